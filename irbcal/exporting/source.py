"""What exports are made from: a calibration with its robot, the numbers of it, test vectors and the URDF."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, Locked
from irbcal.errors import CalibrationError, OptionError
from irbcal.exporting.plain import Plain
from irbcal.exporting.robot_numbers import RobotNumbers, Vectors, constants, vectors_of
from irbcal.io import robots
from irbcal.io.opening import CalibrationLike, open_calibration, open_robot
from irbcal.io.schema import Record
from irbcal.io.urdf import speed_limits
from irbcal.io.urdf_xml import MeshFolders, MeshPaths
from irbcal.modeling.robot import Robot, carrying_payload

EXACT = 1e-12
"""Radians and metres by which an export may differ from irbcal's own kinematics: rounding."""


@dataclass(frozen=True, eq=False)
class Source(Locked):
    """A calibrated robot, ready to be exported."""

    robot: Robot
    """With the load that is carried."""
    numbers: RobotNumbers
    vectors: Vectors
    miss: float
    """By how much the plain module misses the test vectors."""
    record: Record | None = None
    urdf: bytes | None = None
    """``calibrated.urdf``."""
    folder: Path | None = None
    """Where the URDF's own relative names start."""
    out: Path = Path()
    """Where the export will lie."""
    mesh_paths: MeshPaths = "relative"
    """How meshes are to stand in a URDF."""
    package_dirs: tuple[str, ...] = ()
    """Folders in which meshes are looked up, beside the URDF's own."""
    without_meshes: bool = False
    """Leave all meshes out."""

    @property
    def meshes(self) -> MeshFolders:
        """Finds the URDF's meshes."""
        remembered = () if self.record is None else self.record.mesh_folders or ()
        return MeshFolders(self.folder, robots.package_dirs(*self.package_dirs, *remembered))

    @staticmethod
    def from_calibration(
        calibration: CalibrationLike,
        *,
        payload: float | None = None,
        payload_centre: ArrayLike | None = None,
        without_frame_terms: bool = False,
    ) -> Source:
        """What a calibration has to export.

        Parameters
        ----------
        calibration : str, Path, Record or a result that holds one
        payload, payload_centre, without_frame_terms
            See `irbcal.exporting.export.export`.

        Raises
        ------
        CalibrationError
            If it is not a whole calibration, or has frame terms or terms that exports do not know.
        RobotError
            If the payload is not known.
        """
        record, opened = open_calibration(calibration), open_robot(calibration)
        notes = []
        if record.frame_terms is not None:
            if not without_frame_terms:
                record.frame_terms.refuse()
            notes.append(record.frame_terms.in_words)
        robot = carrying_payload(opened.robot, payload, payload_centre).replace(frame_terms=None)
        speed = None if opened.urdf_bytes is None else speed_limits(opened.urdf_bytes, robot.arm.joint_names)
        return Source.of_robot(robot, record, opened.urdf_bytes, opened.folder, speed=speed, notes=tuple(notes))

    @staticmethod
    def of_robot(
        robot: Robot,
        record: Record | None = None,
        urdf: bytes | None = None,
        folder: Path | None = None,
        *,
        speed: FloatArray | None = None,
        notes: tuple[str, ...] = (),
    ) -> Source:
        """The same of a robot without frame terms.

        Raises
        ------
        CalibrationError
            If what would be exported does not compute what irbcal computes.
        """
        source = {} if record is None else {"fingerprint": record.fingerprint, "simulated": record.simulated}
        numbers = RobotNumbers.from_robot(robot, speed=speed, notes=notes, **source)  # type: ignore[arg-type]
        vectors = vectors_of(robot, numbers)
        miss = Plain(**constants(numbers, vectors)).check()
        if not miss < EXACT:
            raise CalibrationError(f"the export would miss irbcal's own kinematics by {miss:.3g}: nothing is written")
        return Source(robot, numbers, vectors, float(miss), record, urdf, folder)


def required_package(package: str, target: str) -> Any:
    """A package, imported, without which a target cannot be made.

    Raises
    ------
    OptionError
        If it is not installed.
    """
    try:
        return import_module(package)
    except ImportError:
        raise OptionError(
            f"as: {target} needs the package {package}, which is not installed here: pip install 'irbcal[{target}]'",
            parameter="as",
        ) from None
