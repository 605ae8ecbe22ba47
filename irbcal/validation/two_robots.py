"""Whether poses are of two robots or two tools: measured early and late, or mixed.

Robot, base and targets are identified from all poses; then each part of the poses may change all of them a little. What
counts is by how much that makes residuals smaller.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray, evenly_chosen
from irbcal.errors import IdentificationError
from irbcal.identification.fit import identify
from irbcal.measurement.change_points import SHORTEST, PoseSums, beyond_chance, pose_sums
from irbcal.measurement.points import PointSet
from irbcal.modeling.arm import Arm
from irbcal.modeling.parameters import default_level
from irbcal.units import MM
from irbcal.wording import first_of


@dataclass(frozen=True, eq=False)
class PoseEquations:
    """Poses in the order of measuring, and what each says of the robot that was identified from all."""

    arm: Arm
    """Nominal."""
    points: PointSet

    def of_most(self, count: int) -> PoseEquations:
        """The same of at most so many poses, evenly chosen."""
        n = self.points.poses
        return self if n <= count else replace(self, points=self.points.select(evenly_chosen(n, count)))

    @cached_property
    def sums(self) -> PoseSums | None:
        """The equations, each unknown scaled by its own size; None where the robot cannot be identified."""
        try:
            fit = identify(self.arm, self.points.with_seen_targets(), default_level(self.arm))
        except IdentificationError:
            return None
        problem, state = fit.problem, fit.solution.state
        m = len(problem.points)
        J = problem.jacobian(state).reshape(-1, 3, problem.unknowns)[:m]
        J = J / np.maximum(np.sqrt((J**2).sum(axis=(0, 1))), 1e-300)
        return pose_sums(J, problem.residuals(state)[:m], problem.points.pose, self.points.poses)


def contradictions(arm: Arm, points: PointSet) -> list[str]:
    """Whether poses, in the order of measuring, are of two robots or tools: early and late ones, or any, in a sentence.

    Returns
    -------
    list of str
        Empty where they are not, or nothing can be said.
    """
    equations = PoseEquations(arm, points)
    return contradicting_parts(equations) or mixed_poses(equations)


RIDGE = 1e-6
"""What is added to normal equations of unknowns in their own sizes: what the data do not show stays."""
CUTS = 7
"""Places at which poses in the order of measuring are cut in two, to see whether the parts are of one robot."""
CUT_MOST_POSES = 1000
"""Poses that are compared; of more, evenly chosen ones."""
CUT_SMALLER = 0.8
"""Ratio to which residuals must fall with a model of its own for each part: those of good runs that were measured axis
by axis from several home poses fall to 0.84 (scripts/moved_alarms)."""
ALIKE = 0.6
"""Share of its spread in both parts together that each joint must have in either part for them to be compared."""


def contradicting_parts(equations: PoseEquations) -> list[str]:
    """Whether poses measured early and late are of two robots or two tools, in a sentence.

    Robot, base and targets are identified from all poses; then each part may change all of them a little. What counts
    is by how much that makes residuals smaller, and whether parts of poses in a random order would do the same.

    Returns
    -------
    list of str
        Empty where nothing beyond chance is found, or poses of one part are elsewhere than those of the other.
    """
    equations = equations.of_most(CUT_MOST_POSES)
    points, n = equations.points, equations.points.poses
    if points.session is not None or n < 4 * SHORTEST:
        return []
    cuts = np.unique(np.linspace(0, n, CUTS + 2)[1:-1].astype(int))
    cuts = cuts[[_alike(points.q, int(k)) for k in cuts]]
    sums = equations.sums if len(cuts) else None
    if sums is None or 3 * len(points) < 4 * sums.unknowns:
        return []
    rss_all, (rss_cut, cut) = sums.rss(RIDGE), sums.best_cut(cuts, RIDGE)
    if not rss_all > 0.0 or rss_cut > CUT_SMALLER**2 * rss_all:
        return []
    if not beyond_chance(n, rss_cut, lambda order: sums.ordered(order).best_cut(cuts, RIDGE)[0], 0):
        return []
    rms, rms_cut = (np.sqrt(rss / len(points)) / MM for rss in (rss_all, rss_cut))
    return [
        f"The poses before and after pose {points.pose_ids[cut]} or thereabouts contradict one another: with a robot "
        f"and a tool of their own, residuals fall from {rms:.3f} to {rms_cut:.3f} mm. Was the tool changed, are these "
        "two robots, or did the arm collide? Calibrate the parts one by one."
    ]


def _alike(q: FloatArray, k: int) -> bool:
    """Whether the poses before and after go through the same ranges."""
    spread = q.std(axis=0)
    return bool(all((half.std(axis=0) >= ALIKE * spread).all() for half in (q[:k], q[k:])))


FEWEST_POSES = 32
"""Poses below which nothing can be said."""
MIXED_MOST_POSES = 600
"""Poses that are compared; of more, evenly chosen ones."""
SPARE = 4.5
"""Equations for each unknown of two robots: with fewer, any run can be taken for two."""
MIXED_SMALLER = 0.5
"""Ratio to which residuals must fall (root mean square)."""
CLEAR_SHARE = 0.9
"""Share of the poses that must be explained `CLEARLY` better as one of the two."""
PREDICTED = 0.91
"""The same share where both were estimated from other poses: 0.92 to 1.00 of two SIMULATED robots, nearly always at
most 0.87 of one robot whose residuals fall to half."""
CLEARLY = 4.0
"""Ratio of the squares of a pose's residuals under the other robot and under its own."""
SMALLEST_SHARE = 0.1
"""Share of the poses that the smaller part must have: fewer are outliers."""
STARTS, ROUNDS = 8, 40
FOLDS = 5
"""Parts of the poses, each of which is explained by changes that were estimated from the others."""


class Halves(NamedTuple):
    """Poses that were separated."""

    second: BoolArray
    """Shape (n,). Which are of the second robot."""
    rss_single: float
    rss_split: float
    """Sums of squares as one robot and as two, m^2."""
    clear_share: float
    """Share of the poses that are explained `CLEARLY` better as one of the two."""


def mixed_poses(equations: PoseEquations) -> list[str]:
    """Whether poses are of two robots, in a sentence; empty where they are not, or nothing can be said."""
    equations = equations.of_most(MIXED_MOST_POSES)
    points, n = equations.points, equations.points.poses
    sums = None if n < FEWEST_POSES or points.session is not None else equations.sums
    if sums is None or 3 * len(points) < SPARE * 2 * sums.unknowns:
        return []
    halves = separate_halves(sums)
    if (
        halves is None
        or halves.rss_split > MIXED_SMALLER**2 * halves.rss_single
        or halves.clear_share < CLEAR_SHARE
        or _together(points.q, halves.second)
        or by_direction(points.moves(), halves.second)
        or predicted(sums, halves.second) < PREDICTED
    ):
        return []
    rms_single, rms_split = (np.sqrt(rss / len(points)) / MM for rss in (halves.rss_single, halves.rss_split))
    names = [str(points.pose_ids[k]) for k in np.flatnonzero(halves.second)]
    return [
        f"{len(names)} of {n} poses ({first_of(names, 8)}) contradict the others: as two robots, or two tools, all "
        f"poses are explained to {rms_split:.3f} mm, as one to {rms_single:.3f} mm only. Were files of two "
        "robots put together?"
    ]


def by_direction(moves: FloatArray, second: BoolArray) -> bool:
    """Whether poses are told apart by the side from which one of the joints came: backlash makes two robots of one.

    Parameters
    ----------
    moves : ndarray, shape (n, joints)
        Last moves.
    second : ndarray of bool, shape (n,)
    """
    side = np.sign(moves) * np.where(second, 1.0, -1.0)[:, None]
    return bool((np.abs(side.mean(axis=0)) >= CLEAR_SHARE).any())


def separate_halves(sums: PoseSums) -> Halves | None:
    """The best way found to tell poses apart; None where the smaller part is too small."""
    H, g, yy = sums
    n = len(g)
    rss_single = sums.rss(RIDGE)
    best: Halves | None = None
    packed = _packed(H)
    both_H, both_g = packed.sum(axis=0), g.sum(axis=0)
    second = np.array(_starts(H, g), dtype=bool)
    second_H, second_g = second @ packed, second @ g
    for _ in range(ROUNDS):  # of all starts together: the sums of poses are read once a round
        count = second.sum(axis=1)
        large = np.minimum(count, n - count) >= max(SMALLEST_SHARE * n, 4)
        second, second_H, second_g = second[large], second_H[large], second_g[large]
        if not len(second):
            break
        sums_H = np.concatenate([both_H - second_H, second_H])
        sums_g = np.concatenate([both_g - second_g, second_g])
        cost = _costs(packed, g, yy, sums_H, sums_g).reshape(2, *second.shape)
        new = cost[1] < cost[0]
        settled = (new == second).all(axis=1)
        for k in np.flatnonzero(settled):
            larger, smaller = cost[:, k].max(axis=0), cost[:, k].min(axis=0)
            split = float(smaller.sum())
            if best is None or split < best.rss_split:
                clear = larger > CLEARLY * np.maximum(smaller, 0.25 * split / n)
                fewer = second[k] if second[k].mean() <= 0.5 else ~second[k]
                best = Halves(fewer, rss_single, split, float(clear.mean()))
        moved = new[~settled].astype(float) - second[~settled]
        second, second_H = new[~settled], second_H[~settled] + moved @ packed
        second_g = second_g[~settled] + moved @ g
    return best


def predicted(sums: PoseSums, second: BoolArray) -> float:
    """Share of the poses that are explained `CLEARLY` better as one of two robots that were estimated without them.

    Parameters
    ----------
    sums : PoseSums
    second : ndarray of bool, shape (n,)
        Which poses the second robot was told apart by.
    """
    H, g, yy = sums
    n = len(second)
    fold = np.random.default_rng(0).permutation(n) % FOLDS
    smaller, larger = np.zeros(n), np.zeros(n)
    packed = _packed(H)
    for k in range(FOLDS):
        tested, trained = fold == k, fold != k
        weight = np.stack([trained & ~second, trained & second]).astype(float)
        costs = _costs(packed, g, yy, weight @ packed, weight @ g)[:, tested]
        smaller[tested], larger[tested] = costs.min(axis=0), costs.max(axis=0)
    return float((larger > CLEARLY * smaller).mean())


def _starts(H: FloatArray, g: FloatArray) -> list[BoolArray]:
    """Poses by the side on which they pull unknowns that many of them pull hard; and at random."""
    n, p = g.shape
    values, vectors = np.linalg.eigh(H.sum(axis=0))
    root = vectors / np.sqrt(np.maximum(values, 1e-6 * values.max()))
    pulls = g @ root
    _, directions = np.linalg.eigh(pulls.T @ pulls)
    rng = np.random.default_rng(0)
    along = [pulls @ directions[:, -k] > 0 for k in range(1, min(STARTS, p) + 1)]
    return [*along, *(rng.uniform(size=n) < 0.5 for _ in range(STARTS))]


def _packed(H: FloatArray) -> FloatArray:
    """Upper triangles of symmetric matrices (n, p, p), row by row, shape (n, p (p + 1) / 2): half as much to read."""
    rows, columns, _ = _upper(H.shape[1])
    return np.ascontiguousarray(H[:, rows, columns])


@cache
def _upper(p: int) -> tuple[IntArray, IntArray, FloatArray]:
    """Rows and columns of the upper triangle of a (p, p) matrix, and how often each entry stands in a symmetric one."""
    rows, columns = np.triu_indices(p)
    return rows, columns, np.where(rows == columns, 1.0, 2.0)


def _costs(packed: FloatArray, g: FloatArray, yy: FloatArray, sums_H: FloatArray, sums_g: FloatArray) -> FloatArray:
    """Squares left of each pose with the change that fits each of k parts of the poses best, shape (k, n).

    ``sums_H``, packed, and ``sums_g``, shape (k, p), are those of the parts.
    """
    p = g.shape[1]
    rows, columns, times = _upper(p)
    H = np.empty((len(sums_H), p, p))
    H[:, rows, columns] = H[:, columns, rows] = sums_H
    changes = np.linalg.solve(H + RIDGE * np.eye(p), sums_g[..., None])[..., 0]
    squares = changes[:, rows] * changes[:, columns] * times
    return np.maximum(yy - 2 * changes @ g.T + squares @ packed.T, 0.0)


def _together(q: FloatArray, second: BoolArray) -> bool:
    """Whether neighbours in joint space belong to one part more often than chance has it."""
    expected = second.mean() ** 2 + (1 - second.mean()) ** 2
    return of_one_part(q, second) > expected + 3.0 * np.sqrt(expected * (1 - expected) / (1.5 * len(q)))


def of_one_part(q: FloatArray, second: BoolArray) -> float:
    """Share of the three nearest poses in joint space that are of the same part as a pose.

    Parameters
    ----------
    q : ndarray, shape (n, joints)
    second : ndarray of bool, shape (n,)
    """
    from scipy.spatial import cKDTree

    spread = q.std(axis=0)
    scaled = q[:, spread > 0] / spread[spread > 0]
    _, near = cKDTree(scaled).query(scaled, k=4)
    return float((second[near[:, 1:]] == second[:, None]).mean())
