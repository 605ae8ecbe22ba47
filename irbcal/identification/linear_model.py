"""All terms linearised once about the geometry solution; sums for any choice of them.

Residuals and derivatives are in millimetres: the log evidence depends on that unit. Columns are ordered: nuisance (base
and targets, without prior: turns count in units of ten radians, shifts in millimetres), then the terms, each for one
natural size of its coefficient. The target of the linear model is the residual of the nominal constants, so that the
coefficients of the geometry are counted from the nominal arm, as its prior is.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from irbcal import parallel
from irbcal.arrays import BoolArray, FloatArray, IntArray, NameArray
from irbcal.errors import IdentificationError
from irbcal.identification.evidence_maximisation import (
    GEOMETRY_CAP,
    NOISE,
    NormalEquations,
    Posterior,
    fit_likelihood_power,
    maximise_evidence,
)
from irbcal.identification.initial_guess import MIN_POSES, first_state
from irbcal.identification.problem import Problem, State
from irbcal.identification.term_sets import TermSet
from irbcal.measurement.points import PointSet
from irbcal.measurement.repeats import repeat_groups
from irbcal.modeling.arm import Arm
from irbcal.modeling.parameters import parameter
from irbcal.modeling.terms.geometry import DHM_COLUMNS
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term import Term, own_axis
from irbcal.units import MM

T = TypeVar("T")

NUMBER_S = 3e-8
"""Seconds that one number of the Jacobian takes."""
LARGEST_KEPT = 4_000_000
"""Numbers of a Jacobian up to which it is kept, 32 MB: that of some hundred poses."""
TURN_UNIT = 10.0
"""Radians: the unit of the base's and target frames' turns, and with it the density of their flat prior. It shifts all
log evidences of a data set alike; this one gives those of the calculation that the method was developed with."""
GEOMETRY_STEPS = 4
"""Gauss-Newton steps of the geometry."""


@dataclass(frozen=True, eq=False)
class Rows:
    """The linear model of a block of poses."""

    J: FloatArray
    """Shape (columns, rows). Millimetres per unit of each column."""
    y: FloatArray
    """Shape (rows,). Millimetres."""
    pose: IntArray
    """Shape (rows,). Pose of each row, ascending; the coordinates of a point stand side by side."""
    row: IntArray
    """Shape (rows,). Which measurement each is of; -1 for what is known besides measurements."""

    @staticmethod
    def joined(blocks: Sequence[Rows]) -> Rows:
        """All rows of some blocks."""
        columns = (np.concatenate([getattr(block, name) for block in blocks]) for name in ("y", "pose", "row"))
        return Rows(np.concatenate([block.J for block in blocks], axis=1), *columns)

    def sums(self, free: int = 0) -> NormalEquations:
        """Normal equations of the rows, of which so many numbers are free."""
        return NormalEquations(self.J @ self.J.T, self.J @ self.y, float(self.y @ self.y), len(self.y) - free)


class LinearModel(ABC):
    """Measurements of any kind, linearised at one state: what evidence and leave-one-out errors need of them."""

    nuisance: int
    """Unknowns without prior; their columns stand first."""
    terms: list[Term]
    sizes: FloatArray
    """Shape (nuisance + terms,). SI value of one unit of each column."""
    per_pose: float
    """Measured vectors in a pose, on average."""
    noise: float = NOISE
    """Standard deviation of a coordinate that is plausible before anything is measured, mm."""
    target_names: tuple[str, ...]
    target: IntArray
    """Shape (measurements,). Number of the target of each measurement; -1 of those that are no places."""
    session: NameArray | None = None
    """Shape (poses,)."""
    projected: bool = False
    """Whether one free number a pose was projected out."""
    restarts: bool = False
    """Whether fits at an improved model start from those before it."""
    sequence: bool = True
    """Whether poses are a sequence, of which contiguous parts are left out, too."""

    @abstractmethod
    def blocks(self, columns: IntArray | None = None) -> Iterator[Rows]:
        """The linear model, a block of whole poses at a time.

        Parameters
        ----------
        columns : ndarray of int, optional
            Numbers of the columns wanted, nuisance ones first; all unless given.
        """

    @abstractmethod
    def improved(self, coefficients: FloatArray) -> LinearModel:
        """The model nearer to some coefficients (nuisance + terms,), in units of the columns."""

    @property
    @abstractmethod
    def repeat_group(self) -> IntArray:
        """Poses with one number are left out together, shape (poses,)."""

    def covariance(self, fit: Posterior, term_set: TermSet) -> FloatArray:
        """Of the coefficients of a term set for intervals, in units of its columns."""
        return fit.covariance

    def sums(self, columns: IntArray | None = None) -> NormalEquations:
        """Sums over all poses of some columns, all unless given."""
        count = self.nuisance + len(self.terms) if columns is None else len(columns)
        return NormalEquations.total(self._block_sums(columns), count)

    def sums_again(self, before: NormalEquations) -> NormalEquations:
        """Sums over all poses; ``before``: those of the model that was improved to this one."""
        return self.sums()

    def _block_sums(self, columns: IntArray | None) -> Iterator[NormalEquations]:
        return (self._sums(block) for block in self.blocks(columns))

    def _sums(self, block: Rows) -> NormalEquations:
        """Of a block of poses."""
        return block.sums(len(np.unique(block.pose)) if self.projected else 0)


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

    Attributes
    ----------
    problem : Problem
        With all terms; where the last move is projected out, each joint's last move is a term behind them.
    """

    def __init__(
        self, problem: Problem, state: State, motion: Motion, terms: Sequence[Term], project: bool = False
    ) -> None:
        self.terms = list(terms)
        self.projected = project
        moves = _moves_of(problem) if project else []
        self.problem, self.motion = problem.with_terms([*terms, *moves], motion), motion
        errors = np.zeros(len(self.problem.terms))
        errors[: len(problem.parameters)] = state.errors[: len(problem.parameters)]
        self.state = replace(state, errors=errors)
        self.nuisance = problem.nuisance
        self.sizes = np.concatenate([np.where(problem.turns, TURN_UNIT, MM), np.array([t.size for t in self.terms])])
        self.per_pose = float(problem.rows / motion.q.shape[0])
        self.target_names, self.session = problem.points.target_names, problem.points.session
        self.target = np.concatenate([problem.points.target, np.full(problem.rows - len(problem.points), -1)])
        self.nonlinearity: FloatArray | None = None
        self.counts = np.ones(problem.rows, dtype=bool)
        self._kept = dict[int, Rows]()

    @cached_property
    def repeat_group(self) -> IntArray:
        """Repeats of one place have one number."""
        return repeat_groups(self.problem.points)

    def blocks(self, columns: IntArray | None = None) -> Iterator[Rows]:
        """The linear model, a block of poses at a time; see `LinearModel.blocks`."""
        return self._of_blocks(lambda block: block, columns)

    def _block_sums(self, columns: IntArray | None) -> Iterator[NormalEquations]:
        return self._of_blocks(self._sums, columns)

    def _of_blocks(self, take: Callable[[Rows], T], columns: IntArray | None) -> Iterator[T]:
        """What is taken from each block, in their order; large problems in threads."""
        every = np.arange(self.nuisance + len(self.terms))
        columns = every if columns is None else columns
        arm, whole = self.problem.arm_at(self.state), len(columns) == len(every)
        numbers = 3 * self.problem.rows * len(columns)

        def block(k: int) -> T:
            rows = self._kept.get(k)
            if rows is None:
                rows = self._rows(k, arm, columns)
                if whole and numbers <= LARGEST_KEPT:
                    self._kept[k] = rows
            elif not whole:
                rows = replace(rows, J=rows.J[columns])
            return take(rows)

        return parallel.threads(block, range(self.problem.block_count), NUMBER_S * numbers)

    def _rows(self, k: int, arm: Arm, columns: IntArray) -> Rows:
        """Block number ``k`` in the units of the columns: weighted, ordered by pose, the last move projected out."""
        points, flats = self.problem.points, columns[columns < self.nuisance]
        moves = np.arange(len(self.terms), len(self.problem.terms))
        chosen = np.concatenate([columns[len(flats) :] - self.nuisance, moves])
        r, J = self.problem.block(k, arm, self.state, chosen)
        rows = self.problem.rows_of(k)
        pose = np.concatenate([points.pose, points.pose[points.oriented()]])[rows]
        if self.nonlinearity is not None:
            r = r + self.nonlinearity[rows].T
        order = np.argsort(pose, kind="stable")
        order = order[self.counts[rows[order]]]
        pose, rows = pose[order], rows[order]
        if len(flats) < self.nuisance:
            J = J[np.concatenate([flats, self.nuisance + np.arange(len(chosen))])]
        weights = self.problem.weights[rows] / MM
        scale = np.outer(np.append(self.sizes[columns], np.ones(len(moves))), weights)
        scaled = np.empty((len(J), len(rows), 3))
        for axis in range(3):  # a copy of all at once takes twice as long
            np.multiply(J[:, axis].take(order, axis=1), scale, out=scaled[..., axis])
        stacked = scaled.reshape(len(J), -1)
        y, pose, rows = (r[:, order] * weights).T.ravel(), np.repeat(pose, 3), np.repeat(rows, 3)
        stacked, along = stacked[: len(columns)], stacked[len(columns) :]
        # counted from the nominal constants: all geometry columns are in every term set
        terms = columns[len(flats) :] - self.nuisance
        y = y + (self.state.errors[terms] / self.sizes[columns[len(flats) :]]) @ stacked[len(flats) :]
        if self.projected:
            move = along.sum(axis=0)
            first = np.flatnonzero(np.r_[True, pose[1:] != pose[:-1]])
            each = np.diff(np.r_[first, len(pose)])
            length = np.add.reduceat(move * move, first)
            share = np.where(length > 0.0, 1.0 / np.where(length > 0.0, length, 1.0), 0.0)
            stacked = stacked - np.repeat(np.add.reduceat(stacked * move, first, axis=1) * share, each, axis=1) * move
            y = y - np.repeat(np.add.reduceat(y * move, first) * share, each) * move
        return Rows(stacked, y, pose, rows)

    def improved(self, coefficients: FloatArray) -> Linearisation:
        """The linear model made exact at some coefficients: what it misses there is taken from the measurements.

        Derivatives stay as they are. On robots without other errors than the model's, what the linear model misses is
        some 0.003 mm. With the last move projected out the model itself is returned: readings are not known well
        enough for it to matter.

        Parameters
        ----------
        coefficients : ndarray, shape (nuisance + terms,)
            In units of the columns.
        """
        if self.projected:
            return self
        out, count = copy(self), len(self.problem.points)
        out.nonlinearity = np.zeros((self.problem.rows, 3))
        linear = np.empty((self.problem.rows, 3))
        for block in self.blocks():
            linear[block.row[::3]] = (block.y - coefficients @ block.J).reshape(-1, 3)
        linear = linear[:count] * MM / self.problem.weights[:count, None]
        out.nonlinearity[:count] = self.problem.residuals(self.moved(coefficients))[:count] - linear
        more = out.nonlinearity if self.nonlinearity is None else out.nonlinearity - self.nonlinearity
        more = more * self.problem.weights[:, None] / MM
        out._kept = {k: replace(rows, y=rows.y + more[rows.row[::3]].ravel()) for k, rows in self._kept.items()}
        return out

    def sums_again(self, before: NormalEquations) -> NormalEquations:
        """Derivatives are those of before; see `LinearModel.sums_again`."""
        g, yy = np.zeros(len(before.g)), 0.0
        for block in self.blocks():
            g, yy = g + block.J @ block.y, yy + float(block.y @ block.y)
        return replace(before, g=g, yy=yy)

    def of_terms(self, places: IntArray) -> Linearisation:
        """The same linear model of some of its terms, the geometry among them."""
        out = Linearisation(self.problem, self.state, self.motion, [self.terms[k] for k in places], self.projected)
        out.nonlinearity, out.counts = self.nonlinearity, self.counts
        columns = np.concatenate([np.arange(self.nuisance), self.nuisance + places])
        if out.problem.cut_like(self.problem):
            out._kept = {k: replace(rows, J=rows.J[columns]) for k, rows in self._kept.items()}
        return out

    def extended(self, terms: Sequence[Term]) -> Linearisation:
        """The same linear model with more terms at its end."""
        out = Linearisation(self.problem, self.state, self.motion, [*self.terms, *terms], self.projected)
        out.nonlinearity, out.counts = self.nonlinearity, self.counts
        return out

    def without(self, points: BoolArray) -> Linearisation:
        """The same linear model without the rows of some points, shape (points,)."""
        out = copy(self)
        out.counts = self.counts & ~np.concatenate([points, points[self.problem.points.oriented()]])
        out._kept = {}
        for k, rows in self._kept.items() if not self.projected else ():
            good = np.flatnonzero(out.counts[rows.row])
            out._kept[k] = Rows(rows.J.take(good, axis=1), rows.y[good], rows.pose[good], rows.row[good])
        return out

    def moved(self, coefficients: FloatArray) -> State:
        """The state as some coefficients say (columns: nuisance, terms; those that are left out are zero)."""
        step = np.zeros(self.problem.unknowns)
        step[: len(coefficients)] = self.sizes[: len(coefficients)] * coefficients
        step[self.nuisance :] -= self.state.errors
        return self.problem.moved(self.state, step)


def _moves_of(problem: Problem) -> list[Term]:
    """A term for the last move of each joint."""
    arm = problem.arm
    return [Term(j, own_axis(arm, j), "move", 1.0, "move", "move", "1") for j in range(len(arm.joint_names))]


def geometry_problem(
    arm: Arm, points: PointSet, geometry: Sequence[Term], targets: Mapping[str, ArrayLike] | None
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
    return Problem(arm, points, chosen, known_targets=targets)


def fit_geometry(linear: LinearModel, start: Posterior | None = None) -> Posterior:
    """Base, targets and constants of the geometry with their prior, its variance by evidence; from that of a start."""
    group, t = np.zeros(len(linear.terms), dtype=int), fit_likelihood_power(linear.per_pose)
    v, s2 = (None, None) if start is None else (start.variances, start.s2)
    caps = np.array([GEOMETRY_CAP])
    return maximise_evidence(linear.sums(), linear.nuisance, group, caps, t, v, s2, noise=linear.noise)


def geometry_solution(problem: Problem, motion: Motion, geometry: Sequence[Term], project: bool = False) -> State:
    """Base, targets and constants by a few Gauss-Newton steps with their prior, its variance by evidence."""
    state = first_state(problem)
    for _ in range(GEOMETRY_STEPS + 8):  # more only from a start far away
        linear = Linearisation(problem, state, motion, geometry, project)
        previous, state = state, linear.moved(fit_geometry(linear).c)
        state = replace(state, errors=state.errors[: len(geometry)])
        size = float(max(np.abs(state.targets - previous.targets).max(), np.abs(state.errors - previous.errors).max()))
        if size < 1e-7:
            break
    return state
