"""A sum of terms with its coefficients: what it makes of commanded joints, and its derivatives."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any, TypeAlias

import numpy as np

from irbcal.arrays import FloatArray, IntArray, lock
from irbcal.errors import RobotError
from irbcal.modeling import dhm
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms import bases, chain
from irbcal.modeling.terms.geometry import DHM_COLUMNS
from irbcal.modeling.terms.situation import GRAVITY, Motion, Situation
from irbcal.modeling.terms.term import AXES, Term, own_axis

BLOCK = 1024
"""Poses whose terms are in memory at a time."""

MotionKey: TypeAlias = tuple[str, bool]
"""How a joint's frame moves: one of `AXES`, and whether before the joint turns, behind all constants of its row."""
Layout: TypeAlias = "tuple[Mapping[MotionKey, tuple[IntArray, IntArray]], list[tuple[int, MotionKey, list[int], int]]]"
"""Motion -> columns of constants, and their joints; of each other column its number, motion, joints and function."""


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


class TermModel:
    """Terms about an arm: constants of the geometry are errors of its DHM table, all others functions of a motion.

    Parameters
    ----------
    arm : Arm
        Nominal.
    terms : sequence of Term
    at_frames : bool
        Take derivatives by terms about the joints' own axes at their frames, too: the same where no frame moves.

    Attributes
    ----------
    moving : list of int
        Numbers of the terms that are no constants.
    frame_terms : list of int
        Numbers of those of them that are not about their joint's own axis: a joint map cannot carry them.
    """

    def __init__(self, arm: Arm, terms: Sequence[Term], at_frames: bool = False) -> None:
        self.arm, self.terms, self._at_frames = arm, tuple(terms), at_frames
        axes = [own_axis(arm, j) for j in range(len(arm.joint_names))]
        self.moving = [k for k, term in enumerate(terms) if term.family != "geometry"]
        self.frame_terms = [k for k in self.moving if terms[k].axis != axes[terms[k].joint]]
        self._row = {k: row for row, k in enumerate(self.moving)}
        self._mix = np.zeros((len(axes), len(self.moving)))
        for k, row in self._row.items():
            if terms[k].axis == axes[terms[k].joint]:
                self._mix[[terms[k].joint, *terms[k].also], row] = 1.0
        self._constants, self._others = self._layout(range(len(terms)))

    def _layout(self, chosen: Sequence[int] | IntArray) -> Layout:
        """How the columns of some terms are made."""
        constants: dict[MotionKey, tuple[list[int], list[int]]] = {}
        others, at_frames = [], set(self.moving if self._at_frames else self.frame_terms)
        for slot, k in enumerate(chosen):
            term = self.terms[k]
            if k in self._row:
                others.append((slot, (term.axis, k in at_frames), [term.joint, *term.also], self._row[k]))
            else:
                slots, joints = constants.setdefault((term.axis, False), ([], []))
                slots.append(slot)
                joints.append(term.joint)
        return {key: (np.array(slots), np.array(joints)) for key, (slots, joints) in constants.items()}, others

    def arm_at(self, coefficients: FloatArray) -> Arm:
        """The arm with the constants of the geometry in its table; coefficients of all terms, SI units."""
        columns: dict[str, FloatArray] = {}
        for (axis, _), (slots, joints) in self._constants.items():
            if coefficients[slots].any():
                column = getattr(self.arm.table, DHM_COLUMNS[axis]).copy()
                column[joints] += coefficients[slots]
                columns[DHM_COLUMNS[axis]] = column
        return self.arm.with_table(replace(self.arm.table, **columns)) if columns else self.arm  # type: ignore[arg-type]

    def values(self, motion: Motion, gravity: tuple[float, ...] = GRAVITY) -> FloatArray:
        """Functions of the `moving` terms, shape (moving, n)."""
        return basis_values([self.terms[k] for k in self.moving], Situation(self.arm, motion, gravity))

    def joints(
        self, q: FloatArray, coefficients: FloatArray, values: Callable[[], FloatArray]
    ) -> tuple[FloatArray, FloatArray | None]:
        """Effective joints and small motions of the frames.

        Parameters
        ----------
        q : ndarray, shape (n, joints)
            Commanded, radians (metres).
        coefficients : ndarray, shape (terms,)
        values : callable
            Gives `values` at these poses; asked only where a coefficient is not zero.

        Returns
        -------
        effective : ndarray, shape (joints, n)
        xi : ndarray, shape (n, joints, 6), or None
            Without the joint map's, in the order of `AXES`; None where no frame moves.
        """
        moving, xi = coefficients[self.moving], None
        if not moving.any():
            return q.T, None
        at_poses = values()
        if coefficients[self.frame_terms].any():
            xi = np.zeros((*q.shape, len(AXES)))
            for k in self.frame_terms:
                term, moved = self.terms[k], coefficients[k] * at_poses[self._row[k]]
                xi[:, [term.joint, *term.also], AXES.index(term.axis)] += moved[:, None]
        return q.T + (self._mix * moving) @ at_poses, xi

    def path(
        self, arm: Arm, effective: FloatArray, xi: FloatArray | None, chosen: Sequence[int] | IntArray | None = None
    ) -> dhm.ChainFrames | chain.Walk:
        """The chain of `arm_at` at `joints`, with what derivatives by the chosen terms (all unless given) need."""
        if xi is None and not set(self.frame_terms).intersection(self.moving if chosen is None else chosen):
            return dhm.chain_frames(arm.table, effective + arm.table.offsets[:, None], arm.T_base_0, arm.T_last_tip)
        return chain.walk(arm, effective.T, xi)

    def columns(
        self,
        path: dhm.ChainFrames | chain.Walk,
        values: Callable[[], FloatArray],
        p: FloatArray | None = None,
        chosen: Sequence[int] | IntArray | None = None,
        out: FloatArray | None = None,
    ) -> FloatArray:
        """Derivative of points of the tool by terms: the motions of the joints' frames times the functions.

        Parameters
        ----------
        path : ChainFrames or Walk
            At n poses.
        values : callable
            Gives `values` there; asked only where a chosen term is no constant.
        p : ndarray, shape (3, n) or (3, t, n), optional
            Points in the base link, metres. Without: by the tip's rotation vector.
        chosen : sequence of int, optional
            Numbers of the terms wanted; all unless given.
        out : ndarray, optional
            Zeros to be filled.

        Returns
        -------
        ndarray, shape (terms, 3, n) or (terms, 3, t, n)
            Metres, or radians, per unit of the coefficient.
        """
        constants, others = (self._constants, self._others) if chosen is None else self._layout(chosen)
        if out is None:
            shape = path.tip.shape[1:] if p is None else p.shape
            out = np.zeros((len(self.terms) if chosen is None else len(chosen), *shape))
        at_poses = values() if others else np.zeros((0, 0))
        by_frame = {
            key: chain.derivative(path, AXES.index(key[0]), p, not key[1])
            for key in {*constants, *(key for _, key, *_ in others)}
        }
        for key, (slots, joints) in constants.items():
            out[slots] = by_frame[key][joints]
        for slot, key, joints_of, row in others:
            column = by_frame[key]
            along = column[joints_of[0]] if len(joints_of) == 1 else column[joints_of].sum(axis=0)
            np.multiply(along, at_poses[row], out=out[slot])
        return out


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

    @cached_property
    def model(self) -> TermModel:
        """The same terms, whatever their coefficients."""
        return TermModel(self.arm, self.terms)

    def select(self, frame_terms: bool) -> TermMap:
        """The frame terms alone, or the joint map alone."""
        rows = [k for k in range(len(self.terms)) if (k in self.model.frame_terms) is frame_terms]
        std = None if self.std is None else self.std[rows]
        return TermMap(self.arm, tuple(self.terms[k] for k in rows), self.coefficients[rows], std, self.gravity)

    @property
    def has_frame_terms(self) -> bool:
        """Whether there are terms that a joint map cannot carry."""
        return bool(self.model.frame_terms)

    def split(self, motion: Motion) -> tuple[FloatArray, FloatArray | None]:
        """Effective joints and the frames' motions.

        Returns
        -------
        effective : ndarray, shape (n, joints)
            Radians (metres for prismatic joints).
        xi : ndarray, shape (n, joints, 6), or None
            Motions of the frames without the joint map's, in the order of `AXES`, radians and metres; None where no
            frame moves.
        """
        effective, xi = motion.q.copy(), None
        for start in range(0, len(motion) if self.coefficients.any() else 0, BLOCK):
            rows = slice(start, start + BLOCK)
            values = partial(self.model.values, motion.select(rows), self.gravity)
            theta, moved = self.model.joints(motion.q[rows], self.coefficients, values)
            effective[rows] = theta.T
            if moved is not None:
                xi = np.zeros((*motion.q.shape, len(AXES))) if xi is None else xi
                xi[rows] = moved
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
        rows, joints = np.setdiff1d(np.arange(len(self.terms)), self.model.frame_terms), motion.q.shape[1]
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
