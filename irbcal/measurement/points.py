"""Measured points as arrays: what identification and validation compute with."""

from dataclasses import dataclass

import numpy as np


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
    """

    q: np.ndarray
    pose: np.ndarray
    target: np.ndarray
    xyz: np.ndarray
    target_names: tuple
    pose_ids: np.ndarray
    groups: np.ndarray

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

    def select(self, keep):
        """The points of the poses that a mask of shape (n,) keeps."""
        keep = np.asarray(keep, dtype=bool)
        rows = keep[self.pose]
        number = np.cumsum(keep) - 1
        return PointSet(
            self.q[keep],
            number[self.pose[rows]],
            self.target[rows],
            self.xyz[rows],
            self.target_names,
            self.pose_ids[keep],
            self.groups[keep],
        )
