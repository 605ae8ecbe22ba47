"""What speaks against a calibration, whatever its errors say: something moved, or the data contradict the model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray
from irbcal.errors import IdentificationError
from irbcal.identification import data_entry_errors
from irbcal.identification.evidence_fit import EvidenceFit
from irbcal.identification.fit import Fit, identify
from irbcal.measurement.moved import SHORTEST, moved_notes, random_orders
from irbcal.measurement.points import PointSet
from irbcal.modeling.arm import Arm
from irbcal.modeling.parameters import default_level
from irbcal.modeling.workspace_coverage import workspace_coverage
from irbcal.names import first_of
from irbcal.units import MM
from irbcal.validation.length_scale import length_scale


class PoseSums(NamedTuple):
    """Normal equations of all unknowns, each scaled by its own size."""

    H: FloatArray
    """Shape (n, p, p)."""
    g: FloatArray
    """Shape (n, p)."""
    yy: FloatArray
    """Shape (n,). Squares, m^2."""

    @property
    def unknowns(self) -> int:
        """Their number."""
        return self.H.shape[1]


@dataclass(frozen=True, eq=False)
class PoseEquations:
    """Poses in the order of measuring, and what each says of the robot that was identified from all."""

    arm: Arm
    """Nominal."""
    points: PointSet

    def of_most(self, count: int) -> PoseEquations:
        """The same of at most so many poses, evenly chosen."""
        n = self.points.poses
        if n <= count:
            return self
        return replace(self, points=self.points.select(np.isin(np.arange(n), evenly(n, count))))

    @cached_property
    def sums(self) -> PoseSums | None:
        """The equations; None where the robot cannot be identified."""
        try:
            fit = identify(self.arm, self.points.with_seen_targets(), default_level(self.arm))
        except IdentificationError:
            return None
        return sums(fit, self.points.poses)


def evenly(n: int, count: int) -> IntArray:
    """Numbers of so many of n poses, evenly chosen."""
    return np.linspace(0, n - 1, count).astype(int)


def sums(fit: Fit, n: int) -> PoseSums:
    """Normal equations of a fit for each of n poses."""
    problem, state = fit.problem, fit.solution.state
    m = len(problem.points)
    J = problem.jacobian(state).reshape(-1, 3, problem.unknowns)[:m]
    r = problem.residuals(state)[:m]
    J = J / np.maximum(np.sqrt((J**2).sum(axis=(0, 1))), 1e-300)
    p = problem.unknowns
    H, g, yy = np.zeros((n, p, p)), np.zeros((n, p)), np.zeros(n)
    count = np.bincount(problem.points.pose, minlength=n)
    order = np.argsort(problem.points.pose, kind="stable")
    of_ordered = count[problem.points.pose[order]]
    for size in np.unique(of_ordered):  # poses with so many points each
        poses, points = np.flatnonzero(count == size), order[of_ordered == size]
        rows, left = J[points].reshape(len(poses), -1, p), r[points].reshape(len(poses), -1)
        H[poses] = rows.swapaxes(1, 2) @ rows
        g[poses] = (rows.swapaxes(1, 2) @ left[..., None])[..., 0]
        yy[poses] = (left**2).sum(axis=1)
    return PoseSums(H, g, yy)


FEWEST_POSES = 32
"""Poses below which nothing can be told."""
MIXED_MOST_POSES = 600
"""Poses that are compared; of more, evenly chosen ones."""
SPARE = 4.5
"""Equations for each unknown of two robots: with fewer, any run can be taken for two."""
MIXED_SMALLER = 0.5
"""Ratio to which residuals must fall (root mean square)."""
SURE = 0.9
"""Share of the poses that must be explained `CLEARLY` better as one of the two."""
PREDICTED = 0.91
"""The same share where both were estimated from other poses: 0.92 to 1.00 of two SIMULATED robots, nearly always at
most 0.87 of one robot whose residuals fall to half."""
CLEARLY = 4.0
"""Ratio of the squares of a pose's residuals under the other robot and under its own."""
FEW = 0.1
"""Share of the poses that the smaller part must have: fewer are outliers."""
STARTS, ROUNDS = 8, 40
FOLDS = 5
"""Parts of the poses, each of which is explained by changes that were estimated from the others."""


class Halves(NamedTuple):
    """Poses told apart: which are of the second robot, sums of squares as one and as two, and how clear it is."""

    second: BoolArray
    one: float
    two: float
    sure: float


def mixed_poses(equations: PoseEquations) -> list[str]:
    """Whether poses are of two robots, in a sentence; empty where they are not, or nothing can be told."""
    equations = equations.of_most(MIXED_MOST_POSES)
    points, n = equations.points, equations.points.poses
    if n < FEWEST_POSES or points.session is not None or equations.sums is None:
        return []
    H, g, yy = equations.sums
    if 3 * len(points) < SPARE * 2 * equations.sums.unknowns:
        return []
    halves = separate_halves(H, g, yy)
    if (
        halves is None
        or halves.two > MIXED_SMALLER**2 * halves.one
        or halves.sure < SURE
        or _together(points.q, halves.second)
        or by_direction(points.moves(), halves.second)
    ):
        return []
    if predicted(H, g, yy, halves.second) < PREDICTED:
        return []
    rms_one, rms_two = (np.sqrt(rss / len(points)) / MM for rss in (halves.one, halves.two))
    names = [str(points.pose_ids[k]) for k in np.flatnonzero(halves.second)]
    return [
        f"{len(names)} of {n} poses ({first_of(names, 8)}) contradict the others: as two robots, or two tools, all "
        f"poses are explained to {rms_two:.3f} mm, as one to {rms_one:.3f} mm only. Were files of two "
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
    return bool((np.abs(side.mean(axis=0)) >= SURE).any())


def separate_halves(H: FloatArray, g: FloatArray, yy: FloatArray) -> Halves | None:
    """The best way found to tell poses apart; None where the smaller part is too small.

    Parameters
    ----------
    H, g, yy : ndarray, shapes (n, p, p), (n, p), (n,)
        Of `irbcal.validation.doubts.PoseSums`.
    """
    n, p = g.shape
    firm = 1e-6 * np.eye(p)
    rss_one = float(yy.sum() - g.sum(axis=0) @ np.linalg.solve(H.sum(axis=0) + firm, g.sum(axis=0)))
    best: Halves | None = None
    packed = _packed(H)
    both_H, both_g = packed.sum(axis=0), g.sum(axis=0)
    second = np.array(_starts(H, g), dtype=bool)
    second_H, second_g = second @ packed, second @ g
    for _ in range(ROUNDS):  # of all starts together: the sums of poses are read once a round
        count = second.sum(axis=1)
        large = np.minimum(count, n - count) >= max(FEW * n, 4)
        second, second_H, second_g = second[large], second_H[large], second_g[large]
        if not len(second):
            break
        sums_H = np.concatenate([both_H - second_H, second_H])
        sums_g = np.concatenate([both_g - second_g, second_g])
        cost = _costs(packed, g, yy, sums_H, sums_g, firm).reshape(2, *second.shape)
        new = cost[1] < cost[0]
        settled = (new == second).all(axis=1)
        for k in np.flatnonzero(settled):
            larger, smaller = cost[:, k].max(axis=0), cost[:, k].min(axis=0)
            two = float(smaller.sum())
            if best is None or two < best.two:
                clear = larger > CLEARLY * np.maximum(smaller, 0.25 * two / n)
                best = Halves(second[k] if second[k].mean() <= 0.5 else ~second[k], rss_one, two, float(clear.mean()))
        moved = new[~settled].astype(float) - second[~settled]
        second, second_H = new[~settled], second_H[~settled] + moved @ packed
        second_g = second_g[~settled] + moved @ g
    return best


def predicted(H: FloatArray, g: FloatArray, yy: FloatArray, second: BoolArray) -> float:
    """Share of the poses that are explained `CLEARLY` better as one of two robots that were estimated without them.

    Parameters
    ----------
    H, g, yy : ndarray, shapes (n, p, p), (n, p), (n,)
    second : ndarray of bool, shape (n,)
        Which poses the second robot was told apart by.
    """
    n = len(second)
    fold = np.random.default_rng(0).permutation(n) % FOLDS
    smaller, larger = np.zeros(n), np.zeros(n)
    packed, firm = _packed(H), 1e-6 * np.eye(g.shape[1])
    for k in range(FOLDS):
        tested, trained = fold == k, fold != k
        weight = np.stack([trained & ~second, trained & second]).astype(float)
        costs = _costs(packed, g, yy, weight @ packed, weight @ g, firm)[:, tested]
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


def _costs(
    packed: FloatArray, g: FloatArray, yy: FloatArray, sums_H: FloatArray, sums_g: FloatArray, firm: FloatArray
) -> FloatArray:
    """Squares left of each pose with the change that fits each of k parts of the poses best, shape (k, n).

    ``sums_H``, packed, and ``sums_g``, shape (k, p), are those of the parts.
    """
    rows, columns, times = _upper(g.shape[1])
    H = np.empty((len(sums_H), *firm.shape))
    H[:, rows, columns] = H[:, columns, rows] = sums_H
    changes = np.linalg.solve(H + firm, sums_g[..., None])[..., 0]
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


FEW_EQUATIONS = 3
"""Equations for each identified combination below which the user is warned."""

LARGE_NOMINAL = 10 * MM
"""Fitted rms of the nominal robot above which something is wrong, unless the model explains it, metres."""

LEFT = 1.2 * MM, 2e-3
"""Fitted rms that no calibrated robot leaves: metres, and as a share of the spread of its tip positions."""

SCALE, SCALED = 4e-3, 0.8
"""Deviation from 1 of the scale of all positions, and the ratio to which it brings the nominal robot's residuals.
Smaller deviations are errors of zeros on robots that move by a third of their range (SIMULATED): `length_scale` judges
them."""

CUTS = 7
"""Places at which poses in the order of measuring are cut in two, to see whether the parts are of one robot."""
MOST_POSES = 1000
"""Poses that are compared; of more, evenly chosen ones."""
SMALLER = 0.8
"""Ratio to which residuals must fall with a model of its own for each part: those of good runs that were measured axis
by axis from several home poses fall to 0.84 (scripts/moved_alarms)."""
ALIKE = 0.6
"""Share of its spread in both parts together that each joint must have in either part for them to be compared."""


def doubts(
    nominal: Fit,
    fit: Fit | EvidenceFit,
    fitted: PointSet,
    measured: Sequence[PointSet],
    times: Sequence[FloatArray | None] | None = None,
    proof: PointSet | None = None,
) -> list[str]:
    """What speaks against a calibration, in sentences: nothing of it may be trusted before that is cleared up.

    Parameters
    ----------
    nominal, fit : Fit
        The nominal robot with base and tool, and the calibrated one.
    fitted : PointSet
        The fitted points.
    measured : sequence of PointSet
        All points of each file in the order in which they were measured, in the measuring frame.
    times : sequence of ndarray, shape (n,), or None, optional
        When their poses were measured, as the fit's motion counts; None where nothing is known of it.
    proof : PointSet, optional
        The held-out points.
    """
    if fit.level == "nominal":
        out = [text for points in measured for text in moved_notes(points, fit.robot)]
        out += _too_far(nominal.rms) if nominal.rms > LARGE_NOMINAL else []
        return [*out, *_data_entry_error(nominal, fitted)]
    out = []
    for points, elapsed in zip(measured, times or [None] * len(measured), strict=True):
        warmth = fit.warmth(points, elapsed) if isinstance(fit, EvidenceFit) and elapsed is not None else None
        equations = PoseEquations(nominal.problem.arm, points)
        out += moved_notes(points, fit.robot, warmth) or contradicting_parts(equations) or mixed_poses(equations)
    limit = max(LEFT[0], LEFT[1] * fitted.spread())
    if fit.rms > limit:
        out.append(
            f"The calibrated robot still misses the fitted points by {fit.rms / MM:.3g} mm (rms), more than tracker "
            "and model leave of a real robot: joints or positions are wrong in some poses, two robots or tools are "
            "mixed, or the model is too small."
        )
    if nominal.rms > LARGE_NOMINAL and fit.rms > 0.05 * nominal.rms:
        out += _too_far(nominal.rms)
    if isinstance(fit, EvidenceFit) and fit.leverage_pose is not None:
        pose, away = fit.leverage_pose
        out.append(
            f"Pose {fit.points.pose_ids[pose]} stands alone: the fit passes it, but all other poses put it "
            f"{away / MM:.3g} mm elsewhere, and none can tell which is right. Measure it again, and poses near it."
        )
    out += _data_entry_error(nominal, fitted)
    out += _scale(nominal, fitted) or _lengths(nominal.problem.arm, fit.robot.arm)
    beyond = workspace_coverage(fit.robot, nominal.robot, fitted.q, None if proof is None else proof.q)
    return [*out, beyond.in_words()] if beyond is not None and beyond.narrow else out


def _data_entry_error(nominal: Fit, fitted: PointSet) -> list[str]:
    """A data-entry error that explains why the nominal robot is far off."""
    if nominal.rms <= data_entry_errors.SUSPECT:
        return []
    data_entry_error = data_entry_errors.find_data_entry_error(
        nominal.problem.arm, fitted, pairs=nominal.rms > LARGE_NOMINAL
    )
    return [] if data_entry_error is None else [f"{data_entry_error.headline()}."]


def _scale(nominal: Fit, fitted: PointSet) -> list[str]:
    """Whether all positions are too long or too short, which a fit takes for link lengths."""
    expected, measured = fitted.predicted(nominal.robot), fitted.xyz
    expected, measured = expected - expected.mean(axis=0), measured - measured.mean(axis=0)
    scale = float((expected * measured).sum() / (expected**2).sum())
    rss, rss_scaled = (float(((measured - s * expected) ** 2).sum()) for s in (1.0, scale))
    if abs(scale - 1.0) < SCALE or rss_scaled > SCALED**2 * rss:
        return []
    how = "long" if scale > 1.0 else "short"
    return [
        f"All positions are {abs(scale - 1.0):.2%} too {how} for this robot: are the units right, and the tracker's "
        "scale? The fit takes that for link lengths."
    ]


def _lengths(nominal: Arm, calibrated: Arm) -> list[str]:
    """Whether all link lengths are too long or too short, which a wrong scale of the tracker looks like."""
    scale = length_scale(nominal, calibrated)
    return [scale.doubt()] if scale is not None and scale.beyond_machining else []


def _too_far(rms: float) -> list[str]:
    return [
        f"The nominal robot misses the fitted points by {rms / MM:.3g} mm (rms), far more than industrial robots do: "
        "something other than the robot is wrong (references, joints, robot file)."
    ]


def cautions(nominal: Fit, fit: Fit | EvidenceFit) -> list[str]:
    """What to know of a result that may well be right, in sentences."""
    out = []
    equations = 3 * nominal.problem.rows
    if isinstance(fit, Fit) and fit.level != "nominal" and equations < FEW_EQUATIONS * fit.rank:
        out.append(
            f"Only {equations} equations for {fit.rank} identified combinations: measure more poses or choose a "
            "smaller model."
        )
    if fit.level != "nominal" and nominal.rms > LARGE_NOMINAL and fit.rms <= 0.05 * nominal.rms:
        out.append(
            f"The nominal robot misses the fitted points by {nominal.rms / MM:.3g} mm (rms), far more than industrial "
            f"robots do, and the model explains it ({fit.rms / MM:.3g} mm): was a joint's zero lost, or is it another "
            "robot file's robot?"
        )
    return out


def contradicting_parts(equations: PoseEquations) -> list[str]:
    """Whether poses measured early and late are of two robots or two tools, in a sentence.

    Robot, base and targets are identified from all poses; then each part may change all of them a little. What counts
    is by how much that makes residuals smaller, and whether parts of poses in a random order would do the same.

    Returns
    -------
    list of str
        Empty where nothing beyond chance is found, or poses of one part are elsewhere than those of the other.
    """
    equations = equations.of_most(MOST_POSES)
    points, n = equations.points, equations.points.poses
    if points.session is not None or n < 4 * SHORTEST:
        return []
    cuts = np.unique(np.linspace(0, n, CUTS + 2)[1:-1].astype(int))
    cuts = cuts[[_alike(points.q, int(k)) for k in cuts]]
    if not len(cuts) or equations.sums is None:
        return []
    H, g, yy = equations.sums
    if 3 * len(points) < 4 * equations.sums.unknowns:
        return []
    whole = yy.sum() - _explained(H.sum(axis=0), g.sum(axis=0))

    def best_cut(order: IntArray) -> tuple[float, int]:
        H_of, g_of = np.cumsum(H[order], axis=0), np.cumsum(g[order], axis=0)
        costs = [
            yy.sum() - _explained(H_of[k - 1], g_of[k - 1]) - _explained(H_of[-1] - H_of[k - 1], g_of[-1] - g_of[k - 1])
            for k in cuts
        ]
        best = int(np.argmin(costs))
        return float(costs[best]), int(cuts[best])

    rss_cut, cut = best_cut(np.arange(n))
    if not whole > 0.0 or rss_cut > SMALLER**2 * whole:
        return []
    if any(best_cut(order)[0] <= rss_cut for order in random_orders(n, 0)):
        return []
    rms, rms_cut = (np.sqrt(rss / len(points)) / MM for rss in (whole, rss_cut))
    return [
        f"The poses before and after pose {points.pose_ids[cut]} or thereabouts contradict one another: with a robot "
        f"and a tool of their own, residuals fall from {rms:.3f} to {rms_cut:.3f} mm. Was the tool changed, are these "
        "two robots, or did the arm collide? Calibrate the parts one by one."
    ]


def _alike(q: FloatArray, k: int) -> bool:
    """Whether the poses before and after go through the same ranges."""
    spread = q.std(axis=0)
    return bool(all((half.std(axis=0) >= ALIKE * spread).all() for half in (q[:k], q[k:])))


def _explained(H: FloatArray, g: FloatArray) -> float:
    """Sum of squares that a free change of all unknowns takes away, of those that the data show."""
    return float(g @ np.linalg.solve(H + 1e-6 * np.eye(len(H)), g))
