"""Base and tool placed anew before a calibration is judged: the robot is the calibration's, where it stands is not.

Reflectors that were mounted anew, or a tracker or base that was moved, say nothing about the robot. The poses that
place them anew must not judge them: they are set aside, and the others are judged.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, lock
from irbcal.errors import MeasurementError, OptionError
from irbcal.measurement.places import places
from irbcal.measurement.points import PointSet
from irbcal.modeling import frames
from irbcal.modeling.robot import Robot
from irbcal.options import number

HALF = 0.5
"""Share of the poses that place a tool anew unless a number is given."""

STEPS = 20
SMALL = 1e-12
"""Last step of the iteration, metres and radians."""
SEEN = 1e-9
"""Ratio of eigenvalues below which poses do not determine base and tool."""


@dataclass(frozen=True)
class Refit:
    """What is placed anew, and from how many poses.

    Attributes
    ----------
    base, tool : bool
    poses : int or None
        Poses (repeats of one place count once) that place them and are not judged. None: half of them where the tool is
        placed anew; with the base alone all poses, which are judged, too.
    seed : int
        Of the choice of these poses.
    """

    base: bool = False
    tool: bool = False
    poses: int | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if self.poses is not None:
            number("refit_from", self.poses, 3, whole=True)
            if not (self.base or self.tool):
                raise OptionError("refit_from: say what to place anew: refit_base, refit_tool", parameter="refit_from")
        lock(self)

    def __bool__(self) -> bool:
        return self.base or self.tool

    @property
    def what(self) -> str:
        """In words."""
        return " and ".join(word for word, refitted in (("base", self.base), ("tool", self.tool)) if refitted)

    def chosen(self, points: PointSet, source: str) -> tuple[BoolArray, BoolArray]:
        """Which poses place base and tool, and which are judged, (n,) each.

        Raises
        ------
        MeasurementError
            If none are left to judge.
        """
        index = places(points)
        count = int(index.max(initial=-1)) + 1
        if self.poses is None and not self.tool:
            every = np.ones(points.poses, dtype=bool)
            return every, every
        take = int(HALF * count) if self.poses is None else self.poses
        if take >= count:
            raise MeasurementError(
                f"{take} of {count} poses are to place the {self.what} anew: none are left to judge", file=source
            )
        drawn = np.zeros(count, dtype=bool)
        drawn[np.random.default_rng(self.seed).permutation(count)[:take]] = True
        return drawn[index], ~drawn[index]

    def placed(self, robot: Robot, points: PointSet, source: str) -> Robot:
        """The robot with base and tool where points say; the robot itself is not touched.

        Parameters
        ----------
        robot : Robot
            With the tool to be placed anew, targets need not be its own.
        points : PointSet
        source : str
            File name for messages.

        Returns
        -------
        Robot

        Raises
        ------
        MeasurementError
            If the poses do not determine it.
        """
        names = points.target_names
        R, p = _tips(robot, points)
        base = robot.T_world_base
        if self.base and self.tool:
            base = _start(R, p, points, source)
        local = np.array([robot.targets.get(name, np.zeros(3)) for name in names])
        for _ in range(STEPS):
            step = self._step(base, local, R, p, points, source)
            if self.base:
                base = base @ frames.transform(frames.rotation_from_vector(step[:3]), step[3:6])
            local = local + step[6:].reshape(-1, 3)
            if np.abs(step).max() < SMALL:
                break
        if not self.tool:
            return robot.replace(T_world_base=base)
        rotations = {}
        if points.rotation is not None:
            for k, name in enumerate(names):
                mask = points.oriented() & (points.target == k)
                if mask.any():
                    R_base = base[:3, :3].T @ points.rotation[mask]
                    rotations[name] = frames.nearest_rotation((R[mask].transpose(0, 2, 1) @ R_base).mean(axis=0))
        targets = dict(zip(names, local, strict=True))
        return robot.replace(T_world_base=base, targets=targets, target_rotations=rotations)

    def _step(
        self, base: FloatArray, local: FloatArray, R: FloatArray, p: FloatArray, points: PointSet, source: str
    ) -> FloatArray:
        """Gauss-Newton step: turn and shift of the base in the base link, then of each target in the tip link."""
        at = p + np.einsum("mij,mj->mi", R, local[points.target])
        T = frames.inverse(base)
        miss = points.xyz @ T[:3, :3].T + T[:3, 3] - at
        m, count = len(points), 6 + 3 * len(local)
        J = np.zeros((m, 3, count))
        J[:, :, :3] = -_cross(at)
        J[:, :, 3:6] = np.eye(3)
        for k in range(len(local)):
            mask = points.target == k
            J[mask, :, 6 + 3 * k : 9 + 3 * k] = R[mask]
        free = np.r_[np.full(6, self.base), np.full(count - 6, self.tool)]
        A = J.reshape(-1, count)[:, free]
        values = np.linalg.eigvalsh(A.T @ A)
        if 3 * m < free.sum() or values[0] < SEEN * values[-1]:
            raise MeasurementError(
                f"{points.poses} poses do not determine the {self.what}: give more, which turn the tool about two "
                "directions",
                file=source,
            )
        step = np.zeros(count)
        step[free] = np.linalg.solve(A.T @ A, A.T @ miss.ravel())
        return step


def _cross(p: FloatArray) -> FloatArray:
    """Matrices (m, 3, 3) of the products p x."""
    out = np.zeros((len(p), 3, 3))
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        out[:, i, j], out[:, j, i] = -p[:, k], p[:, k]
    return out


def _tips(robot: Robot, points: PointSet) -> tuple[FloatArray, FloatArray]:
    """Tip rotations (m, 3, 3) and origins (m, 3) at the points in the base link, whatever they depend on."""

    def at(xyz: FloatArray) -> FloatArray:
        targets = dict.fromkeys(points.target_names, xyz)
        return points.predicted(robot.replace(T_world_base=np.eye(4), targets=targets))

    p = at(np.zeros(3))
    return np.stack([at(axis) - p for axis in np.eye(3)], axis=2), p


def _start(R: FloatArray, p: FloatArray, points: PointSet, source: str) -> FloatArray:
    """Base in closed form with the tool unknown: ``W y + s - R c = p`` is linear, see `closed_form`."""
    m, names = len(points), points.target_names
    centre = points.xyz.mean(axis=0)
    y = points.xyz - centre
    M = np.zeros((m, 3, 12 + 3 * len(names)))
    for k in range(3):
        M[:, k, 3 * k : 3 * k + 3] = y
        M[:, k, 9 + k] = 1.0
    for k in range(len(names)):
        mask = points.target == k
        M[mask, :, 12 + 3 * k : 15 + 3 * k] = -R[mask]
    A = M.reshape(3 * m, -1)
    if len(A) < A.shape[1]:
        raise MeasurementError(f"{points.poses} poses are too few to place base and tool anew", file=source)
    solution = np.linalg.lstsq(A, p.ravel(), rcond=None)[0]
    W = frames.nearest_rotation(solution[:9].reshape(3, 3))
    # with the rotation fixed, the translation once more
    shift = np.linalg.lstsq(A[:, 9:], (p - y @ W.T).ravel(), rcond=None)[0][:3]
    return frames.inverse(frames.transform(W, shift - W @ centre))
