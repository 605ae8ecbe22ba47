"""A table of another program by its map: joints, points, names and time, column by column."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple, NoReturn, TypeAlias

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from irbcal.arrays import BoolArray, FloatArray, IntArray
from irbcal.errors import MeasurementError
from irbcal.measurement.column_names import POSITION, QUATERNION, in_degrees
from irbcal.measurement.imports.column_map import OWN_COLUMNS, RESERVED, Column, ImportMap, pattern_regex
from irbcal.measurement.imports.tables import TextTable
from irbcal.measurement.text_files import short
from irbcal.units import DEG, MM

LENGTH_MM = {"mm": 1.0, "m": 1.0 / MM, "inch": 25.4}
"""Millimetres of a length unit."""
ANGLE_DEG = {"deg": 1.0, "rad": 1.0 / DEG}
"""Degrees of an angle unit."""
TIME_S = {"s": 1.0, "ms": 1e-3}
ALWAYS_LOST = ("", "nan", "none", "null")
"""Cells that hold no number, in lower case."""
LONGEST_NAME = 100
"""Characters of a name that is taken apart."""
ROW, SOURCE = " row", " source"
"""Where each row comes from; no column of a file begins with a blank."""
_COMPACT = re.compile(r"^(\d{4})(\d\d)(\d\d)(\d\d)(\d\d)(\d\d)[.,]?(\d{0,6})$")
"""A time stamp without marks: 20200714163904, with or without parts of a second."""


def _spaced(stamp: re.Match[str]) -> str:
    """A time stamp with marks."""
    year, month, day, hour, minute, second, fraction = stamp.groups()
    return f"{year}-{month}-{day} {hour}:{minute}:{second}{f'.{fraction}' if fraction else ''}"


Values: TypeAlias = dict[str, Any]
"""Columns of the output by name: arrays, or one value for all rows."""


class Declared(NamedTuple):
    """Units of a file as the map declares them; those of what the file does not hold do not matter."""

    lengths: str
    joints: str | Sequence[str]
    time: str


def declared_units(import_map: ImportMap, source: str) -> Declared:
    """Units that the map declares.

    Raises
    ------
    MeasurementError
        If it leaves open one that is needed.
    """
    columns, units = import_map.columns, import_map.units
    if units.lengths is None:
        undeclared(source, "the unit of the positions", "units.lengths=mm", "m or inch")
    if columns.joints and units.joints is None:
        undeclared(source, "the unit of the joints", "units.joints=deg", "rad, or a list with a unit for each joint")
    if columns.time is not None and units.time is None:
        undeclared(source, "the unit of the time", "units.time=s", "ms or iso")
    return Declared(units.lengths, units.joints or (), units.time or "")


class SourceFile:
    """One source file, understood column by column.

    Parameters
    ----------
    text : TextTable
    import_map : ImportMap
    targets_elsewhere : bool
        The joints file says what was measured.

    Raises
    ------
    MeasurementError
        If the file lacks a column of the map, holds something else in it, or needs what the map does not declare.
    """

    def __init__(self, text: TextTable, import_map: ImportMap, targets_elsewhere: bool = False) -> None:
        self.targets_elsewhere = targets_elsewhere
        self.map, self.units = import_map, declared_units(import_map, text.source)
        columns = import_map.columns
        triples: dict[str | None, Sequence[Column]] = {}
        if isinstance(columns.position, dict):
            triples.update(columns.position)
        else:
            triples[None] = columns.position
        self.positions = [[text.find(name, "the position") for name in triple] for triple in triples.values()]
        self.target_names = list(triples)
        optional = self._optional("programmed")
        self.joints, self.programmed = joint_places(text, columns.joints, columns.programmed, optional)
        numeric = [k for position in (self.joints, self.programmed, *self.positions) for k in position]
        double = [text.label(k) for k in numeric if numeric.count(k) > 1]
        if double:
            raise MeasurementError(
                f"columns: expected each column of joints and positions once, found {double[0]!r} again",
                file=text.source,
            )
        self.used_columns = set(numeric)
        self.table = text
        self.orientation = self._several(columns.orientation, "orientation")
        self.table = text.with_decimal([*numeric, *(self.orientation or ())])
        self.source = text.source
        self.file_fields = self._from_file_name()
        """What the file's name says (target, group, pose, cycle)."""

    def frame(self, number: int) -> pd.DataFrame:
        """Rows of the output; ``number`` poses were counted before this file."""
        rows = len(self.table.cells)
        shared: Values = {
            SOURCE: self.source,
            ROW: self.table.lines,
            "pose": (np.arange(rows) + number + 1).astype(str),
        }
        shared |= self._names()
        if self.joints:
            shared |= joint_values(self.table, self.joints, self.programmed, self.units.joints)
        shared |= self._extras()
        frames = []
        for name, columns in zip(self.target_names, self.positions, strict=True):
            target = {"target": name} if name is not None else {}
            frames.append(pd.DataFrame(shared | target | self._pose_values(columns), index=range(rows)))
        # targets that share a row stay together
        return pd.concat(frames).sort_index(kind="stable") if len(frames) > 1 else frames[0]

    def _optional(self, key: str) -> bool:
        return key in self.map.columns.optional

    def _one(self, column: Column | None, key: str) -> int | None:
        """Place of a column, None if there is none; an optional one that is taken for another purpose is not there."""
        if column is None:
            return None
        k = self.table.find(column, f"the {key}", self._optional(key))
        if k in self.used_columns and self._optional(key):
            return None
        return k

    def _several(self, columns: Sequence[Column] | None, key: str) -> list[int] | None:
        if columns is None:
            return None
        indices = [self.table.find(column, f"the {key}", self._optional(key)) for column in columns]
        present = [k for k in indices if k is not None]
        if len(present) < len(indices) or (self._optional(key) and self.used_columns.intersection(present)):
            return None
        _check_orientation(self.map, self.table.source, len(present))
        self.used_columns |= set(present)
        return present

    def _from_file_name(self) -> dict[str, str]:
        pattern = self.map.file_name
        if pattern is None:
            return {}
        stem = Path(self.source).stem
        return take_apart(pd.Series([stem]), [pattern], self.source).iloc[0].to_dict()

    def _names(self) -> Values:
        """Pose, target, group, cycle and session as columns or names say."""
        columns, fixed = self.map.columns, {"target": self.map.fixed.target, "group": self.map.fixed.group}
        out: Values = {name: value for name, value in fixed.items() if value is not None} | self.file_fields
        if columns.name:
            columns_text = [self.table.text(self.table.find(name, "the name")) for name in columns.name]
            joined = columns_text[0].str.cat(columns_text[1:], sep="::") if len(columns_text) > 1 else columns_text[0]
            fields = take_apart(joined, self.map.names, self.source, self.table.lines)
            out |= {name: fields[name].to_numpy() for name in fields.columns}
        for key in ("pose", "target", "group", "cycle", "session"):
            k = self._one(getattr(columns, key), key)
            if k is not None:
                out[key] = self._full(k, key) if key in ("pose", "target") else self.table.text(k).to_numpy()
        if "target" not in out and self.target_names == [None] and not self.targets_elsewhere:
            undeclared(self.source, "the target", "fixed.target=smr1", "another name")
        return out

    def _full(self, k: int, key: str) -> NDArray[Any]:
        """A column in which every row must have a name."""
        text = self.table.text(k)
        if (text == "").any():
            row = int(np.flatnonzero(text == "")[0])
            raise self.table.fault(f"expected the name of a {key}, found nothing", row, k)
        return text.to_numpy()

    def _pose_values(self, columns: Sequence[int]) -> dict[str, FloatArray]:
        """Position and orientation of one target, NaN where lost."""
        out: dict[str, FloatArray] = {}
        unit = self.units.lengths
        empty = [self._is_marker(k) for k in columns]
        lost = np.any(empty, axis=0) | self._bad_status()
        for name, k, gap in zip(POSITION, columns, empty, strict=True):
            self.table.check_unit(k, unit, "lengths in")
            absent = gap | lost if self.map.lost.status else gap
            values = self.table.numbers(k, f"a position in {unit} or a mark of a lost point", absent)
            out[name] = values * LENGTH_MM[unit]
        lost |= np.all([values == 0.0 for values in out.values()], axis=0)
        for values in out.values():
            values[lost] = np.nan
        if self.orientation is not None:
            quaternion = self._quaternions(self.orientation, lost)
            out |= dict(zip(QUATERNION, quaternion.T, strict=True))
        return out

    def _is_marker(self, k: int) -> BoolArray:
        """Rows whose cell in a column says that the point is lost, as text or as number."""
        markers = self.map.lost.markers
        numbers = [float(value) for value in markers if not isinstance(value, str)]
        return self.table.is_one_of(k, [*ALWAYS_LOST, *self.map.lost.texts], numbers)

    def _bad_status(self) -> BoolArray:
        status = self.map.lost.status
        if status is None:
            return np.zeros(len(self.table.cells), dtype=bool)
        text = self.table.text(self.table.find(status.column, "the status"))
        return ~text.str.lower().isin([str(value).strip().lower() for value in status.good]).to_numpy()

    def _quaternions(self, columns: Sequence[int], lost: BoolArray) -> FloatArray:
        """Unit quaternions, scalar first, shape (rows, 4); NaN where lost or absent."""
        from scipy.spatial.transform import Rotation

        convention = self.map.orientation
        absent = np.any([self._is_marker(k) for k in columns], axis=0) | lost
        angles = "rad" if convention.kind == "ur" else self.map.units.angles
        if convention.kind not in ("quaternion", "matrix"):
            for k in columns:
                self.table.check_unit(k, angles, "angles in")
        numbers = {"quaternion": "a quaternion's number", "matrix": "a number of a rotation matrix"}
        expected = numbers.get(convention.kind or "", f"an angle in {angles}")
        values = np.column_stack([self.table.numbers(k, expected, absent) for k in columns])
        out = np.full((len(values), 4), np.nan)
        have = ~absent
        if not have.any():
            return out
        values = values[have]
        if convention.kind == "matrix":
            rotation = Rotation.from_matrix(self._rotations(columns, values.reshape(-1, 3, 3), np.flatnonzero(have)))
        elif convention.kind == "quaternion":
            self._check_unit_length(columns, values, np.flatnonzero(have))
            rotation = Rotation.from_quat(values if convention.scalar == "last" else np.roll(values, -1, axis=1))
        else:
            radians = values * (ANGLE_DEG[angles or "rad"] * DEG)
            if convention.kind == "euler":
                axes = convention.axes or ""
                rotation = Rotation.from_euler(axes.upper() if convention.about == "moving" else axes, radians)
            else:
                rotation = Rotation.from_rotvec(radians)
        if convention.maps == "tracker-to-target":
            rotation = rotation.inv()
        out[have] = np.roll(rotation.as_quat(canonical=True), 1, axis=1)
        return out

    def _rotations(self, columns: Sequence[int], values: FloatArray, rows: IntArray) -> FloatArray:
        """Rotation matrices as read, (n, 3, 3), refused where they are none."""
        off = np.abs(values @ values.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
        bad = (off > 2e-3) | (np.linalg.det(values) < 0)
        if bad.any():
            k = int(np.flatnonzero(bad)[0])
            problem = (
                "a left-handed one"
                if off[k] <= 2e-3
                else f"rows that are no unit vectors at right angles ({off[k]:.2g})"
            )
            raise self.table.fault(f"expected a rotation matrix, found {problem}", rows[k], *columns)
        return values

    def _check_unit_length(self, columns: Sequence[int], values: FloatArray, rows: IntArray) -> None:
        norm = np.linalg.norm(values, axis=1)
        bad = np.abs(norm - 1.0) > 1e-3
        if bad.any():
            k = int(np.flatnonzero(bad)[0])
            numbers = ", ".join(f"{value:g}" for value in values[k])
            raise self.table.fault(f"expected a unit quaternion, found {numbers}", rows[k], *columns)

    def _extras(self) -> Values:
        """Uncertainty, payload, time and the columns that are kept."""
        columns = self.map.columns
        fixed = {"u95_mm": self.map.fixed.u95_mm, "payload_kg": self.map.fixed.payload_kg}
        out: Values = {name: value for name, value in fixed.items() if value is not None}
        for key in ("u95", "payload"):
            k, name = self._one(getattr(columns, key), key), OWN_COLUMNS[key]
            if k is not None:
                values = self.table.numbers(k, "a number or nothing", self._is_marker(k))
                if key == "u95" and self.table.key(k) != name:  # u95_mm says its unit itself
                    self.table.check_unit(k, self.units.lengths, "lengths in")
                    values = values * LENGTH_MM[self.units.lengths]
                out[name] = values
        k = self._one(columns.time, "time")
        if k is not None:
            out["time_s"] = self._time(k)
        for name, column in columns.keep.items():
            out[name] = self._kept(self.table.find(column, name))
        if columns.others and self.table.names:
            used = self.used_columns | self._used()
            names = enumerate(self.table.names)
            out |= {name: self._kept(k) for k, name in names if k not in used and name and name not in RESERVED}
        return out

    def _used(self) -> set[int]:
        """Places of all columns that the map names beside those of numbers."""
        columns, status = self.map.columns, self.map.lost.status
        keys = [getattr(columns, key) for key in ("pose", "target", *OWN_COLUMNS)]
        keys += [*(columns.name or ()), *columns.keep.values(), *([] if status is None else [status.column])]
        indices = (self.table.find(column, "a use", True) for column in keys if column is not None)
        return {k for k in indices if k is not None}

    def _time(self, k: int) -> FloatArray:
        text, unit = self.table.text(k), self.units.time
        absent = self.table.is_one_of(k, ALWAYS_LOST)
        if unit != "iso":
            return self.table.numbers(k, f"a time in {unit} or nothing", absent) * TIME_S[unit]
        text = text.str.replace(_COMPACT, _spaced, regex=True)
        when = pd.to_datetime(text.where(~absent), errors="coerce", format="ISO8601", utc=True)
        bad = when.isna().to_numpy() & ~absent
        if bad.any():
            row = int(np.flatnonzero(bad)[0])
            expected = "a time such as 2024-05-31 14:03:07.5 or nothing"
            raise self.table.fault(f"expected {expected}, found {short(text.iloc[row])!r}", row, k)
        return (when - pd.Timestamp(0, tz="UTC")).dt.total_seconds().to_numpy()

    def _kept(self, k: int) -> NDArray[Any]:
        """A column handed on: numbers with a decimal point if all its cells are numbers, else the text."""
        text = self.table.text(k)
        try:
            return self.table.numbers(k, "a number", (text == "").to_numpy())
        except MeasurementError:
            return text.to_numpy()


def take_apart(names: pd.Series, patterns: Sequence[str], source: str, rows: IntArray | None = None) -> pd.DataFrame:
    """Fields of names by the first pattern that fits all of them, else each name by the first that fits it.

    Parameters
    ----------
    names : Series of str
    patterns : sequence of str
        Such as ``{pose}_{target}``.
    source : str
        File name for messages.
    rows : ndarray of int, optional
        Rows of the names for messages; without them the name is the file's own.

    Returns
    -------
    DataFrame
        A column for each field.

    Raises
    ------
    MeasurementError
        For a name that no pattern fits or that is too long.
    """

    def refusal(k: int, expected: str) -> MeasurementError:
        name, row = short(names.iloc[k]), None if rows is None else int(rows[k])
        return MeasurementError(
            f"{'file name: ' if rows is None else ''}expected {expected}, found {name!r}", file=source, row=row
        )

    names = names.astype(object)
    long = (names.str.len() > LONGEST_NAME).to_numpy(dtype=bool)
    worst = int(long.argmax())
    if long.any():
        raise refusal(worst, f"a name of at most {LONGEST_NAME} characters")
    regexes = [re.compile(pattern_regex(pattern)) for pattern in patterns]
    fits = np.column_stack([names.str.fullmatch(regex).to_numpy(dtype=bool) for regex in regexes])
    if not fits.any(axis=1).all():
        raise refusal(int(np.flatnonzero(~fits.any(axis=1))[0]), f"a name such as {' or '.join(patterns)}")
    all_fit = fits.all(axis=0)
    chosen = np.full(len(names), int(all_fit.argmax())) if all_fit.any() else fits.argmax(axis=1)
    parts = []
    for k in np.unique(chosen):
        fields_read = names[chosen == k].str.extract(regexes[k])
        by_number = {number: name for name, number in regexes[k].groupindex.items()}
        fields_read.columns = [by_number.get(number) for number in range(1, regexes[k].groups + 1)]
        parts.append(fields_read[list(by_number.values())])
    return pd.concat(parts).loc[names.index]


def joint_places(
    text: TextTable, joints: Sequence[Column] | None, programmed: Sequence[Column] | None, optional: bool = False
) -> tuple[list[int], list[int]]:
    """Places of joints and of programmed ones; of these none where they are optional and not all there."""
    places = [text.find(name, f"joint {k}") for k, name in enumerate(joints or (), 1)]
    beside = [text.find(name, f"programmed joint {k}", optional) for k, name in enumerate(programmed or (), 1)]
    return places, [] if None in beside else [k for k in beside if k is not None]


def joint_values(
    text: TextTable, joints: Sequence[int], programmed: Sequence[int], units: str | Sequence[str]
) -> dict[str, FloatArray]:
    """Joint columns of a file in degrees and mm, dict of name to values; those of programmed joints begin with c."""
    units = [units] * len(joints) if isinstance(units, str) else units
    if len(units) != len(joints):
        raise MeasurementError(
            f"units.joints: expected one unit or {len(joints)}, one for each joint, found {len(units)}",
            file=text.source,
        )
    out = {}
    for letter, columns in (("q", joints), ("c", programmed)):
        for number, (k, unit) in enumerate(zip(columns, units, strict=False), 1):
            if text.names and in_degrees(text.names[k]) != text.names[k]:  # q1_rad says its unit itself
                unit = "rad"
            text.check_unit(k, unit, "joints in")
            turns = unit in ANGLE_DEG
            quantity = "a joint angle" if turns else "a joint's travel"
            factor = ANGLE_DEG[unit] if turns else LENGTH_MM[unit]
            out[f"{letter}{number}_{'deg' if turns else 'mm'}"] = text.numbers(k, f"{quantity} in {unit}") * factor
    return out


def _check_orientation(import_map: ImportMap, source: str, count: int) -> None:
    """Refuse an orientation whose convention is not declared."""
    convention = import_map.orientation
    title = "the orientation"
    if convention.kind is None:
        undeclared(
            source,
            f"what the {count} orientation columns mean",
            "orientation.kind=euler",
            "quaternion, rotation-vector, ur or matrix; --set columns.orientation=null leaves them out",
        )
    if convention.kind == "quaternion" and convention.scalar is None:
        undeclared(source, f"{title}'s order of numbers", "orientation.scalar=first", "last")
    if convention.kind == "euler" and convention.axes is None:
        undeclared(source, f"{title}'s order of turns", "orientation.axes=xyz", "another order")
    if convention.kind == "euler" and convention.about is None:
        undeclared(source, f"{title}'s axes", "orientation.about=moving", "fixed")
    if convention.kind in ("euler", "rotation-vector") and import_map.units.angles is None:
        undeclared(source, f"{title}'s unit", "units.angles=deg", "rad")
    count_expected = {"quaternion": 4, "matrix": 9}.get(convention.kind or "", 3)
    if count != count_expected:
        raise MeasurementError(
            f"columns.orientation: expected {count_expected} columns for {convention.kind}, found {count}", file=source
        )


def undeclared(source: str, subject: str, example: str, choices: str) -> NoReturn:
    """Refuse what the map leaves open, with an example of how to say it."""
    raise MeasurementError(
        f"expected {subject} to be declared in the map (--set {example}; or {choices}), found nothing: "
        "it is not guessed",
        file=source,
        parameter=example.partition("=")[0],
    )
