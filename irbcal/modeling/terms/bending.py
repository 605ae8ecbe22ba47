"""Bending: what gravity does about the two axes of a joint's frame that the joint does not turn about."""

from __future__ import annotations

from irbcal.modeling.arm import Arm
from irbcal.modeling.terms.gravity import lever_terms
from irbcal.modeling.terms.term import Family, Term

SIZE = 1e-4


class Bending(Family):
    """Links and bearings bend under the weight of what they carry."""

    name, moves_frames = "bending", True

    def terms(self, arm: Arm) -> list[Term]:
        """All independent levers about x and y of the joints' frames, a variance for each joint."""
        return lever_terms(arm, ("rx", "ry"), SIZE, self.name)


FAMILY = Bending()
