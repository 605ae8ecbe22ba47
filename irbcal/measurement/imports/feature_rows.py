"""Import of rows at features: other programs' tables, understood by a map, as `irbcal.measurement.features` reads them.

No maker's format of a ballbar, string encoder or probe is documented that holds the robot's joints beside the values;
so this is the general one: any table with a header or numbered columns, a row for each contact or reading, or a row for
each pose with the values of several features beside one another.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pandas as pd
from pydantic import BaseModel, ConfigDict, Field, model_validator

from irbcal.arrays import BoolArray, FloatArray
from irbcal.errors import OptionError
from irbcal.measurement.imports import column_map, tables
from irbcal.measurement.imports.column_map import (
    Changes,
    Column,
    ColumnName,
    Dialect,
    JointRules,
    Lost,
    ThreeColumns,
    Units,
    check_programmed,
)
from irbcal.measurement.imports.reader import joint_rules_applied
from irbcal.measurement.imports.source_file import (
    ALWAYS_LOST,
    ANGLE_DEG,
    LENGTH_MM,
    ROW,
    SOURCE,
    joint_places,
    joint_values,
    undeclared,
)
from irbcal.measurement.imports.tables import TextTable
from irbcal.names import csv_bytes
from irbcal.overwriting import refuse_overwriting
from irbcal.safe_files import write_set
from irbcal.summary import Paragraph, Result

NAME = "features"
"""What ``irbcal import --as`` calls it."""

PRESET = """\
about: >-
  Rows at features (balls, sockets, planes, strings, ballbars, inclinometers) of any table, for irbcal calibrate
  --features.
# Example: joints and three string encoders in a row, in millimetres
#   J1;J2;J3;J4;J5;J6;L1;L2;L3
#   irbcal import strings.csv --as features --set 'columns.joints=[J1, J2, J3, J4, J5, J6]' --set units.joints=deg
#     --set 'columns.values={string 1: L1, string 2: L2, string 3: L3}' --set units.lengths=mm --out rows.csv
#
# Example: contacts, the ball's name in a column
#   irbcal import contacts.txt --as features --set 'columns.joints=[1, 2, 3, 4, 5, 6]' --set units.joints=rad
#     --set columns.feature=7 --set file.header=false --out rows.csv
#
# This is not a maker's format: all of it is up to who wrote the table.
rows: features
file: {delimiter: auto, decimal: auto}
columns: {}                         # joints, and feature or values
units: {}                           # joints: deg, lengths: mm, angles: deg
values: length                      # or angle, of an inclinometer
"""


class _RowsModel(BaseModel):
    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, frozen=True)


class RowColumns(_RowsModel):
    """Columns by name, or by number from 1 (from -1 backwards).

    ``values`` are columns of several features that share a row; else ``feature`` (unless ``keep`` hands on columns that
    name it together, such as place and socket) and, for kinds that have one, ``value``. ``position`` is what a sensor
    or tracker saw. ``u95`` has the unit of the values. ``keep`` hands columns on under new names.
    """

    joints: Annotated[list[Column], Field(min_length=1, max_length=20)]
    programmed: Annotated[list[Column], Field(min_length=1, max_length=20)] | None = None
    pose: Column | None = None
    feature: Column | None = None
    target: Column | None = None
    kind: Column | None = None
    value: Column | None = None
    values: Annotated[dict[ColumnName, Column], Field(max_length=50)] = {}
    position: ThreeColumns | None = None
    u95: Column | None = None
    payload: Column | None = None
    keep: Annotated[dict[ColumnName, Column], Field(max_length=50)] = {}


class FixedRow(_RowsModel):
    """Values that the file does not hold."""

    feature: ColumnName | None = None
    kind: ColumnName | None = None
    target: ColumnName | None = None
    payload_kg: Annotated[float, Field(ge=0)] | None = None
    u95_mm: Annotated[float, Field(gt=0)] | None = None


class FeatureMap(_RowsModel):
    """All that is to be known about a table of rows at features; parts as in `ImportMap`."""

    about: str = ""
    rows: Literal["features"]
    file: Dialect = Dialect()
    columns: RowColumns
    units: Units = Units()
    values: Literal["length", "angle"] = "length"
    joints: JointRules = JointRules()
    lost: Lost = Lost()
    fixed: FixedRow = FixedRow()

    @model_validator(mode="after")
    def _one_way_of_values(self) -> FeatureMap:
        columns = self.columns
        if columns.values and (columns.value is not None or columns.feature is not None):
            raise ValueError("columns.values: expected no columns.feature and columns.value beside it")
        check_programmed("columns", columns.joints, columns.programmed)
        return self


@dataclass(frozen=True, eq=False, repr=False)
class ImportedRows(Result):
    """What was understood.

    Attributes
    ----------
    table : DataFrame
        The first file of ``irbcal calibrate --features``, degrees and millimetres.
    lost : int
        Readings of features that were not there: their rows are left out.
    map : FeatureMap
    out : Path or None
    """

    table: pd.DataFrame
    lost: int
    map: FeatureMap
    out: Path | None = None

    CONTENT = "out rows=table.__len__ poses features=counts lost map=map_as_written"
    COLUMNS = "*table"

    @property
    def poses(self) -> int:
        """Poses of the rows."""
        return int(self.table["pose"].nunique())

    def map_as_written(self) -> dict[str, Any]:
        """What a map's file has."""
        return self.map.model_dump(exclude_defaults=True)

    @property
    def counts(self) -> dict[str, int]:
        """Rows of each feature, where a column names it."""
        return {} if "feature" not in self.table else dict(self.table["feature"].value_counts(sort=False).items())

    def csv(self) -> bytes:
        """The file as bytes."""
        rounded = self.table.copy()
        numbers = rounded.select_dtypes("number").columns
        rounded[numbers] = rounded[numbers].round(9) + 0.0
        return csv_bytes(rounded)

    def report(self) -> Sequence[Paragraph]:
        """Counts; what was not written yet is shown."""
        names = ", ".join(f"{name} {count}" for name, count in self.counts.items())
        lines = [
            f"{len(self.table)} rows in {self.poses} poses, {self.lost} lost readings" + (f"; {names}" if names else "")
        ]
        if self.out is not None:
            return [*lines, f"Written to {self.out}"]
        return [*lines, *self.csv().decode().splitlines()[:6]]


def is_of_features(name: str | PathLike[str] | None) -> bool:
    """Whether a map is one of rows at features: the general one by its name, or a file that says so."""
    if name is None or str(name) == NAME:
        return name is not None
    return Path(name).is_file() and column_map.values_of(name)[0].get("rows") == NAME


def import_features(
    *sources: str | PathLike[str],
    as_: str | PathLike[str] | FeatureMap = NAME,
    out: str | PathLike[str] | None = None,
    set_: Changes = (),
    dry_run: bool = False,
) -> ImportedRows:
    """Turn tables of other programs into rows at features: ``irbcal import --as features`` as a function.

    Parameters
    ----------
    *sources : str or Path
        Files of one kind.
    as_ : str, Path or FeatureMap
        ``features``, a map file (YAML) with ``rows: features``, or a map.
    out : str or Path, optional
        File to write (CSV), whole or not at all.
    set_ : dict, or sequence of str
        Changes of the map, such as ``{"units.lengths": "mm"}``.
    dry_run : bool
        Write nothing, even with ``out``.

    Raises
    ------
    MeasurementError
        If a file does not fit the map; the sentence names file, row, column, what was expected and what was found.
    OptionError
        If there is no source, or ``set_`` is to change a `FeatureMap`.
    """
    if not sources:
        raise OptionError("sources: expected one file or more, found none", parameter="sources")
    if isinstance(as_, FeatureMap):
        if set_:
            raise OptionError("set_: expected no changes beside a FeatureMap: change the map itself", parameter="set_")
        layout = as_
    else:
        source = f"preset {NAME}" if str(as_) == NAME else str(as_)
        values = column_map.changed(PRESET, source, set_) if str(as_) == NAME else column_map.values_of(as_, set_)[0]
        layout = column_map.validated(FeatureMap, values, source)
    if out is not None:
        refuse_overwriting({"out": out}, list(sources))
    frames, lost, poses = [], 0, 0
    for path in sources:
        frame, rows_lost, count = _understood(tables.read(path, layout.file, layout.lost.texts), layout, poses)
        frames.append(frame)
        lost, poses = lost + rows_lost, poses + count
    imported = ImportedRows(pd.concat(frames, ignore_index=True).drop(columns=[SOURCE, ROW]), lost, layout)
    if out is None or dry_run:
        return imported
    write_set({Path(out): imported.csv()})
    return replace(imported, out=Path(out))


def _understood(text: TextTable, layout: FeatureMap, first_pose: int) -> tuple[pd.DataFrame, int, int]:
    """Rows of one file, how many readings are lost, and its poses."""
    columns, units = layout.columns, layout.units
    if units.joints is None:
        undeclared(
            text.source, "the unit of the joints", "units.joints=deg", "rad, or a list with a unit for each joint"
        )
    joints, programmed = joint_places(text, columns.joints, columns.programmed)
    readings = {name: text.find(column, f"the value of {name}") for name, column in columns.values.items()}
    single = {} if columns.value is None else {"": text.find(columns.value, "the value")}
    position = [text.find(name, "the position") for name in columns.position or ()]
    numeric = [*joints, *programmed, *readings.values(), *single.values(), *position]
    text = text.with_decimal(numeric)
    count = len(text.cells)
    shared: dict[str, Any] = {
        SOURCE: text.source,
        ROW: text.lines,
        "pose": (np.arange(count) + first_pose + 1).astype(str),
    }
    shared |= joint_values(text, joints, programmed, units.joints)
    shared |= _beside(text, layout)
    if position:
        for axis, k in zip("xyz", position, strict=True):
            shared[f"{axis}_mm"] = _measured(text, k, layout, "a position or nothing")[1]
    frame = joint_rules_applied(pd.DataFrame(shared, index=range(count)), layout.joints)
    frames, lost = [], 0
    columns_of: dict[str, int | None] = {**(readings or single)} or {"": None}
    for name, index in columns_of.items():
        rows_of_feature = frame if not name else frame.assign(feature=name)
        if index is not None:
            rows_lost = _rows_lost(text, index, layout)
            unit, values = _measured(text, index, layout, "a value or nothing", layout.values)
            rows_of_feature = rows_of_feature.assign(**{f"value_{unit}": values})[~rows_lost]
            lost += int(rows_lost.sum())
        frames.append(rows_of_feature)
    rows = pd.concat(frames).sort_index(kind="stable")
    first = ["pose", *(name for name in rows.columns if name[0] in "qc" and name.endswith(("_deg", "_mm")))]
    first += [name for name in ("target", "feature", "kind", "value_mm", "value_deg") if name in rows.columns]
    return rows[[*first, *(name for name in rows.columns if name not in first)]], lost, count


def _beside(text: TextTable, layout: FeatureMap) -> dict[str, Any]:
    """Columns beside joints and readings, and values that the file does not hold."""
    columns, out = layout.columns, dict[str, Any]()
    for name in ("pose", "target", "kind", "feature"):
        column = getattr(columns, name)
        if column is not None:
            out[name] = text.text(text.find(column, f"the {name}")).to_numpy()
    for new, column in columns.keep.items():
        out[new] = text.text(text.find(column, new)).to_numpy()
    if columns.u95 is not None:
        unit, values = _measured(text, text.find(columns.u95, "the u95"), layout, "a number or nothing", layout.values)
        out[f"u95_{unit}"] = values
    if columns.payload is not None:
        k = text.find(columns.payload, "the payload")
        out["payload_kg"] = text.numbers(k, "a number or nothing", _rows_lost(text, k, layout))
    return out | {name: value for name, value in layout.fixed.model_dump().items() if value is not None}


def _rows_lost(text: TextTable, k: int, layout: FeatureMap) -> BoolArray:
    """Cells of a column that hold no number."""
    return text.is_one_of(k, [*ALWAYS_LOST, *layout.lost.texts])


def _measured(
    text: TextTable, k: int, layout: FeatureMap, expected: str, quantity: Literal["length", "angle"] = "length"
) -> tuple[str, FloatArray]:
    """A column of lengths or angles: ``mm`` or ``deg``, and its numbers in that unit, NaN where lost."""
    units = layout.units
    if quantity == "length":
        if units.lengths is None:
            undeclared(text.source, "the unit of the lengths", "units.lengths=mm", "m or inch")
        text.check_unit(k, units.lengths, "lengths in")
        unit, factor = "mm", LENGTH_MM[units.lengths]
    else:
        if units.angles is None:
            undeclared(text.source, "the unit of the angles", "units.angles=deg", "rad")
        text.check_unit(k, units.angles, "angles in")
        unit, factor = "deg", ANGLE_DEG[units.angles]
    return unit, text.numbers(k, expected, _rows_lost(text, k, layout)) * factor
