"""Own weight: the joints give way under the arm's own weight, taken as equal masses at its joints and at its tip.

Levers of gravity (`irbcal.modeling.terms.gravity`) can be any masses, with many terms a joint. Where rows are few, one
term that is about right tells more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms.gravity import SIZE, Gravity
from irbcal.modeling.terms.payload import as_levers
from irbcal.modeling.terms.situation import Situation
from irbcal.modeling.terms.term import Basis, Family, Term, weighed
from irbcal.modeling.terms.waves import Expansion, summed


class LinkWeights(Basis):
    """Torque of equal masses at the joints behind and at the tip about the joint's axis, one with the arm stretched."""

    name = "own_weight"

    def values(self, terms: Sequence[Term], situation: Situation) -> FloatArray:
        """Torque, shape (terms, n)."""
        return _summed(Gravity().values, terms, situation)

    def quick_values(self, terms: Sequence[Term], situation: Situation) -> FloatArray:
        """As `values`; by the waves of the levers."""
        return _summed(Gravity().quick_values, terms, situation)

    def slopes(self, terms: Sequence[Term], situation: Situation) -> FloatArray:
        """Derivative by the joints, shape (terms, n, joints)."""
        return _summed(Gravity().slopes, terms, situation)

    def slope_rates(self, terms: Sequence[Term], situation: Situation, dq: FloatArray) -> FloatArray:
        """Derivative of the slopes along joint speeds (n, joints), shape (terms, n, joints)."""
        return _summed(lambda levers, at: Gravity().slope_rates(levers, at, dq), terms, situation)

    def expansion(self, term: Term, arm: Arm, gravity: Sequence[float]) -> Expansion | None:
        """Waves of the joints that carry the axis or a link."""
        return summed(Gravity().expansion(lever, arm, gravity) for lever in levers_of(term, arm))


def levers_of(term: Term, arm: Arm) -> list[Term]:
    """A term of this family as terms of gravity, whose sum it is; none where a joint behind it slides or has no length.

    Parameters
    ----------
    term : Term
    arm : Arm
        Nominal.
    """
    levers = as_levers(term, arm) or []
    vectors = [np.asarray(lever.parameters["vector"]) * (len(levers) - k) for k, lever in enumerate(levers)]
    longest = sum(float(np.linalg.norm(vector)) for vector in vectors)
    return [
        replace(lever, parameters={**lever.parameters, "vector": tuple(map(float, vector / longest))})
        for lever, vector in zip(levers, vectors, strict=True)
        if longest > 0.0
    ]


def _summed(
    of_levers: Callable[[Sequence[Term], Situation], FloatArray], terms: Sequence[Term], situation: Situation
) -> FloatArray:
    levers = [levers_of(term, situation.arm) for term in terms]
    values = of_levers([lever for group in levers for lever in group], situation)
    return np.asarray(np.add.reduceat(values, np.cumsum([0, *map(len, levers)])[:-1], axis=0))


class OwnWeight(Family):
    """One term a revolute joint, one variance for all."""

    name = "own_weight"
    bases = (LinkWeights(),)

    def terms(self, arm: Arm) -> list[Term]:
        """None for joints before one that slides."""
        terms = [Term(j, "rz", self.name, SIZE, self.name, self.name) for j in weighed(arm)]
        return [term for term in terms if levers_of(term, arm)]


FAMILY = OwnWeight()
