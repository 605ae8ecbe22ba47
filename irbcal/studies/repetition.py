"""One calibration of a study: from the campaign's points to robots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.identification.axis_calibration import calibrate_by_axes
from irbcal.identification.methods import identify_by
from irbcal.identification.result import Fit
from irbcal.measurement.points import PointSet, distances
from irbcal.modeling.arm import Arm
from irbcal.modeling.levels import LEVELS, Level
from irbcal.modeling.robot import Robot
from irbcal.options import checked
from irbcal.simulation import procedure
from irbcal.simulation.cell import Cell
from irbcal.studies.settings import AREAS, COURSE, METHODS, NOMINAL, Repetition, shares
from irbcal.studies.stage import Stage

if TYPE_CHECKING:
    import pandas as pd

COURSE_UNUSED = 20
"""Points in each area that the course of the search is watched on (Nubiola 2011, section 7.5)."""


def nominal(cell: Cell, robot: Robot) -> Robot:
    """The nominal robot with base from axes 1 and 2 and tool from axes 5 and 6.

    Nubiola 2011, sections 3.2, 3.4.2, 5.4.1 and 7.7.1.
    """
    return Robot(cell.arm, T_world_base=robot.T_world_base, targets=robot.targets)


def choice(axes: PointSet | None, areas: Mapping[str, PointSet], counts: Sequence[int], seed: int) -> PointSet:
    """Identification measurements: axis points and a random choice of the others (Nubiola 2011, section 7.2).

    Parameters
    ----------
    axes : PointSet or None
    areas : dict of str to PointSet
    counts : sequence of int
        In each area.
    seed : int

    Returns
    -------
    PointSet
    """
    rng = np.random.default_rng(seed)
    parts = [procedure.drawn(areas[area], count, rng) for area, count in zip(AREAS, counts, strict=True)]
    return procedure.joined(*([] if axes is None else [axes]), *parts)


def fitted(arm: Arm, points: PointSet, level: Level, targets: Mapping[str, FloatArray], **options: Any) -> Fit:
    """Fit of a level with the targets as the tool was calibrated; options as `identify_by`."""
    known = {name: targets[name] for name in points.target_names}
    return identify_by(arm, points, level, known_targets=known, **options)


def identify(stage: Stage, repetition: Repetition) -> tuple[list[tuple[str, Robot, float]], pd.DataFrame | None]:
    """The calibrations of a repetition (Nubiola 2011, section 7.3).

    Returns
    -------
    models : list of tuple
        Method, robot with all targets, largest distance of the measurements it was made from (m). The method of the
        settings comes first; where it starts from least squares, these come second.
    watched : DataFrame or None
        Course of the search (section 7.5), for `COURSE`.
    """
    arm, first = stage.cell.arm, stage.first
    if repetition == NOMINAL:
        points = stage.axes[54]
        robot = nominal(stage.cell, first)
        return [("", robot, distances(robot, points).max())], None
    if repetition.model == "axes":
        points = stage.axes[repetition.measures]
        known = {name: first.targets[name] for name in points.target_names}
        robot = calibrate_by_axes(arm, points, known_targets=known).robot.replace(targets=first.targets)
        return [("axes", robot, distances(robot, points).max())], None
    axes, *counts = shares(repetition.measures)
    seed = repetition.seed(stage.settings)
    course = repetition == COURSE
    level = "34" if course else checked("model", repetition.model, LEVELS)
    method = "nelder-mead" if course else stage.settings.method
    areas: Mapping[str, PointSet] = stage.identification
    watched = None
    if course:
        watched, areas = _set_aside(areas, seed)
    points = choice(stage.axes.get(axes), areas, counts, seed)
    fit = fitted(arm, points, level, first.targets, watched=watched, **METHODS[method])
    models = [(method, fit)] + ([] if fit.least_squares is None else [("least-squares", fit.least_squares)])
    found = [(name, f.robot, distances(f.robot, points).max()) for name, f in models]
    history = fit.history.to_frame() if watched is not None and fit.history is not None else None
    return [(name, robot.replace(targets=first.targets), largest) for name, robot, largest in found], history


def _set_aside(areas: Mapping[str, PointSet], seed: int) -> tuple[dict[str, PointSet], dict[str, PointSet]]:
    """A few points of each area that take no part in the search, and the rest (Nubiola 2011, section 7.5)."""
    rng = np.random.default_rng([seed, 1])
    watched, rest = {}, {}
    for area, points in areas.items():
        aside = np.zeros(points.poses, dtype=bool)
        aside[rng.permutation(points.poses)[:COURSE_UNUSED]] = True
        watched[area], rest[area] = points.select(aside), points.select(~aside)
    return watched, rest
