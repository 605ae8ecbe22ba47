"""Measured points as arrays: what identification and validation compute with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from irbcal.arrays import BoolArray, FloatArray, IntArray, NameArray
from irbcal.distributions import gamma_quantile
from irbcal.error_statistics import RotationStatistics, Statistics, rotation_statistics, statistics, statistics_by
from irbcal.modeling import frames
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms import inputs
from irbcal.modeling.terms.situation import at_rows
from irbcal.section import Name, Section
from irbcal.summary import Paragraph, Result, Table, values

if TYPE_CHECKING:
    import pandas as pd

TOO_FAR = 0.1
"""Median miss, as a fraction of the spread of the measured points, that no real robot shows."""


@dataclass(frozen=True, eq=False, repr=False)
class PointSet(Result):
    """Measured reflector positions and the joints at which they were measured.

    Points are sorted by pose, so that a block of poses is a slice of points.
    """

    q: FloatArray
    """Shape (n, joints). Commanded joints of each pose, radians (metres for prismatic joints)."""
    pose: IntArray
    """Shape (m,). Row of ``q`` each point belongs to, ascending."""
    target: IntArray
    """Shape (m,). Index into ``target_names``."""
    xyz: FloatArray
    """Shape (m, 3). Positions in the measuring frame, metres."""
    target_names: tuple[str, ...]
    pose_ids: NDArray[Any]
    """Shape (n,). The user's pose numbers."""
    groups: NameArray
    """Shape (n,). Group of each pose, empty where none was given."""
    rotation: FloatArray | None = None
    """Shape (m, 3, 3). Measured orientation of a target frame in the measuring frame; NaN for points without one."""
    u95: FloatArray | None = None
    """Shape (m,). Expanded uncertainty of each point, metres; NaN where not given."""
    previous: FloatArray | None = None
    """Shape (n, joints). The stop before each pose, as commanded, units as ``q``; NaN rows where it is not known."""
    session: NameArray | None = None
    """Shape (n,). Session of each pose. Poses of different sessions have bases of their own, which an identification
    finds; those of the last pose's session define the robot's base, see `irbcal.measurement.session_blocks`. None: one
    base for all.
    """
    inputs: Mapping[str, FloatArray] = field(default_factory=dict)
    """Values of shape (n,) or (n, values). What else the error model's terms are functions of, such as ``payload_kg``,
    by name: see `irbcal.modeling.terms.inputs`. SI units, NaN where not told.
    """

    def __len__(self) -> int:
        return len(self.pose)

    @property
    def poses(self) -> int:
        """Number of poses."""
        return len(self.q)

    def joints(self) -> FloatArray:
        """Joints of each point, shape (m, joints), radians (metres for prismatic joints)."""
        return self.q[self.pose]

    def names(self) -> NameArray:
        """Target name of each point, shape (m,)."""
        return np.array(self.target_names, dtype=object)[self.target]

    def oriented(self, robot: Robot | None = None) -> BoolArray:
        """Which points carry a measured orientation, and that of a target whose frame a robot knows, shape (m,)."""
        if self.rotation is None:
            return np.zeros(len(self), dtype=bool)
        known = np.array([robot is None or name in robot.target_rotations for name in self.target_names], dtype=bool)
        return np.asarray(np.isfinite(self.rotation).all(axis=(1, 2))) & known[self.target]

    def spread(self) -> float:
        """Root mean square distance of the points from their middle, metres.

        Not that of the tip: on a positioner the tip may lie where the axes cross, and stay there.
        """
        return float(np.sqrt(np.mean(np.sum((self.xyz - self.xyz.mean(axis=0)) ** 2, axis=1))))

    def distance_noise(self) -> float:
        """Standard deviation of a coordinate that distances between targets at one pose prove, metres.

        Errors of the robot move the targets of a pose as one rigid body, noise moves each alone: the variance of their
        distance is twice that of a coordinate. The lower 95 % bound of all pairs together, counted as independent (chi
        squared); zero where no pair was measured in two poses. Where the robot moved between two targets of a pose,
        what it does not repeat counts as noise.
        """
        squares, freedom = 0.0, 0
        of_target = [np.flatnonzero(self.target == k) for k in range(len(self.target_names))]
        for first, second in combinations(of_target, 2):
            poses, a, b = np.intersect1d(self.pose[first], self.pose[second], return_indices=True)
            if len(poses) > 1:
                distance = np.linalg.norm(self.xyz[first[a]] - self.xyz[second[b]], axis=1)
                squares += float(np.sum((distance - distance.mean()) ** 2)) / 2.0
                freedom += len(poses) - 1
        return float(np.sqrt(0.5 * squares / gamma_quantile(0.5 * freedom, 0.95))) if freedom else 0.0

    def tips(self, robot: Robot) -> FloatArray:
        """Where a robot expects its tip at each pose with the load carried there, in the base link, shape (n, 4, 4)."""
        return robot.forward(self.q, self.previous, **self.inputs)

    def predicted(self, robot: Robot) -> FloatArray:
        """Where a robot expects the points, given the stops before where they are known.

        Parameters
        ----------
        robot : Robot
            It must know every target that was seen.

        Returns
        -------
        ndarray, shape (m, 3)
            Metres, in the robot's measuring frame.

        Raises
        ------
        RobotError
            If it does not know a target.
        """
        local, measured = np.zeros((len(self.target_names), 3)), np.flatnonzero(np.bincount(self.target))
        for k in measured:
            local[k] = robot.target_position(self.target_names[k])
        tips = self.tips(robot)
        base = np.empty((len(self), 3))
        for k in measured:
            rows = np.flatnonzero(self.target == k)
            base[rows] = (np.einsum("nij,j->ni", tips[:, :3, :3], local[k]) + tips[:, :3, 3])[self.pose[rows]]
        return base @ robot.T_world_base[:3, :3].T + robot.T_world_base[:3, 3]

    def predicted_rotations(self, robot: Robot) -> FloatArray:
        """How a robot expects the target frames to be turned.

        Returns
        -------
        ndarray, shape (m, 3, 3)
            In the robot's measuring frame; NaN for targets whose orientation the robot does not know.
        """
        local = np.full((len(self.target_names), 3, 3), np.nan)
        for k, name in enumerate(self.target_names):
            if name in robot.target_rotations:
                local[k] = robot.target_rotations[name]
        tip = robot.T_world_base[:3, :3] @ self.tips(robot)[:, :3, :3]
        return tip[self.pose] @ local[self.target]

    def take(self, keep: BoolArray | IntArray) -> PointSet:
        """The points that a mask of shape (m,) keeps; the poses stay, even without points."""
        return replace(
            self,
            pose=self.pose[keep],
            target=self.target[keep],
            xyz=self.xyz[keep],
            rotation=None if self.rotation is None else self.rotation[keep],
            u95=None if self.u95 is None else self.u95[keep],
        )

    def select(self, keep: BoolArray) -> PointSet:
        """The poses that a mask of shape (n,) keeps, with their points."""
        keep = np.asarray(keep, dtype=bool)
        points = self.take(keep[self.pose])
        number = np.cumsum(keep) - 1
        return replace(
            points,
            q=self.q[keep],
            pose=number[points.pose],
            pose_ids=self.pose_ids[keep],
            groups=self.groups[keep],
            previous=None if self.previous is None else self.previous[keep],
            session=None if self.session is None else self.session[keep],
            inputs=at_rows(self.inputs, keep),
        )

    def moves(self) -> FloatArray:
        """Joints minus those of the stop before, shape (n, joints); zero where it is not known."""
        return np.zeros(self.q.shape) if self.previous is None else np.nan_to_num(self.q - self.previous)

    @property
    def known_moves(self) -> int:
        """Number of poses whose stop before is known."""
        return 0 if self.previous is None else int(np.isfinite(self.previous).all(axis=1).sum())

    def with_seen_targets(self) -> PointSet:
        """The same points without names of targets that none of them has."""
        measured = np.unique(self.target)
        names = tuple(self.target_names[k] for k in measured)
        return replace(self, target=np.searchsorted(measured, self.target), target_names=names)

    def without_empty_poses(self) -> PointSet:
        """The same points without poses that have none."""
        measured = np.zeros(self.poses, dtype=bool)
        measured[self.pose] = True
        return self.select(measured)

    def to_frame(self) -> pd.DataFrame:
        """One row for each point.

        Returns
        -------
        DataFrame
            ``pose``, ``group``, ``q1`` … (radians, metres for prismatic joints), ``target``, ``x_mm``, ``y_mm``,
            ``z_mm`` in the measuring frame and, where measured or told, ``u95_mm``, ``qw``, ``qx``, ``qy``, ``qz``,
            ``payload_kg`` and other inputs of the error model.
        """
        import pandas as pd

        columns: dict[str, NDArray[Any]] = {"pose": self.pose_ids[self.pose], "group": self.groups[self.pose]}
        columns |= {f"q{k}": angle for k, angle in enumerate(self.joints().T, 1)}
        columns["target"] = self.names()
        columns |= values(self, "x_mm,y_mm,z_mm=xyz u95_mm?")
        if self.rotation is not None:
            quaternion = frames.quaternion_from_matrix(self.rotation)
            columns |= dict(zip(("qw", "qx", "qy", "qz"), quaternion.T, strict=True))
        for name, given in self.inputs.items():
            columns |= inputs()[name].to_columns(given[self.pose])
        return pd.DataFrame(columns)

    def report(self) -> Sequence[Paragraph]:
        """Counts of points, poses and targets; a table of groups, where there are any."""
        counts = np.bincount(self.target, minlength=len(self.target_names))
        targets = ", ".join(f"{name} {count}" for name, count in zip(self.target_names, counts, strict=True))
        turned = f", {int(self.oriented().sum())} of them with orientation" if self.rotation is not None else ""
        lines: list[Paragraph] = [f"{len(self)} points of {self.poses} poses{turned}; targets: {targets}"]
        groups = [str(name) for name in self.groups]
        if any(groups):
            of_points = [groups[k] for k in self.pose]
            rows = tuple((name, groups.count(name), of_points.count(name)) for name in dict.fromkeys(groups))
            lines.append(Table("Groups", ("group", "poses", "points"), rows))
        return lines


def distances(robot: Robot, points: PointSet) -> FloatArray:
    """Distance of each measured point from its prediction.

    Parameters
    ----------
    robot : Robot
    points : PointSet
        In the robot's measuring frame; every target must be one of the robot's.

    Returns
    -------
    ndarray, shape (m,)
        Metres.

    Raises
    ------
    RobotError
        If the robot does not know a target.
    """
    return np.linalg.norm(points.xyz - points.predicted(robot), axis=1)


def rotation_distances(robot: Robot, points: PointSet) -> FloatArray:
    """Angle between each measured and predicted target frame.

    Returns
    -------
    ndarray, shape (o,)
        Radians, for the points that carry an orientation and whose target frame the robot knows.
    """
    rows = np.flatnonzero(points.oriented(robot))
    if points.rotation is None or not len(rows):
        return np.zeros(0)
    return frames.rotation_distance(points.predicted_rotations(robot)[rows], points.rotation[rows])


class Errors(Section):
    """Statistics of one set of poses, all points, by target and by group; of orientations where measured."""

    all: Statistics
    orientation: RotationStatistics | None
    per_target: dict[Name, Statistics]
    per_group: dict[Name, Statistics]

    @staticmethod
    def from_points(robot: Robot, points: PointSet, distance: FloatArray) -> Errors | None:
        """Of points with their distances, metres, shape (points,); None of no points."""
        overall = statistics(distance)
        if overall is None:
            return None
        groups = statistics_by(distance, points.groups[points.pose])
        return Errors(
            all=overall,
            orientation=rotation_statistics(rotation_distances(robot, points)),
            per_target=statistics_by(distance, points.names()),
            per_group={name: values for name, values in groups.items() if name},
        )
