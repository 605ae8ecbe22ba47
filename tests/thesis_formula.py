"""The thesis's joint map as its formulas have it, in numpy: the oracle of the sum of terms that robots have."""

from dataclasses import dataclass, field, fields, replace

import numpy as np

from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.terms.gain import FAMILY as GAIN
from irbcal.modeling.terms.harmonics import order
from irbcal.modeling.terms.term_map import TermMap
from irbcal.modeling.terms.thesis import fourier_of, stiffness_of
from irbcal.modeling.thesis_map import stiffness_and_phases

GEOMETRIC, OF_THE_MAP = ("alpha", "a", "theta", "d", "beta", "b"), ("gain", "stiffness", "fourier")


@dataclass(frozen=True)
class ThesisMap:
    """Gains (n,), A and B (2,), phi_2 and phi_3 (2,), a_1, b_1, a_2, b_2 of joint 6 (4,), radians."""

    gain: np.ndarray = field(default_factory=lambda: np.zeros(6))
    stiffness: np.ndarray = field(default_factory=lambda: np.zeros(2))
    phases: np.ndarray = field(default_factory=lambda: np.array([0.0, np.pi / 2]))
    fourier: np.ndarray = field(default_factory=lambda: np.zeros(4))

    def __post_init__(self):
        for array in fields(self):
            object.__setattr__(self, array.name, np.array(getattr(self, array.name), dtype=float))

    @staticmethod
    def from_joint_map(joint_map):
        """The numbers of a joint map of gains, arm stiffness and joint 6's waves."""
        terms = joint_map.terms
        gain, fourier = np.zeros(len(terms.arm.joint_names)), np.zeros(4)
        for term, coefficient in zip(terms.terms, terms.coefficients, strict=True):
            if term.basis == "q":
                gain[term.joint] = coefficient
            elif term.basis != "gravity":
                fourier[2 * order(term) - 2 + (term.basis == "sin")] = coefficient
        return ThesisMap(gain, *stiffness_and_phases(joint_map), fourier)

    def joint_map(self, nominal):
        """The same as a sum of terms of a nominal arm; of what is zero without any."""
        terms, values = [], []
        for numbers, make in (
            (self.gain, lambda: GAIN.terms(nominal)),
            (self.stiffness, lambda: stiffness_of(nominal, self.phases)),
            (self.fourier, fourier_of),
        ):
            new = make() if numbers.any() else []
            terms += new
            values += numbers[: len(new)].tolist()
        return JointMap(TermMap(nominal, tuple(terms), np.array(values)))

    def effective(self, q):
        """Effective joints (n, joints), radians (Nubiola 2011, eqs. 3.31, 5.8, 5.14 and 5.15)."""
        q = np.asarray(q, dtype=float)
        theta = q * (1.0 + self.gain)
        if self.stiffness.any():
            (A, B), (phi_2, phi_3) = self.stiffness, self.phases
            fore = B * np.sin(q[:, 1] + q[:, 2] + phi_3)
            theta[:, 1] += A * np.sin(q[:, 1] + phi_2) + fore
            theta[:, 2] += fore
        if self.fourier.any():
            q_6 = q[:, 5]
            theta[:, 5] += self.fourier @ [np.cos(q_6), np.sin(q_6), np.cos(2 * q_6), np.sin(2 * q_6)]
        return theta


def apply(parameters, values, table, joint_map):
    """A nominal DHM table and a `ThesisMap` with error parameters added."""
    columns = {kind: getattr(table, kind).copy() for kind in GEOMETRIC}
    columns |= {kind: getattr(joint_map, kind).copy() for kind in OF_THE_MAP}
    for parameter, value in zip(parameters, values, strict=True):
        columns[parameter.kind][parameter.index] += value
    return (
        replace(table, **{kind: columns[kind] for kind in GEOMETRIC}),
        replace(joint_map, **{kind: columns[kind] for kind in OF_THE_MAP}),
    )
