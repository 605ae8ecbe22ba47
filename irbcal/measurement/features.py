"""Measurements at features: balls, sockets, planes, lines and known distances instead of a tracker's points.

A file of rows says at which joints the tool was at which feature, and a second small file (CSV or YAML) what is known
of the features::

    pose,q1_deg,...,q6_deg,feature[,target,kind,value_mm,value_deg,u95_mm,u95_deg,x_mm,y_mm,z_mm,qw,qx,qy,qz,...]
    feature,kind[,target,first,second,length_mm,angle_deg,radius_mm,offset_mm,x_mm,y_mm,z_mm,u95_mm,u95_deg]

Corners of a board in images have more columns, see `irbcal.measurement.imaging`.

What a row does not say, its feature does. A feature of kind ``distance`` is the known length between the features
``first`` and ``second``, one of kind ``angle-between`` the known angle. Names in the second file may be made of columns
of the first in braces: ``{place}/{socket}`` is one feature for each place and socket, and where the rows have no column
``feature`` it names theirs. Rows that a tracker measured have a position and no feature. Joints are ``q1_deg``
(``q1_rad``; ``q1_mm`` or ``q1_m`` where one slides) or, where there are programmed joints, ``c1_deg`` … What was
carried is told as in a tracker's file: ``payload_kg`` and optionally ``payload_x_mm`` …
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from irbcal.arrays import BoolArray, FloatArray, IntArray, Locked, NameArray
from irbcal.errors import MeasurementError
from irbcal.measurement import board_formats, imaging, lens_formats
from irbcal.measurement.column_names import POSITION, check_header, joint_units
from irbcal.measurement.imaging import Imaging
from irbcal.measurement.input_table import InputTable, TableLike, TextRow
from irbcal.measurement.table import MeasurementSet
from irbcal.measurement.table_columns import ColumnArrays
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms import inputs
from irbcal.modeling.terms.situation import Motion, at_rows
from irbcal.summary import Paragraph, Result
from irbcal.units import DEG, MM, UNIT_OUTSIDE

TARGET = "ball"
"""What the tool's point is called unless a target is named."""

DISTANCE = "distance"
"""The kind of known lengths between two features."""

ANGLE_BETWEEN = "angle-between"
"""The kind of known angles between two features."""

RELATIONS = {DISTANCE: "length_mm", ANGLE_BETWEEN: "angle_deg"}
"""Kinds of what is known between two features, with the column of its value."""

ANGLE = "angle"
"""The kind of rows whose value is an angle; those of all others are lengths."""

TEXT_COLUMNS = ("feature", "kind", "target", "first", "second", *imaging.TEXT_COLUMNS)
NUMBER_COLUMNS = (*RELATIONS.values(), "radius_mm", "offset_mm", "x_mm", "y_mm", "z_mm", "u95_mm", "u95_deg")
SMALLEST_ANGLE = 1.0 * DEG
"""Between two features, radians: below it follows no small turn, but the size of one."""

BRACES = re.compile(r"\{([^{}]+)\}")


@dataclass(frozen=True, eq=False)
class Feature(Locked):
    """A feature with what is known of it."""

    name: str
    kind: str
    target: str = TARGET
    radius: float | None = None
    offset: float | None = None
    """Metres."""
    centre: FloatArray | None = None
    """Shape (3,). In the measuring frame, metres."""
    u95: float | None = None
    """Of its rows, metres; of angles radians."""
    imaging: Imaging | None = None
    """Camera and board, of images."""
    axes: FloatArray | None = None
    """Shape (3, 3). Of a plane (the third is its normal) or a line through ``centre`` (along the third) that is known.
    """

    @property
    def view(self) -> Imaging:
        """Camera and board of a feature of images."""
        assert self.imaging is not None
        return self.imaging


@dataclass(frozen=True)
class Relation:
    """What is known between two features, such as the distance of their centres."""

    name: str
    kind: str
    """One of `RELATIONS`."""
    first: str
    second: str
    value: float
    u95: float | None = None
    """Metres or radians; None where the file does not say how well it is known."""

    @property
    def quantity(self) -> tuple[str, str, float]:
        """What is known, the unit of that in files, and what one is in SI units: ``("length", "mm", 0.001)``."""
        noun, _, unit = RELATIONS[self.kind].rpartition("_")
        return noun, unit, dict(UNIT_OUTSIDE.values())[unit]


def given_rows(features: TableLike, static: bool | None = None) -> list[TextRow]:
    """The features' file as rows of text.

    Parameters
    ----------
    features : str, Path or DataFrame
        Or the file of another program's board (`irbcal.measurement.board_formats`).
    static : bool, optional
        Whether its camera stands in the hall, where the file does not say that.
    """
    if isinstance(features, (str, PathLike)) and Path(features).suffix in (".yaml", ".yml"):
        source = str(features)
        content = board_formats.yaml_of(Path(features))
        if board_formats.is_board(content):
            row = board_formats.board(content, source)
            static = content.get(board_formats.STATIC, static)
            if static is None:
                raise MeasurementError(
                    "a board alone does not say where the camera is: name this file in the column board of a feature "
                    "of kind image-on-tool (camera on the arm) or image (camera in the hall)",
                    file=source,
                )
            content = [board_formats.feature(row, bool(static))]
        if not isinstance(content, list) or not all(isinstance(row, dict) for row in content):
            raise MeasurementError("expected a list of features, each with feature and kind", file=source)
        table = pd.DataFrame([{k: "" if v is None else str(v) for k, v in row.items()} for row in content]).fillna("")
        return _rows_of(InputTable(table, source))
    return _rows_of(InputTable.read(features, ["feature", "kind"]))


def _with_files(rows: list[TextRow]) -> list[TextRow]:
    """Rows whose ``lens`` or ``board`` is a file of another program, beside the features' file, with what that says."""
    for row in rows:
        if row.get(imaging.BOARD_FILE):
            path = Path(row.source).parent / row[imaging.BOARD_FILE]
            if path.suffix.lower() == ".csv":  # markers on a body: pictures give places of their corners
                row[imaging.BOARD_FILE] = str(path)
            else:
                cells = board_formats.board(board_formats.yaml_of(path), str(path))
                row |= {name: value for name, value in cells.items() if not row.get(name)}
        if not row.get(imaging.LENS_FILE):
            continue
        path = Path(row.source).parent / row[imaging.LENS_FILE]
        cameras = lens_formats.read(path)
        camera = imaging.camera_and_board(row)[0] if row["kind"] in imaging.CAMERA_KINDS else ""
        if camera not in cameras and len(cameras) > 1:
            raise row.fault(f"{path.name} has no camera {camera}, but {', '.join(cameras)}", imaging.LENS_FILE)
        columns = imaging.lens_columns(*(cameras.get(camera) or next(iter(cameras.values()))))
        row |= {name: text for name, text in columns.items() if not row.get(name)}
    return rows


def _rows_of(table: InputTable) -> list[TextRow]:
    columns = (*TEXT_COLUMNS, *NUMBER_COLUMNS, *imaging.NUMBER_COLUMNS)
    check_header(table.names, ["feature", "kind"], table.source, columns)
    cells = table.cells
    for name in table.names:
        if name in TEXT_COLUMNS:
            table.texts(name)
        else:
            cells = cells.assign(**{name: cells[name].mask(np.isnan(table.numbers(name, lost=True)), "")})
    rows = [
        TextRow({str(k): str(v).strip() for k, v in record.items()}, table.source, int(row))
        for row, record in zip(table.rows, cells.to_dict("records"), strict=True)
    ]
    return _with_files(rows)


def filled(pattern: str, table: InputTable, row: TextRow) -> NameArray:
    """A name for each row of the measurements, from a pattern with columns in braces."""
    out = np.full(len(table), pattern, dtype=object)
    for column in dict.fromkeys(BRACES.findall(pattern)):
        if column not in table:
            raise row.fault(
                f"{pattern} asks for the column {column}, which {table.source} does not have: it has {table.listed}",
                "feature",
            )
        values = table.filled(column)
        out = np.array([a.replace(f"{{{column}}}", str(b)) for a, b in zip(out, values, strict=True)], dtype=object)
    return InputTable(pd.DataFrame({"feature": out}, index=table.cells.index), table.source).texts("feature")


def known_features(
    rows: list[TextRow], table: InputTable, names: NameArray
) -> tuple[dict[str, Feature], tuple[Relation, ...]]:
    """Features and what is known between them, with all names filled in."""
    by_name: dict[str, Feature] = {}
    relations: dict[str, Relation] = {}
    measured = set(names)
    imaging.shared(rows)
    for row in rows:
        value = {
            name: float(row[name]) * (DEG if name.endswith("_deg") else MM) if row.get(name) else None
            for name in NUMBER_COLUMNS
        }
        if not row["feature"] or not row["kind"]:
            raise row.fault("expected a feature and its kind")
        labels = filled(row["feature"], table, row) if BRACES.search(row["feature"]) else [row["feature"]]
        ends = [filled(row.get(name, ""), table, row) for name in ("first", "second")]
        u95, other = _units(row["kind"], "u95")
        if value[u95] is None and value[other] is not None:
            raise row.fault(f"a feature of kind {row['kind']} takes {u95}, found {other}", other)
        if row["kind"] in RELATIONS:
            size = value[RELATIONS[row["kind"]]]
            if size is None or size <= 0.0 or not row.get("first") or not row.get("second"):
                raise row.fault(f"a feature of kind {row['kind']} needs first, second and {RELATIONS[row['kind']]}")
            if row["kind"] == ANGLE_BETWEEN and not SMALLEST_ANGLE <= size <= np.pi - SMALLEST_ANGLE:
                raise row.fault("expected an angle from 1 to 179 degrees: nearly parallel ones show none", "angle_deg")
            triples = set(zip(labels if len(labels) > 1 else labels * len(table), *ends, strict=True))
            present = sorted(triple for triple in triples if triple[1] in measured and triple[2] in measured)
            if not present and not any(BRACES.search(row[key]) for key in ("first", "second")):
                lost = row["first"] if row["first"] not in measured else row["second"]
                raise row.fault(f"no row is at {lost}, between which and another {row['feature']} is known")
            for label, first, second in present:
                relations[label] = Relation(label, row["kind"], first, second, size, value[u95])
            continue
        if (value["radius_mm"] or 0.0) < 0.0:
            raise row.fault("expected a radius from 0 on")
        xyz = [value[f"{axis}_mm"] for axis in "xyz"]
        if any(x is None for x in xyz) and any(x is not None for x in xyz):
            raise row.fault("expected x_mm, y_mm and z_mm, all or none")
        centre = None if xyz[0] is None else np.array(xyz, dtype=float)
        for label in dict.fromkeys(labels):
            by_name[label] = Feature(
                label,
                row["kind"],
                row.get("target") or TARGET,
                value["radius_mm"],
                value["offset_mm"],
                centre,
                value[u95],
                imaging.imaging_of(row) if row["kind"] in imaging.CAMERA_KINDS else None,
            )
    return by_name, tuple(relations.values())


POINT = "point"
"""The kind of rows with a measured position and no feature."""


OF_ROWS = (
    *("q", "pose", "pose_index", "target", "kind", "feature", "value", "u95", "xyz", "rotation", "row", "cells"),
    *("corners", "frame", "carrier", "point", "flange"),
)
"""Attributes of `FeatureSet` with an entry for each row; some may be None."""


@dataclass(frozen=True, eq=False, repr=False)
class FeatureSet(Result):
    """Measurements at features, row by row."""

    q: FloatArray
    """Shape (m, joints). Of the arm, radians (metres)."""
    pose: NameArray
    """Shape (m,)."""
    pose_index: IntArray
    """Shape (m,)."""
    target: NameArray
    kind: NameArray
    feature: NameArray
    """Shape (m,). The feature of a tracker's row is empty."""
    value: FloatArray
    u95: FloatArray
    """Shape (m,). Metres (radians where the value is an angle); NaN where there is none."""
    xyz: FloatArray
    """Shape (m, 3). Metres; likewise."""
    rotation: FloatArray
    """Shape (m, 3, 3). Measured orientation; likewise."""
    row: IntArray
    """Shape (m,). In the file, for messages."""
    cells: pd.DataFrame
    """The rows as text, for columns that name places."""
    features: Mapping[str, Feature]
    relations: tuple[Relation, ...]
    joint_columns: tuple[str, ...]
    """Of the arm, in the order of its joints."""
    source: str
    sha256: str
    simulated: bool = False
    programmed: bool = False
    feature_column: str = ""
    """How columns name the feature of a row, as ``{place}/{socket}``; empty where none do."""
    corners: FloatArray | None = None
    """Shape (m, n, 5 or 6). Of images, see `irbcal.measurement.imaging.Images`: a row is a whole image."""
    inputs: Mapping[str, FloatArray] = field(default_factory=dict)
    """Shape (m,) or (m, values). What else the error model's terms are functions of, such as ``payload_kg``: see
    `irbcal.modeling.terms.inputs`."""
    frame: NameArray | None = None
    carrier: NameArray | None = None
    """Shape (m,). Frames of the cell (`irbcal.modeling.cell_graph`): in which the feature is known, and whose point is
    looked at. Empty, and None: the measuring frame for what is known in it, else the robot base; the flange."""
    point: FloatArray | None = None
    """Shape (m, 3). The point that is looked at, in a carrier that is neither flange nor base, metres; its origin
    unless given."""
    flange: FloatArray | None = None
    """Shape (m, 4, 4). The flange in the robot base, metres, where it is measured and joints do not matter."""
    outside: int = 0
    """Corners that were left out because they are beyond their image."""

    def __len__(self) -> int:
        return len(self.q)

    @property
    def poses(self) -> int:
        """Number of poses."""
        return len(np.unique(self.pose_index))

    @classmethod
    def computed(
        cls,
        arm: Arm,
        q: FloatArray,
        pose: NameArray,
        kind: Sequence[str],
        feature: Sequence[str],
        target: Sequence[str],
        u95: FloatArray,
        features: Mapping[str, Feature],
        source: str,
        **more: Any,
    ) -> FeatureSet:
        """Rows that no table of features has; ``more`` are other attributes, else empty, each row a pose."""
        m = len(q)
        empty: dict[str, Any] = {"pose_index": np.arange(m), "row": np.arange(m), "xyz": np.full((m, 3), np.nan)}
        return cls(
            q=q,
            pose=pose,
            kind=np.array([*kind], dtype=object),
            feature=np.array([*feature], dtype=object),
            target=np.array([*target], dtype=object),
            value=np.full(m, np.nan),
            u95=u95,
            rotation=np.full((m, 3, 3), np.nan),
            cells=pd.DataFrame(index=range(m)),
            features=features,
            relations=(),
            joint_columns=tuple(arm.joint_columns),
            source=source,
            sha256="",
            **(empty | more),
        )

    def select(self, rows: BoolArray) -> FeatureSet:
        """Some rows, with the features seen in them and what is known between these."""
        names = set(self.feature[rows])
        chosen: dict[str, Any] = {
            name: None if (values := getattr(self, name)) is None else values[rows] for name in OF_ROWS
        }
        return replace(
            self,
            **chosen,
            inputs=at_rows(self.inputs, rows),
            features={name: feature for name, feature in self.features.items() if name in names},
            relations=tuple(each for each in self.relations if each.first in names and each.second in names),
        )

    def motion(self) -> Motion:
        """Joints and load of each row; with the last move and the order of its pose where joints are a program's."""
        if not self.programmed:
            return Motion(self.q, inputs=self.inputs)
        index, first, pose = np.unique(self.pose_index, return_index=True, return_inverse=True)
        in_order = Motion.in_order(self.q[first])
        assert in_order.move is not None
        move = np.where((np.diff(index, prepend=index[0]) == 1)[:, None], in_order.move, 0.0)
        return Motion(self.q, move[pose], index[pose].astype(float), self.inputs)

    def as_measurements(self) -> MeasurementSet:
        """The rows as a table of measurements without places, with the joints that models take."""
        table = pd.DataFrame({"row": self.row, "pose": self.pose, "target": self.target})
        table[list(self.joint_columns)] = self.q / joint_units(self.joint_columns)
        for name in POSITION:
            table[name] = np.nan
        table["pose_index"] = np.unique(self.pose_index, return_inverse=True)[1]
        for name, values in self.inputs.items():
            for column, numbers in inputs()[name].to_columns(values).items():
                table[column] = numbers
        if self.simulated:
            table["simulated"] = "yes"
        return MeasurementSet(ColumnArrays.of_frame(table), self.source, self.sha256)

    def kinds(self) -> dict[str, int]:
        """Number of rows of each kind."""
        names, counts = np.unique(self.kind.astype(str), return_counts=True)
        return {str(name): int(count) for name, count in zip(names, counts, strict=True)}

    def left_out_together(self, column: str | None = None, related: bool = True) -> NameArray:
        """What is held out together, for each row: a column's values, or features that relations or poses tie together.

        Where relations tie all features, each is by itself: those to the others then prove it, too.

        Raises
        ------
        MeasurementError
            If there is no such column, or it divides the rows of one feature.
        """
        if column is not None:
            table = InputTable(self.cells, self.source)
            if column not in table:
                raise table.header_fault(
                    f"there is no column {column} to leave out by; found {table.listed}", "leave_out"
                )
            return table.filled(column)
        parent = {name: name for name in self.features}

        def root(name: str) -> str:
            while parent[name] != name:
                name = parent[name]
            return name

        for relation in self.relations if related else ():
            parent[root(relation.second)] = root(relation.first)
        first: dict[int, str] = {}
        for number, name in zip(self.pose_index.tolist(), self.feature, strict=True):
            if name:
                parent[root(name)] = root(first.setdefault(number, name))
        tied = {name: root(name) for name in parent}
        if related and self.relations and len(set(tied.values())) == 1:
            return self.left_out_together(related=False)
        # a tracker's poses stand for themselves, unless they are at a feature, too
        return np.array(
            [
                tied[name] if name else tied[first[k]] if k in first else "tracker"
                for name, k in zip(self.feature, self.pose_index.tolist(), strict=True)
            ],
            dtype=object,
        )

    def report(self) -> Sequence[Paragraph]:
        """How many rows of which kinds at how many features."""
        rows = ", ".join(f"{count} of kind {kind}" for kind, count in self.kinds().items())
        nouns = [relation.quantity[0] for relation in self.relations]
        relations = "".join(f", {nouns.count(noun)} known {noun}s" for noun in dict.fromkeys(nouns))
        if self.corners is not None:
            rows += f", {int(np.isfinite(self.corners[:, :, 2]).sum())} corners in all"
            rows += f", {self.outside} beyond their image left out" if self.outside else ""
        prefix = "SIMULATED " if self.simulated else ""
        return [f"{prefix}{len(self)} rows in {self.poses} poses ({rows}) at {len(self.features)} features{relations}"]


def read(rows: TableLike, features: TableLike | None, arm: Arm) -> FeatureSet:
    """Read rows and features.

    Parameters
    ----------
    rows : str, Path or DataFrame
    features : str, Path or DataFrame, optional
        CSV or YAML (a list of mappings with the same names); none where every row says its kind.
    arm : Arm

    Raises
    ------
    MeasurementError
        If a file does not keep the format, or a row's feature is not known.
    """
    table = InputTable.read(rows, ["pose"])
    cells, source = table.cells, table.source
    feature_rows = [] if features is None else given_rows(features)
    name_of = "<features>" if not isinstance(features, (str, PathLike)) else str(features)
    names, name_pattern = _names(table, feature_rows)
    by_name, relations = known_features(feature_rows, table, names)
    kind, target = table.texts("kind"), table.texts("target")
    for k, name in enumerate(names):
        feature = by_name.get(name)
        if name and feature is None and not kind[k]:
            sentence = (
                f"nothing is known of the feature {name}: name it with its kind in {name_of}, or give the row a kind"
            )
            raise table.fault(sentence, k, "feature")
        kind[k] = kind[k] or (POINT if feature is None else feature.kind)
        target[k] = target[k] or (TARGET if feature is None else feature.target)
        if name and feature is None:
            by_name[name] = Feature(name, kind[k], target[k])
    q, programmed = _joints(table, arm)
    u95 = _in_unit_of_kind(table, "u95", kind)
    stated_u95 = np.array([np.nan if not n or by_name[n].u95 is None else by_name[n].u95 for n in names], dtype=float)
    pose = table.filled("pose")
    rotations = table.rotations(lost=True)
    features_read = FeatureSet(
        q,
        pose,
        _poses(cells, pose),
        target,
        kind,
        names,
        _in_unit_of_kind(table, "value", kind),
        np.where(np.isfinite(u95), u95, stated_u95),
        np.column_stack([table.optional(name) for name in POSITION]),
        np.full((len(table), 3, 3), np.nan) if rotations is None else rotations,
        np.asarray(table.rows, dtype=int),
        cells,
        {name: feature for name, feature in by_name.items() if name in set(names)},
        relations,
        tuple(arm.joint_columns),
        source,
        table.sha256,
        table.simulated,
        programmed,
        name_pattern,
    )
    return _with_images(replace(features_read, inputs=table.inputs(q.shape[1])), by_name)


def _with_images(rows: FeatureSet, features: Mapping[str, Feature]) -> FeatureSet:
    """Rows that are corners, gathered to images."""
    table = InputTable(rows.cells, rows.source)
    number, u, v, u95 = (table.optional(name) for name in ("corner", "u_px", "v_px", "u95_px"))
    keys = [rows.pose_index.astype(str), rows.feature, rows.target]
    image = pd.factorize(pd.Series([" | ".join(map(str, key)) for key in zip(*keys, strict=True)]))[0]
    corners = imaging.Corners(image, rows.kind, rows.feature, rows.target, number, u, v, u95, rows.xyz, rows.row)
    views = {name: feature.imaging for name, feature in features.items()}
    images = imaging.gathered(corners, views, {name: feature.target for name, feature in features.items()}, rows.source)
    if images is None:
        return rows
    selected = rows.select(images.keep)
    is_image = np.isfinite(images.corners[:, 0, 2])
    at_board = imaging.u95_of(images.corners)
    for k in np.flatnonzero(np.isin(selected.kind.astype(str), list(imaging.POINTS))):
        view = views[str(selected.feature[k])]
        assert view is not None
        at_board[k] = images.corners[k, 0, 4] / view.lens[0]  # a metre away
    return replace(
        selected,
        corners=images.corners,
        outside=images.outside,
        u95=np.where(is_image, at_board, selected.u95),
        xyz=np.where(is_image[:, None], np.nan, selected.xyz),
    )


def _names(table: InputTable, feature_rows: list[TextRow]) -> tuple[NameArray, str]:
    """Feature of each row, and how columns name it."""
    if "feature" in table:
        return table.texts("feature"), ""
    patterns = [row for row in feature_rows if BRACES.search(row["feature"]) and row["kind"] not in RELATIONS]
    if len(patterns) == 1:
        return filled(patterns[0]["feature"], table, patterns[0]), patterns[0]["feature"]
    if not feature_rows and all(name in table for name in POSITION):
        return table.texts("feature"), ""
    raise table.header_fault(
        "missing column feature: expected the name of the feature that each row is at, or one name made of columns, "
        "such as {place}/{socket}, among the features"
    )


def _in_unit_of_kind(table: InputTable, name: str, kind: NameArray) -> FloatArray:
    """A quantity of each row from the column of its kind's unit, SI units; NaN where it is absent."""
    lengths, angles = (table.optional(f"{name}_{unit}") for unit in ("mm", "deg"))
    out, other = np.where(kind == ANGLE, (angles, lengths), (lengths, angles))
    for k in np.flatnonzero(np.isnan(out) & np.isfinite(other))[:1]:
        taken, present = _units(kind[k], name)
        raise table.fault(f"a row of kind {kind[k]} takes {taken}, found {present}", k, present)
    return out


def _units(kind: str, name: str) -> tuple[str, str]:
    """Columns of a quantity in the unit that a kind takes, and in the other one."""
    mm, deg = f"{name}_mm", f"{name}_deg"
    return (deg, mm) if kind == ANGLE or RELATIONS.get(kind, "").endswith("_deg") else (mm, deg)


def _joints(table: InputTable, arm: Arm) -> tuple[FloatArray, bool]:
    """Joints (m, joints) of the arm, programmed ones where there are any, SI units, and whether they are programmed."""
    for letter in "cq":
        q = []
        for k, slides in enumerate(arm.table.prismatic, 1):
            names = [f"{letter}{k}_{unit}" for unit in (("mm", "m") if slides else ("deg",))]
            name = next((name for name in names if name in table), None)
            if name is None:
                break
            q.append(table.si(name))
        else:
            return arm.check_joints(arm.from_controller(np.column_stack(q))), letter == "c"
        if q:
            break
    raise table.header_fault(
        f"missing column {' or '.join(names)}: {arm.name} has {arm.joints_in_words}; found {table.listed}"
    )


def _poses(cells: pd.DataFrame, pose: NameArray) -> IntArray:
    """Number of each row's pose: rows with one name and the same joints."""
    joints = [name for name in cells.columns if re.fullmatch(r"[qc][1-9]\d?_(deg|rad|mm|m)|payload_.*", str(name))]
    key = pd.Series(pose, index=cells.index).astype(str)
    for name in joints:
        key = key + "|" + cells[name].astype(str)
    return np.asarray(pd.factorize(key)[0], dtype=int)
