"""The joint map in ``calibration.json``: a sum of terms."""

from __future__ import annotations

from typing import Any, Literal, TypeAlias

import numpy as np
from pydantic import Field, field_validator

from irbcal.errors import RobotError
from irbcal.files.section import Section, Word
from irbcal.modeling.arm import Arm
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.terms import bases
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.term_map import SCHEMA, TermMap

TEST_VECTORS = 5
TermEntry: TypeAlias = dict[Word, Word | int | float | list[int | float]]
"""A term as `irbcal.modeling.terms.term.Term.to_json` writes it."""


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


class JointMapSection(Section):
    """A joint map of terms, complete enough to be implemented elsewhere: docs/calibration-auto.md.

    ``terms`` are those of `irbcal.modeling.terms.term.Term.to_json`; ``gravity`` is a direction in the base link;
    ``ranges`` are the smallest and the largest joints of the fit, rad (m), null for levels of the thesis, whose terms
    hold beyond them. ``payload_kg`` is the mass that is carried
    where nothing else is said: the one that most poses were measured with; null where it was not told. Links'
    attitudes are those of the nominal robot (``robot.dhm_nominal``) at commanded joints.
    """

    schema_name: Literal["irbcal-joint-map-2"] = Field(alias="schema")
    inputs: list[Word]
    gravity: list[float] = Field(min_length=3, max_length=3)
    terms: list[TermEntry]
    ranges: list[list[float]] | None = Field(default=None, min_length=2, max_length=2)
    payload_kg: float | None = Field(default=None, ge=0.0, allow_inf_nan=False)
    test_vectors: list[TermVector]

    @field_validator("terms")
    @classmethod
    def _understood(cls, terms: list[TermEntry]) -> list[TermEntry]:
        return check_terms(terms)

    @staticmethod
    def of(joint_map: JointMap, arm: Arm) -> JointMapSection:
        """The section of a joint map, with test vectors at random joints of the arm."""
        q, before = (arm.random_joints(TEST_VECTORS, seed=seed) for seed in (1, 2))
        usual = joint_map.payload_kg or 0.0
        load = np.full(TEST_VECTORS, usual)
        if joint_map.knows_loads:
            load = usual + np.arange(TEST_VECTORS)  # the usual one, and others
        torques = None
        if any(term.basis == "torque" for term in joint_map.terms.terms):
            torques = np.random.default_rng(3).normal(0.0, 50.0, q.shape)
        motion = Motion(q, q - before, payload_kg=load, torques=torques)
        return JointMapSection(**joint_map.terms.to_json(joint_map.ranges, motion), payload_kg=joint_map.payload_kg)

    def joint_map(self, nominal: Arm) -> JointMap:
        """The joint map that the section describes, of a nominal arm."""
        content: dict[str, Any] = {"schema": SCHEMA, "gravity": self.gravity, "terms": self.terms}
        ranges = None if self.ranges is None else np.array(self.ranges)
        if ranges is not None and ranges.shape != (2, len(nominal.joint_names)):
            raise RobotError(f"the joint map's ranges need two rows of {len(nominal.joint_names)} joints")
        return JointMap(TermMap.from_json(nominal, content), ranges, self.payload_kg)
