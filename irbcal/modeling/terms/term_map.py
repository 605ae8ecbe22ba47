"""A sum of terms with its coefficients: what it makes of commanded joints, and its derivatives."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from irbcal.arrays import FloatArray, IntArray, lock
from irbcal.errors import RobotError
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms import bases, chain
from irbcal.modeling.terms.situation import GRAVITY, Motion, Situation
from irbcal.modeling.terms.term import AXES, Term, own_axis

BLOCK = 1024
"""Poses whose terms are in memory at a time."""


def basis_values(terms: Sequence[Term], situation: Situation) -> FloatArray:
    """Function of each term at each pose, shape (terms, n)."""
    out = np.empty((len(terms), len(situation.motion)))
    for name, rows in _by_basis(terms):
        out[rows] = bases()[name].quick_values([terms[k] for k in rows], situation)
    return out


def basis_slopes(terms: Sequence[Term], situation: Situation) -> FloatArray:
    """Derivative of each term by the commanded joints, the stop before held, shape (terms, n, joints)."""
    out = np.empty((len(terms), *situation.motion.q.shape))
    for name, rows in _by_basis(terms):
        out[rows] = bases()[name].slopes([terms[k] for k in rows], situation)
    return out


def basis_slope_rates(terms: Sequence[Term], situation: Situation, dq: FloatArray) -> FloatArray:
    """Derivative of `basis_slopes` along joint speeds (n, joints), shape (terms, n, joints)."""
    out = np.empty((len(terms), *situation.motion.q.shape))
    for name, rows in _by_basis(terms):
        out[rows] = bases()[name].slope_rates([terms[k] for k in rows], situation, dq)
    return out


def _by_basis(terms: Sequence[Term]) -> Iterator[tuple[str, list[int]]]:
    rows: dict[str, list[int]] = {}
    for k, term in enumerate(terms):
        rows.setdefault(term.basis, []).append(k)
    unknown = sorted(set(rows) - set(bases()))
    if unknown:
        raise RobotError(f"unknown basis {unknown[0]!r} of a term: there are {', '.join(sorted(bases()))}")
    yield from rows.items()


@dataclass(frozen=True, eq=False)
class TermMap:
    """Terms with coefficients: from commanded to effective joints, and the small motions of the frames.

    Constants of the geometry do not belong here: they are in the arm's DHM table.
    """

    arm: Arm
    """Nominal arm: attitudes of links are taken from it."""
    terms: tuple[Term, ...]
    coefficients: FloatArray
    """Shape (terms,). In the terms' units."""
    std: FloatArray | None = None
    """Shape (terms,). Standard deviations."""
    gravity: tuple[float, ...] = GRAVITY
    """Three. Direction in the base link."""

    def __post_init__(self) -> None:
        if len(self.terms) != len(self.coefficients):
            raise RobotError(f"{len(self.terms)} terms need as many coefficients, found {len(self.coefficients)}")
        lock(self)

    def _own(self) -> list[bool]:
        """Which terms are about their joint's own axis: the joint map."""
        return [term.axis == own_axis(self.arm, term.joint) for term in self.terms]

    def select(self, frame_terms: bool) -> TermMap:
        """The frame terms alone, or the joint map alone."""
        rows = [k for k, is_own in enumerate(self._own()) if is_own is not frame_terms]
        std = None if self.std is None else self.std[rows]
        return TermMap(self.arm, tuple(self.terms[k] for k in rows), self.coefficients[rows], std, self.gravity)

    @property
    def has_frame_terms(self) -> bool:
        """Whether there are terms that a joint map cannot carry."""
        return not all(self._own())

    def motions(self, motion: Motion) -> FloatArray:
        """Motions of all joints' frames, the joint map's among them.

        Returns
        -------
        ndarray, shape (n, joints, 6)
            In the order of `AXES`, radians and metres.
        """
        out = np.zeros((*motion.q.shape, len(AXES)))
        order, starts, joints, axes = self._added
        for start in range(0, len(motion) if self.terms else 0, BLOCK):
            rows = slice(start, start + BLOCK)
            values = basis_values(self.terms, Situation(self.arm, motion.select(rows), self.gravity))
            values *= self.coefficients[:, None]
            out[rows, joints, axes] = np.add.reduceat(values[order], starts).T
        return out

    @cached_property
    def _added(self) -> tuple[IntArray, IntArray, IntArray, IntArray]:
        """Terms in the order of the motions that they are parts of, where each motion begins, its joint and axis."""
        acts = [(j, AXES.index(term.axis), k) for k, term in enumerate(self.terms) for j in (term.joint, *term.also)]
        joint, axis, order = np.array(sorted(acts), dtype=int).reshape(-1, 3).T
        _, starts = np.unique(joint * len(AXES) + axis, return_index=True)
        return order, starts, joint[starts], axis[starts]

    def split(self, motion: Motion) -> tuple[FloatArray, FloatArray]:
        """Effective joints and the frames' motions.

        Returns
        -------
        effective : ndarray, shape (n, joints)
            Radians (metres for prismatic joints).
        xi : ndarray, shape (n, joints, 6)
            Motions of the frames without the joint map's.
        """
        xi = self.motions(motion)
        effective = motion.q.copy()
        for j in range(effective.shape[1]):
            axis = AXES.index(own_axis(self.arm, j))
            effective[:, j] += xi[:, j, axis]
            xi[:, j, axis] = 0.0
        return effective, xi

    def effective(self, motion: Motion) -> FloatArray:
        """Effective joints, shape (n, joints), radians (metres for prismatic joints)."""
        return self.split(motion)[0]

    def jacobian(self, motion: Motion) -> FloatArray:
        """Derivative of the effective by the commanded joints, the stop before held, shape (n, joints, joints)."""
        return np.eye(motion.q.shape[1]) + self._sum(motion, None)

    def jacobian_derivative(self, motion: Motion, dq: FloatArray) -> FloatArray:
        """Time derivative of `jacobian` at joint speeds ``dq`` (n, joints), shape (n, joints, joints)."""
        return self._sum(motion, np.asarray(dq, dtype=float))

    def _sum(self, motion: Motion, dq: FloatArray | None) -> FloatArray:
        rows, joints = np.flatnonzero(self._own()), motion.q.shape[1]
        terms = [self.terms[k] for k in rows]
        out = np.zeros((len(motion), joints, joints))
        for start in range(0, len(motion), BLOCK):
            block = slice(start, start + BLOCK)
            situation = Situation(self.arm, motion.select(block), self.gravity)
            slopes = basis_slopes(terms, situation) if dq is None else basis_slope_rates(terms, situation, dq[block])
            slopes *= self.coefficients[rows][:, None, None]
            for term, slope in zip(terms, slopes, strict=True):
                for joint in (term.joint, *term.also):
                    out[block, joint] += slope
        return out

    def forward(self, calibrated: Arm, motion: Motion) -> FloatArray:
        """Tip poses of a calibrated arm with this map, shape (n, 4, 4), in the base link."""
        out = np.empty((len(motion), 4, 4))
        for start in range(0, len(motion), BLOCK):
            rows = slice(start, start + BLOCK)
            out[rows] = chain.poses(chain.walk(calibrated, *self.split(motion.select(rows))))
        return out

    def entries(self) -> list[dict[str, Any]]:
        """The terms as JSON objects, see `Term.to_json`."""
        std = np.full(len(self.terms), np.nan) if self.std is None else self.std
        return [t.to_json(c, s) for t, c, s in zip(self.terms, self.coefficients, std, strict=True)]

    @staticmethod
    def of_entries(arm: Arm, entries: Sequence[Mapping[str, Any]], gravity: Sequence[float] = GRAVITY) -> TermMap:
        """The map that `entries` wrote.

        Raises
        ------
        RobotError
            If a term is not understood.
        """
        terms, coefficients, std = zip(*map(Term.from_json, entries), strict=True) if entries else ((), (), ())
        return TermMap(arm, tuple(terms), np.array(coefficients), np.array(std), tuple(gravity))


def term_columns(
    terms: Sequence[Term], path: chain.Walk, values: FloatArray, p: FloatArray | None = None
) -> FloatArray:
    """Derivative of points of the tool, one a pose, by terms: the motions of the joints' frames times the functions.

    Parameters
    ----------
    terms : sequence of Term
        Constants of the geometry are errors of the DHM table.
    path : Walk
    values : ndarray, shape (terms, n)
        Of the terms' functions.
    p : ndarray, shape (3, n), optional
        Points in the base link, metres. Without: by the tip's rotation vector.

    Returns
    -------
    ndarray, shape (terms, 3, n)
        Metres, or radians, per unit of the coefficient.
    """
    pose = np.arange(values.shape[1])
    out = np.empty((len(terms), 3, len(pose)))
    for constant in (True, False):
        rows = [k for k, term in enumerate(terms) if (term.family == "geometry") is constant]
        if not rows:
            continue
        columns = (
            chain.turn_columns(path, pose, constant) if p is None else chain.point_columns(path, p, pose, constant)
        )
        axes = [AXES.index(terms[k].axis) for k in rows]
        out[rows] = columns[[terms[k].joint for k in rows], axes]
        for k, axis in zip(rows, axes, strict=True):
            for joint in terms[k].also:
                out[k] += columns[joint, axis]
    out *= values[:, None]
    return out
