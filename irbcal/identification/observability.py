"""What the data can show: rank, held directions by name, standard deviations.

Base and targets have no nominal values, so they are eliminated first (Schur complement). What is left is
the information about the robot's own error parameters, scaled by their plausible sizes. A direction in
that space is *seen* if its standard deviation, given the residuals at hand, is smaller than the plausible
size; every other direction is *held*: the parameters keep the smallest change from nominal along it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, lock
from irbcal.errors import IdentificationError

if TYPE_CHECKING:
    from irbcal.identification.problem import Problem

ROUNDING = 1e-13
"""Information below this fraction of the largest is rounding, whatever the residuals."""

HELD, TIED = 0.99, 0.01
"""Share of a parameter in held directions above which it counts as held, and as tied."""


@dataclass(frozen=True, eq=False)
class Information:
    """Information about the error parameters after base and targets are eliminated.

    Attributes
    ----------
    eigenvalues : ndarray, shape (k,)
        Of the scaled information matrix, m^2 (change of the sum of squares for one plausible size), ascending; those of
        held directions come first.
    directions : ndarray, shape (k, k)
        Their eigenvectors, columns, in plausible sizes.
    seen : ndarray of bool, shape (k,)
    scale : ndarray, shape (k,)
        Plausible sizes, SI units.
    H_nn_inverse : ndarray, shape (b, b)
        Inverse information of base and targets for known error parameters.
    follow : ndarray, shape (b, k)
        How base and targets follow the (unscaled) error parameters: ``dn = -follow @ de``.
    sigma : float
        Standard deviation of one coordinate residual, metres.
    outer_null : ndarray, shape (b, k)
        Directions of base and targets that no pose of the arm can show, unit vectors; only arms whose axes are all
        parallel have any.
    """

    eigenvalues: FloatArray
    directions: FloatArray
    seen: BoolArray
    scale: FloatArray
    H_nn_inverse: FloatArray
    follow: FloatArray
    sigma: float
    outer_null: FloatArray

    def __post_init__(self) -> None:
        lock(self)

    @property
    def rank(self) -> int:
        """Number of seen directions, base and targets included."""
        return len(self.H_nn_inverse) - self.outer_null.shape[1] + int(self.seen.sum())

    def weakest(self, rank: int) -> FloatArray:
        """The directions that are held if no more than ``rank`` (base and targets included) are seen, shape (k, h)."""
        held = len(self.seen) - int(self.seen.sum()) + max(self.rank - rank, 0)
        return self.directions[:, :held]

    def covariance(self) -> FloatArray:
        """Covariance of base (rotation vector, translation), targets and error parameters, SI units.

        Held directions add nothing: standard deviations are those of the parameters with the held
        combinations fixed. Shape (b + k, b + k).
        """
        V = self.directions[:, self.seen] * self.scale[:, None]
        C_rr = (V / self.eigenvalues[self.seen]) @ V.T
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

        Parameters
        ----------
        poses : int

        Returns
        -------
        dict of str to float
            ``O1`` ... ``O5``, ``condition``; empty where no error parameter is seen.
        """
        s = np.sqrt(self.eigenvalues[self.seen])[::-1]
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
        seen = self.directions[:, self.seen] * self.scale[:, None]
        return np.block([[np.eye(b), np.zeros((b, seen.shape[1]))], [np.zeros((k, b)), seen]])

    def held_fraction(self) -> FloatArray:
        """Share of each error parameter that lies in held directions, 0 (identified) to 1 (held), shape (k,)."""
        held = self.directions[:, ~self.seen]
        return np.clip(np.sum(held**2, axis=1), 0.0, 1.0)

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
        held = self.directions[:, ~self.seen]
        if not held.shape[1]:
            return []
        leading = _leading(held)
        basis = held @ np.linalg.inv(held[leading])
        return [(int(j), v, -self.follow @ (self.scale * v)) for j, v in zip(leading, basis.T, strict=True)]


def _leading(directions: FloatArray) -> list[int]:
    """Rows of directions (k, h) that are most independent: the pivots of a QR decomposition of their transpose."""
    left = directions.copy()
    chosen: list[int] = []
    for _ in range(directions.shape[1]):
        chosen.append(int(np.argmax(np.sum(left**2, axis=1))))
        axis = left[chosen[-1]] / np.linalg.norm(left[chosen[-1]])
        left -= np.outer(left @ axis, axis)
        left[chosen] = 0.0
    return chosen


def information(problem: Problem, H: FloatArray, rss: float, held: FloatArray | None = None) -> Information:
    """Information about the error parameters from the normal matrix.

    Parameters
    ----------
    problem : Problem
    H : ndarray, shape (unknowns, unknowns)
    rss : float
        Sum of squared residuals, m^2.
    held : ndarray, shape (k, h), optional
        Orthonormal directions in plausible sizes that are held whatever the data say; unless given, the residuals
        decide.

    Returns
    -------
    Information

    Raises
    ------
    IdentificationError
        If the poses do not determine base and targets although those of another choice would, or if there are no
        equations to spare.
    """
    b = problem.outer
    values, vectors = np.linalg.eigh(H[:b, :b])
    null = values < 1e-9 * values[-1]
    if null.any() and not problem.arm.planar:
        raise IdentificationError(
            f"the {problem.points.poses} poses do not determine base and tool: they are too alike; "
            "measure poses that turn the tool about at least two directions"
        )
    # a direction that nothing depends on gets no step: base and tool stay as they started along it
    H_nn_inverse = (vectors[:, ~null] / values[~null]) @ vectors[:, ~null].T
    follow = H_nn_inverse @ H[:b, b:]
    scale = np.array([p.scale for p in problem.parameters])
    S = (H[b:, b:] - H[b:, :b] @ follow) * scale[:, None] * scale
    eigenvalues, directions = _eigen(0.5 * (S + S.T), held)
    seen, sigma = _judged(problem, eigenvalues, b - int(null.sum()), rss, held)
    return Information(eigenvalues, directions, seen, scale, H_nn_inverse, follow, sigma, vectors[:, null])


def judged_again(problem: Problem, found: Information, rss: float, held: FloatArray | None = None) -> Information:
    """The `information` of the same normal matrix with another sum of squares."""
    outer = len(found.H_nn_inverse) - found.outer_null.shape[1]
    seen, sigma = _judged(problem, found.eigenvalues, outer, rss, held)
    return replace(found, seen=seen, sigma=sigma)


def _judged(
    problem: Problem, eigenvalues: FloatArray, outer: int, rss: float, held: FloatArray | None
) -> tuple[BoolArray, float]:
    """Which directions are seen, and the standard deviation of a coordinate, with so many outer unknowns seen."""
    equations = 3 * problem.rows
    solid = eigenvalues > ROUNDING * max(eigenvalues.max(initial=0.0), 0.0)
    known = outer + int(solid.sum())
    spare = equations - known
    if spare < 1:
        raise IdentificationError(
            f"{len(problem.points)} points of {problem.points.poses} poses give {equations} equations for "
            f"{known} unknowns: measure at least {-(-(1 - spare) // 3)} more points or choose a "
            "smaller model"
        )
    sigma = float(np.sqrt(rss / spare))
    seen = solid & ((eigenvalues > sigma**2) if held is None else (np.arange(len(eigenvalues)) >= held.shape[1]))
    return seen, sigma


def _eigen(S: FloatArray, held: FloatArray | None) -> tuple[FloatArray, FloatArray]:
    """Eigenvalues, ascending, and eigenvectors of a symmetric matrix; with held directions, theirs come first."""
    if not len(S):
        return np.zeros(0), np.zeros((0, 0))
    if held is None:
        values, vectors = np.linalg.eigh(S)
        return values, vectors
    whole, _ = np.linalg.qr(held, mode="complete")
    parts = []
    for V in (held, whole[:, held.shape[1] :]):
        values, turned = np.linalg.eigh(V.T @ S @ V)
        parts.append((values, V @ turned))
    return np.concatenate([values for values, _ in parts]), np.hstack([vectors for _, vectors in parts])
