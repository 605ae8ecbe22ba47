"""Measurements as they were taken: the table with one row for each point that the tracker was asked for.

A measurement file, or a DataFrame, has the columns::

    pose,q1_deg,...,q6_deg,target,x_mm,y_mm,z_mm[,c1_deg,...,c6_deg,group,session,payload_kg,time_s,cycle,u95_mm,
        qw,qx,qy,qz,payload_x_mm,payload_y_mm,payload_z_mm,tau1_nm,...,tau6_nm,...]

Arms with another number of joints have as many columns; the travel of a prismatic joint is ``q1_mm``. Where there are
``c1_deg`` … (``c1_mm``), these are the programmed joints: they are what models take, and ``q1_deg`` … are the
controller's readings. Without them the readings stand for the programmed joints. ``payload_kg`` is the mass carried at
each pose, ``payload_x_mm`` … its centre in the tip link, ``tau1_nm`` … the torques that the robot reported. Column
order is free and unknown columns are kept. A position that is empty, NaN or exactly 0,0,0 is a lost point. A column
``simulated`` (yes) marks data that no tracker measured. Errors name the file, the row (line of the file, the header
being line 1; in a DataFrame the position plus one) and the column.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from irbcal import literals
from irbcal.arrays import BoolArray, FloatArray, IntArray, coded, handed_on, locked
from irbcal.errors import MeasurementError
from irbcal.measurement.column_names import (
    ALL_JOINTS,
    NAMES,
    POSITION,
    QUATERNION,
    difference,
    header_row,
    input_columns,
    input_of,
    is_joint,
    joint_columns,
    joint_units,
    programmed_columns,
)
from irbcal.measurement.input_table import InputTable, TableLike
from irbcal.measurement.reading_lag import ReadingLag, reading_lag
from irbcal.measurement.table_columns import ColumnArrays
from irbcal.modeling import coupling
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms import inputs
from irbcal.option_values import excerpt
from irbcal.summary import Paragraph, Result, Table
from irbcal.units import MM

REQUIRED = ["pose", ALL_JOINTS, "target", *POSITION]
GOAL_POSITIONS = tuple(tuple(f"goal_{axis}_{unit}" for axis in "xyz") for unit in ("mm", "m"))
GOAL_ANGLES = tuple(tuple(f"goal_{name}_{unit}" for name in ("roll", "pitch", "yaw")) for unit in ("rad", "deg"))
GOAL_QUATERNION = tuple(f"goal_{name}" for name in QUATERNION)
"""Columns of the pose that the controller was sent to: angles about the fixed axes x, y, z, or a quaternion."""
GOALS = (*GOAL_POSITIONS[0], *GOAL_POSITIONS[1], *GOAL_ANGLES[0], *GOAL_ANGLES[1], *GOAL_QUATERNION)
NUMERIC_EXTRAS = ["time_s", "u95_mm", *QUATERNION, *GOALS]
DECLARED_NAMES = {*REQUIRED, *NAMES, *NUMERIC_EXTRAS, "direction", "simulated", "row", "pose_index"}
"""Columns that irbcal knows, beside those of joints and of inputs of the error model."""
REFERENCE_PREFIX = "ref"
"""Targets whose name starts so are fixed to the ground; ``refl`` begins a reflector's name, as does ``reflector1``."""


def names_reference(target: str) -> bool:
    """Whether a target is fixed to the ground, by its name (`REFERENCE_PREFIX`)."""
    return target.lower().startswith(REFERENCE_PREFIX) and not target.lower().startswith(f"{REFERENCE_PREFIX}l")


@dataclass(frozen=True, eq=False, repr=False)
class MeasurementSet(Result):
    """Measurements as read: one row per asked-for point.

    Attributes
    ----------
    cells : ColumnArrays
        Checked columns of the file format as arrays, see `table`; ``row`` is the line in the file, ``pose_index``
        numbers the poses (of each cycle and session) from 0. Lost points have NaN positions.
    source : str
        File name for messages.
    sha256 : str
        Of the file's content (of a DataFrame's: as ``frame.to_csv(index=False)`` writes it).
    coupling : ndarray, shape (joints, joints), optional
        Of the arm that was measured, see `of_arm`.
    notes : tuple of str
        What the user should know of how they were read, in sentences.
    """

    cells: ColumnArrays
    source: str
    sha256: str
    coupling: FloatArray | None = None
    notes: tuple[str, ...] = ()

    @property
    def table(self) -> pd.DataFrame:
        """The checked columns as a DataFrame of its own: what is written into it changes nothing here."""
        return self.cells.to_frame()

    def with_table(self, table: pd.DataFrame) -> MeasurementSet:
        """The same with other rows or columns, such as those of a changed `table`."""
        return replace(self, cells=ColumnArrays.of_frame(table))

    def changed(self, columns: Mapping[str, NDArray[Any]], **values: Any) -> MeasurementSet:
        """The same with some other columns, or attributes."""
        cells = ColumnArrays({**self.cells.columns, **locked(columns)}, self.cells.index)
        return replace(self, **{"cells": cells, **values})

    @cached_property
    def _first_rows(self) -> tuple[IntArray, IntArray]:
        """First row of each pose, and the number of each row's pose."""
        return np.unique(self.cells["pose_index"], return_index=True, return_inverse=True)[1:]

    def per_pose(self, name: str) -> NDArray[Any]:
        """What a column says of each pose in the first row that says something, shape (n,)."""
        column, (first, number) = self.cells[name], self._first_rows
        values = column[first]
        if column.dtype.kind == "f" and np.isnan(values).any():
            rows = np.flatnonzero(~np.isnan(column))
            some, at = np.unique(number[rows], return_index=True)
            values[some] = column[rows[at]]
        return values

    def __len__(self) -> int:
        return len(self.cells)

    @property
    def stem(self) -> str:
        """Name of the file without folder and ending."""
        return Path(self.source).stem

    @property
    def simulated(self) -> bool:
        """Whether the file says so itself: any value but ``no`` in a column ``simulated``."""
        return InputTable(self.cells).simulated

    @property
    def extra_columns(self) -> list[str]:
        """Columns that irbcal does not know and only carries along (``operator``, ``program``), as they stand."""
        return [name for name in self.cells.columns if not (name in DECLARED_NAMES or _of_numbers(name))]

    @property
    def poses(self) -> int:
        """Number of poses asked for."""
        return len(self._first_rows[0])

    @property
    def joint_columns(self) -> list[str]:
        """Columns of joint values, in the order of the joints."""
        return joint_columns(self.cells.columns)

    @property
    def programmed_columns(self) -> list[str]:
        """Columns of programmed joints, in the order of the joints; empty where there are none."""
        return programmed_columns(self.cells.columns, self.source)

    @property
    def programmed(self) -> bool:
        """Whether there are programmed joints beside the readings."""
        return bool(self.programmed_columns)

    def joints(self) -> FloatArray:
        """Joints of each pose that models take: the programmed ones where there are any, else the readings.

        In the order of the file, shape (n, joints), radians (metres from columns in mm).
        """
        return self._joints_per_pose(self.programmed_columns or self.joint_columns)

    def with_programmed(self, joints: FloatArray) -> MeasurementSet:
        """The same with programmed joints (n, joints) of each pose, as `joints` counts them.

        Radians (metres for columns in mm).
        """
        names, number = self.joint_columns, self._first_rows[1]
        programmed = (coupling.to_controller(joints, self.coupling) / joint_units(names)).T[:, number]
        return self.changed({f"c{name[1:]}": column for name, column in zip(names, programmed, strict=True)})

    def readings(self) -> FloatArray:
        """Joint readings (``q1_deg`` …) of each pose, shape and units as `joints`."""
        return self._joints_per_pose(self.joint_columns)

    def _joints_per_pose(self, columns: list[str]) -> FloatArray:
        first = self._first_rows[0]
        q: FloatArray = np.array([self.cells[name] for name in columns]).T[first] * joint_units(columns)
        return coupling.from_controller(q, self.coupling)

    def reading_lag(self) -> ReadingLag | None:
        """How the readings differ from the programmed joints, and whether they lag; None without programmed joints."""
        if not self.programmed:
            return None
        groups = self.per_pose("group") if "group" in self.cells.columns else None
        return reading_lag(self.readings(), self.joints(), self.programmed_columns, groups)

    def joint_notes(self) -> list[str]:
        """What the user should know of the joints that models take, in sentences; nothing without programmed joints."""
        lag = self.reading_lag()
        return [] if lag is None else lag.notes(self.source)

    def of_arm(self, arm: Arm) -> MeasurementSet:
        """The same measurements, whose joints are those of an arm that its controller counts in its own way.

        The table holds the controller's joints, `joints` and `readings` give those of the arm.

        Raises
        ------
        MeasurementError
            If the joint columns are not those of the arm.
        """
        self.check_joints(arm)
        return self if arm.coupling is None else self.changed({}, coupling=arm.coupling)

    def check_joints(self, arm: Arm) -> None:
        """Refuse joint columns that are not those of an arm.

        Raises
        ------
        MeasurementError
            The sentence names the columns.
        """
        expected, actual = arm.joint_columns, self.joint_columns
        if expected != actual:
            raise MeasurementError(
                f"{difference(expected, actual)}: {arm.name} has {len(expected)} joints between the links "
                f"{arm.base_link} and {arm.tip_link} (--base-link, --tip-link) with the columns {expected[0]} … "
                f"{expected[-1]}, found {', '.join(actual)}",
                file=self.source,
                row=header_row(self.source),
            )

    def input(self, name: str) -> FloatArray | None:
        """An input of the error model at each pose, by its name in `irbcal.modeling.terms.inputs`.

        Shape (n,) or (n, values), SI units, NaN where it is not told; None where it is told nowhere.
        """
        quantity = inputs()[name]
        names = input_columns(quantity, self.cells.columns, self.source)
        if not names:
            return None
        if quantity.per_pose:
            values = quantity.from_columns([self.per_pose(name) for name in names])
        else:
            means = self.table.groupby("pose_index", sort=True)[names].mean()
            values = quantity.from_columns(means.to_numpy(dtype=float).T)
        return values if np.isfinite(values).any() else None

    def is_reference(self) -> BoolArray:
        """Mask of the rows that are reference points fixed to the ground (Nubiola 2011, section 7.1)."""
        code, names = coded(self.cells["target"])
        return np.array([names_reference(name) for name in names], dtype=bool)[code]

    def rotations(self) -> FloatArray | None:
        """Measured orientations of all rows, shape (rows, 3, 3), NaN where there is none; None without columns."""
        return InputTable(self.cells).rotations(lost=True)

    def uncertainties(self) -> FloatArray | None:
        """Expanded uncertainties of all rows, shape (rows,), metres, NaN where not given; None without a column."""
        return self.cells["u95_mm"] * MM if "u95_mm" in self.cells.columns else None

    def positions(self) -> FloatArray:
        """Positions of all rows, shape (rows, 3), metres; NaN where lost."""
        return np.array([self.cells[name] for name in POSITION]).T * MM

    def to_frame(self) -> pd.DataFrame:
        """The table in the columns of a measurement file (degrees and millimetres), for `read` or ``to_csv``."""
        first = ["pose", *self.joint_columns, *self.programmed_columns, "target", *POSITION]
        others = [name for name in self.cells.columns if name not in (*first, "row", "pose_index")]
        return self.table[[*first, *others]]

    def report(self) -> Sequence[Paragraph]:
        """Counts of rows, poses and lost points; tables of targets, of groups and of programmed joints."""
        lost = np.isnan(self.positions()).any(axis=1)
        counts = f"{len(self)} rows, {self.poses} poses, {int(lost.sum())} lost points"
        text = f"{self.source}: {counts}{', SIMULATED' if self.simulated else ''}"
        rows = pd.DataFrame({"target": self.cells["target"], "reference": self.is_reference(), "lost": lost})
        targets = tuple(
            (str(name), "reference" if group["reference"].any() else "tool", len(group), int(group["lost"].sum()))
            for name, group in rows.groupby("target", sort=True)
        )
        lines: list[Paragraph] = [text, Table("Targets", ("target", "fixed to", "rows", "lost"), targets)]
        if "group" in self.cells.columns:
            counted = self.table.groupby("group", sort=False)["pose_index"].nunique()
            lines.append(Table("Groups", ("group", "poses"), tuple((str(name), int(n)) for name, n in counted.items())))
        lag = self.reading_lag()
        return lines if lag is None else [*lines, *lag.report()]


@runtime_checkable
class HoldsMeasurements(Protocol):
    """A result that holds measurements, such as of a simulation or an import."""

    def measurements(self) -> MeasurementSet:
        """The measurements."""
        ...


MeasurementsLike: TypeAlias = "TableLike | MeasurementSet | HoldsMeasurements"
"""What stands for measurements wherever they are asked for: a file, a DataFrame, what `read` made of them, or a result
that holds them."""


def read(source: MeasurementsLike) -> MeasurementSet:
    """Read measurements.

    Parameters
    ----------
    source : str, Path, DataFrame, MeasurementSet or a result that holds one
        CSV, or Parquet where pyarrow is installed; a DataFrame has the columns of the file, in degrees and
        millimetres. A `MeasurementSet` is returned as it is, so is that of a simulation or an import.

    Raises
    ------
    MeasurementError
        If the table cannot be read or does not keep the format. The row of a DataFrame is the position plus one.
    """
    if isinstance(source, MeasurementSet):
        return source
    if not isinstance(source, (str, PathLike)) and not isinstance(source, pd.DataFrame):
        if not isinstance(source, HoldsMeasurements):
            raise MeasurementError(
                f"expected measurements (a file, a DataFrame or a result that holds them), found {excerpt(source)}",
                parameter="measurements",
            )
        return source.measurements()
    try:
        return _checked(InputTable.read(source, REQUIRED, typed=_of_numbers))
    except MeasurementError as error:
        if error.row != 1 or not isinstance(source, (str, PathLike)) or Path(source).suffix == ".parquet":
            raise
        command = f"irbcal import {literals.shell(str(source))} --robot ROBOT --out measured.csv"
        message = f"{error.message}; a file of another program is imported first: {command}"
        raise MeasurementError(message, file=error.file, row=error.row, column=error.column) from None


read_measurements = read


def parse(data: bytes, source: str) -> MeasurementSet:
    """Read measurements from the content of a CSV file.

    Parameters
    ----------
    data : bytes
    source : str
        File name for messages.

    Raises
    ------
    MeasurementError
        If it does not keep the format.
    """
    return _checked(InputTable.parse(data, source, REQUIRED, typed=_of_numbers))


def of_frame(frame: pd.DataFrame, source: str) -> MeasurementSet:
    """Read measurements from rows of a Parquet file; see `parse`."""
    return _checked(InputTable.of_frame(frame, source, REQUIRED, _of_numbers))


def _of_numbers(name: str) -> bool:
    """Whether a column of a measurement file is one of numbers."""
    return name in POSITION or name in NUMERIC_EXTRAS or is_joint(name) or input_of(name) is not None


def _checked(rows: InputTable) -> MeasurementSet:
    names, source = rows.names, rows.source
    cells: dict[str, NDArray[Any]] = {"row": rows.rows}
    joints = [*joint_columns(names), *programmed_columns(names, source)]
    told = {quantity: input_columns(quantity, names, source) for quantity in inputs().values()}
    for name in [*joints, *(name for quantity in told if not quantity.per_pose for name in told[quantity])]:
        cells[name] = rows.numbers(name)
    for name in POSITION:
        cells[name] = rows.numbers(name, lost=True)
    for name in ("pose", "target"):
        cells[name] = rows.filled(name)
    for name in [name for name in names if name not in cells]:
        if _of_numbers(name):
            cells[name] = rows.numbers(name, lost=True)
        else:
            cells[name] = rows.texts(name) if name in ("group", "cycle", "session") else rows.as_written(name)
    lost = rows.lost()
    cells |= {name: np.where(lost, np.nan, cells[name]) for name in POSITION}
    cells["pose_index"] = _pose_index(cells, source)
    quaternions = rows.quaternions()
    if quaternions is not None:
        cells |= dict(zip(QUATERNION, quaternions.T, strict=True))
    columns = {name: handed_on(column) for name, column in cells.items()}
    return MeasurementSet(ColumnArrays(columns, np.arange(len(rows))), source, rows.sha256)


def _pose_index(table: Mapping[str, NDArray[Any]], source: str) -> IntArray:
    """Number poses in the order of the file; one pose (and cycle) has one set of joints, read and programmed."""
    key = table["pose"]
    for name in ("cycle", "session"):
        if name in table:
            key = key + " / " + table[name]
    index = coded(key)[0]
    first = np.unique(index, return_index=True)[1]
    programmed = programmed_columns(table, source)
    for names, kind in ((joint_columns(table), "joints"), (programmed, "programmed joints")):
        if names:
            _check_same(table, names, kind, first[index], source)
    for quantity in inputs().values():
        for name in quantity.columns if quantity.per_pose else ():
            if name in table:
                _check_same(table, [name], quantity.noun, first[index], source)
    return index


def _check_same(table: Mapping[str, NDArray[Any]], names: list[str], kind: str, first: IntArray, source: str) -> None:
    """Refuse a row whose joints are not those of its pose's first row."""
    joints = np.column_stack([table[name] for name in names])
    differ = np.abs(joints - joints[first]).max(axis=1) > 1e-6
    if differ.any():
        k = int(np.flatnonzero(differ)[0])
        joint = int(np.argmax(np.abs(joints[k] - joints[first[k]])))
        raise MeasurementError(
            f"expected the {kind} of pose {table['pose'][k]} as in row {table['row'][first[k]]}, "
            f"found {joints[k, joint]:g}",
            file=source,
            row=int(table["row"][k]),
            column=names[joint],
        )
