"""Payload: the joints give way under a mass on the tool, which the motion tells."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms.gravity import Gravity, cross_columns
from irbcal.modeling.terms.situation import Situation
from irbcal.modeling.terms.term import Basis, Family, Input, Term, weighed
from irbcal.modeling.terms.waves import Expansion, summed
from irbcal.units import LARGEST_PAYLOAD_KG, MM, ColumnKind

SIZE = 5e-5
"""Compliance of a joint, rad/(N m)."""
STANDARD_GRAVITY = 9.81
"""m/s^2."""


MASS = Input(
    "payload_kg",
    ("payload_kg",),
    ColumnKind(f"a mass from 0 to {LARGEST_PAYLOAD_KG:g} kg", 0.0, LARGEST_PAYLOAD_KG),
    "payload",
    "",
    per_pose=True,
)
CENTRE = Input(
    "payload_centre",
    ("payload_x_mm", "payload_y_mm", "payload_z_mm"),
    ColumnKind("a place in the tip link in mm", -1e4, 1e4, MM),
    "payload's centre",
    "",
    per_pose=True,
    with_columns=MASS.columns,
)
"""Of the payload's mass, in the tip link."""


class PayloadTorque(Basis):
    """Torque of the payload about the joint's axis, N m.

    ``m z_j . ((p - o_j) x g^) 9.81``, with ``p`` the place of the mass in the tip link, metres: the motion's, or
    parameter ``place``.
    """

    name = "payload"
    inputs = (MASS, CENTRE)

    def _parts(self, terms: Sequence[Term], situation: Situation) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Axes z and levers p - o (terms, 3, n), and weights (n,) in newtons."""
        joints, tip = [t.joint for t in terms], situation.tip
        centres = np.array([np.asarray(t.parameters.get("place", (0.0, 0.0, 0.0)), dtype=float) for t in terms])
        stated = situation.motion.inputs.get("payload_centre")
        p = tip[3] + (
            np.einsum("ka,acn->kcn", centres, tip[:3])
            if stated is None
            else np.broadcast_to(np.einsum("na,acn->cn", stated, tip[:3]), (len(terms), 3, len(stated)))
        )
        mass = situation.motion.inputs.get("payload_kg")
        weight = np.zeros(len(situation.motion)) if mass is None else STANDARD_GRAVITY * mass
        return situation.axes_before_joint[joints, 2], p - situation.origins[joints], weight

    def values(self, terms: Sequence[Term], situation: Situation) -> FloatArray:
        """Torque, shape (terms, n), N m."""
        z, lever, weight = self._parts(terms, situation)
        return weight * np.einsum("kcn,kcn->kn", z, cross_columns(lever, situation.gravity[:, None]))

    def slopes(self, terms: Sequence[Term], situation: Situation) -> FloatArray:
        """Derivative by the joints, shape (terms, n, joints)."""
        z, lever, weight = self._parts(terms, situation)
        g = situation.gravity[:, None]
        out = np.zeros((len(terms), *situation.motion.q.shape))
        joints = np.array([t.joint for t in terms])
        p = lever + situation.origins[joints]
        for i, turning in enumerate(situation.turning):
            # axis and origin of joint j move with joints before it, the mass with all
            carried = (i < joints)[:, None, None]
            slides = situation.axes_before_joint[i, 2] if situation.arm.table.prismatic[i] else np.zeros(3)[:, None]
            z_move = np.where(carried, cross_columns(turning, z), 0.0)
            o = situation.origins[i]
            arm_move = cross_columns(turning, p - o) + slides
            arm_move = arm_move - np.where(carried, cross_columns(turning, p - lever - o) + slides, 0.0)
            out[:, :, i] = np.einsum("kcn,kcn->kn", z_move, cross_columns(lever, g))
            out[:, :, i] += np.einsum("kcn,kcn->kn", z, cross_columns(arm_move, g))
        return weight[:, None] * out

    def expansion(self, term: Term, arm: Arm, gravity: Sequence[float]) -> Expansion | None:
        """For one kilogram; None where a joint between that of the term and the tip slides."""
        levers = as_levers(term, arm)
        return None if levers is None else summed(Gravity().expansion(lever, arm, gravity) for lever in levers)


def as_levers(term: Term, arm: Arm) -> list[Term] | None:
    """A payload term as terms of gravity on the links that carry the mass, for one kilogram.

    Parameters
    ----------
    term : Term
    arm : Arm
        Nominal arm.

    Returns
    -------
    list of Term or None
        Their sum, each with coefficient one, is the term's function for 1 kg; None where a joint between that of the
        term and the tip slides.
    """
    table = arm.table
    if table.prismatic[term.joint + 1 :].any():
        return None
    vectors = []
    for k in range(term.joint + 1, len(table.a)):
        c, s, cb, sb = np.cos(table.alpha[k]), np.sin(table.alpha[k]), np.cos(table.beta[k]), np.sin(table.beta[k])
        y, z = np.array([0.0, c, s]), np.array([sb, -s * cb, c * cb])
        vectors.append(table.a[k] * np.array([1.0, 0.0, 0.0]) + table.b[k] * y + table.d[k] * z)
    centre = np.asarray(term.parameters.get("place", (0.0, 0.0, 0.0)), dtype=float)
    vectors.append(arm.T_last_tip[:3, :3] @ centre + arm.T_last_tip[:3, 3])
    return [
        Term(
            term.joint,
            term.axis,
            "gravity",
            1.0,
            "",
            "",
            "rad",
            {"link": term.joint + 1 + k, "vector": tuple(float(x) for x in STANDARD_GRAVITY * vector)},
            term.also,
        )
        for k, vector in enumerate(vectors)
    ]


def largest_torque(term: Term, arm: Arm, lower: ArrayLike, upper: ArrayLike) -> float:
    """A bound of a payload term's function within joint limits (joints,), N m, for one kilogram."""
    table = arm.table
    travel = np.maximum(np.abs(np.asarray(lower, dtype=float)), np.abs(np.asarray(upper, dtype=float)))
    travel = np.where(table.prismatic & np.isfinite(travel), travel, 0.0)
    reach = (np.abs(table.a) + np.abs(table.b) + np.abs(table.d) + travel).sum()
    centre = np.asarray(term.parameters.get("place", (0.0,)), dtype=float)
    return STANDARD_GRAVITY * float(reach + np.linalg.norm(arm.T_last_tip[:3, 3]) + np.linalg.norm(centre))


class Payload(Family):
    """One compliance a joint, one variance for all.

    Parameters
    ----------
    place : sequence of three float
        Centre of the payload in the tip link where the motion does not say, metres.
    """

    name = "payload"
    bases = (PayloadTorque(),)

    def __init__(self, place: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
        self.place = tuple(float(x) for x in place)

    def terms(self, arm: Arm) -> list[Term]:
        """One term a revolute joint."""
        parameters = {"place": self.place}
        return [Term(j, "rz", "payload", SIZE, self.name, self.name, "rad/(N m)", parameters) for j in weighed(arm)]


FAMILY = Payload()
