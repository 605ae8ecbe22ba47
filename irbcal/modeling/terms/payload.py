"""Payload: the joints give way under a mass on the tool, which the motion tells."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms.situation import Situation
from irbcal.modeling.terms.term import Basis, Family, Term, revolute

SIZE = 5e-5
"""Compliance of a joint, rad/(N m)."""
STANDARD_GRAVITY = 9.81
"""m/s^2."""


class PayloadTorque(Basis):
    """Torque of the payload about the joint's axis, N m.

    ``m z_j . ((p - o_j) x g^) 9.81``, with ``p`` the place of the mass: parameter ``place``, in the tip link, metres.
    """

    name = "payload"

    def _parts(self, terms: Sequence[Term], here: Situation) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Axes z and levers p - o (terms, 3, n), and weights (n,) in newtons."""
        joints, tip = [t.joint for t in terms], here.tip
        place = np.array([np.asarray(t.parameters.get("place", (0.0, 0.0, 0.0)), dtype=float) for t in terms])
        p = tip[3] + np.einsum("ka,acn->kcn", place, tip[:3])
        mass = here.motion.payload_kg
        weight = np.zeros(len(here.motion)) if mass is None else STANDARD_GRAVITY * mass
        return here.before[joints, 2], p - here.origins[joints], weight

    def values(self, terms: Sequence[Term], here: Situation) -> FloatArray:
        """Torque, shape (terms, n), N m."""
        z, lever, weight = self._parts(terms, here)
        return weight * np.einsum("kcn,kcn->kn", z, _cross(lever, here.gravity[:, None]))

    def slopes(self, terms: Sequence[Term], here: Situation) -> FloatArray:
        """Derivative by the joints, shape (terms, n, joints)."""
        z, lever, weight = self._parts(terms, here)
        g = here.gravity[:, None]
        out = np.zeros((len(terms), *here.motion.q.shape))
        joints = np.array([t.joint for t in terms])
        p = lever + here.origins[joints]
        for i, turning in enumerate(here.turning):
            # axis and origin of joint j move with joints before it, the mass with all
            before = (i < joints)[:, None, None]
            slides = here.before[i, 2] if here.arm.table.prismatic[i] else np.zeros(3)[:, None]
            z_move = np.where(before, _cross(turning, z), 0.0)
            arm_move = _cross(turning, p - here.origins[i]) + slides
            arm_move = arm_move - np.where(before, _cross(turning, p - lever - here.origins[i]) + slides, 0.0)
            out[:, :, i] = np.einsum("kcn,kcn->kn", z_move, _cross(lever, g))
            out[:, :, i] += np.einsum("kcn,kcn->kn", z, _cross(arm_move, g))
        return weight[:, None] * out


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.cross(a, np.broadcast_to(b, np.broadcast_shapes(a.shape, b.shape)), axis=-2)


class Payload(Family):
    """One compliance a joint, one variance for all.

    Parameters
    ----------
    place : sequence of three float
        Centre of the payload in the tip link, metres.
    """

    name = "payload"
    bases = (PayloadTorque(),)

    def __init__(self, place: Sequence[float] = (0.0, 0.0, 0.0)) -> None:
        self.place = tuple(float(x) for x in place)

    def terms(self, arm: Arm) -> list[Term]:
        """One term a revolute joint."""
        parameters = {"place": self.place}
        return [Term(j, "rz", "payload", SIZE, self.name, self.name, "rad/(N m)", parameters) for j in revolute(arm)]


FAMILY = Payload()
