"""What came out of an identification, with all that it was made from."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from irbcal.arrays import FloatArray, lock
from irbcal.identification.evidence_fit import EvidenceFit
from irbcal.identification.fit import Fit
from irbcal.identification.selection import Choice
from irbcal.io.earlier import Earlier
from irbcal.io.schema import FeaturesSection
from irbcal.io.urdf import UrdfArm
from irbcal.measurement.cleaning import Exclusion
from irbcal.measurement.points import PointSet, distances
from irbcal.measurement.table import MeasurementSet
from irbcal.modeling.robot import Robot


@dataclass(frozen=True, eq=False)
class PlacedRobot:
    """The nominal robot with base and tool, where these come from no fit of points."""

    robot: Robot


@dataclass(frozen=True, eq=False)
class AtFeatures:
    """What rows at features came to.

    Attributes
    ----------
    section : FeaturesSection
    fitted, heldout : (ndarray, ndarray)
        What each row misses, nominal and calibrated, metres: in the fit, and with its place left out.
    """

    section: FeaturesSection
    fitted: tuple[FloatArray, FloatArray]
    heldout: tuple[FloatArray, ...]

    def __post_init__(self) -> None:
        lock(self)


@dataclass(frozen=True, eq=False, repr=False)
class Outcome:
    """Everything that came out of a calibration, ready to be saved.

    Attributes
    ----------
    urdf : UrdfArm
        The nominal robot as read.
    robot_file : Path
    fit : Fit or EvidenceFit
        The level asked for, or model ``auto``.
    nominal : Fit or PlacedRobot
        Base and tool alone, on the poses of the fit, too.
    fit_points, heldout_points : PointSet
        ``heldout_points`` may be empty.
    measurements : MeasurementSet
    verification : MeasurementSet or None
        Where the held-out poses come from a file of their own.
    poses_asked : int
    excluded : tuple of Exclusion
    references : dict of str to ndarray
        Places of the reference points, metres; empty without references.
    tool_shape : dict of str to ndarray
        Places of the reflectors on the tool where they were turned into poses, metres; else empty.
    choice : Choice or None
        The comparison of levels, where the level was chosen by it.
    notes : tuple of str
    seconds : float
    other_bases : dict of str to ndarray, shape (4, 4)
        Bases of the sessions before the last one, each in its own measuring frame. The points are all in the frame of
        the last session.
    sessions : tuple of str
        Names of all sessions, the last one last; empty where there is one only.
    numbers : (ndarray, ndarray)
        Number of each pose in its session: those of the fit, and those held out.
    earlier : Earlier or None
        The calibration that was added to.
    doubts : tuple of str
        What speaks against the result, whatever its errors say; these stand among the notes, too.
    robot_source : (str, str) or None
        Name and SHA-256 of the nominal URDF, where the robot was taken from an earlier calibration.
    features : AtFeatures or None
        Where rows at features were measured: the points then have no measured places.
    """

    urdf: UrdfArm
    robot_file: Path
    fit: Fit | EvidenceFit
    nominal: Fit | PlacedRobot
    fit_points: PointSet
    heldout_points: PointSet
    measurements: MeasurementSet
    verification: MeasurementSet | None
    poses_asked: int
    excluded: tuple[Exclusion, ...]
    references: dict[str, FloatArray]
    tool_shape: dict[str, FloatArray]
    choice: Choice | None
    notes: tuple[str, ...]
    seconds: float
    other_bases: dict[str, FloatArray] = field(default_factory=dict)
    sessions: tuple[str, ...] = ()
    numbers: tuple[FloatArray | None, FloatArray | None] = (None, None)
    earlier: Earlier | None = None
    doubts: tuple[str, ...] = ()
    robot_source: tuple[str, str] | None = None
    features: AtFeatures | None = None

    def __post_init__(self) -> None:
        lock(self)

    def __repr__(self) -> str:
        poses = f"{self.fit_points.poses} fitted and {self.heldout_points.poses} held-out poses"
        return f"<Outcome of {self.robot_file.name}, model {self.fit.level}: {poses}>"

    def errors(self, calibrated: bool, heldout: bool) -> FloatArray:
        """Distances of points from the robot, or of rows from their features, shape (points,), metres."""
        if self.features is not None:
            pair = self.features.heldout if heldout else self.features.fitted
            return pair[int(calibrated)]
        points = self.heldout_points if heldout else self.fit_points
        return distances((self.fit if calibrated else self.nominal).robot, points) if len(points) else np.zeros(0)
