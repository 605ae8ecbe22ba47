"""Gross errors and mixed-up units, seen against the nominal robot before anything is identified."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from irbcal.arrays import BoolArray, FloatArray
from irbcal.errors import IdentificationError, MeasurementError
from irbcal.identification.fit import identify
from irbcal.measurement.points import PointSet, distances
from irbcal.modeling.arm import Arm
from irbcal.units import DEG, MM

FLOOR = 5 * MM
"""Distance from the nominal robot below which no point is called a gross error, metres."""

FACTOR = 8.0
"""The same as a multiple of the median distance."""

CORE = 0.6
"""Share of the points that the nominal robot is fitted to while gross errors are looked for."""

TOO_FAR = 0.1
"""Median miss, as a fraction of the spread of the measured points, that no real robot shows."""

READINGS = {
    "joints in radians instead of degrees": (1.0 / DEG, 1.0),
    "positions in metres instead of millimetres": (1.0, 1.0 / MM),
    "joints in radians and positions in metres": (1.0 / DEG, 1.0 / MM),
}


def scaled(points: PointSet, q_factor: float, xyz_factor: float) -> PointSet:
    """The same points with joints and positions multiplied."""
    return replace(points, q=points.q * q_factor, xyz=points.xyz * xyz_factor)


def spread(points: PointSet) -> float:
    """Root mean square distance of the measured points from their middle, metres.

    Not that of the tip: on a positioner the tip may lie where the axes cross, and stay there.
    """
    return float(np.sqrt(np.mean(np.sum((points.xyz - points.xyz.mean(axis=0)) ** 2, axis=1))))


def find_gross_errors(arm: Arm, points: PointSet, source: str = "the measurements") -> tuple[BoolArray, FloatArray]:
    """Points that no robot of this kind could have reached.

    The nominal robot (base and tool identified) is fitted to the 60 % of the points that it fits best, which up to
    40 % of wrong points cannot bend (least trimmed squares by concentration). A point farther from it than 8 times the
    median of all and 5 mm is a gross error. The decision uses nominal kinematics only, so it does not favour a
    calibrated model.

    Parameters
    ----------
    arm : Arm
    points : PointSet
    source : str
        File name for messages.

    Returns
    -------
    keep : ndarray of bool, shape (m,)
    distance : ndarray, shape (m,)
        From the nominal robot, metres.

    Raises
    ------
    MeasurementError
        If joints or positions are in another unit.
    IdentificationError
        If the robot does not fit the points at all.
    """
    try:
        distance = trimmed_distances(arm, points)
    except IdentificationError as error:
        _refuse_other_units(arm, points, np.inf, source)
        raise IdentificationError(str(error), file=source) from None
    median = np.median(distance)
    if median > TOO_FAR * spread(points):
        _refuse_other_units(arm, points, median, source)
        raise IdentificationError(
            f"{arm.name} misses the measured points by {median / MM:.3g} mm (median) even with the best base and tool: "
            "wrong robot file, joint order or joint signs, or a base or tool that moved between the poses?",
            file=source,
        )
    return distance <= max(FLOOR, FACTOR * median), distance


def trimmed_distances(arm: Arm, points: PointSet) -> FloatArray:
    """Distances of all points from the nominal robot fitted to the best part of them, shape (m,), metres."""
    distance = distances(identify(arm, points, "nominal").robot, points)
    core = None
    for _ in range(20):
        new = distance <= np.quantile(distance, CORE)
        if core is not None and (new == core).all():
            break
        core = new
        try:
            robot = identify(arm, points.take(core).without_empty_poses().with_seen_targets(), "nominal").robot
        except IdentificationError:  # too few for a part of them: all are needed
            return distance
        if set(robot.targets) != set(points.target_names):
            return distance
        distance = distances(robot, points)
    return distance


def _refuse_other_units(arm: Arm, points: PointSet, median: float, source: str) -> None:
    """Name the units in which the nominal robot would fit."""
    for reading, factors in READINGS.items():
        other = scaled(points, *factors)
        try:
            better = np.median(trimmed_distances(arm, other))
        except IdentificationError:
            continue
        if better < min(0.1 * median, 0.02 * spread(other)):
            raise MeasurementError(
                f"these look like {reading}: read so, the nominal robot meets the points within "
                f"{better / MM:.2g} mm (median)",
                file=source,
            )
