"""A corrected program to look at: its targets, and by how much they are missed before and after the correction."""

from __future__ import annotations

from dataclasses import replace
from pathlib import PurePath
from typing import TYPE_CHECKING

import numpy as np

from irbcal.correction.corrected_program import CorrectedProgram
from irbcal.correction.fake_targets import next_to_singularities
from irbcal.modeling.arm import Arm
from irbcal.units import DEG
from irbcal.viewer.building import default_magnification, scale_top, view
from irbcal.viewer.scene import Points, WhichModel
from irbcal.viewer.view import View

if TYPE_CHECKING:
    from irbcal.io.opening import CalibrationLike

MOST_UNCHANGED = 200
"""Targets that are left, and remarks on moves, that the page names."""
MODELS: tuple[WhichModel, WhichModel] = ("nominal", "calibrated")
"""As the page names what is before and after a correction."""
HOW_TO_READ = (
    "Points are the tool centre point at the targets: where it shall go, and where the calibrated robot takes it with "
    "the program as it was (before) and as it is now (after). The line joins the targets in the order of the program; "
    "moves between them are not computed."
)


LONGER, LONGER_SHARE = 1.0 * DEG, 0.05
"""By how much, and by which share, the largest turn of a joint in a move changes before it is named."""


def singularities(arm: Arm, filtered: CorrectedProgram, reach: float, names: list[str]) -> list[str]:
    """Sentences on corrected targets next to a singularity: the correction, and moves there, turn joints far.

    Parameters
    ----------
    arm : Arm
    filtered : CorrectedProgram
    reach : float
        Metres: translations count by it.
    names : list of str
        Of the targets.
    """
    near = next_to_singularities(arm, filtered.q, reach)
    return [
        f"next to a singularity: {names[k]}: joint {joint + 1} turns by {min(gain, 9999.0):.0f} degrees for one degree "
        "of the tool; straight moves through it are slow or stop"
        for k, (joint, gain) in near.items()
    ]


def changed_moves(arm: Arm, filtered: CorrectedProgram, names: list[str]) -> list[str]:
    """Sentences on moves in which a joint turns farther, or less far, than before: they take another time."""
    stops, turning = filtered.visited, ~arm.table.prismatic
    turn_before, turn_after = (
        np.abs(np.diff(q[stops][:, turning], axis=0)).max(axis=1) for q in (filtered.q_before, filtered.q)
    )
    changed = np.abs(turn_after - turn_before) > np.maximum(LONGER, LONGER_SHARE * turn_before)
    return [
        f"another speed: from {names[stops[k]]} to {names[stops[k + 1]]} a joint turns by "
        f"{turn_after[k] / DEG:.1f} degrees, {turn_before[k] / DEG:.1f} before"
        for k in np.flatnonzero(changed)
    ]


def program_view(calibration: CalibrationLike, filtered: CorrectedProgram) -> View:
    """The page of a corrected program: its targets in 3D with error vectors, and what was left and why.

    Parameters
    ----------
    calibration : str, Path or a result with the calibration's URDF
    filtered : CorrectedProgram
        As `irbcal.correct` gives it; with targets that were corrected.

    Raises
    ------
    RobotError, CalibrationError
        As `irbcal.view`.
    """
    scene = view(calibration, plan=filtered.q).scene
    programmed, nominal_point, corrected_point = np.swapaxes(filtered.positions, 0, 1)
    n = len(programmed)
    points = Points(np.arange(n), np.zeros(n, dtype=int), corrected_point, programmed, nominal_point)
    errors = [np.linalg.norm(programmed - position, axis=1) for position in (nominal_point, corrected_point)]
    size = scene.reach
    scales = [(default_magnification([error], size), scale_top([error])) for error in errors]
    unchanged = [
        f"left as it was: {target.with_line}: {target.reason}" for target in filtered.unchanged_targets[:MOST_UNCHANGED]
    ]
    if len(filtered.unchanged_targets) > MOST_UNCHANGED:
        unchanged.append(f"left as they were: {len(filtered.unchanged_targets) - MOST_UNCHANGED} more")
    notes = [f"line {note.line}: {note.text}" for note in filtered.notes]
    programs = filtered.source.split(", ")
    split = [str(name).rpartition(" in ") if len(programs) > 1 else (name, "", "") for name in filtered.targets]
    names = [
        f"{name} ({PurePath(position).name}{', ' if position else ''}line {line})"
        for (name, _, position), line in zip(split, filtered.lines, strict=True)
    ]
    arm = scene.robot.arm
    motion = [*singularities(arm, filtered, size, names), *changed_moves(arm, filtered, names)]
    if len(motion) > MOST_UNCHANGED:
        motion = [*motion[:MOST_UNCHANGED], f"{len(motion) - MOST_UNCHANGED} more targets and moves like these"]
    source = PurePath(programs[0]).name if len(programs) == 1 else f"{len(programs)} programs"
    return View(
        replace(
            scene,
            title=f"{source}: {n} targets {filtered.verb}, {len(filtered.unchanged_targets)} left",
            mode="program",
            pose_ids=np.array(names, dtype=object),
            targets={"tool centre point": np.zeros(3)},
            points=points,
            path=programmed[filtered.visited] if len(filtered.visited) > 1 else None,
            magnification=default_magnification(errors, size),
            scale_top=scale_top(errors),
            own_scales=dict(zip(MODELS, scales, strict=True)),
            fitted=None,
            tracker=False,
            cube=None,
            references={},
            notes=(HOW_TO_READ, *unchanged, *motion, *filtered.cautions, *notes, *scene.notes),
        )
    )
