"""One calibration of the study: the measuring campaign, the identification, and what the robot does with it.

Any calibration can be run again by itself: it depends on the settings and its seed alone::

    stage = Stage.of(Settings())
    rows, series = run(stage, Repetition("34", 120, 3))

All data are simulated. Lengths are metres inside, millimetres and degrees in the rows.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from chapter7 import campaign
from chapter7.settings import (
    AREAS,
    COURSE,
    FULL,
    METHODS,
    MOVES,
    NOMINAL,
    PAYLOADS,
    Repetition,
    Settings,
    repetitions,
    shares,
)
from irbcal.arrays import BoolArray, FloatArray, IntArray, lock, locked
from irbcal.error_statistics import statistics
from irbcal.errors import MeasurementError
from irbcal.identification.axis_calibration import calibrate_by_axes
from irbcal.identification.fit import Fit, identify_by
from irbcal.measurement.points import PointSet, distances
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.inverse import calibrated_arm, closed_form
from irbcal.modeling.levels import LEVELS, Level
from irbcal.modeling.robot import Robot
from irbcal.option_values import checked
from irbcal.simulation import pose_list, simulation
from irbcal.simulation.virtual_cell import VirtualCell
from irbcal.summary import Paragraph, Result
from irbcal.units import DEG, MM
from irbcal.validation import accuracy
from irbcal.validation.accuracy import replace_geometry

if TYPE_CHECKING:
    import pandas as pd

SPHERE_CENTRE, SPHERE_DIAMETER, SPHERE_POINTS = np.array([845.7, 200.0, 965.7]) * MM, 400.0 * MM, 434
"""Of the relative analyses, in the base link (Nubiola 2011, section 7.7.3.6 and Figure 7.12)."""

SPHERE_TURN = 20.0 * DEG
"""Largest turn of the tool from its orientation at zero joints there."""


@dataclass(frozen=True, eq=False, repr=False)
class Stage(Result):
    """What all repetitions of a study share (Nubiola 2011, sections 7.1, 7.2 and 7.7, Figure 7.1).

    Attributes
    ----------
    settings : Settings
    cell : VirtualCell
        Eight targets; the poses were chosen so that the tracker sees them.
    first : Robot
        Base and tool from moves of one joint (sections 3.2 and 3.4.2).
    axes : dict of int to PointSet
        Number of axis points -> the points, of target 1.
    identification : dict of str to PointSet
        Area -> measured points of targets 1 to 3.
    verification : dict of int to dict of str to PointSet
        Payload (kg) -> area -> measured points of targets 1 to 8.
    commanded : dict of str to tuple
        Area -> joints (n, 6) and target (n,) of the verification.
    whole : dict of str to ndarray, shape (n, 6)
        Area -> joints at which targets 1 to 3 are all in sight.
    sphere : tuple
        Joints (n, 6) and target (n,) of the relative analyses.
    """

    settings: Settings
    cell: VirtualCell
    first: Robot
    axes: dict[int, PointSet]
    identification: dict[str, PointSet]
    verification: dict[int, dict[str, PointSet]]
    commanded: dict[str, tuple[FloatArray, IntArray]]
    whole: dict[str, FloatArray]
    sphere: tuple[FloatArray, IntArray]

    def __post_init__(self) -> None:
        pairs = {area: locked(list(pair)) for area, pair in self.commanded.items()}
        object.__setattr__(self, "commanded", pairs)
        object.__setattr__(self, "sphere", locked(list(self.sphere)))
        lock(self)

    @classmethod
    def of(cls, settings: Settings) -> Stage:
        """Draw the poses of a study and measure them."""
        cell = simulation.open_cell("irb1600", seed=settings.seed)
        poses = campaign.campaign(cell, settings.pool, settings.points, settings.seed)
        measured = campaign.measure(cell, poses)
        for area in AREAS:
            wanted = max(max(shares(r.measures)[1:]) for r in repetitions(settings))
            if measured.identification[area].poses < wanted:
                raise MeasurementError(
                    f"{measured.identification[area].poses} identification points were seen in {area}, {wanted} are "
                    "needed: ask for more verification points or for smaller procedures"
                )
        heavy = campaign.measure(cell.with_payload(PAYLOADS[1]), poses).verification
        three = cell.with_targets(pose_list.IDENTIFIED)
        whole = {
            area: pose_list.random_poses(three, settings.verified, [settings.seed, 2, k], where)
            for k, (area, where) in enumerate(zip(AREAS, (pose_list.in_cube, pose_list.in_range), strict=True))
        }
        cell = cell.with_targets(pose_list.VERIFIED).without("visibility")
        return cls(
            settings,
            cell,
            by_axes(cell, measured),
            {n: measured.axes if n == 54 else _axis_points(cell, n) for n in MOVES},
            measured.identification,
            dict(zip(PAYLOADS, (measured.verification, heavy), strict=True)),
            poses.verification,
            whole,
            sphere_poses(cell.arm, settings.seed),
        )

    def report(self) -> Sequence[Paragraph]:
        """What was measured, in a sentence."""
        seen = ", ".join(f"{points.poses} in {area}" for area, points in self.identification.items())
        return (
            f"SIMULATED campaign, seed {self.settings.seed}: measurements to identify from {seen}; "
            f"{self.settings.points} to verify in each area with each payload",
        )


def by_axes(cell: VirtualCell, measured: campaign.Measured) -> Robot:
    """The robot that the moves of single joints give: base, tool and links (Nubiola 2011, sections 3.1 and 5.4.4).

    Parameters
    ----------
    cell : VirtualCell
    measured : Measured

    Returns
    -------
    Robot
    """
    return calibrate_by_axes(cell.arm, measured.moves).robot


def _axis_points(cell: VirtualCell, count: int) -> PointSet:
    """Moves of one joint at a time, seen at target 1."""
    joints = [angle * DEG * np.eye(6)[j] for j, angles in enumerate(MOVES[count]) for angle in angles]
    groups = [f"axis{j + 1}" for j, angles in enumerate(MOVES[count]) for _ in angles]
    return cell.with_targets(["smr1"]).measure(np.array(joints), run=100 + count).points(groups)


def sphere_poses(arm: Arm, seed: int) -> tuple[FloatArray, IntArray]:
    """Random places in the sphere of Nubiola 2011, Figure 7.12, the tool turned a little from zero joints.

    Returns
    -------
    q : ndarray, shape (n, 6)
        Of the configurations the one nearest to zero joints, radians.
    target : ndarray of int, shape (n,)
        Of the eight.
    """
    rng = np.random.default_rng([seed, 3])
    home = arm.forward(np.zeros((1, 6)))[0]
    places = rng.uniform(-1.0, 1.0, (4 * SPHERE_POINTS, 3))
    places = places[np.linalg.norm(places, axis=1) <= 1.0][:SPHERE_POINTS]
    T = np.tile(home, (SPHERE_POINTS, 1, 1))
    T[:, :3, 3] = SPHERE_CENTRE + SPHERE_DIAMETER / 2 * places
    turns = rng.standard_normal((SPHERE_POINTS, 3))
    turns *= SPHERE_TURN * rng.uniform(0, 1, (SPHERE_POINTS, 1)) / np.linalg.norm(turns, axis=1, keepdims=True)
    T[:, :3, :3] = [home[:3, :3] @ frames.rotation_from_vector(v) for v in turns]
    q, branch = closed_form.nearest(arm, closed_form.branches(arm, T), np.zeros(6))
    if (branch < 0).any():
        raise MeasurementError("the robot does not reach the sphere of the relative analyses")
    return q, rng.integers(0, len(pose_list.VERIFIED), SPHERE_POINTS)


COURSE_UNUSED = 20
"""Points in each area that the course of the search is watched on (Nubiola 2011, section 7.5)."""


def nominal(cell: VirtualCell, robot: Robot) -> Robot:
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
    parts = [campaign.drawn(areas[area], count, rng) for area, count in zip(AREAS, counts, strict=True)]
    return campaign.joined(*([] if axes is None else [axes]), *parts)


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


TARGETS = {"1": ("smr1",), "1-3": pose_list.IDENTIFIED, "4-8": pose_list.VERIFIED[3:], "1-8": pose_list.VERIFIED}
"""Sets of targets that expected errors are given for."""

ISO_POSES = np.array(
    [
        [0.0, -14.0, 14.0, 0.0, 0.0, 0.0],
        [17.690, 18.084, -46.521, -33.814, 33.095, 29.298],
        [-17.690, 18.084, -46.521, 33.814, 33.095, -29.298],
        [-41.374, -24.789, 47.145, -66.643, -46.052, 58.108],
        [41.373, -24.788, 47.145, 66.643, -46.052, -58.108],
    ]
)
"""P1 to P5 of Nubiola 2011, Table A I-1, degrees."""

CYCLES = 30
"""Of these poses (Nubiola 2011, section 7.7.3.4 and annex I)."""

PERCENTILES = (5, 25, 50, 75, 95)
COLUMNS = (
    *("repetition", "model", "measures", "index", "seed", "method", "kind", "area", "payload_kg", "targets"),
    *("quantity", "unit", "n", "mean", "sigma", "max", "mean_plus_3sigma", "rms"),
    *(f"p{p}" for p in PERCENTILES),
    "objective_mm",
)
"""Columns of a row.

``kind``: ``expected`` (the model against measured poses, Nubiola 2011, section 7.6), ``verified`` (fake targets,
measured), ``verified_all`` (the same with all verification poses), ``poses`` (fake targets, measured with targets 1 to
3), ``iso9283``, ``sphere_virtual_frame`` and ``sphere_three_points``. ``quantity``: ``point``, ``flange``,
``orientation``. ``objective_mm``: largest distance of the measurements that the calibration was made from.
"""

Key: TypeAlias = "tuple[str, str, int, str, str]"
"""Kind, area, payload (kg), targets and quantity of a row."""


def run(
    stage: Stage, repetition: Repetition, tests: bool = True
) -> tuple[list[dict[str, Any]], dict[str, NDArray[Any]]]:
    """Calibrate and test.

    Parameters
    ----------
    stage : Stage
    repetition : Repetition
    tests : bool
        Without, expected errors only.

    Returns
    -------
    rows : list of dict
        With `COLUMNS`.
    series : dict of str to ndarray
        Errors one by one, mm and degrees, under ``kind/area/payload/quantity``, and the course of the search under
        ``course/…``.
    """
    models, course = identify(stage, repetition)
    rows: list[dict[str, Any]] = []
    series: dict[str, NDArray[Any]] = {}
    common = asdict(repetition) | {"repetition": repetition.name, "seed": repetition.seed(stage.settings)}
    for method, robot, largest in models:
        rest = common | {"method": method, "objective_mm": largest / MM}
        for key, values, unit in _expected(stage, robot):
            rows.append(rest | _row(key, values, unit))
    if course is not None:
        return rows, {f"course/{name}": course[name].to_numpy() for name in course if name != "seconds"}
    if not tests:
        return rows, series
    method, robot, largest = models[0]
    rest = common | {"method": method, "objective_mm": largest / MM}
    for key, values, unit in _tests(stage, robot, repetition):
        rows.append(rest | _row(key, values, unit))
        series["/".join(str(part) for part in (*key[:3], key[4]))] = (values / unit).astype(np.float32)
    return rows, series


def _row(key: Key, values: FloatArray, unit: float) -> dict[str, Any]:
    """Statistics of errors as a row; NaN for what was not seen."""
    values = values[np.isfinite(values)].ravel() / unit
    found: dict[str, Any] = statistics(values * MM) or {}  # of plain numbers: those of angles are in degrees
    row: dict[str, Any] = dict(zip(("kind", "area", "payload_kg", "targets", "quantity"), key, strict=True))
    row |= {"unit": "mm" if unit == MM else "deg", "n": found["n"]}
    row |= {name: found[f"{name}_mm"] for name in ("mean", "sigma", "max", "mean_plus_3sigma", "rms")}
    return row | {f"p{p}": value for p, value in zip(PERCENTILES, np.percentile(values, PERCENTILES), strict=True)}


def _expected(stage: Stage, robot: Robot) -> Iterator[tuple[Key, FloatArray, float]]:
    """Errors of the model at measured poses, for each area, payload and set of targets.

    The expected error of Nubiola 2011, section 7.6 and Figure 7.3: from the measured point to the improved model at
    the same joints.
    """
    for load in PAYLOADS:
        for area in AREAS:
            points = stage.verification[load][area]
            distance, names = distances(robot, points), points.names()
            for targets, members in TARGETS.items():
                yield ("expected", area, load, targets, "point"), distance[np.isin(names, members)], MM


def _tests(stage: Stage, robot: Robot, repetition: Repetition) -> Iterator[tuple[Key, FloatArray, float]]:
    """Errors of what the robot does with fake targets (Nubiola 2011, sections 7.4, 7.7.3 and 7.7.5).

    Points of eight targets in both areas with both payloads (sections 7.7.3.1, 7.7.3.2 and 7.7.5.1); poses by targets 1
    to 3 (sections 7.7.3.5, 7.7.4 and 7.7.5.2); the ISO 9283 poses (section 7.7.3.4); relative errors in the sphere
    (sections 7.7.3.6 and 7.7.3.7).
    """
    bench = _Bench(stage, robot, 100 * repetition.seed(stage.settings))
    few = stage.settings.verified
    for load in PAYLOADS:
        for area in AREAS:
            q, which = stage.commanded[area]
            points = bench.measured(q[:few], _asked(which[:few]), load)
            yield ("verified", area, load, "1-8", "point"), distances(bench.meant, points), MM
    load = PAYLOADS[0]
    if repetition == FULL:
        for area in AREAS:
            q, which = stage.commanded[area]
            points = bench.measured(q, _asked(which), load)
            yield ("verified_all", area, load, "1-8", "point"), distances(bench.meant, points), MM
    for area in AREAS:
        errors = accuracy.tip_errors(bench.meant, bench.measured(stage.whole[area], None, load))
        yield ("poses", area, load, "1-3", "flange"), errors.position, MM
        yield ("poses", area, load, "1-3", "orientation"), errors.rotation, DEG
    yield from _iso(bench, load)
    points = bench.measured(stage.sphere[0], _asked(stage.sphere[1]), load)
    key = ("sphere", load, "1-8", "point")
    yield ("sphere_virtual_frame", *key), accuracy.relative_to_virtual_frame(bench.meant, points)[0], MM
    yield ("sphere_three_points", *key), accuracy.relative_to_three_points(bench.meant, points)[0], MM


def _asked(which: IntArray) -> BoolArray:
    return which[:, None] == np.arange(len(pose_list.VERIFIED))


def _iso(bench: _Bench, load: int) -> Iterator[tuple[Key, FloatArray, float]]:
    """The five poses of Nubiola 2011, Table A I-1 (section 7.7.3.4), in 30 cycles from P5 to P1.

    Errors by cycle and pose, shape (30, 5).
    """
    order = np.tile([4, 3, 2, 1, 0], CYCLES)
    points = bench.measured(ISO_POSES[order] * DEG, None, load, thorough=True)  # P1 is at the wrist's singularity
    errors = accuracy.tip_errors(bench.meant, points)
    row = points.pose_ids[errors.pose] - 1
    for name, values, unit in (("flange", errors.position, MM), ("orientation", errors.rotation, DEG)):
        grid = np.full((CYCLES, 5), np.nan)
        grid[row // 5, order[row]] = values
        yield ("iso9283", "iso_poses", load, "1-3", name), grid, unit


class _Bench:
    """A calibrated robot whose fake targets are run in the cell (Nubiola 2011, section 7.4).

    Attributes
    ----------
    meant : Robot
        Where the targets are wanted: the nominal arm on the calibration's base with its tool.
    """

    def __init__(self, stage: Stage, robot: Robot, run: int) -> None:
        self.cell, self.robot, self.run = stage.cell, robot, run
        self.meant = replace_geometry(robot, stage.cell.arm)

    def measured(self, q: FloatArray, asked: BoolArray | None, load: int, thorough: bool = False) -> PointSet:
        """Points of a run of fake targets, at the joints that were wanted; targets 1 to 3 where none are asked for.

        Fake targets are the joints at which the improved model reaches what the nominal one means. Poses without fake
        targets inside the joint limits are left out, as they are where they are real.
        """
        arm = self.cell.arm
        self.run += 1
        fake, reached = q, np.ones(len(q), dtype=bool)
        if self.robot.arm is not arm:
            found = calibrated_arm.solve(self.robot, arm, arm.forward(q), seed=q, thorough=thorough)
            fake, reached = found.joints, found.inside
        cell = self.cell if asked is not None else self.cell.with_targets(pose_list.IDENTIFIED)
        seen = cell.with_payload(load).measure(fake[reached], None if asked is None else asked[reached], run=self.run)
        numbers = np.flatnonzero(reached) + 1
        points = seen.points()
        numbers = numbers[points.pose_ids - 1]
        return replace(points, q=q[numbers - 1], pose_ids=numbers)
