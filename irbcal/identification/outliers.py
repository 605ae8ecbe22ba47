"""Gross errors and mixed-up units, seen against the nominal robot before anything is identified."""

from dataclasses import replace

import numpy as np

from irbcal.errors import IdentificationError, MeasurementError
from irbcal.identification.fit import identify
from irbcal.measurement.points import distances
from irbcal.modeling import dhm
from irbcal.units import DEG, MM

FLOOR = 10 * MM
"""Distance from the nominal robot below which no point is called a gross error, metres."""

FACTOR = 15.0
"""The same as a multiple of the median distance."""

TOO_FAR = 0.1
"""Median miss, as a fraction of the spread of the nominal tip positions, that no real robot shows."""

READINGS = {
    "joints in radians instead of degrees": (1.0 / DEG, 1.0),
    "positions in metres instead of millimetres": (1.0, 1.0 / MM),
    "joints in radians and positions in metres": (1.0 / DEG, 1.0 / MM),
}


def scaled(points, q_factor, xyz_factor):
    """The same points with joints and positions multiplied."""
    return replace(points, q=points.q * q_factor, xyz=points.xyz * xyz_factor)


def spread(arm, points):
    """Root mean square distance of the nominal tip positions from their middle, metres."""
    tip = dhm.forward(arm.table, points.q, arm.T_base_0, arm.T_6_tip)[:, :3, 3]
    return float(np.sqrt(np.mean(np.sum((tip - tip.mean(axis=0)) ** 2, axis=1))))


def find_gross_errors(arm, points, source="the measurements"):
    """Points that no robot of this kind could have reached.

    The nominal robot (base and tool identified) is fitted; points farther from it than 15 times the median and
    10 mm are taken out, farthest first, until none is left; what fits the final model is taken back in. The
    decision uses nominal kinematics only, so it does not favour a calibrated model.

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
    keep = np.ones(len(points), dtype=bool)
    for _ in range(50):
        distance = _nominal_distances(arm, points, keep, source)
        limit = max(FLOOR, FACTOR * np.median(distance[keep]))
        new = distance <= max(limit, 0.5 * distance[keep].max())
        if distance[keep].max() <= limit:
            new = distance <= limit
            if (new == keep).all():
                return keep, distance
        keep = new
    return keep, distance


def _nominal_distances(arm, points, keep, source):
    failure = None
    try:
        robot = identify(arm, points.take(keep), "nominal").robot
        distance = distances(robot, points)
    except IdentificationError as error:
        failure, distance = error, np.full(len(points), np.inf)
    median = np.median(distance[keep])
    if median <= TOO_FAR * spread(arm, points):
        return distance
    for reading, factors in READINGS.items():
        other = scaled(points, *factors)
        try:
            better = np.median(distances(identify(arm, other, "nominal").robot, other))
        except IdentificationError:
            continue
        if better < min(0.1 * median, 0.02 * spread(arm, other)):
            raise MeasurementError(
                f"{source}: these look like {reading}: read so, the nominal robot meets the points within "
                f"{better / MM:.2g} mm (median)"
            )
    if failure is not None:
        raise failure
    raise IdentificationError(
        f"{source}: {arm.name} misses the measured points by {median / MM:.3g} mm (median) even with the best base "
        "and tool: wrong robot file, joint order or joint signs?"
    )
