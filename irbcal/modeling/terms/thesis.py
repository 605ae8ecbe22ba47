"""The joint map of Nubiola 2011, sections 5.2 and 5.3, as special cases of gravity and harmonics.

``A sin(q_2 + phi_2)`` is the lever of the upper arm's direction about axis 2, ``B sin(q_2 + q_3 + phi_3)``, which moves
joints 2 and 3 alike, that of the forearm's; joint 6 has harmonics of orders 1 and 2.
"""

from __future__ import annotations

from functools import cache, lru_cache

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms import gravity, harmonics
from irbcal.modeling.terms.situation import Motion, Situation
from irbcal.modeling.terms.term import Family, Term, TermValue

GROUP = "thesis_stiffness"


def stiffness_of(arm: Arm, phases: FloatArray) -> list[Term]:
    """Terms that A and B multiply: levers of upper arm and forearm, by their angles from the vertical at zero joints.

    They are the sines of the levers in Nubiola 2011, eqs. 5.9, 5.10 and 5.11.

    Parameters
    ----------
    arm : Arm
        Nominal, one that bends like the thesis's (`irbcal.modeling.arm.Arm.stiffness_geometry`).
    phases : ndarray, shape (2,)
        About axis 2, radians.
    """
    return list(_stiffness_of(arm, *map(float, phases)))


@lru_cache(maxsize=32)
def _stiffness_of(arm: Arm, *phases: float) -> tuple[Term, ...]:
    arm.stiffness_geometry()
    situation = Situation(arm, Motion(np.zeros((1, 6))))
    up = np.array([0.0, 0.0, 1.0])
    side = np.cross(situation.axes_before_joint[1, 2, :, 0], up)
    out = []
    for link, phase, also in ((1, phases[0], ()), (2, phases[1], (2,))):
        vector = situation.axes_after_joint[link, :, :, 0] @ (np.cos(phase) * up + np.sin(phase) * side)
        parameters: dict[str, TermValue] = {"link": link + 1, "vector": tuple(float(v) for v in vector)}
        out.append(Term(1, "rz", "gravity", gravity.SIZE, GROUP, Thesis.name, "rad", parameters, also))
    return tuple(out)


@cache
def _fourier_of() -> tuple[Term, ...]:
    name = Thesis.name
    return tuple(term for k in (1, 2) for term in harmonics.pair(5, k, "rz", harmonics.SIZE, f"{name}_fourier", name))


def fourier_of() -> list[Term]:
    """Cosine and sine of orders 1 and 2 of joint 6 (Nubiola 2011, eq. 5.8)."""
    return list(_fourier_of())


class Thesis(Family):
    """The two stiffness terms and the four of joint 6's Fourier series; none for arms that they do not fit."""

    name, title = "thesis", "arm stiffness and joint-6 series"
    special_case_of = ("gravity", "harmonics")

    def terms(self, arm: Arm) -> list[Term]:
        """A, B, then cosine and sine of orders 1 and 2 of joint 6."""
        return [*stiffness_of(arm, arm.stiffness_geometry()[0]), *fourier_of()] if arm.bends_like_the_thesis else []


FAMILY = Thesis()
