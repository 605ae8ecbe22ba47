"""The measured points and poses of a calibration, column by column, and back as points.

In memory points are a `PointSet` in SI units, fitted and held-out ones apart; here they stand together, rounded, in the
units of measurement files, and large ones go to files of their own.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np
from pydantic import Field, StringConstraints, model_validator

from irbcal.arrays import FloatArray, NameArray, plain
from irbcal.measurement.column_names import input_of
from irbcal.measurement.points import PointSet
from irbcal.measurement.session_blocks import stacked
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms import inputs
from irbcal.section import Names, Section, Word
from irbcal.units import MM

PLACE_DIGITS, JOINT_DIGITS, QUATERNION_DIGITS = 6, 9, 12
"""Decimals of measured places (mm), joints (degrees, mm) and quaternions: far below what is measured."""


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
    def from_points(
        fitted: PointSet, heldout: PointSet, errors: Sequence[FloatArray], placed: bool = True
    ) -> PointTable:
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
    def from_points(
        fitted: PointSet, heldout: PointSet, arm: Arm, came_from: FloatArray, number: FloatArray
    ) -> PoseTable:
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
        told = {
            name: stacked([(points.inputs.get(name), points.poses) for points in sets])
            for name in dict.fromkeys(name for points in sets for name in points.inputs)
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


def used_points(t: PointTable, p: PoseTable, units: FloatArray, heldout: bool | None) -> tuple[PointSet, FloatArray]:
    """The fitted or held-out points or (None) all, and the directions from which their joints were reached.

    ``units`` are the radians of a degree, or metres of a millimetre, of each joint.
    """
    poses, mask = (
        np.array([heldout is None or kind == heldout for kind in table.heldout], dtype=bool) for table in (p, t)
    )
    labels = np.array(t.target, dtype=object)[mask]
    names = sorted(set(labels))
    target = np.zeros(len(labels), dtype=int)
    for k, name in enumerate(names):
        target[labels == name] = k
    u95 = np.array(t.u95_mm, dtype=float)[mask] * MM if t.u95_mm else None
    told = {
        quantity.name: quantity.from_columns([p.inputs[name] for name in quantity.names(len(units))])[poses]
        for quantity in inputs().values()
        if quantity.names(1)[0] in p.inputs
    }
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
        inputs={name: values for name, values in told.items() if np.isfinite(values).any()},
    )
    codes = np.array([np.frombuffer(column.encode("ascii"), dtype=np.uint8) for column in p.came_from])
    came_from = np.where(codes == ord("+"), 1.0, np.where(codes == ord("-"), -1.0, 0.0)).T[poses]
    came_from.flags.writeable = False
    return points, came_from


def texts(names: NameArray) -> NameArray:
    """Names as text."""
    return np.array([str(name) for name in names.tolist()], dtype=object)
