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

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
import pandas as pd

from irbcal import literals
from irbcal.arrays import BoolArray, FloatArray, IntArray
from irbcal.errors import MeasurementError
from irbcal.measurement import columns
from irbcal.measurement.columns import (
    ALL_JOINTS,
    PAYLOAD,
    PAYLOAD_CENTRE,
    POSITION,
    QUATERNION,
    InputTable,
    TableLike,
)
from irbcal.measurement.reading_lag import ReadingLag, reading_lag
from irbcal.modeling.arm import Arm
from irbcal.options import shown
from irbcal.summary import Paragraph, Result, Table
from irbcal.units import MM

REQUIRED = ["pose", ALL_JOINTS, "target", *POSITION]
GOAL_POSITIONS = tuple(tuple(f"goal_{axis}_{unit}" for axis in "xyz") for unit in ("mm", "m"))
GOAL_ANGLES = tuple(tuple(f"goal_{name}_{unit}" for name in ("roll", "pitch", "yaw")) for unit in ("rad", "deg"))
GOAL_QUATERNION = tuple(f"goal_{name}" for name in QUATERNION)
"""Columns of the pose that the controller was sent to: angles about the fixed axes x, y, z, or a quaternion."""
GOALS = (*GOAL_POSITIONS[0], *GOAL_POSITIONS[1], *GOAL_ANGLES[0], *GOAL_ANGLES[1], *GOAL_QUATERNION)
NUMERIC_EXTRAS = [PAYLOAD, *PAYLOAD_CENTRE, "time_s", "u95_mm", *QUATERNION, *GOALS]
DECLARED_NAMES = {*REQUIRED, *columns.NAMES, *NUMERIC_EXTRAS, "direction", "simulated", "row", "pose_index"}
"""Columns that irbcal knows, beside those of joints and torques."""
REFERENCE_PREFIX = "ref"
"""Targets whose name starts so are fixed to the ground."""


class ReadOnlyTables:
    """Base of frozen dataclasses whose DataFrames nobody can change: every access to such a field hands out a copy.

    ``dataclasses.replace``, ``pickle`` and ``copy`` work as with any other dataclass. Fields of tables have no default.
    """

    def __post_init__(self) -> None:
        tables: dict[str, Any] = {}
        for field in fields(self):  # type: ignore[arg-type]  # those who inherit are dataclasses
            if isinstance(self.__dict__[field.name], pd.DataFrame):
                tables[field.name] = self.__dict__.pop(field.name).copy()
        self.__dict__["_tables"] = tables

    if not TYPE_CHECKING:  # the fields are declared by those who inherit

        def __getattr__(self, name: str) -> pd.DataFrame:
            """Tables are kept under another name, so each access to one ends here."""
            tables = self.__dict__.get("_tables", {})
            if name in tables:
                return tables[name].copy()
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")


def shared_table(holder: ReadOnlyTables, name: str = "table") -> pd.DataFrame:
    """A table for reading only: a long one need not stand in memory twice."""
    table: pd.DataFrame = holder.__dict__["_tables"][name]
    # from pandas 3 on a table gets content of its own when it is written to
    return table.copy(deep=int(pd.__version__.partition(".")[0]) < 3)


@dataclass(frozen=True, eq=False, repr=False)
class MeasurementSet(ReadOnlyTables, Result):
    """Measurements as read: one row per asked-for point.

    Attributes
    ----------
    table : DataFrame
        Checked columns of the file format; ``row`` is the line in the file, ``pose_index`` numbers the poses (of each
        cycle and session) from 0. Lost points have NaN positions. Every access hands out a copy: what is written into
        it changes nothing here, ``dataclasses.replace(measurements, table=...)`` makes other measurements.
    source : str
        File name for messages.
    sha256 : str
        Of the file's content (of a DataFrame's: as ``frame.to_csv(index=False)`` writes it).
    coupling : ndarray, shape (joints, joints), optional
        Of the arm that was measured, see `of_arm`.
    notes : tuple of str
        What the user should know of how they were read, in sentences.
    """

    table: pd.DataFrame
    source: str
    sha256: str
    coupling: FloatArray | None = None
    notes: tuple[str, ...] = ()

    @property
    def _rows(self) -> pd.DataFrame:
        return self.__dict__["_tables"]["table"]

    def __len__(self) -> int:
        return len(self._rows)

    @property
    def stem(self) -> str:
        """Name of the file without folder and ending."""
        return Path(self.source).stem

    @property
    def simulated(self) -> bool:
        """Whether the file says so itself: any value but ``no`` in a column ``simulated``."""
        return InputTable(self._rows).simulated

    @property
    def extra_columns(self) -> list[str]:
        """Columns that irbcal does not know and only carries along (``operator``, ``program``), as they stand."""
        return [name for name in self._rows.columns if not (name in DECLARED_NAMES or _of_numbers(name))]

    @property
    def poses(self) -> int:
        """Number of poses asked for."""
        return int(self._rows["pose_index"].nunique())

    @property
    def joint_columns(self) -> list[str]:
        """Columns of joint values, in the order of the joints."""
        return columns.joint_columns(self._rows.columns)

    @property
    def programmed_columns(self) -> list[str]:
        """Columns of programmed joints, in the order of the joints; empty where there are none."""
        return columns.programmed_columns(self._rows.columns, self.source)

    @property
    def programmed(self) -> bool:
        """Whether there are programmed joints beside the readings."""
        return bool(self.programmed_columns)

    def joints(self) -> FloatArray:
        """Joints of each pose that models take: the programmed ones where there are any, else the readings.

        In the order of the file, shape (n, joints), radians (metres from columns in mm).
        """
        return self._of_poses(self.programmed_columns or self.joint_columns)

    def with_programmed(self, joints: FloatArray) -> MeasurementSet:
        """The same with programmed joints (n, joints) of each pose, as `joints` counts them.

        Radians (metres for columns in mm).
        """
        names = self.joint_columns
        q = joints if self.coupling is None else joints @ np.linalg.inv(self.coupling).T
        table = self.table
        number = np.unique(table["pose_index"], return_inverse=True)[1]
        for name, column in zip(names, (q / columns.joint_units(names)).T, strict=True):
            table[f"c{name[1:]}"] = column[number]
        return replace(self, table=table)

    def readings(self) -> FloatArray:
        """Joint readings (``q1_deg`` …) of each pose, shape and units as `joints`."""
        return self._of_poses(self.joint_columns)

    def _of_poses(self, names: list[str]) -> FloatArray:
        first = np.unique(self._rows["pose_index"], return_index=True)[1]
        q: FloatArray = self._rows[names].to_numpy()[first] * columns.joint_units(names)
        return q if self.coupling is None else np.asarray(q @ self.coupling.T)

    def reading_lag(self) -> ReadingLag | None:
        """How the readings differ from the programmed joints, and whether they lag; None without programmed joints."""
        if not self.programmed:
            return None
        poses = self._rows.groupby("pose_index", sort=True)
        groups = poses["group"].first().to_numpy(dtype=object) if "group" in self._rows.columns else None
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
        return self if arm.coupling is None else replace(self, coupling=arm.coupling)

    def check_joints(self, arm: Arm) -> None:
        """Refuse joint columns that are not those of an arm.

        Raises
        ------
        MeasurementError
            The sentence names the columns.
        """
        expected, actual = arm.joint_columns, self.joint_columns
        if expected != actual:
            missing = [name for name in expected if name not in actual]
            which = f"missing column {', '.join(missing)}" if missing else f"there is a column {actual[len(expected)]}"
            raise MeasurementError(
                f"{which}: {arm.name} has {len(expected)} joints between the links {arm.base_link} and {arm.tip_link} "
                f"(--base-link, --tip-link) with the columns {expected[0]} … {expected[-1]}, found {', '.join(actual)}",
                file=self.source,
                row=columns.header_row(self.source),
            )

    def payloads(self) -> FloatArray | None:
        """Mass carried at each pose, shape (n,), kg, NaN where not given; None without a column payload_kg."""
        if "payload_kg" not in self._rows.columns:
            return None
        loads = self._rows.groupby("pose_index", sort=True)["payload_kg"].first().to_numpy(dtype=float)
        return loads if np.isfinite(loads).any() else None

    def payload_places(self) -> FloatArray | None:
        """Centre of the payload in the tip link at each pose, shape (n, 3), metres; None without columns."""
        names = columns.payload_centre_columns(self._rows.columns, self.source)
        if not names:
            return None
        centres = self._rows.groupby("pose_index", sort=True)[names].first().to_numpy(dtype=float) * MM
        return centres if np.isfinite(centres).any() else None

    def torques(self) -> FloatArray | None:
        """Measured torques of the joints at each pose, shape (n, joints), N m; None without columns tau1_nm …."""
        names = columns.torque_columns(self._rows.columns, self.source)
        if not names:
            return None
        return self._rows.groupby("pose_index", sort=True)[names].mean().to_numpy(dtype=float)

    def is_reference(self) -> BoolArray:
        """Mask of the rows that are reference points fixed to the ground (Nubiola 2011, section 7.1)."""
        return self._rows["target"].str.lower().str.startswith(REFERENCE_PREFIX).to_numpy(dtype=bool)

    def rotations(self) -> FloatArray | None:
        """Measured orientations of all rows, shape (rows, 3, 3), NaN where there is none; None without columns."""
        return InputTable(self._rows).rotations(lost=True)

    def uncertainties(self) -> FloatArray | None:
        """Expanded uncertainties of all rows, shape (rows,), metres, NaN where not given; None without a column."""
        return self._rows["u95_mm"].to_numpy() * MM if "u95_mm" in self._rows.columns else None

    def positions(self) -> FloatArray:
        """Positions of all rows, shape (rows, 3), metres; NaN where lost."""
        return self._rows[POSITION].to_numpy() * MM

    def to_frame(self) -> pd.DataFrame:
        """The table in the columns of a measurement file (degrees and millimetres), for `read` or ``to_csv``."""
        first = ["pose", *self.joint_columns, *self.programmed_columns, "target", *POSITION]
        others = [name for name in self._rows.columns if name not in (*first, "row", "pose_index")]
        return self._rows[[*first, *others]].copy()

    def report(self) -> Sequence[Paragraph]:
        """Counts of rows, poses and lost points; tables of targets, of groups and of programmed joints."""
        lost = np.isnan(self.positions()).any(axis=1)
        counts = f"{len(self)} rows, {self.poses} poses, {int(lost.sum())} lost points"
        text = f"{self.source}: {counts}{', SIMULATED' if self.simulated else ''}"
        rows = pd.DataFrame({"target": self._rows["target"], "reference": self.is_reference(), "lost": lost})
        targets = tuple(
            (str(name), "reference" if group["reference"].any() else "tool", len(group), int(group["lost"].sum()))
            for name, group in rows.groupby("target", sort=True)
        )
        lines: list[Paragraph] = [text, Table("Targets", ("target", "fixed to", "rows", "lost"), targets)]
        if "group" in self._rows.columns:
            counted = self._rows.groupby("group", sort=False)["pose_index"].nunique()
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
    if not isinstance(source, (str, PathLike, pd.DataFrame)):
        if not isinstance(source, HoldsMeasurements):
            raise MeasurementError(
                f"expected measurements (a file, a DataFrame or a result that holds them), found {shown(source)}",
                parameter="measurements",
            )
        return source.measurements()
    try:
        return _checked(InputTable.read(source, REQUIRED, typed=_of_numbers))
    except MeasurementError as error:
        raise _with_import(error, source) from None


read_measurements = read


def _with_import(error: MeasurementError, source: TableLike) -> MeasurementError:
    """A refusal of a file's header, with the command that imports files of other programs."""
    if isinstance(source, pd.DataFrame) or error.row != 1 or Path(source).suffix == ".parquet":
        return error
    message = str(error).removeprefix(str(MeasurementError("", file=error.file, row=error.row, column=error.column)))
    command = f"irbcal import {literals.shell(str(source))} --robot ROBOT --out measured.csv"
    return MeasurementError(
        f"{message.removeprefix(': ')}; a file of another program is imported first: {command}",
        file=error.file,
        row=error.row,
        column=error.column,
    )


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
    return name in POSITION or name in NUMERIC_EXTRAS or columns.is_joint(name) or columns.is_torque(name)


def _checked(rows: InputTable) -> MeasurementSet:
    names, source = rows.names, rows.source
    cells: dict[str, Any] = {"row": rows.rows}
    joints = [*columns.joint_columns(names), *columns.programmed_columns(names, source)]
    for name in [*joints, *columns.torque_columns(names, source)]:
        cells[name] = rows.numbers(name)
    for name in POSITION:
        cells[name] = rows.numbers(name, lost=True)
    for name in ("pose", "target"):
        cells[name] = rows.filled(name)
    for name in [name for name in names if name not in cells]:
        if name in NUMERIC_EXTRAS:
            cells[name] = rows.numbers(name, lost=True)
        else:
            cells[name] = rows.texts(name) if name in ("group", "cycle", "session") else rows.cells[name].to_numpy()
    lost = rows.lost()
    table = pd.DataFrame(cells | {name: np.where(lost, np.nan, cells[name]) for name in POSITION}, copy=False)
    table["pose_index"] = _pose_index(table, source)
    columns.payload_centre_columns(names, source)
    quaternions = rows.quaternions()
    if quaternions is not None:
        table[QUATERNION] = quaternions
    return MeasurementSet(table, source, rows.sha256)


def _pose_index(table: pd.DataFrame, source: str) -> IntArray:
    """Number poses in the order of the file; one pose (and cycle) has one set of joints, read and programmed."""
    key: Any = table["pose"]
    if "cycle" in table.columns:
        key = key + " / " + table["cycle"].astype(str)
    if "session" in table.columns:
        key = key + " / " + table["session"].astype(str)
    index = pd.factorize(key)[0]
    first = np.unique(index, return_index=True)[1]
    programmed = columns.programmed_columns(table.columns, source)
    for names, kind in ((columns.joint_columns(table.columns), "joints"), (programmed, "programmed joints")):
        if names:
            _check_same(table, names, kind, first[index], source)
    for name in (PAYLOAD, *PAYLOAD_CENTRE):
        if name in table.columns:
            _check_same(table, [name], "payload", first[index], source)
    return index


def _check_same(table: pd.DataFrame, names: list[str], kind: str, first: IntArray, source: str) -> None:
    """Refuse a row whose joints are not those of its pose's first row."""
    joints = table[names].to_numpy()
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
