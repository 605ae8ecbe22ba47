"""Optimal design: what poses say of the parameters, and the best of many by exchange.

A pose with Jacobian ``J`` (rows: coordinates of the reflectors seen in it; columns: base, targets and error parameters,
each in its plausible size over the standard deviation of a coordinate) adds ``J^T J`` to the information ``M``. The
prior, one plausible size for each error parameter and a metre and a radian for base and targets, keeps directions that
no pose shows from spoiling the rest. What a plan is judged by is a `Criterion`; `CRITERIA` names them.

No model describes a robot wholly. Plans for noise alone go to the corners of the workspace and are no better than
random ones where such errors are the larger part; so ``position`` also counts what a fit makes of unmodelled joint
errors: waves over the angle of each joint and tilts of its axis, of random size (variance and bias together, as Box
and Draper 1959 propose). With ``E`` what such errors do to the measured coordinates, the fit is off by
``M^-1 J^T E``.

Poses are exchanged one at a time for the candidate that serves best, until none does (Fedorov 1972; the cheaper form
of Cook and Nachtsheim 1980). All candidates are rated at once by low-rank updates of ``J M^-1 J^T``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray, Locked
from irbcal.errors import MeasurementError
from irbcal.identification.problem import Problem, State
from irbcal.measurement.points import PointSet
from irbcal.modeling.arm import Arm
from irbcal.modeling.commanded_joints import METRES_PER_DEGREE
from irbcal.modeling.parameters import Parameter, level_parameters, parameter
from irbcal.planning.conditions import Targets
from irbcal.units import DEG, MM

NOISE = 0.1 * MM
"""Standard deviation of one measured coordinate where none is given, metres."""
WAVES = 6
"""Waves of unmodelled errors in a joint: periods a turn."""
UNMODELLED_SIZE = 0.01 * DEG
"""Size of the unmodelled errors of each joint, root mean square, radians: uneven gears, backlash and the like."""


class Model:
    """What a measured pose says about an arm's unknowns, at its nominal values.

    Parameters
    ----------
    arm : Arm
    targets : Targets
    level : str
        See `irbcal.modeling.parameters`.
    noise : float
        Standard deviation of one coordinate, metres.
    parameters : sequence of Parameter, optional
        Those of the level unless given; ``level`` is then their name.
    """

    def __init__(
        self,
        arm: Arm,
        targets: Targets,
        level: str,
        noise: float = NOISE,
        parameters: Sequence[Parameter] | None = None,
    ) -> None:
        self.arm, self.targets, self.level, self.noise = arm, targets, level, float(noise)
        self.parameters = level_parameters(level, arm) if parameters is None else tuple(parameters)
        self.nuisance = 6 + 3 * len(targets.names)
        self.scale = np.concatenate([np.ones(self.nuisance), [p.scale for p in self.parameters]])

    def problem(self, q: FloatArray, visible: BoolArray) -> tuple[Problem, State]:
        """The identification from the reflectors seen in poses, and the state it is linearised at."""
        pose, target = np.nonzero(visible)
        n = len(q)
        points = PointSet(
            q, pose, target, np.zeros((len(pose), 3)), self.targets.names, np.arange(n), np.full(n, "", dtype=object)
        )
        problem = Problem(self.arm, points, self.parameters)
        return problem, State(np.eye(4), self.targets.positions, np.zeros(len(self.parameters)))

    def rows(self, q: FloatArray, visible: BoolArray) -> FloatArray:
        """Scaled Jacobians of poses.

        Parameters
        ----------
        q : ndarray, shape (n, joints)
        visible : ndarray of bool, shape (n, k)
            Reflectors measured in each pose.

        Returns
        -------
        ndarray, shape (n, r, unknowns)
            ``r`` is three times the largest number of reflectors in a pose; poses with fewer have rows of zeros.
        """
        problem, state = self.problem(q, visible)
        J = problem.jacobian(state).reshape(-1, 3, problem.unknowns) * (self.scale / self.noise)
        return _by_pose(visible, J)

    def candidates(self, q: FloatArray, visible: BoolArray, unmodelled: float = 0.0) -> Candidates:
        """What candidate poses would show.

        Parameters
        ----------
        q : ndarray, shape (N, joints)
        visible : ndarray of bool, shape (N, k)
        unmodelled : float
            Size of the errors that the model does not describe, radians; 0 for none.
        """
        rows = self.rows(q, visible)
        return Candidates(rows, self._errors(q, visible, unmodelled)) if unmodelled else Candidates.without_errors(rows)

    def _errors(self, q: FloatArray, visible: BoolArray, size: float) -> FloatArray:
        """Imagined errors as they move the reflectors, over the noise, shape (n, r, h).

        Each joint errs by waves with 1 to `WAVES` periods a turn, a cosine and a sine each, independent of one another;
        and its axis is tilted. Their squares add up to those of the expected error.
        """
        joints, slides = q.shape[1], self.arm.table.prismatic
        unit = np.where(slides, METRES_PER_DEGREE / DEG, 1.0)
        kinds = [parameter(f"delta_{'d' if slides[i] else 'theta'}{i + 1}") for i in range(joints)]
        kinds += [parameter(f"delta_beta{i + 1}") for i in range(1, joints)]
        problem = Problem(self.arm, self.problem(q, visible)[0].points, kinds)
        J = problem.jacobian(State(np.eye(4), self.targets.positions, np.zeros(len(kinds))))[:, self.nuisance :]
        J = J.reshape(-1, 3, len(kinds)) * (size / self.noise)
        pose = np.nonzero(visible)[0]
        turns = np.arange(1, WAVES + 1)[:, None] * (q / unit)[pose, None]
        waves = np.concatenate([np.cos(turns), np.sin(turns)], axis=1) * unit / np.sqrt(WAVES)
        moved = (J[:, :, None, :joints] * waves[:, None]).reshape(len(pose), 3, -1)
        return _by_pose(visible, np.concatenate([moved, J[:, :, joints:]], axis=2))

    def aim(self, criterion: str, q: FloatArray, target: int = 0, unmodelled: float = 0.0) -> Aim:
        """What a plan is chosen for.

        Parameters
        ----------
        criterion : str
            See `CRITERIA`.
        q : ndarray, shape (n, joints)
            Sample poses of the volume where the robot shall be accurate.
        target : int
            Reflector whose predicted positions count there.
        unmodelled : float
            As for `candidates`.

        Raises
        ------
        MeasurementError
            If there is no such criterion.
        """
        if criterion not in CRITERIA:
            raise MeasurementError(
                f"unknown criterion {criterion!r}: choose one of {', '.join(CRITERIA)}", parameter="criterion"
            )
        return Aim(CRITERIA[criterion].for_model(self, q, target, unmodelled))

    def mask_of(self, n: int, target: int) -> BoolArray:
        """Mask (n, k) of one reflector."""
        return np.tile(np.arange(len(self.targets.names)) == target, (n, 1))

    def measuring(self, visible: BoolArray) -> tuple[Model, BoolArray]:
        """The model with only the reflectors that a mask (n, k) has anywhere, and the mask for it."""
        used = np.any(visible, axis=0)
        names = tuple(name for name, have in zip(self.targets.names, used, strict=True) if have)
        targets = Targets(names, self.targets.positions[used])
        return Model(self.arm, targets, self.level, self.noise, self.parameters), visible[:, used]


def _by_pose(visible: BoolArray, of_points: FloatArray) -> FloatArray:
    """Rows (m, 3, p) of the reflectors seen in poses (n, k), by pose, shape (n, r, p); zeros where a pose has fewer."""
    slot = (np.cumsum(visible, axis=1) - 1)[visible]
    out = np.zeros((len(visible), int(visible.sum(axis=1).max(initial=0)), *of_points.shape[1:]))
    out[np.nonzero(visible)[0], slot] = of_points
    return out.reshape(len(visible), out.shape[1] * 3, -1)


def stacked_rows(blocks: FloatArray) -> FloatArray:
    """The rows of all poses one below the other, (n r, p) of (n, r, p)."""
    n, r, p = blocks.shape
    return blocks.reshape(n * r, p)


@dataclass(frozen=True, eq=False)
class Candidates(Locked):
    """What candidates would show."""

    rows: FloatArray
    """Shape (N, r, p). See `Model.rows`."""
    errors: FloatArray
    """Shape (N, r, h). Imagined errors that the model does not describe, over the noise; ``h`` may be 0."""

    @staticmethod
    def without_errors(rows: FloatArray) -> Candidates:
        """Candidates with no unmodelled errors."""
        return Candidates(rows, np.zeros((*rows.shape[:2], 0)))


class Criterion(ABC):
    """What a plan is judged by: a figure of the information ``M`` and of ``N = J^T E``; less is better.

    A new one is a class with `for_model` and `value`, and its name in `CRITERIA`. `gains` then tries each candidate;
    a class for which formulas do that faster keeps matrices of each candidate (`blocks`, `change`).
    """

    WORDS = "the criterion"
    """What it is, for a comparison with random poses."""
    IN_METRES = False
    """Whether it is a mean squared distance, m^2, which unmodelled errors add to."""

    @classmethod
    @abstractmethod
    def for_model(cls, model: Model, q: FloatArray, target: int, unmodelled: float) -> Criterion:
        """The criterion of a model, see `Model.aim`."""

    @abstractmethod
    def value(self, M: FloatArray, N: FloatArray) -> float:
        """The figure for information with prior (p, p) and ``J^T E`` (p, h)."""

    def gains(self, ratings: Ratings) -> FloatArray:
        """How much better the figure becomes with each candidate, shape (N,)."""
        with_each = [
            self.value(ratings.M + X.T @ X, ratings.N + X.T @ E)
            for X, E in zip(ratings.rows, ratings.errors, strict=True)
        ]
        return self.value(ratings.M, ratings.N) - np.array(with_each)

    def blocks(self, ratings: Ratings) -> FloatArray:
        """What `gains` needs of each candidate, shape (N, r, r)."""
        return np.zeros((0, 0, 0))

    def change(self, ratings: Ratings, X: FloatArray, C: FloatArray, sign: float, full: Turn) -> None:
        """Bring ``ratings.blocks`` up to date, in place, for rows X that come (sign 1) or go (-1).

        C is the inverse of ``ratings.M`` before the change, ``full`` what changes ``J C J^T``.
        """
        return


@dataclass(frozen=True)
class LogDeterminant(Criterion):
    """Minus log det of the information about the error parameters, the ``nuisance`` unknowns before them eliminated."""

    nuisance: int

    WORDS = "the information that scatter leaves (log det, less is better)"

    @classmethod
    def for_model(cls, model: Model, q: FloatArray, target: int, unmodelled: float) -> Criterion:
        """Base and targets of the model are eliminated."""
        return cls(model.nuisance)

    def value(self, M: FloatArray, N: FloatArray) -> float:
        """The logarithm of a quotient of determinants."""
        return float(np.linalg.slogdet(M[: self.nuisance, : self.nuisance])[1] - np.linalg.slogdet(M)[1])

    def blocks(self, ratings: Ratings) -> FloatArray:
        """``J C J^T`` of base and targets alone."""
        block = slice(self.nuisance)
        return ratings.products(_inverse(ratings.M[block, block]), block)

    def gains(self, ratings: Ratings) -> FloatArray:
        """Sylvester's identity: determinants of the size of a pose's rows."""
        one = np.eye(ratings.rows.shape[1])
        return np.asarray(np.linalg.slogdet(one + ratings.full)[1] - np.linalg.slogdet(one + ratings.blocks)[1])

    def change(self, ratings: Ratings, X: FloatArray, C: FloatArray, sign: float, full: Turn) -> None:
        """Woodbury's formula once more."""
        block = slice(self.nuisance)
        ratings.turn(ratings.blocks, X, _inverse(ratings.M[block, block]), block, sign)


@dataclass(frozen=True, eq=False)
class MeanSquaredError(Locked, Criterion):
    """Mean squared error of predicted positions of a reflector over sample poses, base and target included."""

    G: FloatArray
    """Shape (p, p). Mean of ``J^T J`` over the samples, metres."""
    cross: FloatArray
    """Shape (p, h). Mean of ``J^T E`` with the unmodelled errors there; ``h`` may be 0."""
    constant: float = 0.0
    """Mean of their squares."""

    WORDS = "errors unmodelled in the joints and scatter"
    IN_METRES = True

    @classmethod
    def for_model(cls, model: Model, q: FloatArray, target: int, unmodelled: float) -> Criterion:
        """Samples are the poses q (n, joints), seen by one reflector."""
        candidates = model.candidates(q, model.mask_of(len(q), target), unmodelled)
        J, E = (stacked_rows(array) * model.noise for array in (candidates.rows, candidates.errors))
        n = len(q)
        return cls(J.T @ J / n, J.T @ E / n, float(np.sum(E**2)) / n)

    def value(self, M: FloatArray, N: FloatArray) -> float:
        """Variance and squared bias."""
        variance = float(np.sum(np.linalg.inv(M) * self.G))
        if not self.counts_errors(N):
            return variance
        A = np.linalg.solve(M, N)
        return variance + float(np.sum(A * (self.G @ A - 2 * self.cross))) + self.constant

    def counts_errors(self, N: FloatArray) -> bool:
        """Whether errors are unmodelled, in the poses and in the samples."""
        return bool(N.shape[1] and self.cross.shape[1])

    def blocks(self, ratings: Ratings) -> FloatArray:
        """``J C G C J^T``."""
        C = _inverse(ratings.M)
        return ratings.products(C @ self.G @ C, slice(None))

    def gains(self, ratings: Ratings) -> FloatArray:
        """What the variance loses by Woodbury's formula, and what the bias does."""
        W = _inverse(np.eye(ratings.rows.shape[1]) + ratings.full)
        gain = np.einsum("nij,nji->n", W, ratings.blocks)
        if self.counts_errors(ratings.N):
            # the fit moves by C J' W e, with e what is left of the unmodelled errors in the candidate
            C = _inverse(ratings.M)
            A = C @ ratings.N
            e = ratings.errors - (ratings.flat @ A).reshape(ratings.errors.shape)
            We = W @ e
            Y = (ratings.flat @ (C @ (self.G @ A - self.cross))).reshape(ratings.errors.shape)
            gain -= np.einsum("nih,nih->n", We, 2 * Y + ratings.blocks @ We)
        return np.asarray(gain)

    def change(self, ratings: Ratings, X: FloatArray, C: FloatArray, sign: float, full: Turn) -> None:
        """V W Z' + Z W V' - V (W U'GU W) V' = V T' + T V' with T = Z W - V (W U'GU W) / 2."""
        V, W, U = full
        T = ratings.flat @ (C @ (self.G @ U)) @ W - V @ (0.5 * W @ (U.T @ self.G @ U) @ W)
        cross = ratings.block_products(V, T)
        blocks = ratings.blocks
        blocks -= cross
        blocks -= cross.transpose(0, 2, 1)


CRITERIA: Mapping[str, type[Criterion]] = {"position": MeanSquaredError, "D": LogDeterminant}


@dataclass(frozen=True, eq=False)
class Aim(Locked):
    """What a plan is chosen for."""

    criterion: Criterion
    prior_sums: tuple[FloatArray | float, FloatArray | float] = (0.0, 0.0)
    """Information (p, p) and ``J^T E`` (p, h) that are there anyway; numbers where there is nothing."""

    def with_given(self, poses: Candidates) -> Aim:
        """The same with what some poses (Candidates) show taken as there."""
        X, E = stacked_rows(poses.rows), stacked_rows(poses.errors)
        return replace(self, prior_sums=(self.prior_sums[0] + X.T @ X, self.prior_sums[1] + X.T @ E))

    def sums(self, rows: FloatArray, errors: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Information with prior (p, p) and ``J^T E`` (p, h) of poses."""
        X, E = stacked_rows(rows), stacked_rows(errors)
        return np.eye(X.shape[1]) + self.prior_sums[0] + X.T @ X, self.prior_sums[1] + X.T @ E

    def value(self, rows: FloatArray, errors: FloatArray) -> float:
        """The criterion; less is better."""
        return self.criterion.value(*self.sums(rows, errors))


PASSES = 20
LEAST_GAIN = 1e-4
"""Relative gain of a pass below which no further one is made."""
ACTIVE = 300
"""Candidates that take part in one pass of exchanges: those rated best at its beginning."""
DRAWS = 8
"""Random plans of each size that chosen ones are compared with."""


@dataclass(frozen=True, eq=False)
class Chosen(Locked):
    """Poses chosen out of candidates."""

    rows: IntArray
    """Shape (count,). Ascending."""
    value: float
    start_value: float
    """The criterion reached and that of the start: less is better."""
    exchanges: int


def exchange(
    candidates: Candidates,
    count: int,
    aim: Aim,
    start: Sequence[int] | IntArray | None = None,
) -> Chosen:
    """Choose poses by exchange.

    Parameters
    ----------
    candidates : Candidates
    count : int
    aim : Aim
    start : sequence of int, optional
        Candidates to start from; chosen one by one, each the best, unless given.

    Raises
    ------
    MeasurementError
        If there are fewer candidates than poses wanted.
    """
    n = len(candidates.rows)
    if not 1 <= count <= n:
        raise MeasurementError(
            f"expected to choose between 1 and {n} poses of as many candidates, found {count}", parameter="count"
        )

    def value() -> float:
        return aim.value(candidates.rows[chosen], candidates.errors[chosen])

    chosen = _one_by_one(candidates, count, aim) if start is None else np.array(start, dtype=np.int64)
    start_value, exchanges = value(), 0
    for _ in range(PASSES):
        previous = value()
        everyone = Ratings(candidates, np.arange(n), aim)
        everyone.reset(chosen)
        # where the best poses for this plan are, the best for its neighbours are, too
        pool = np.union1d(np.argsort(-everyone.gains())[: max(ACTIVE, 4 * count)], chosen)
        positions, swapped = _pass(Ratings(candidates, pool, aim), np.searchsorted(pool, chosen))
        chosen = pool[positions]
        exchanges += swapped
        if not swapped or previous - value() < LEAST_GAIN * abs(previous):
            break
    return Chosen(np.sort(chosen), value(), start_value, exchanges)


@dataclass(frozen=True, eq=False)
class DesignComparison(Locked):
    """Chosen poses beside random ones of the same candidates, by the criterion (less is better)."""

    optimal: float
    random: dict[int, float]
    """Number of random poses -> mean over `DRAWS` draws."""
    as_good_as: int | None
    """How many random poses are as good as the chosen ones; None where more than were looked at."""
    scatter: DesignComparison | None = None
    """The same from the points' scatter alone, where the criterion counts unmodelled errors, too."""


def compare(candidates: Candidates, chosen: Chosen, aim: Aim, seed: int = 0) -> DesignComparison:
    """How many random poses are as good as chosen ones.

    Parameters
    ----------
    candidates : Candidates
    chosen : Chosen
    aim : Aim
    seed : int
    """
    rng = np.random.default_rng(seed)
    n, count = len(candidates.rows), len(chosen.rows)
    means = {}
    for size in sorted({min(n, round(count * factor)) for factor in (1, 1.25, 1.5, 2, 2.5, 3, 4, 6)}):
        draws = [rng.choice(n, size, replace=False) for _ in range(DRAWS)]
        means[size] = float(np.mean([aim.value(candidates.rows[d], candidates.errors[d]) for d in draws]))
    sizes, values = np.log(list(means)), np.minimum.accumulate(list(means.values()))
    within = values[-1] <= chosen.value <= values[0]
    as_good = round(float(np.exp(np.interp(-chosen.value, -values, sizes)))) if within else None
    return DesignComparison(chosen.value, means, as_good)


def _one_by_one(candidates: Candidates, count: int, aim: Aim) -> IntArray:
    """A start: each pose the best of a part of the candidates for those chosen before."""
    pool = np.arange(0, len(candidates.rows), max(1, len(candidates.rows) // max(ACTIVE, 4 * count)))
    ratings = Ratings(candidates, pool, aim)
    free = np.ones(len(pool), dtype=bool)
    chosen: list[int] = []
    for _ in range(count):
        k = int(np.argmax(np.where(free, ratings.gains(), -np.inf)))
        ratings.change(k, 1.0)
        free[k] = False
        chosen.append(k)
    return pool[chosen]


def _pass(ratings: Ratings, chosen: IntArray) -> tuple[IntArray, int]:
    """Exchange each chosen pose for the best candidate in its place; new choice and number of exchanges."""
    chosen = chosen.copy()
    ratings.reset(chosen)
    free = np.ones(len(ratings.rows), dtype=bool)
    free[chosen] = False
    swapped = 0
    for slot, old in enumerate(chosen.tolist()):
        saved = ratings.saved()
        ratings.change(old, -1.0)
        free[old] = True
        gains = np.where(free, ratings.gains(), -np.inf)
        new = int(np.argmax(gains))
        if gains[new] <= gains[old] + 1e-9 * abs(gains[old]):
            free[old] = False
            ratings.restore(saved)
            continue
        ratings.change(new, 1.0)
        free[new] = False
        swapped += 1
        chosen[slot] = new
    return chosen, swapped


Turn: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]
"""V (N r, r), W (r, r) and U (p, r): ``J C J^T`` of the candidates changes by ``- V W V^T`` where C becomes
``C - U W U^T``."""


class Ratings:
    """What each candidate would add, kept up to date while poses come and go.

    Parameters
    ----------
    candidates : Candidates
    pool : ndarray of int
        Those that are rated.
    aim : Aim
    """

    def __init__(self, candidates: Candidates, pool: IntArray, aim: Aim) -> None:
        self.rows, self.aim = candidates.rows[pool], aim
        self.flat = self.rows.reshape(-1, self.rows.shape[2])
        self.errors = candidates.errors[pool]
        self.reset(np.zeros(0, dtype=int))

    def reset(self, chosen: IntArray) -> None:
        """Begin again with chosen poses of the pool; no rounding is carried on."""
        self.M, self.N = self.aim.sums(self.rows[chosen], self.errors[chosen])
        self.full = self.products(_inverse(self.M), slice(None))
        self.blocks = self.aim.criterion.blocks(self)

    def products(self, C: FloatArray, block: slice) -> FloatArray:
        """``J C J^T`` of each candidate, for a block of the unknowns, shape (N, r, r)."""
        n, r, _ = self.rows.shape
        return (self.flat[:, block] @ C).reshape(n, r, -1) @ self.rows[:, :, block].transpose(0, 2, 1)

    def gains(self) -> FloatArray:
        """How much better the criterion becomes with each candidate, shape (N,)."""
        return self.aim.criterion.gains(self)

    def saved(self) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """All that `change` changes, for `restore`."""
        return self.M, self.N, self.full.copy(), self.blocks.copy()

    def restore(self, saved: tuple[FloatArray, FloatArray, FloatArray, FloatArray]) -> None:
        """Undo the changes since `saved`."""
        self.M, self.N, self.full, self.blocks = saved

    def change(self, k: int, sign: float) -> None:
        """Take candidate k in (sign 1) or out (-1)."""
        X, C = self.rows[k], _inverse(self.M)
        full = self.turn(self.full, X, C, slice(None), sign)
        self.aim.criterion.change(self, X, C, sign, full)
        self.M = self.M + sign * X.T @ X
        self.N = self.N + sign * X.T @ self.errors[k]

    def turn(self, blocks: FloatArray, X: FloatArray, C: FloatArray, block: slice, sign: float) -> Turn:
        """Update ``J C J^T`` in place by Woodbury's formula; C is that before the change."""
        X = X[:, block]
        U = C @ X.T
        W = _inverse(sign * np.eye(len(X)) + X @ U)
        V = self.flat[:, block] @ U
        blocks -= self.block_products(V @ W, V)
        return V, W, U

    def block_products(self, A: FloatArray, B: FloatArray) -> FloatArray:
        """``A B^T`` of each candidate for (N r, r) arrays, shape (N, r, r)."""
        n, r, _ = self.rows.shape
        return A.reshape(n, r, r) @ B.reshape(n, r, r).transpose(0, 2, 1)


def _inverse(M: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.inv(M), dtype=np.float64)
