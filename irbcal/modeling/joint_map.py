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
from irbcal.modeling.term_sums import compiled, stops, term_sums
from irbcal.modeling.terms import bases, given_inputs
from irbcal.modeling.terms import inputs as by_name
from irbcal.modeling.terms.payload import largest_torque
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.term_map import TermMap
from irbcal.modeling.terms.waves import NOTHING, Expansion, Turns

HISTORY_BASES = ("direction", "share_of_move", "move")
"""Bases that are zero where the last move is not known."""
INVERSE_STEPS = 60


@dataclass(frozen=True, eq=False, repr=False)
class JointMap:
    """Commanded to effective joints by a sum of terms about the joints' own axes.

    The arm is warm and carries ``payload_kg`` unless told otherwise. Where the stop before is not given, terms of the
    last move are zero, and so are those of other inputs that are not given.

    Raises
    ------
    RobotError
        If there are terms that a joint map cannot carry.
    """

    terms: TermMap
    """Without frame terms."""
    ranges: FloatArray | None = None
    """Shape (2, joints). Smallest and largest commanded joints that the terms were identified from, radians (metres):
    outside them high harmonics must not be trusted.
    """
    payload_kg: float | None = None
    """The mass that is carried where none is given: the one that most poses of the fit were measured with. None where
    it was not told.
    """

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

    @cached_property
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
    def sums(self) -> dict[str, Any] | None:
        """Its terms summed up as plain numbers; None where some cannot be, see `irbcal.modeling.term_sums`."""
        try:
            return term_sums(self.terms, self.payload_kg)
        except CalibrationError:
            return None

    @cached_property
    def _kernel(self) -> Any:
        return None if self.sums is None else compiled(self.terms.arm, self.sums)

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
    def payload_centre(self) -> FloatArray | None:
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
            measured = "a load that was not given" if self.payload_kg is None else f"{self.payload_kg:g} kg only"
            raise RobotError(
                f"this calibration was measured with {measured}, which does not show how the joints deflect under "
                f"{payload_kg:g} kg: measure some poses with another load, too (column payload_kg)",
                parameter="payload_kg",
            )
        terms = self.terms
        if centre is not None:
            xyz = np.asarray(centre, dtype=float)
            if xyz.shape != (3,) or not np.isfinite(xyz).all():
                raise RobotError(
                    f"payload's centre: expected three numbers, found {centre!r}", parameter="payload_centre"
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
        return self._of(*HISTORY_BASES)

    @cached_property
    def _still(self) -> TermMap:
        """Its other terms."""
        return self._of(*({term.basis for term in self.terms.terms} - set(HISTORY_BASES)))

    @cached_property
    def _gain(self) -> FloatArray:
        gain = np.zeros(len(self.terms.arm.joint_names))
        terms = self._of("q")
        for term, coefficient in zip(terms.terms, terms.coefficients, strict=True):
            gain[[term.joint, *term.also]] += coefficient
        return gain

    def _expansion(self, term: Term) -> Expansion | None:
        return bases()[term.basis].expansion(term, self.terms.arm, self.terms.gravity)

    def phase(self, term: Term) -> float:
        """``phi`` of a term that is ``sin(sum of joints + phi)`` times a positive number, radians."""
        ((_, weight),) = (self._expansion(term) or {}).items()
        return float(np.angle(1j * weight))

    @cached_property
    def _usual(self) -> tuple[dict[tuple[int, Turns], complex], list[tuple[Term, float]]]:
        """What depends on the joints alone, for the load that is carried: weights of waves, and terms that are none."""
        weights: dict[tuple[int, Turns], complex] = {}
        rest = []
        apart = {
            name for name, basis in bases().items() if basis.inputs and not (name == "payload" and self.payload_kg)
        }
        apart |= {"q", "decay", *HISTORY_BASES}
        for term, coefficient in zip(self.terms.terms, self.terms.coefficients.tolist(), strict=True):
            if term.basis in apart:
                continue
            expansion = self._expansion(term)
            if expansion is None:
                rest.append((term, coefficient))
                continue
            size = coefficient * (self.payload_kg or 0.0) if term.basis == "payload" else coefficient
            for joint in (term.joint, *term.also):
                for turns, weight in expansion.items():
                    weights[joint, turns] = weights.get((joint, turns), 0.0) + size * weight
        return {key: weight for key, weight in weights.items() if abs(weight) > NOTHING}, rest

    def motion(self, q: ArrayLike, previous: ArrayLike | None = None, **inputs: ArrayLike | None) -> Motion:
        """The motion that the terms are functions of, with what is assumed where nothing is given; see `effective`."""
        q = np.asarray(q, dtype=float)
        usual: dict[str, Any] = {"payload_kg": self.payload_kg or 0.0, "payload_centre": self.payload_centre}
        given: dict[str, ArrayLike] = {"payload_kg": usual["payload_kg"], **given_inputs(inputs)}
        filled = {name: by_name()[name].filled(value, q.shape, usual.get(name)) for name, value in given.items()}
        return replace(Motion.from_stops(q, previous), inputs=filled)

    def effective(self, q: ArrayLike, previous: ArrayLike | None = None, **inputs: ArrayLike | None) -> FloatArray:
        """Effective joints.

        Parameters
        ----------
        q : array_like, shape (n, joints) or (joints,)
            Commanded joints, radians (metres for prismatic joints).
        previous : array_like, shape (n, joints) or (joints,), optional
            The stop before each, as commanded; rows with NaN are not known.
        **inputs : array_like
            What else terms are functions of (`irbcal.modeling.terms.inputs`), at each or at all, SI units; the usual
            where NaN. ``payload_kg`` (n,) is the mass carried; the map's own unless given. ``payload_centre`` (n, 3) is
            its centre in the tip link; as in the fit unless given. ``torques`` (n, joints) are those that the robot
            reports. Without an input the other terms of it are zero.

        Returns
        -------
        ndarray, shape (n, joints)
            n is 1 for one pose.

        Raises
        ------
        RobotError
            If joints have another shape, or look like degrees.
        """
        check = self.terms.arm.check_joints
        return self.effective_unchecked(check(q), None if previous is None else check(previous), **inputs)

    def effective_unchecked(
        self, q: FloatArray, previous: ArrayLike | None = None, **inputs: ArrayLike | None
    ) -> FloatArray:
        """As `effective`, of any joints (n, joints): for iterations."""
        if self.is_identity or not len(q):
            return q
        if self._kernel is not None:
            theta = np.empty(q.shape)
            stop_columns = stops(q, previous, inputs, self.sums) if inputs or previous is not None else None
            if self._kernel.effective(np.ascontiguousarray(q), stop_columns, theta):
                return theta
        return self.terms.effective(self.motion(q, previous, **inputs))

    def jacobian(self, q: ArrayLike, previous: ArrayLike | None = None) -> FloatArray:
        """Derivative of the effective by the commanded joints, the stop before held.

        Parameters
        ----------
        q, previous
            As `effective`.

        Returns
        -------
        ndarray, shape (n, joints, joints)
            ``d theta_i / d q_j``; n is 1 for one pose.

        Raises
        ------
        RobotError
            If joints have another shape, or look like degrees.
        """
        check = self.terms.arm.check_joints
        return self.jacobian_unchecked(check(q), None if previous is None else check(previous))

    def jacobian_unchecked(self, q: FloatArray, previous: ArrayLike | None = None) -> FloatArray:
        """As `jacobian`, of any joints (n, joints): for iterations."""
        slopes = self._slopes(q, previous, None)
        if slopes is not None:
            return slopes
        slopes = self._still.jacobian(self.motion(q))
        if self.history.terms and previous is not None:
            moved = np.isfinite(np.broadcast_to(previous, q.shape)).all(axis=1)
            slopes[moved] += self.history.jacobian(self.motion(q, previous))[moved] - np.eye(q.shape[1])
        return slopes

    def _slopes(self, q: FloatArray, previous: ArrayLike | None, dq: FloatArray | None) -> FloatArray | None:
        """`jacobian`, or its time derivative at speeds ``dq``, by the compiled kernel; None where there is none."""
        if self._kernel is None:
            return None
        out, stop_columns = np.empty((*q.shape, q.shape[1])), stops(q, previous, {}, None)
        speeds = None if dq is None else np.ascontiguousarray(dq)
        return out if self._kernel.map_slopes(np.ascontiguousarray(q), stop_columns, speeds, out) else None

    def jacobian_derivative(self, q: ArrayLike, dq: ArrayLike) -> FloatArray:
        """Time derivative of `jacobian` along a motion, the stop before unknown.

        Parameters
        ----------
        q, dq : array_like, shape (n, joints) or (joints,)
            Commanded joints and their speeds, radians and radians per second (metres for prismatic joints).

        Returns
        -------
        ndarray, shape (n, joints, joints)
            n is 1 for one pose.

        Raises
        ------
        RobotError
            As `jacobian`.
        """
        q, dq = self.terms.arm.check_joints(q), self.terms.arm.check_shape(dq)
        rates = self._slopes(q, None, dq)
        return self._still.jacobian_derivative(self.motion(q), dq) if rates is None else rates

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
        weights, rest = self._usual
        slack = np.zeros(len(self.terms.arm.joint_names))
        single = {
            (j, turns): weight for (j, turns), weight in weights.items() if turns[j] and sum(map(bool, turns)) == 1
        }
        for key, weight in weights.items():
            slack[key[0]] += 0.0 if key in single else abs(weight)
        for term, coefficient in rest:
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
            for (joint, turns), weight in single.items():
                box[joint] += (weight * np.exp(1j * turns[joint] * at[joint])).real
            limits.append(np.where(finite, box, bounds))
        return limits[0], limits[1]

    def commanded(self, theta: ArrayLike, previous: ArrayLike | None = None) -> FloatArray:
        """Commanded joints that give these effective joints: the inverse of `effective`.

        By ``q <- theta - f(q, q - previous)``, a contraction by about one twentieth a step.

        Parameters
        ----------
        theta : array_like, shape (n, joints) or (joints,)
            Effective joints, radians (metres for prismatic joints).
        previous : array_like, shape (n, joints) or (joints,), optional
            As `effective`.

        Returns
        -------
        ndarray, shape (n, joints)
            n is 1 for one pose.

        Raises
        ------
        RobotError
            If joints have another shape, or look like degrees, or the map is so far from the identity that the
            iteration does not converge.
        """
        check = self.terms.arm.check_joints
        return self.commanded_unchecked(check(theta), None if previous is None else check(previous))

    def commanded_unchecked(self, theta: FloatArray, previous: ArrayLike | None = None) -> FloatArray:
        """As `commanded`, of any joints (n, joints)."""
        q = theta.copy()
        if self.is_identity or not len(theta):
            return q
        change = np.inf
        for _ in range(INVERSE_STEPS):
            miss = theta - self.effective_unchecked(q, previous)
            q += miss
            change = np.abs(miss).max()
            if change < 1e-14:
                return q
        if not change < 1e-11:
            raise RobotError(f"the joint map cannot be inverted: {change:.3g} rad left after {INVERSE_STEPS} steps")
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
        weights, rest = self._usual
        if rest:
            raise RobotError("this joint map has terms that cannot be written in other languages")
        return {
            "gain": self._gain.tolist(),
            "waves": [
                {"joint": joint, "turns": [*turns], "cosine": weight.real, "sine": -weight.imag}
                for (joint, turns), weight in weights.items()
            ],
        }

    def outside(self, q: ArrayLike) -> FloatArray:
        """How far commanded joints lie outside the ranges of the fit, zero within and without ranges.

        Joints are checked as by `effective`.
        """
        q = self.terms.arm.check_joints(q)
        if self.ranges is None:
            return np.zeros(q.shape)
        return np.maximum(q - self.ranges[1], 0.0) + np.minimum(q - self.ranges[0], 0.0)


def _placed(term: Term, centre: FloatArray) -> Term:
    if term.basis != "payload":
        return term
    return replace(term, parameters={**term.parameters, "place": tuple(float(x) for x in centre)})
