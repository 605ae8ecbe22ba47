"""Poses of ISO 9283:1998: the test cube (Nubiola 2011, annex I), and pose tests, read and judged.

The standard itself was not at hand: the cube is that of public descriptions and of the thesis (section 7.2).

The pose tests are measurements with the columns ``pose`` (P1 to P5, or any names) and ``cycle``. Where there is a
column ``group``, rows of ``iso9283`` are the cycles of pose accuracy and repeatability; rows with something in a column
``direction`` (three directions of approach) are those of the multi-directional variation, and rows of the group
``iso9283_drift`` the sets of the drift test, in the order of the file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from irbcal.arrays import BoolArray, FloatArray, IntArray, Locked, NameArray
from irbcal.error_statistics import rotation_statistics, statistics
from irbcal.errors import MeasurementError, RobotError
from irbcal.io.schema import Record
from irbcal.measurement.cleaning import Exclusion, left_out
from irbcal.measurement.column_names import POSITION
from irbcal.measurement.input_table import InputTable, TableLike, poses_to_frame
from irbcal.measurement.points import PointSet
from irbcal.measurement.poses import as_poses
from irbcal.measurement.table import MeasurementSet
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.inverse import closed_form
from irbcal.modeling.robot import Robot
from irbcal.plotting.charts import (
    DASHED,
    DOT,
    TALL,
    WIDE,
    Chart,
    Drawing,
    LegendEntry,
    Panel,
    Sign,
    axis_top,
    grouped_panel,
    span,
)
from irbcal.simulation.instruments import iso_cube
from irbcal.summary import Paragraph, Result, Table, TableValue, remarks, simulated_mark
from irbcal.units import DEG, MM
from irbcal.validation import accuracy, pose_criteria
from irbcal.validation.cleaned_points import CleanedPoints, prepare
from irbcal.validation.pose_criteria import ANGLES, AXES, mean_rotation, small_angles

if TYPE_CHECKING:
    import pandas as pd


ISO_POSES = ("P1", "P2", "P3", "P4", "P5")

FRACTION = float(0.1 * np.sqrt(2.0 / 3.0))
"""Distance of P2 to P5 from the corners as a share of the cube's diagonal, as the thesis has it: 8.2 %.

ISO 9283 asks for (10 +- 2) %; the thesis's 91.9 mm (Table A I-1) are 10 % of the diagonal of a face.
"""

CubePlane: TypeAlias = Literal["x=z", "x=-z", "y=z", "y=-z"]

PLANES: dict[CubePlane, tuple[tuple[int, int, int], ...]] = {
    "x=z": ((1, 1, 1), (1, -1, 1), (-1, -1, -1), (-1, 1, -1)),
    "x=-z": ((1, 1, -1), (1, -1, -1), (-1, -1, 1), (-1, 1, 1)),
    "y=z": ((1, 1, 1), (-1, 1, 1), (-1, -1, -1), (1, -1, -1)),
    "y=-z": ((1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1)),
}
"""Inclined planes of the cube, and the directions of P2 to P5 from its centre; the thesis took ``x=z``."""

IRB120_CUBE = "irb120_3_058", (np.array([0.374, 0.0, 0.40]), 0.25)
"""Name of the arm, centre in the base link and edge of its test cube, metres."""


@dataclass(frozen=True, eq=False, repr=False)
class FivePoses(Result):
    """The five test poses and the joints that reach them.

    Attributes
    ----------
    arm : Arm
    T_base_tip : ndarray, shape (5, 4, 4)
        The tip in the base link, metres.
    q : ndarray, shape (5, joints)
        Radians (metres for prismatic joints).
    """

    arm: Arm
    T_base_tip: FloatArray
    q: FloatArray

    def to_frame(self) -> pd.DataFrame:
        """The poses as a table.

        Returns
        -------
        DataFrame
            ``pose``, the arm's joint columns (degrees, mm), ``x_mm``, ``y_mm``, ``z_mm`` and the unit quaternion ``qw``
            to ``qz`` (scalar first, ``qw`` not negative) of the tip in the base link: what `irbcal plan` and
            ``commanded`` of `irbcal.validation.iso9283_check.iso9283` take.
        """
        import pandas as pd

        q = pd.DataFrame({"pose": ISO_POSES, **self.arm.joint_table(self.q)})
        return q.join(poses_to_frame(self.arm.forward(self.q)))

    CONTENT = "robot=arm.name poses=to_frame"

    def report(self) -> Sequence[Paragraph]:
        """The poses, one a row."""
        sentence = f"The five test poses of ISO 9283 for {self.arm.name}, P1 in the centre of its cube."
        return [sentence, Table.from_frame("Joints and tip in the base link, degrees and mm", self.to_frame())]


def cube_poses(
    center: ArrayLike, edge: float, rotation: FloatArray, plane: CubePlane = "x=z", fraction: float = FRACTION
) -> FloatArray:
    """P1 in the centre of a cube parallel to the base, P2 to P5 on the diagonals of an inclined plane.

    Parameters
    ----------
    center : array_like, shape (3,)
        Metres, in the base link.
    edge : float
        Metres.
    rotation : ndarray, shape (3, 3)
        Orientation of the tip, the same in all poses.
    plane : str
        One of `PLANES`.
    fraction : float
        Distance from the corners as a share of the cube's diagonal.

    Returns
    -------
    ndarray, shape (5, 4, 4)

    Raises
    ------
    RobotError
        If the plane is none or the sizes make no cube.
    """
    if plane not in PLANES:
        raise RobotError(f"the inclined planes of the cube are {', '.join(PLANES)}, not {plane!r}")
    if not (edge > 0 and 0 <= fraction < 0.5):
        raise RobotError(
            f"a test cube needs an edge above zero and points between centre and corners, found {edge:g} m"
        )
    T = np.tile(frames.transform(rotation, center), (5, 1, 1))
    T[1:, :3, 3] += np.array(PLANES[plane]) * edge * (0.5 - fraction)
    return T


def five_poses(
    arm: Arm,
    center: ArrayLike | None = None,
    edge: float | None = None,
    near: ArrayLike | None = None,
    plane: CubePlane = "x=z",
    fraction: float = FRACTION,
) -> FivePoses:
    """The five test poses and the joints that reach them; the tip keeps the orientation it has at ``near``.

    Parameters
    ----------
    arm : Arm
        Nominal.
    center, edge, plane, fraction
        See `cube_poses`; unless given, `IRB120_CUBE`, or of other arms
        `irbcal.simulation.instruments.iso_cube` above the origin of the base link.
    near : array_like, shape (joints,), optional
        Joints that set the tip's orientation, and which the solutions are to be near, radians; zero (or the nearest to
        it within the limits) unless given.

    Raises
    ------
    RobotError
        If a pose is out of reach.
    """

    def above_base(q: FloatArray) -> BoolArray:
        """Most arms stand on a floor, which nothing here tells of."""
        return np.asarray(arm.forward(q)[:, 2, 3] > 0.0)

    if center is None or edge is None:
        usual_center, usual_edge = IRB120_CUBE[1] if arm.name == IRB120_CUBE[0] else iso_cube(arm, above_base)
        center, edge = usual_center if center is None else center, usual_edge if edge is None else edge
    home = np.clip(np.zeros(len(arm.lower)), arm.lower, arm.upper)
    at = home if near is None else arm.check_joints(near)[0]
    T = cube_poses(center, edge, arm.forward(at[None])[0, :3, :3], plane, fraction)
    if closed_form.has_closed_form(arm):
        q, branch = closed_form.nearest(arm, closed_form.branches(arm, T), at)
        reached = branch >= 0
    else:
        from irbcal.modeling.inverse import any_arm
        from irbcal.modeling.robot import Robot

        solution = any_arm.solve(Robot(arm), arm, T, at)
        q, reached = solution.joints, solution.converged & solution.inside
    if not reached.all():
        k = int(np.flatnonzero(~reached)[0])
        x, y, z = T[k, :3, 3] / MM
        raise RobotError(
            f"{arm.name} does not reach {ISO_POSES[k]} at {x:.1f}, {y:.1f}, {z:.1f} mm within its joint limits: choose "
            "a smaller cube, another centre or another orientation"
        )
    return FivePoses(arm, T, q + 0.0)


NO_ORIENTATION = (
    "missing columns qw, qx, qy, qz: where a target on the tool is commanded to be depends on the orientation"
)


@dataclass(frozen=True, eq=False)
class Attained(Locked):
    """What was reached in n poses of a file, and what was commanded."""

    source: str
    """File name for messages."""
    target: str
    """Whose position it is, unless poses were measured as a whole."""
    q: FloatArray
    """Shape (n, joints). Commanded joints, radians."""
    pose: NDArray[np.str_]
    group: NDArray[np.str_]
    session: NDArray[np.str_]
    cycle: NDArray[np.str_]
    direction: NDArray[np.str_]
    time: NameArray
    """Shape (n,). The file's columns; empty text where there is none."""
    order: IntArray
    """Shape (n,). Which repetition of its pose in its group, counted from 0, lost ones too."""
    xyz: FloatArray
    """Shape (n, 3). Metres."""
    rotation: FloatArray | None = None
    """Shape (n, 3, 3)."""
    commanded: FloatArray | None = None
    """Shape (n, 3). Commanded positions, metres."""
    commanded_rotation: FloatArray | None = None
    """Shape (n, 3, 3)."""

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
        for name in ("xyz", "commanded"):
            if (points := getattr(self, name)) is not None:
                changes[name] = frames.apply(T, points)
        for name in ("rotation", "commanded_rotation"):
            if (rotation := getattr(self, name)) is not None:
                changes[name] = T[:3, :3] @ rotation
        return replace(self, **changes)

    def angles(self) -> FloatArray | None:
        """Angles a, b, c from the commanded orientation, or from the mean one, shape (n, 3); None without any."""
        if self.rotation is None:
            return None
        about = mean_rotation(self.rotation) if self.commanded_rotation is None else self.commanded_rotation
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
            return replace(self, commanded=T[:, :3, 3], commanded_rotation=T[:, :3, :3] if turned else None)
        if self.rotation is None and R is None:
            raise table.header_fault(NO_ORIENTATION)
        return self._wanting(robot.T_world_base @ T, robot)

    def _wanting(self, T_world_tip: FloatArray, robot: Robot) -> Attained:
        """With commanded poses of the tip, or of a target on it."""
        position, R = T_world_tip[:, :3, 3], T_world_tip[:, :3, :3]
        if self.rotation is None:
            return replace(self, commanded=position + R @ robot.targets[self.target])
        return replace(self, commanded=position, commanded_rotation=R)


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
    return bool(points.oriented(robot).any()) or (three and (robot is not None or table is None))


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
        session=cleaned.labels("session")[rows].astype(str),
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


GROUP, DRIFT = "iso9283", "iso9283_drift"

PoseValues: TypeAlias = "dict[str, int | float | None]"


@dataclass(frozen=True, eq=False)
class ModelCriteria(Locked):
    """Criteria by one model, in mm and degrees, along and about the axes of the base link.

    Without a calibration there is no base link: axes are then those of the measuring frame.
    """

    poses: dict[str, PoseValues]
    """Of each pose ``n``, ``AP_mm`` (None without a command), ``RP_mm``, mean, sigma and largest distance from the mean
    (``l_mean_mm``, ...), ``AP_x_mm``, ...; with orientations ``RP_a_deg``, ..., ``AP_a_deg``, ...
    """
    overall: dict[str, Any] | None
    """Errors of all poses and cycles ``from`` the command or the mean: statistics of ``position`` and ``orientation``
    (Nubiola 2011, Table 7.8).
    """
    distance: dict[str, Any] | None
    """``AD_mm`` and ``RD_mm`` from P2 to P4, along the axes ``AD_x_mm``, ``RD_x_mm``, …, and with orientations about
    them ``AD_a_deg``, ``RD_a_deg``, …
    """
    directions: dict[str, dict[str, float]] | None
    """``vAP_mm``, ``vAP_x_mm``, … and, with orientations, ``vAP_a_deg``, … of each pose over its ``directions`` of
    approach.
    """
    drift: dict[str, Any] | None
    """``RP_mm``, ``AP_mm`` and ``shift_mm`` of each of the ``sets`` of cycles, ``dRP_mm``, ``dAP_mm``."""
    history: dict[str, Any] | None
    """``pose``, ``cycle``, ``position_mm`` and ``orientation_deg`` of each cycle, in the order of the file."""


def criteria(attained: Attained, set_size: int) -> ModelCriteria:
    """The criteria of what was reached.

    Parameters
    ----------
    attained : Attained
    set_size : int
        Cycles of a set of the drift test.

    Raises
    ------
    MeasurementError
        If no row belongs to a test, a pose was measured once only, or directions or sets are too few.
    """
    grouped = (attained.group == GROUP).any()
    approached = attained.direction != ""
    drifting = attained.group == DRIFT
    plain = ~approached & ~drifting & ((attained.group == GROUP) | ~np.bool_(grouped))
    if not (plain.any() or approached.any() or drifting.any()):
        raise MeasurementError(f"no usable row of the groups {GROUP} and {DRIFT}", file=attained.source)
    poses: dict[str, PoseValues] = {}
    overall = history = distance = None
    if plain.any():
        cycles = attained.select(plain)
        poses = {name: _pose(cycles, name) for name in _in_order(cycles.pose)}
        overall, history = _overall(cycles)
        distance = _distance(cycles)
    return ModelCriteria(
        poses=poses,
        overall=overall,
        distance=distance,
        directions=_directions(attained.select(approached)) if approached.any() else None,
        drift=_drift(attained.select(drifting), set_size) if drifting.any() else None,
        history=history,
    )


def _in_order(names: NDArray[np.str_]) -> list[str]:
    """Names as they come first, P1 to P5 in that order."""
    ordered = [str(name) for name in dict.fromkeys(names)]
    return sorted(ordered) if set(ordered) <= set(ISO_POSES) else ordered


def _mm(value: float) -> float:
    return float(value / MM)


def _pose(cycles: Attained, name: str) -> PoseValues:
    cycles_of_pose = cycles.select(cycles.pose == name)
    n = len(cycles_of_pose.xyz)
    if n < 2:
        raise MeasurementError(
            f"pose {name} was measured in one cycle only: repeatability needs two", file=cycles.source
        )
    repeatability, distance = pose_criteria.position_repeatability(cycles_of_pose.xyz)
    out: PoseValues = {
        "n": n,
        "AP_mm": None,
        "RP_mm": _mm(repeatability),
        "l_mean_mm": _mm(distance.mean()),
        "l_sigma_mm": _mm(distance.std(ddof=1)),
        "l_max_mm": _mm(distance.max()),
    }
    if cycles_of_pose.commanded is not None:
        # the joints, and so the commanded places, may differ between cycles by the readings' last digit
        shift = cycles_of_pose.xyz - cycles_of_pose.commanded
        total, axes = pose_criteria.pose_accuracy(shift, 0.0)
        out |= {"AP_mm": _mm(total)} | _by_axis("AP", axes)
    angles = cycles_of_pose.angles()
    if angles is not None:
        out |= _by_axis("RP", pose_criteria.angle_repeatability(angles), ANGLES)
        if cycles_of_pose.commanded_rotation is not None:
            out |= _by_axis("AP", pose_criteria.angle_accuracy(angles), ANGLES)
    return out


def _overall(cycles: Attained) -> tuple[dict[str, Any], dict[str, Any]]:
    """Errors of every pose and cycle (Table 7.8, Figures 7.8 and 7.9): from the command, else from the pose's mean."""
    names = _in_order(cycles.pose)
    if cycles.commanded is not None:
        error = np.linalg.norm(cycles.xyz - cycles.commanded, axis=1)
    else:
        error = np.empty(len(cycles.xyz))
        for name in names:
            rows = cycles.pose == name
            error[rows] = pose_criteria.position_repeatability(cycles.xyz[rows])[1]
    turn = None
    if cycles.rotation is not None:
        about = cycles.commanded_rotation
        if about is None:
            means = {name: pose_criteria.mean_rotation(cycles.rotation[cycles.pose == name]) for name in names}
            about = np.array([means[name] for name in cycles.pose])
        turn = frames.rotation_distance(cycles.rotation, about)
    overall = {
        "from": "commanded" if cycles.commanded is not None else "mean",
        "position": dict(statistics(error) or {}),
        "orientation": None if turn is None else dict(rotation_statistics(turn) or {}),
    }
    history = {
        "pose": cycles.pose.tolist(),
        "cycle": cycles.cycle.tolist(),
        "position_mm": (error / MM).tolist(),
        "orientation_deg": None if turn is None else (turn / DEG).tolist(),
    }
    return overall, history


def _distance(cycles: Attained) -> dict[str, Any] | None:
    """Between P2 and P4, in the cycles that have both; None for fewer than two."""
    import pandas as pd

    rows = pd.DataFrame({"pose": cycles.pose, "session": cycles.session, "cycle": cycles.cycle})
    rows["repetition"] = rows.groupby(["pose", "session", "cycle"]).cumcount()  # a number that was used again
    rows["row"] = rows.index
    p2, p4 = (rows[rows["pose"] == name].drop(columns="pose") for name in ("P2", "P4"))
    common = p2.merge(p4, on=["session", "cycle", "repetition"])
    if len(common) < 2:
        return None
    first, second = (cycles.select(common[name].to_numpy()) for name in ("row_x", "row_y"))
    commanded = [None if pose.commanded is None else pose.commanded.mean(axis=0) for pose in (first, second)]
    total, spread = pose_criteria.distance_accuracy(first.xyz, second.xyz, *commanded)
    out: dict[str, Any] = {
        "poses": ["P2", "P4"],
        "n": len(common),
        "AD_mm": None if total is None else _mm(total),
        "RD_mm": _mm(spread),
    }
    accuracy, scatter = pose_criteria.distance_along_axes(first.xyz, second.xyz, *commanded)
    out |= _by_axis("AD", accuracy) | _by_axis("RD", scatter)
    if first.rotation is not None and second.rotation is not None:
        turns, meant = small_angles(first.rotation, second.rotation), None
        if first.commanded_rotation is not None and second.commanded_rotation is not None:
            meant = small_angles(first.commanded_rotation, second.commanded_rotation).mean(axis=0)
        zero = np.zeros(3)
        accuracy, scatter = pose_criteria.distance_along_axes(turns, zero, meant, None if meant is None else zero)
        out |= _by_axis("AD", accuracy, ANGLES) | _by_axis("RD", scatter, ANGLES)
    return out


def _by_axis(name: str, values: FloatArray | None, axes: str = AXES) -> dict[str, Any]:
    """A criterion along the axes in mm, or about them (`ANGLES`) in degrees, by its names."""
    unit, size = ("mm", MM) if axes == AXES else ("deg", DEG)
    return {f"{name}_{a}_{unit}": None if values is None else float(values[k] / size) for k, a in enumerate(axes)}


def _directions(approached: Attained) -> dict[str, dict[str, float]]:
    """Variation of each pose over its directions of approach."""
    out: dict[str, dict[str, float]] = {}
    for name in _in_order(approached.pose):
        cycles = approached.select(approached.pose == name)
        ways = list(dict.fromkeys(cycles.direction))
        if len(ways) < 2:
            raise MeasurementError(
                f"pose {name} was approached from {ways[0]} only: the variation needs several directions (ISO 9283: "
                "three, perpendicular)",
                file=approached.source,
                column="direction",
            )
        means = np.array([cycles.xyz[cycles.direction == direction].mean(axis=0) for direction in ways])
        out[name] = {"directions": len(ways), "vAP_mm": _mm(pose_criteria.multidirectional_variation(means))}
        out[name] |= _by_axis("vAP", np.ptp(means, axis=0))
        angles = cycles.angles()
        if angles is not None:
            means = np.array([angles[cycles.direction == direction].mean(axis=0) for direction in ways])
            out[name] |= _by_axis("vAP", np.ptp(means, axis=0), ANGLES)
    return out


def _drift(drifting: Attained, set_size: int) -> dict[str, Any]:
    """Of the first pose of the group (P1)."""
    name = _in_order(drifting.pose)[0]
    cycles = drifting.select(drifting.pose == name)
    rows = [np.flatnonzero(cycles.order // set_size == k) for k in range(int(cycles.order.max()) // set_size + 1)]
    rows = [k for k in rows if len(k) > set_size // 2 and len(k) > 1]  # lost points and an unfinished last set
    if len(rows) < 2:
        raise MeasurementError(
            f"group {DRIFT} has {len(cycles.xyz)} cycles of {name}: drift needs two sets of {set_size}",
            file=drifting.source,
        )
    meant = None if cycles.commanded is None else cycles.commanded.mean(axis=0)
    values = pose_criteria.drift([cycles.xyz[k] for k in rows], meant)
    timed = (cycles.time != "").all()
    out: dict[str, Any] = {
        "pose": name,
        "sets": len(rows),
        "set_size": set_size,
        "n": [len(k) for k in rows],
        "RP_mm": (values.RP / MM).tolist(),
        "shift_mm": (values.shift / MM).tolist(),
        "dRP_mm": _mm(values.dRP),
    }
    if values.AP is not None and values.dAP is not None:
        out |= {"AP_mm": (values.AP / MM).tolist(), "dAP_mm": _mm(values.dAP)}
    return out | {"time_s": [float(np.mean(cycles.time[k].astype(float))) for k in rows] if timed else None}


SET_SIZE = 10
"""Cycles of a set of the drift test."""


@dataclass(frozen=True, eq=False, repr=False)
class PoseCheck(Result):
    """Pose accuracy and repeatability, variation, distance and drift."""

    subject: str
    """What was regarded: ``flange``, ``measured frame``, ``all targets``, or a target."""
    models: dict[str, ModelCriteria]
    """``nominal`` and ``calibrated``; ``measured`` without a calibration."""
    excluded: tuple[Exclusion, ...]
    notes: tuple[str, ...]
    simulated: bool

    def default_band(self) -> float | None:
        """RP of P1, else of the first pose, metres: the limit band of stabilisation unless one is given."""
        poses = next(iter(self.models.values())).poses
        values = poses.get("P1") or next(iter(poses.values()), None)
        return None if values is None or values["RP_mm"] is None else values["RP_mm"] * MM

    CONTENT = "subject models excluded notes simulated"

    def to_frame(self) -> pd.DataFrame:
        """A row for each model and pose: ``model``, ``pose`` and its criteria."""
        import pandas as pd

        rows = [
            {"model": name, "pose": pose, **values}
            for name, model in self.models.items()
            for pose, values in model.poses.items()
        ]
        return pd.DataFrame(rows)

    def cycles_to_frame(self) -> pd.DataFrame:
        """A row for each model and cycle: ``model``, ``pose``, ``cycle``, ``position_mm``, ``orientation_deg``."""
        import pandas as pd

        tables = [pd.DataFrame({"model": name, **m.history}) for name, m in self.models.items() if m.history]
        return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()

    def report(self) -> Sequence[Paragraph]:
        """The criteria pose by pose, over all poses, and what was left out."""
        start = simulated_mark(self.simulated)
        out: list[Paragraph] = [f"{start}ISO 9283, {self.subject}: {self._said_shortly()}."]
        for name, model in self.models.items():
            if model.poses:
                out += _tables_of_poses(f"{start}ISO 9283, {self.subject}, {name}", model.poses)
        out += _table_over_all(self.models)
        for name, model in self.models.items():
            if model.distance:
                out += _of_distance(name, model.distance)
        last = list(self.models.values())[-1]
        for pose, values in (last.directions or {}).items():
            angles = "".join(f", {x} {values[f'vAP_{x}_mm']:.3f}" for x in AXES)
            angles += "".join(f", {a} {values[f'vAP_{a}_deg']:.4f}°" for a in ANGLES if f"vAP_{a}_deg" in values)
            out.append(
                f"Variation over {values['directions']} directions, {pose}: vAP {values['vAP_mm']:.3f} mm{angles}"
            )
        for name, model in self.models.items():
            if model.drift:
                d = model.drift
                accuracy = f"dAP {d['dAP_mm']:+.3f} mm, " if "dAP_mm" in d else ""
                out.append(
                    f"Drift of {d['pose']} over {d['sets']} sets of {d['set_size']}, {name}: {accuracy}dRP "
                    f"{d['dRP_mm']:+.3f} mm, way of the mean {d['shift_mm'][-1]:.3f} mm"
                )
        return [
            *out,
            *left_out(self.excluded),
            *remarks("Note", self.notes),
        ]

    def _said_shortly(self) -> str:
        said = []
        for name, model in self.models.items():
            if model.overall:
                position = model.overall["position"]
                said.append(f"{name} {position['mean_mm']:.3f} mm (mean), {position['max_mm']:.3f} mm (largest)")
        return "position errors " + "; ".join(said) if said else "variation and drift"

    def plot(self) -> Chart:
        """Position and orientation errors by pose, in each pose by cycle (Figures 7.8 and 7.9).

        Raises
        ------
        MeasurementError
            If no cycles of pose accuracy were measured.
        """
        if not self.has_cycles:
            raise MeasurementError("there is nothing to draw: no cycles of pose accuracy were measured")
        models = {name: (m, m.history) for name, m in self.models.items() if m.history}
        turned = all(history["orientation_deg"] is not None for _, history in models.values())
        kinds = [("position_mm", "position error (mm)"), ("orientation_deg", "orientation error (°)")]
        drawings: list[Drawing] = []
        legend: list[LegendEntry] = []
        about = ""
        for key, label in kinds[: 2 if turned else 1]:
            rows: dict[str, FloatArray] = {}
            for name, (model, history) in models.items():
                order = np.argsort([list(model.poses).index(p) for p in history["pose"]], kind="stable")
                labels = [history["pose"][k] for k in order]
                rows[name] = np.array(history[key], dtype=float)[order]
                about = (model.overall or {})["from"]
            drawing = Drawing(label, 0.7 * TALL, WIDE)
            panel = grouped_panel(drawing, labels, (0.0, axis_top(*rows.values())), "pose, in each by cycle", label)
            for name, values in rows.items():
                panel.dots(np.arange(len(values)), values, name, DOT)
            drawings.append(drawing)
        for name, (model, _) in models.items():
            mean = (model.overall or {})["position"]["mean_mm"]
            legend.append((name, "o", f"{name} (mean {mean:.3f} mm)"))
        caption = f"Errors by pose and cycle, from the {'command' if about == 'commanded' else 'mean'}"
        return Chart("poses", caption, drawings, legend, 1).marked(self.simulated)

    def plot_drift(self) -> Chart:
        """Accuracy and repeatability of each set of cycles of the drift test.

        Raises
        ------
        MeasurementError
            If no drift was measured.
        """
        if not self.has_drift:
            raise MeasurementError("there is nothing to draw: no drift was measured")
        measured = {name: model.drift for name, model in self.models.items() if model.drift}
        rows: list[tuple[str, Sign, str, FloatArray]] = []
        for name, values in measured.items():
            x = np.arange(1.0, values["sets"] + 1) if values["time_s"] is None else np.array(values["time_s"]) / 3600
            if "AP_mm" in values:
                rows.append((name, "-", f"AP, {name}", np.array(values["AP_mm"])))
        last = list(measured.values())[-1]
        rows.append(("measured", "--", "RP", np.array(last["RP_mm"])))
        rows.append(("unknown", "--", "way of the mean", np.array(last["shift_mm"])))
        drawing = Drawing("Drift", TALL, WIDE)
        label = "time (h)" if last["time_s"] else f"set of {last['set_size']} cycles"
        panel = Panel(drawing, span(x), (0.0, axis_top(*(y for *_, y in rows))), label, "AP, RP, way (mm)")
        for colour, sign, _, y in rows:
            panel.line(x, y, colour, dash="" if sign == "-" else DASHED)
            panel.dots(x, y, colour, DOT)
        legend: list[LegendEntry] = [(colour, sign, label) for colour, sign, label, _ in rows]
        caption = "Accuracy and repeatability of each set of cycles of the drift test"
        return Chart("drift", caption, [drawing], legend).marked(self.simulated)

    @property
    def has_cycles(self) -> bool:
        """Whether cycles of pose accuracy were measured."""
        return any(model.history for model in self.models.values())

    @property
    def has_drift(self) -> bool:
        """Whether the drift test was measured."""
        return any(model.drift for model in self.models.values())


def _tables_of_poses(title: str, poses: Mapping[str, PoseValues]) -> list[Paragraph]:
    keys = ["AP_mm", "AP_x_mm", "AP_y_mm", "AP_z_mm", "RP_mm", "l_mean_mm", "l_max_mm"]
    columns = ["AP", "AP x", "AP y", "AP z", "RP", "mean l", "max l"]
    if next(iter(poses.values()))["AP_mm"] is None:
        keys, columns = keys[4:], columns[4:]
    rows = tuple((pose, values["n"], *(values.get(key) for key in keys)) for pose, values in poses.items())
    out: list[Paragraph] = [Table(f"{title}, mm", ("pose", "n", *columns), rows)]
    if all("RP_a_deg" in values for values in poses.values()):
        keys = [f"{key}_{a}_deg" for key in ("AP", "RP") for a in ANGLES]
        turned = tuple((pose, *(values.get(key) for key in keys)) for pose, values in poses.items())
        columns = ["pose", "AP a", "AP b", "AP c", "RP a ±", "RP b ±", "RP c ±"]
        out.append(Table(f"{title}, orientation, degrees", tuple(columns), turned, digits=4))
    return out


def _of_distance(name: str, d: Mapping[str, Any]) -> list[Paragraph]:
    """AD and RD in a sentence, and along and about the axes."""
    accuracy = "–" if d["AD_mm"] is None else f"{d['AD_mm']:.3f}"
    texts = []
    for axes, unit, digits in ((AXES, "mm", 3), (ANGLES, "deg", 4)):
        for axis in (axis for axis in axes if f"RD_{axis}_{unit}" in d):
            total = d[f"AD_{axis}_{unit}"]
            first = "" if total is None else f"{total:+.{digits}f} "
            texts.append(f"{axis} {first}±{d[f'RD_{axis}_{unit}']:.{digits}f}{'°' if unit == 'deg' else ''}")
    return [
        f"Distance P2 to P4, {name}: AD {accuracy} mm, RD ±{d['RD_mm']:.3f} mm",
        f"Distance P2 to P4, {name}, AD ± RD by axis, mm, and angle: {', '.join(texts)}",
    ]


def _table_over_all(models: Mapping[str, ModelCriteria]) -> list[Paragraph]:
    """Errors of all poses and cycles by each model, as Table 7.8 has them."""
    rows: list[tuple[TableValue, ...]] = []
    about = ""
    for name, model in models.items():
        if model.overall:
            position, turned = model.overall["position"], model.overall["orientation"] or {}
            rows.append((name, position["mean_mm"], position["max_mm"], turned.get("mean_deg"), turned.get("max_deg")))
            about = "command" if model.overall["from"] == "commanded" else "mean"
    columns = ("model", "position mean mm", "max mm", "orientation mean deg", "max deg")
    return [Table(f"Errors from the {about}, all poses and cycles", columns, tuple(rows), digits=4)] if rows else []


# --- from measurements to criteria ------------------------------------------------------------------------


def check_poses(
    measurements: MeasurementSet,
    calibration: Record | None = None,
    commanded: TableLike | None = None,
    target: str | None = None,
    set_size: int = SET_SIZE,
) -> PoseCheck:
    """Pose accuracy and repeatability, variation, distance and drift (section 7.7.3.4 and annex I).

    Parameters
    ----------
    measurements : MeasurementSet
    calibration : Record, optional
        Gives the commanded poses at the file's joints, by the nominal and by the calibrated robot.
    commanded, target, set_size
        As `irbcal.validation.iso9283_check.iso9283`.

    Raises
    ------
    MeasurementError
        If the file has no cycles, a pose was measured once only, or a target or a commanded pose is missing.
    """
    _check_cycles(measurements)
    cleaned = prepare(measurements, calibration)
    if target is not None:
        cleaned = _only(cleaned, target)
    robots: dict[str, Robot | None] = {"measured": None}
    if calibration is not None:
        robots = {"nominal": calibration.robot_nominal(), "calibrated": calibration.robot_calibrated()}
    table = None if commanded is None else commanded_poses(commanded)
    full_poses = target is None and measured_whole(cleaned.points, robots, table)
    if not full_poses and target is None:
        cleaned = cleaned.keep(cleaned.points.target == int(np.argmax(np.bincount(cleaned.points.target))))
    models = {}
    for name, robot in robots.items():
        cycles = attained(cleaned, robot, full_poses).commanded_by(robot, table)
        models[name] = criteria(cycles if robot is None else cycles.seen_from(robot.T_world_base), set_size)
    subject = f"target {cleaned.points.names()[0]}"
    if full_poses:
        subject = "flange" if calibration else ("measured frame" if cleaned.points.oriented().any() else "all targets")
    inputs = (measurements, calibration, table)
    simulated = any(item is not None and item.simulated for item in inputs)
    return PoseCheck(subject, models, cleaned.excluded, cleaned.notes, simulated)


def _only(cleaned: CleanedPoints, target: str) -> CleanedPoints:
    if target not in cleaned.points.target_names:
        raise MeasurementError(
            f"no usable point of target {target}; targets are {', '.join(cleaned.points.target_names)}",
            file=cleaned.measurements.source,
            parameter="target",
        )
    return cleaned.keep(cleaned.points.names() == target)


def _check_cycles(measurements: MeasurementSet) -> None:
    table, source = measurements.table, measurements.source
    if "cycle" not in table.columns:
        raise MeasurementError(
            "missing column cycle: ISO 9283 repeats its poses in numbered cycles", file=source, row=1
        )
    used = ~measurements.is_reference()
    double = table[used].duplicated(["pose_index", "target"]).to_numpy()
    if double.any():
        row = table[used][double].iloc[0]
        raise MeasurementError(
            f"pose {row['pose']} with target {row['target']} stands there twice in cycle {row['cycle']}: number the "
            "cycles through, over directions and sets, too",
            file=source,
            row=int(row["row"]),
            column="cycle",
        )
