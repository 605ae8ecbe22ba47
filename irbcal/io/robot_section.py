"""The robot as ``calibration.json`` has it: names, limits, DHM tables, frames, base and targets.

All of it is in the file's units: the fingerprint is of these digits, and a number that goes to SI units and back may
have another last digit.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Literal, TypeAlias

import numpy as np
from pydantic import Field, GetPydanticSchema
from pydantic_core import core_schema

from irbcal.arrays import FloatArray
from irbcal.modeling import coupling, frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.dhm import DHMTable
from irbcal.modeling.robot import Robot
from irbcal.section import Name, Names, Section, Sha256, in_unit
from irbcal.units import DEG, MM, joint_unit

Three: TypeAlias = Annotated[list[float], Field(min_length=3, max_length=3)]
"""A place, or three angles."""
Four: TypeAlias = Annotated[list[float], Field(min_length=4, max_length=4)]
"""Scalar first."""
FourByFour: TypeAlias = Annotated[list[Four], Field(min_length=4, max_length=4)]
"""A rigid frame, row by row."""


class DhmRow(Section):
    """One row of a DHM table; ``beta`` is Hayati's tilt about y, ``b`` a shift along y."""

    alpha_deg: float
    a_mm: float
    theta_deg: float
    d_mm: float
    beta_deg: float
    b_mm: float

    @staticmethod
    def from_table(table: DHMTable) -> list[DhmRow]:
        """The rows of a table."""
        values = {name: getattr(table, name.partition("_")[0]) / unit for name, unit in DHM_UNITS.items()}
        return [DhmRow(**{name: column[i] for name, column in values.items()}) for i in range(len(table.a))]

    @staticmethod
    def table(rows: Sequence[DhmRow], prismatic: Sequence[bool]) -> DHMTable:
        """The table of rows."""
        columns = {
            name.partition("_")[0]: np.array([getattr(row, name) * unit for row in rows])
            for name, unit in DHM_UNITS.items()
        }
        return DHMTable(**columns, prismatic=np.array(prismatic, dtype=bool))


DHM_UNITS = {"alpha_deg": DEG, "a_mm": MM, "theta_deg": DEG, "d_mm": MM, "beta_deg": DEG, "b_mm": MM}


class FilePose(Section):
    """A frame: position and unit quaternion, scalar first."""

    x_mm: float
    y_mm: float
    z_mm: float
    qw: float
    qx: float
    qy: float
    qz: float

    @staticmethod
    def from_transform(T: FloatArray) -> FilePose:
        """From a transform, shape (4, 4), metres."""
        w, x, y, z = frames.quaternion_from_matrix(T[:3, :3]).tolist()
        return FilePose(x_mm=T[0, 3] / MM, y_mm=T[1, 3] / MM, z_mm=T[2, 3] / MM, qw=w, qx=x, qy=y, qz=z)

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


def _transform(pose: FilePose) -> FloatArray:
    if abs(pose.quaternion_norm - 1.0) > QUATERNION_TOLERANCE:
        raise ValueError("expected a unit quaternion")
    return pose.transform()


Transform: TypeAlias = Annotated[
    FloatArray,
    GetPydanticSchema(
        lambda _, handler: core_schema.no_info_after_validator_function(
            _transform,
            handler.generate_schema(FilePose),
            serialization=core_schema.plain_serializer_function_ser_schema(
                lambda T: FilePose.from_transform(T).model_dump()
            ),
        )
    ),
]
"""A transform (4, 4) in metres, in the file a `FilePose`."""


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
    base_to_frame0: FourByFour
    last_frame_to_tip: FourByFour
    dhm_nominal: list[DhmRow]
    dhm_calibrated: list[DhmRow]
    coupling: list[list[float]] | None = None
    joints_up: int | None = None

    @staticmethod
    def from_arm(arm: Arm, calibrated: DHMTable, urdf: str, sha256: str) -> RobotSection:
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
            dhm_nominal=DhmRow.from_table(arm.table),
            dhm_calibrated=DhmRow.from_table(calibrated),
            coupling=None if arm.coupling is None else arm.coupling.tolist(),
            joints_up=arm.joints_up or None,
        )

    @property
    def joint_units(self) -> FloatArray:
        """Radians of a degree, or metres of a millimetre, of each joint, shape (joints,)."""
        return np.array([size for _, size in self.units])

    @property
    def units(self) -> list[tuple[str, float]]:
        """See `irbcal.units.joint_unit`, of each joint."""
        return [joint_unit(kind == "prismatic") for kind in self.joint_types]

    def arm(self, calibrated: bool) -> Arm:
        """The calibrated or the nominal arm."""
        lower, upper = (
            np.array([sign * np.inf if value is None else value for value in values]) * self.joint_units
            for sign, values in ((-1, self.lower), (1, self.upper))
        )
        slides = [kind == "prismatic" for kind in self.joint_types]
        return Arm(
            self.name,
            DhmRow.table(self.dhm_calibrated if calibrated else self.dhm_nominal, slides),
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
    def from_transform(T: FloatArray) -> OriginSection:
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
    """Base in the measuring frame; targets and target frames (unit quaternion, scalar first) in the tip link."""

    base: FilePose
    targets_mm: dict[Name, Three]
    target_quaternions: dict[Name, Four]

    @staticmethod
    def from_robot(robot: Robot) -> Placement:
        """Base and targets of a robot."""
        rotations = robot.target_rotations.items()
        return Placement(
            base=FilePose.from_transform(robot.T_world_base),
            targets_mm=in_unit(robot.targets, MM),
            target_quaternions={name: frames.quaternion_from_matrix(R).tolist() for name, R in rotations},
        )

    def base_and_targets(self) -> tuple[FloatArray, dict[str, FloatArray], dict[str, FloatArray]]:
        """Base, targets and their orientations as a `Robot` has them, metres."""
        rotations = {name: frames.matrix_from_quaternion(q) for name, q in self.target_quaternions.items()}
        return self.base.transform(), {name: np.array(xyz) * MM for name, xyz in self.targets_mm.items()}, rotations
