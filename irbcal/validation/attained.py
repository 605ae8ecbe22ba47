"""What was reached and what was commanded, pose by pose and cycle by cycle: what the criteria of ISO 9283 compare."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from irbcal.arrays import BoolArray, FloatArray, IntArray, Locked, NameArray
from irbcal.measurement.columns import POSITION, InputTable, TableLike
from irbcal.measurement.points import PointSet
from irbcal.measurement.poses import as_poses
from irbcal.modeling import frames
from irbcal.modeling.robot import Robot
from irbcal.validation import accuracy
from irbcal.validation.pose_criteria import mean_rotation, small_angles
from irbcal.validation.prepared import CleanedPoints

if TYPE_CHECKING:
    import pandas as pd

NO_ORIENTATION = (
    "missing columns qw, qx, qy, qz: where a target on the tool is commanded to be depends on the orientation"
)


@dataclass(frozen=True, eq=False)
class Attained(Locked):
    """What was reached in n poses of a file, and what was commanded.

    Attributes
    ----------
    source : str
        File name for messages.
    target : str
        Whose position it is, unless poses were measured as a whole.
    q : ndarray, shape (n, joints)
        Commanded joints, radians.
    pose, group, cycle, direction, time : ndarray of str, shape (n,)
        The file's columns; empty text where there is none.
    order : ndarray of int, shape (n,)
        Which repetition of its pose in its group, counted from 0, lost ones too.
    xyz : ndarray, shape (n, 3)
        Metres.
    rotation : ndarray, shape (n, 3, 3), or None
    wanted : ndarray, shape (n, 3), or None
        Commanded positions, metres.
    wanted_rotation : ndarray, shape (n, 3, 3), or None
    """

    source: str
    target: str
    q: FloatArray
    pose: NDArray[np.str_]
    group: NDArray[np.str_]
    cycle: NDArray[np.str_]
    direction: NDArray[np.str_]
    time: NameArray
    order: IntArray
    xyz: FloatArray
    rotation: FloatArray | None = None
    wanted: FloatArray | None = None
    wanted_rotation: FloatArray | None = None

    def select(self, rows: BoolArray | IntArray) -> Attained:
        """The same for some rows."""
        fields_of_rows: dict[str, Any] = {
            name: value[rows] for name, value in vars(self).items() if isinstance(value, np.ndarray)
        }
        return replace(self, **fields_of_rows)

    def seen_from(self, T_world_base: FloatArray) -> Attained:
        """Everything in the base link: errors are then told along its axes."""
        T = frames.inverse(T_world_base)
        changes: dict[str, Any] = {}
        for name in ("xyz", "wanted"):
            if (points := getattr(self, name)) is not None:
                changes[name] = frames.apply(T, points)
        for name in ("rotation", "wanted_rotation"):
            if (rotation := getattr(self, name)) is not None:
                changes[name] = T[:3, :3] @ rotation
        return replace(self, **changes)

    def angles(self) -> FloatArray | None:
        """Angles a, b, c from the commanded orientation, or from the mean one, shape (n, 3); None without any."""
        if self.rotation is None:
            return None
        about = mean_rotation(self.rotation) if self.wanted_rotation is None else self.wanted_rotation
        return small_angles(self.rotation, about)

    def commanded_by(self, robot: Robot | None, table: InputTable | None) -> Attained:
        """With the commanded positions and orientations, where there are any.

        Parameters
        ----------
        robot : Robot, optional
            Gives commanded poses at the joints, unless a table does.
        table : DataFrame, optional
            See `commanded_poses`.

        Raises
        ------
        MeasurementError
            If the table lacks a pose or what a target's place takes.
        """
        if table is None:
            return self if robot is None else self._wanting(robot.T_world_base @ robot.poses(self.q), robot)
        names = list(table.filled("pose"))
        missing = sorted(set(self.pose) - set(names))
        if missing:
            raise table.fault(f"there is no commanded pose {missing[0]}")
        rows = [names.index(name) for name in self.pose]
        R = table.rotations()
        T = np.tile(np.eye(4), (len(rows), 1, 1))
        T[:, :3, 3] = table.si(POSITION)[rows]
        if R is not None:
            T[:, :3, :3] = R[rows]
        if robot is None:
            turned = R is not None and self.rotation is not None
            return replace(self, wanted=T[:, :3, 3], wanted_rotation=T[:, :3, :3] if turned else None)
        if self.rotation is None and R is None:
            raise table.header_fault(NO_ORIENTATION)
        return self._wanting(robot.T_world_base @ T, robot)

    def _wanting(self, T_world_tip: FloatArray, robot: Robot) -> Attained:
        """With commanded poses of the tip, or of a target on it."""
        position, R = T_world_tip[:, :3, 3], T_world_tip[:, :3, :3]
        if self.rotation is None:
            return replace(self, wanted=position + R @ robot.targets[self.target])
        return replace(self, wanted=position, wanted_rotation=R)


def commanded_poses(source: TableLike) -> InputTable:
    """A table of commanded poses: ``pose``, ``x_mm``, ``y_mm``, ``z_mm`` and for orientations ``qw`` to ``qz``.

    Raises
    ------
    MeasurementError
        If the file does not keep the format or names a pose twice.
    """
    table = InputTable.read(source, ["pose", *POSITION])
    table.refuse_repeats("pose", table.filled("pose"))
    table.si(POSITION)
    return table


def measured_whole(points: PointSet, robots: Mapping[str, Robot | None], table: InputTable | None) -> bool:
    """Whether poses are measured as a whole and what was commanded is, too."""
    if table is not None and table.rotations() is None:
        return False
    robot = next(iter(robots.values()))
    three = bool((np.bincount(points.pose) >= 3).any())
    if robot is None:
        return bool(points.oriented().any()) or (table is None and three)
    has_R = np.isin(points.names().astype(str), list(robot.target_rotations))
    return bool((points.oriented() & has_R).any()) or three


def attained(cleaned: CleanedPoints, robot: Robot | None, full_poses: bool) -> Attained:
    """What was reached, in the measuring frame.

    Parameters
    ----------
    cleaned : CleanedPoints
        Of one target, unless poses are regarded as a whole.
    robot : Robot, optional
        Knows the places of the targets on the tip; without it the targets themselves make up a frame.
    full_poses : bool
        Regard poses, see `measured_whole`, instead of the position of the target.
    """
    points, source = cleaned.points, cleaned.measurements.source
    if not full_poses:
        return _of_rows(cleaned, points.pose, points.xyz)
    if robot is not None:
        tips = accuracy.tip_errors(robot, points, source)
        return _of_rows(cleaned, tips.pose, tips.T_world_tip[:, :3, 3], tips.T_world_tip[:, :3, :3])
    if points.rotation is not None and points.oriented().any():
        rows = np.flatnonzero(points.oriented())
        return _of_rows(cleaned, points.pose[rows], points.xyz[rows], points.rotation[rows])
    poses, _ = as_poses(replace(points, pose_ids=np.arange(points.poses)), source)
    return _of_rows(cleaned, poses.pose_ids, poses.xyz, poses.rotation)


def _of_rows(cleaned: CleanedPoints, rows: Any, xyz: FloatArray, rotation: FloatArray | None = None) -> Attained:
    points = cleaned.points
    return Attained(
        source=cleaned.measurements.source,
        target=str(points.names()[0]),
        q=points.q[rows],
        pose=points.pose_ids[rows].astype(str),
        group=points.groups[rows].astype(str),
        cycle=cleaned.labels("cycle")[rows].astype(str),
        direction=cleaned.labels("direction")[rows].astype(str),
        time=cleaned.labels("time_s")[rows],
        order=_order(cleaned.measurements.table)[cleaned.number[rows]],
        xyz=xyz,
        rotation=rotation,
    )


def _order(table: pd.DataFrame) -> IntArray:
    """Which repetition of its pose in its group each pose of the file is, counted from 0, lost ones too."""
    first = table.drop_duplicates("pose_index").sort_values("pose_index")
    keys = [name for name in ("pose", "group") if name in table.columns]
    return first.groupby(keys).cumcount().to_numpy()
