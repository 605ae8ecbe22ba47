"""The joint map in ``calibration.json``: the thesis's formula, or a sum of terms."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

import numpy as np
from pydantic import Field, field_validator

from irbcal.arrays import FloatArray
from irbcal.errors import RobotError
from irbcal.files.section import Section, Sentence, Word
from irbcal.modeling.arm import Arm
from irbcal.modeling.joint_map import AnyJointMap, JointMap
from irbcal.modeling.terms import bases
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.term_joint_map import TermJointMap
from irbcal.modeling.terms.term_map import SCHEMA, TermMap

TEST_VECTORS = 5
TermEntry: TypeAlias = dict[Word, Word | int | float | list[int | float]]
"""A term as `irbcal.modeling.terms.term.Term.to_json` writes it."""


class TestVector(Section):
    """Commanded joints and the effective joints they give, radians (metres for prismatic joints)."""

    commanded: list[float]
    effective: list[float]


class JointMapSection(Section):
    """The joint map, complete enough to be implemented elsewhere."""

    formula: Literal["irbcal-joint-map-1"]
    equations: list[Sentence]
    gain: list[float]
    stiffness_A_rad: float
    stiffness_B_rad: float
    phi2_rad: float
    phi3_rad: float
    fourier_a1_rad: float
    fourier_b1_rad: float
    fourier_a2_rad: float
    fourier_b2_rad: float
    test_vectors: list[TestVector]

    @staticmethod
    def of(joint_map: JointMap, arm: Arm) -> JointMapSection:
        """The section of a joint map, with test vectors at random joints of the arm."""
        q = arm.random_joints(TEST_VECTORS, seed=1)
        vectors = [
            TestVector(commanded=row.tolist(), effective=effective.tolist())
            for row, effective in zip(q, joint_map.effective(q), strict=True)
        ]
        a1, b1, a2, b2 = joint_map.fourier
        equations = [f"theta_i = q_i + gain_i q_i for i = 1 ... {len(arm.joint_names)} (radians, metres)"]
        if arm.six_revolute:
            equations += [
                "theta_2 += A sin(q_2 + phi2) + B sin(q_2 + q_3 + phi3)",
                "theta_3 += B sin(q_2 + q_3 + phi3)",
                "theta_6 += a1 cos(q_6) + b1 sin(q_6) + a2 cos(2 q_6) + b2 sin(2 q_6)",
            ]
        return JointMapSection(
            formula="irbcal-joint-map-1",
            equations=equations,
            gain=joint_map.gain.tolist(),
            stiffness_A_rad=joint_map.stiffness[0],
            stiffness_B_rad=joint_map.stiffness[1],
            phi2_rad=joint_map.phases[0],
            phi3_rad=joint_map.phases[1],
            fourier_a1_rad=a1,
            fourier_b1_rad=b1,
            fourier_a2_rad=a2,
            fourier_b2_rad=b2,
            test_vectors=vectors,
        )

    def joint_map(self, nominal: Arm) -> JointMap:
        """The joint map that the section describes."""
        return JointMap(
            np.array(self.gain),
            np.array([self.stiffness_A_rad, self.stiffness_B_rad]),
            np.array([self.phi2_rad, self.phi3_rad]),
            np.array([self.fourier_a1_rad, self.fourier_b1_rad, self.fourier_a2_rad, self.fourier_b2_rad]),
        )


def check_terms(terms: list[TermEntry]) -> list[TermEntry]:
    """Terms of a file, refused with a `ValueError` if one is not understood."""
    for entry in terms:
        try:
            term, coefficient, _ = Term.from_json(entry)
        except RobotError as error:
            raise ValueError(str(error)) from None
        if term.basis not in bases() or not np.isfinite(coefficient):
            raise ValueError(f"a term is not understood: {term.name}")
    return terms


class TermVector(Section):
    """Joints with the stop before, both as commanded, and the effective joints that they give, rad (m)."""

    q: list[float]
    previous_q: list[float]
    payload_kg: float
    effective: list[float]
    torques_nm: list[float] | None = None


class TermMapSection(Section):
    """A joint map of terms, complete enough to be implemented elsewhere: docs/calibration-auto.md.

    ``terms`` are those of `irbcal.modeling.terms.term.Term.to_json`; ``gravity`` is a direction in the base link;
    ``ranges`` are the smallest and the largest joints of the fit, rad (m). ``payload_kg`` is the mass that is carried
    where nothing else is said: the one that most poses were measured with; null where it was not told. Links'
    attitudes are those of the nominal robot (``robot.dhm_nominal``) at commanded joints.
    """

    schema_name: Literal["irbcal-joint-map-2"] = Field(alias="schema")
    inputs: list[Word]
    gravity: list[float] = Field(min_length=3, max_length=3)
    terms: list[TermEntry]
    ranges: list[list[float]] = Field(min_length=2, max_length=2)
    payload_kg: float | None = Field(default=None, ge=0.0, allow_inf_nan=False)
    test_vectors: list[TermVector]

    @field_validator("terms")
    @classmethod
    def _understood(cls, terms: list[TermEntry]) -> list[TermEntry]:
        return check_terms(terms)

    @staticmethod
    def of(joint_map: TermJointMap, arm: Arm) -> TermMapSection:
        """The section of a joint map, with test vectors at random joints of the arm."""
        q, before = (arm.random_joints(TEST_VECTORS, seed=seed) for seed in (1, 2))
        ranges = np.array([q.min(axis=0), q.max(axis=0)]) if joint_map.ranges is None else joint_map.ranges
        usual = joint_map.payload_kg or 0.0
        load = np.full(TEST_VECTORS, usual)
        if joint_map.knows_loads:
            load = usual + np.arange(TEST_VECTORS)  # the usual one, and others
        torques = None
        if any(term.basis == "torque" for term in joint_map.terms.terms):
            torques = np.random.default_rng(3).normal(0.0, 50.0, q.shape)
        motion = Motion(q, q - before, payload_kg=load, torques=torques)
        return TermMapSection(**joint_map.terms.to_json(ranges, motion), payload_kg=joint_map.payload_kg)

    def joint_map(self, nominal: Arm) -> TermJointMap:
        """The joint map that the section describes, of a nominal arm."""
        content: dict[str, Any] = {"schema": SCHEMA, "gravity": self.gravity, "terms": self.terms}
        ranges: FloatArray = np.array(self.ranges)
        if ranges.shape != (2, len(nominal.joint_names)):
            raise RobotError(f"the joint map's ranges need two rows of {len(nominal.joint_names)} joints")
        return TermJointMap(TermMap.from_json(nominal, content), ranges, self.payload_kg)


def section_of(joint_map: AnyJointMap, arm: Arm) -> JointMapSection | TermMapSection:
    """The section of either kind of joint map; test vectors are within the arm's limits."""
    if isinstance(joint_map, TermJointMap):
        return TermMapSection.of(joint_map, arm)
    assert isinstance(joint_map, JointMap)
    return JointMapSection.of(joint_map, arm)
