"""What one calibration of a study is worth: expected errors, and what the robot does with fake targets.

It depends on the settings and its own seed alone, so that any of them can be run again by itself::

    stage = Stage.of(Settings())
    rows, series = trial.run(stage, Repetition("34", 120, 3))

All data are simulated. Lengths are metres inside, millimetres and degrees in the rows.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from irbcal.arrays import BoolArray, FloatArray, IntArray
from irbcal.measurement.points import PointSet, distances
from irbcal.measurement.statistics import statistics
from irbcal.modeling.inverse import calibrated_arm
from irbcal.modeling.robot import Robot
from irbcal.simulation import procedure
from irbcal.studies.repetition import identify
from irbcal.studies.settings import AREAS, FULL, PAYLOADS, Repetition
from irbcal.studies.stage import Stage
from irbcal.units import DEG, MM
from irbcal.validation import accuracy
from irbcal.validation.comparison import replace_geometry

TARGETS = {"1": ("smr1",), "1-3": procedure.IDENTIFIED, "4-8": procedure.VERIFIED[3:], "1-8": procedure.VERIFIED}
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
    return which[:, None] == np.arange(len(procedure.VERIFIED))


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
        cell = self.cell if asked is not None else self.cell.with_targets(procedure.IDENTIFIED)
        seen = cell.with_payload(load).measure(fake[reached], None if asked is None else asked[reached], run=self.run)
        numbers = np.flatnonzero(reached) + 1
        points = seen.points()
        numbers = numbers[points.pose_ids - 1]
        return replace(points, q=q[numbers - 1], pose_ids=numbers)
