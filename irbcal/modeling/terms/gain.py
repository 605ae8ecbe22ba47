"""Gain: each joint turns a little more or less than commanded, in proportion to its angle."""

from __future__ import annotations

from collections.abc import Sequence

from irbcal.arrays import FloatArray
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms.situation import Situation
from irbcal.modeling.terms.term import Basis, Family, Term, by_own_joint, own_axis

SIZE = 5e-4


class JointValue(Basis):
    """The joint's own commanded value."""

    name = "q"

    def values(self, terms: Sequence[Term], situation: Situation) -> FloatArray:
        """Commanded value of each term's joint, shape (terms, n), radians or metres."""
        return situation.motion.q.T[[term.joint for term in terms]]

    def slopes(self, terms: Sequence[Term], situation: Situation) -> FloatArray:
        """One by the own joint, shape (terms, n, joints)."""
        return by_own_joint(terms, situation, 1.0)


class Gain(Family):
    """One gain a joint (Nubiola 2011, eq. 3.31)."""

    name, of_type = "gain", True
    bases = (JointValue(),)

    def terms(self, arm: Arm) -> list[Term]:
        """One term a joint, all with one variance."""
        return [Term(j, own_axis(arm, j), "q", SIZE, self.name, self.name, "1") for j in range(len(arm.joint_names))]


FAMILY = Gain()
