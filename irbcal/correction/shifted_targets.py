"""Moves that go to a corrected target with an offset: how far off they are, in words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.correction.corrected_targets import CorrectionModel, TargetBatch, refused
from irbcal.correction.program import Note
from irbcal.correction.targets import PROBE, Shift
from irbcal.correction.text_program import TextProgram
from irbcal.modeling import frames
from irbcal.modeling.inverse import any_arm
from irbcal.modeling.robot import Robot
from irbcal.units import MM
from irbcal.wording import and_more, inflected

OF_TAUGHT = "moves also go to it with an offset, whose error is not known where points are taught"


def with_shifts(
    model: CorrectionModel, robots: Mapping[int, Robot], program: TextProgram, batches: list[TargetBatch]
) -> tuple[list[TargetBatch], list[Note]]:
    """What the corrections do to moves that shift a corrected target; where points are taught it is left.

    Parameters
    ----------
    model : CorrectionModel
    robots : dict of int to Robot
        With what the program says that they carry, by the numbers of the targets; ``model.robot`` of all others.
    program : TextProgram
    batches : list of TargetBatch

    Returns
    -------
    batches : list of TargetBatch
    notes : list of Note
    """
    by_itself = {id(program.targets[n]) for batch in batches for n in batch.programmed.numbers[batch.fake.ok]}
    shifts = [shift for shift in program.shifts if id(shift.new_target) not in by_itself]
    if model.true_frames.points.taught is not None:
        shifted = {id(shift.target) for shift in shifts}
        why = [
            [OF_TAUGHT if id(program.targets[k]) in shifted else "" for k in batch.programmed.numbers]
            for batch in batches
        ]
        return [replace(b, fake=refused(b.fake, reasons)) for b, reasons in zip(batches, why, strict=True)], []
    apart: dict[tuple[int, str, bool], list[tuple[str, FloatArray]]] = {}
    for name, shift, distance in _distances(model, robots, program, shifts, batches):
        move = shift.at, f"{shift.instruction} {shift.text}", shift.numeric
        apart.setdefault(move, []).append((name, distance))
    notes = []
    for (at, move_text, known), of_targets in apart.items():
        name, worst = max(of_targets, key=lambda entry: np.nan_to_num(entry[1][1], nan=np.inf))
        more = f"{and_more(len(of_targets) - 1)} {inflected(len(of_targets), 'is', 'are')}"
        probe = "" if known else f", at {PROBE / MM:.0f} mm"
        error_text = f"off by {worst[1]:.3f} mm{probe} ({worst[0]:.3f} mm without the correction)"
        error_text = error_text if np.isfinite(worst).all() else "not reached by the nominal robot near the target"
        text = f"{move_text}: {name}{more} corrected, the shifted target is {error_text}"
        notes.append(Note(program.listing.line(at), text))
    return batches, notes


def _distances(
    model: CorrectionModel,
    robots: Mapping[int, Robot],
    program: TextProgram,
    shifts: Sequence[Shift],
    batches: Sequence[TargetBatch],
) -> list[tuple[str, Shift, FloatArray]]:
    """Of each shifted target its name, the move, and how far off it is before and after the correction (2,), mm."""
    values: dict[int, FloatArray] = {}
    q: dict[int, FloatArray] = {}
    frames_of = {
        number: (batch.frames, row) for batch in batches for row, number in enumerate(batch.programmed.numbers.tolist())
    }
    for batch in batches:
        rows = np.flatnonzero(batch.fake.ok) if batch.programmed.kind == "pose" else np.zeros(0, dtype=int)
        chosen = batch.programmed.numbers[rows].tolist()
        values |= program.values_for_tip_poses(chosen, batch.fake.T_fake[rows])
        q |= dict(zip(chosen, batch.fake.q[rows], strict=True))
    out = []
    for k, shift, nominal, corrected, tool in replace(program, shifts=tuple(shifts)).shifted(values):
        at, row = frames_of[k]
        seeds = np.tile(q[k], (2 * len(nominal), 1))
        new_numbers = model.true_frames.numbers == "from-cell"
        sent = frames.inverse(at.T_numbers[row]) @ corrected @ at.T_right[row] if new_numbers else corrected
        poses = np.concatenate([nominal, sent])
        solved = any_arm.solve(Robot(model.computing), model.nominal, poses, seed=seeds, thorough=False)
        reached = robots.get(k, model.robot).forward(np.nan_to_num(solved.joints)) @ at.T_tool[row]
        wanted = np.tile(at.T_left[row] @ nominal @ tool, (2, 1, 1))
        off = np.linalg.norm(reached[:, :3, 3] - wanted[:, :3, 3], axis=1)
        out.append((shift.target.name, shift, np.where(solved.converged, off, np.nan).reshape(2, -1).max(axis=1) / MM))
    return out
