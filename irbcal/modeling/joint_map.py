"""The joint map: from commanded to effective joints by a sum of terms, what URDF cannot carry of a calibration."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, lock
from irbcal.errors import CalibrationError, RobotError
from irbcal.modeling.arm import Arm
from irbcal.modeling.parts import compiled, map_parts, stops
from irbcal.modeling.terms import bases
from irbcal.modeling.terms.payload import largest_torque
from irbcal.modeling.terms.situation import LOAD, Motion, motion_at_use
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.term_map import TermMap
from irbcal.modeling.terms.waves import Expansion, Turns, Waves

HISTORY = ("direction", "share_of_move", "move")
"""Bases that are zero where the last move is not known."""
STEPS = 60


@dataclass(frozen=True, eq=False, repr=False)
class JointMap:
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
        return f"<JointMap: {self.in_words}>"

    @staticmethod
    def identity(arm: Arm) -> JointMap:
        """The map of a robot whose joints do as they are told."""
        return JointMap(TermMap(arm, (), np.zeros(0)))

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

    @cached_property
    def parts(self) -> dict[str, Any] | None:
        """Its terms summed up as plain numbers; None where some cannot be, see `irbcal.modeling.parts.map_parts`."""
        try:
            return map_parts(self.terms, self.payload_kg)
        except CalibrationError:
            return None

    @cached_property
    def _kernel(self) -> Any:
        return None if self.parts is None else compiled(self.terms.arm, self.parts)

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
        centre = next(term.parameters.get("place") for term in self.terms.terms if term.basis == "payload")
        return np.array(centre if isinstance(centre, tuple) else (0.0, 0.0, 0.0))

    def carrying(self, payload_kg: float, centre: ArrayLike | None = None) -> JointMap:
        """The same map with another mass on the tool.

        Parameters
        ----------
        payload_kg : float
            Mass in the unit and by the reckoning of the measurements (with or without the tool, as there).
        centre : array_like, shape (3,), optional
            Its centre in the tip link, metres; that of the fit unless given.

        Raises
        ------
        RobotError
            If the map was identified with another load only: nothing is known of how the joints give way then.
        """
        payload_kg = float(payload_kg)
        if not np.isfinite(payload_kg) or payload_kg < 0.0:
            raise RobotError(f"payload: expected a mass in kg, found {payload_kg:g}", parameter="payload_kg")
        if not self.knows_loads:
            if payload_kg == self.payload_kg and centre is None:
                return self
            measured = "a load that was not told" if self.payload_kg is None else f"{self.payload_kg:g} kg only"
            raise RobotError(
                f"this calibration was measured with {measured}, which does not tell how the joints give way under "
                f"{payload_kg:g} kg: measure some poses with another load, too (column payload_kg)",
                parameter="payload_kg",
            )
        terms = self.terms
        if centre is not None:
            xyz = np.asarray(centre, dtype=float)
            if xyz.shape != (3,) or not np.isfinite(xyz).all():
                raise RobotError(
                    f"payload's place: expected three numbers, found {centre!r}", parameter="payload_place"
                )
            terms = replace(terms, terms=tuple(_placed(term, xyz) for term in terms.terms))
        return replace(self, terms=terms, payload_kg=payload_kg)

    # -------------------------------------------------------------- what the terms come to

    def _of(self, *names: str) -> TermMap:
        """Its terms of some bases."""
        rows = [k for k, term in enumerate(self.terms.terms) if term.basis in names]
        chosen = tuple(self.terms.terms[k] for k in rows)
        return TermMap(self.terms.arm, chosen, self.terms.coefficients[rows], None, self.terms.gravity)

    @cached_property
    def history(self) -> TermMap:
        """Its terms of the last move, functions of that alone."""
        return self._of(*HISTORY)

    @cached_property
    def _torque(self) -> TermMap:
        return self._of("torque")

    @cached_property
    def _gain(self) -> FloatArray:
        gain = np.zeros(len(self.terms.arm.joint_names))
        terms = self._of("q")
        for term, coefficient in zip(terms.terms, terms.coefficients, strict=True):
            gain[[term.joint, *term.also]] += coefficient
        return gain

    def _expanded(self, terms: TermMap) -> tuple[Waves, TermMap]:
        """Terms as waves, and those that are none."""
        weights: dict[tuple[int, Turns], complex] = {}
        sliding = []
        for k, (term, coefficient) in enumerate(zip(terms.terms, terms.coefficients.tolist(), strict=True)):
            expansion = self._expansion(term)
            if expansion is None:
                sliding.append(k)
                continue
            for joint in (term.joint, *term.also):
                for turns, weight in expansion.items():
                    weights[joint, turns] = weights.get((joint, turns), 0.0) + coefficient * weight
        remaining = TermMap(
            terms.arm, tuple(terms.terms[k] for k in sliding), terms.coefficients[sliding], None, terms.gravity
        )
        return Waves(len(terms.arm.joint_names), weights), remaining

    def _expansion(self, term: Term) -> Expansion | None:
        return bases()[term.basis].expansion(term, self.terms.arm, self.terms.gravity)

    def phase(self, term: Term) -> float:
        """``phi`` of a term that is ``sin(sum of joints + phi)`` times a positive number, radians."""
        ((_, weight),) = (self._expansion(term) or {}).items()
        return float(np.angle(1j * weight))

    @cached_property
    def _unloaded(self) -> tuple[Waves, TermMap]:
        """What depends on the joints alone, whatever is carried."""
        apart = ("q", "decay", "payload", "torque", *HISTORY)
        return self._expanded(self._of(*({term.basis for term in self.terms.terms} - set(apart))))

    @cached_property
    def _payload(self) -> tuple[Waves, TermMap]:
        """What one kilogram at its usual place does."""
        return self._expanded(self._of("payload"))

    @cached_property
    def _payload_along(self) -> tuple[Waves, ...]:
        """What one kilogram adds a metre farther along each axis of the tip link."""
        terms, none = self._of("payload"), np.zeros(3)
        at_tip = self._expanded(replace(terms, terms=tuple(_placed(term, none) for term in terms.terms)))[0]
        out = []
        for axis in np.eye(3):
            expanded = self._expanded(replace(terms, terms=tuple(_placed(term, axis) for term in terms.terms)))[0]
            weights = dict(expanded.weights)
            for key, weight in at_tip.weights.items():
                weights[key] = weights.get(key, 0.0) - weight
            out.append(Waves(expanded.joints, weights))
        return tuple(out)

    @cached_property
    def _usual(self) -> tuple[Waves, TermMap]:
        """`_unloaded` with the payload that is carried."""
        (waves, remaining), (of_payload, sliding) = self._unloaded, self._payload
        if not self.payload_kg or not (of_payload or sliding.terms):
            return waves, remaining
        weights = dict(waves.weights)
        for key, weight in of_payload.weights.items():
            weights[key] = weights.get(key, 0.0) + self.payload_kg * weight
        terms = (*remaining.terms, *sliding.terms), np.concatenate([remaining.coefficients, sliding.coefficients])
        return Waves(waves.joints, weights), TermMap(remaining.arm, *terms, None, remaining.gravity)

    def motion(
        self,
        q: ArrayLike,
        previous: ArrayLike | None = None,
        payload_kg: ArrayLike | None = None,
        payload_place: ArrayLike | None = None,
        torques: ArrayLike | None = None,
    ) -> Motion:
        """The motion that the terms are functions of, with what is assumed where nothing is given; see `effective`."""
        centre = np.zeros(3) if self.payload_place is None else self.payload_place
        return motion_at_use(q, previous, payload_kg, payload_place, torques, self.payload_kg, centre)

    def load(self, n: int, *given: ArrayLike | None) -> dict[str, FloatArray | None]:
        """What the motion of n stops says of the load: mass, place, torques as given, or as usual; see `effective`."""
        motion = self.motion(np.zeros((n, len(self.terms.arm.joint_names))), None, *given)
        return {name: getattr(motion, name) for name in LOAD}

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
        if self._kernel is not None and q.ndim == 2:
            theta, known = np.empty(q.shape), stops(q, previous, payload_kg, payload_place, torques)
            if self._kernel.effective(np.ascontiguousarray(q), known, theta):
                return theta
        theta = q * (1.0 + self._gain)
        if payload_kg is None and payload_place is None:
            waves, remaining = self._usual
            waves.add(q, theta)
            self._add_rest(remaining, self.motion(q) if remaining.terms else None, theta)
        else:
            self._add_loaded(self.motion(q, None, payload_kg, payload_place), theta, payload_place is not None)
        if previous is not None:
            self._add_rest(self.history, Motion.after(q, previous), theta)
        if torques is not None:
            self._add_rest(self._torque, self.motion(q, torques=torques), theta)
        return theta

    @staticmethod
    def _add_rest(terms: TermMap, motion: Motion | None, theta: FloatArray) -> None:
        """Add terms that are summed one by one to effective joints (n, joints)."""
        if terms.terms and motion is not None:
            theta += terms.effective(motion) - motion.q

    def _add_loaded(self, motion: Motion, theta: FloatArray, placed: bool) -> None:
        """Add what depends on the joints and the load of a motion, its places among them where ``placed``."""
        for waves, remaining in (self._unloaded, self._payload):
            self._add_rest(remaining, motion, theta)
            waves.add(motion.q, theta, motion.payload_kg if waves is self._payload[0] else None)
        usual_centre, mass, centre = self.payload_place, motion.payload_kg, motion.payload_place
        if placed and usual_centre is not None and mass is not None and centre is not None:
            for waves, shift in zip(self._payload_along, (centre - usual_centre).T, strict=True):
                waves.add(motion.q, theta, mass * shift)

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
        waves, remaining = self._usual
        waves.add_slopes(q, out)
        if remaining.terms and len(q):
            out += remaining.jacobian(self.motion(q)) - np.eye(joints)
        if self.history.terms and len(q) and previous is not None:
            out += self.history.jacobian(Motion.after(q, previous)) - np.eye(joints)
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
        waves, remaining = self._usual
        waves.add_slope_rates(q, dq, out)
        if remaining.terms and len(q):
            out += remaining.jacobian_derivative(self.motion(q), dq)
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
        waves, remaining = self._usual
        slack = waves.bound
        for term, coefficient in zip(remaining.terms, remaining.coefficients, strict=True):
            largest = float(np.linalg.norm(np.asarray(term.parameters.get("vector", (1.0,)), dtype=float)))
            if term.basis == "payload":
                largest = float(self.payload_kg or 0.0) * largest_torque(term, self.terms.arm, lower, upper)
            slack[[term.joint, *term.also]] += abs(coefficient) * largest
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
            waves.add_own(at[None], box[None])
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
            ``gain`` of each joint, and ``waves``: ``turns`` of each joint, and for each ``joint`` that the wave moves
            what multiplies the ``cosine`` and the ``sine`` of ``turns . q``. Joints count from 0.

        Raises
        ------
        RobotError
            If there are terms that are no waves.
        """
        waves, remaining = self._usual
        if remaining.terms:
            raise RobotError("this joint map has terms that cannot be written in other languages")
        return {
            "gain": self._gain.tolist(),
            "waves": [
                {"joint": joint, "turns": [*turns], "cosine": weight.real, "sine": -weight.imag}
                for (joint, turns), weight in waves.weights.items()
            ],
        }

    def outside(self, q: ArrayLike) -> FloatArray:
        """How far commanded joints (n, joints) lie outside the ranges of the fit, zero within and without ranges."""
        q = np.asarray(q, dtype=float)
        if self.ranges is None:
            return np.zeros(q.shape)
        return np.maximum(q - self.ranges[1], 0.0) + np.minimum(q - self.ranges[0], 0.0)


def _placed(term: Term, centre: FloatArray) -> Term:
    if term.basis != "payload":
        return term
    return replace(term, parameters={**term.parameters, "place": tuple(float(x) for x in centre)})
