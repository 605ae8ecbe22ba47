"""A corrected program to look at: its targets, and by how much they are missed before and after the correction."""

from __future__ import annotations

from dataclasses import replace
from pathlib import PurePath
from typing import TYPE_CHECKING

import numpy as np

from irbcal.correction.filtered import Filtered
from irbcal.viewer.building import default_magnification, scale_top
from irbcal.viewer.scene import Model, Points
from irbcal.viewer.view import View, view

if TYPE_CHECKING:
    from irbcal.io.opening import CalibrationLike

MOST_LEFT = 200
"""Targets that are left and named on the page, each with its reason."""
MODELS: tuple[Model, Model] = ("nominal", "calibrated")
"""As the page names what is before and after a correction."""
HOW_TO_READ = (
    "Points are the tool centre point at the targets: where it shall go, and where the calibrated robot takes it with "
    "the program as it was (before) and as it is now (after). The line joins the targets in the order of the program; "
    "moves between them are not computed."
)


def program_view(calibration: CalibrationLike, filtered: Filtered) -> View:
    """The page of a corrected program: its targets in 3D with error vectors, and what was left and why.

    Parameters
    ----------
    calibration : str, Path or a result with the calibration's URDF
    filtered : Filtered
        As `irbcal.correct` gives it; with targets that were corrected.

    Raises
    ------
    RobotError, CalibrationError
        As `irbcal.view`.
    """
    scene = view(calibration, plan=filtered.q).scene
    wanted, before, after = np.swapaxes(filtered.places, 0, 1)
    n = len(wanted)
    points = Points(np.arange(n), np.zeros(n, dtype=int), after, wanted, before)
    errors = [np.linalg.norm(wanted - place, axis=1) for place in (before, after)]
    size = scene.reach
    scales = [(default_magnification([error], size), scale_top([error])) for error in errors]
    left = [f"left as it was: {one.target} (line {one.line}): {one.reason}" for one in filtered.left[:MOST_LEFT]]
    if len(filtered.left) > MOST_LEFT:
        left.append(f"left as they were: {len(filtered.left) - MOST_LEFT} more")
    notes = [f"line {note.line}: {note.text}" for note in filtered.notes]
    programs = filtered.source.split(", ")
    split = [str(name).rpartition(" in ") if len(programs) > 1 else (name, "", "") for name in filtered.targets]
    names = [
        f"{name} ({PurePath(place).name}{', ' if place else ''}line {line})"
        for (name, _, place), line in zip(split, filtered.lines, strict=True)
    ]
    source = PurePath(programs[0]).name if len(programs) == 1 else f"{len(programs)} programs"
    return View(
        replace(
            scene,
            title=f"{source}: {n} targets corrected, {len(filtered.left)} left",
            mode="program",
            pose_ids=np.array(names, dtype=object),
            targets={"tool centre point": np.zeros(3)},
            points=points,
            path=wanted[filtered.way] if len(filtered.way) > 1 else None,
            magnification=default_magnification(errors, size),
            scale_top=scale_top(errors),
            own_scales=dict(zip(MODELS, scales, strict=True)),
            fitted=None,
            tracker=False,
            cube=None,
            references={},
            notes=(HOW_TO_READ, *left, *filtered.cautions, *notes, *scene.notes),
        )
    )
