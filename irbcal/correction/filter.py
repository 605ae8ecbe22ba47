"""The filter: programs in, the same programs with fake targets out (Nubiola 2011, section 6.2 and conclusion)."""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from numpy.typing import ArrayLike

from irbcal.cell.cell_file import CellFile, cell_of
from irbcal.correction.backup import Unpacked, packed, unpacked
from irbcal.correction.corrected_targets import CorrectionModel
from irbcal.correction.filter_program import filter_program
from irbcal.correction.filtered import Filtered, together
from irbcal.correction.languages import table
from irbcal.correction.long_tables import correct_long_table
from irbcal.correction.opened_programs import OpenedPrograms, read_programs
from irbcal.correction.paths import Cuttable
from irbcal.correction.program import Note, Program, Unread
from irbcal.correction.text_program import TextProgram
from irbcal.correction.true_frames import ControllerNumbers, TrueFrames, point_origin
from irbcal.errors import OptionError
from irbcal.io.opening import CalibrationLike
from irbcal.io.urdf import speed_limits
from irbcal.measurement import pieces
from irbcal.modeling.robot import carrying_payload
from irbcal.names import csv_bytes
from irbcal.options import Progress, number
from irbcal.safe_files import refuse_overwriting, write_set

CHANGES = "changes.csv"
"""What changed, target by target, in folders and archives that are written of those that were searched."""


@contextmanager
def _without_garbage_collection() -> Iterator[None]:
    """Python's search for cyclic garbage is off within, and as it was before afterwards.

    Tokens and targets by the hundred thousand stay until the program is written; to look through all of them again and
    again finds nothing and takes a fifth of the time.
    """
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


@_without_garbage_collection()
def correct(
    calibration: CalibrationLike,
    program: str | Path | Sequence[str | Path],
    *,
    out: str | Path | None = None,
    allow_partial: bool = False,
    changes: str | Path | None = None,
    tool: Mapping[str, ArrayLike] | None = None,
    wobj: Mapping[str, ArrayLike] | None = None,
    pulses: Sequence[float] | None = None,
    payload: float | None = None,
    payload_place: ArrayLike | None = None,
    controller_model: str | Path | None = None,
    where: tuple[ArrayLike, ArrayLike] | None = None,
    path_tolerance: float | None = None,
    cell: CellFile | str | Path | None = None,
    controller_frames: ControllerNumbers = "same",
    points: str | None = None,
    re_express: bool = False,
    start: ArrayLike | None = None,
    posture: ArrayLike | None = None,
    instructions: str | Path | None = None,
    harmless: Sequence[str] | None = None,
    split_points: bool = False,
    frames_measured: bool = False,
    strict: bool = False,
    progress: Progress | None = None,
) -> Filtered:
    """Replace a program's targets so that the controller with its nominal model reaches the true poses.

    Tables (CSV, Parquet) of a million rows and more, without times, are corrected in pieces, side by side, in memory
    that hardly grows with them, where a file is written and of all options ``allow_partial``, ``payload`` and
    ``payload_place`` alone are used. The result then holds the first targets, and how far all were shifted. Stopped by
    Ctrl-C, it keeps what is done beside that file (``NAME.unfinished``), and the same call goes on from there.

    Parameters
    ----------
    calibration : str, Path, Record or a result that holds one
        Calibration folder, or its content.
    program : str, Path or sequence of these
        File of a language that is known (docs/programs.md), CSV and Parquet of joints or of tip poses among them;
        several files of one language, or a folder or a zip archive, which is searched to its end. A file of several
        that cannot be read is left.
    out : str or Path, optional
        File for the program with fake targets, or, where it lies in several files, the folder for them, or the archive
        (``.zip``) with all files of the one that was given; without it the bytes are in the result only. Beside the
        programs of a folder or an archive lies ``changes.csv``.
    allow_partial : bool
        Write files even if some targets could not be corrected; these stay as they are.
    changes : str or Path, optional
        File for what changed, target by target, as CSV (millimetres and degrees).
    tool, wobj : dict of str to ndarray, shape (4, 4), optional
        ``T_tip_tcp`` of tools and ``T_base_wobj`` of work objects that a program does not define, metres; tip and base
        are the controller's flange and world.
    pulses : sequence of float, optional
        Pulses per degree of the six joints, for Yaskawa jobs whose positions are in pulses.
    payload, payload_place : optional
        See `irbcal.forward_kinematics`.
    controller_model : str or Path, optional
        What the controller itself computes with where that is not the nominal robot: a URDF (``irbcal controller``
        writes one), or joint origins in the layout of ``ur_description``'s calibration files. Poses of the program, its
        tools and its work objects are then those of this model. ``nominal`` says that it is the nominal robot, though
        a backup says that the controller corrects its robot itself.
    where : tuple, optional
        For poses of Kawasaki programs: joints (6,) as the controller counts them, radians, and the pose (4, 4), metres,
        that it reports there with null tool and null base.
    path_tolerance : float, optional
        Put points into straight and circular moves, so that the tool centre point leaves the wanted path by less than
        this, metres. For RAPID.
    cell : CellFile, str or Path, optional
        True tools and work objects, as ``irbcal cell`` writes them (`irbcal.correction.true_frames`).
    controller_frames : str
        Which numbers the controller will have for them: ``same`` as now, or those ``from-cell``.
    points : str, optional
        ``offline``: coordinates of points are wanted. ``taught``, or ``taught:PATTERN`` of their names: they were shown
        on the real robot, so they stay as they are. ``offline`` unless given.
    re_express : bool
        Rewrite the taught points as offline points of the true frames, and correct nothing.
    start : ndarray, shape (6,), optional
        Joints where the program begins, as the controller counts them, radians. Poses whose configuration the program
        does not say are meant next to the stop before.
    posture : ndarray, shape (6,), optional
        Joints in whose configuration, and next to which, poses are meant where the program does not say it and no stop
        before is known; radians.
    instructions : str or Path, optional
        File that teaches motion instructions of RAPID and INFORM, and routines of KRL, AS, URScript and VAL3 that move
        to one of their arguments, a line each: ``rapid ArcL to speed seam weld * tool``, ``krl DISPENSE to bead``
        (`irbcal.correction.instructions`).
    harmless : sequence of str, optional
        Names of routines, or patterns of names with ``*``, that the programs call and that are not among them: they
        neither move the robot nor set its tool or work object.
    split_points : bool
        Put a point of its own, in numbers, into moves that go to another point with an offset in numbers, and correct
        it by itself. For RAPID, KRL, VAL3 and Kawasaki.
    frames_measured : bool
        Tools and work objects that are not in the cell file were measured independently of the robot.
    strict : bool
        Write nothing where tools or work objects are of unknown origin.
    progress : callable, optional
        Called with a short text after each piece of a long table.

    Raises
    ------
    NotWritten
        If a file is asked for, and no target could be corrected, or not all while ``allow_partial`` is false; if
        ``strict``, and a tool or work object is of unknown origin.
    ProgramError
        If the program cannot be read, was filtered before, or needs a frame that is not known.
    RobotError
        If the arm has fewer than six joints, or poses do not tell its joints.
    CalibrationError
        If the calibration or the cell cannot be read, the cell is of another calibration, or a file cannot be written.
    OptionError
        If options contradict each other, a frame is not a rigid transform, or two files to write are the same.

    Examples
    --------
    >>> filtered = correct("my-robot", "job.mod", out="job_calibrated.mod")  # doctest: +SKIP
    >>> filtered.to_frame()  # doctest: +SKIP
    """
    programs_given = [program] if isinstance(program, (str, os.PathLike)) else [*program]
    if not programs_given:
        raise OptionError("program: expected a file, found none", parameter="program")
    read_too = [path for path in (controller_model, cell, instructions) if isinstance(path, (str, os.PathLike))]
    refuse_overwriting({"out": out, "changes": changes}, [*programs_given, *read_too], calibration)
    endings = {Path(name).suffix.lower() for name in (out, programs_given[0]) if name is not None}
    if endings == set(table.ENDINGS):
        ending = Path(programs_given[0]).suffix
        raise OptionError(f"out: expected a name that ends in {ending}, as that of the table", parameter="out")
    others = tool, wobj, pulses, controller_model, where, path_tolerance, cell, start, posture, instructions, harmless
    plain = changes is None and points in (None, "offline") and not any(option is not None for option in others)
    if out is not None and plain and len(programs_given) == 1 and not (re_express or split_points or strict):
        long = pieces.long_table(Path(programs_given[0]))
        if long is not None and table.TIME not in pieces.header(long):
            return correct_long_table(calibration, long, Path(out), allow_partial, payload, payload_place, progress)
    with unpacked(programs_given) as files:
        opened = read_programs(
            calibration,
            files.programs,
            tool=tool,
            wobj=wobj,
            pulses=pulses,
            controller_model=controller_model,
            where=where,
            start=start,
            posture=posture,
            instructions=instructions,
            harmless=harmless,
            split_points=split_points,
        )
        tolerance = None if path_tolerance is None else number("path_tolerance", path_tolerance, 1e-6, 1.0)
        origin = point_origin(points, re_express)
        if split_points and (origin.taught or tolerance is not None):
            raise OptionError(
                "split_points: goes with offline points, and without a path tolerance", parameter="split_points"
            )
        known_cell = None if cell is None else cell_of(cell, opened.record.fingerprint)
        true_frames = TrueFrames(known_cell, frames_measured, controller_frames, origin, opened.setup.controller)
        true_frames.check(tolerance is not None)
        programs = _in_cell(opened, known_cell)
        robot = carrying_payload(opened.record.robot_calibrated(), payload, payload_place)
        model = CorrectionModel(
            robot=robot if opened.model is None else opened.model.seen_by_it(robot),
            nominal=opened.nominal,
            fingerprint=opened.record.fingerprint,
            controller=opened.setup.own_model,
            true_frames=true_frames,
            path_tolerance=tolerance,
            speeds=None if opened.urdf is None else speed_limits(opened.urdf, opened.nominal.joint_names),
            follow_loads=payload is None,
        )
        if tolerance is not None and not all(isinstance(each, (Cuttable, Unread)) for each in programs):
            raise OptionError(
                "path_tolerance: points are put into moves of RAPID only, where a move can name its point in numbers; "
                f"this is {opened.files.language.name}",
                parameter="path_tolerance",
            )
        filtered = _with_remarks(
            together(
                [filter_program(program_read, model) for program_read in programs],
                {str(path): place.as_posix() for path, place in opened.files.relative.items()},
            ),
            opened,
            model,
        )
        if strict and filtered.unknown_frames is not None:
            raise filtered.not_written(filtered.unknown_frames.in_words())
        if out is not None or changes is not None:
            if not len(filtered.targets) or (filtered.left and not allow_partial):
                raise filtered.not_written()
            folder = len(filtered.files) > 1 or len(opened.files.files) > 1
            filtered = _written(filtered, out, changes, folder, files)
        # files in archives are named as the caller knows them
        contents = {files.shown(name): data for name, data in filtered.files.items()}
        return replace(filtered, files=contents, source=files.shown(filtered.source))


def _in_cell(opened: OpenedPrograms, cell: CellFile | None) -> Sequence[Program]:
    """The programs with the external axes of the cell.

    Raises
    ------
    OptionError
        If the robot stands elsewhere in the controller's world than in the cell.
    """
    if cell is None:
        return opened.programs
    if opened.setup.T_world_base is not None:
        message = "cell: its frames are seen from the robot, which the backup places elsewhere in its world"
        raise OptionError(f"{message}: correct the programs outside of the backup", parameter="cell")
    if not cell.axes:
        return opened.programs
    return [program.on_axes(cell.axes) if isinstance(program, TextProgram) else program for program in opened.programs]


def _with_remarks(filtered: Filtered, opened: OpenedPrograms, model: CorrectionModel) -> Filtered:
    """The corrections with what calibration, controller and files say of all of them."""
    cautions = [] if opened.model is None else [opened.model.in_words(model.robot, filtered.q_before)]
    if model.robot.certainty is not None:
        cautions.append(model.robot.certainty.outside_in_words(filtered.q_before, "targets"))
        if model.true_frames.measured:
            cautions.append(model.robot.certainty.open_ends_in_words())
    skipped = [Note(1, f"{path.name} was skipped: {reason}") for path, reason in opened.files.skipped]
    return replace(
        filtered,
        cautions=tuple(filter(None, cautions)),
        notes=(*filtered.notes, *skipped, *opened.notes),
        expected_error=opened.record.expected_error,
    )


def _written(
    filtered: Filtered, out: str | Path | None, changes: str | Path | None, folder: bool, given: Unpacked
) -> Filtered:
    """Write what was asked for, all or nothing; files of folders that were searched lie as they did there."""
    searched = [path for path in given.programs if path.is_dir()]
    contents: dict[Path, bytes] = {}

    def table_of_changes() -> bytes:
        return csv_bytes(filtered.to_frame(), float_format="%.6f")

    if changes is not None:
        contents[Path(changes)] = table_of_changes()
    if out is not None and Path(out).suffix.lower() == ".zip":
        if len(given.archives) != 1 or len(given.programs) != 1:
            raise OptionError("out: a zip archive is written of one that was given, expected a folder", parameter="out")
        ((inside, archive),) = given.archives.items()
        files = {Path(name).relative_to(inside).as_posix(): data for name, data in filtered.files.items()}
        contents[Path(out)] = packed(archive, {CHANGES: table_of_changes()} | files)
        filtered = replace(filtered, written=Path(out))
    elif out is not None:
        targets_of_files = _places(Path(out), filtered.files, folder, searched)
        if searched and folder:
            targets_of_files.setdefault(Path(out) / CHANGES, table_of_changes())
        refuse_overwriting({"out": [*targets_of_files], "changes": changes}, [*filtered.files])
        contents |= targets_of_files
        filtered = replace(filtered, written=Path(out))
    write_set(contents)
    return filtered


def _places(out: Path, files: Mapping[str, bytes], folder: bool, searched: Sequence[Path]) -> dict[Path, bytes]:
    """Where files go: all into a folder, or the one into a file."""
    if not folder:
        return {out: next(iter(files.values()))}
    if out.is_file() or (not out.is_dir() and out.suffix and out.suffix == Path(next(iter(files))).suffix):
        file_names = ", ".join(Path(name).name for name in files)
        raise OptionError(f"out: expected a folder for {file_names}, found the file {out}", parameter="out")
    inside = {name: next((root for root in searched if Path(name).is_relative_to(root)), None) for name in files}
    relative = {
        name: Path(name).name if root is None else Path(name).relative_to(root) for name, root in inside.items()
    }
    return {out / relative[name]: data for name, data in files.items()}
