"""A sum of terms as a robot's joint map: with the interface of the thesis's, `irbcal.modeling.joint_map.JointMap`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, lock
from irbcal.errors import RobotError
from irbcal.modeling.cos_sin import cos_sin
from irbcal.modeling.terms.payload import as_levers, largest_torque
from irbcal.modeling.terms.situation import LOAD, Motion, motion_at_use
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.term_map import TermMap

LOADS = ("payload", "torque")
"""Bases that depend on the load."""
ELSEWHERE = ("decay", *LOADS)
"""Bases that are zero for a warm arm, or are summed elsewhere."""
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
        c, s = cos_sin(phase)
        if order == 0:
            return c @ self.cosine + s @ self.sine
        if order == 1:
            return c @ (self.cycles * self.sine) - s @ (self.cycles * self.cosine)
        squares = self.cycles**2
        return -(c @ (squares * self.cosine) + s @ (squares * self.sine))


@dataclass(frozen=True, eq=False, repr=False)
class TermJointMap:
    """Commanded to effective joints by a sum of terms about the joints' own axes.

    The arm is warm and carries ``payload_kg`` unless told otherwise. Where the stop before is not given, terms of the
    last move are zero; where torques are not given, theirs are.

    Parameters
    ----------
    terms : TermMap
        Without frame terms.
    ranges : ndarray, shape (2, joints), optional
        Smallest and largest commanded joints that the terms were identified from, radians (metres): outside them high
        harmonics must not be trusted.
    payload_kg : float, optional
        The mass that is carried where none is given: the one that most poses of the fit were measured with. None where
        it was not told.

    Raises
    ------
    RobotError
        If there are terms that a joint map cannot carry.
    """

    terms: TermMap
    ranges: FloatArray | None = None
    payload_kg: float | None = None

    def __post_init__(self) -> None:
        if self.terms.has_frame_terms:
            raise RobotError("a joint map cannot carry terms about or along other axes than the joints' own")
        if self.knows_loads and self.payload_kg is None:
            object.__setattr__(self, "payload_kg", 0.0)
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
        return bool(self.history.coefficients.any())

    @cached_property
    def history_std(self) -> FloatArray:
        """By how much each joint's stop is uncertain where the stop before is not known, shape (joints,), rad (m).

        The root of the sum of the squares of its terms' coefficients, each with a function of one.
        """
        squares = np.zeros(len(self.terms.arm.joint_names))
        for term, coefficient in zip(self.history.terms, self.history.coefficients, strict=True):
            squares[[term.joint, *term.also]] += coefficient**2
        return np.sqrt(squares)

    @property
    def in_words(self) -> str:
        """How many terms of which kinds."""
        if self.is_identity:
            return "no joint map (commanded joints are the effective ones)"
        kinds = dict.fromkeys(term.family.replace("_", " ") for term in self.terms.terms)
        load = f", carrying {self.payload_kg:g} kg" if self.knows_loads else ""
        return f"joint map with {len(self.terms.terms)} terms ({', '.join(kinds)}){load}"

    @property
    def knows_loads(self) -> bool:
        """Whether it has terms of the payload: it was identified from measurements with several loads."""
        return any(term.basis == "payload" for term in self.terms.terms)

    @property
    def payload_place(self) -> FloatArray | None:
        """Centre of the payload in the tip link, metres; None without terms of the payload."""
        if not self.knows_loads:
            return None
        own = next(term.parameters.get("place") for term in self.terms.terms if term.basis == "payload")
        return np.array(own if isinstance(own, tuple) else (0.0, 0.0, 0.0))

    def carrying(self, payload_kg: float, place: ArrayLike | None = None) -> TermJointMap:
        """The same map with another mass on the tool.

        Parameters
        ----------
        payload_kg : float
            Mass in the unit and by the reckoning of the measurements (with or without the tool, as there).
        place : array_like, shape (3,), optional
            Its centre in the tip link, metres; that of the fit unless given.

        Returns
        -------
        TermJointMap

        Raises
        ------
        RobotError
            If the map was identified with another load only: nothing is known of how the joints give way then.
        """
        payload_kg = float(payload_kg)
        if not np.isfinite(payload_kg) or payload_kg < 0.0:
            raise RobotError(f"payload: expected a mass in kg, found {payload_kg:g}", parameter="payload_kg")
        if not self.knows_loads:
            if payload_kg == self.payload_kg and place is None:
                return self
            known = "a load that was not told" if self.payload_kg is None else f"{self.payload_kg:g} kg only"
            raise RobotError(
                f"this calibration was measured with {known}, which does not tell how the joints give way under "
                f"{payload_kg:g} kg: measure some poses with another load, too (column payload_kg)",
                parameter="payload_kg",
            )
        terms = self.terms
        if place is not None:
            there = np.asarray(place, dtype=float)
            if there.shape != (3,) or not np.isfinite(there).all():
                raise RobotError(f"payload's place: expected three numbers, found {place!r}", parameter="payload_place")
            terms = replace(terms, terms=tuple(_placed(term, there) for term in terms.terms))
        return replace(self, terms=terms, payload_kg=payload_kg)

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
        """Gravity, the vectors of one link and joint as one, and whatever is neither series, gain, history nor load."""
        return self._lever_map(None)

    @cached_property
    def _loaded(self) -> TermMap:
        """`_levers` with the payload that is carried."""
        return self._lever_map(self.payload_kg)

    def _lever_map(self, payload_kg: float | None) -> TermMap:
        sums: dict[tuple[int, tuple[int, ...], int], FloatArray] = {}
        for k in self._rows("gravity"):
            term = self.terms.terms[k]
            vector = term.parameters["vector"]
            value = np.eye(3)["xyz".index(vector)] if isinstance(vector, str) else np.asarray(vector, dtype=float)
            key = (term.joint, term.also, int(str(term.parameters["link"])))
            sums[key] = sums.get(key, np.zeros(3)) + self.terms.coefficients[k] * value
        sliding = []
        for k in self._rows("payload") if payload_kg else ():
            levers = as_levers(self.terms.terms[k], self.terms.arm)
            sliding += [k] if levers is None else []
            for lever in levers or ():
                key = (lever.joint, lever.also, int(str(lever.parameters["link"])))
                value = np.asarray(lever.parameters["vector"], dtype=float)
                weight = float(payload_kg or 0.0) * self.terms.coefficients[k]
                sums[key] = sums.get(key, np.zeros(3)) + weight * value
        terms = [
            Term(joint, "rz", "gravity", 1.0, "", "", "rad", {"link": link, "vector": tuple(map(float, v))}, also)
            for (joint, also, link), v in sums.items()
        ]
        rest = [*self._rows("q", "cos", "sin", "gravity", *ELSEWHERE, *HISTORY, other=True), *sliding]
        return TermMap(
            self.terms.arm,
            (*terms, *(self.terms.terms[k] for k in rest)),
            np.concatenate([np.ones(len(terms)), self.terms.coefficients[rest]]),
            None,
            self.terms.gravity,
        )

    @cached_property
    def history(self) -> TermMap:
        """Its terms of the last move, functions of that alone."""
        rows = self._rows(*HISTORY)
        chosen = tuple(self.terms.terms[k] for k in rows)
        return TermMap(self.terms.arm, chosen, self.terms.coefficients[rows], None, self.terms.gravity)

    def _only(self, basis: str) -> TermMap:
        rows = self._rows(basis)
        chosen = tuple(self.terms.terms[k] for k in rows)
        return TermMap(self.terms.arm, chosen, self.terms.coefficients[rows], None, self.terms.gravity)

    @cached_property
    def _payload(self) -> TermMap:
        return self._only("payload")

    @cached_property
    def _torque(self) -> TermMap:
        return self._only("torque")

    def motion(
        self,
        q: ArrayLike,
        previous: ArrayLike | None = None,
        payload_kg: ArrayLike | None = None,
        payload_place: ArrayLike | None = None,
        torques: ArrayLike | None = None,
    ) -> Motion:
        """The motion that the terms are functions of, with what is assumed where nothing is given; see `effective`."""
        own = np.zeros(3) if self.payload_place is None else self.payload_place
        return motion_at_use(q, previous, payload_kg, payload_place, torques, self.payload_kg, own)

    def load(self, n: int, *given: ArrayLike | None) -> dict[str, FloatArray | None]:
        """What the motion of n stops says of the load: mass, place, torques as given, or as usual; see `effective`."""
        motion = self.motion(np.zeros((n, len(self.terms.arm.joint_names))), None, *given)
        return {name: getattr(motion, name) for name in LOAD}

    def _parts(self, q: FloatArray, previous: ArrayLike | None) -> Sequence[tuple[TermMap, Motion]]:
        """Terms that are summed one by one, with the motion that they see, for the load that is carried."""
        parts = [(self._loaded, self.motion(q))] if self._loaded.terms else []
        if previous is not None and self.history.terms:
            parts.append((self.history, Motion.after(q, previous)))
        return parts

    def effective(
        self,
        q: ArrayLike,
        previous: ArrayLike | None = None,
        payload_kg: ArrayLike | None = None,
        payload_place: ArrayLike | None = None,
        torques: ArrayLike | None = None,
    ) -> FloatArray:
        """Effective joints.

        Parameters
        ----------
        q : array_like, shape (n, joints)
            Commanded joints, radians (metres for prismatic joints).
        previous : array_like, shape (n, joints) or (joints,), optional
            The stop before each, as commanded; rows with NaN are not known.
        payload_kg : array_like, shape (n,) or (), optional
            Mass carried at each; the map's own unless given, and where NaN.
        payload_place : array_like, shape (n, 3) or (3,), optional
            Its centre in the tip link, metres; as in the fit unless given.
        torques : array_like, shape (n, joints), optional
            Torques that the robot reports, N m. Without them terms of torques are zero.

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
        parts = list(self._parts(q, previous))
        if self.knows_loads and not (payload_kg is None and payload_place is None):
            parts = [part for part in parts if part[0] is not self._loaded]
            motion = self.motion(q, None, payload_kg, payload_place)
            parts += [(terms, motion) for terms in (self._levers, self._payload) if terms.terms]
        if torques is not None and self._torque.terms:
            parts.append((self._torque, self.motion(q, torques=torques)))
        for terms, motion in parts:
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
        if self._loaded.terms and len(q):
            out += self._loaded.jacobian_derivative(self.motion(q), dq)
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
        for term, coefficient in zip(self._loaded.terms, self._loaded.coefficients, strict=True):
            vector = np.asarray(term.parameters.get("vector", (1.0,)), dtype=float)
            most = float(np.linalg.norm(vector))
            if term.basis == "payload":
                most = float(self.payload_kg or 0.0) * largest_torque(term, self.terms.arm, lower, upper)
            slack[[term.joint, *term.also]] += abs(coefficient) * most
        longest = np.subtract(upper, lower)
        longest = np.where(np.isfinite(longest), longest, 0.0)
        for term, coefficient in zip(self.history.terms, self.history.coefficients, strict=True):
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
        """What `effective` without the stop before is made of for the load carried, as values for other languages.

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
            for term in self._loaded.terms
            if isinstance(vector := term.parameters.get("vector"), tuple)
        ]
        if len(levers) < len(self._loaded.terms):
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


def _placed(term: Term, place: FloatArray) -> Term:
    if term.basis != "payload":
        return term
    return replace(term, parameters={**term.parameters, "place": tuple(float(x) for x in place)})


def _turn(axis: int, angle: float) -> FloatArray:
    """Rotation about x (0) or y (1), shape (3, 3)."""
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0], [0, c, -s], [0, s, c]] if axis == 0 else [[c, 0, s], [0, 1, 0], [-s, 0, c]])
