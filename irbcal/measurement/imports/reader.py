"""Foreign measurement files, understood by a map, as the table that irbcal reads.

Units are those that the map declares; numbers that look like others are refused, never converted by guess.
"""

from __future__ import annotations

import fnmatch
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd

from irbcal.arrays import BoolArray, IntArray
from irbcal.errors import MeasurementError
from irbcal.measurement import table, text_files
from irbcal.measurement.column_names import (
    POSITION,
    QUATERNION,
    in_degrees,
    input_of,
    joint_columns,
    programmed_columns,
)
from irbcal.measurement.imports import tables
from irbcal.measurement.imports.column_map import Dialect, ImportMap, JointRules, JointsFileColumns, has_field
from irbcal.measurement.imports.source_file import (
    ALWAYS_LOST,
    ANGLE_DEG,
    LENGTH_MM,
    ROW,
    SOURCE,
    SourceFile,
    declared_units,
    joint_places,
    joint_values,
    undeclared,
)
from irbcal.measurement.input_table import InputTable
from irbcal.measurement.table import MeasurementSet
from irbcal.measurement.text_files import short
from irbcal.names import csv_bytes
from irbcal.overwriting import refuse_overwriting
from irbcal.safe_files import write_together
from irbcal.summary import Paragraph, Result, Table, TableValue, remarks, simulated_mark
from irbcal.units import DEG
from irbcal.wording import first_of

SAME_JOINTS = 1e-6
"""Joints that differ by no more are the same, degrees or mm."""


def pose_keys(frame: pd.DataFrame) -> pd.Series:
    """What tells the poses of all cycles and sessions apart, a text for each row."""
    keys = frame["pose"]
    for name in ("cycle", "session"):
        if name in frame.columns:
            keys = keys + "\n" + frame[name].astype(str)
    return keys


def runs(frame: pd.DataFrame) -> pd.Series:
    """Number poses from 1: neighbouring rows with the same joints, until a target comes again."""
    new = _new_joints(frame) | (frame[SOURCE] != frame[SOURCE].shift()).to_numpy()
    run = np.cumsum(new)
    again = frame.groupby([pd.Series(run), frame["target"]]).cumcount()
    return pd.Series(pd.factorize(pd.MultiIndex.from_arrays([run, again]))[0] + 1, index=frame.index)


def _new_joints(frame: pd.DataFrame) -> BoolArray:
    """Which rows have other joints than the row before."""
    q = frame[joint_columns(frame.columns)].to_numpy()
    return np.r_[True, np.abs(np.diff(q, axis=0)).max(axis=1) > SAME_JOINTS]


def together(frame: pd.DataFrame) -> pd.DataFrame:
    """Rows of a pose (and cycle) beside one another, poses in the order in which they first appear."""
    order = np.argsort(pd.factorize(pose_keys(frame))[0], kind="stable")
    return frame.iloc[order].reset_index(drop=True)


def joint_rules_applied(frame: pd.DataFrame, rules: JointRules) -> pd.DataFrame:
    """The same table, with readings as irbcal's joints."""
    columns = joint_columns(frame.columns)
    n = len(columns)
    for key, values in (("signs", rules.signs), ("offsets_deg", rules.offsets_deg)):
        if values is not None and len(values) != n:
            raise MeasurementError(
                f"the map: joints.{key}: expected {n} numbers, one for each joint, found {len(values)}"
            )
    if rules.signs is None and rules.offsets_deg is None and not rules.add:
        return frame
    matrix = np.eye(n)
    for to, source_joint in rules.add.items():
        if not (1 <= to <= n and 1 <= abs(source_joint) <= n and to != abs(source_joint)):
            raise MeasurementError(
                f"the map: joints.add: expected two different joints of 1 to {n}, found {to}: {source_joint}"
            )
        matrix[to - 1, abs(source_joint) - 1] = np.sign(source_joint)
    offsets = np.array(rules.offsets_deg if rules.offsets_deg is not None else np.zeros(n))
    sliding = [k for k, name in enumerate(columns) if name.endswith("_mm") and offsets[k]]
    if sliding:
        raise MeasurementError(f"the map: joints.offsets_deg: expected 0 for joint {sliding[0] + 1}, which slides")
    signs = np.array(rules.signs if rules.signs is not None else np.ones(n))
    for names in (columns, programmed_columns(frame.columns, frame[SOURCE].iloc[0])):
        if names:
            frame[names] = (frame[names].to_numpy() @ matrix.T) * signs + offsets
    return frame


def check_one_pose_one_joints(frame: pd.DataFrame) -> None:
    """Refuse a pose (of a cycle) whose rows have different joints."""
    index = pd.factorize(pose_keys(frame))[0]
    first = np.unique(index, return_index=True)[1][index]
    programmed = programmed_columns(frame.columns, frame[SOURCE].iloc[0])
    q = frame[joint_columns(frame.columns) + programmed].to_numpy()
    off = np.abs(q - q[first])
    if (off > SAME_JOINTS).any():
        k = int(np.flatnonzero((off > SAME_JOINTS).any(axis=1))[0])
        joint = int(off[k].argmax())
        row, first_row = frame.iloc[k], frame.iloc[first[k]]
        count = q.shape[1] - len(programmed)
        quantity, number = ("joints", joint + 1) if joint < count else ("programmed joints", joint + 1 - count)
        raise MeasurementError(
            f"expected the {quantity} of pose {short(row['pose'])} as in row {first_row[ROW]} of {first_row[SOURCE]} "
            f"(joint {number}: {q[first[k], joint]:.6g}), found {q[k, joint]:.6g}",
            file=row[SOURCE],
            row=int(row[ROW]),
        )


def name_groups(frame: pd.DataFrame, import_map: ImportMap) -> list[str]:
    """Name the groups of poses by the map's rules, in place; poses that no rule fits keep what they have.

    Returns
    -------
    list of str
        What the user should look at, in sentences.
    """
    notes: list[str] = []
    if not import_map.groups:
        return notes
    number, names = pd.factorize(frame["pose"])
    names = pd.Series(names, dtype=object)
    groups = np.full(len(names), "", dtype=object)
    open_ = np.ones(len(names), dtype=bool)
    for rule in import_map.groups:
        if rule.poses is not None:
            fits = names.str.fullmatch(fnmatch.translate(rule.poses)).to_numpy(dtype=bool)
        else:
            place = np.arange(1, len(names) + 1)
            fits = (place >= (rule.first or 1)) & (place <= (rule.last or len(names)))
        if not fits.any():
            notes.append(f"The rule for group {rule.group} fits no pose")
        groups[fits & open_] = rule.group
        open_ &= ~fits
    previous = (
        frame["group"].to_numpy(dtype=object) if "group" in frame.columns else np.full(len(frame), "", dtype=object)
    )
    frame["group"] = np.where(open_[number], previous, groups[number])
    return notes


MOST_RADIANS = 2.0 * np.pi + 1e-3
"""A file declared as degrees of which no joint is above this number is refused: its joints look like radians."""
MOST_TURNS = 8.0 * np.pi
"""A file declared as radians of which a joint is above this number is refused: its joints look like degrees."""
SMALLEST_REACH_MM, LARGEST_REACH_MM = 20.0, 200e3
"""No tracker measures a robot whose farthest point is nearer than the one or farther than the other."""
FEWEST_JUDGED = 3
"""Poses from which on joints and positions are judged by their size."""


def check_joint_sizes(frame: pd.DataFrame, source: str, units: str | Sequence[str], import_map: ImportMap) -> None:
    """Refuse joints (as read, in degrees and mm) whose size contradicts the declared units."""
    columns = joint_columns(frame.columns)
    units = [units] * len(columns) if isinstance(units, str) else list(units)
    programmed = programmed_columns(frame.columns, source)
    columns, units = columns + programmed, units * 2 if programmed else units
    if import_map.trust_units or len(frame[columns].drop_duplicates()) < FEWEST_JUDGED:
        return
    for unit, other_unit in (("deg", "rad"), ("rad", "deg")):
        columns_of_unit = [name for name, its in zip(columns, units, strict=True) if its == unit]
        if not columns_of_unit:
            continue
        size = frame[columns_of_unit].abs() / ANGLE_DEG[unit]
        largest = float(size.to_numpy().max())
        column = size.max().idxmax()
        if (unit == "deg" and 0.0 < largest <= MOST_RADIANS) or (unit == "rad" and largest > MOST_TURNS):
            row = frame[ROW].iloc[int(size[column].to_numpy().argmax())]
            raise MeasurementError(
                f"row {row}, joint {column.partition('_')[0][1:]}: expected joints in {unit} as declared, found "
                f"{largest:.4g} as the largest angle of all: these look like {other_unit} (units.joints: {other_unit}; "
                "trust_units: true takes them as they are)",
                file=source,
            )


def check_reach(frame: pd.DataFrame, import_map: ImportMap) -> None:
    """Refuse positions whose size contradicts the declared unit, and files in which every point is lost."""
    xyz = frame[POSITION].to_numpy()
    have = np.isfinite(xyz).all(axis=1)
    source = frame[SOURCE].iloc[0]
    if not have.any():
        raise MeasurementError(f"expected measured points, found only lost ones ({len(frame)} rows)", file=source)
    reach = np.where(have, np.linalg.norm(np.where(have[:, None], xyz, 0.0), axis=1), 0.0)
    k = int(reach.argmax())
    size = reach[k]
    if import_map.trust_units or (have.sum() < FEWEST_JUDGED and size < LARGEST_REACH_MM):
        return
    if not SMALLEST_REACH_MM <= size <= LARGEST_REACH_MM:
        unit = import_map.units.lengths or "mm"
        row = frame.iloc[k]
        wrong = "near" if size < SMALLEST_REACH_MM else "far"
        raise MeasurementError(
            f"expected positions in {unit} as declared, found the farthest of all points at "
            f"{size / LENGTH_MM[unit]:.4g} {unit}, too {wrong} for a tracker: the unit is another (units.lengths; "
            "trust_units: true takes it as it is)",
            file=row[SOURCE],
            row=int(row[ROW]),
        )


def strange(frame: pd.DataFrame) -> list[str]:
    """What the user should look at, in sentences."""
    out, columns = [], joint_columns(frame.columns)
    lost = frame["x_mm"].isna()
    for name, all_lost in lost.groupby(frame["target"]).all().items():
        if all_lost:
            out.append(f"Every point of target {name} is lost")
    key = pd.DataFrame({"pose": pose_keys(frame), "target": frame["target"]})
    again = key.duplicated()
    if again.any():
        row = frame.iloc[int(np.flatnonzero(again)[0])]
        out.append(
            f"{int(again.sum())} rows repeat a target of a pose, the first is {row['pose']}/{row['target']} "
            f"in row {row[ROW]} of {row[SOURCE]}"
        )
    q = frame[columns].to_numpy()
    still = [str(k) for k in range(1, len(columns) + 1) if np.ptp(q[:, k - 1]) <= SAME_JOINTS]
    if still and frame["pose"].nunique() >= FEWEST_JUDGED:
        out.append(f"Joint {', '.join(still)} never moves")
    return out


PREVIEW_ROWS = 5
"""Rows that are shown of a table: as many as fit beside one another."""
DRY_RUN_ROWS = 10
"""Rows that JSON has of what was not written."""
LONGEST_CELL = 24


class PointCount(NamedTuple):
    """Points of a target."""

    measured: int
    lost: int


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


@dataclass(frozen=True, eq=False, repr=False)
class Imported(ReadOnlyTables, Result):
    """What was understood.

    Attributes
    ----------
    table : DataFrame
        Columns of a measurement file: degrees and millimetres, NaN where a point was lost. Each access hands out a
        copy.
    origin : DataFrame
        ``source`` (file) and ``row`` (line in it) of each row of ``table``. Each access hands out a copy.
    map : ImportMap
    notes : tuple of str
    out : Path or None
        The file it was written to.
    columns : tuple of (str, str, str)
        Where the map was recognised: a column, what it holds, its unit and where that comes from.
    """

    table: pd.DataFrame
    origin: pd.DataFrame
    map: ImportMap
    notes: tuple[str, ...]
    out: Path | None = None
    columns: tuple[tuple[str, str, str], ...] = ()

    @property
    def lost(self) -> BoolArray:
        """Mask of the rows without a position."""
        return self.table["x_mm"].isna().to_numpy()

    @property
    def poses(self) -> int:
        """Number of poses."""
        return len(pose_keys(self.table).unique())

    @property
    def targets(self) -> dict[str, PointCount]:
        """Number of measured and of lost points of each target."""
        lost = pd.Series(self.lost).groupby(self.table["target"].to_numpy(), sort=True).agg(["size", "sum"])
        return {str(name): PointCount(int(row["size"] - row["sum"]), int(row["sum"])) for name, row in lost.iterrows()}

    @property
    def simulated(self) -> bool:
        """Whether a file says that it is simulated."""
        return "simulated" in self.table.columns and InputTable.read(self.table[["simulated"]]).simulated

    @property
    def groups(self) -> dict[str, int]:
        """Number of poses of each group, sorted by name."""
        if "group" not in self.table.columns:
            return {}
        counts = self.table.groupby("group")["pose"].nunique()
        return {str(name): int(count) for name, count in counts.items()}

    def csv(self) -> bytes:
        """The measurement file as bytes; it is read back and compared before it is handed out.

        Raises
        ------
        MeasurementError
            If irbcal itself would refuse it or read other numbers.
        """
        return self._written()[0]

    def measurements(self) -> MeasurementSet:
        """The measurements as irbcal reads them from the measurement file.

        Raises
        ------
        MeasurementError
            As `csv`.
        """
        return self._written()[1]

    def _written(self) -> tuple[bytes, MeasurementSet]:
        written, origin = self.table, self.origin
        data = csv_bytes(_rounded(written))
        source = str(origin["source"].iloc[0])
        try:
            reread = table.parse(data, source)
        except MeasurementError as error:
            k = -1 if error.row is None else error.row - 2
            if not 0 <= k < len(origin):
                raise
            first, row = origin.iloc[k]
            raise MeasurementError(error.message, file=first, row=int(row), column=error.column) from None
        names = [
            *reread.joint_columns,
            *reread.programmed_columns,
            *POSITION,
            *(name for name in QUATERNION if name in written.columns),
        ]
        equal = np.isclose(reread.table[names], written[names], rtol=0, atol=1e-6, equal_nan=True)
        if len(reread) != len(written) or not equal.all():
            raise MeasurementError("the measurement file would not hold the numbers that were understood", file=source)
        return data, reread

    def written_to(self, out: str | PathLike[str]) -> Imported:
        """Write the measurement file, and beside it the map where that was recognised; both whole or not at all.

        Returns
        -------
        Imported
            The same with ``out`` set.

        Raises
        ------
        MeasurementError
            As `csv`.
        CalibrationError
            If the file cannot be written.
        CalibrationError
            If it is one of the files that were read.
        """
        out = Path(out)
        refuse_overwriting({"out": out}, [text_files.file_of(source) for source in self.origin["source"].unique()])
        files = {out.name: self.csv()}
        if self.columns:
            files[map_beside(out).name] = f"# for irbcal import --as\n{self.map_text()}\n".encode()
        write_together(out.parent, files)
        return replace(self, out=out)

    def first_rows(self, count: int) -> list[dict[str, Any]]:
        """The first rows as they are understood, None for what is lost, with ``source`` and ``row``."""
        rows = self.table.head(count)
        values = rows.astype(object).where(rows.notna(), None).to_dict(orient="records")
        origins = self.origin.head(count).to_dict(orient="records")
        return [origin | row for origin, row in zip(origins, values, strict=True)]

    CONTENT = (
        "out rows=table.__len__ poses targets lost=lost.sum groups notes simulated map=map_in_use first_rows?=dry_rows"
    )
    COLUMNS = "*table"

    def map_in_use(self) -> dict[str, Any]:
        """What its map says beside what every map does."""
        return self.map.model_dump(exclude_defaults=True)

    def dry_rows(self) -> list[dict[str, Any]] | None:
        """The first rows of what was not written."""
        return None if self.out is not None else self.first_rows(DRY_RUN_ROWS)

    def report(self) -> Sequence[Paragraph]:
        """Counts and notes; what was not written yet is shown: its first rows and the map in use."""
        targets = ", ".join(
            f"{name} {count}" + (f" (and {lost} lost)" if lost else "") for name, (count, lost) in self.targets.items()
        )
        lines: list[Paragraph] = [
            f"{simulated_mark(self.simulated)}{len(self.table)} rows, {self.poses} poses, {int(self.lost.sum())} lost "
            f"points; points: {targets}",
            *remarks("Note", (f"{text}." for text in self.notes)),
        ]
        if self.columns:
            lines += [Table("What was understood", ("column", "holds", "unit"), self.columns), self._shown()]
        if self.out is not None:
            beside = f"; its map to {map_beside(self.out)}, for --as" if self.columns else ""
            return [*lines, f"Written to {self.out}{beside}"]
        return [*lines, *([] if self.columns else [self._shown()]), "The map in use:", self.map_text()]

    def _shown(self) -> Table:
        """The first rows, a column each, as a row has too many values for a page."""
        first = self.first_rows(PREVIEW_ROWS)
        rows: list[tuple[TableValue, ...]] = [
            (str(name), *(_cell(row[name]) for row in first)) for name in self.table.columns
        ]
        title = f"The first rows of {first[0]['source']} as they would be understood:"
        return Table(title, ("row of file", *(str(row["row"]) for row in first)), tuple(rows), digits=4)

    def map_text(self) -> str:
        """The map in use, in YAML."""
        import yaml

        values = self.map.model_dump(exclude_defaults=True, exclude={"about"})
        return str(yaml.safe_dump(values, sort_keys=False, default_flow_style=None, allow_unicode=True)).rstrip()


def map_beside(out: Path) -> Path:
    """Where the map of a measurement file is written."""
    return out.with_name(f"{out.stem}.map.yaml")


def _cell(value: Any) -> TableValue:
    if value is None or isinstance(value, float):
        return "" if value is None else float(value)
    text = str(value)
    return text if len(text) <= LONGEST_CELL else text[: LONGEST_CELL - 1] + "…"


def _rounded(frame: pd.DataFrame) -> pd.DataFrame:
    """The same with 1e-9 mm, degree or second as last place, and no minus zeros."""
    out = frame.copy()
    for name in out.columns:
        if pd.api.types.is_float_dtype(out[name]):
            out[name] = out[name].round(12 if name in QUATERNION else 9) + 0.0
    return out


_N = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_LIST = rf"\[\s*({_N}(?:\s*,\s*{_N}){{4,6}})\s*\]"


class _JointLiterals(NamedTuple):
    """Endings of a language's files, what a literal looks like, degrees of one of its units, and what is no literal."""

    endings: tuple[str, ...]
    literal: re.Pattern[str]
    unit: float
    ignored: str


JOINT_LITERALS = (
    _JointLiterals(
        (".mod", ".sys", ".prg", ".modx"),
        re.compile(rf"(?:jointtarget\s+(?P<name>\w+)(?:\{{\d+\}})?\s*:=\s*)?\[\s*{_LIST}\s*,\s*\[[^\]]*\]\s*\]", re.I),
        1.0,
        r"![^\n]*",
    ),
    _JointLiterals(
        (".src", ".dat", ".sub"),
        re.compile(
            rf"(?:(?:E6)?AXIS\s+(?P<name>\w+)\s*=\s*)?\{{[^{{}}]*?(A1\s+{_N}(?:\s*,\s*A[2-6]\s+{_N}){{5}})", re.I
        ),
        1.0,
        r";[^\n]*",
    ),
    _JointLiterals(
        (".ls",),
        re.compile(
            rf"(?:P\[\s*(?P<name>\d+)[^\]]*\]\s*\{{[^{{}}]*?)(J1\s*=\s*{_N}\s*deg(?:\s*,\s*J\d\s*=\s*{_N}\s*deg)+)",
            re.I,
        ),
        1.0,
        r"![^\n]*",
    ),
    _JointLiterals(
        (".script", ".urscript"),
        re.compile(rf"(?:(?P<name>\w+)\s*=\s*|(?<![p\w])){_LIST}"),
        1.0 / DEG,
        r"#[^\n]*|\b(?!move[jlp]\b|servoj\b)\w+\s*\([^()]*\)",  # six inertias or a start of a search are no target
    ),
)


def joints_of_program(path: str | PathLike[str]) -> pd.DataFrame | None:
    """Joints that stand as literals in a program, whose language its ending tells.

    Returns
    -------
    DataFrame or None
        ``q1_deg`` …, ``pose`` where all literals have names of their own, and their lines; None if it is no program, or
        has no joints in its text.
    """
    path = Path(path)
    language = next((language for language in JOINT_LITERALS if path.suffix.lower() in language.endings), None)
    if language is None or not path.is_file():
        return None
    text = path.read_bytes().decode("utf-8-sig", errors="replace")
    text = re.sub(language.ignored, lambda match: re.sub(r"[^\n]", " ", match[0]), text)
    rows, names, lines = [], [], []
    for literal in language.literal.finditer(text):
        listed = literal[literal.lastindex or 0]
        values = re.sub(r"[AJ]\d\s*=?", " ", listed, flags=re.I) if language.unit == 1.0 else listed
        rows.append([float(value) * language.unit for value in re.findall(_N, values)])
        names.append(literal["name"])
        lines.append(text.count("\n", 0, literal.start()) + 1)
    if not rows or len({len(row) for row in rows}) > 1:
        return None
    table = pd.DataFrame(np.array(rows), columns=[f"q{k}_deg" for k in range(1, len(rows[0]) + 1)])
    table[ROW] = lines
    if all(names) and len(set(names)) == len(names):
        table["pose"] = [f"P{name}" if name.isdigit() else name for name in names]
    return table


def join(
    frame: pd.DataFrame, joints: pd.DataFrame, path: str | PathLike[str], import_map: ImportMap
) -> tuple[pd.DataFrame, list[str]]:
    """Add the joints of a joints file, by the poses' names or by their order.

    Parameters
    ----------
    frame : DataFrame
        Points, as `Part.frame` returns them.
    joints : DataFrame
        As `read_joints` returns them.
    path : str or Path
        The joints file.
    import_map : ImportMap

    Returns
    -------
    frame : DataFrame
        With joint columns in degrees and mm.
    notes : list of str
        What the user should look at, in sentences.

    Raises
    ------
    MeasurementError
        If the joints file cannot be read or does not fit the points.
    """
    notes: list[str] = []
    if "target" in joints.columns:
        if "target" not in frame.columns:
            return _row_by_row(frame, joints, path), notes
        joints = _one_row_for_each_pose(joints)
    how: str = import_map.join or ("name" if import_map.names_poses and "pose" in joints.columns else "order")
    columns = joint_columns(joints.columns) + programmed_columns(joints.columns, str(path))
    columns += [name for name in joints.columns if says_of_poses(name) and name not in frame.columns]
    if how != "order":
        row = _places_by_name(frame, joints, path, how == "number")
    else:
        row, pose_names = pd.factorize(frame["pose"])
        _check_counts(frame, len(pose_names), len(joints), path, import_map)
    frame = frame.copy()
    frame[columns] = joints[columns].to_numpy()[row]
    if "group" in joints.columns and "group" not in frame.columns:
        frame["group"] = joints["group"].to_numpy()[row]
    if how == "order" and "pose" in joints.columns and not import_map.names_poses and joints["pose"].is_unique:
        frame["pose"] = joints["pose"].to_numpy()[row]
    unused = np.setdiff1d(np.arange(len(joints)), row)
    if len(unused):
        notes.append(
            f"{len(unused)} poses of {path} have no row in the measurements, the first in row {joints[ROW][unused[0]]}"
        )
    if how != "order":  # the joints file knows the order in which the robot visited them
        frame = frame.iloc[np.argsort(row, kind="stable")].reset_index(drop=True)
    return frame, notes


def _row_by_row(frame: pd.DataFrame, joints: pd.DataFrame, path: str | PathLike[str]) -> pd.DataFrame:
    """Points whose targets, poses and joints stand in the same rows of the joints file."""
    if len(frame) != len(joints):
        raise MeasurementError(
            f"expected {len(joints)} rows, as many as {path} has, which names their targets, found {len(frame)}",
            file=frame[SOURCE].iloc[0],
        )
    frame = frame.copy()
    kept = {name for name in frame.columns if name == "group" or says_of_poses(name)}
    columns_new = [name for name in joints.columns if name not in {ROW, *kept}]
    frame[columns_new] = joints[columns_new].to_numpy()
    frame = frame.astype({name: float for name in joints.columns if name.endswith(("_deg", "_mm"))})
    if "pose" not in joints.columns:
        frame["pose"] = np.cumsum(_new_joints(joints)).astype(str)
    return frame


def _one_row_for_each_pose(joints: pd.DataFrame) -> pd.DataFrame:
    """A joints file with a row for each point as one with a row for each pose."""
    first = ~joints["pose"].duplicated().to_numpy() if "pose" in joints.columns else _new_joints(joints)
    return joints[first].drop(columns="target").reset_index(drop=True)


def _last_numbers(names: pd.Series) -> pd.Series:
    """The last number in each name, as text without leading zeros; the name where it has none."""
    numbers = names.str.extract(r"(\d+)\D*$")[0].str.lstrip("0")
    return numbers.where(numbers != "", "0").fillna(names)


def _places_by_name(
    frame: pd.DataFrame, joints: pd.DataFrame, path: str | PathLike[str], by_number: bool = False
) -> IntArray:
    """Row of the joints file for each point, by the poses' names or the last numbers in them."""
    if "pose" not in joints.columns:
        raise MeasurementError(
            "expected a column pose to join by name, found none; --set join=order joins by order", file=path, row=1
        )
    keys = _last_numbers(joints["pose"]) if by_number else joints["pose"]
    double = keys.duplicated()
    if double.any():
        k = int(np.flatnonzero(double)[0])
        raise MeasurementError(
            f"expected each pose once, found {joints['pose'][k]!r} again",
            file=path,
            row=int(joints[ROW][k]),
            column="pose",
        )
    row_of_pose = np.asarray(pd.Index(keys).get_indexer(_last_numbers(frame["pose"]) if by_number else frame["pose"]))
    if (row_of_pose < 0).any():
        row = frame.iloc[int(np.flatnonzero(row_of_pose < 0)[0])]
        raise MeasurementError(
            f"expected a pose of {path} ({short(str(joints['pose'][0]))} …), found {short(row['pose'])!r}; "
            "--set join=order joins by order",
            file=row[SOURCE],
            row=int(row[ROW]),
        )
    return row_of_pose


def _check_counts(frame: pd.DataFrame, poses: int, rows: int, path: str | PathLike[str], import_map: ImportMap) -> None:
    """Joining by order needs as many poses as rows of joints, in every file that counts its own."""
    if not import_map.names_poses and has_field(import_map.file_name or "", "target"):
        counts = frame.groupby("target", sort=False)["pose"].nunique()
        wrong = counts[counts != rows]
        if len(wrong):
            source = frame[SOURCE][frame["target"] == wrong.index[0]].iloc[0]
            raise MeasurementError(
                f"expected {rows} rows, as many as {path} has, found {wrong.iloc[0]}: the order does not tell which is "
                "missing or too much; join by name",
                file=source,
            )
    if poses != rows:
        raise MeasurementError(
            f"expected {rows} poses, as many as {path} has rows, found {poses}; joining by order needs as many",
            file=frame[SOURCE].iloc[0],
        )


def read_joints(path: str | PathLike[str], import_map: ImportMap) -> pd.DataFrame:
    """A joints file, DataFrame of joints and, where it has them, pose, group and target.

    Parameters
    ----------
    path : str or Path
        A table, or a program, see `joints_of_program`.
    import_map : ImportMap

    Raises
    ------
    MeasurementError
        If it is neither.
    """
    layout = import_map.joints_file
    program = joints_of_program(path) if layout is None else None
    if program is not None:
        check_joint_sizes(program, str(path), "deg", import_map)
        return program
    text = tables.read(path, Dialect(decimal="auto") if layout is None else layout.file)
    columns, units = _by_header(text) if layout is None else (layout.columns, layout.units.joints)
    joints, programmed = joint_places(text, columns.joints, columns.programmed)
    of_poses = {k: name for k, name in enumerate(text.names or ()) if says_of_poses(name)}
    text = text.with_decimal([*joints, *programmed, *of_poses])
    frame = pd.DataFrame(joint_values(text, joints, programmed, units))
    frame[ROW] = text.lines
    for k, name in of_poses.items():
        frame[name] = text.numbers(k, "a number or nothing", text.is_one_of(k, ALWAYS_LOST))
    for key in ("pose", "group", "target"):
        column = getattr(columns, key)
        if column is not None:
            frame[key] = text.text(text.find(column, f"the {key}")).to_numpy()
    check_joint_sizes(frame, str(path), units, import_map)
    return frame


def says_of_poses(name: str) -> bool:
    """Whether a joints file's column of this name is taken with the joints: loads, other inputs, commanded poses."""
    return name in (*table.GOALS, "time_s") or input_of(name) is not None


def _by_header(text: tables.TextTable) -> tuple[JointsFileColumns, list[str]]:
    """Columns and units of a joints file in irbcal's own format."""
    header = text.names or ()
    as_written = {in_degrees(name): name for name in header}
    joints = [as_written[name] for name in joint_columns(as_written)]
    if not joints:
        raise text.header_fault(
            "expected the columns q1_deg, q2_deg … (q1_mm of a rail; optional pose, group, target), or joints_file "
            f"in the map, found {first_of([*map(short, header)], 40)}"
        )
    programmed = [as_written[name] for name in programmed_columns(as_written, text.source)]
    pose, group, target = (name if name in header else None for name in ("pose", "group", "target"))
    columns = JointsFileColumns.model_construct(
        joints=[*joints], programmed=[*programmed], pose=pose, group=group, target=target
    )
    return columns, [name.rpartition("_")[2] for name in joints]


def understand(
    sources: Sequence[str | PathLike[str]], import_map: ImportMap, joints: str | PathLike[str] | None = None
) -> Imported:
    """Understand foreign files by a map.

    Parameters
    ----------
    sources : sequence of str or Path
        Files of one kind.
    import_map : ImportMap
    joints : str or Path, optional
        Joints file for sources that hold points only: in irbcal's own format (``q1_deg`` …, optional ``c1_deg`` …,
        ``pose`` and ``group``), unless ``joints_file`` of the map says otherwise.

    Raises
    ------
    MeasurementError
        If a file does not fit the map; the sentence names file, row, column, what was expected and what was found.
    """
    joints_read = None if joints is None else read_joints(joints, import_map)
    elsewhere = joints_read is not None and "target" in joints_read.columns
    _check_declared(import_map, joints is not None, str(sources[0]), elsewhere)
    frames: list[pd.DataFrame] = []
    counted: Counter[str | None] = Counter()
    simulated = False
    for path in sources:
        source_file = SourceFile(tables.read(path, import_map.file, import_map.lost.texts), import_map, elsewhere)
        target = source_file.file_fields.get("target")  # logs of one target each count the same poses
        frames.append(source_file.frame(counted[target]))
        counted[target] += len(source_file.table.cells)
        simulated |= source_file.table.simulated
    frame = pd.concat(frames, ignore_index=True)
    if simulated:
        frame["simulated"] = "yes"
    if import_map.pose_by == "target" and not import_map.names_poses:
        frame["pose"] = _counted_by_target(frame)
    for name in ("group", "cycle", "session"):
        if name in frame.columns:
            frame[name] = frame[name].fillna("")
    notes: list[str] = []
    if joints is not None and joints_read is not None:
        frame, notes = join(frame, joints_read, joints, import_map)
    else:
        if import_map.pose_by == "joints" and not import_map.names_poses:
            frame["pose"] = runs(frame).astype(str)
        check_joint_sizes(frame, frame[SOURCE].iloc[0], import_map.units.joints or "deg", import_map)
    joint_rules_applied(frame, import_map.joints)
    frame = together(frame)
    check_one_pose_one_joints(frame)
    unknown = [name for name in import_map.rename if name not in set(frame["target"])]
    if unknown:
        notes.append(f"There is no target {', '.join(unknown)} to rename")
    frame["target"] = frame["target"].replace(import_map.rename)
    notes += name_groups(frame, import_map)
    check_reach(frame, import_map)
    notes += strange(frame)
    programmed = programmed_columns(frame.columns, str(sources[0]))
    order = ["pose", *joint_columns(frame.columns), *programmed, "target", *POSITION]
    others = ("group", "cycle", "session", "u95_mm", *QUATERNION, "time_s", "payload_kg")
    order += [name for name in others if name in frame.columns]
    order += [name for name in frame.columns if name not in (*order, SOURCE, ROW)]
    origin = frame[[SOURCE, ROW]].rename(columns=str.strip)
    return Imported(frame[order], origin, import_map, tuple(notes))


def _counted_by_target(frame: pd.DataFrame) -> pd.Series:
    """Number of the pose of each row, from 1: the rows of each target are one pose after the other."""
    counts = frame["target"].value_counts(sort=False)
    if counts.nunique() > 1:
        least = str(counts.idxmin())
        raise MeasurementError(
            f"expected as many rows of each target, as they are counted (pose_by: target), found {counts.min()} of "
            f"{short(least)} and {counts.max()} of {short(str(counts.idxmax()))}",
            file=frame[SOURCE].iloc[0],
        )
    return (frame.groupby("target").cumcount() + 1).astype(str)


def _check_declared(import_map: ImportMap, with_joints_file: bool, source: str, targets_elsewhere: bool) -> None:
    """Refuse a map that leaves open what must be declared."""
    declared_units(import_map, source)
    columns = import_map.columns
    has_target = (
        targets_elsewhere
        or columns.target is not None
        or import_map.fixed.target
        or isinstance(columns.position, dict)
        or any(has_field(text, "target") for text in (*import_map.names, import_map.file_name or ""))
    )
    if not has_target:
        undeclared(source, "the target", "fixed.target=smr1", "another name, or columns.target")
    if columns.joints and with_joints_file:
        raise MeasurementError(
            "expected joints from one place, found columns.joints in the map and a joints file; leave one out "
            "(--set columns.joints=null)",
            file=source,
        )
    if not columns.joints and not with_joints_file:
        raise MeasurementError(
            "this map finds points only: expected a joints file (--joints JOINTS.csv) or columns.joints in the map, "
            "found neither",
            file=source,
            parameter="joints",
        )
