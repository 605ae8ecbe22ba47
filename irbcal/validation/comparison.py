"""Comparisons pose by pose: two calibrations on the same data, and expected against verified errors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, IntArray, Locked, NameArray
from irbcal.errors import MeasurementError
from irbcal.measurement.points import PointSet, distances
from irbcal.measurement.statistics import statistics
from irbcal.modeling.arm import Arm
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.robot import Robot
from irbcal.units import MM
from irbcal.validation import bootstrap

SAME_COMMAND = 0.1 * MM
"""Distance within which a command counts as the calibration's fake target, metres."""


@dataclass(frozen=True, eq=False)
class Comparison(Locked):
    """Two sets of errors of the same poses.

    Attributes
    ----------
    pose : ndarray, shape (n,)
        Names of the poses.
    first, second : ndarray, shape (n,)
        Mean distance over the points of each pose, metres.
    interval : (float, float) or None
        Bootstrap interval of the mean of second minus first, metres.
    """

    pose: NameArray
    first: FloatArray
    second: FloatArray
    interval: tuple[float, ...] | None

    @property
    def difference(self) -> float:
        """Mean of second minus first, metres: negative where the second is better."""
        return float(np.mean(self.second - self.first))

    @property
    def second_is_better(self) -> float:
        """Share of the poses in which the second error is smaller."""
        return float(np.mean(self.second < self.first))

    def verdict(self, first: str, second: str) -> str:
        """One sentence, with what the two are called."""
        if self.interval is None:
            return f"{len(self.pose)} poses are too few to tell {first} and {second} apart."
        low, high = (value / MM for value in self.interval)
        if low <= 0 <= high:
            return f"These poses do not tell {first} and {second} apart (95 % interval {low:+.3f} to {high:+.3f} mm)."
        better, worse = (second, first) if high < 0 else (first, second)
        low, high = sorted((abs(low), abs(high)))
        return (
            f"On these poses {better} is better than {worse} by {abs(self.difference) / MM:.3f} mm "
            f"(95 % interval {low:.3f} to {high:.3f} mm)."
        )


def compare(
    first: ArrayLike,
    second: ArrayLike,
    pose: IntArray,
    names: ArrayLike,
    seed: int = 0,
    place: IntArray | None = None,
) -> Comparison:
    """Compare two errors of each point, pose by pose.

    Parameters
    ----------
    first, second : ndarray, shape (m,)
        Distances of the same points, metres.
    pose : ndarray of int, shape (m,)
    names : ndarray, shape (poses,)
        Names of the poses that ``pose`` counts.
    seed : int
        Of the bootstrap.
    place : ndarray of int, shape (poses,), optional
        Place of each pose: repeats of one place are drawn together.
    """
    used, row = np.unique(pose, return_inverse=True)
    count = np.bincount(row)
    means, two = (np.bincount(row, np.asarray(d, dtype=float)) / count for d in (first, second))
    change = two - means
    if place is not None:
        which = np.unique(place[used], return_inverse=True)[1].ravel()
        change = np.bincount(which, change) / np.bincount(which)
    interval = bootstrap.difference(change, seed=seed)
    return Comparison(np.asarray(names)[used], means, two, None if interval is None else tuple(interval))


def common_points(first: PointSet, second: PointSet) -> tuple[IntArray, IntArray]:
    """Rows of two point sets of one file that are the same pose and target.

    Parameters
    ----------
    first, second : PointSet

    Returns
    -------
    rows_first, rows_second : ndarray of int
        Sorted by pose.

    Raises
    ------
    MeasurementError
        If they have no point in common.
    """
    keys = [list(zip(points.pose_ids[points.pose], points.names(), strict=True)) for points in (first, second)]
    where = {key: k for k, key in enumerate(keys[1])}
    pairs = np.array([(k, where[key]) for k, key in enumerate(keys[0]) if key in where], dtype=int).reshape(-1, 2)
    if not len(pairs):
        raise MeasurementError(
            f"the two calibrations have no measured point in common: targets {', '.join(first.target_names)} and "
            f"{', '.join(second.target_names)}"
        )
    return pairs[:, 0], pairs[:, 1]


def expected_and_verified(robot: Robot, nominal: Arm, expected: PointSet, verified: PointSet) -> dict[str, Any]:
    """Errors as expected from uncorrected poses, and as found once the same poses were corrected (section 7.6).

    The expected error is the distance of a measured point from the calibrated model ``T_R6(q_A)`` (Nubiola 2011, Figure
    7.3); fake targets ``q_B`` bring the robot to where the nominal model ``T_6(q_A)`` means to be, and the verified
    error is what they miss that by (section 7.4).

    The verification commanded fake targets; what was meant is where the nominal arm would have been with the joints
    that the pose of the same name has in the first measurements, on the calibration's base and with its tool.

    Parameters
    ----------
    robot : Robot
        Calibrated.
    nominal : Arm
    expected : PointSet
        Measured at uncorrected joints.
    verified : PointSet
        Measured at corrected joints.

    Returns
    -------
    dict
        STATS under ``uncorrected`` (distance from what was meant, without correction), ``expected`` (distance from
        the calibrated model's prediction) and ``verified`` (distance from what was meant, with correction); the same
        ``per_group``; ``command_mm``: largest distance by which the commands miss the calibration's own fake targets;
        ``poses``: their numbers, and the names of those set aside because their commands are no fake targets of this
        calibration, such as targets that could not be corrected.

    Raises
    ------
    MeasurementError
        If no pose of the verification has its name in the first measurements.
    """
    meant = replace_geometry(robot, nominal)
    row_of = {name: k for k, name in enumerate(expected.pose_ids)}
    shared = np.array([name in row_of for name in verified.pose_ids], dtype=bool)
    if not shared.any():
        raise MeasurementError(
            "the verification has no pose of the same name as the measurements: what was meant is unknown"
        )
    verified = verified.select(shared)
    expected_points = replace(verified, q=expected.q[[row_of[name] for name in verified.pose_ids]], previous=None)
    reached = robot.forward(verified.q, verified.previous)
    apart = np.linalg.norm(reached[:, :3, 3] - meant.poses(expected_points.q)[:, :3, 3], axis=1)
    ours = apart <= SAME_COMMAND
    unlike: list[str] = []
    if ours.mean() > 0.5:  # else the whole run was made with other fake targets
        unlike = [str(name) for name in verified.pose_ids[~ours]]
        verified, expected_points, apart = verified.select(ours), expected_points.select(ours), apart[ours]
    errors = {
        "uncorrected": (distances(meant, expected), expected),
        "expected": (distances(robot, expected), expected),
        "verified": (distances(meant, expected_points), verified),
    }
    groups = sorted({str(g) for g in [*expected.groups, *verified.groups] if g})
    return {
        **{name: statistics(d) for name, (d, _) in errors.items()},
        "per_group": {
            g: {name: statistics(d[points.groups[points.pose] == g]) for name, (d, points) in errors.items()}
            for g in groups
        },
        "command_mm": float(apart.max() / MM),
        "poses": {"expected": expected.poses, "verified": verified.poses, "set_aside": unlike},
    }


def replace_geometry(robot: Robot, nominal: Arm) -> Robot:
    """The robot that would have the nominal arm on the same base with the same tool."""
    return robot.replace(arm=nominal, joint_map=JointMap.identity(nominal))
