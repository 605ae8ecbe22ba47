r"""The fixed point of a calibrated robot's inverse (Nubiola 2011, section 6.2), for batches.

With T_n the nominal and T_R the calibrated forward kinematics and H the target (Figures 6.2 and 6.3)::

    H_fake,i = H_fake,i-1 H_aprox,i-1^-1 H,    q_i = inverse of T_n at H_fake,i,    H_aprox,i = T_R(q_i)

takes the closed-form inverse in one branch and no derivatives; its error shrinks by about a hundred in each
iteration, but not next to a singularity, and it cannot go where the nominal arm does not reach.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, IntArray, aligned
from irbcal.modeling.arm import Arm
from irbcal.modeling.inverse import closed_form, newton
from irbcal.modeling.inverse.branches import branch_signs
from irbcal.modeling.inverse.newton import CalibratedChain
from irbcal.modeling.inverse.orthoparallel import TAU, OrthoParallel
from irbcal.modeling.inverse.poses import check_poses, pose_columns
from irbcal.modeling.robot import Robot

NEAR_NOMINAL = 0.02
"""Entries of the nominal table may be this far (m or rad) from ortho-parallel: the iteration makes it good."""

ITERATIONS = 12
"""Nubiola 2011, Table 6.1, needs three."""

STALLED = 0.5
"""An iteration that leaves more than this share of the error is given up for Newton's steps."""

SLACK = 0.05
"""Radians that a start may be beyond a limit: the iteration may bring it back."""

MOST = 0.85
"""Share of poses under way below which those that are done are taken out: to do so costs a quarter of an iteration."""

SUMS = 5e-3
"""Radians: the turn of the tip up to which fake targets are moved by sums."""


class Work(NamedTuple):
    """Poses under way: places in the state (n,), signs of the branch (3, n), last merit (n,), target and fake target.

    Both are columns (4, 3, n). Joints (6, n) are the last ones; at first those whose turns to keep, where there are.
    """

    places: IntArray
    signs: FloatArray
    last: FloatArray
    H: FloatArray
    fake: FloatArray
    q: FloatArray | None


class FixedPointState:
    """Best known joints and their errors for all poses."""

    def __init__(self, n: int) -> None:
        self.q = np.full((6, n), np.nan)
        self.position, self.rotation = np.full(n, np.nan), np.full(n, np.nan)
        self.iterations = np.zeros(n, dtype=int)
        self.method = np.zeros(n, dtype=np.int8)
        self.margin = np.full(n, np.nan)
        self.rank = np.full(n, np.inf)

    def keep(
        self,
        index: IntArray,
        these: BoolArray,
        better: BoolArray,
        now: Sequence[FloatArray],
        previous: Sequence[FloatArray] | None,
        iterations: int,
    ) -> None:
        """Joints and errors of these poses of a block: those of now where they are better, else those of before.

        After the first iteration there are none of before, and where it found none the state stays.
        """
        index_kept: IntArray | slice = index
        if np.count_nonzero(these) < len(index) // 8:
            chosen = np.flatnonzero(these)
            index_kept, these, better = index[chosen], these[chosen], better[chosen]
            now = [np.take(v, chosen, axis=-1) for v in now]
            previous = None if previous is None else [np.take(v, chosen, axis=-1) for v in previous]
        elif index[-1] - index[0] == len(index) - 1:
            index_kept = slice(index[0], index[-1] + 1)
        self.iterations[index_kept] += iterations * these
        if previous is None:
            these = these & better
        elif not (better | ~these).all():
            now = [np.where(better, new, old) for new, old in zip(now, previous, strict=True)]
        for total, best in zip((self.q, self.position, self.rotation), now, strict=True):
            if isinstance(index_kept, slice):
                np.copyto(total[..., index_kept], best, where=these)
            else:
                total[..., index_kept[these]] = best[..., these]


class FixedPoint:
    """The iteration for one robot.

    Parameters
    ----------
    robot : Robot
        Calibrated arm and joint map.
    nominal : Arm
        The arm before calibration; near to ortho-parallel with a spherical wrist.
    position, rotation : float
        Tolerances, metres and radians.

    Raises
    ------
    RobotError
        If the nominal arm has no closed-form inverse.
    """

    def __init__(self, robot: Robot, nominal: Arm, position: float = 0.0, rotation: float = 0.0) -> None:
        self.closed = OrthoParallel.of(nominal, NEAR_NOMINAL)
        self.chain = CalibratedChain(robot, self.closed.reach)
        self.tolerance = position, rotation
        self.lower, self.upper = nominal.lower - SLACK, nominal.upper + SLACK

    def good(self, position: FloatArray, rotation: FloatArray) -> BoolArray:
        """Whether both errors (n,) are within the tolerances."""
        return (position <= self.tolerance[0]) & (rotation <= self.tolerance[1])

    def start_turns(self, q: FloatArray, near: FloatArray | None) -> FloatArray:
        """Joints (6, n) shifted near the limits at the turns nearest to ``near`` (6, n) or zero, in place."""
        stay = (q >= self.lower[:, None]) & (q <= self.upper[:, None])
        if near is not None:
            stay &= np.abs(near - q) <= np.pi
        for j in np.flatnonzero(~stay.all(axis=1)):
            turn = np.flatnonzero(~stay[j])
            close = 0.0 if near is None else near[j, turn]
            q[j, turn] += TAU * closed_form.whole_turns(self.lower[j], self.upper[j], q[j, turn], close)[0]
        return q

    def run(self, work: Work, state: FixedPointState, again: bool | None = None) -> tuple[Work | None, bool]:
        """The iteration of Nubiola 2011, Figure 6.2, for a block, until few poses are left: those, or None.

        Next fake targets are products of transforms (`_next_fake`) at first, which undoes what base, tool or one joint
        are turned by. Where that is less than `SUMS` for all poses of the block, they are sums from then on, of the
        fake target and of what the columns of the tip lack: the error shrinks by no less than that turn in each
        iteration, for a tenth of the arithmetic. Such a fake target is nearly a rigid transform; the closed form takes
        it as it is. Whether they are sums is returned, and told as ``again`` for the poses that are left.
        """
        index, signs, last, H, fake, q = work
        first, sums = again is None, bool(again)
        if not len(index):
            return None, sums
        few_left = len(index) // 8 if first else 0
        previous: Sequence[FloatArray] | None = None
        alive = np.ones(len(index), dtype=bool)
        for count in range(1, ITERATIONS + 1):
            q_new, margin = self.closed.branch(fake.reshape(12, -1), signs)
            if first and count == 1:
                state.margin[index] = margin
                q = self.start_turns(q_new, q)
            else:
                assert q is not None
                q = _same_turn(q_new, q)
            tip = self.chain.tip(q)
            lacking = np.subtract(H, tip, out=tip if sums else None)
            position, rotation = newton.lengths(lacking)
            merit = self.chain.merit(position, rotation)
            on = alive & (merit <= STALLED * last) & ~self.good(position, rotation)  # False for NaN: not within reach
            count_left = np.count_nonzero(on)
            ends = count_left <= few_left or count == ITERATIONS
            if ends or count_left < np.count_nonzero(alive):
                done = alive if ends else alive & ~on
                state.keep(index, done, merit < last, (q, position, rotation), previous, count)
            if count_left == 0:
                break
            alive, last = on, merit
            if sums:
                fake = np.add(fake, lacking, out=lacking)
            else:
                fake = _next_fake(fake, tip, H)
                sums = first and count == 1 and float(rotation[on].max()) < SUMS
            if count_left <= few_left or count_left < MOST * len(index):
                rows = np.flatnonzero(on)
                index = index[rows]
                signs, last, H, fake, q, position, rotation = (
                    np.take(v, rows, axis=-1) for v in (signs, last, H, fake, q, position, rotation)
                )
                alive = np.ones(count_left, dtype=bool)
            if count_left <= few_left:
                return Work(index, signs, last, H, fake, q), sums
            previous = q, position, rotation
        return None, sums


def history(
    robot: Robot, nominal: Arm, T_base_tip: FloatArray, configuration: ArrayLike, iterations: int
) -> tuple[FloatArray, FloatArray]:
    """Errors of the fixed point alone, iteration by iteration (Nubiola 2011, Table 6.1).

    All fake targets are products, as in the thesis; a solution may take sums from the second on (`FixedPoint.run`).

    Parameters
    ----------
    robot : Robot
    nominal : Arm
    T_base_tip : ndarray, shape (n, 4, 4)
    configuration : array_like of int, shape () or (n,)
    iterations : int

    Returns
    -------
    position, rotation : ndarray, shape (iterations, n)
        Metres and radians; NaN where the nominal arm does not reach.
    """
    fixed_point = FixedPoint(robot, nominal)
    H = pose_columns(check_poses(T_base_tip))
    signs = branch_signs(closed_form.check_configuration(configuration, len(T_base_tip)))
    fake, errors = H, list[tuple[FloatArray, FloatArray]]()
    q = np.zeros((6, H.shape[2]))
    for iteration in range(iterations):
        q_new, _ = fixed_point.closed.branch(fake.reshape(12, -1), signs)
        q = _same_turn(q_new, q) if iteration else fixed_point.start_turns(q_new, q)
        tip = fixed_point.chain.tip(q)
        errors.append(newton.errors(tip, H))
        fake = _next_fake(fake, tip, H)
    position, rotation = np.array(errors).swapaxes(0, 1)
    return position, rotation


def _next_fake(fake: FloatArray, tip: FloatArray, H: FloatArray) -> FloatArray:
    """The product fake tip^-1 H of columns (4, 3, n), step 1 of Nubiola 2011, section 6.2; overwrites the tip."""
    n = tip.shape[2]
    terms, along, column = aligned(3, 3, n), aligned(4, 3, n), aligned(3, n)
    np.subtract(H[3], tip[3], out=column)
    for k in (0, 1, 3):  # the transpose of the tip's axes times a column; z is the product of x and y
        np.multiply(tip[:3], H[k] if k < 3 else column, out=terms)
        np.add(np.add(terms[:, 0], terms[:, 1], out=along[k]), terms[:, 2], out=along[k])
    for k in (0, 1, 3):
        np.multiply(fake[:3], along[k][:, None], out=terms)
        np.add(np.add(terms[0], terms[1], out=tip[k]), terms[2], out=tip[k])
    np.add(tip[3], fake[3], out=tip[3])
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        np.multiply(tip[0, i], tip[1, j], out=tip[2, k])
        np.subtract(tip[2, k], np.multiply(tip[0, j], tip[1, i], out=column[0]), out=tip[2, k])
    return tip


def _same_turn(q: FloatArray, q_before: FloatArray) -> FloatArray:
    """Joints q at the turns nearest to the joints before, in place."""
    turns = q_before - q
    turns *= 1.0 / TAU
    np.rint(turns, out=turns)
    turns *= TAU
    q += turns
    return q
