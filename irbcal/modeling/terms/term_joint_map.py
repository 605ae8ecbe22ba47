"""A sum of terms as a robot's joint map: with the interface of the thesis's, `irbcal.modeling.joint_map.JointMap`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, lock
from irbcal.errors import RobotError
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.term_map import TermMap

ELSEWHERE = ("decay", "payload")
"""Bases that are zero for a warm arm without another payload."""
HISTORY = ("direction", "share_of_move", "move")
"""Bases that are zero where the last move is not known."""
STEPS = 60


@dataclass(frozen=True, eq=False)
class _Waves:
    """Series of cosines and sines of one joint's angle."""

    joint: int
    cycles: FloatArray
    cosine: FloatArray
    sine: FloatArray

    def sums(self, angle: FloatArray, order: int) -> FloatArray:
        """The series or its first or second derivative, shape (n,)."""
        phase = angle[:, None] * self.cycles
        c, s = np.cos(phase), np.sin(phase)
        if order == 0:
            return c @ self.cosine + s @ self.sine
        if order == 1:
            return c @ (self.cycles * self.sine) - s @ (self.cycles * self.cosine)
        squares = self.cycles**2
        return -(c @ (squares * self.cosine) + s @ (squares * self.sine))


@dataclass(frozen=True, eq=False, repr=False)
class TermJointMap:
    """Commanded to effective joints by a sum of terms about the joints' own axes.

    The arm is warm and carries what it carried when it was measured. Where the stop before is not given, terms of the
    last move are zero.

    Parameters
    ----------
    terms : TermMap
        Without frame terms.
    ranges : ndarray, shape (2, joints), optional
        Smallest and largest commanded joints that the terms were identified from, radians (metres): outside them high
        harmonics must not be trusted.

    Raises
    ------
    RobotError
        If there are terms that a joint map cannot carry.
    """

    terms: TermMap
    ranges: FloatArray | None = None

    def __post_init__(self) -> None:
        if self.terms.has_frame_terms:
            raise RobotError("a joint map cannot carry terms about or along other axes than the joints' own")
        lock(self)

    def __repr__(self) -> str:
        return f"<TermJointMap: {self.in_words}>"

    @property
    def is_identity(self) -> bool:
        """Whether effective and commanded joints are the same."""
        return not self.terms.coefficients.any()

    @cached_property
    def has_history(self) -> bool:
        """Whether effective joints depend on the stop before."""
        return bool(self._history.coefficients.any())

    @cached_property
    def history_std(self) -> FloatArray:
        """By how much each joint's stop is uncertain where the stop before is not known, shape (joints,), rad (m).

        The root of the sum of the squares of its terms' coefficients, each with a function of one.
        """
        squares = np.zeros(len(self.terms.arm.joint_names))
        for term, coefficient in zip(self._history.terms, self._history.coefficients, strict=True):
            squares[[term.joint, *term.also]] += coefficient**2
        return np.sqrt(squares)

    @property
    def in_words(self) -> str:
        """How many terms of which kinds."""
        if self.is_identity:
            return "no joint map (commanded joints are the effective ones)"
        kinds = dict.fromkeys(term.family.replace("_", " ") for term in self.terms.terms)
        return f"joint map with {len(self.terms.terms)} terms ({', '.join(kinds)})"

    # -------------------------------------------------------------- what the terms come to

    def _rows(self, *names: str, other: bool = False) -> list[int]:
        return [k for k, term in enumerate(self.terms.terms) if (term.basis in names) is not other]

    @cached_property
    def _gain(self) -> FloatArray:
        gain = np.zeros(len(self.terms.arm.joint_names))
        for k in self._rows("q"):
            term = self.terms.terms[k]
            gain[[term.joint, *term.also]] += self.terms.coefficients[k]
        return gain

    @cached_property
    def _waves(self) -> tuple[_Waves, ...]:
        found: dict[int, dict[float, list[float]]] = {}
        for k in self._rows("cos", "sin"):
            term = self.terms.terms[k]
            cycles = float(str(term.parameters["cycles_per_turn"]))
            pair = found.setdefault(term.joint, {}).setdefault(cycles, [0.0, 0.0])
            pair[term.basis == "sin"] += self.terms.coefficients[k]
        return tuple(
            _Waves(joint, np.array(list(series)), *np.array(list(series.values())).T) for joint, series in found.items()
        )

    @cached_property
    def _levers(self) -> TermMap:
        """Gravity, the vectors of one link and joint as one, and whatever is neither series, gain nor history."""
        sums: dict[tuple[int, tuple[int, ...], int], FloatArray] = {}
        for k in self._rows("gravity"):
            term = self.terms.terms[k]
            vector = term.parameters["vector"]
            value = np.eye(3)["xyz".index(vector)] if isinstance(vector, str) else np.asarray(vector, dtype=float)
            key = (term.joint, term.also, int(str(term.parameters["link"])))
            sums[key] = sums.get(key, np.zeros(3)) + self.terms.coefficients[k] * value
        terms = [
            Term(joint, "rz", "gravity", 1.0, "", "", "rad", {"link": link, "vector": tuple(map(float, v))}, also)
            for (joint, also, link), v in sums.items()
        ]
        rest = self._rows("q", "cos", "sin", "gravity", *ELSEWHERE, *HISTORY, other=True)
        return TermMap(
            self.terms.arm,
            (*terms, *(self.terms.terms[k] for k in rest)),
            np.concatenate([np.ones(len(terms)), self.terms.coefficients[rest]]),
            None,
            self.terms.gravity,
        )

    @cached_property
    def _history(self) -> TermMap:
        rows = self._rows(*HISTORY)
        chosen = tuple(self.terms.terms[k] for k in rows)
        return TermMap(self.terms.arm, chosen, self.terms.coefficients[rows], None, self.terms.gravity)

    def _parts(self, q: FloatArray, previous: ArrayLike | None) -> Sequence[tuple[TermMap, Motion]]:
        """Terms that are summed one by one, with the motion that they see."""
        parts = [(self._levers, Motion(q))] if self._levers.terms else []
        if previous is not None and self._history.terms:
            parts.append((self._history, Motion.after(q, previous)))
        return parts

    def effective(self, q: ArrayLike, previous: ArrayLike | None = None) -> FloatArray:
        """Effective joints.

        Parameters
        ----------
        q : array_like, shape (n, joints)
            Commanded joints, radians (metres for prismatic joints).
        previous : array_like, shape (n, joints) or (joints,), optional
            The stop before each, as commanded; rows with NaN are not known.

        Returns
        -------
        ndarray, shape (n, joints)
        """
        q = np.asarray(q, dtype=float)
        if self.is_identity or not len(q):
            return q
        theta = q * (1.0 + self._gain)
        for waves in self._waves:
            theta[:, waves.joint] += waves.sums(q[:, waves.joint], 0)
        for terms, motion in self._parts(q, previous):
            theta += terms.effective(motion) - q
        return theta

    def jacobian(self, q: ArrayLike, previous: ArrayLike | None = None) -> FloatArray:
        """Derivative of the effective by the commanded joints, the stop before held.

        Parameters
        ----------
        q, previous
            As `effective`.

        Returns
        -------
        ndarray, shape (n, joints, joints)
            ``d theta_i / d q_j``.
        """
        q = np.asarray(q, dtype=float)
        joints = q.shape[1]
        out = np.zeros((len(q), joints, joints))
        out[:, range(joints), range(joints)] = 1.0 + self._gain
        for waves in self._waves:
            out[:, waves.joint, waves.joint] += waves.sums(q[:, waves.joint], 1)
        for terms, motion in self._parts(q, previous) if len(q) else ():
            out += terms.jacobian(motion) - np.eye(joints)
        return out

    def jacobian_derivative(self, q: ArrayLike, dq: ArrayLike) -> FloatArray:
        """Time derivative of `jacobian` along a motion, the stop before unknown.

        Parameters
        ----------
        q, dq : array_like, shape (n, joints)
            Commanded joints and their speeds, radians and radians per second (metres for prismatic joints).

        Returns
        -------
        ndarray, shape (n, joints, joints)
        """
        q, dq = np.asarray(q, dtype=float), np.asarray(dq, dtype=float)
        out = np.zeros((len(q), q.shape[1], q.shape[1]))
        for waves in self._waves:
            out[:, waves.joint, waves.joint] += waves.sums(q[:, waves.joint], 2) * dq[:, waves.joint]
        if self._levers.terms and len(q):
            out += self._levers.jacobian_derivative(Motion(q), dq)
        return out

    def effective_limits(self, lower: ArrayLike, upper: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """A box of effective joints whose commands all respect joint limits, whatever the stop before.

        Each effective joint grows with its own command: gains and series are taken at the limit itself, and what
        depends on other joints, gravity, or on the last move, draws the box in by as much as it can be.

        Parameters
        ----------
        lower, upper : array_like, shape (joints,)
            Limits of the commanded joints, radians (metres for prismatic joints); may be infinite.

        Returns
        -------
        lower, upper : ndarray, shape (joints,)
            Limits of the effective joints.
        """
        slack = np.zeros(len(self.terms.arm.joint_names))
        for term, coefficient in zip(self._levers.terms, self._levers.coefficients, strict=True):
            vector = np.asarray(term.parameters.get("vector", (1.0,)), dtype=float)
            slack[[term.joint, *term.also]] += abs(coefficient) * np.linalg.norm(vector)
        longest = np.subtract(upper, lower)
        longest = np.where(np.isfinite(longest), longest, 0.0)
        for term, coefficient in zip(self._history.terms, self._history.coefficients, strict=True):
            joints = [term.joint, *term.also]
            slack[joints] += abs(coefficient) * (longest[joints] if term.basis == "move" else 1.0)
        limits = []
        for bounds, inwards in ((lower, 1.0), (upper, -1.0)):
            bounds = np.array(bounds, dtype=float)
            finite = np.isfinite(bounds)
            at = np.where(finite, bounds, 0.0)
            box = at * (1.0 + self._gain) + inwards * slack
            for waves in self._waves:
                box[waves.joint] += waves.sums(at[waves.joint : waves.joint + 1], 0)[0]
            limits.append(np.where(finite, box, bounds))
        return limits[0], limits[1]

    def commanded(self, theta: ArrayLike, previous: ArrayLike | None = None) -> FloatArray:
        """Commanded joints that give these effective joints: the inverse of `effective`.

        By ``q <- theta - f(q, q - previous)``, a contraction by about one twentieth a step.

        Parameters
        ----------
        theta : array_like, shape (n, joints)
            Effective joints, radians (metres for prismatic joints).
        previous : array_like, shape (n, joints) or (joints,), optional
            As `effective`.

        Returns
        -------
        ndarray, shape (n, joints)

        Raises
        ------
        RobotError
            If the map is so far from the identity that the iteration does not converge.
        """
        theta = np.asarray(theta, dtype=float)
        q = theta.copy()
        if self.is_identity or not len(theta):
            return q
        change = np.inf
        for _ in range(STEPS):
            miss = theta - self.effective(q, previous)
            q += miss
            change = np.abs(miss).max()
            if change < 1e-14:
                return q
        if not change < 1e-11:
            raise RobotError(f"the joint map cannot be inverted: {change:.3g} rad left after {STEPS} steps")
        return q

    def static_parts(self) -> dict[str, Any]:
        """What `effective` without the stop before is made of, as plain values: for other languages.

        Returns
        -------
        dict
            ``gain`` of each joint; ``waves``: ``joint``, ``cycles``, ``cosine`` and ``sine``; ``levers``: ``joints``
            that turn by ``z . (R v x g)``, with ``z`` the axis of the first of them, ``R`` the attitude of ``link``,
            ``v`` its ``vector`` and ``g`` ``gravity``; and the nominal arm for these: rotations ``base`` and, before
            each joint, ``frames``, ``offsets`` and whether it ``turns``. Joints and links count from 0.

        Raises
        ------
        RobotError
            If there are terms of another kind.
        """
        levers = [
            {"joints": [term.joint, *term.also], "link": int(str(term.parameters["link"])) - 1, "vector": [*vector]}
            for term in self._levers.terms
            if isinstance(vector := term.parameters.get("vector"), tuple)
        ]
        if len(levers) < len(self._levers.terms):
            raise RobotError("this joint map has terms that cannot be written in other languages")
        arm = self.terms.arm
        frames = [_turn(0, alpha) @ _turn(1, beta) for alpha, beta in zip(arm.table.alpha, arm.table.beta, strict=True)]
        return {
            "gain": self._gain.tolist(),
            "waves": [
                {"joint": w.joint, "cycles": w.cycles.tolist(), "cosine": w.cosine.tolist(), "sine": w.sine.tolist()}
                for w in self._waves
            ],
            "levers": levers,
            "gravity": list(self.terms.gravity),
            "base": arm.T_base_0[:3, :3].tolist(),
            "frames": [R.tolist() for R in frames],
            "offsets": arm.table.theta.tolist(),
            "turns": (~arm.table.prismatic).tolist(),
        }

    def outside(self, q: ArrayLike) -> FloatArray:
        """How far commanded joints (n, joints) lie outside the ranges of the fit, zero within and without ranges."""
        q = np.asarray(q, dtype=float)
        if self.ranges is None:
            return np.zeros(q.shape)
        return np.maximum(q - self.ranges[1], 0.0) + np.minimum(q - self.ranges[0], 0.0)


def _turn(axis: int, angle: float) -> FloatArray:
    """Rotation about x (0) or y (1), shape (3, 3)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]] if axis == 0 else [[c, 0, s], [0, 1, 0], [-s, 0, c]])
