"""Rows at features by another objective than least squares: largest distance, p-norm, robust losses.

The solvers are those of a tracker's points (`irbcal.identification.minimax`, `irbcal.identification.robust`). They
start from the evidence fit and move along the directions that the rows show; all others stay where the evidence left
them.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from irbcal.arrays import FloatArray, IntArray
from irbcal.identification import robust
from irbcal.identification.choices import Goal
from irbcal.identification.feature_problem import NO_TERMS, FeatureProblem, FeatureState
from irbcal.identification.least_squares import Solution, information_of
from irbcal.identification.linear_model import Rows
from irbcal.identification.problem import VectorProblem
from irbcal.units import MM


class FeatureVectors(VectorProblem[FeatureState]):
    """Rows at features as vectors of up to three residuals.

    A row of one or two residuals has zeros beside them; one of six (a pose) is two vectors, an image is a vector each
    corner. Each vector is multiplied by the median uncertainty of all rows over its row's, so that rows of different
    devices can be compared. What is known beforehand (lengths, priors of features) are vectors, too. Steps are in the
    problem's own units.

    Parameters
    ----------
    problem : FeatureProblem
    state : FeatureState
        Any of its states.
    """

    refusal = "the rows leave base, tool or features open: measure at more places"

    def __init__(self, problem: FeatureProblem, state: FeatureState) -> None:
        self.problem, self.nuisance, self.poses = problem, problem.nuisance, problem.rows.poses
        self.scales: FloatArray = np.ones(len(problem.terms))
        blocks = list(problem.dense(state, NO_TERMS))
        self.equations = sum(len(block.y) for block in blocks)
        self.rows = sum(len(block.y) // _length(block) for block in blocks)
        self.weights: FloatArray = np.ones(self.rows)

    def moved(self, state: FeatureState, step: FloatArray) -> FeatureState:
        """The state after a step (nuisance and terms,) in the problem's units."""
        from_nominal = step.copy()
        from_nominal[self.nuisance :] += state.coefficients / self.problem.sizes[self.nuisance :]
        return self.problem.moved(state, from_nominal)

    def residuals(self, state: FeatureState) -> FloatArray:
        """Measured minus predicted, shape (rows, 3), metres."""
        return np.concatenate([_vectors(block, block.y[None])[0] for block in self.problem.dense(state, NO_TERMS)])

    def jacobian_blocks(self, state: FeatureState) -> Iterator[tuple[IntArray, FloatArray]]:
        """Rows (r,) and their derivatives (r, 3, unknowns), metres a unit."""
        first = 0
        for block in self.problem.dense(state):
            J = _vectors(block, block.J).transpose(1, 2, 0)
            yield np.arange(first, first + len(J)), J
            first += len(J)

    def jacobian(self, state: FeatureState) -> FloatArray:
        """Derivatives of all vectors, shape (3 rows, unknowns): the blocks hold them in order."""
        return np.concatenate([J.reshape(-1, J.shape[2]) for _, J in self.jacobian_blocks(state)])


def _length(block: Rows) -> int:
    """Residuals of a vector: those of a row, of a place or a turn, or of a corner."""
    if block.row[0] < 0:
        return 1
    of_row = int(np.count_nonzero(block.row == block.row[0]))
    return 3 if of_row in (3, 6) else 2 if of_row % 2 == 0 else 1


def _vectors(block: Rows, scalars: FloatArray) -> FloatArray:
    """Scalars (k, n) of a block in millimetres as vectors, shape (k, n / length, 3), metres."""
    length = _length(block)
    out = np.zeros((len(scalars), scalars.shape[1] // length, 3))
    out[:, :, :length] = scalars.reshape(len(scalars), -1, length) * MM
    return out


def minimise(problem: FeatureProblem, state: FeatureState, goal: Goal) -> Solution[FeatureState]:
    """Another objective's minimum near a fit.

    Parameters
    ----------
    problem : FeatureProblem
    state : FeatureState
        Of the evidence fit.
    goal : Goal
        Not least squares.

    Raises
    ------
    IdentificationError
        If the solver does not converge.
    """
    vectors = FeatureVectors(problem, state)
    H, _, rss = vectors.normal_equations(state)
    start = Solution(state, information_of(vectors, H, rss), rss, float(np.sqrt(rss / vectors.rows)), 0)
    return robust.solve(vectors, start, goal)
