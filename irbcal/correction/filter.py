"""The filter: a program in, the same program with fake targets out (Nubiola 2011, section 6.2 and conclusion)."""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from irbcal import __version__, parallel
from irbcal.arrays import FloatArray
from irbcal.cell.cell_file import CellFile, cell_of, frames_by_name
from irbcal.correction import languages, unfinished
from irbcal.correction.backup import Unpacked, of_programs, packed, unpacked
from irbcal.correction.corrected_targets import UNCHANGED, as_written, corrected, counted, of_arm, refused, writable
from irbcal.correction.fake_targets import Corrected
from irbcal.correction.filtered import SHOWN, Filtered, together
from irbcal.correction.instructions import read as taught
from irbcal.correction.languages import table
from irbcal.correction.last_moves import MOST, LastMoves, with_last_moves
from irbcal.correction.loads import Carried
from irbcal.correction.maker import BEYOND
from irbcal.correction.paths import CutPath, Cuttable, Ends, cut_move
from irbcal.correction.program import (
    ControllerSetup,
    Corrections,
    Left,
    Note,
    Program,
    Unread,
    WantedTargets,
    read_bytes,
    refuse_filtered,
)
from irbcal.correction.text_program import PROBE, TextProgram
from irbcal.correction.trajectories import Timed, follow
from irbcal.correction.true_frames import ControllerNumbers, TargetFrames, TrueFrames, point_origin
from irbcal.correction.unfinished import CorrectedPieces
from irbcal.errors import OptionError, ProgramError
from irbcal.io.calibration_folder import read
from irbcal.io.controller_model import (
    ControllerFrames,
    ControllerModel,
    controller_frames,
    controller_kinematics,
    unknown_frames,
)
from irbcal.io.opening import CalibrationLike, open_calibration
from irbcal.io.schema import Record
from irbcal.io.urdf import speed_limits
from irbcal.measurement import pieces
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.inverse import any_arm
from irbcal.modeling.robot import Robot, loaded
from irbcal.names import csv_bytes
from irbcal.options import names, number, pulses_per_degree, shown
from irbcal.safe_files import refuse_overwriting, write_set
from irbcal.units import MM

CHANGES = "changes.csv"
"""What changed, target by target, in folders and archives that are written of those that were searched."""
NOMINAL = "nominal"
"""The controller model that is the nominal robot."""


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


class NotWritten(ProgramError):
    """Files were asked for, but not everything (or nothing) could be corrected, so none was written.

    Attributes
    ----------
    filtered : Filtered
        What was corrected, and what was left and why.
    """

    filtered: Filtered


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
    progress: Callable[[str], Any] | None = None,
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
        Mass carried, kg, and its centre in the tip link (3,), metres; those of most poses of the fit unless given.
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
    inputs = [*programs_given, *read_too]
    refuse_overwriting({"out": out, "changes": changes}, inputs, calibration)
    endings = {Path(name).suffix.lower() for name in (out, programs_given[0]) if name is not None}
    if endings == set(table.ENDINGS):
        ending = Path(programs_given[0]).suffix
        raise OptionError(f"out: expected a name that ends in {ending}, as that of the table", parameter="out")
    others = tool, wobj, pulses, controller_model, where, path_tolerance, cell, start, posture, instructions, harmless
    plain = changes is None and points in (None, "offline") and not any(option is not None for option in others)
    if out is not None and plain and len(programs_given) == 1 and not (re_express or split_points or strict):
        long = pieces.long_table(Path(programs_given[0]))
        if long is not None and table.TIME not in pieces.header(long):
            return _correct_long(calibration, long, Path(out), allow_partial, payload, payload_place, progress)
    with unpacked(programs_given) as files:
        places = start, posture, instructions, harmless, split_points
        opened = read_programs(calibration, files.programs, tool, wobj, pulses, controller_model, where, *places)
        record, nominal, given, programs, setup, model, urdf, backup_notes = opened
        language = given.language
        tolerance = None if path_tolerance is None else number("path_tolerance", path_tolerance, 1e-6, 1.0)
        origin = point_origin(points, re_express)
        if split_points and (origin.taught or tolerance is not None):
            raise OptionError(
                "split_points: goes with offline points, and without a path tolerance", parameter="split_points"
            )
        true_frames = TrueFrames(
            None if cell is None else cell_of(cell, record.fingerprint),
            frames_measured,
            controller_frames,
            origin,
            setup.controller,
        )
        true_frames.check(path_tolerance is not None)
        if true_frames.cell is not None and setup.T_world_base is not None:
            message = "cell: its frames are seen from the robot, which the backup places elsewhere in its world"
            raise OptionError(f"{message}: correct the programs outside of the backup", parameter="cell")
        if true_frames.cell is not None and true_frames.cell.axes:
            axes = true_frames.cell.axes
            programs = [program.on_axes(axes) if isinstance(program, TextProgram) else program for program in programs]
        robot = loaded(record.robot_calibrated(), payload, payload_place)
        robot = robot if model is None else model.seen_by_it(robot)
        readable = [program_read for program_read in programs if not isinstance(program_read, Unread)]
        if tolerance is not None and not all(isinstance(program_read, Cuttable) for program_read in readable):
            raise OptionError(
                "path_tolerance: points are put into moves of RAPID only, where a move can name its point in numbers; "
                f"this is {language.NAME}",
                parameter="path_tolerance",
            )
        speeds = None if urdf is None else speed_limits(urdf, nominal.joint_names)
        common = record.fingerprint, setup.own_model, tolerance, speeds
        filtered = together(
            [
                filter_program(robot, nominal, program_read, *common, true_frames, payload is None)
                for program_read in programs
            ],
            {str(path): place.as_posix() for path, place in given.relative.items()},
        )
        skipped = tuple(Note(1, f"{path.name} was skipped: {reason}") for path, reason in given.skipped)
        filtered = replace(filtered, notes=(*filtered.notes, *skipped))
        if robot.certainty is not None and (outside := robot.certainty.outside_in_words(filtered.q_before, "targets")):
            filtered = replace(filtered, cautions=(outside,))
        if robot.certainty is not None and frames_measured and (ends := robot.certainty.open_ends_in_words()):
            filtered = replace(filtered, cautions=(*filtered.cautions, ends))
        if model is not None:
            filtered = replace(filtered, cautions=(model.in_words(robot, filtered.q_before), *filtered.cautions))
        if record.heldout is not None and record.features is None:  # rows at features tell no accuracy
            filtered = replace(filtered, expected_error=record.heldout.all.mean_mm * MM)
        filtered = replace(filtered, notes=(*filtered.notes, *backup_notes))
        if strict and filtered.unknown_frames is not None:
            raise _not_written(filtered, filtered.unknown_frames.in_words())
        if out is None and changes is None:
            return _as_given(filtered, files)
        if not len(filtered.targets) or (filtered.left and not allow_partial):
            raise _not_written(filtered)
        folder = len(filtered.files) > 1 or len(given.files) > 1
        return _as_given(_written(filtered, out, changes, folder, files), files)


ROWS_BEFORE = 100
"""Rows before a piece of a long table that tell from where the robot comes to its first."""
MOST_LEFT = 10_000
"""Rows of a long table that were left as they were, and are named."""
PIECE_S = 1.0
"""Seconds that a piece of a long table takes, about."""


@dataclass(frozen=True, eq=False)
class _ForAllPieces:
    """What all pieces of a long table have in common."""

    robot: Robot
    nominal: Arm
    fingerprint: str
    follow_loads: bool


def _corrected_piece(shared: _ForAllPieces, piece: pieces.Piece) -> tuple[bytes, Filtered]:
    """In a worker: a piece with its fake targets, as a table; and what was done, without the bytes."""
    data, before = pieces.content(piece, ROWS_BEFORE)
    offset = piece.row - before
    try:
        program = table.parse(data, piece.path, shared.nominal.joint_columns)
        program = replace(program, rows=program.rows + offset)
    except ProgramError as error:
        raise error if error.row in (None, 1) else pieces.with_row_of_file(error, offset) from None
    filtered = filter_program(
        shared.robot, shared.nominal, program, shared.fingerprint, follow_loads=shared.follow_loads
    )
    if len(filtered.targets):
        written = filtered.data
    else:
        written = table.with_values(
            program, program.values, shared.fingerprint, np.zeros(len(program.rows), dtype=bool)
        )
    first_line = program.rows[before]
    inside = filtered.lines >= first_line
    certainty = shared.robot.certainty
    outside = "" if certainty is None else certainty.outside_in_words(filtered.q_before[inside], "targets")
    first = np.flatnonzero(inside)[:SHOWN]
    arrays = ("targets", "lines", "q_before", "q", "shift", "turn", "residual", "places")
    small = replace(
        filtered,
        **{name: getattr(filtered, name)[first] for name in arrays},
        files={},
        left=tuple(left for left in filtered.left if left.line >= first_line),
        last_move_error=None,
        last_moves=None,
        frames=None,
        way=np.arange(len(first)),
        cautions=(outside,) if outside else (),
        shifts=filtered.shift[inside],
    )
    return table.rows_from(written, before), small


def _correct_long(
    calibration: CalibrationLike,
    file: pieces.LongFile,
    out: Path,
    allow_partial: bool,
    payload: float | None,
    payload_place: ArrayLike | None,
    progress: Callable[[str], Any] | None,
) -> Filtered:
    """Correct a long table in pieces, whose rows are written in their order: all of them, or nothing."""
    record = open_calibration(calibration)
    robot = loaded(record.robot_calibrated(), payload, payload_place)
    shared = _ForAllPieces(robot, record.arm(calibrated=False), record.fingerprint, payload is None)
    place = None if payload_place is None else np.asarray(payload_place).tolist()
    call = [__version__, file.sha256, len(file.pieces), record.fingerprint, allow_partial, payload, place]
    first: Filtered | None = None
    done = CorrectedPieces()

    def add(filtered: Filtered) -> None:
        done.pieces += 1
        done.left += filtered.left[: max(MOST_LEFT - len(done.left), 0)]
        done.notes = [*dict.fromkeys((*done.notes, *filtered.notes))]
        done.cautions += filtered.cautions
        done.unchanged += filtered.unchanged
        done.shifts.append(filtered.all_shifts)

    def write(stream: BinaryIO) -> None:
        nonlocal done, first
        writer = table.TableWriter(stream)
        if begun := unfinished.kept(out, call):
            rows, done = begun
            writer.begin_with(rows)
            first = _corrected_piece(shared, file.pieces[0])[1]
        early: dict[int, tuple[bytes, Filtered]] = {}
        start = done.pieces
        try:
            for index, corrected_piece in parallel.each(_corrected_piece, shared, file.pieces[start:], seconds=PIECE_S):
                early[start + index] = corrected_piece
                while done.pieces in early:
                    rows_written, filtered = early.pop(done.pieces)
                    writer.append(rows_written)
                    first = first or filtered
                    add(filtered)
                    if progress is not None:
                        progress(f"{done.pieces} of {len(file.pieces)} pieces")
                    if filtered.left and not allow_partial:
                        raise _not_written(replace(filtered, left=tuple(done.left)))
        except KeyboardInterrupt:
            if not done.pieces:
                raise
            writer.close()
            unfinished.keep(out, Path(stream.name), call, done)
            raise parallel.Interrupted(len(file.pieces) - done.pieces, "pieces of the table to correct") from None
        assert first is not None
        if not any(map(len, done.shifts)):
            raise _not_written(replace(first, left=tuple(done.left)))
        writer.close()

    write_set({out: write})
    assert first is not None
    unfinished.forget(out)
    cautions = pieces.once(done.cautions, len(file.pieces))
    if len(done.left) == MOST_LEFT:
        cautions = (*cautions, f"Of the targets that were left as they were the first {MOST_LEFT} are named.")
    expected = None if record.heldout is None or record.features is not None else record.heldout.all.mean_mm * MM
    return replace(
        first,
        left=tuple(done.left),
        notes=tuple(done.notes),
        cautions=cautions,
        expected_error=expected,
        written=out,
        unchanged=done.unchanged,
        shifts=np.concatenate(done.shifts),
    )


class OpenedPrograms(NamedTuple):
    """Programs as read for the robot of a calibration.

    Attributes
    ----------
    record : Record
    nominal : Arm
    files : ProgramFiles
    programs : sequence of Program
    setup : ControllerSetup
        What the controller computes with.
    model : ControllerModel or None
        Where that is not the nominal robot.
    urdf : bytes or None
        Of the calibration, where it is at hand.
    notes : sequence of Note
        What the backup says in which the programs lie.
    """

    record: Record
    nominal: Arm
    files: languages.ProgramFiles
    programs: Sequence[Program]
    setup: ControllerSetup
    model: ControllerModel | None
    urdf: bytes | None
    notes: Sequence[Note] = ()


def read_programs(
    calibration: CalibrationLike,
    program: Sequence[str | Path],
    tool: Mapping[str, ArrayLike] | None = None,
    wobj: Mapping[str, ArrayLike] | None = None,
    pulses: Sequence[float] | None = None,
    controller_model: str | Path | None = None,
    where: tuple[ArrayLike, ArrayLike] | None = None,
    start: ArrayLike | None = None,
    posture: ArrayLike | None = None,
    instructions: str | Path | None = None,
    harmless: Sequence[str] | None = None,
    split_points: bool = False,
) -> OpenedPrograms:
    """Read programs for the robot of a calibration; arguments and errors as of `correct`."""
    files = languages.files_of(program)
    language = files.language
    record = open_calibration(calibration)
    nominal = record.arm(calibrated=False)
    urdf = _urdf(calibration)
    own = controller_model is not None and str(controller_model) != NOMINAL
    model = controller_kinematics(str(controller_model), record, urdf) if own else None
    ends = _controller(urdf, record)
    frames_given = frames_by_name(tool, "tool"), frames_by_name(wobj, "wobj")
    counts, controller_arm = pulses_per_degree(pulses), None if model is None else model.arm
    places = [joints_of_place(name, q, nominal, language) for name, q in (("start", start), ("posture", posture))]
    setup = ControllerSetup(
        *frames_given, ends, counts, controller_arm, place_pair(where, language), places[0], places[1]
    )
    setup = setup._replace(harmless=names("harmless", harmless or ()), split_points=split_points)
    if instructions is not None:
        setup = setup._replace(instructions=taught(instructions))
    backup = of_programs(languages.name_of(language), files.files)
    if backup.accuracy and controller_model is None:
        raise ProgramError(
            f"{backup.accuracy}: fake targets would correct it twice; give what the controller computes with "
            f"(--controller-model), or say --controller-model {NOMINAL} where that is switched off, or the URDF that "
            "was calibrated has these numbers",
            file=files.files[0],
        )
    notes: list[Note] = []
    if backup.T_world_base is not None:
        x, y, z = backup.T_world_base[:3, 3] / MM
        place = (
            f"the robot stands at {x:.3f}, {y:.3f}, {z:.3f} mm in the controller's world ({Path(backup.source).name})"
        )
        notes.append(Note(1, f"{place}: bases and work objects, given ones too, count from the world"))
        setup = setup._replace(T_world_base=backup.T_world_base)
    programs = language.read_for(nominal, files.files, setup)
    return OpenedPrograms(record, nominal, files, programs, setup, model, urdf, notes)


def _as_given(filtered: Filtered, files: Unpacked) -> Filtered:
    """The result with the names of files in archives as the caller knows them."""
    contents = {files.shown(name): data for name, data in filtered.files.items()}
    return replace(filtered, files=contents, source=files.shown(filtered.source))


def _written(
    filtered: Filtered, out: str | Path | None, changes: str | Path | None, folder: bool, given: Unpacked
) -> Filtered:
    """Write what was asked for, all or nothing; files of folders that were searched lie as they did there."""
    searched = [path for path in given.programs if path.is_dir()]
    contents: dict[Path, bytes] = {}

    def table() -> bytes:
        return csv_bytes(filtered.to_frame(), float_format="%.6f")

    if changes is not None:
        contents[Path(changes)] = table()
    if out is not None and Path(out).suffix.lower() == ".zip":
        if len(given.archives) != 1 or len(given.programs) != 1:
            raise OptionError("out: a zip archive is written of one that was given, expected a folder", parameter="out")
        ((inside, archive),) = given.archives.items()
        files = {Path(name).relative_to(inside).as_posix(): data for name, data in filtered.files.items()}
        contents[Path(out)] = packed(archive, {CHANGES: table()} | files)
        filtered = replace(filtered, written=Path(out))
    elif out is not None:
        targets_of_files = _places(Path(out), filtered.files, folder, searched)
        if searched and folder:
            targets_of_files.setdefault(Path(out) / CHANGES, table())
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


def _urdf(calibration: CalibrationLike) -> bytes | None:
    """The calibration's URDF where that is at hand."""
    data = read(calibration).urdf if isinstance(calibration, (str, os.PathLike)) else getattr(calibration, "urdf", None)
    return data if isinstance(data, bytes) else None


def _controller(data: bytes | None, record: Record) -> ControllerFrames:
    """The controller's world and flange, from the calibration's URDF where that is at hand."""
    if data is None:
        return unknown_frames()
    return controller_frames(data, "calibrated.urdf", record.robot.base_link, record.robot.tip_link)


def place_pair(
    where: tuple[ArrayLike, ArrayLike] | None, language: languages.Language
) -> tuple[FloatArray, FloatArray] | None:
    """Joints and the pose that the controller reports there, from the caller.

    Raises
    ------
    OptionError
        If they are none, or the language asks for none.
    """
    if where is None:
        return None
    if language.MAKER is None or not language.MAKER.asks_where:
        raise OptionError(f"where: {language.NAME} programs need no pair of joints and pose", parameter="where")
    try:
        joints, pose = np.array(where[0], dtype=float), np.array(where[1], dtype=float)
    except (TypeError, ValueError, IndexError):
        joints, pose = np.zeros(0), np.zeros(0)
    if joints.shape != (6,) or pose.shape != (4, 4) or not (np.isfinite(joints).all() and np.isfinite(pose).all()):
        raise OptionError("where: expected joints of shape (6,) and a pose of shape (4, 4)", parameter="where")
    return joints, frames_by_name({"pose": pose}, "where")["pose"]


def joints_of_place(name: str, q: ArrayLike | None, nominal: Arm, language: languages.Language) -> FloatArray | None:
    """Joints of the URDF from those of the controller (6,), radians; None where there are none.

    Raises
    ------
    OptionError
        If they are not six numbers, or beyond the limits of the arm.
    """
    if q is None:
        return None
    try:
        joints = np.array(q, dtype=float)
    except (TypeError, ValueError):
        joints = np.zeros(0)
    if not nominal.six_revolute:
        message = f"{name} is for arms with six revolute joints, {nominal.name} has {nominal.joints_listed}"
        raise OptionError(message, parameter=name)
    if joints.shape != (6,):
        raise OptionError(f"{name}: expected six joints, found {shown(q)}", parameter=name)
    maker = language.MAKER
    joints = nominal.from_controller(joints[None])[0] if maker is None else maker.of(nominal).joints(joints)
    if not ((joints >= nominal.lower - BEYOND) & (joints <= nominal.upper + BEYOND)).all():
        raise OptionError(f"{name}: the joints are beyond the limits of {nominal.name}", parameter=name)
    return joints


def _not_written(filtered: Filtered, reason: str = "") -> NotWritten:
    if reason:
        message = f"nothing was written: {reason}"
    elif not len(filtered.targets):
        taught = f", and {filtered.unchanged} need no change" if filtered.unchanged else ""
        message = f"nothing was written: no target could be corrected{taught}"
    else:
        first = filtered.left[0]
        more = f" and {len(filtered.left) - 1} more" if len(filtered.left) > 1 else ""
        message = (
            f"nothing was written, because {first.target} (line {first.line}){more} could not be corrected: correct "
            "these targets or allow a partial correction (allow_partial)"
        )
    refusal = NotWritten(message, file=filtered.source)
    refusal.filtered = filtered
    return refusal


def filter_program(
    robot: Robot,
    nominal: Arm,
    program: Program,
    fingerprint: str,
    controller: Arm | None = None,
    path_tolerance: float | None = None,
    speeds: FloatArray | None = None,
    true_frames: TrueFrames | None = None,
    follow_loads: bool = False,
) -> Filtered:
    """Correct the targets of a program as read.

    Parameters
    ----------
    robot : Robot
        Calibrated.
    nominal : Arm
        What the controller computes with.
    program : Program
        See `irbcal.correction.languages`.
    fingerprint : str
        Of the calibration; goes into the mark.
    controller : Arm, optional
        What the controller computes with where that is not the nominal arm.
    path_tolerance : float, optional
        As for `correct`; the program must be `irbcal.correction.paths.Cuttable`.
    speeds : ndarray, shape (joints,), optional
        Largest speeds of the joints, which trajectories must keep to, rad/s (m/s).
    true_frames : TrueFrames, optional
        What is known of tools and work objects; without it nothing is.
    follow_loads : bool
        The robot carries what the program says; else what ``robot`` carries everywhere.

    Raises
    ------
    ProgramError
        If the program was filtered before.
    RobotError
        As `irbcal.correction.fake_targets.correct_joints` and `irbcal.correction.fake_targets.correct_poses`.
    """
    refuse_filtered(program)
    true_frames = true_frames or TrueFrames()
    batches = of_arm(program, nominal)
    frames_of = [true_frames.frames_of(program, batch, controller or nominal) for batch in batches]
    follow_loads &= robot.joint_map.knows_loads
    carried = [Carried.at(robot, batch) if follow_loads and batch.loads else None for batch in batches]
    uncoupled = [
        (batch, _corrected_carrying(robot, load, nominal, batch, controller, at, true_frames))
        for batch, at, load in zip(batches, frames_of, carried, strict=True)
    ]
    moving = Robot(controller or nominal) if true_frames.points.re_express else robot
    corrections, program, left, last_moves = _in_course(
        moving, nominal, program, uncoupled, controller, speeds, carried
    )
    corrections = [
        (batch, writable(program, nominal, batch, as_written(nominal, batch, fake, controller, at, true_frames)))
        for (batch, fake), at in zip(corrections, frames_of, strict=True)
    ]
    robots: dict[int, Robot] = {}
    for batch, of_batch in zip(batches, carried, strict=True):
        loads, which = ([], np.zeros(0, dtype=int)) if of_batch is None else of_batch.groups()
        loaded_robots = [robot.carrying(*load) for load in loads]
        robots |= {int(number): loaded_robots[k] for number, k in zip(batch.numbers[: len(which)], which, strict=True)}
    shift_notes: list[Note] = []
    if isinstance(program, TextProgram) and program.shifts:
        corrections, shift_notes = _with_shifts(
            robot, robots, nominal, program, corrections, controller, true_frames, frames_of
        )
    corrected_names: list[str] = []
    unchanged = 0
    for batch, fake in corrections:
        corrected_names += [batch.names[k] for k in np.flatnonzero(fake.ok)]
        unlike = [k for k in np.flatnonzero(~fake.ok) if fake.reason[k] not in UNCHANGED]
        left += [Left(batch.names[k], int(batch.lines[k]), fake.reason[k]) for k in unlike]
        unchanged += int((~fake.ok).sum()) - len(unlike)
    fakes = [fake for _, fake in corrections]
    rows = {int(n): k for k, n in enumerate(n for batch, fake in corrections for n in batch.numbers[fake.ok])}
    stops = (stop.target for stop in program.stops())
    way = [rows[number] for number in stops if number is not None and number in rows]
    places = [_places_of_tool(robot, *row) for row in zip(fakes, frames_of, carried, strict=True)]
    cuts: list[CutPath] = []
    if path_tolerance is not None and isinstance(program, Cuttable):
        ends = _ends(corrections)
        cuts = [
            cut_move(
                move,
                ends,
                robot if move.to is None else robots.get(move.to, robot),
                nominal,
                path_tolerance,
                controller,
            )
            for move in program.path_moves()
        ]
        left += [Left(f"the path of {cut.move.name}", cut.move.line, cut.why) for cut in cuts if cut.why]
        program = program.with_cuts(cuts)
    none = np.zeros((0, len(nominal.joint_names)))
    last_move_error = None
    if last_moves is not None:
        errors = [error[fake.ok] for error, fake in zip(last_moves.errors, fakes, strict=True)]
        last_move_error = np.concatenate([none[:, 0], *errors])
    return Filtered(
        source=program.source,
        files=program.with_fake_targets(
            counted(corrections, program, nominal), None if true_frames.points.re_express else fingerprint
        ),
        targets=np.array(corrected_names, dtype=object),
        lines=np.concatenate([np.zeros(0, dtype=int), *(batch.lines[fake.ok] for batch, fake in corrections)]),
        q_before=np.concatenate([none, *(fake.q_nominal[fake.ok] for fake in fakes)]),
        q=np.concatenate([none, *(fake.q[fake.ok] for fake in fakes)]),
        shift=np.concatenate([none[:, 0], *(fake.shift[fake.ok] for fake in fakes)]),
        turn=np.concatenate([none[:, 0], *(fake.turn[fake.ok] for fake in fakes)]),
        residual=np.concatenate([none[:, 0], *(fake.residual[fake.ok] for fake in fakes)]),
        left=tuple(sorted(left, key=lambda target: target.line)),
        notes=(
            *program.notes,
            *shift_notes,
            *(last_moves.notes if last_moves else ()),
            *_load_notes(robot, program, corrections, carried),
        ),
        joint_columns=tuple(nominal.joint_columns),
        fingerprint=fingerprint,
        last_move_error=last_move_error,
        last_moves=None if last_moves is None else (last_moves.known, last_moves.stops),
        coupling=nominal.coupling,
        paths=tuple(cuts) if path_tolerance is not None else None,
        frames=TargetFrames.of(robot, controller or nominal, corrections, frames_of, true_frames),
        unchanged=unchanged,
        places=np.concatenate([np.zeros((0, 3, 3)), *places]),
        way=np.array(way, dtype=int),
    )


def _corrected_carrying(
    robot: Robot,
    carried: Carried | None,
    nominal: Arm,
    batch: WantedTargets,
    controller: Arm | None,
    at: TargetFrames,
    true_frames: TrueFrames,
) -> Corrected:
    """Fake targets of goals, each for what the robot carries there."""
    if carried is None:
        return corrected(robot, nominal, batch, controller, at, true_frames)
    loads, which = carried.groups()
    fakes = [corrected(robot.carrying(*load), nominal, batch, controller, at, true_frames) for load in loads]
    rows = np.arange(len(which))
    names = [part.name for part in fields(Corrected)]
    return refused(
        Corrected(**{name: np.stack([getattr(fake, name) for fake in fakes])[which, rows] for name in names}),
        [f"{reason}: say with --payload what the robot carries" if reason else "" for reason in carried.reasons],
    )


def _load_notes(
    robot: Robot, program: Program, corrections: Corrections, carried: Sequence[Carried | None]
) -> list[Note]:
    """Notes where a program says what the robot carries, and the calibration knows what loads do."""
    if not robot.joint_map.knows_loads or not isinstance(program, TextProgram) or not program.loads.names_any:
        return []
    at = program.names_loads[0] if program.names_loads else 0
    more = f" and {len(program.names_loads) - 1} more" if len(program.names_loads) > 1 else ""
    said = f"{program.listing.quote_line(at)}{more}: " if program.names_loads else ""
    line = program.listing.line(at)
    if not any(carried):
        usual = f"{robot.joint_map.payload_kg:g} kg"
        return [Note(line, f"{said}the program says what the robot carries; all targets are corrected for {usual}")]
    masses = np.concatenate([load.mass[fake.ok] for (_, fake), load in zip(corrections, carried, strict=True) if load])
    counts = [f"{mass:g} kg ({count})" for mass, count in zip(*np.unique(masses, return_counts=True), strict=True)]
    words = "targets are corrected for what the program says that the robot carries, tool and part"
    out = [Note(line, f"{said}{words}: {', '.join(counts) or 'none'}; --payload says another mass for all")]
    apart = [
        (off, batch.names[k], int(batch.lines[k]), load.several[k])
        for (batch, fake), load in zip(corrections, carried, strict=True)
        if load is not None
        for k, off in load.apart(robot, fake)
    ]
    apart.sort(key=lambda entry: -entry[0])
    for off, name, line, several in apart[:MOST]:
        loads = " and ".join(f"{mass:g}" for mass, _ in several)
        text = f"{name} is reached with {loads} kg: it is corrected for the mean, off by up to {off / MM:.3f} mm"
        out.append(Note(line, f"{text}; two targets would do better"))
    if len(apart) > MOST:
        text = f"so are {len(apart) - MOST} more targets, off by up to {apart[MOST][0] / MM:.3f} mm"
        out.append(Note(apart[MOST][2], text))
    return out


def _places_of_tool(robot: Robot, fake: Corrected, at: TargetFrames, carried: Carried | None) -> FloatArray:
    """Tool centre points of corrected targets, (n, 3, 3): wanted, before and after the correction; in the base link."""
    ok = fake.ok
    load = {} if carried is None else {"payload_kg": carried.mass[ok], "payload_place": carried.centre[ok]}
    before, after = (robot.forward(q[ok], **load) for q in (fake.q_nominal, fake.q))
    tip = np.stack([fake.T_wanted[ok], before, after], axis=1)
    T_tool = at.T_tool[ok]
    on_tip = np.einsum("nij,nj->ni", T_tool[:, :3, :3], at.contact[ok]) + T_tool[:, :3, 3]
    return np.asarray(np.einsum("nkij,nj->nki", tip[..., :3, :3], on_tip) + tip[..., :3, 3])


def _with_shifts(
    robot: Robot,
    robots: Mapping[int, Robot],
    nominal: Arm,
    program: TextProgram,
    corrections: Corrections,
    controller: Arm | None,
    true_frames: TrueFrames,
    frames_of: Sequence[TargetFrames],
) -> tuple[Corrections, list[Note]]:
    """Corrections with what they do to moves that shift a corrected target, in words.

    ``robots`` carry what the program says that the robot carries at targets, by their numbers; ``frames_of`` are the
    tools and work objects of all targets. Where points are taught shifted ones are not computed: they are left.
    """
    own = {id(program.targets[n]) for batch, fake in corrections for n in batch.numbers[fake.ok]}
    shifts = [shift for shift in program.shifts if id(shift.own) not in own]
    shifted = {id(shift.target) for shift in shifts}
    if true_frames.points.taught is not None:
        reason = "moves also go to it with an offset, whose error is not known where points are taught"
        left = [
            [reason if id(program.targets[k]) in shifted else "" for k in batch.numbers] for batch, _ in corrections
        ]
        return [(batch, refused(fake, why)) for (batch, fake), why in zip(corrections, left, strict=True)], []
    values: dict[int, FloatArray] = {}
    q: dict[int, FloatArray] = {}
    frame_of = {
        number: (every, row)
        for (batch, _), every in zip(corrections, frames_of, strict=True)
        for row, number in enumerate(batch.numbers.tolist())
    }
    for batch, fake in corrections:
        rows = np.flatnonzero(fake.ok) if batch.kind == "pose" else np.zeros(0, dtype=int)
        chosen = batch.numbers[rows].tolist()
        values |= program.values_for_tip_poses(chosen, fake.T_fake[rows])
        q |= dict(zip(chosen, fake.q[rows], strict=True))
    apart: dict[tuple[int, str, bool], list[tuple[str, FloatArray]]] = {}
    for k, shift, before, after, tool in replace(program, shifts=tuple(shifts)).shifted(values):
        every, row = frame_of[k]
        seeds = np.tile(q[k], (2 * len(before), 1))
        new_numbers = true_frames.numbers == "from-cell"
        sent = frames.inverse(every.T_numbers[row]) @ after @ every.T_right[row] if new_numbers else after
        found = any_arm.solve(
            Robot(controller or nominal), nominal, np.concatenate([before, sent]), seed=seeds, thorough=False
        )
        reached = robots.get(k, robot).forward(np.nan_to_num(found.joints)) @ every.T_tool[row]
        wanted = np.tile(every.T_left[row] @ before @ tool, (2, 1, 1))
        off = reached[:, :3, 3] - wanted[:, :3, 3]
        distance = np.where(found.converged, np.linalg.norm(off, axis=1), np.nan).reshape(2, -1).max(axis=1) / MM
        move = shift.at, f"{shift.instruction} {shift.text}", shift.known
        apart.setdefault(move, []).append((shift.target.name, distance))
    notes = []
    for (at, move_text, known), of_targets in apart.items():
        name, worst = max(of_targets, key=lambda entry: np.nan_to_num(entry[1][1], nan=np.inf))
        more = f" and {len(of_targets) - 1} more are" if len(of_targets) > 1 else " is"
        probe = "" if known else f", at {PROBE / MM:.0f} mm"
        words = f"off by {worst[1]:.3f} mm{probe} ({worst[0]:.3f} mm without the correction)"
        words = words if np.isfinite(worst).all() else "not reached by the nominal robot near the target"
        text = f"{move_text}: {name}{more} corrected, the shifted target is {words}"
        notes.append(Note(program.listing.line(at), text))
    return corrections, notes


def _in_course(
    robot: Robot,
    nominal: Arm,
    program: Program,
    uncoupled: Corrections,
    controller: Arm | None,
    speeds: FloatArray | None,
    carried: Sequence[Carried | None],
) -> tuple[Corrections, Program, list[Left], LastMoves | None]:
    """Corrections that know what comes before: in a motion as it goes, in other programs the stop before."""
    unchanged = list(program.left())
    if not isinstance(program, Timed):
        corrections, last_moves = with_last_moves(robot, controller or nominal, uncoupled, program.stops(), carried)
        return corrections, program, unchanged, last_moves
    moving, commands, passed = follow(robot, nominal, program, uncoupled, controller, speeds)
    return moving, program if commands is None else program.with_motion(commands), unchanged + passed, None


def _ends(corrections: Corrections) -> dict[int, Ends]:
    """The corrected targets by their numbers."""
    return {
        int(batch.numbers[k]): Ends(fake.T_wanted[k], fake.q_nominal[k], fake.q[k], fake.T_fake[k])
        for batch, fake in corrections
        for k in np.flatnonzero(fake.ok)
    }


def fingerprints_of(program: str | Path) -> dict[str, str | None]:
    """Fingerprint of the calibration that programs were filtered with, file by file.

    Parameters
    ----------
    program : str or Path
        As `correct` takes and writes it: a file, or a folder or zip archive with programs of one language.

    Returns
    -------
    dict of str to str or None
        Name of the file (in the folder) -> ``Record.fingerprint`` of that calibration; None for a file that bears no
        mark, an empty text where the mark does not say which calibration it was.

    Raises
    ------
    ProgramError
        If it cannot be read as a program.
    """
    with unpacked([program]) as files:
        given = languages.files_of(files.programs)
        return {
            place.as_posix(): given.language.fingerprint(read_bytes(path), str(path))
            for path, place in given.relative.items()
        }
