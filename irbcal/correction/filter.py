"""The filter: programs in, the same programs with fake targets out (Nubiola 2011, section 6.2 and conclusion)."""

from __future__ import annotations

import gc
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from irbcal.cell.cell_file import CellFile, cell_of
from irbcal.correction.backup import Unpacked, packed, unpacked
from irbcal.correction.corrected_program import CorrectedProgram, together
from irbcal.correction.corrected_targets import CorrectionModel
from irbcal.correction.correction_options import IN_PIECES, CorrectionOptions
from irbcal.correction.filter_program import filter_program
from irbcal.correction.languages import all_languages, table
from irbcal.correction.long_tables import correct_long_table
from irbcal.correction.opened_programs import OpenedPrograms, read_programs
from irbcal.correction.paths import Cuttable
from irbcal.correction.program import Note, Program, Unread
from irbcal.correction.text_program import TextProgram
from irbcal.correction.true_frames import TrueFrames
from irbcal.declared_options import changed_options, takes_fields_of
from irbcal.errors import OptionError
from irbcal.io.urdf import speed_limits
from irbcal.measurement import long_files
from irbcal.modeling.robot import carrying_payload
from irbcal.names import csv_bytes
from irbcal.overwriting import refuse_overwriting
from irbcal.safe_files import write_set

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


@takes_fields_of(CorrectionOptions)
@_without_garbage_collection()
def correct(options: CorrectionOptions) -> CorrectedProgram:
    """Replace a program's targets so that the controller with its nominal model reaches the true poses.

    Tables (CSV, Parquet) of a million rows and more, without times, are corrected in pieces, side by side, in memory
    that hardly grows with them, where a file is written and of all options ``allow_partial``, ``payload`` and
    ``payload_centre`` alone are used. The result then holds the first targets, and how far all were shifted. Stopped by
    Ctrl-C, it keeps what is done beside that file (``NAME.unfinished``), and the same call goes on from there.

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
    calibration, given_files, out, changes = options.calibration, options.programs, options.out, options.changes
    read_too = (options.controller_model, options.cell, options.instructions)
    refuse_overwriting({"out": out, "changes": changes}, given_files, *read_too, calibration)
    endings = {Path(name).suffix.lower() for name in (out, *given_files[:1]) if name is not None}
    if endings == set(table.ENDINGS):
        ending = Path(given_files[0]).suffix
        raise OptionError(f"out: expected a name that ends in {ending}, as that of the table", parameter="out")
    in_pieces = {"calibration", "program", *changed_options(options, IN_PIECES)}
    if out is not None and len(given_files) == 1 and in_pieces.issuperset(changed_options(options)):
        long = long_files.long_table(Path(given_files[0]))
        if long is not None and table.TIME not in long.columns:
            return correct_long_table(options, long, Path(out))
    with unpacked(given_files) as files:
        opened = read_programs(options, files.programs, options.split_points, out)
        known_cell = None if options.cell is None else cell_of(options.cell, opened.record.fingerprint)
        true_frames = TrueFrames(
            known_cell, options.frames_measured, options.controller_frames, options.origin, opened.setup.controller
        )
        programs = _in_cell(opened, known_cell)
        robot = carrying_payload(opened.record.robot_calibrated(), options.payload, options.payload_centre)
        model = CorrectionModel(
            robot=robot if opened.model is None else opened.model.seen_by_it(robot),
            nominal=opened.nominal,
            fingerprint=opened.record.fingerprint,
            controller=opened.setup.controller_arm,
            true_frames=true_frames,
            path_tolerance=options.path_tolerance,
            speeds=None if opened.urdf is None else speed_limits(opened.urdf, opened.nominal.joint_names),
            follow_loads=options.payload is None,
        )
        cuttable = all(isinstance(each, (Cuttable, Unread)) for each in programs)
        if options.path_tolerance is not None and not cuttable:
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
        if options.strict and filtered.unknown_frames is not None:
            raise filtered.not_written(filtered.unknown_frames.in_words())
        if out is not None or changes is not None:
            if not len(filtered.targets) or (filtered.unchanged_targets and not options.allow_partial):
                raise filtered.not_written()
            folder = len(filtered.files) > 1 or len(opened.files.files) > 1
            filtered = _written(filtered, out, changes, folder, files)
        # files in archives are named as the caller knows them
        contents = {files.with_archives(name): data for name, data in filtered.files.items()}
        return replace(filtered, files=contents, source=files.with_archives(filtered.source))


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


def _with_remarks(filtered: CorrectedProgram, opened: OpenedPrograms, model: CorrectionModel) -> CorrectedProgram:
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
        simulated=opened.record.simulated,
    )


def _written(
    filtered: CorrectedProgram, out: str | Path | None, changes: str | Path | None, folder: bool, options: Unpacked
) -> CorrectedProgram:
    """Write what was asked for, all or nothing; files of folders that were searched lie as they did there."""
    searched = [path for path in options.programs if path.is_dir()]
    contents: dict[Path, bytes] = {}

    def table_of_changes() -> bytes:
        return csv_bytes(filtered.to_frame(), float_format="%.6f")

    if changes is not None:
        contents[Path(changes)] = table_of_changes()
    if out is not None and Path(out).suffix.lower() == ".zip":
        if len(options.archives) != 1 or len(options.programs) != 1:
            raise OptionError("out: a zip archive is written of one that was given, expected a folder", parameter="out")
        ((inside, archive),) = options.archives.items()
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
        name, data = next(iter(files.items()))
        ending = Path(name).suffix.lower()
        if out.suffix.lower() != ending and any(out.suffix.lower() in each.endings for each in all_languages()):
            raise OptionError(
                f"out: expected a name that ends in {ending}, as {Path(name).name}, found {out}", parameter="out"
            )
        return {out: data}
    if out.is_file() or (not out.is_dir() and any(out.suffix.lower() in each.endings for each in all_languages())):
        file_names = ", ".join(Path(name).name for name in files)
        raise OptionError(f"out: expected a folder for {file_names}, found the name of a file, {out}", parameter="out")
    inside = {name: next((root for root in searched if Path(name).is_relative_to(root)), None) for name in files}
    relative = {
        name: Path(name).name if root is None else Path(name).relative_to(root) for name, root in inside.items()
    }
    return {out / relative[name]: data for name, data in files.items()}
