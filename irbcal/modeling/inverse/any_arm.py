"""Inverse kinematics by damped Newton steps alone, for arms without a closed form: any serial arm, batches.

From the seed first, then within the limits from joints around it; poses that this does not solve are tried again from
random joints, and from the ends of all joints' ranges. Of the solutions within the limits the one nearest to the seed
is taken. Arms with more joints than a pose needs stay near the start.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from irbcal import parallel
from irbcal.arrays import BoolArray, FloatArray, IntArray
from irbcal.errors import RobotError
from irbcal.modeling.arm import Arm
from irbcal.modeling.inverse import closed_form, newton
from irbcal.modeling.inverse.poses import check_poses, pose_columns, usable
from irbcal.modeling.inverse.result import InverseResult, Method, Reason
from irbcal.modeling.robot import Robot

ROUNDS = ((40, 0, False), (40, 2, True), (0, 0, True), (160, 2, True), (560, 2, True))
"""Number of random starts (0: `_ends`), `newton.solve`'s straighten, and whether joints stay within the limits on the
way, one after the other for the poses still left."""

MOST_ENDS = 256

START_SPREAD = 0.03
"""Radians (metres): standard deviation of the starts around a seed."""

HOPELESS = (0.2, 0.02)
"""Merit (see `newton.CalibratedChain.merit`) below which the first round comes where a pose is within reach, and below
which the first two come."""

MANY = 16_384
"""Starts that are worked on at a time, in each thread."""

START_S = 1e-4
"""Seconds that a start takes."""


def solve(
    robot: Robot,
    nominal: Arm,
    T_base_tip: ArrayLike,
    seed: ArrayLike | None = None,
    position: float = 1e-10,
    rotation: float = 1e-10,
    thorough: bool = True,
) -> InverseResult:
    """Commanded joints that bring the tip to given poses.

    Parameters
    ----------
    robot : Robot
        Nominal or calibrated.
    nominal : Arm
        Whose limits hold.
    T_base_tip : array_like, shape (n, 4, 4)
        Tip link in the base link.
    seed : array_like, shape (n, joints) or (joints,), optional
        Joints to start from and to stay near, radians (metres for prismatic joints); those nearest to zero that lie
        within the limits unless given.
    position, rotation : float
        Tolerances, metres and radians.
    thorough : bool
        Try random starts where the seed does not do.

    Returns
    -------
    InverseResult
        Without branches: ``configuration`` is -1, ``branch_kept`` is ``converged``.

    Raises
    ------
    RobotError
        If shapes do not fit, or the seed looks like degrees.
    """
    T = check_poses(T_base_tip)
    n, joints = len(T), len(nominal.joint_names)
    seeded = seed is not None
    seed = nominal.check_joints(np.clip(np.zeros(joints), nominal.lower, nominal.upper) if seed is None else seed)
    if len(seed) not in (1, n):
        raise RobotError(f"seed joints need shape ({joints},) or ({n}, {joints}), found {seed.shape}")
    seed = np.broadcast_to(seed, (n, joints))
    H = pose_columns(T)
    good_pose = usable(T, H)
    good_seed = np.isfinite(seed).all(axis=1)
    chain = newton.CalibratedChain(robot, reach(nominal))
    search = _Search(chain, nominal, H, seed, position, rotation)
    todo = np.flatnonzero(good_pose & good_seed)
    with np.errstate(invalid="ignore", over="ignore"):
        search.run(todo, seed[todo][None])
        if thorough and seeded:
            offsets = np.random.default_rng(12).standard_normal((4, 3, 1, joints)) * START_SPREAD
            offsets[0, 0] = 0.0
            for few in offsets:
                unsolved = todo[~search.solved[todo]]
                search.run(unsolved, np.clip(seed[unsolved] + few, nominal.lower, nominal.upper), 1, True)
        if thorough:
            for number, (count, straighten, bounded) in enumerate(ROUNDS):
                unsolved = todo[~search.solved[todo]]
                if number:
                    unsolved = unsolved[chain.merit(*search.errors[:, unsolved]) < HOPELESS[min(number, 2) - 1]]
                starts = nominal.random_joints(count, number) if count else _ends(nominal)
                again = partial(search.random, starts[:, None], straighten, bounded)
                step = max(1, MANY // len(starts))
                blocks = [unsolved[k : k + step] for k in range(0, len(unsolved), step)]
                for _ in parallel.threads(again, blocks, START_S * len(starts) * len(unsolved)):
                    pass
    reason = np.full(n, Reason.NOT_FOUND)
    reason[~good_seed], reason[~good_pose] = Reason.BAD_SEED, Reason.NOT_A_POSE
    reason[search.converged] = Reason.CONVERGED
    return InverseResult(
        joints=np.where(search.converged[:, None], search.q, np.nan),
        converged=search.converged,
        inside=search.solved,
        configuration=np.full(n, -1),
        branch_kept=search.converged.copy(),
        iterations=search.iterations,
        method=np.where(search.converged, Method.NEWTON, Method.NONE),
        position_residual=search.errors[0],
        rotation_residual=search.errors[1],
        reason=reason,
    )


def reach(arm: Arm, places: int = 200) -> float:
    """Largest distance of the tip from the middle of its places at random joints, metres."""
    tip = arm.forward(arm.random_joints(places, 0))[:, :3, 3]
    return float(np.linalg.norm(tip - tip.mean(axis=0), axis=1).max())


def _ends(arm: Arm) -> FloatArray:
    """Each joint at an end of its range, in all combinations (at most `MOST_ENDS`); random where it has no end.

    From anywhere else steps seldom come to joints most of which lie at limits.
    """
    joints = len(arm.lower)
    some = np.random.default_rng(0).integers(0, 2**joints, MOST_ENDS)
    number = np.arange(2**joints) if 2**joints <= MOST_ENDS else some
    ends = np.where(number[:, None] >> np.arange(joints) & 1, arm.upper, arm.lower)
    return np.where(np.isfinite(ends), ends, arm.random_joints(len(ends), 0))


class _Search:
    """Best joints found so far for all poses: within the limits and near the seed, else any, else the least error."""

    def __init__(
        self,
        chain: newton.CalibratedChain,
        nominal: Arm,
        H: FloatArray,
        seed: FloatArray,
        position: float,
        rotation: float,
    ) -> None:
        self.chain, self.nominal, self.H, self.seed = chain, nominal, H, seed
        self.tolerance = position, rotation
        n, joints = seed.shape
        self.q = np.full((n, joints), np.nan)
        self.errors = np.full((2, n), np.nan)
        self.iterations = np.zeros(n, dtype=int)
        self.cost = np.full(n, np.inf)
        self.converged, self.solved = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)

    def good(self, position: FloatArray, rotation: FloatArray) -> BoolArray:
        """Whether both errors (n,) are within the tolerances."""
        return (position <= self.tolerance[0]) & (rotation <= self.tolerance[1])

    def random(self, starts: FloatArray, straighten: int, bounded: bool, rows: IntArray) -> None:
        """`run` from the same starts (k, 1, joints) for all poses ``rows``."""
        with np.errstate(invalid="ignore", over="ignore"):  # a thread has settings of its own
            self.run(rows, np.broadcast_to(starts, (len(starts), len(rows), starts.shape[2])), straighten, bounded)

    def run(self, rows: IntArray, starts: FloatArray, straighten: int = 0, bounded: bool = False) -> None:
        """Newton's steps for poses ``rows`` from starts (k, len(rows), joints)."""
        k, n = starts.shape[:2]
        if not n:
            return
        repeated = np.tile(rows, k)
        H, seed = self.H[:, :, repeated], self.seed[repeated]
        limits = (self.nominal.lower, self.nominal.upper) if bounded else None
        columns, *residuals, evaluations = newton.solve(
            self.chain, H, starts.reshape(k * n, -1).T.copy(), self.tolerance, straighten, limits=limits
        )
        q, errors = columns.T.copy(), np.array(residuals)
        turned, fits = closed_form.into_limits(self.nominal, q, seed, newton.ROUNDING)
        moved = np.flatnonzero(self.good(*errors) & fits & ((turned != q).any(axis=1) | ~_inside(self.nominal, q)))
        if len(moved):
            _, better, errors_new, more = newton.into_limits(
                self.chain, self.nominal, H[:, :, moved], q[moved].T, seed[moved].T
            )
            evaluations[moved] += more
            take = self.good(*errors_new)
            q[moved[take]], errors[:, moved[take]] = better[:, take].T, errors_new[:, take]
        np.add.at(self.iterations, repeated, evaluations)
        converged = self.good(*errors)
        inside = converged & _inside(self.nominal, q)
        # a solution within the limits and near the seed, then one beyond them, then the least error
        far = np.sum((q - seed) ** 2, axis=1)
        cost = np.where(inside, far, np.where(converged, 1e6 + far, 1e12 + self.chain.merit(*errors)))
        cost = np.where(np.isnan(cost), np.inf, cost).reshape(k, n)
        best = np.argmin(cost, axis=0) * n + np.arange(n)
        take = cost.ravel()[best] < self.cost[rows]
        best, rows = best[take], rows[take]
        self.cost[rows] = cost.ravel()[best]
        self.q[rows], self.errors[:, rows] = q[best], errors[:, best]
        self.converged[rows], self.solved[rows] = converged[best], inside[best]


def _inside(arm: Arm, q: FloatArray) -> BoolArray:
    """Whether joints (n, joints) are within the limits as they are."""
    slack = closed_form.LIMIT_TOLERANCE
    return np.logical_and.reduce((q >= arm.lower - slack) & (q <= arm.upper + slack), axis=1)
