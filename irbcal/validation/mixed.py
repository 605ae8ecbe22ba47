"""Whether poses are of two robots, by turns or at random: residuals that two models explain, and one cannot.

Robot, base and targets are identified from all poses. Then poses are told apart by which of two small changes of all
unknowns explains them better, and both changes are estimated again, until nothing changes. That makes residuals of any
run smaller; what counts is how much smaller, that nearly every pose belongs to one of the two beyond doubt, and that
neighbours in joint space do not belong together: what a model does not describe depends on the pose, too.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from irbcal.arrays import BoolArray, FloatArray
from irbcal.units import MM
from irbcal.validation.pose_equations import PoseEquations

FEWEST = 32
"""Poses below which nothing can be told."""
MOST_POSES = 600
"""Poses that are compared; of more, evenly chosen ones."""
SPARE = 4.5
"""Equations for each unknown of two robots: with fewer, any run can be taken for two."""
SMALLER = 0.5
"""Ratio to which residuals must fall (root mean square)."""
SURE = 0.9
"""Share of the poses that must be explained `CLEARLY` better as one of the two."""
PREDICTED = 0.91
"""The same share where both were estimated from other poses: 0.92 to 1.00 of two SIMULATED robots, nearly always at
most 0.87 of one robot whose residuals fall to half."""
CLEARLY = 4.0
"""Ratio of the squares of a pose's residuals under the other robot and under its own."""
FEW = 0.1
"""Share of the poses that the smaller part must have: fewer are gross errors."""
STARTS, ROUNDS = 8, 40
FOLDS = 5
"""Parts of the poses, each of which is explained by changes that were estimated from the others."""


class Halves(NamedTuple):
    """Poses told apart: which are of the second robot, sums of squares as one and as two, and how clear it is."""

    second: BoolArray
    one: float
    two: float
    sure: float


def mixed_poses(equations: PoseEquations, seed: int = 0) -> list[str]:
    """Whether poses are of two robots, in a sentence.

    Parameters
    ----------
    equations : PoseEquations
    seed : int
        Of random starts.

    Returns
    -------
    list of str
        Empty where they are not, or nothing can be told.
    """
    equations = equations.of_most(MOST_POSES)
    points, n = equations.points, equations.points.poses
    if n < FEWEST or points.session is not None or equations.sums is None:
        return []
    H, g, yy = equations.sums
    if 3 * len(points) < SPARE * 2 * equations.sums.unknowns:
        return []
    found = told_apart(H, g, yy, seed)
    if found is None or found.two > SMALLER**2 * found.one or found.sure < SURE or _together(points.q, found.second):
        return []
    if predicted(H, g, yy, found.second, seed) < PREDICTED:
        return []
    before, after = (np.sqrt(rss / len(points)) / MM for rss in (found.one, found.two))
    names = [str(points.pose_ids[k]) for k in np.flatnonzero(found.second)]
    shown = ", ".join(names[:8]) + (" …" if len(names) > 8 else "")
    return [
        f"{len(names)} of {n} poses ({shown}) contradict the others: as two robots, or two tools, all poses are "
        f"explained to {after:.3f} mm, as one to {before:.3f} mm only. Were files of two robots put together?"
    ]


def told_apart(H: FloatArray, g: FloatArray, yy: FloatArray, seed: int = 0) -> Halves | None:
    """The best way found to tell poses apart; None where the smaller part is too small.

    Parameters
    ----------
    H, g, yy : ndarray, shapes (n, p, p), (n, p), (n,)
        Of `irbcal.validation.pose_equations.PoseSums`.
    seed : int
    """
    n, p = g.shape
    firm = 1e-6 * np.eye(p)
    one = float(yy.sum() - g.sum(axis=0) @ np.linalg.solve(H.sum(axis=0) + firm, g.sum(axis=0)))
    best: Halves | None = None
    for second in _starts(H, g, seed):
        for _ in range(ROUNDS):
            if min(second.sum(), n - second.sum()) < max(FEW * n, 4):
                break
            cost = _costs(H, g, yy, np.stack([~second, second]), firm)
            new = cost[1] < cost[0]
            if (new == second).all():
                two = float(cost.min(axis=0).sum())
                if best is None or two < best.two:
                    clear = cost.max(axis=0) > CLEARLY * np.maximum(cost.min(axis=0), 0.25 * two / n)
                    best = Halves(second if second.mean() <= 0.5 else ~second, one, two, float(clear.mean()))
                break
            second = new
    return best


def predicted(H: FloatArray, g: FloatArray, yy: FloatArray, second: BoolArray, seed: int = 0) -> float:
    """Share of the poses that are explained `CLEARLY` better as one of two robots that were estimated without them.

    Parameters
    ----------
    H, g, yy : ndarray, shapes (n, p, p), (n, p), (n,)
    second : ndarray of bool, shape (n,)
        Which poses the second robot was told apart by.
    seed : int
        Of the folds.
    """
    n = len(second)
    fold = np.random.default_rng(seed).permutation(n) % FOLDS
    least, most = np.zeros(n), np.zeros(n)
    for k in range(FOLDS):
        mine, rest = fold == k, fold != k
        costs = _costs(H, g, yy, np.stack([rest & ~second, rest & second]), 1e-6 * np.eye(g.shape[1]))[:, mine]
        least[mine], most[mine] = costs.min(axis=0), costs.max(axis=0)
    return float((most > CLEARLY * least).mean())


def _starts(H: FloatArray, g: FloatArray, seed: int) -> list[BoolArray]:
    """Poses by the side on which they pull unknowns that many of them pull hard; and at random."""
    n, p = g.shape
    values, vectors = np.linalg.eigh(H.sum(axis=0))
    root = vectors / np.sqrt(np.maximum(values, 1e-6 * values.max()))
    pulls = g @ root
    _, directions = np.linalg.eigh(pulls.T @ pulls)
    rng = np.random.default_rng(seed)
    along = [pulls @ directions[:, -k] > 0 for k in range(1, min(STARTS, p) + 1)]
    return [*along, *(rng.uniform(size=n) < 0.5 for _ in range(STARTS))]


def _costs(H: FloatArray, g: FloatArray, yy: FloatArray, parts: BoolArray, firm: FloatArray) -> FloatArray:
    """Squares left of each pose with the change that fits each part (k, n) of the poses best, shape (k, n)."""
    n, p = g.shape
    flat, weight = H.reshape(n, -1), parts.astype(float)
    changes = np.linalg.solve((weight @ flat).reshape(-1, p, p) + firm, (weight @ g)[..., None])[..., 0]
    squares = np.einsum("ki,kj->kij", changes, changes).reshape(len(parts), -1)
    return np.maximum(yy - 2 * changes @ g.T + squares @ flat.T, 0.0)


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
