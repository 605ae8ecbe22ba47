"""One measuring run of the virtual cell: what was commanded, what the tracker saw, and the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, NameArray, lock
from irbcal.measurement.points import PointSet


@dataclass(frozen=True, eq=False, repr=False)
class Run:
    """One measuring run as the tracker saw it.

    Attributes
    ----------
    q : ndarray, shape (n, joints)
        Commanded joints, radians (metres for prismatic joints).
    T_base_tip : ndarray, shape (n, 4, 4)
        Where the tip really was: the truth.
    xyz : ndarray, shape (n, k, 3)
        Targets, then references, in the tracker's frame, metres; NaN where lost or not asked for.
    asked : ndarray of bool, shape (n, k)
    names : tuple of str, length k
    targets : int
        How many of the names are targets on the tool.
    time_s : ndarray, shape (n, k)
        When each point was measured, from the start of the run.
    unseen : dict of str to int
        How many of the points asked for were lost to each effect.
    payload_kg : float
    readings : ndarray, shape (n, joints), optional
        Joints as the controller read them, where these are not the commanded ones.
    payload_place : ndarray, shape (3,), optional
        Centre of the payload in the tip link, metres, where the measurements shall tell it.
    """

    q: FloatArray
    T_base_tip: FloatArray
    xyz: FloatArray
    asked: BoolArray
    names: tuple[str, ...]
    targets: int
    time_s: FloatArray
    unseen: dict[str, int]
    payload_kg: float
    readings: FloatArray | None = None
    payload_place: FloatArray | None = None

    def __post_init__(self) -> None:
        lock(self)

    def __repr__(self) -> str:
        return f"<Run: SIMULATED, {len(self.q)} poses, {int(self.asked.sum())} points of {', '.join(self.names)}>"

    def points(self, groups: Sequence[str] | NameArray | None = None) -> PointSet:
        """The targets that were seen, in the tracker's frame (references unused).

        Parameters
        ----------
        groups : sequence of str, length n, optional

        Returns
        -------
        PointSet
        """
        xyz = self.xyz[:, : self.targets]
        pose, target = np.nonzero(np.isfinite(xyz).all(axis=2))
        n = len(self.q)
        labels = np.full(n, "", dtype=object) if groups is None else np.asarray(groups, dtype=object)
        names = self.names[: self.targets]
        found = PointSet(self.q, pose, target, xyz[pose, target], names, np.arange(1, n + 1), labels)
        return found.without_empty_poses().with_seen_targets()
