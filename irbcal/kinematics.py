"""Forward and inverse kinematics of any robot by its name, for batches: what the commands fk and ik do."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from typing import TYPE_CHECKING, Any, TypeAlias, Union

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, IntArray, NameArray
from irbcal.errors import OptionError, RobotError
from irbcal.io.opening import RobotLike, open_robot
from irbcal.modeling.inverse.along_path import SingularPlace
from irbcal.modeling.robot import carrying_payload
from irbcal.option_values import excerpt
from irbcal.parallel import on_workers
from irbcal.summary import Paragraph, Result, Table, values
from irbcal.units import MM

if TYPE_CHECKING:
    import pandas as pd

    from irbcal.measurement.input_table import InputTable
    from irbcal.measurement.table import MeasurementSet
    from irbcal.modeling.arm import Arm
    from irbcal.modeling.robot import Robot


SUMMARY_ROWS = 10
"""Rows of a result that are shown to people."""


@dataclass(frozen=True, eq=False, repr=False)
class ForwardResult(Result):
    """Where a robot ends for n rows of commanded joints.

    Attributes
    ----------
    T_base_tip : ndarray, shape (n, 4, 4)
        Poses of the tip link in the base link, metres.
    tip, base : str
        Names of these links.
    target : str or None
        The reflector asked for.
    points : ndarray, shape (n, 3), or None
        Its places in the measuring frame, metres; None without a target.
    std : ndarray, shape (n, 3), or None
        Standard deviations of x, y and z, of the reflector or, without one, of the tip, metres; None unless asked for.
        They are those of the identified parameters: what the model cannot describe is in the held-out errors only.
    heldout_mean, heldout_rms : float or None
        Of the calibration's held-out errors, metres; None where there are none, or ``std`` was not asked for.
    interval : ndarray, shape (n, 3), or None
        Half-widths that hold 95 % of a coordinate's errors, metres; None unless asked for.
    outside : ndarray of bool, shape (n,), or None
        Whether a joint is outside the ranges of the calibration's fit; None unless intervals were asked for.
    note : str
        How many poses are outside, in which joints and by how much; empty where none is, or nothing is known.
    input_columns : DataFrame or None
        The table that the joints came from, texts, or joints with the loads and other inputs of the error model that
        measurements or a result had; None where they came as numbers.
    """

    T_base_tip: FloatArray
    tip: str
    base: str
    target: str | None = None
    points: FloatArray | None = None
    std: FloatArray | None = None
    heldout_mean: float | None = None
    heldout_rms: float | None = None
    interval: FloatArray | None = None
    outside: BoolArray | None = None
    note: str = ""
    input_columns: pd.DataFrame | None = None

    def __len__(self) -> int:
        return len(self.T_base_tip)

    def to_frame(self, as_written: bool = False) -> pd.DataFrame:
        """A row for each row of joints, as the command fk prints it, beside `input_columns`.

        Returns
        -------
        DataFrame
            ``x_mm, y_mm, z_mm`` of the target in the measuring frame; without a target of the tip in the base link, and
            ``qw, qx, qy, qz`` (unit quaternion, scalar first). ``std_x_mm`` and so on where asked for; ``x_u95_mm`` and
            so on and ``outside`` with intervals.
        """
        import pandas as pd

        from irbcal.measurement.input_table import poses_to_frame, with_input_columns

        if self.points is None:
            table = poses_to_frame(self.T_base_tip)
        else:
            table = pd.DataFrame(values(self, "x_mm,y_mm,z_mm=points"))
        more = values(self, "std_x_mm,std_y_mm,std_z_mm?=std x_u95_mm,y_u95_mm,z_u95_mm?=interval outside?")
        return with_input_columns(self.input_columns, table.assign(**more), as_written)

    CONTENT = "tip base target rows=to_frame"

    @property
    def caution(self) -> str:
        """What standard deviations do not say, and poses outside the joint ranges; empty where there is nothing."""
        if self.heldout_mean is None or self.heldout_rms is None:
            return self.note
        text = (
            "standard deviations are those of the parameters; held-out errors of this calibration: mean "
            f"{self.heldout_mean / MM:.3f} mm, rms {self.heldout_rms / MM:.3f} mm"
        )
        return f"{text}. {self.note}" if self.note else text

    def report(self) -> Sequence[Paragraph]:
        """What is where, and the first rows."""
        subject = f"{self.tip} in {self.base}" if self.target is None else f"{self.target} in the measuring frame"
        lines: list[Paragraph] = [f"{len(self)} {'poses' if self.target is None else 'places'} of {subject}"]
        lines += [self.caution] if self.caution else []
        return [*lines, _first_rows(self.to_frame())]


@dataclass(frozen=True, eq=False, repr=False)
class InverseJoints(Result):
    """Commanded joints for poses of a robot's tip.

    Attributes
    ----------
    joints : ndarray, shape (m, joints)
        Radians (metres for prismatic joints); NaN where a pose has none. One row for each pose, or, with all branches,
        for each branch of each pose that reaches it within the joint limits.
    row : ndarray of int, shape (m,)
        The pose that the joints are for, from 0.
    branch : ndarray of str, shape (m,), or None
        Name of the branch; None unless all were asked for.
    note : ndarray of str, shape (m,)
        Why there are no joints, or that they are outside the limits; else empty.
    arm : Arm
        Nominal: tables hold joints as its controller counts them.
    input_columns : DataFrame or None
        The table that the poses came from, texts, or joints with the loads and other inputs of the error model that
        a result had; None where they came as numbers.
    singular : tuple of SingularPlace
        Where a path comes near to a singularity; empty unless the poses were followed as a path.
    """

    joints: FloatArray
    row: IntArray
    branch: NameArray | None
    note: NameArray
    arm: Arm
    input_columns: pd.DataFrame | None = None
    singular: tuple[SingularPlace, ...] = ()

    def __len__(self) -> int:
        return len(self.joints)

    @property
    def solved(self) -> BoolArray:
        """Which rows have joints, shape (m,)."""
        return np.logical_and.reduce(np.isfinite(self.joints), axis=1)

    def to_frame(self, as_written: bool = False) -> pd.DataFrame:
        """The rows as the command ik prints them, beside `input_columns`.

        Returns
        -------
        DataFrame
            The joint columns (degrees, mm; NaN where there is no solution) and ``note``; with all branches first
            ``row`` (of the poses, from 1) and ``branch``.
        """
        import pandas as pd

        from irbcal.measurement.input_table import with_input_columns

        table = pd.DataFrame(self.arm.joint_table(self.joints))
        if self.branch is not None:
            table.insert(0, "branch", self.branch)
            table.insert(0, "row", self.row + 1)
        table["note"] = self.note
        return with_input_columns(self.input_columns, table, as_written, self.row)

    CONTENT = "rows=to_frame"

    def report(self) -> Sequence[Paragraph]:
        """How many poses have joints, and the first rows."""
        if self.branch is not None:
            headline = f"{len(self)} ways to reach {len(set(self.row.tolist()))} poses within the joint limits"
        else:
            headline = f"joints for {int(self.solved.sum())} of {len(self)} poses"
        return [headline, *(singularity.in_words() for singularity in self.singular), _first_rows(self.to_frame())]


def _first_rows(table: pd.DataFrame) -> Table:
    title = f"the first {SUMMARY_ROWS} of {len(table)} rows" if len(table) > SUMMARY_ROWS else "rows"
    return Table.from_frame(title, table.head(SUMMARY_ROWS), digits=6)


JointsLike: TypeAlias = Union["ArrayLike | str | PathLike[str] | pd.DataFrame | MeasurementSet | InverseJoints"]
"""Joints: an array in radians, or a file or a table with its units in the names of its columns."""
TipPosesLike: TypeAlias = Union["ArrayLike | str | PathLike[str] | pd.DataFrame | ForwardResult"]
"""Poses (n, 4, 4) in metres, or a file or a table in millimetres with quaternions."""


def forward_kinematics(
    robot: RobotLike,
    q: JointsLike,
    *,
    target: str | None = None,
    uncertainty: bool = False,
    intervals: bool = False,
    nominal: bool = False,
    payload: float | None = None,
    payload_centre: ArrayLike | None = None,
    base_link: str | None = None,
    tip_link: str | None = None,
    coupling: str | None = None,
) -> ForwardResult:
    """Where a robot really ends for commanded joints.

    Parameters
    ----------
    robot : str, Path, Record, a result that holds one, or Opened
        Calibration folder (in Python also a loaded calibration, or what `irbcal.io.opening.open_robot` opened), URDF or
        a robot's name (`irbcal.robots`).
    q : array_like, shape (n, joints), path, DataFrame, MeasurementSet or InverseJoints
        Commanded joints: a file or table with the columns ``q1_deg``, ``q2_deg`` … (or ``q1_rad`` …, ``q1_mm`` of a
        rail) and, where it differs from row to row, ``payload_kg`` with ``payload_x_mm`` …, ``-`` being standard input
        (in Python also an array in radians, metres for prismatic joints; or joints of measured poses, or of a result,
        with the loads that their tables had).
    target : str, optional
        Predict the places of this reflector in the measuring frame, too.
    uncertainty : bool
        Add standard deviations of the position (calibrations only).
    intervals : bool
        Add half-widths that hold 95 % of a coordinate's errors, and which poses are outside the joint ranges of the
        calibration's fit (calibrations only), see `irbcal.modeling.robot.Robot.predict`.
    nominal : bool
        Nominal behaviour of a calibration.
    payload : float, optional
        Mass carried, kg; what most poses of the calibration were measured with unless given.
    payload_centre : array_like, shape (3,), optional
        Centre of the payload in the tip link, metres; that of the calibration unless given.
    base_link, tip_link, coupling : str, optional
        See `irbcal.read_urdf`.

    Raises
    ------
    RobotError
        If there is no such robot or target, the joints have another shape, are no numbers or look like degrees, or the
        robot knows no uncertainty.
    CalibrationError
        If a calibration folder is not a whole calibration.
    MeasurementError
        If a file of joints cannot be read.

    Examples
    --------
    >>> import numpy as np
    >>> forward_kinematics("irb1600", np.radians([[0, -14, 14, 0, 0, 0]])).T_base_tip[0, :3, 3].round(6)
    array([0.645655, 0.      , 1.165707])
    """
    opened = open_robot(robot, nominal=nominal, base_link=base_link, tip_link=tip_link, coupling=coupling)
    model = carrying_payload(opened.robot, payload, payload_centre)
    table, cells, inputs = _table(q, model.arm.joint_columns, model.arm, payload)
    q = _joints(q, model.arm) if table is None else model.arm.from_controller(table.joints(model.arm.joint_columns))
    if target is not None and not model.targets:
        raise RobotError(
            "a URDF has no reflectors: name a calibration folder to predict a target's position", parameter="target"
        )
    for name, requested in (("uncertainty", uncertainty), ("intervals", intervals)):
        if requested and (opened.record is None or nominal):
            raise RobotError(
                f"{opened.name}: only the calibrated behaviour of a calibration folder knows its uncertainty",
                parameter=name,
            )
    result = ForwardResult(
        T_base_tip=model.forward(q, **inputs) if inputs else model.poses(q),
        tip=model.arm.tip_link,
        base=model.arm.base_link,
        target=target,
        points=None if target is None else model.points(q, target, **inputs),
        note="" if model.certainty is None else model.certainty.outside_in_words(q),
        input_columns=cells,
    )
    if uncertainty and opened.record is not None:
        result = replace(result, std=model.position_std(q, target, **inputs))
        if opened.record.expected_error is not None and opened.record.heldout is not None:
            rms = opened.record.heldout.all.rms_mm * MM
            result = replace(result, heldout_mean=opened.record.expected_error, heldout_rms=rms)
    if intervals:
        predicted = model.predict_tip(q, **inputs) if target is None else model.predict(q, target=target, **inputs)
        result = replace(result, interval=predicted.interval, outside=predicted.outside)
    return result


@on_workers
def inverse_kinematics(
    robot: RobotLike,
    T_base_tip: TipPosesLike,
    *,
    near: ArrayLike | None = None,
    all_branches: bool = False,
    path: bool = False,
    redundancy: str | None = None,
    nominal: bool = False,
    payload: float | None = None,
    payload_centre: ArrayLike | None = None,
    base_link: str | None = None,
    tip_link: str | None = None,
    coupling: str | None = None,
    jobs: int | None = None,
) -> InverseJoints:
    """Joints to command so that a robot's tip reaches poses.

    Parameters
    ----------
    robot
        See `irbcal.forward_kinematics`.
    T_base_tip : array_like, shape (n, 4, 4), path, DataFrame or ForwardResult
        Poses of the tip link in the base link: a file or table with the columns ``x_mm, y_mm, z_mm, qw, qx, qy, qz``
        and optionally ``payload_kg`` with ``payload_x_mm`` …, ``-`` being standard input (in Python also an array in
        metres, or a result of forward kinematics with the loads of its joints).
    near : array_like, shape (joints,), optional
        The solution nearest to these joints is taken, radians (metres for prismatic joints); those nearest to zero
        within the limits unless given.
    all_branches : bool
        Every branch within the joint limits instead, not with ``near``; for arms with a closed-form inverse.
    path : bool
        The poses are a path that the tip follows straight from one to the next: joints without jumps from one solution
        to another, see `irbcal.modeling.inverse.along_path`. Of the solutions at the first pose the one is taken that
        leads farthest within the limits. Where the path passes a singularity is told.
    redundancy : str, optional
        What arms with more than six joints do with the rest: ``limits`` stays away from the joint limits, ``near``
        next to ``near``. Unless given, a solution that the steps from ``near`` come to.
    nominal : bool
        Nominal behaviour of a calibration.
    payload, payload_centre : optional
        See `irbcal.forward_kinematics`.
    base_link, tip_link, coupling : str, optional
        See `irbcal.read_urdf`.
    jobs : int, optional
        See `irbcal.parallel.using`.

    Raises
    ------
    RobotError
        If there is no such robot, shapes do not fit, ``near`` looks like degrees, or all branches are wanted of an arm
        without a closed-form inverse; the message says why it has none.
    CalibrationError
        If a calibration folder is not a whole calibration.
    MeasurementError
        If a file of poses cannot be read.
    OptionError
        If both ``near`` and all branches are asked for, all branches of a path, a criterion of an arm without joints
        to spare, or a path with several loads.
    """
    from irbcal.measurement.column_names import POSE
    from irbcal.modeling.inverse import along_path
    from irbcal.modeling.inverse import redundancy as spare
    from irbcal.modeling.inverse.poses import check_poses

    opened = open_robot(robot, nominal=nominal, base_link=base_link, tip_link=tip_link, coupling=coupling)
    model, arm = carrying_payload(opened.robot, payload, payload_centre), opened.nominal
    if all_branches and near is not None:
        raise OptionError("near: all branches are asked for, not the nearest: leave one of them out", parameter="near")
    if all_branches and (path or redundancy is not None):
        raise OptionError("all_branches: goes neither with a path nor with a criterion", parameter="all_branches")
    if redundancy is not None and (redundancy not in spare.CRITERIA or len(arm.lower) < 7):
        message = f"redundancy: expected limits or near, found {excerpt(redundancy)}"
        if redundancy in spare.CRITERIA:
            message = f"redundancy: {arm.name} has {len(arm.lower)} joints, none to spare for a criterion"
        raise OptionError(message, parameter="redundancy")
    table, cells, inputs = _table(T_base_tip, POSE, arm, payload)
    T = _poses(T_base_tip) if table is None else table.poses()
    start = _start(arm, near)
    loads = _by_load(model, inputs, len(T))
    if path:
        if len(loads) > 1:
            raise OptionError(f"path: expected one load on the way, found {len(loads)} (payload_kg)", parameter="path")
        model = loads[0][0]
        path_result = along_path.follow(model, arm, check_poses(T), start, redundancy)
        rows = np.arange(len(T))
        return InverseJoints(path_result.joints, rows, None, path_result.note, arm, cells, path_result.singular)
    parts = [_inverse(robot, arm, T[rows], start, all_branches, redundancy) for robot, rows in loads]
    of_poses = [replace(part, row=rows[part.row]) for (_, rows), part in zip(loads, parts, strict=True)]
    return replace(_joined(of_poses), input_columns=cells)


def _by_load(model: Robot, inputs: Mapping[str, FloatArray], count: int) -> list[tuple[Robot, IntArray]]:
    """The robot with each load that poses have, and these poses."""
    if "payload_kg" not in inputs or not model.joint_map.knows_loads:
        return [(model, np.arange(count))]
    centre = inputs.get("payload_centre", np.zeros((count, 0)))
    loads, which = np.unique(np.column_stack([inputs["payload_kg"], centre]), axis=0, return_inverse=True)
    return [
        (model.carrying(load[0], load[1:] if len(load) > 1 else None), np.flatnonzero(which.reshape(-1) == k))
        for k, load in enumerate(loads)
    ]


def _inverse(
    model: Robot, arm: Arm, T: FloatArray, start: FloatArray, all_branches: bool, redundancy: str | None
) -> InverseJoints:
    """Joints for poses each by itself."""
    from irbcal.modeling.inverse import any_arm, calibrated_arm, closed_form
    from irbcal.modeling.inverse import redundancy as spare

    if all_branches:
        return _all_branches(model, arm, T, start)
    if redundancy is not None:
        solution = spare.solve(model, arm, T, start, redundancy)
    elif closed_form.has_closed_form(arm):
        solution = calibrated_arm.solve_nearest(model, arm, T, start)
    else:
        # with fewer than six joints a pose is met only as well as its file is rounded
        tolerance = 1e-8 if len(start) < 6 else 1e-10
        solution = any_arm.solve(model, arm, T, start, tolerance, tolerance)
    return InverseJoints(solution.joints, np.arange(len(T)), None, solution.notes(), arm)


def _all_branches(model: Robot, arm: Arm, T: FloatArray, near: FloatArray) -> InverseJoints:
    from irbcal.modeling.inverse import calibrated_arm, closed_form

    branches, parts = closed_form.branches(arm, T), list[InverseJoints]()
    for k, name in enumerate(closed_form.BRANCH_NAMES):
        seed, inside = closed_form.with_configuration(arm, branches, np.full(len(T), k), near)
        row = np.flatnonzero(inside)
        solution = calibrated_arm.solve(model, arm, T[row], seed=seed[row])
        good = solution.converged
        names = np.full(int(good.sum()), name, dtype=object)
        parts.append(InverseJoints(solution.joints[good], row[good], names, solution.notes()[good], arm))
    return _joined(parts)


def _joined(parts: Sequence[InverseJoints]) -> InverseJoints:
    """Several results as one, in the order of their poses."""
    order = np.argsort(np.concatenate([part.row for part in parts]), kind="stable")
    columns = {name: [getattr(part, name) for part in parts] for name in ("joints", "row", "branch", "note")}
    joined: dict[str, Any] = {
        name: None if each[0] is None else np.concatenate(each)[order] for name, each in columns.items()
    }
    return replace(parts[0], **joined)


def _joints(q: Any, arm: Arm) -> FloatArray:
    from irbcal.measurement.table import MeasurementSet

    if isinstance(q, MeasurementSet):
        return q.of_arm(arm).joints()
    checked = arm.check_joints(q.joints if isinstance(q, InverseJoints) else q)
    if not np.isfinite(checked).all():
        row, joint = np.argwhere(~np.isfinite(checked))[0]
        raise RobotError(f"joints: row {row + 1} has no number for {arm.joint_names[joint]}", parameter="q")
    return checked


def _table(
    source: object, required: Sequence[str], arm: Arm, payload: float | None
) -> tuple[InputTable | None, pd.DataFrame | None, dict[str, Any]]:
    """The table that a file or DataFrame is, the cells to show beside what is computed, inputs of the error model.

    Measurements and results are no table, and have the cells of these inputs and the joints; None for all else.
    """
    import pandas as pd

    from irbcal.measurement.input_table import InputTable, check_one_payload

    is_table = isinstance(source, (str, PathLike, pd.DataFrame))
    content: Any = source if is_table else _input_cells(source)
    if content is None:
        return None, None, {}
    table = InputTable.read(content, required if is_table else (), stdin=True)
    inputs = table.inputs(len(arm.lower))
    check_one_payload(payload is not None, "payload_kg" in inputs)
    return table if is_table else None, table.cells, inputs


def _input_cells(source: object) -> pd.DataFrame | None:
    """Inputs of the error model that measurements or a result hold, with the joints, row by row; None without any."""
    from irbcal.measurement.column_names import input_of, joint_columns
    from irbcal.measurement.table import MeasurementSet

    if isinstance(source, MeasurementSet):
        cells = source.table
    elif isinstance(source, (ForwardResult, InverseJoints)) and source.input_columns is not None:
        cells = source.input_columns
    else:
        return None
    of_inputs = {name: quantity for name in cells.columns if (quantity := input_of(name))}
    if not of_inputs or not len(source):
        return None
    joints = joint_columns(cells.columns)
    if isinstance(source, MeasurementSet):
        rules = {name: "first" if quantity.per_pose else "mean" for name, quantity in of_inputs.items()}
        return cells.groupby("pose_index").agg(dict.fromkeys(joints, "first") | rules)
    cells = cells[[*joints, *of_inputs]]
    if isinstance(source, InverseJoints):
        return cells.iloc[source.row].assign(**source.arm.joint_table(source.joints))
    return cells


def _poses(T_base_tip: TipPosesLike) -> FloatArray:
    try:
        T = np.asarray(T_base_tip.T_base_tip if isinstance(T_base_tip, ForwardResult) else T_base_tip, dtype=float)
    except (TypeError, ValueError):
        T = np.zeros(0)
    if T.ndim not in (2, 3) or T.shape[-2:] != (4, 4):
        raise RobotError(
            f"poses need shape (n, 4, 4), found {T.shape if T.size else excerpt(T_base_tip)}",
            parameter="T_base_tip",
        )
    return T[None] if T.ndim == 2 else T


def _start(arm: Arm, near: ArrayLike | None) -> FloatArray:
    if near is None:
        return np.clip(np.zeros(len(arm.lower)), arm.lower, arm.upper)
    start = arm.check_joints(near)
    if len(start) != 1 or not np.isfinite(start).all():
        raise RobotError(
            f"near: expected {len(arm.lower)} numbers ({', '.join(arm.joint_names)}), found {near!r}", parameter="near"
        )
    return start[0]
