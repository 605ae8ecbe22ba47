"""Measured points as arrays: what identification and validation compute with."""

from dataclasses import dataclass, replace

import numpy as np

from irbcal.modeling import frames


@dataclass(frozen=True, eq=False)
class PointSet:
    """Measured reflector positions and the joints at which they were measured.

    Points are sorted by pose, so that a block of poses is a slice of points.

    Parameters
    ----------
    q : ndarray, shape (n, 6)
        Commanded joints of each pose, radians.
    pose : ndarray of int, shape (m,)
        Row of ``q`` each point belongs to, ascending.
    target : ndarray of int, shape (m,)
        Index into ``target_names``.
    xyz : ndarray, shape (m, 3)
        Positions in the measuring frame, metres.
    target_names : tuple of str
    pose_ids : ndarray, shape (n,)
        The user's pose numbers.
    groups : ndarray of str, shape (n,)
        Group of each pose, empty where none was given.
    rotation : ndarray, shape (m, 3, 3), optional
        Measured orientation of a target frame in the measuring frame; NaN for points without one.
    u95 : ndarray, shape (m,), optional
        Expanded uncertainty of each point, metres; NaN where not given.
    """

    q: np.ndarray
    pose: np.ndarray
    target: np.ndarray
    xyz: np.ndarray
    target_names: tuple
    pose_ids: np.ndarray
    groups: np.ndarray
    rotation: np.ndarray | None = None
    u95: np.ndarray | None = None

    def __len__(self):
        return len(self.pose)

    @property
    def poses(self):
        """Number of poses."""
        return len(self.q)

    def joints(self):
        """Joints of each point, shape (m, 6), radians."""
        return self.q[self.pose]

    def names(self):
        """Target name of each point, shape (m,)."""
        return np.array(self.target_names, dtype=object)[self.target]

    def oriented(self):
        """Which points carry a measured orientation, shape (m,)."""
        if self.rotation is None:
            return np.zeros(len(self), dtype=bool)
        return np.isfinite(self.rotation).all(axis=(1, 2))

    def take(self, keep):
        """The points that a mask of shape (m,) keeps; the poses stay, even without points."""
        return replace(
            self,
            pose=self.pose[keep],
            target=self.target[keep],
            xyz=self.xyz[keep],
            rotation=None if self.rotation is None else self.rotation[keep],
            u95=None if self.u95 is None else self.u95[keep],
        )

    def select(self, keep):
        """The poses that a mask of shape (n,) keeps, with their points."""
        keep = np.asarray(keep, dtype=bool)
        rest = self.take(keep[self.pose])
        number = np.cumsum(keep) - 1
        return replace(
            rest, q=self.q[keep], pose=number[rest.pose], pose_ids=self.pose_ids[keep], groups=self.groups[keep]
        )

    def with_seen_targets(self):
        """The same points without names of targets that none of them has."""
        seen = np.unique(self.target)
        names = tuple(self.target_names[k] for k in seen)
        return replace(self, target=np.searchsorted(seen, self.target), target_names=names)

    def without_empty_poses(self):
        """The same points without poses that have none."""
        used = np.zeros(self.poses, dtype=bool)
        used[self.pose] = True
        return self.select(used)


def distances(robot, points):
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
    """
    local = np.array([robot.targets[name] for name in points.target_names])[points.target]
    T = robot.forward(points.q)
    R, p = T[points.pose, :3, :3], T[points.pose, :3, 3]
    base = np.einsum("mij,mj->mi", R, local) + p
    predicted = base @ robot.T_world_base[:3, :3].T + robot.T_world_base[:3, 3]
    return np.linalg.norm(points.xyz - predicted, axis=1)


def rotation_distances(robot, points):
    """Angle between each measured and predicted target frame.

    Parameters
    ----------
    robot : Robot
    points : PointSet

    Returns
    -------
    ndarray, shape (o,)
        Radians, for the points that carry an orientation and whose target frame the robot knows.
    """
    known = np.isin(points.names().astype(str), list(robot.target_rotations))
    rows = np.flatnonzero(points.oriented() & known)
    if not len(rows):
        return np.zeros(0)
    R_tip = (robot.T_world_base @ robot.poses(points.q[points.pose[rows]]))[:, :3, :3]
    local = np.array([robot.target_rotations[name] for name in points.names()[rows]])
    return frames.rotation_distance(R_tip @ local, points.rotation[rows])
