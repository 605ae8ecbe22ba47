"""Joint map and frame terms as ``calibration.json`` has them: for others to implement, with test vectors.

In memory they are compiled (`irbcal.modeling.joint_map`); here each term stands by itself, in the file's units.
"""

from __future__ import annotations

from typing import Annotated, Literal, TypeAlias

import numpy as np
from pydantic import AfterValidator, Field

from irbcal.errors import CalibrationError, RobotError
from irbcal.modeling.arm import Arm
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms import bases, inputs
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.term_map import TermMap
from irbcal.section import Name, Section, Word
from irbcal.units import MM

TEST_VECTORS = 5
TermEntry: TypeAlias = dict[Word, Word | int | float | list[int | float]]
"""A term as `irbcal.modeling.terms.term.Term.to_json` writes it."""


def _understood(terms: list[TermEntry]) -> list[TermEntry]:
    """Terms of a file, refused with a `ValueError` if one is not understood."""
    for entry in terms:
        try:
            term, coefficient, _ = Term.from_json(entry)
        except RobotError as error:
            raise ValueError(str(error)) from None
        if term.basis not in bases() or not np.isfinite(coefficient):
            raise ValueError(f"a term is not understood: {term.name}")
    return terms


TermEntries: TypeAlias = Annotated[list[TermEntry], AfterValidator(_understood)]


class TermVector(Section):
    """Joints with the stop before, both as commanded, and the effective joints that they give, rad (m).

    ``inputs`` are what else the terms are functions of: numbers of the pose, or of each joint.
    """

    q: list[float]
    previous_q: list[float]
    inputs: dict[Word, float | list[float]]
    effective: list[float]


class JointMapSection(Section):
    """A joint map of terms, complete enough to be implemented elsewhere: docs/calibration-auto.md.

    ``terms`` are those of `irbcal.modeling.terms.term.Term.to_json`; ``gravity`` is a direction in the base link;
    ``ranges`` are the smallest and the largest joints of the fit, rad (m), null for levels of the thesis, whose terms
    hold beyond them. ``payload_kg`` is the mass that is carried
    where nothing else is said: the one that most poses were measured with; null where it was not told. Links'
    attitudes are those of the nominal robot (``robot.dhm_nominal``) at commanded joints.
    """

    schema_name: Literal["irbcal-joint-map-1"] = Field(alias="schema")
    inputs: list[Word]
    gravity: list[float] = Field(min_length=3, max_length=3)
    terms: TermEntries
    ranges: list[list[float]] | None = Field(default=None, min_length=2, max_length=2)
    payload_kg: float | None = Field(default=None, ge=0.0, allow_inf_nan=False)
    test_vectors: list[TermVector]

    @staticmethod
    def from_joint_map(joint_map: JointMap, arm: Arm) -> JointMapSection:
        """The section of a joint map, with test vectors at random joints of the arm."""
        q, q_before, load = arm.random_stops(TEST_VECTORS, joint_map.payload_kg or 0.0, joint_map.knows_loads)
        rng, random_inputs = np.random.default_rng(3), {"payload_kg": load}
        for quantity in (quantity for term in joint_map.terms.terms for quantity in bases()[term.basis].inputs):
            if quantity.name not in random_inputs and not quantity.per_pose:
                random_inputs[quantity.name] = quantity.usual + rng.normal(0.0, 50.0, quantity.shape(q.shape))
        motion, terms = Motion(q, q - q_before, inputs=random_inputs), joint_map.terms
        effective = terms.effective(motion)
        known = {quantity for name in {term.basis for term in terms.terms} for quantity in bases()[name].inputs}
        return JointMapSection(
            schema="irbcal-joint-map-1",
            inputs=["q", "previous_q", *(name for name, quantity in inputs().items() if quantity in known)],
            gravity=[*terms.gravity],
            terms=terms.entries(),
            ranges=None if joint_map.ranges is None else joint_map.ranges.tolist(),
            payload_kg=joint_map.payload_kg,
            test_vectors=[
                TermVector(
                    q=q[k].tolist(),
                    previous_q=(q[k] - motion.moves[k]).tolist(),
                    inputs={name: np.asarray(values)[k].tolist() for name, values in random_inputs.items()},
                    effective=effective[k].tolist(),
                )
                for k in range(TEST_VECTORS)
            ],
        )

    def joint_map(self, nominal: Arm) -> JointMap:
        """The joint map that the section describes, of a nominal arm."""
        ranges = None if self.ranges is None else np.array(self.ranges)
        if ranges is not None and ranges.shape != (2, len(nominal.joint_names)):
            raise RobotError(f"the joint map's ranges need two rows of {len(nominal.joint_names)} joints")
        return JointMap(TermMap.of_entries(nominal, self.terms, self.gravity), ranges, self.payload_kg)


SAMPLES = 1000
"""Poses within the joint ranges of the fit at which their size is told."""


class FrameVector(Section):
    """Commanded joints, the stop before, and the tip in the base link with joint map and frame terms, rad and m."""

    q: list[float]
    previous_q: list[float]
    T_base_tip: list[list[float]]


class FrameTermsSection(Section):
    """Small motions of the joints' frames before each joint turns: docs/calibration-auto.md.

    ``terms`` are written as those of the joint map, with axes ``rx``, ``ry``, ``rz``, ``tx``, ``ty``, ``tz`` of the
    joint's frame in the calibrated DHM table. ``median_mm`` and ``largest_mm``: by how much they move ``of`` (a target
    or the tip) within the joint ranges of the fit, which is what a robot described by URDF and joint map alone misses.
    """

    schema_name: Literal["irbcal-frame-terms-1"] = Field(alias="schema")
    of: Name
    median_mm: float
    largest_mm: float
    gravity: list[float] = Field(min_length=3, max_length=3)
    terms: TermEntries
    test_vectors: list[FrameVector]

    @staticmethod
    def of_robot(robot: Robot) -> FrameTermsSection | None:
        """The section of a robot; None for one without frame terms."""
        if robot.frame_terms is None:
            return None
        q, q_before, *_ = robot.arm.random_stops(TEST_VECTORS)
        ranges = robot.joint_map.ranges
        low, high = (robot.arm.lower, robot.arm.upper) if ranges is None else ranges
        inside = np.random.default_rng(0).uniform(low, high, (SAMPLES, len(low)))
        moved = robot.moved_by_frame_terms(inside) / MM
        vectors = [
            FrameVector(q=a.tolist(), previous_q=b.tolist(), T_base_tip=T.tolist())
            for a, b, T in zip(q, q_before, robot.forward(q, q_before), strict=True)
        ]
        return FrameTermsSection(
            schema="irbcal-frame-terms-1",
            of=next(iter(robot.targets), robot.arm.tip_link),
            median_mm=float(np.median(moved)),
            largest_mm=float(moved.max()),
            gravity=[*robot.frame_terms.gravity],
            terms=robot.frame_terms.entries(),
            test_vectors=vectors,
        )

    def term_map(self, nominal: Arm) -> TermMap:
        """The frame terms that the section describes, of a nominal arm."""
        return TermMap.of_entries(nominal, self.terms, self.gravity)

    @property
    def in_words(self) -> str:
        """What is not in URDF and joint map, and how much that is."""
        return (
            "URDF and joint map are INCOMPLETE: the frame terms of this calibration (terms all), which only "
            f"irbcal's own kinematics knows, move {self.of} by {self.median_mm:.3f} mm in the median and by up to "
            f"{self.largest_mm:.3f} mm within the joint ranges of the fit. For planners and other programs calibrate "
            "with terms joint-map."
        )

    def refuse(self) -> None:
        """Refuse to go on with URDF and joint map alone.

        Raises
        ------
        CalibrationError
            Always: it says what they miss.
        """
        raise CalibrationError(
            f"{self.in_words} To plan without them give without_frame_terms=True", parameter="without_frame_terms"
        )
