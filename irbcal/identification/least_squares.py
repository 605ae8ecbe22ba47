"""Least squares by Gauss-Newton with analytic derivatives and rank handling; what the data show; the course of a fit.

The normal equations are summed over blocks of poses (memory does not grow with the data). Base and targets have no
nominal values, so they are eliminated first (Schur complement). What is left is the information about the robot's own
error parameters, scaled by their plausible sizes. A direction in that space is *seen* if its standard deviation, given
the residuals at hand, is smaller than the plausible size; every other direction is *held*: the parameters keep the
smallest change from nominal along it.

What the data show is judged by the residuals of the moment, so that near the noise a direction may come and go: once
seen it moves, and moved it is not seen. Where the objective no longer falls, the held directions are therefore frozen:
what is left is an ordinary least-squares problem with fewer unknowns.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Generic, TypeAlias, TypeVar

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray, Locked
from irbcal.errors import IdentificationError
from irbcal.identification.problem import Problem, S, State, VectorProblem
from irbcal.summary import Paragraph, Result, Table
from irbcal.units import MM

if TYPE_CHECKING:
    from irbcal.plotting.charts import Chart

ROUNDING = 1e-13
"""Information below this fraction of the largest is rounding, whatever the residuals."""

HELD, TIED = 0.99, 0.01
"""Share of a parameter in held directions above which it counts as held, and as tied."""


@dataclass(frozen=True, eq=False)
class Information(Locked):
    """Information about the error parameters after base and targets are eliminated."""

    eigenvalues: FloatArray
    """Shape (k,). Of the scaled information matrix, m^2 (change of the sum of squares for one plausible size),
    ascending; those of held directions come first.
    """
    directions: FloatArray
    """Shape (k, k). Their eigenvectors, columns, in plausible sizes."""
    determined: BoolArray
    """Shape (k,)."""
    scale: FloatArray
    """Shape (k,). Plausible sizes, SI units."""
    H_nn_inverse: FloatArray
    """Shape (b, b). Inverse information of base and targets for known error parameters."""
    follow: FloatArray
    """Shape (b, k). How base and targets follow the (unscaled) error parameters: ``dn = -follow @ de``."""
    sigma: float
    """Standard deviation of one coordinate residual, metres."""
    nuisance_null: FloatArray
    """Shape (b, k). Directions of base and targets that no pose of the arm can show, unit vectors; only arms whose axes
    are all parallel have any.
    """

    @property
    def rank(self) -> int:
        """Number of seen directions, base and targets included."""
        return len(self.H_nn_inverse) - self.nuisance_null.shape[1] + int(self.determined.sum())

    def weakest(self, rank: int) -> FloatArray:
        """The directions that are held if no more than ``rank`` (base and targets included) are seen, shape (k, h)."""
        count = len(self.determined) - int(self.determined.sum()) + max(self.rank - rank, 0)
        return self.directions[:, :count]

    def covariance(self) -> FloatArray:
        """Covariance of base (rotation vector, translation), targets and error parameters, SI units.

        Held directions add nothing: standard deviations are those of the parameters with the held
        combinations fixed. Shape (b + k, b + k).
        """
        V = self.directions[:, self.determined] * self.scale[:, None]
        C_rr = (V / self.eigenvalues[self.determined]) @ V.T
        C_nr = -self.follow @ C_rr
        C_nn = self.H_nn_inverse - C_nr @ self.follow.T
        return self.sigma**2 * np.block([[C_nn, C_nr], [C_nr.T, C_rr]])

    @property
    def singular_values(self) -> FloatArray:
        """Singular values of the scaled Jacobian of the error parameters, descending, metres.

        How far all points move together (root of the summed squares) for one plausible size along each
        direction, base and targets following.
        """
        return np.sqrt(np.maximum(self.eigenvalues[::-1], 0.0))

    def indices(self, poses: int) -> dict[str, float]:
        """Observability indices O1 to O5 and the condition number, over the seen directions.

        O1 = (s_1 ... s_r)^(1/r) / sqrt(poses) (Borm and Menq 1989), O2 = s_r / s_1 (Driels and Pathre 1990),
        O3 = s_r (Nahvi, Hollerbach and Hayward 1994), O4 = s_r^2 / s_1 (Nahvi and Hollerbach 1996),
        O5 = 1 / (1/s_1 + ... + 1/s_r) (Sun and Hollerbach 2008); s in metres for a plausible size.

        Returns
        -------
        dict of str to float
            ``O1`` ... ``O5``, ``condition``; empty where no error parameter is seen.
        """
        s = np.sqrt(self.eigenvalues[self.determined])[::-1]
        if not len(s):
            return {}
        return {
            "O1": float(np.exp(np.mean(np.log(s))) / np.sqrt(poses)),
            "O2": float(s[-1] / s[0]),
            "O3": float(s[-1]),
            "O4": float(s[-1] ** 2 / s[0]),
            "O5": float(1.0 / np.sum(1.0 / s)),
            "condition": float(s[0] / s[-1]),
        }

    def correlations(self, above: float = 0.9) -> list[tuple[int, int, float]]:
        """Pairs of error parameters that the data can hardly tell apart.

        Returns
        -------
        list of tuple
            (index, index, correlation coefficient), strongest first; held parameters are left out.
        """
        b = len(self.H_nn_inverse)
        C = self.covariance()[b:, b:]
        free = np.flatnonzero(self.held_fraction() < TIED)
        std = np.sqrt(np.diag(C))
        pairs = [
            (int(i), int(j), float(C[i, j] / (std[i] * std[j]))) for k, i in enumerate(free) for j in free[k + 1 :]
        ]
        return sorted((pair for pair in pairs if abs(pair[2]) > above), key=lambda pair: -abs(pair[2]))

    def basis(self) -> FloatArray:
        """Directions in which the data speak: base and targets, then the seen combinations of error parameters.

        Returns
        -------
        ndarray, shape (b + k, rank)
            Columns are steps in SI units (`Problem.moved`), a plausible size long each.
        """
        b, k = self.follow.shape
        identified = self.directions[:, self.determined] * self.scale[:, None]
        return np.block([[np.eye(b), np.zeros((b, identified.shape[1]))], [np.zeros((k, b)), identified]])

    def held_fraction(self) -> FloatArray:
        """Share of each error parameter that lies in held directions, 0 (identified) to 1 (held), shape (k,)."""
        directions_held = self.directions[:, ~self.determined]
        return np.clip(np.sum(directions_held**2, axis=1), 0.0, 1.0)

    def held_directions(self) -> list[tuple[int, FloatArray, FloatArray]]:
        """A readable basis of the held directions.

        Each basis vector has its own leading error parameter that no other vector contains.

        Returns
        -------
        list of tuple
            ``(leading, errors, base_and_targets)``: index of the leading error parameter; the direction in
            plausible sizes of the error parameters, shape (k,), one at the leading one; and how base and
            targets move along, SI units, shape (b,).
        """
        fixed = self.directions[:, ~self.determined]
        if not fixed.shape[1]:
            return []
        leading = _leading(fixed)
        basis = fixed @ np.linalg.inv(fixed[leading])
        return [(int(j), v, -self.follow @ (self.scale * v)) for j, v in zip(leading, basis.T, strict=True)]


def _leading(directions: FloatArray) -> list[int]:
    """Rows of directions (k, h) that are most independent: the pivots of a QR decomposition of their transpose."""
    remaining = directions.copy()
    chosen: list[int] = []
    for _ in range(directions.shape[1]):
        chosen.append(int(np.argmax(np.sum(remaining**2, axis=1))))
        axis = remaining[chosen[-1]] / np.linalg.norm(remaining[chosen[-1]])
        remaining -= np.outer(remaining @ axis, axis)
        remaining[chosen] = 0.0
    return chosen


def information_of(
    problem: VectorProblem[Any], H: FloatArray, rss: float, fixed: FloatArray | None = None
) -> Information:
    """Information about the error parameters from the normal matrix.

    Parameters
    ----------
    problem : VectorProblem
    H : ndarray, shape (unknowns, unknowns)
    rss : float
        Sum of squared residuals, m^2.
    fixed : ndarray, shape (k, h), optional
        Orthonormal directions in plausible sizes that are held whatever the data say; unless given, the residuals
        decide.

    Raises
    ------
    IdentificationError
        If the poses do not determine base and targets although those of another choice would, or if there are no
        equations to spare.
    """
    b = problem.nuisance
    values, vectors = np.linalg.eigh(H[:b, :b])
    null = values < 1e-9 * values[-1]
    if null.any() and problem.refusal:
        raise IdentificationError(problem.refusal)
    # a direction that nothing depends on gets no step: base and tool stay as they started along it
    H_nn_inverse = (vectors[:, ~null] / values[~null]) @ vectors[:, ~null].T
    follow = H_nn_inverse @ H[:b, b:]
    scale = problem.scales
    S = (H[b:, b:] - H[b:, :b] @ follow) * scale[:, None] * scale
    eigenvalues, directions = _eigen(0.5 * (S + S.T), fixed)
    identified, sigma = _judged(problem, eigenvalues, b - int(null.sum()), rss, fixed)
    return Information(eigenvalues, directions, identified, scale, H_nn_inverse, follow, sigma, vectors[:, null])


def judged_again(
    problem: Problem, information: Information, rss: float, fixed: FloatArray | None = None
) -> Information:
    """The `information` of the same normal matrix with another sum of squares."""
    nuisance = len(information.H_nn_inverse) - information.nuisance_null.shape[1]
    identified, sigma = _judged(problem, information.eigenvalues, nuisance, rss, fixed)
    return replace(information, determined=identified, sigma=sigma)


def _judged(
    problem: VectorProblem[Any], eigenvalues: FloatArray, nuisance: int, rss: float, fixed: FloatArray | None
) -> tuple[BoolArray, float]:
    """Which directions are seen, and the standard deviation of a coordinate, with so many nuisance unknowns seen."""
    equations = problem.equations
    solid = eigenvalues > ROUNDING * max(eigenvalues.max(initial=0.0), 0.0)
    unknowns = nuisance + int(solid.sum())
    spare = equations - unknowns
    if spare < 1:
        raise IdentificationError(
            f"{problem.poses} poses give {equations} equations for "
            f"{unknowns} unknowns: measure at least {-(-(1 - spare) // 3)} more points or choose a "
            "smaller model"
        )
    sigma = float(np.sqrt(rss / spare))
    identified = solid & (
        (eigenvalues > sigma**2) if fixed is None else (np.arange(len(eigenvalues)) >= fixed.shape[1])
    )
    return identified, sigma


def _eigen(S: FloatArray, fixed: FloatArray | None) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues, ascending, and eigenvectors of a symmetric matrix; with held directions, theirs come first."""
    if not len(S):
        return np.zeros(0), np.zeros((0, 0))
    if fixed is None:
        values, vectors = np.linalg.eigh(S)
        return values, vectors
    complete, _ = np.linalg.qr(fixed, mode="complete")
    blocks = []
    for V in (fixed, complete[:, fixed.shape[1] :]):
        values, turned = np.linalg.eigh(V.T @ S @ V)
        blocks.append((values, V @ turned))
    return np.concatenate([values for values, _ in blocks]), np.hstack([vectors for _, vectors in blocks])


def distances(problem: VectorProblem[S], state: S) -> FloatArray:
    """Distances of all rows (Nubiola 2011, eq. 3.36), shape (rows,), metres."""
    r = problem.residuals(state)
    return np.sqrt(np.einsum("jk,jk->j", r, r))


def largest(distance: FloatArray) -> float:
    """Largest distance (Nubiola 2011, eq. 3.35), metres."""
    return float(distance.max())


class History(Result):
    """Recorder of iterations (Nubiola 2011, section 7.5).

    Parameters
    ----------
    problem : Problem
        The one that is being fitted.
    watched : dict of str to Problem, optional
        Unused points under names of the caller's choice. They need the same targets in the same order and the same
        error parameters, so that a state of ``problem`` is a state of theirs.
    objective : callable
        From distances (rows,) to metres: `largest`, `rms` or another.
    every : int
        Record only iterations that are multiples of this number.

    Attributes
    ----------
    rows : list of dict
        ``iteration``, ``seconds`` (since the first record, without the time that recording took),
        ``objective_mm``, and for each of the others ``<name>_mean_mm`` and ``<name>_max_mm``.

    Raises
    ------
    IdentificationError
        If other points do not belong to the same unknowns.
    """

    def __init__(
        self,
        problem: Problem,
        watched: Mapping[str, Problem] | None = None,
        objective: Callable[[FloatArray], float] = largest,
        every: int = 1,
    ) -> None:
        self.problem, self.watched = problem, dict(watched or {})
        self.objective, self.every = objective, every
        self.rows: list[dict[str, float]] = []
        self._begin: float | None = None
        self._lost = 0.0
        for name, problem_watched in self.watched.items():
            if (
                problem_watched.points.target_names != problem.points.target_names
                or problem_watched.parameters != problem.parameters
            ):
                raise IdentificationError(
                    f"the points {name!r} cannot be followed: they need the targets and error parameters of the fit "
                    f"({', '.join(problem.points.target_names)}; {len(problem.parameters)} error parameters)"
                )

    def record(self, iteration: int, state: State) -> None:
        """Add one iteration; hand this method to a fit."""
        if iteration % self.every:
            return
        now = time.perf_counter()
        if self._begin is None:
            self._begin = now
        row = {
            "iteration": iteration,
            "seconds": now - self._begin - self._lost,
            "objective_mm": self.objective(distances(self.problem, state)) / MM,
        }
        for name, problem_watched in self.watched.items():
            d = distances(problem_watched, state) / MM
            row |= {f"{name}_mean_mm": float(d.mean()), f"{name}_max_mm": float(d.max())}
        self.rows.append(row)
        self._lost += time.perf_counter() - now

    def report(self) -> Sequence[Paragraph]:
        """From where to where the objective went, and what became of the other points."""
        if not self.rows:
            return ("no iteration was recorded",)
        first, last = self.rows[0], self.rows[-1]
        names = [name for name in last if name not in ("iteration", "seconds")]
        headline = (
            f"{last['iteration']} iterations in {last['seconds']:.2f} s: objective {first['objective_mm']:.3f} -> "
            f"{last['objective_mm']:.3f} mm"
        )
        rows = tuple((name, first[name], last[name], min(row[name] for row in self.rows)) for name in names)
        return headline, Table("From the first to the last iteration", ("", "first", "last", "smallest"), rows)

    COLUMNS = "*columns"

    def columns(self) -> dict[str, list[float]]:
        """The same by columns."""
        columns = ["iteration", "seconds", "objective_mm"]
        columns += [f"{name}_{statistic}_mm" for name in self.watched for statistic in ("mean", "max")]
        return {name: [row[name] for row in self.rows] for name in columns}

    def plot(self) -> Chart:
        """Objective and unused points against iterations (Nubiola 2011, Figure 7.2).

        Raises
        ------
        IdentificationError
            If nothing was recorded.
        """
        from irbcal.plotting.pose_errors import course

        if not self.rows:
            raise IdentificationError("there is no history to draw: no iteration was recorded")
        return course(self.columns())


STEP_TOLERANCE = 1e-7
"""Largest step (metres, radians) after which the iteration has converged: convergence is at least a factor of
1,000 a step near the minimum, so that what is left after a step of this size is below a nanometre."""

CHORD = 1e-5
"""Step (metres, radians) after which derivatives are taken once as they were before it. They have changed by as large a
share, and that share of what noise lets a parameter vary is missed: less than 1e-4 of its standard deviation."""

MAX_ITERATIONS = 60
"""Iterations, counted again when directions are frozen."""

PATIENCE = 5
"""Iterations without progress after which the held directions are frozen."""

PROGRESS = 1e-3
"""Relative fall of the sum of squares that counts as progress."""

DECREASE_TOLERANCE = 1e-8
"""Expected fall of the sum of squares, in variances of one coordinate, below which a fit with frozen directions has
converged, too: no combination of parameters is farther from the minimum than 1e-4 of its standard deviation."""

SUPPORT = 1e-3
"""Share of all multipliers above which a row counts as carrying weight."""

T = TypeVar("T")

RecordStep: TypeAlias = Callable[[int, S], None]
"""Called with iteration and state."""


@dataclass(frozen=True, eq=False)
class Solution(Locked, Generic[S]):
    """Outcome of a fit, by whatever solver."""

    state: S
    information: Information
    """What least squares says that the data show; other solvers move the state along these directions."""
    rss: float
    """Weighted sum of squared residuals at ``state``, m^2."""
    value: float
    """Objective at ``state``, metres: (weighted) root mean square, largest distance, p-norm, root of the mean loss."""
    iterations: int
    history: tuple[float, ...] = ()
    """Objective at the start and after each iteration, metres (Nelder-Mead: every ten iterations)."""
    weights: FloatArray | None = None
    """Shape (rows,). What each row's squared distance counts in the last step of a reweighted fit, at most 1."""
    scale: float | None = None
    """``c`` of a robust loss, metres."""
    lower_bound: float | None = None
    """No small move along the seen directions brings the largest distance below this, metres."""
    multipliers: FloatArray | None = None
    """Shape (rows, 3). The vectors ``w_j`` that prove the bound, see `irbcal.identification.minimax`."""
    evaluations: int | None = None
    """Of the objective, without derivatives."""

    @property
    def gap(self) -> float:
        """Share of the largest distance that is not proved to be needed; 0 where it is 0, 1 without a bound."""
        return max(self.value - (self.lower_bound or 0.0), 0.0) / self.value if self.value else 0.0

    @property
    def support(self) -> IntArray:
        """Rows that carry weight in the bound, in rising order."""
        size = np.zeros(0) if self.multipliers is None else np.linalg.norm(self.multipliers, axis=1)
        return np.flatnonzero(size > SUPPORT)


def note(history: list[float], value: float, state: S, record: RecordStep[S] | None) -> None:
    """Add a state's objective to the history, and hand the state to whoever records."""
    history.append(value)
    if record:
        record(len(history) - 1, state)


def line_search(trial: Callable[[float], T], accepted: Callable[[T, float], bool], smallest: float) -> T | None:
    """What the first of the shares 1, 1/2, 1/4 … of a step gives that is accepted; None where none is.

    Parameters
    ----------
    trial : callable
        From a share of the step to what it gives.
    accepted : callable
        Whether what a share gives is good enough; from that and the share.
    smallest : float
        Share at which the search ends.
    """
    share = 1.0
    while share > smallest:
        result = trial(share)
        if accepted(result, share):
            return result
        share *= 0.5
    return None


def solve(problem: Problem, state: State, record: RecordStep[State] | None = None) -> Solution[State]:
    """Minimise the sum of squared distances from a start.

    Parameters
    ----------
    problem : Problem
    state : State
        Start; its errors are normally zero.
    record : callable, optional
        Called with (iteration, state) for the start and after each step, see `irbcal.identification.least_squares`.

    Raises
    ------
    IdentificationError
        If base and tool are not determined, equations are too few or the iteration does not converge.
    """
    m = float((problem.weights[: len(problem.points)] ** 2).sum())
    slopes: list[FloatArray] = []
    H, g, rss = problem.normal_equations(state, slopes=slopes)
    sums: list[float] = []
    note(sums, rss, state, record)
    ranks: list[int] = []
    fixed: FloatArray | None = None
    looked: tuple[FloatArray, FloatArray | None, Information] | None = None
    last = MAX_ITERATIONS
    iteration = 0
    while iteration < last:
        iteration += 1
        if fixed is None and _stands_still(sums):
            fixed = information_of(problem, H, rss).weakest(min(ranks[-PATIENCE:]))
            last = iteration + MAX_ITERATIONS
            state = _put_back(problem, information_of(problem, H, rss, fixed), state)
            H, g, rss = problem.normal_equations(state, slopes=(slopes := []))
        if looked and looked[0] is H and looked[1] is fixed:
            information = judged_again(problem, looked[2], rss, fixed)
        else:
            information = information_of(problem, H, rss, fixed)
        looked = H, fixed, information
        ranks.append(information.rank)
        step = _step(information, g, state)
        size = np.abs(step).max()
        if size < STEP_TOLERANCE or (fixed is not None and g @ step < DECREASE_TOLERANCE * information.sigma**2):
            # the sum is a parabola over so short a step
            rss_expected = max(rss - float(step @ (2.0 * g - H @ step)), 0.0)
            course = tuple(np.sqrt(np.array(sums) / m))
            return Solution(
                problem.moved(state, step),
                information,
                rss_expected,
                float(np.sqrt(rss_expected / m)),
                iteration,
                course,
            )

        chord, start = slopes if size < CHORD else [], (state, step, H)
        better = line_search(partial(_moved, problem, start, chord), partial(_lower, rss, size), 0.0)
        assert better is not None
        state, H, g, rss, slopes = better
        note(sums, rss, state, record)
    raise IdentificationError(
        f"the fit did not converge in {iteration} iterations (last step {size:.2g}, rms "
        f"{1e3 * np.sqrt(rss / m):.3g} mm): check units, joint order and the robot file, and that neither base "
        "nor tool moved between the poses"
    )


_Place: TypeAlias = "tuple[State, FloatArray, FloatArray, float, list[FloatArray]]"
"""A state with its normal equations H, g and sum of squares, and the derivatives of each block of poses."""


def _moved(
    problem: Problem, start: tuple[State, FloatArray, FloatArray], chord: list[FloatArray], share: float
) -> _Place:
    """Where a share of a step leads; a whole short one (``chord``) with the derivatives before it."""
    state, step, H = start
    moved = problem.moved(state, share * step)
    if chord and share == 1.0:
        return moved, H, *problem.gradient_near(moved, chord), []
    slopes: list[FloatArray] = []
    return moved, *problem.normal_equations(moved, slopes=slopes), slopes


def _lower(rss: float, size: float, reached: _Place, share: float) -> bool:
    """Whether a step is good enough: lower, or lost in rounding, or one that only puts held directions back."""
    return reached[3] <= rss * (1 + 1e-6) or size * share < 1e-7 or share < 2e-6


def _stands_still(sums: list[float]) -> bool:
    """Whether the sum of squares has made no progress of late, although the fit has not converged."""
    return len(sums) > 2 * PATIENCE and min(sums[-PATIENCE:]) > (1 - PROGRESS) * min(sums[:-PATIENCE])


def _put_back(problem: Problem, information: Information, state: State) -> State:
    """The state with held directions at nominal; base and targets follow."""
    return problem.moved(state, _step(information, np.zeros(problem.unknowns), state))


def _step(information: Information, g: FloatArray, state: State) -> FloatArray:
    """Gauss-Newton step of base, targets and error parameters; held directions go back to nominal."""
    b = len(information.H_nn_inverse)
    nuisance = information.H_nn_inverse @ g[:b]
    gradient = information.scale * (g[b:] - information.follow.T @ g[:b])
    V, fixed = information.directions[:, information.determined], information.directions[:, ~information.determined]
    errors = V @ ((V.T @ gradient) / information.eigenvalues[information.determined]) - fixed @ (
        fixed.T @ (state.errors / information.scale)
    )
    errors = information.scale * errors
    return np.concatenate([nuisance - information.follow @ errors, errors])
