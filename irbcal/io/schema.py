"""What stands in ``calibration.json``: a checked schema, and the robots that it describes."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from pydantic import PrivateAttr, StringConstraints, model_validator

from irbcal.arrays import FloatArray
from irbcal.identification.feature_sections import FeaturesSection
from irbcal.identification.fit_sections import (
    AverageChoice,
    LevelChoice,
    ModelAverage,
    Observability,
    ParameterReport,
)
from irbcal.io import urdf_check
from irbcal.io.packed_covariance import PackedCovariance
from irbcal.io.point_tables import PointTable, PoseTable, used_points
from irbcal.io.robot_section import FilePose, JointOrigin, Placement, RobotSection, Three
from irbcal.io.term_sections import FrameTermsSection, JointMapSection
from irbcal.io.urdf_check import UrdfCheck
from irbcal.measurement.cleaning import Exclusion
from irbcal.measurement.points import Errors, PointSet
from irbcal.modeling.arm import Arm
from irbcal.modeling.certainty import Certainty, FitLimits
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.parameters import all_names, parameter, term_of
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms.term import Term
from irbcal.modeling.workspace_coverage import WorkspaceCoverage
from irbcal.section import Date, Fingerprint, Name, Section, Sentence, Sha256, Version, Word
from irbcal.units import MM, UNIT_OUTSIDE


class CertaintySection(FitLimits):
    """What intervals need, with what is expected elsewhere in the workspace: null where nothing is known of it."""

    workspace_coverage: WorkspaceCoverage | None = None

    def doubts(self) -> list[str]:
        """The doubt, in a sentence, where the poses of the fit cover only a corner of the workspace."""
        coverage = self.workspace_coverage
        return [coverage.in_words()] if coverage is not None and coverage.narrow else []


FileName: TypeAlias = Annotated[str, StringConstraints(pattern=r"^[0-9A-Za-z][0-9A-Za-z._-]{0,99}$")]
"""Of a file in the folder itself."""


class Seal(Section):
    """Hashes of all other parts and of all other files, by name, and a line for every deliberate change since."""

    parts: dict[Word, Sha256]
    files: dict[FileName, Sha256]
    changes: list[Sentence]


class SessionSection(Section):
    """A session: its base in its own measuring frame. Its targets are the placement's with its name behind ``@``.

    The last session's frame is that of the calibration: its base is the placement's, and its targets have plain names.
    """

    name: Name
    base: FilePose


class ReachedObjective(Section):
    """What was minimised and what was reached."""

    name: Literal["rms", "max", "pnorm"]
    value_mm: float
    lower_bound_mm: float | None


class DataFile(Section):
    """A data file and its fingerprint; ``programmed``: it has programmed joints, which the model takes."""

    file: Name
    sha256: Sha256
    programmed: bool


class Computed(dict[str, tuple[tuple[object, ...], Any]]):
    """What was computed from a record already; no part of what it says, so records are equal without it."""

    def get_or_make(self, name: str, parts: tuple[object, ...], make: Callable[[], Any]) -> Any:
        """What ``make`` gives; made again where one of the parts that it comes from is another object by now."""
        if name not in self or any(a is not b for a, b in zip(self[name][0], parts, strict=True)):
            self[name] = parts, make()
        return self[name][1]

    def __eq__(self, value: object) -> bool:
        return isinstance(value, Computed)

    __hash__ = None

    def __reduce__(self) -> tuple[type, tuple[()]]:
        return Computed, ()


class Record(Section):
    """Content of ``calibration.json``.

    ``fingerprint`` (`irbcal.io.integrity.fingerprint`) stands in the URDF, too. ``frame_terms`` are null where URDF and
    joint map are the whole truth. ``covariance`` is that of base (rotation vector and translation in the base link),
    unknown targets, target frames (rotation vectors in the tip link), bases of sessions before the last and error
    parameters, in the order of ``parameters``, in metres and radians: see `covariance_matrix`. ``sessions`` are empty
    where there is one only; ``earlier`` is the fingerprint of the calibration that was added to. ``mesh_folders`` are
    those in which meshes of the robot's URDF lay, where no reader looks of itself; null where there are none.
    ``features`` are there where rows at features were measured: errors are then distances from these, and poses count
    among the fitted and, each with its place held out in turn, among the held-out ones. ``seal``
    (`irbcal.io.integrity`) has the hashes of all other parts and of all files beside it; null until it is written.
    """

    schema_name: Literal["irbcal-calibration-1"]
    created: Date
    simulated: bool
    fingerprint: Fingerprint
    calibrated_urdf_sha256: Sha256
    robot: RobotSection
    joint_origins: list[JointOrigin]
    model: Word
    method: Word
    objective: ReachedObjective
    choice: LevelChoice | AverageChoice | None
    evidence: ModelAverage | None
    rank: int
    parameter_count: int
    parameters: list[ParameterReport]
    covariance: PackedCovariance
    certainty: CertaintySection
    undetermined: list[Sentence]
    observability: Observability
    history: dict[Name, list[float]]
    joint_map: JointMapSection
    frame_terms: FrameTermsSection | None
    placement: Placement
    placement_nominal: Placement
    sessions: list[SessionSection]
    earlier: Fingerprint | None
    references_mm: dict[Name, Three]
    tool_shape_mm: dict[Name, Three]
    fit: Errors
    fit_nominal: Errors
    heldout: Errors | None
    heldout_nominal: Errors | None
    heldout_least_squares: Errors | None
    poses_fit: int
    poses_heldout: int
    poses_excluded: int
    features: FeaturesSection | None
    points: PointTable
    poses: PoseTable
    excluded: list[Exclusion]
    notes: list[Sentence]
    doubts: list[Sentence]
    data: list[DataFile]
    mesh_folders: list[Sentence] | None = None
    urdf_witnesses: UrdfCheck
    largest_link_shift_mm: float
    software: dict[Word, Version]
    seconds: float
    seal: Seal | None = None

    _computed: Computed = PrivateAttr(default_factory=Computed)

    def __repr__(self) -> str:
        kind = "SIMULATED, " if self.simulated else ""
        proof = "nothing held out" if self.heldout is None else f"held-out mean {self.heldout.all.mean_mm:.3f} mm"
        return f"<Record of {self.robot.name}: {kind}model {self.model}, {proof}>"

    __str__ = __repr__

    @property
    def programmed(self) -> bool:
        """Whether it was made from programmed joints, not from joint readings."""
        return bool(self.data) and self.data[0].programmed

    @property
    def expected_error(self) -> float | None:
        """Mean error of held-out measurements of places, metres; None without, and where they are distances only."""
        return None if self.heldout is None or self.features is not None else self.heldout.all.mean_mm * MM

    @property
    def usual_load(self) -> float | None:
        """The payload that it is for where none is told, kg; None if it is not known."""
        return self.joint_map.payload_kg

    @model_validator(mode="after")
    def _points_of_known_poses(self) -> Record:
        p, rows = self.poses, self.points.row
        if rows:
            row, is_heldout = np.array(rows), np.array(self.points.heldout, dtype=bool)
            complete = ((row >= 0) & (row < len(p.pose))).all()
            if not complete or (np.array(p.heldout, dtype=bool)[row] != is_heldout).any():
                raise ValueError("a point belongs to a pose that is not among the poses")
        if len(p.joints) != len(self.robot.joint_names):
            raise ValueError(f"poses have {len(p.joints)} joints, the robot has {len(self.robot.joint_names)}")
        return self

    def arm(self, calibrated: bool = True) -> Arm:
        """The calibrated (or nominal) arm as an `irbcal.modeling.arm.Arm`."""
        return self.robot.arm(calibrated)

    def notes_to_read(self) -> list[str]:
        """Notes, and what reflectors of unknown place leave open of base and flange."""
        certainty = self.robot_calibrated().certainty
        ends = "" if certainty is None else certainty.open_ends_in_words()
        return [*self.notes, *filter(None, [ends])]

    def robot_calibrated(self) -> Robot:
        """The calibrated robot: predicts points and poses from commanded joints, and says how well it knows them."""
        moved_by = (self.robot, self.joint_map, self.frame_terms, self.placement)
        known_by = (self.parameters, self.covariance, self.certainty)
        return self._computed.get_or_make("robot", (*moved_by, *known_by), self._robot_calibrated)

    def errors_of_joints(self) -> JointMap:
        """The joint map that section `joint_map` describes."""
        parts = (self.robot, self.joint_map)
        return self._computed.get_or_make("joint_map", parts, lambda: parts[1].joint_map(self.arm(calibrated=False)))

    def _robot_calibrated(self) -> Robot:
        nominal = self.arm(calibrated=False)
        frame_terms = None if self.frame_terms is None else self.frame_terms.term_map(nominal)
        robot = Robot(self.arm(), self.errors_of_joints(), *self.placement.base_and_targets(), frame_terms=frame_terms)
        return robot.replace(certainty=self._certainty(robot))

    def with_urdf(self, data: bytes) -> Record:
        """The same with another URDF of the same geometry, checked by `urdf_check.check`.

        Raises
        ------
        CalibrationError
            If one of them disagrees.
        """
        sha256 = hashlib.sha256(data).hexdigest()
        if sha256 == self.calibrated_urdf_sha256:
            return self
        check = urdf_check.check(data, self.arm())
        return self.model_copy(update={"calibrated_urdf_sha256": sha256, "urdf_witnesses": check})

    def covariance_matrix(self) -> FloatArray:
        """``covariance`` as an array, shape (k, k), metres and radians."""
        return self.covariance.matrix()

    def _certainty(self, robot: Robot) -> Certainty:
        nominal = self.arm(calibrated=False)
        listed = {row.name for row in self.parameters}
        terms: dict[str, Term] = {term.name: term for term in robot.joint_map.terms.terms}
        if robot.frame_terms is not None:
            terms |= {term.name: term for term in robot.frame_terms.terms}
        named = listed & set(all_names(nominal))
        terms_by_name = {name: term_of(parameter(name), nominal) for name in named} | terms
        # row by row, as the columns of the covariance are: terms of two families may be the same function
        rows = [row for row in self.parameters if row.name in terms_by_name]
        factor = dict(UNIT_OUTSIDE.values())
        return Certainty(
            nominal=nominal,
            terms=tuple(terms_by_name[row.name] for row in rows),
            covariance=self.covariance_matrix(),
            fitted_targets=tuple(name for name in robot.targets if f"target_{name}_x" in listed),
            coefficients=np.array([row.value * factor.get(row.unit, 1.0) for row in rows]),
            limits=self.certainty,
        )

    def robot_nominal(self) -> Robot:
        """The nominal robot with base and tool identified from the same poses."""
        nominal = self.arm(calibrated=False)
        return Robot(nominal, JointMap.identity(nominal), *self.placement_nominal.base_and_targets())

    def used_points(self, heldout: bool | None) -> tuple[PointSet, FloatArray] | None:
        """The used points, fitted or held out or (None) both, and the directions from which their joints were reached.

        Returns
        -------
        points : PointSet
        came_from : ndarray, shape (n, joints)
            1: from below, -1: from above, 0: not known.

        ``None`` in place of both for calibrations that were saved without measured places.
        """
        t, p = self.points, self.poses
        if not t.x_mm:
            return None
        name = {True: "held-out points", False: "fitted points", None: "all points"}[heldout]
        return self._computed.get_or_make(name, (t, p), lambda: used_points(t, p, self.robot.joint_units, heldout))

    def tool_shape(self) -> dict[str, FloatArray]:
        """Places of the reflectors that make up the tool's pose, dict of arrays (3,), metres; empty if none do."""
        return {name: np.array(xyz) * MM for name, xyz in self.tool_shape_mm.items()}

    def reference_places(self) -> dict[str, FloatArray]:
        """Places of the reference points in the measuring frame, dict of arrays (3,), metres."""
        return {name: np.array(xyz) * MM for name, xyz in self.references_mm.items()}
