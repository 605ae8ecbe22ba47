"""A row lost or doubled in the middle of a file: from some pose on, positions stand beside their neighbour's joints.

Base and tool of the nominal robot are found in closed form from windows of the file, read as they are and one pose
late or early; at least one window lies on one side of the place. With each, every pose has a distance as it is and one
read late or early, and the sums of both, each capped as a gross error has no more to say, from the front and from the
back tell the place at which it is best to go over from one to the other. The best is fitted anew to all poses.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray
from irbcal.identification import slips
from irbcal.measurement.own_tables import shared
from irbcal.measurement.points import PointSet, distances
from irbcal.measurement.table import MeasurementSet
from irbcal.modeling.arm import Arm
from irbcal.modeling.robot import Robot
from irbcal.units import MM

FEWEST_POSES, FEWEST = 20, 3
"""Poses below which nothing is looked for, and poses that must be shifted and poses that must not be."""

NEARER, SHARE = 8.0, 0.6
"""How many times nearer the poses of each side must be as read, and the share of them of which each is nearer so."""

NEAR, NEAR_SHARE = 30.0 * MM, 0.05
"""Median distance of either side from the nominal robot at most, metres and as a share of the spread of the points."""

WINDOW = 3
"""Part of the file, one in so many, that robots are fitted to."""


@dataclass(frozen=True)
class LostRow:
    """Where positions begin to stand beside their neighbour's joints.

    Attributes
    ----------
    pose : str
        The first such pose.
    late : int
        1 where positions belong to the joints of the pose before (they come late), -1 where to those of the next.
    poses : int
        Poses from there on.
    before, after : float
        Median distance of their points from the robot as they are and read so, metres.
    """

    pose: str
    late: int
    poses: int
    before: float
    after: float

    def in_words(self, measurements: MeasurementSet | None = None) -> str:
        """One sentence, with the row of the file where this is at hand."""
        where = f"pose {self.pose}"
        if measurements is not None:
            table = shared(measurements)
            rows = table["row"][table["pose"].astype(str) == self.pose]
            where = f"row {rows.iloc[0]} of {Path(measurements.source).name}" if len(rows) else where
        late = self.late > 0
        what = "a row of joints is missing or a position is doubled"
        if not late:
            what = "a position is missing or a row of joints is doubled"
        return (
            f"from pose {self.pose} on the points are one pose {'late' if late else 'early'}: {what} at about {where} "
            f"(read so, the {self.poses} poses from there on are met within {self.after / MM:.2g} mm (median), as they "
            f"are within {self.before / MM:.3g} mm); nothing was changed"
        )

    def sentence(self, measurements: MeasurementSet) -> str:
        """The same as a sentence of its own."""
        text = self.in_words(measurements)
        return f"{text[0].upper()}{text[1:]}."


def find(arm: Arm, points: PointSet) -> LostRow | None:
    """Look for the pose from which on positions belong to their neighbour's joints.

    Parameters
    ----------
    arm : Arm
        Nominal.
    points : PointSet
        All poses in the order of the file; of several sessions, none is looked for.

    Returns
    -------
    LostRow or None
        None where no place explains clearly more than the file as it is.
    """
    if points.session is not None or points.poses < FEWEST_POSES:
        return None
    points = replace(points, rotation=None, previous=None)
    unknowns = 12 + 3 * len(points.target_names)
    of_a_pose = 3.0 * len(points) / points.poses
    width = max(points.poses // WINDOW, int(np.ceil(slips.FEWEST_EQUATIONS * unknowns / of_a_pose)))
    if width > points.poses // 2:
        return None
    best: tuple[float, int, int] | None = None
    for first in (0, (points.poses - width) // 2, points.poses - width):
        window = np.zeros(points.poses, dtype=bool)
        window[first : first + width] = True
        for late in (0, 1, -1):
            found = _change(arm, points, _read(points, window * late), window)
            if found is not None and (best is None or found < best):
                best = found
    for _ in range(2):
        if best is None:
            return None
        _, late, place = best
        shifted = np.arange(points.poses) >= place
        best = _change(arm, points, _read(points, shifted * late), np.ones(points.poses, dtype=bool), (late,))
    return None if best is None else _named(arm, points, best[1], best[2])


def with_robot(robot: Robot, points: PointSet) -> LostRow | None:
    """The same with a robot whose base and tool are known already.

    Parameters
    ----------
    robot : Robot
    points : PointSet
        All poses in the order of the file.

    Returns
    -------
    LostRow or None
    """
    if points.session is not None or points.poses < FEWEST_POSES:
        return None
    if points.torques is None and points.payload_kg is None:  # each pose's prediction serves its neighbours, too
        predicted = _every_target(robot, points)
        rows = {late: np.clip(points.pose - late, 0, points.poses - 1) for late in (0, 1, -1)}
        apart = {late: np.linalg.norm(points.xyz - predicted[points.target, row], axis=1) for late, row in rows.items()}
    else:
        apart = {late: distances(robot, _read(points, late)) for late in (0, 1, -1)}
    read = {late: _of_poses(points, distance) for late, distance in apart.items()}
    _, late, place = min(_cheapest(read, late) for late in (1, -1))
    return _judged(points, read[0], read[late], late, place)


def _read(points: PointSet, late: int | IntArray) -> PointSet:
    """The points with the joints of the pose so many before, of all or (n,) of each; at the ends those of the last."""
    rows = np.clip(np.arange(points.poses) - late, 0, points.poses - 1)
    return replace(points, q=points.q[rows], previous=None)


def _every_target(robot: Robot, points: PointSet) -> FloatArray:
    """Where a robot expects each target at each pose from unknown moves, shape (targets, n, 3), metres."""
    n = points.poses
    alone = replace(points, pose=np.arange(n), target=np.zeros(n, int), xyz=np.zeros((n, 3)), rotation=None, u95=None)
    alone = replace(alone, previous=None)
    tip = robot.T_world_base @ alone.tips(robot)
    return np.stack([tip[:, :3, :3] @ robot.targets[name] + tip[:, :3, 3] for name in points.target_names])


def _of_poses(points: PointSet, distance: FloatArray) -> FloatArray:
    """Median distance (n,) of the points of each pose, metres."""
    first = np.searchsorted(points.pose, np.arange(points.poses))
    count = np.bincount(points.pose, minlength=points.poses)
    most = int(count.max())
    if most * points.poses > 4 * len(distance):
        order = np.lexsort((distance, points.pose))
        ordered = distance[order]
        return np.asarray((ordered[first + (count - 1) // 2] + ordered[first + count // 2]) / 2.0)
    table = np.full((points.poses, most), np.inf)
    table[points.pose, np.arange(len(distance)) - first[points.pose]] = distance
    table.sort(axis=1)
    row = np.arange(points.poses)
    return np.asarray((table[row, (count - 1) // 2] + table[row, count // 2]) / 2.0)


def _change(
    arm: Arm, points: PointSet, read: PointSet, used: BoolArray, shifts: tuple[int, ...] = (1, -1)
) -> tuple[float, int, int] | None:
    """Sum of capped distances, shift and place of the best change, seen by the robot that fits points as read."""
    some = read.select(used).without_empty_poses()
    if len(np.unique(some.target)) < len(points.target_names):
        return None
    found = slips.fitted(arm, some)
    if found is None:
        return None
    state, _ = found
    distance = {k: _of_poses(points, slips.misses(arm, state, _read(points, k))) for k in (0, *shifts)}
    return min(_cheapest(distance, late) for late in shifts)


def _cheapest(distance: Mapping[int, FloatArray], late: int) -> tuple[float, int, int]:
    """Sum of capped distances with the best place from which on poses are read with a shift; the shift; the place."""
    cap = 5.0 * NEAR
    plain, shifted = np.minimum(distance[0], cap), np.minimum(distance[late], cap)
    sums = np.concatenate([[0.0], np.cumsum(plain)]) + np.concatenate([np.cumsum(shifted[::-1])[::-1], [0.0]])
    place = int(np.argmin(sums))
    return float(sums[place]), late, place


def _named(arm: Arm, points: PointSet, late: int, place: int) -> LostRow | None:
    """The change that a robot fitted to the file as read so stands by."""
    shifted = np.arange(points.poses) >= place
    found = slips.fitted(arm, _read(points, shifted * late))
    if found is None:
        return None
    plain, other = (_of_poses(points, slips.misses(arm, found[0], _read(points, k))) for k in (0, late))
    return _judged(points, plain, other, late, place)


def _judged(points: PointSet, plain: FloatArray, shifted: FloatArray, late: int, place: int) -> LostRow | None:
    """The change, where both sides are clearly nearer as read and near."""
    spread = float(np.sqrt(np.var(points.xyz, axis=0).sum()))
    near = min(NEAR, NEAR_SHARE * spread)
    sides = ((plain[:place], shifted[:place]), (shifted[place:], plain[place:]))
    for good, bad in sides:
        if len(good) < FEWEST or np.median(good) > min(near, float(np.median(bad)) / NEARER):
            return None
        # of a few poses all must be nearer
        if np.count_nonzero((good < 0.5 * bad) & (good <= 3.0 * near)) < max(SHARE * len(good), FEWEST):
            return None
    name = str(points.pose_ids[place])
    after = float(np.median(shifted[place:]))
    return LostRow(name, late, points.poses - place, float(np.median(plain[place:])), after)
