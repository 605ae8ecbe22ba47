"""Fake targets of tables of a million rows and more: in pieces, side by side, in memory that hardly grows with them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import BinaryIO

import numpy as np

from irbcal import __version__, parallel
from irbcal.correction import unfinished
from irbcal.correction.corrected_program import LISTED_CHANGES, OF_TARGETS, CorrectedProgram
from irbcal.correction.corrected_targets import CorrectionModel
from irbcal.correction.correction_options import CorrectionOptions
from irbcal.correction.filter_program import filter_program
from irbcal.correction.languages import table
from irbcal.correction.unfinished import CorrectedPieces
from irbcal.errors import ProgramError
from irbcal.io.opening import open_calibration
from irbcal.measurement import long_files
from irbcal.modeling.robot import carrying_payload
from irbcal.safe_files import write_set

ROWS_BEFORE = 100
"""Rows before a piece of a long table that tell from where the robot comes to its first."""
MOST_UNCHANGED = 10_000
"""Rows of a long table that were left as they were, and are named."""
PIECE_S = 1.0
"""Seconds that a piece of a long table takes, about."""


def _corrected_piece(model: CorrectionModel, piece: long_files.Piece) -> tuple[bytes, CorrectedProgram]:
    """In a worker: a piece with its fake targets, as a table; and what was done, without the bytes."""
    data, rows_before = long_files.content(piece, ROWS_BEFORE)
    offset = piece.row - rows_before
    try:
        program = table.parse(data, piece.path, model.nominal)
        program = replace(program, rows=program.rows + offset)
    except ProgramError as error:
        raise error if error.row in (None, 1) else long_files.with_row_of_file(error, offset) from None
    filtered = filter_program(program, model)
    if len(filtered.targets):
        written = filtered.data
    else:
        unchanged = np.zeros(len(program.rows), dtype=bool)
        written = table.with_values(program, program.values, model.fingerprint, unchanged)
    first_line = program.rows[rows_before]
    inside = filtered.lines >= first_line
    certainty = model.robot.certainty
    outside = "" if certainty is None else certainty.outside_in_words(filtered.q_before[inside], "targets")
    first = np.flatnonzero(inside)[:LISTED_CHANGES]
    small = replace(
        filtered,
        **{name: getattr(filtered, name)[first] for name in OF_TARGETS},
        files={},
        unchanged_targets=tuple(left for left in filtered.unchanged_targets if left.line >= first_line),
        last_move_error=None,
        last_moves=None,
        frames=None,
        visited=np.arange(len(first)),
        cautions=(outside,) if outside else (),
        shifts=filtered.shift[inside],
    )
    return table.rows_from(written, rows_before), small


def correct_long_table(options: CorrectionOptions, file: long_files.LongFile, out: Path) -> CorrectedProgram:
    """Correct a long table in pieces, whose rows are written in their order: all of them, or nothing."""
    payload, centre = options.payload, options.payload_centre
    record = open_calibration(options.calibration)
    robot = carrying_payload(record.robot_calibrated(), payload, centre)
    model = CorrectionModel(robot, record.arm(calibrated=False), record.fingerprint, follow_loads=payload is None)
    centre = None if centre is None else np.asarray(centre).tolist()
    call = [__version__, file.sha256, len(file.pieces), record.fingerprint, options.allow_partial, payload, centre]
    first: CorrectedProgram | None = None
    corrected = CorrectedPieces()

    def add(filtered: CorrectedProgram) -> None:
        corrected.pieces += 1
        corrected.unchanged_targets += filtered.unchanged_targets[
            : max(MOST_UNCHANGED - len(corrected.unchanged_targets), 0)
        ]
        corrected.notes = [*dict.fromkeys((*corrected.notes, *filtered.notes))]
        corrected.cautions += filtered.cautions
        corrected.unchanged += filtered.unchanged
        corrected.shifts.append(filtered.all_shifts)

    def write(stream: BinaryIO) -> None:
        nonlocal corrected, first
        writer = table.TableWriter(stream)
        if begun := unfinished.resumed(out, call):
            rows, corrected = begun
            writer.begin_with(rows)
            first = _corrected_piece(model, file.pieces[0])[1]
        early: dict[int, tuple[bytes, CorrectedProgram]] = {}
        start = corrected.pieces
        try:
            for index, corrected_piece in parallel.each(_corrected_piece, model, file.pieces[start:], seconds=PIECE_S):
                early[start + index] = corrected_piece
                while corrected.pieces in early:
                    rows_written, filtered = early.pop(corrected.pieces)
                    writer.append(rows_written)
                    first = first or filtered
                    add(filtered)
                    if options.progress is not None:
                        options.progress(f"{corrected.pieces} of {len(file.pieces)} pieces")
                    if filtered.unchanged_targets and not options.allow_partial:
                        raise replace(filtered, unchanged_targets=tuple(corrected.unchanged_targets)).not_written()
        except KeyboardInterrupt:
            if not corrected.pieces:
                raise
            writer.close()
            unfinished.keep(out, Path(stream.name), call, corrected)
            raise parallel.Interrupted(len(file.pieces) - corrected.pieces, "pieces of the table to correct") from None
        assert first is not None
        if not any(map(len, corrected.shifts)):
            raise replace(first, unchanged_targets=tuple(corrected.unchanged_targets)).not_written()
        writer.close()

    write_set({out: write})
    assert first is not None
    unfinished.forget(out)
    cautions = long_files.once(corrected.cautions, len(file.pieces))
    if len(corrected.unchanged_targets) == MOST_UNCHANGED:
        cautions = (*cautions, f"Of the targets that were left as they were the first {MOST_UNCHANGED} are named.")
    return replace(
        first,
        unchanged_targets=tuple(corrected.unchanged_targets),
        notes=tuple(corrected.notes),
        cautions=cautions,
        expected_error=record.expected_error,
        simulated=record.simulated,
        written=out,
        unchanged=corrected.unchanged,
        shifts=np.concatenate(corrected.shifts),
    )
