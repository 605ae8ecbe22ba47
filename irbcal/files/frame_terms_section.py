"""Frame terms in ``calibration.json``: what neither URDF nor joint map can carry."""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import Field, field_validator

from irbcal.errors import CalibrationError
from irbcal.files.joint_map_section import TEST_VECTORS, TermEntry, check_terms
from irbcal.files.section import Name, Section
from irbcal.modeling.arm import Arm
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms.term_map import SCHEMA, TermMap
from irbcal.units import MM

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
    terms: list[TermEntry]
    test_vectors: list[FrameVector]

    @field_validator("terms")
    @classmethod
    def _understood(cls, terms: list[TermEntry]) -> list[TermEntry]:
        return check_terms(terms)

    @staticmethod
    def of_robot(robot: Robot) -> FrameTermsSection | None:
        """The section of a robot; None for one without frame terms."""
        if robot.frame_terms is None:
            return None
        q, before = (robot.arm.random_joints(TEST_VECTORS, seed=seed) for seed in (1, 2))
        ranges = getattr(robot.joint_map, "ranges", None)
        low, high = (robot.arm.lower, robot.arm.upper) if ranges is None else ranges
        inside = np.random.default_rng(0).uniform(low, high, (SAMPLES, len(low)))
        moved = robot.moved_by_frame_terms(inside) / MM
        vectors = [
            FrameVector(q=a.tolist(), previous_q=b.tolist(), T_base_tip=T.tolist())
            for a, b, T in zip(q, before, robot.forward(q, before), strict=True)
        ]
        written = robot.frame_terms.to_json()
        return FrameTermsSection(
            schema="irbcal-frame-terms-1",
            of=next(iter(robot.targets), robot.arm.tip_link),
            median_mm=float(np.median(moved)),
            largest_mm=float(moved.max()),
            gravity=written["gravity"],
            terms=written["terms"],
            test_vectors=vectors,
        )

    def term_map(self, nominal: Arm) -> TermMap:
        """The frame terms that the section describes, of a nominal arm."""
        return TermMap.from_json(nominal, {"schema": SCHEMA, "gravity": self.gravity, "terms": self.terms})

    @property
    def in_words(self) -> str:
        """What is not in URDF and joint map, and how much that is."""
        return (
            "URDF and joint map are NOT the whole truth of this calibration: its frame terms (terms all), which only "
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
