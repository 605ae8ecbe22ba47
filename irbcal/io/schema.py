"""What stands in ``calibration.json``: a checked schema, and the robots that it describes."""

from __future__ import annotations

import base64
import binascii
import hashlib
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import numpy as np
from pydantic import Field, GetPydanticSchema, PrivateAttr, StringConstraints, field_validator, model_validator
from pydantic_core import core_schema

from irbcal.arrays import FloatArray, NameArray, plain
from irbcal.errors import CalibrationError, RobotError
from irbcal.identification.fit_sections import (
    FamilyShown,
    GearSpectrum,
    GroupResult,
    LevelChoice,
    ParameterReport,
    Stage,
    TermSetResult,
)
from irbcal.io import urdf_check
from irbcal.measurement.cleaning import Exclusion
from irbcal.measurement.columns import input_of
from irbcal.measurement.points import PointSet, rotation_distances
from irbcal.modeling import coupling, frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.certainty import Certainty
from irbcal.modeling.dhm import DHMTable
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.levels import Level
from irbcal.modeling.parameters import all_names, parameter, term_of
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms import bases, inputs
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.term_map import SCHEMA, TermMap
from irbcal.modeling.workspace_coverage import WorkspaceCoverage
from irbcal.section import Base64, Date, Fingerprint, Name, Names, Section, Sentence, Sha256, Version, Word
from irbcal.statistics import rotation_statistics, statistics, statistics_by
from irbcal.units import DEG, MM, UNIT_OUTSIDE

if TYPE_CHECKING:
    from irbcal.identification.evidence_fit import EvidenceFit
    from irbcal.identification.fit import Fit


class CovarianceSection(Section):
    """A covariance matrix ``C = L L'`` by its factor, packed.

    ``factor`` is base64 of the lower triangle of L, row by row (L11, L21, L22, L31, …), as little-endian floats of four
    bytes. The factor keeps what is known well beside what is not: a rounding of C itself to four bytes would not.
    """

    layout: Literal["cholesky-rows-float32-base64"]
    size: int = Field(ge=0)
    factor: Base64

    @model_validator(mode="after")
    def _whole(self) -> CovarianceSection:
        try:
            data = base64.b64decode(self.factor, validate=True)
        except binascii.Error:
            raise ValueError("the factor of the covariance is not base64") from None
        if len(data) != 2 * self.size * (self.size + 1):
            raise ValueError(f"the factor of a covariance of size {self.size} has {len(data)} bytes")
        if not np.isfinite(np.frombuffer(data, "<f4")).all():
            raise ValueError("the factor of the covariance has numbers that are not finite")
        return self

    @staticmethod
    def of(matrix: FloatArray) -> CovarianceSection:
        """The section of a covariance, shape (k, k), which may be singular."""
        scale = np.sqrt(np.maximum(np.diagonal(matrix), 0.0))
        scale[scale == 0.0] = 1.0
        values, vectors = np.linalg.eigh(matrix / np.outer(scale, scale))
        # R'R = V diag(values) V' with R upper triangular: a factor although directions may be held
        R: FloatArray = np.linalg.qr((vectors * np.sqrt(np.maximum(values, 0.0))).T)[1]
        L = R.T * scale[:, None]
        data = L[np.tril_indices(len(L))].astype("<f4").tobytes()
        return CovarianceSection(
            layout="cholesky-rows-float32-base64", size=len(L), factor=base64.b64encode(data).decode("ascii")
        )

    def matrix(self) -> FloatArray:
        """The covariance, shape (size, size), read-only."""
        return _unpacked(self.factor, self.size)


@lru_cache(maxsize=4)
def _unpacked(factor: str, size: int) -> FloatArray:
    L = np.zeros((size, size))
    L[np.tril_indices(size)] = np.frombuffer(base64.b64decode(factor), "<f4")
    C: FloatArray = L @ L.T
    C.setflags(write=False)
    return C


class CertaintySection(Section):
    """What intervals of predictions need beside the covariance, and where they are valid.

    Leave-one-out errors (mm) are root mean square lengths by target, under the empty name for all: of single poses, and
    of contiguous fifths of the poses; null where what is left does not determine them. ``ranges`` are the smallest and
    the largest joints of the fit, rad (m). ``measurement_noise_mm`` is the standard deviation of a measured coordinate
    that distances between targets at one pose prove.
    """

    leave_one_out_mm: dict[Name, float | None]
    leave_fifths_out_mm: dict[Name, float | None]
    ranges: list[list[float]] = Field(min_length=2, max_length=2)
    measurement_noise_mm: float = Field(default=0.0, ge=0.0)
    elsewhere: WorkspaceCoverage | None = None

    @staticmethod
    def of(certainty: Certainty, coverage: WorkspaceCoverage | None) -> CertaintySection:
        """The section of what an identification knows."""
        assert certainty.ranges is not None
        return CertaintySection.from_result(certainty, ranges=certainty.ranges.tolist(), elsewhere=coverage)

    def warning(self) -> str:
        """The warning of a calibration that is that of a corner of the workspace; else an empty text."""
        return "" if self.elsewhere is None else self.elsewhere.in_words()


def in_mm(lengths: Mapping[str, Any]) -> dict[str, Any]:
    """Lengths or positions by name, metres, in millimetres: numbers, lists or None."""
    return {name: None if value is None else (np.asarray(value) / MM).tolist() for name, value in lengths.items()}


def in_metres(lengths: Mapping[str, float | None]) -> dict[str, float | None]:
    """Lengths by name, millimetres, in metres."""
    return {name: None if value is None else value * MM for name, value in lengths.items()}


PLACE_DIGITS, JOINT_DIGITS, QUATERNION_DIGITS = 6, 9, 12
"""Decimals of measured places (mm), joints (degrees, mm) and quaternions: far below what is measured."""


class EvidenceChoice(Section):
    """Which error models were averaged."""

    level: Level | Literal["auto"]
    table: list[TermSetResult]
    explanation: Sentence

    @staticmethod
    def of(fit: EvidenceFit) -> EvidenceChoice:
        """The comparison of a fit."""
        return EvidenceChoice(level=fit.level, table=fit.term_sets, explanation=fit.explanation())


class GearSection(Section):
    """A single high harmonic that was found; joints count from 1."""

    joint: int
    cycles_per_turn: int
    amplitude_deg: float
    chi2: float
    evidence_gain: float


class EvidenceSection(Section):
    """What is known of an average of error models beside its parameters.

    Leave-one-out errors are root mean squares by target, under the empty name for all: of single poses, and of
    contiguous fifths of the poses; null where what is left does not determine them. ``warm_up_tau`` is in poses.
    ``explained`` are fits with one family after the other;
    ``spectrum`` is null where no gear scan was made, because long series of harmonics take its place.
    """

    terms: Word
    poses: int
    sigma_mm: float
    leave_one_out_mm: dict[Name, float | None]
    leave_fifths_out_mm: dict[Name, float | None]
    groups: list[GroupResult]
    families: list[FamilyShown]
    gears: list[GearSection]
    spectrum: GearSpectrum | None
    explained: list[Stage]
    warm_up_tau: float | None
    readings_gain: float | None
    readings_lag: bool

    @staticmethod
    def of(fit: EvidenceFit, stages: Sequence[Stage] = ()) -> EvidenceSection:
        """The section of a fit, with its stages (`irbcal.identification.explanation`)."""
        gears = [
            GearSection.from_result(gear, joint=gear.joint + 1, amplitude_deg=fit.amplitude(gear) / DEG)
            for gear in fit.gears
        ]
        return EvidenceSection.from_result(
            fit,
            terms=fit.kind,
            gears=gears,
            explained=stages,
            warm_up_tau=fit.tau,
            readings_lag=fit.readings_projected,
        )


class FeatureRow(Section):
    """A feature: what was known and what was found of it.

    ``found`` has its unknowns in the base link (mm, degrees), ``known`` what was given of it, likewise; ``rms_mm`` is
    what its rows miss in the fit. At its rows the tool was about ``middle_mm``, within ``spread_mm`` (root mean
    square). ``imaging`` has what was given of camera and board, as in the features' file.
    """

    name: Name
    kind: Word
    target: Name
    rows: int
    place: Name
    rms_mm: float
    nominal_rms_mm: float
    found: dict[Name, list[float]]
    std: dict[Name, list[float]]
    known: dict[Name, list[float]]
    middle_mm: list[float]
    spread_mm: float
    imaging: dict[Name, Name]


class PlaceRow(Section):
    """A place that was left out of the fit: what its rows miss about features placed anew, mm."""

    name: Name
    rows: int
    nominal_mean_mm: float
    nominal_max_mm: float
    mean_mm: float
    rms_mm: float
    max_mm: float


class LengthRow(Section):
    """A known length: found minus known, mm; left out where its place was, null where it never was."""

    name: Name
    first: Name
    second: Name
    length_mm: float
    fitted_mm: float
    nominal_mm: float | None
    heldout_mm: float | None


class FeaturesSection(Section):
    """Features, places and lengths.

    ``left_out`` is what was left out in turn, null where nothing was. ``before_mm`` and ``open_mm`` are root mean
    square lengths of what was not known of the tool's place, before the rows and after them. ``named`` is how columns
    name the feature of a row, empty where a column does; ``scale_from`` is what gives
    the robot its scale where that is a part of the features, as the squares of a board.
    """

    kinds: dict[Name, int]
    framed: bool
    scale_measured: bool
    left_out: Name | None
    before_mm: float
    open_mm: float
    features: list[FeatureRow]
    places: list[PlaceRow]
    lengths: list[LengthRow]
    named: Name
    scale_from: Sentence

    @property
    def scale(self) -> str:
        """Where the scale of the robot comes from, in a sentence; empty where lengths were measured."""
        if self.scale_from:
            return f"the scale rests on {self.scale_from}: were these 0.1 % longer, the robot would be, too"
        return (
            ""
            if self.scale_measured
            else "no length was measured that tells the size of the arm: the scale rests on nominal link lengths"
        )

    def length_error(self) -> tuple[float, float] | None:
        """Mean size of the errors of known lengths at left-out places, nominal and calibrated, mm."""
        pairs = [
            (abs(r.nominal_mm), abs(r.heldout_mm))
            for r in self.lengths
            if r.nominal_mm is not None and r.heldout_mm is not None
        ]
        if not pairs:
            return None
        return sum(a for a, _ in pairs) / len(pairs), sum(b for _, b in pairs) / len(pairs)


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
        q, q_before, load = arm.random_stops(TEST_VECTORS, joint_map.payload_kg or 0.0, joint_map.knows_loads)
        rng, drawn = np.random.default_rng(3), {"payload_kg": load}
        for quantity in (quantity for term in joint_map.terms.terms for quantity in bases()[term.basis].inputs):
            if quantity.name not in drawn and not quantity.told_once:
                drawn[quantity.name] = quantity.usual + rng.normal(0.0, 50.0, quantity.shape(q.shape))
        motion = Motion(q, q - q_before, inputs=drawn)
        return JointMapSection(**joint_map.terms.to_json(joint_map.ranges, motion), payload_kg=joint_map.payload_kg)

    def joint_map(self, nominal: Arm) -> JointMap:
        """The joint map that the section describes, of a nominal arm."""
        content: dict[str, Any] = {"schema": SCHEMA, "gravity": self.gravity, "terms": self.terms}
        ranges = None if self.ranges is None else np.array(self.ranges)
        if ranges is not None and ranges.shape != (2, len(nominal.joint_names)):
            raise RobotError(f"the joint map's ranges need two rows of {len(nominal.joint_names)} joints")
        return JointMap(TermMap.from_json(nominal, content), ranges, self.payload_kg)


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
        q, q_before, *_ = robot.arm.random_stops(TEST_VECTORS)
        ranges = getattr(robot.joint_map, "ranges", None)
        low, high = (robot.arm.lower, robot.arm.upper) if ranges is None else ranges
        inside = np.random.default_rng(0).uniform(low, high, (SAMPLES, len(low)))
        moved = robot.moved_by_frame_terms(inside) / MM
        vectors = [
            FrameVector(q=a.tolist(), previous_q=b.tolist(), T_base_tip=T.tolist())
            for a, b, T in zip(q, q_before, robot.forward(q, q_before), strict=True)
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


class PointTable(Section):
    """Every used point, column by column: what the report's figures are drawn from.

    ``row`` counts the poses of `PoseTable`; places are in the measuring frame; uncertainties and orientations (unit
    quaternion, scalar first) are null where a point has none, and the columns are empty where no point has.
    """

    pose: Names
    group: Names
    target: Names
    heldout: list[bool]
    nominal_mm: list[float]
    calibrated_mm: list[float]
    row: list[int] = Field(default_factory=list)
    x_mm: list[float] = Field(default_factory=list)
    y_mm: list[float] = Field(default_factory=list)
    z_mm: list[float] = Field(default_factory=list)
    u95_mm: list[float | None] = Field(default_factory=list)
    qw: list[float | None] = Field(default_factory=list)
    qx: list[float | None] = Field(default_factory=list)
    qy: list[float | None] = Field(default_factory=list)
    qz: list[float | None] = Field(default_factory=list)

    @model_validator(mode="after")
    def _of_one_length(self) -> PointTable:
        n = len(self.pose)
        for name in type(self).model_fields:
            column: list[Any] = getattr(self, name)
            added_later = not type(self).model_fields[name].is_required()
            if len(column) != n and not (added_later and not column):
                raise ValueError(f"column {name} has {len(column)} values for {n} points")
        return self

    @staticmethod
    def of(fitted: PointSet, heldout: PointSet, errors: Sequence[FloatArray], placed: bool = True) -> PointTable:
        """Fitted and held-out points.

        Parameters
        ----------
        fitted, heldout : PointSet
        errors : sequence of ndarray
            Distances from the calibrated and the nominal robot, of fitted points, then of held-out ones, metres.
        placed : bool
            Whether the points' positions were measured.
        """
        sets = fitted, heldout
        filled = [points for points in sets if len(points)]
        columns: dict[str, Any] = {
            "pose": [name for points in sets for name in texts(points.pose_ids)[points.pose].tolist()],
            "group": [name for points in sets for name in texts(points.groups)[points.pose].tolist()],
            "target": [name for points in sets for name in points.names().tolist()],
            "heldout": [False] * len(fitted) + [True] * len(heldout),
            "row": [*fitted.pose.tolist(), *(heldout.pose + fitted.poses).tolist()],
            "calibrated_mm": (np.concatenate([errors[0], errors[2]]) / MM).tolist(),
            "nominal_mm": (np.concatenate([errors[1], errors[3]]) / MM).tolist(),
        }
        if placed and filled:
            xyz = np.concatenate([points.xyz for points in filled]) / MM
            u95 = np.concatenate([np.full(len(p), np.nan) if p.u95 is None else p.u95 for p in filled]) / MM
            R = np.concatenate([np.full((len(p), 3, 3), np.nan) if p.rotation is None else p.rotation for p in filled])
            columns |= dict(zip(("x_mm", "y_mm", "z_mm"), np.round(xyz, PLACE_DIGITS).T.tolist(), strict=True))
            if np.isfinite(u95).any():
                columns["u95_mm"] = plain(np.round(u95, PLACE_DIGITS))
            if any(points.oriented().any() for points in sets):
                quaternions = np.round(frames.quaternion_from_matrix(R), QUATERNION_DIGITS)
                columns |= {name: plain(q) for name, q in zip(("qw", "qx", "qy", "qz"), quaternions.T, strict=True)}
        return PointTable(**columns)


class PoseTable(Section):
    """Every used pose, column by column; one column of ``joints`` (degrees, mm) and ``came_from`` for each joint.

    ``came_from`` has one character for each pose: ``+`` where the joint was reached from below, ``-`` from above, ``0``
    where that is not known. ``previous`` holds the joints of the stop before, as ``joints``, null where that is not
    known; ``number`` counts the poses of a session in the order in which the robot visited them, empty where that is
    not known. ``inputs`` are columns of what else the error model's terms are functions of, as in measurement files:
    ``payload_kg``, …; none where no pose has any.
    """

    pose: Names
    group: Names
    heldout: list[bool]
    joints: list[list[float]]
    number: list[float] = Field(default_factory=list)
    came_from: list[Annotated[str, StringConstraints(pattern=r"^[+0-]*$")]]
    previous: list[list[float | None]] = Field(default_factory=list)
    inputs: dict[Word, list[float | None]] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _of_one_length(self) -> PoseTable:
        n = len(self.pose)
        columns: list[Sequence[Any]] = [self.group, self.heldout, *self.joints, *self.came_from, *self.previous]
        columns += [self.number] if self.number else []
        columns += self.inputs.values()
        counts = {len(self.joints), len(self.came_from), len(self.previous or self.joints)}
        if any(len(column) != n for column in columns) or len(counts) > 1:
            raise ValueError(f"every column must have {n} values, one for each pose")
        strange = [name for name in self.inputs if input_of(name) is None]
        if strange:
            raise ValueError(f"inputs: {strange[0]} is no column of an input of the error model")
        return self

    @staticmethod
    def of(fitted: PointSet, heldout: PointSet, arm: Arm, came_from: FloatArray, number: FloatArray) -> PoseTable:
        """Poses of fitted and held-out points.

        Parameters
        ----------
        fitted, heldout : PointSet
        arm : Arm
        came_from : ndarray, shape (poses, joints)
            1: from below, -1: from above, 0: not known.
        number : ndarray, shape (poses,)
            Of each pose in its session; another length where it is not known.
        """
        sets = fitted, heldout
        n = fitted.poses + heldout.poses
        unknown = [np.full(points.q.shape, np.nan) if points.previous is None else points.previous for points in sets]
        signs = np.frombuffer(b"-0+", dtype=np.uint8)[came_from.astype(int) + 1]
        filled = [points for points in sets if points.poses]
        told = {
            name: np.concatenate([points.inputs[name] for points in filled])
            for name in (filled[0].inputs if filled else ())
            if all(name in points.inputs for points in filled)
        }
        return PoseTable(
            pose=[name for points in sets for name in texts(points.pose_ids).tolist()],
            group=[name for points in sets for name in texts(points.groups).tolist()],
            heldout=[False] * fitted.poses + [True] * heldout.poses,
            joints=np.round(np.concatenate([points.q for points in sets]) / arm.joint_units, JOINT_DIGITS).T.tolist(),
            number=number.tolist() if len(number) == n else [],
            came_from=[column.tobytes().decode("ascii") for column in signs.T],
            previous=[plain(column) for column in np.round(np.concatenate(unknown) / arm.joint_units, JOINT_DIGITS).T],
            inputs={
                column: plain(numbers)
                for name, values in told.items()
                for column, numbers in inputs()[name].to_columns(values).items()
            },
        )


def texts(names: NameArray) -> NameArray:
    """Names as text."""
    return np.array([str(name) for name in names.tolist()], dtype=object)


FileName: TypeAlias = Annotated[str, StringConstraints(pattern=r"^[0-9A-Za-z][0-9A-Za-z._-]{0,99}$")]
"""Of a file in the folder itself."""


class Seal(Section):
    """Hashes of all other parts and of all other files, by name, and a line for every deliberate change since."""

    parts: dict[Word, Sha256]
    files: dict[FileName, Sha256]
    changes: list[Sentence]


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

    @staticmethod
    def of(table: DHMTable) -> list[Row]:
        """The rows of a table."""
        values = {name: getattr(table, name.partition("_")[0]) / unit for name, unit in DHM_UNITS.items()}
        return [Row(**{name: column[i] for name, column in values.items()}) for i in range(len(table.a))]

    @staticmethod
    def table(rows: Sequence[Row], prismatic: Sequence[bool]) -> DHMTable:
        """The table of rows."""
        columns = {
            name.partition("_")[0]: np.array([getattr(row, name) * unit for row in rows])
            for name, unit in DHM_UNITS.items()
        }
        return DHMTable(**columns, prismatic=np.array(prismatic, dtype=bool))


DHM_UNITS = {"alpha_deg": DEG, "a_mm": MM, "theta_deg": DEG, "d_mm": MM, "beta_deg": DEG, "b_mm": MM}


class PoseSection(Section):
    """A frame: position and unit quaternion, scalar first."""

    x_mm: float
    y_mm: float
    z_mm: float
    qw: float
    qx: float
    qy: float
    qz: float

    @staticmethod
    def of(T: FloatArray) -> PoseSection:
        """From a transform, shape (4, 4), metres."""
        w, x, y, z = frames.quaternion_from_matrix(T[:3, :3]).tolist()
        return PoseSection(x_mm=T[0, 3] / MM, y_mm=T[1, 3] / MM, z_mm=T[2, 3] / MM, qw=w, qx=x, qy=y, qz=z)

    @property
    def quaternion_norm(self) -> float:
        """One but for rounding."""
        return float(np.linalg.norm([self.qw, self.qx, self.qy, self.qz]))

    def transform(self) -> FloatArray:
        """As a transform, shape (4, 4), metres."""
        R = frames.matrix_from_quaternion([self.qw, self.qx, self.qy, self.qz])
        return frames.transform(R, np.array([self.x_mm, self.y_mm, self.z_mm]) * MM)


QUATERNION_TOLERANCE = 1e-9
"""How far the length of a quaternion of a pose may be from one."""


def _transform(pose: PoseSection) -> FloatArray:
    if abs(pose.quaternion_norm - 1.0) > QUATERNION_TOLERANCE:
        raise ValueError("expected a unit quaternion")
    return pose.transform()


Pose: TypeAlias = Annotated[
    FloatArray,
    GetPydanticSchema(
        lambda _, handler: core_schema.no_info_after_validator_function(
            _transform,
            handler.generate_schema(PoseSection),
            serialization=core_schema.plain_serializer_function_ser_schema(lambda T: PoseSection.of(T).model_dump()),
        )
    ),
]
"""A transform (4, 4) in metres, in the file a `PoseSection`."""


class RobotSection(Section):
    """The arm: names, limits (null where there is none) and the constant frames around the DHM chain.

    Joint types are ``revolute`` and ``prismatic``; limits are in degrees and mm. ``joints_up`` is how many of
    the first joints lead up a tree.
    """

    name: Name
    urdf: Name
    urdf_sha256: Sha256
    base_link: Name
    tip_link: Name
    joint_names: Names
    joint_types: list[Literal["revolute", "prismatic"]]
    lower: list[float | None]
    upper: list[float | None]
    base_to_frame0: Matrix
    last_frame_to_tip: Matrix
    dhm_nominal: list[Row]
    dhm_calibrated: list[Row]
    coupling: list[list[float]] | None = None
    joints_up: int | None = None

    @staticmethod
    def of(arm: Arm, calibrated: DHMTable, urdf: str, sha256: str) -> RobotSection:
        """Of a nominal arm, with its calibrated table and name and hash of its URDF."""
        lower, upper = (
            [float(value) if np.isfinite(value) else None for value in limits / arm.joint_units]
            for limits in (arm.lower, arm.upper)
        )
        return RobotSection(
            name=arm.name,
            urdf=urdf,
            urdf_sha256=sha256,
            base_link=arm.base_link,
            tip_link=arm.tip_link,
            joint_names=list(arm.joint_names),
            joint_types=["prismatic" if slides else "revolute" for slides in arm.table.prismatic],
            lower=lower,
            upper=upper,
            base_to_frame0=arm.T_base_0.tolist(),
            last_frame_to_tip=arm.T_last_tip.tolist(),
            dhm_nominal=Row.of(arm.table),
            dhm_calibrated=Row.of(calibrated),
            coupling=None if arm.coupling is None else arm.coupling.tolist(),
            joints_up=arm.joints_up or None,
        )

    @property
    def joint_units(self) -> FloatArray:
        """Radians of a degree, or metres of a millimetre, of each joint, shape (joints,)."""
        return np.array([MM if kind == "prismatic" else DEG for kind in self.joint_types])

    def arm(self, calibrated: bool) -> Arm:
        """The calibrated or the nominal arm."""
        lower, upper = (
            np.array([sign * np.inf if value is None else value for value in values]) * self.joint_units
            for sign, values in ((-1, self.lower), (1, self.upper))
        )
        slides = [kind == "prismatic" for kind in self.joint_types]
        return Arm(
            self.name,
            Row.table(self.dhm_calibrated if calibrated else self.dhm_nominal, slides),
            np.array(self.base_to_frame0),
            np.array(self.last_frame_to_tip),
            tuple(self.joint_names),
            lower,
            upper,
            self.base_link,
            self.tip_link,
            coupling.matrix(self.coupling, len(slides)),
            self.joints_up or 0,
        )


class OriginSection(Section):
    """A joint frame in its parent link, as URDF has it: metres, and radians about fixed axes."""

    xyz_m: Three
    rpy_rad: Three

    @staticmethod
    def of(T: FloatArray) -> OriginSection:
        """From a transform, shape (4, 4)."""
        return OriginSection(
            xyz_m=(T[:3, 3] + 0.0).tolist(), rpy_rad=(frames.rpy_from_matrix(T[:3, :3]) + 0.0).tolist()
        )

    def transform(self) -> FloatArray:
        """As a transform, shape (4, 4)."""
        return frames.transform(frames.matrix_from_rpy(np.array(self.rpy_rad)), self.xyz_m)


class JointOrigin(Section):
    """Nominal and calibrated origin of one joint of the chain; ``link`` is its child link."""

    joint: Name
    link: Name
    nominal: OriginSection
    calibrated: OriginSection


class Placement(Section):
    """Base in the measuring frame; targets (mm) and target frames (unit quaternion, scalar first) in the tip link."""

    base: PoseSection
    targets: dict[Name, Three]
    target_quaternions: dict[Name, Quaternion]

    @staticmethod
    def of(robot: Robot) -> Placement:
        """Base and targets of a robot."""
        rotations = robot.target_rotations.items()
        return Placement(
            base=PoseSection.of(robot.T_world_base),
            targets=in_mm(robot.targets),
            target_quaternions={name: frames.quaternion_from_matrix(R).tolist() for name, R in rotations},
        )

    def parts(self) -> tuple[FloatArray, dict[str, FloatArray], dict[str, FloatArray]]:
        """Base, targets and their orientations as a `Robot` has them, metres."""
        rotations = {name: frames.matrix_from_quaternion(q) for name, q in self.target_quaternions.items()}
        return self.base.transform(), {name: np.array(xyz) * MM for name, xyz in self.targets.items()}, rotations


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
    per_target: dict[Name, Statistics]
    per_group: dict[Name, Statistics]

    @staticmethod
    def of(robot: Robot, points: PointSet, distance: FloatArray) -> Errors | None:
        """Of points with their distances, metres, shape (points,); None of no points."""
        overall = statistics(distance)
        if overall is None:
            return None
        groups = statistics_by(distance, points.groups[points.pose])
        turned = rotation_statistics(rotation_distances(robot, points))
        return Errors.model_validate(
            {
                "all": overall,
                "orientation": turned,
                "per_target": statistics_by(distance, points.names()),
                "per_group": {name: value for name, value in groups.items() if name},
            }
        )


class SessionSection(Section):
    """A session: its base in its own measuring frame. Its targets are the placement's with its name behind ``@``.

    The last session's frame is that of the calibration: its base is the placement's, and its targets have plain names.
    """

    name: Name
    base: PoseSection


class Objective(Section):
    """What was minimised and what was reached."""

    name: Literal["rms", "max", "pnorm"]
    value_mm: float
    lower_bound_mm: float | None


class CorrelationSection(Section):
    """Two parameters that the data can hardly tell apart."""

    first: Name
    second: Name
    coefficient: float


class Observability(Section):
    """What the poses can show of the error parameters, base and targets eliminated.

    Singular values (mm) are those of the Jacobian scaled by plausible sizes; ``indices`` are O1 to O5 and the condition
    number over the seen directions.
    """

    singular_values_mm: list[float]
    seen: int
    indices: dict[Word, float]
    correlations: list[CorrelationSection]

    @staticmethod
    def of_average(fit: EvidenceFit) -> Observability:
        """Of an average: how much is seen stands with the groups of terms, nothing is held."""
        return Observability(singular_values_mm=[], seen=fit.rank, indices={}, correlations=[])

    @staticmethod
    def of(fit: Fit) -> Observability:
        """Of the fit of a level."""
        information, names = fit.solution.information, [p.name for p in fit.problem.parameters]
        return Observability(
            singular_values_mm=(information.singular_values / MM).tolist(),
            seen=int(information.seen.sum()),
            indices=information.indices(fit.problem.points.poses),
            correlations=[
                CorrelationSection(first=names[i], second=names[j], coefficient=c)
                for i, j, c in information.correlations()
            ],
        )


class DataFile(Section):
    """A data file and its fingerprint; ``programmed``: it has programmed joints, which the model takes."""

    file: Name
    sha256: Sha256
    programmed: bool


class Check(Section):
    """Largest disagreement of the calibrated robot with readers of the written URDF, and how many poses each read."""

    position_m: float
    rotation_rad: float
    witnesses: dict[Name, int]

    def in_words(self) -> str:
        """The witnesses, each with its poses."""
        return " and ".join(f"{name} ({poses} poses)" for name, poses in self.witnesses.items())


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
    among the fitted and, each with its place left out in turn, among the held-out ones. ``seal``
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
    objective: Objective
    choice: LevelChoice | EvidenceChoice | None
    evidence: EvidenceSection | None
    rank: int
    parameter_count: int
    parameters: list[ParameterReport]
    covariance: CovarianceSection
    certainty: CertaintySection
    held: list[Sentence]
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
    urdf_witnesses: Check
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
        """Notes that are no doubts, and what reflectors of unknown place leave open of base and flange."""
        certainty = self.robot_calibrated().certainty
        ends = "" if certainty is None else certainty.open_ends_in_words()
        return [*(note for note in self.notes if note not in self.doubts), *filter(None, [ends])]

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
        robot = Robot(self.arm(), self.errors_of_joints(), *self.placement.parts(), frame_terms=frame_terms)
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
        check = Check.model_validate(urdf_check.check(data, self.arm()))
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
            free_targets=tuple(name for name in robot.targets if f"target_{name}_x" in listed),
            coefficients=np.array([row.value * factor.get(row.unit, 1.0) for row in rows]),
            leave_one_out=in_metres(self.certainty.leave_one_out_mm),
            leave_fifths_out=in_metres(self.certainty.leave_fifths_out_mm),
            ranges=np.array(self.certainty.ranges),
            measurement_noise=self.certainty.measurement_noise_mm * MM,
        )

    def robot_nominal(self) -> Robot:
        """The nominal robot with base and tool identified from the same poses."""
        nominal = self.arm(calibrated=False)
        return Robot(nominal, JointMap.identity(nominal), *self.placement_nominal.parts())

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
        return self._computed.get_or_make(name, (t, p), lambda: self._points_of(t, p, heldout))

    def _points_of(self, t: PointTable, p: PoseTable, heldout: bool | None) -> tuple[PointSet, FloatArray]:
        poses, mask = (
            np.array([heldout is None or kind == heldout for kind in table.heldout], dtype=bool) for table in (p, t)
        )
        units = self.robot.joint_units
        labels = np.array(t.target, dtype=object)[mask]
        names = sorted(set(labels))
        target = np.zeros(len(labels), dtype=int)
        for k, name in enumerate(names):
            target[labels == name] = k
        u95 = np.array(t.u95_mm, dtype=float)[mask] * MM if t.u95_mm else None
        points = PointSet(
            np.array(p.joints, dtype=float).T[poses] * units,
            (np.cumsum(poses) - 1)[np.array(t.row, dtype=int)[mask]],
            target,
            np.column_stack([t.x_mm, t.y_mm, t.z_mm])[mask] * MM,
            tuple(names),
            np.array(p.pose, dtype=object)[poses],
            np.array(p.group, dtype=object)[poses],
            frames.matrix_from_quaternion(np.array([t.qw, t.qx, t.qy, t.qz], dtype=float).T[mask]) if t.qw else None,
            u95,
            np.array(p.previous, dtype=float).T[poses] * units if p.previous else None,
            inputs={
                quantity.name: quantity.from_columns([p.inputs[name] for name in quantity.names(len(units))])[poses]
                for quantity in inputs().values()
                if quantity.names(1)[0] in p.inputs
            },
        )
        codes = np.array([np.frombuffer(column.encode("ascii"), dtype=np.uint8) for column in p.came_from])
        came_from = np.where(codes == ord("+"), 1.0, np.where(codes == ord("-"), -1.0, 0.0)).T[poses]
        came_from.flags.writeable = False
        return points, came_from

    def tool_shape(self) -> dict[str, FloatArray]:
        """Places of the reflectors that make up the tool's pose, dict of arrays (3,), metres; empty if none do."""
        return {name: np.array(xyz) * MM for name, xyz in self.tool_shape_mm.items()}

    def reference_places(self) -> dict[str, FloatArray]:
        """Places of the reference points in the measuring frame, dict of arrays (3,), metres."""
        return {name: np.array(xyz) * MM for name, xyz in self.references_mm.items()}
