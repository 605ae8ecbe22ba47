"""What stands in ``calibration.json``: a checked schema, and the robots that it describes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal, TypeAlias

import numpy as np
from pydantic import Field, PrivateAttr, model_validator

from irbcal.arrays import FloatArray
from irbcal.files.certainty_section import CertaintySection, CovarianceSection, in_metres, matrix_of
from irbcal.files.choice_section import Choice, EvidenceChoice, EvidenceSection
from irbcal.files.features_section import FeaturesSection
from irbcal.files.frame_terms_section import FrameTermsSection
from irbcal.files.joint_map_section import JointMapSection, TermMapSection
from irbcal.files.point_tables import PointTable, PoseTable
from irbcal.files.seal import Seal
from irbcal.files.section import Section
from irbcal.identification.level_certainty import term_of
from irbcal.measurement.points import PointSet
from irbcal.modeling import coupling, frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.certainty import Certainty
from irbcal.modeling.dhm import DHMTable
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.parameters import all_names, parameter
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.term_joint_map import TermJointMap
from irbcal.units import DEG, MM, UNIT_OUTSIDE

Three: TypeAlias = Annotated[list[float], Field(min_length=3, max_length=3)]
"""A place, or three angles."""
Quaternion: TypeAlias = Annotated[list[float], Field(min_length=4, max_length=4)]
"""Scalar first."""
Matrix: TypeAlias = Annotated[list[Quaternion], Field(min_length=4, max_length=4)]
"""A rigid frame, row by row."""


class Statistics(Section):
    """Statistics of distances between measured and predicted points, mm."""

    n: int
    mean_mm: float
    sigma_mm: float
    max_mm: float
    mean_plus_3sigma_mm: float
    rms_mm: float


class Row(Section):
    """One row of a DHM table; ``beta`` is Hayati's tilt about y, ``b`` a shift along y."""

    alpha_deg: float
    a_mm: float
    theta_deg: float
    d_mm: float
    beta_deg: float
    b_mm: float


class Pose(Section):
    """A frame: position and unit quaternion, scalar first."""

    x_mm: float
    y_mm: float
    z_mm: float
    qw: float
    qx: float
    qy: float
    qz: float


class RobotSection(Section):
    """The arm: names, limits (null where there is none) and the constant frames around the DHM chain.

    Joint types are ``revolute`` and ``prismatic``; limits are in degrees and mm.
    """

    name: str
    urdf: str
    urdf_sha256: str
    base_link: str
    tip_link: str
    joint_names: list[str]
    joint_types: list[Literal["revolute", "prismatic"]]
    lower: list[float | None]
    upper: list[float | None]
    base_to_frame0: Matrix
    last_frame_to_tip: Matrix
    dhm_nominal: list[Row]
    dhm_calibrated: list[Row]
    coupling: list[list[float]] | None = None


class Origin(Section):
    """A joint frame in its parent link, as URDF has it: metres, and radians about fixed axes."""

    xyz_m: Three
    rpy_rad: Three

    @staticmethod
    def of(T: FloatArray) -> Origin:
        """From a transform, shape (4, 4)."""
        return Origin(xyz_m=(T[:3, 3] + 0.0).tolist(), rpy_rad=(frames.rpy_from_matrix(T[:3, :3]) + 0.0).tolist())

    def transform(self) -> FloatArray:
        """As a transform, shape (4, 4)."""
        return frames.transform(frames.matrix_from_rpy(np.array(self.rpy_rad)), self.xyz_m)


class JointOrigin(Section):
    """Nominal and calibrated origin of one joint of the chain; ``link`` is its child link."""

    joint: str
    link: str
    nominal: Origin
    calibrated: Origin


class Parameter(Section):
    """One identified, tied or held parameter; ``low`` to ``high`` is its 95 % interval."""

    name: str
    value: float
    unit: str
    std: float | None
    low: float | None
    high: float | None
    state: Literal["identified", "tied", "held"]
    reason: str


class Placement(Section):
    """Base in the measuring frame; targets (mm) and target frames (unit quaternion, scalar first) in the tip link."""

    base: Pose
    targets: dict[str, Three]
    target_quaternions: dict[str, Quaternion]


class RotationStatistics(Section):
    """Statistics of the angles between measured and predicted target frames, degrees."""

    n: int
    mean_deg: float
    sigma_deg: float
    max_deg: float


class Errors(Section):
    """Statistics of one set of poses, all points, by target and by group; of orientations where measured."""

    all: Statistics
    orientation: RotationStatistics | None
    per_target: dict[str, Statistics]
    per_group: dict[str, Statistics]


class SessionSection(Section):
    """A session: its base in its own measuring frame. Its targets are the placement's with its name behind ``@``.

    The last session's frame is that of the calibration: its base is the placement's, and its targets have plain names.
    """

    name: str
    base: Pose


class Exclusion(Section):
    """A point that was left out, with the reason."""

    pose: str
    target: str
    reason: str


class Objective(Section):
    """What was minimised and what was reached."""

    name: Literal["rms", "max", "pnorm"]
    value_mm: float
    lower_bound_mm: float | None


class Correlation(Section):
    """Two parameters that the data can hardly tell apart."""

    first: str
    second: str
    coefficient: float


class Observability(Section):
    """What the poses can show of the error parameters, base and targets eliminated.

    Singular values (mm) are those of the Jacobian scaled by plausible sizes; ``indices`` are O1 to O5 and the condition
    number over the seen directions.
    """

    singular_values_mm: list[float]
    seen: int
    indices: dict[str, float]
    correlations: list[Correlation]


class DataFile(Section):
    """A data file and its fingerprint; ``programmed``: it has programmed joints, which the model takes."""

    file: str
    sha256: str
    programmed: bool = False


class Check(Section):
    """Largest disagreement with Pinocchio and yourdfpy on the written URDF."""

    position_m: float
    rotation_rad: float
    poses: int
    yourdfpy_poses: int = 0


class Kept(dict[bool, tuple[PointTable, PoseTable, PointSet, FloatArray]]):
    """Points of a record that were computed already; no part of what it says, so records are equal without it."""

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Kept)

    __hash__ = None

    def __reduce__(self) -> tuple[type, tuple[()]]:
        return Kept, ()


class Record(Section):
    """Content of ``calibration.json``.

    ``fingerprint`` stands in the URDF, too: it is that of the joint origins, the joint map, frame terms and the data
    files. ``frame_terms`` are null where URDF and joint map are the whole truth.
    ``covariance`` is that of base (rotation vector and translation in the base link), unknown targets, target frames
    (rotation vectors in the tip link), bases of sessions before the last and error parameters, in the order of
    ``parameters``, in metres and radians: see `covariance_matrix`. Files of earlier versions have it number by number,
    and no ``certainty``. ``sessions`` are empty where there is one only; ``earlier`` is the fingerprint of the
    calibration that was added to. ``features`` are
    there where rows at features were measured: errors are then distances from these, and poses count among the fitted
    and, each with its place left out in turn, among the held-out ones. ``seal`` has the hashes of all other parts
    (`irbcal.files.seal`); null in files of earlier versions.
    """

    schema_name: Literal["irbcal-calibration-1"]
    created: str
    simulated: bool
    fingerprint: str
    calibrated_urdf_sha256: str
    robot: RobotSection
    joint_origins: list[JointOrigin]
    model: str
    method: str
    objective: Objective
    choice: Choice | EvidenceChoice | None
    evidence: EvidenceSection | None = None
    rank: int
    parameter_count: int
    parameters: list[Parameter]
    covariance: CovarianceSection | list[list[float]]
    certainty: CertaintySection | None = None
    held: list[str]
    observability: Observability
    history: dict[str, list[float]]
    joint_map: Annotated[JointMapSection | TermMapSection, Field(union_mode="left_to_right")]
    frame_terms: FrameTermsSection | None = None
    placement: Placement
    placement_nominal: Placement
    sessions: list[SessionSection] = Field(default_factory=list)
    earlier: str | None = None
    references_mm: dict[str, Three]
    tool_shape_mm: dict[str, Three]
    fit: Errors
    fit_nominal: Errors
    heldout: Errors | None
    heldout_nominal: Errors | None
    heldout_least_squares: Errors | None
    poses_fit: int
    poses_heldout: int
    poses_excluded: int
    features: FeaturesSection | None = None
    points: PointTable
    poses: PoseTable | None = None
    excluded: list[Exclusion]
    notes: list[str]
    doubts: list[str] = Field(default_factory=list)
    data: list[DataFile]
    pinocchio_check: Check
    largest_link_shift_mm: float
    software: dict[str, str]
    seconds: float
    seal: Seal | None = None

    _used: Kept = PrivateAttr(default_factory=Kept)

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
    def usual_load(self) -> float | None:
        """The payload that it is for where none is told, kg; None if it is not known, or for levels of the thesis."""
        return self.joint_map.payload_kg if isinstance(self.joint_map, TermMapSection) else None

    @model_validator(mode="after")
    def _points_of_known_poses(self) -> Record:
        p, rows = self.poses, self.points.row
        if p is not None and rows:
            row, aside = np.array(rows), np.array(self.points.heldout, dtype=bool)
            there = ((row >= 0) & (row < len(p.pose))).all()
            if not there or (np.array(p.heldout, dtype=bool)[row] != aside).any():
                raise ValueError("a point belongs to a pose that is not among the poses")
        if p is not None and len(p.joints) != len(self.robot.joint_names):
            raise ValueError(f"poses have {len(p.joints)} joints, the robot has {len(self.robot.joint_names)}")
        return self

    def arm(self, calibrated: bool = True) -> Arm:
        """The calibrated (or nominal) arm as an `irbcal.modeling.arm.Arm`."""
        section = self.robot
        slides = [kind == "prismatic" for kind in section.joint_types]

        def limits(sign: int, values: Sequence[float | None]) -> FloatArray:
            units = [MM if sliding else DEG for sliding in slides]
            pairs = zip(values, units, strict=True)
            return np.array([sign * np.inf if value is None else value * unit for value, unit in pairs])

        return Arm(
            section.name,
            _table(section.dhm_calibrated if calibrated else section.dhm_nominal, slides),
            np.array(section.base_to_frame0),
            np.array(section.last_frame_to_tip),
            tuple(section.joint_names),
            limits(-1, section.lower),
            limits(1, section.upper),
            section.base_link,
            section.tip_link,
            coupling.matrix(section.coupling, len(slides)),
        )

    def robot_calibrated(self) -> Robot:
        """The calibrated robot: predicts points and poses from commanded joints, and says how well it knows them."""
        nominal = self.arm(calibrated=False)
        frame_terms = None if self.frame_terms is None else self.frame_terms.term_map(nominal)
        joint_map = self.joint_map.joint_map(nominal)
        robot = Robot(self.arm(), joint_map, *_placed(self.placement), frame_terms=frame_terms)
        return robot.replace(certainty=self._certainty(robot))

    def covariance_matrix(self) -> FloatArray:
        """``covariance`` as an array, shape (k, k), metres and radians."""
        return matrix_of(self.covariance)

    def _certainty(self, robot: Robot) -> Certainty:
        nominal = self.arm(calibrated=False)
        listed = {row.name for row in self.parameters}
        terms: dict[str, Term] = {}
        if isinstance(robot.joint_map, TermJointMap):
            terms = {term.name: term for term in robot.joint_map.terms.terms}
        if robot.frame_terms is not None:
            terms |= {term.name: term for term in robot.frame_terms.terms}
        known = {name: term_of(parameter(name), nominal) for name in listed if name in all_names(nominal)} | terms
        # row by row, as the columns of the covariance are: terms of two families may be the same function
        rows = [row for row in self.parameters if row.name in known]
        factor = dict(UNIT_OUTSIDE.values())
        section, evidence = self.certainty, self.evidence
        loo: dict[str, float | None] = {}
        fifths, ranges = loo, None
        if section is not None:
            loo, fifths = section.leave_one_out_mm, section.leave_fifths_out_mm
            ranges = np.array(section.ranges)
        elif evidence is not None and isinstance(robot.joint_map, TermJointMap):
            loo, fifths = evidence.leave_one_out_mm, evidence.leave_fifths_out_mm
            ranges = robot.joint_map.ranges
        return Certainty(
            nominal=nominal,
            terms=tuple(known[row.name] for row in rows),
            covariance=self.covariance_matrix(),
            free_targets=tuple(name for name in robot.targets if f"target_{name}_x" in listed),
            coefficients=np.array([row.value * factor.get(row.unit, 1.0) for row in rows]),
            loo=in_metres(loo),
            loo_blocks=in_metres(fifths),
            ranges=ranges,
        )

    def robot_nominal(self) -> Robot:
        """The nominal robot with base and tool identified from the same poses."""
        return Robot(
            self.arm(calibrated=False),
            JointMap(np.zeros(len(self.robot.joint_names))),
            *_placed(self.placement_nominal),
        )

    def used_points(self, heldout: bool) -> tuple[PointSet, FloatArray] | None:
        """The used points, fitted or held out, and the directions from which their joints were reached.

        Parameters
        ----------
        heldout : bool

        Returns
        -------
        points : PointSet
        came_from : ndarray, shape (n, joints)
            1: from below, -1: from above, 0: not known.

        ``None`` in place of both for calibrations that were saved without measured places.
        """
        t, p = self.points, self.poses
        if p is None or not t.x_mm:
            return None
        kept = self._used.get(heldout)
        if kept is None or kept[0] is not t or kept[1] is not p:
            kept = self._used[heldout] = (t, p, *self._points_of(t, p, heldout))
        return kept[2:]

    def _points_of(self, t: PointTable, p: PoseTable, heldout: bool) -> tuple[PointSet, FloatArray]:
        poses = np.array(p.heldout, dtype=bool) == heldout
        mine = np.array(t.heldout, dtype=bool) == heldout
        slides = [kind == "prismatic" for kind in self.robot.joint_types]
        units = np.where(slides, MM, DEG)
        labels = np.array(t.target, dtype=object)[mine]
        names = sorted(set(labels))
        target = np.zeros(len(labels), dtype=int)
        for k, name in enumerate(names):
            target[labels == name] = k
        u95 = np.array(t.u95_mm, dtype=float)[mine] * MM if t.u95_mm else None
        points = PointSet(
            np.array(p.joints, dtype=float).T[poses] * units,
            (np.cumsum(poses) - 1)[np.array(t.row, dtype=int)[mine]],
            target,
            np.column_stack([t.x_mm, t.y_mm, t.z_mm])[mine] * MM,
            tuple(names),
            np.array(p.pose, dtype=object)[poses],
            np.array(p.group, dtype=object)[poses],
            frames.matrix_from_quaternion(np.array([t.qw, t.qx, t.qy, t.qz], dtype=float).T[mine]) if t.qw else None,
            u95,
            np.array(p.previous, dtype=float).T[poses] * units if p.previous else None,
            payload_kg=np.array(p.payload_kg, dtype=float)[poses] if p.payload_kg else None,
            payload_place=np.array(p.payload_place_mm, dtype=float).T[poses] * MM if p.payload_place_mm else None,
            torques=np.array(p.torques_nm, dtype=float).T[poses] if p.torques_nm else None,
        )
        codes = np.array([np.frombuffer(column.encode("ascii"), dtype=np.uint8) for column in p.came_from])
        came_from = np.where(codes == ord("+"), 1.0, np.where(codes == ord("-"), -1.0, 0.0)).T[poses]
        came_from.flags.writeable = False
        return points, came_from

    def tool_shape(self) -> dict[str, FloatArray]:
        """Places of the reflectors that make up the tool's pose, dict of arrays (3,), metres; empty if none do."""
        return {name: np.array(place) * MM for name, place in self.tool_shape_mm.items()}

    def reference_places(self) -> dict[str, FloatArray]:
        """Places of the reference points in the measuring frame, dict of arrays (3,), metres."""
        return {name: np.array(place) * MM for name, place in self.references_mm.items()}


def _table(rows: Sequence[Row], prismatic: Sequence[bool]) -> DHMTable:
    def column(name: str, unit: float) -> FloatArray:
        return np.array([getattr(row, name) * unit for row in rows])

    return DHMTable(
        column("alpha_deg", DEG),
        column("a_mm", MM),
        column("theta_deg", DEG),
        column("d_mm", MM),
        column("beta_deg", DEG),
        column("b_mm", MM),
        np.array(prismatic, dtype=bool),
    )


def _placed(placement: Placement) -> tuple[FloatArray, dict[str, FloatArray], dict[str, FloatArray]]:
    b = placement.base
    R = frames.matrix_from_quaternion([b.qw, b.qx, b.qy, b.qz])
    T = frames.transform(R, np.array([b.x_mm, b.y_mm, b.z_mm]) * MM)
    rotations = {name: frames.matrix_from_quaternion(q) for name, q in placement.target_quaternions.items()}
    return T, {name: np.array(xyz) * MM for name, xyz in placement.targets.items()}, rotations
