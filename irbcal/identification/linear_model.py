"""All terms linearised once about the geometry solution; sums for any choice of them.

Residuals and derivatives are in millimetres: the log evidence depends on that unit. Columns are ordered: base and
targets (*flat*, without prior: turns count in units of ten radians, shifts in millimetres), then the terms, each for
one natural size of its coefficient. The target of the linear model is the residual of the nominal constants, so that
the coefficients of the geometry are counted from the nominal arm, as its prior is.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np

from irbcal import parallel
from irbcal.arrays import FloatArray, IntArray, NameArray
from irbcal.errors import IdentificationError
from irbcal.identification.evidence_maximisation import (
    GEOMETRY_CAP,
    NOISE,
    NormalEquations,
    Posterior,
    fit_temper,
    maximise_evidence,
)
from irbcal.identification.initial_guess import MIN_POSES, first_state
from irbcal.identification.problem import Problem, State
from irbcal.measurement.places import places
from irbcal.measurement.points import PointSet
from irbcal.modeling.arm import Arm
from irbcal.modeling.parameters import parameter
from irbcal.modeling.terms import chain
from irbcal.modeling.terms.geometry import DHM_COLUMNS
from irbcal.modeling.terms.situation import Motion, Situation
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.term_map import TermMap, basis_values, term_columns
from irbcal.units import MM

T = TypeVar("T")

BLOCK = 500
"""Poses whose Jacobian is in memory at a time, in each thread."""
NUMBER_S = 3e-8
"""Seconds that one number of the Jacobian takes."""
TURN_UNIT = 10.0
"""Radians: the unit of the base's and target frames' turns, and with it the density of their flat prior. It shifts all
log evidences of a data set alike; this one gives those of the calculation that the method was developed with."""
STEPS = 4
"""Gauss-Newton steps of the geometry."""


@dataclass(frozen=True, eq=False)
class Rows:
    """The linear model of a block of poses.

    Attributes
    ----------
    J : ndarray, shape (columns, rows)
        Millimetres per unit of each column.
    y : ndarray, shape (rows,)
        Millimetres.
    pose : ndarray of int, shape (rows,)
        Pose of each row, ascending; the coordinates of a point stand side by side.
    row : ndarray of int, shape (rows,)
        Which measurement each is of; -1 for what is known besides measurements.
    """

    J: FloatArray
    y: FloatArray
    pose: IntArray
    row: IntArray


class LinearModel(ABC):
    """Measurements linearised at one state: what evidence and leave-one-out errors need of them, whatever their kind.

    Attributes
    ----------
    flat : int
        Unknowns without prior; their columns stand first.
    terms : list of Term
    sizes : ndarray, shape (flat + terms,)
        SI value of one unit of each column.
    per_pose : float
        Measured vectors in a pose, on average.
    noise : float
        Standard deviation of a coordinate that is plausible before anything is measured, mm.
    target_names : tuple of str
    target : ndarray of int, shape (measurements,)
        Number of the target of each measurement; -1 of those that are no places.
    session : ndarray of str, shape (poses,), or None
    projected : bool
        Whether one free number a pose was projected out.
    restarts : bool
        Whether fits at an improved model start from those before it.
    sequence : bool
        Whether poses are a sequence, of which contiguous parts are left out, too.
    """

    flat: int
    terms: list[Term]
    sizes: FloatArray
    per_pose: float
    noise: float = NOISE
    target_names: tuple[str, ...]
    target: IntArray
    session: NameArray | None = None
    projected: bool = False
    restarts: bool = False
    sequence: bool = True

    @abstractmethod
    def blocks(self, columns: IntArray | None = None) -> Iterator[Rows]:
        """The linear model, a block of whole poses at a time.

        Parameters
        ----------
        columns : ndarray of int, optional
            Numbers of the columns wanted, flat ones first; all unless given.
        """

    @abstractmethod
    def improved(self, coefficients: FloatArray) -> LinearModel:
        """The model nearer to some coefficients (flat + terms,), in units of the columns."""

    @property
    @abstractmethod
    def place(self) -> IntArray:
        """Poses with one number are left out together, shape (poses,)."""

    def widening(self, fit: Posterior) -> float:
        """Factor on a fit's standard deviations."""
        return 1.0

    def sums(self, columns: IntArray | None = None) -> NormalEquations:
        """Sums over all poses of some columns, all unless given."""
        k = self.flat + len(self.terms) if columns is None else len(columns)
        H, g, yy, equations = np.zeros((k, k)), np.zeros(k), 0.0, 0
        for part in self._block_sums(columns):
            H += part.H
            g += part.g
            yy += part.yy
            equations += part.equations
        return NormalEquations(H, g, yy, equations)

    def _block_sums(self, columns: IntArray | None) -> Iterator[NormalEquations]:
        return (self._sums(block) for block in self.blocks(columns))

    def _sums(self, block: Rows) -> NormalEquations:
        """Of a block of poses."""
        free = len(np.unique(block.pose)) if self.projected else 0
        return NormalEquations(block.J @ block.J.T, block.J @ block.y, float(block.y @ block.y), len(block.y) - free)


class Linearisation(LinearModel):
    """Measured points linearised at one state.

    Parameters
    ----------
    problem : Problem
        With the constants of the geometry as its error parameters, in the order of the geometry's terms.
    state : State
        Where derivatives are taken.
    motion : Motion
        Of the problem's poses.
    terms : sequence of Term
        Geometry first.
    project : bool
        Project the last move out of each pose: one free number a pose, see `irbcal.identification.evidence_fit.Lag`.
    """

    def __init__(
        self, problem: Problem, state: State, motion: Motion, terms: Sequence[Term], project: bool = False
    ) -> None:
        self.problem, self.state, self.motion = problem, state, motion
        self.terms = list(terms)
        self.projected = project
        self.flat = problem.outer
        self.sizes = np.concatenate([flat_units(problem), np.array([t.size for t in self.terms])])
        self.per_pose = float(problem.rows / motion.q.shape[0])
        self.target_names, self.session = problem.points.target_names, problem.points.session
        self.target = np.concatenate([problem.points.target, np.full(problem.rows - len(problem.points), -1)])
        self.bend: FloatArray | None = None

    @property
    def place(self) -> IntArray:
        """Repeats of one place have one number."""
        return places(self.problem.points)

    def blocks(self, columns: IntArray | None = None) -> Iterator[Rows]:
        """The linear model, a block of poses at a time; see `LinearModel.blocks`."""
        return self._of_blocks(lambda block: block, columns)

    def _block_sums(self, columns: IntArray | None) -> Iterator[NormalEquations]:
        return self._of_blocks(self._sums, columns)

    def _of_blocks(self, taken: Callable[[Rows], T], columns: IntArray | None) -> Iterator[T]:
        """What is taken from each block, in their order; large problems in threads."""
        columns = np.arange(self.flat + len(self.terms)) if columns is None else columns
        arm, _ = self.problem.model(self.state)
        residuals = self.problem.residuals(self.state)
        if self.bend is not None:
            residuals = residuals + self.bend
        points: PointSet = self.problem.points
        starts = [*range(0, points.poses, BLOCK), points.poses]
        edges = np.searchsorted(points.pose, starts)
        oriented = points.oriented()
        number = np.cumsum(oriented) - 1 + len(points)  # row of a point's orientation in the problem

        def block(k: int) -> T:
            some = np.arange(edges[k], edges[k + 1])
            turned = some[oriented[some]]
            motion = self.motion.select(slice(starts[k], starts[k + 1]))
            rows = np.concatenate([some, number[turned]])
            J = self._columns(arm, points, some, turned, motion, starts[k], columns)
            pose = np.concatenate([points.pose[some], points.pose[turned]])
            return taken(self._finished(J, residuals[rows].T, rows, pose, columns, points.poses))

        return parallel.threads(block, range(len(starts) - 1), NUMBER_S * 3 * self.problem.rows * len(columns))

    def _columns(
        self,
        arm: Arm,
        points: PointSet,
        some: IntArray,
        turned: IntArray,
        motion: Motion,
        start: int,
        columns: IntArray,
    ) -> FloatArray:
        """Derivatives in SI units, shape (columns, 3, points + orientations); the last column is the last move."""
        path = chain.walk(arm, motion.q)
        pose, target = points.pose[some] - start, points.target[some]
        local = self.state.targets[target].T
        tip = path.tip[..., pose]
        p = tip[3] + np.einsum("acm,am->cm", tip[:3], local)
        flats = flat_columns(self.problem, tip, p, target, turned - some[0] if len(some) else turned)
        self.problem.share_out(flats, self.problem.session_of_points()[np.concatenate([some, turned])])
        numbers = columns[columns >= self.flat] - self.flat
        chosen = [self.terms[j] for j in numbers]
        values = basis_values(chosen, Situation(self.problem.arm, motion))
        geometry = np.array([t.family == "geometry" for t in chosen], dtype=bool)
        length = self.problem.orientation_length
        out = np.empty((len(columns) + 1, 3, len(some) + len(turned)))
        n_flat = len(columns) - len(numbers)
        out[:n_flat] = flats[columns[:n_flat]]
        turned_pose = points.pose[turned] - start
        for constant in (True, False):
            mine = np.flatnonzero(geometry == constant)
            terms = [chosen[j] for j in mine]
            places = n_flat + mine
            moved = chain.point_columns(path, p, pose, constant)
            out[places, :, : len(some)] = term_columns(terms, moved, values[mine], pose)
            spun = length * chain.turn_columns(path, turned_pose, constant)
            out[places, :, len(some) :] = term_columns(terms, spun, values[mine], turned_pose)
        out[-1] = self._last_move(motion, moved, spun, pose, turned_pose)
        return out

    def _last_move(
        self, motion: Motion, moved: FloatArray, spun: FloatArray, pose: IntArray, turned: IntArray
    ) -> FloatArray:
        """Derivative by a share of the last move of all joints, shape (3, points + orientations)."""
        out = np.zeros((3, len(pose) + len(turned)))
        for j, slides in enumerate(self.problem.arm.table.prismatic):
            own = 5 if slides else 2
            out[:, : len(pose)] += moved[j, own] * motion.moves[pose, j]
            out[:, len(pose) :] += spun[j, own] * motion.moves[turned, j]
        return out

    def _finished(
        self, J: FloatArray, residuals: FloatArray, rows: IntArray, pose: IntArray, columns: IntArray, poses: int
    ) -> Rows:
        """Units, weights, order by pose, and the last move projected out."""
        weights = self.problem.weights[rows]
        J *= weights / MM
        y = residuals * weights / MM
        J[:-1] *= self.sizes[columns][:, None, None]
        order = np.argsort(pose, kind="stable")
        J, y, pose, rows = J[:, :, order], y[:, order], np.repeat(pose[order], 3), np.repeat(rows[order], 3)
        flat = np.ascontiguousarray(J.transpose(0, 2, 1)).reshape(len(J), -1)
        y = y.T.ravel()
        # counted from the nominal constants: all geometry columns are in every choice
        constants = np.zeros(len(columns))
        for k, column in enumerate(columns - self.flat):
            if 0 <= column < len(self.problem.parameters):
                constants[k] = self.state.errors[column] / self.terms[column].size
        y = y + constants @ flat[:-1]
        move, flat = flat[-1], flat[:-1]
        if self.projected:
            first = np.flatnonzero(np.r_[True, pose[1:] != pose[:-1]])
            each = np.diff(np.r_[first, len(pose)])
            length = np.add.reduceat(move * move, first)
            share = np.where(length > 0.0, 1.0 / np.where(length > 0.0, length, 1.0), 0.0)
            flat = flat - np.repeat(np.add.reduceat(flat * move, first, axis=1) * share, each, axis=1) * move
            y = y - np.repeat(np.add.reduceat(y * move, first) * share, each) * move
        return Rows(flat, y, pose, rows)

    def improved(self, coefficients: FloatArray) -> Linearisation:
        """The linear model made exact at some coefficients: what it misses there is taken from the measurements.

        Derivatives stay as they are. On robots without other errors than the model's, what the linear model misses is
        some 0.003 mm. With the last move projected out the model itself is returned: readings are not known well
        enough for it to matter.

        Parameters
        ----------
        coefficients : ndarray, shape (flat + terms,)
            In units of the columns.
        """
        if self.projected:
            return self
        out, count = copy(self), len(self.problem.points)
        out.bend = np.zeros((self.problem.rows, 3))
        linear = np.empty((self.problem.rows, 3))
        for block in self.blocks():
            linear[block.row[::3]] = (block.y - coefficients @ block.J).reshape(-1, 3)
        linear = linear[:count] * MM / self.problem.weights[:count, None]
        out.bend[:count] = self._misses(coefficients) - linear
        return out

    def _misses(self, coefficients: FloatArray) -> FloatArray:
        """Measured minus predicted points in the base link with all terms, not linearised, shape (points, 3)."""
        state, points = self.moved(coefficients), self.problem.points
        arm, _ = self.problem.model(state)
        values = self.sizes[self.flat :] * coefficients[self.flat :]
        rows = [k for k, term in enumerate(self.terms) if term.family != "geometry"]
        terms = TermMap(self.problem.arm, tuple(self.terms[k] for k in rows), values[rows])
        out = np.empty((len(points), 3))
        edges = np.searchsorted(points.pose, starts := [*range(0, points.poses, BLOCK), points.poses])
        seen = self.problem.in_base_link(state)
        for k in range(len(starts) - 1):
            some = slice(edges[k], edges[k + 1])
            path = chain.walk(arm, *terms.split(self.motion.select(slice(starts[k], starts[k + 1]))))
            tip = path.tip[..., points.pose[some] - starts[k]]
            p = tip[3] + np.einsum("acm,am->cm", tip[:3], state.targets[points.target[some]].T)
            out[some] = seen[some] - p.T
        return out

    def moved(self, coefficients: FloatArray) -> State:
        """The state with base, targets and geometry as some coefficients say (columns: flat, geometry, …)."""
        step = self.sizes * np.pad(coefficients, (0, len(self.sizes) - len(coefficients)))
        step = step[: self.problem.unknowns].copy()
        step[self.flat :] -= self.state.errors
        return self.problem.moved(self.state, step)


def flat_units(problem: Problem) -> FloatArray:
    """SI value of one unit of each flat column, shape (flat,)."""
    base = np.r_[np.full(3, TURN_UNIT), np.full(3, MM)]
    shifts, turns = np.full(3 * len(problem.free), MM), np.full(3 * len(problem.framed), TURN_UNIT)
    return np.concatenate([base, shifts, turns, np.tile(base, len(problem.sessions) - 1)])


def flat_columns(problem: Problem, tip: FloatArray, p: FloatArray, target: IntArray, turned: IntArray) -> FloatArray:
    """Derivatives by base and targets, SI units, shape (flat, 3, points + orientations); all points on one base.

    Parameters
    ----------
    problem : Problem
    tip : ndarray, shape (4, 3, m)
        Tip axes and origin at each point.
    p : ndarray, shape (3, m)
        Points in the base link.
    target : ndarray of int, shape (m,)
    turned : ndarray of int
        Which of the points carry an orientation.
    """
    m, length = len(target), problem.orientation_length
    out = np.zeros((problem.outer, 3, m + len(turned)))
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        out[k, i, :m], out[k, j, :m] = -p[j], p[i]
        out[k, k, m:] = length
        out[3 + k, k, :m] = 1.0
    for slot, name in enumerate(problem.free):
        mine = np.flatnonzero(target == name)
        out[6 + 3 * slot : 9 + 3 * slot, :, mine] = tip[:3][..., mine]
    start = 6 + 3 * len(problem.free)
    for slot, name in enumerate(problem.framed):
        mine = np.flatnonzero(target[turned] == name)
        out[start + 3 * slot : start + 3 * slot + 3, :, m + mine] = length * tip[:3][..., turned[mine]]
    return out


def geometry_problem(
    arm: Arm, points: PointSet, geometry: Sequence[Term], known: Mapping[str, FloatArray] | None
) -> Problem:
    """The problem whose error parameters are the geometry's terms.

    Raises
    ------
    IdentificationError
        If there are too few poses.
    """
    if points.poses < MIN_POSES:
        raise IdentificationError(f"{points.poses} poses cannot determine a robot: at least {MIN_POSES} are needed")
    chosen = [parameter(f"delta_{DHM_COLUMNS[t.axis]}{t.joint + 1}") for t in geometry]
    return Problem(arm, points, chosen, known_targets=known)


def geometry_solution(problem: Problem, motion: Motion, geometry: Sequence[Term], project: bool = False) -> State:
    """Base, targets and constants by a few Gauss-Newton steps with their prior, its variance by evidence.

    Returns
    -------
    State
    """
    state = first_state(problem)
    group = np.zeros(len(geometry), dtype=int)
    caps = np.array([GEOMETRY_CAP])
    size = np.inf
    for _ in range(STEPS + 8):  # more only from a start far away
        linear = Linearisation(problem, state, motion, geometry, project)
        t = fit_temper(linear.per_pose)
        found = maximise_evidence(linear.sums(), linear.flat, group, caps, t)
        before, state = state, linear.moved(found.c)
        size = float(max(np.abs(state.targets - before.targets).max(), np.abs(state.errors - before.errors).max()))
        if size < 1e-7:
            break
    return state


def at_poses(problem: Problem, points: PointSet) -> Problem:
    """The same problem for other points (of the same targets)."""
    same = replace(points, target_names=problem.points.target_names)
    return Problem(problem.arm, same, problem.parameters, known_targets=problem.known, sessions=problem.sessions)
