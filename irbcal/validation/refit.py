"""Base and tool fitted again before a calibration is judged, and zeros of joints that were lost.

Reflectors that were remounted, or a tracker or base that was moved, say nothing about the robot. The poses that
fit them again must not judge them: they are set aside, and the others are judged. After a crash or a change of a motor
the zeros of some joints are others, and all else of the robot is as it was calibrated: few poses tell them.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, lock
from irbcal.distributions import student_within
from irbcal.errors import IdentificationError, MeasurementError, OptionError
from irbcal.identification import initial_guess
from irbcal.identification.problem import Problem
from irbcal.measurement.points import PointSet
from irbcal.measurement.repeats import repeat_groups
from irbcal.modeling import frames
from irbcal.modeling.lost_zeros import MANY, WELL, with_zeros, zeros_in_words
from irbcal.modeling.robot import Robot
from irbcal.option_values import number
from irbcal.units import DEG

TOOL_SHARE = 0.5
"""Share of the poses that a tool is fitted to unless a number is given."""

MOST_STEPS = 20
LAST_STEP = 1e-12
"""Last step of the iteration, metres and radians."""
STEP = 1e-6
"""Of the zero of a joint for its derivative, radians or metres."""
LEAST_EIGENVALUE = 1e-9
"""Ratio of eigenvalues below which poses do not determine base and tool."""


@dataclass(frozen=True)
class Refit:
    """What is fitted again, and from how many poses."""

    base: bool = False
    tool: bool = False
    poses: int | None = None
    """Poses (repeats of one place count once) that place them and are not judged. None: half of them where the tool is
    fitted again; with the base alone all poses, which are judged, too.
    """
    seed: int = 0
    """Of the choice of these poses."""
    zeros: tuple[int, ...] = ()
    """Joints, from 1, whose zeros are found, too."""

    def __post_init__(self) -> None:
        if self.poses is not None:
            number("refit_from", self.poses, 3, whole=True)
            if not self:
                message = "refit_from: say what to fit again: refit_base, refit_tool, refit_zeros"
                raise OptionError(message, parameter="refit_from")
        lock(self)

    def __bool__(self) -> bool:
        return self.base or self.tool or bool(self.zeros)

    @property
    def in_words(self) -> str:
        """In words."""
        words = [word for word, refitted in (("base", self.base), ("tool", self.tool)) if refitted]
        return " and ".join([*words, *(f"zero of joint {joint}" for joint in self.zeros)])

    def sentence(self, placing: int, judged: int) -> str:
        """That so many poses place base and tool, and so many others are judged."""
        return (
            f"The {self.in_words} {'were' if self.base and self.tool else 'was'} fitted again to {placing} poses "
            f"of these measurements, for each model; errors are those of the other {judged} poses."
        )

    def chosen(self, points: PointSet, source: str) -> tuple[BoolArray, BoolArray]:
        """Which poses place base and tool, and which are judged, (n,) each.

        Raises
        ------
        MeasurementError
            If none are left to judge.
        """
        if self.poses is None and not self.tool:
            every = np.ones(points.poses, dtype=bool)
            return every, every
        index = repeat_groups(points)
        count = int(index.max(initial=-1)) + 1
        take = int(TOOL_SHARE * count) if self.poses is None else self.poses
        if take >= count:
            hint = f" (--refit-from {count - 1} leaves one)" if count > 3 else ""
            raise MeasurementError(
                f"{take} of {count} poses would fit the {self.in_words} again and leave none to judge{hint}",
                file=source,
            )
        drawn = np.zeros(count, dtype=bool)
        drawn[np.random.default_rng(self.seed).permutation(count)[:take]] = True
        return drawn[index], ~drawn[index]

    def placed(self, robot: Robot, points: PointSet, source: str) -> Robot:
        """The robot with base, tool and zeros as points say; all else of the robot is not touched.

        Parameters
        ----------
        robot : Robot
            With the tool to be fitted again, targets need not be its own.
        points : PointSet
        source : str
            File name for messages.

        Raises
        ------
        MeasurementError
            If the poses do not determine it.
        """
        if not self:
            return robot
        names, problem = points.target_names, Problem(robot.arm, points, ())
        R, p = _tips(robot, points)
        base = robot.T_world_base
        if self.base and (self.tool or self.zeros):
            try:
                base = initial_guess.closed_form(problem, _columns(R, p))[0].T_world_base
            except IdentificationError as error:
                raise MeasurementError(str(error), file=source) from None
        local = np.array([robot.targets.get(name, np.zeros(3)) for name in names])
        for _ in range(MOST_STEPS):
            free, A, miss = self._equations(robot, base, local, R, p, points)
            self._check(A, points, source)
            step = np.zeros(len(free))
            step[free] = np.linalg.lstsq(A, miss, rcond=None)[0]
            if self.base:
                base = base @ frames.transform(frames.rotation_from_one(step[:3]), step[3:6])
            local = local + step[6 : 6 + local.size].reshape(-1, 3)
            if self.zeros:
                robot = with_zeros(robot, self.zeros, step[6 + local.size :])
                R, p = _tips(robot, points)
            if np.abs(step).max() < LAST_STEP:
                break
        robot = robot.replace(T_world_base=base)
        if not self.tool:
            return robot
        rotations = initial_guess.target_rotations(problem, _columns(R, p), base[:3, :3].T)
        return robot.replace(
            targets=dict(zip(names, local, strict=True)),
            target_rotations={names[k]: rotations[k] for k in problem.oriented_targets},
        )

    def zeros_in_words(self, robot: Robot, placed: Robot, points: PointSet) -> list[str]:
        """How far the zeros of a placed robot are from those of the robot before, with 95 % intervals.

        The points of a pose share the error of the robot there, so that they count as one.
        """
        if not self.zeros:
            return []
        local = np.array([placed.targets[name] for name in points.target_names])
        _, A, miss = self._equations(placed, placed.T_world_base, local, *_tips(placed, points), points)
        freedom = 3 * points.poses - A.shape[1]
        if freedom < 1:
            return [f"{points.poses} poses are too few to tell how certain the zeros are"]
        covariance = np.linalg.inv(A.T @ A) * (miss @ miss) / freedom
        std = np.sqrt(np.diagonal(covariance)[-len(self.zeros) :])
        u95 = student_within(0.95, freedom) * std
        counts = range((A.shape[1] + 3) // 3, MANY)
        u95_of_one = std.max() * math.sqrt(points.poses)
        k = bisect_left(
            counts, -WELL, key=lambda n: -student_within(0.95, 3 * n - A.shape[1]) * u95_of_one / math.sqrt(n)
        )
        enough = counts[k] if k < len(counts) else 0
        original, refitted = robot.arm.table, placed.arm.table
        moved = np.where(refitted.prismatic, refitted.d - original.d, refitted.theta - original.theta)
        words = zeros_in_words(placed.arm, self.zeros, moved[np.array(self.zeros) - 1], u95)
        if not refitted.prismatic[np.array(self.zeros) - 1].any():
            few = f"{enough} poses like these are enough" if enough else f"{MANY} poses like these are not enough"
            words.append(f"{few} for zeros within {WELL / DEG:g} degrees (95 %)")
        return words

    def _equations(
        self, robot: Robot, base: FloatArray, local: FloatArray, R: FloatArray, p: FloatArray, points: PointSet
    ) -> tuple[BoolArray, FloatArray, FloatArray]:
        """Which unknowns are free, the derivative by these, and what is missed, in the base link.

        Unknowns: turn and shift of the base in the base link, each target in the tip link, zeros.
        """
        at = p + np.einsum("mij,mj->mi", R, local[points.target])
        T = frames.inverse(base)
        miss = points.xyz @ T[:3, :3].T + T[:3, 3] - at
        m, count = len(points), 6 + 3 * len(local) + len(self.zeros)
        J = np.zeros((m, 3, count))
        J[:, :, :6] = frames.by_motion(at).reshape(m, 3, 6)
        for k in range(len(local)):
            mask = points.target == k
            J[mask, :, 6 + 3 * k : 9 + 3 * k] = R[mask]
        for k, joint in enumerate(self.zeros, 6 + 3 * len(local)):
            R_off, p_off = _tips(with_zeros(robot, (joint,), np.array([STEP])), points)
            J[:, :, k] = (p_off + np.einsum("mij,mj->mi", R_off, local[points.target]) - at) / STEP
        free = np.r_[np.full(6, self.base), np.full(3 * len(local), self.tool), np.full(len(self.zeros), True)]
        return free, J.reshape(-1, count)[:, free], miss.ravel()

    def _check(self, A: FloatArray, points: PointSet, source: str) -> None:
        """Refuse equations that do not determine their unknowns."""
        values = np.linalg.eigvalsh(A.T @ A)
        if len(A) < A.shape[1] or values[0] < LEAST_EIGENVALUE * values[-1]:
            more = (
                "; the zero of the first joint cannot be separated from a base that is fitted again, nor the zero of "
                "the last joint from a tool"
            )
            raise MeasurementError(
                f"{points.poses} poses do not determine the {self.in_words}: give more, which turn the tool about two "
                f"directions{more if self.zeros else ''}",
                file=source,
            )


NO_REFIT = Refit()
"""Base and tool stay where the calibration has them."""


def _tips(robot: Robot, points: PointSet) -> tuple[FloatArray, FloatArray]:
    """Tip rotations (m, 3, 3) and origins (m, 3) at the points in the base link, whatever they depend on."""

    def at(xyz: FloatArray) -> FloatArray:
        targets = dict.fromkeys(points.target_names, xyz)
        return points.predicted(robot.replace(T_world_base=np.eye(4), targets=targets))

    p = at(np.zeros(3))
    return np.stack([at(axis) - p for axis in np.eye(3)], axis=2), p


def _columns(R: FloatArray, p: FloatArray) -> FloatArray:
    """Rotations (m, 3, 3) and origins (m, 3) as axes and origins, shape (4, 3, m)."""
    return np.concatenate([R.transpose(2, 1, 0), p.T[None]])
