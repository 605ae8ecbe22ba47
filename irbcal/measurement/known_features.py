"""What is known of features: balls, planes, known lengths, in a file beside the rows.

The format is that of `irbcal.measurement.features`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import numpy as np
import pandas as pd

from irbcal.arrays import FloatArray, Locked, NameArray
from irbcal.errors import MeasurementError
from irbcal.measurement import columns, imaging
from irbcal.measurement.columns import InputTable, TableLike
from irbcal.measurement.imaging import Imaging
from irbcal.reading import read_bytes
from irbcal.units import MM

TARGET = "ball"
"""What the tool's point is called unless a target is named."""

DISTANCE = "distance"
"""The kind of what is known between two features."""

TEXT = ("feature", "kind", "target", "first", "second", imaging.FIT, imaging.DICTIONARY)
LENGTHS = ("length_mm", "radius_mm", "offset_mm", "x_mm", "y_mm", "z_mm", "u95_mm")
LENGTH_U95 = 0.05 * MM
"""How well a known length is known unless that is said, metres."""

BRACES = re.compile(r"\{([^{}]+)\}")


@dataclass(frozen=True, eq=False)
class Feature(Locked):
    """A feature with what is known of it.

    Attributes
    ----------
    name, kind, target : str
    radius, offset : float or None
        Metres.
    centre : ndarray, shape (3,), or None
        In the measuring frame, metres.
    axes : ndarray, shape (3, 3), or None
        Of a plane (the third is its normal) or a line through ``centre`` (along the third) that is known.
    u95 : float or None
        Of its rows, metres.
    imaging : Imaging or None
        Camera and board, of images.
    """

    name: str
    kind: str
    target: str = TARGET
    radius: float | None = None
    offset: float | None = None
    centre: FloatArray | None = None
    u95: float | None = None
    imaging: Imaging | None = None
    axes: FloatArray | None = None


@dataclass(frozen=True)
class Length:
    """A known distance of two features' centres, metres."""

    name: str
    first: str
    second: str
    length: float
    u95: float = LENGTH_U95


def given_rows(features: TableLike) -> list[dict[str, str]]:
    """The features' file as rows of text, with its row under ``row``."""
    if isinstance(features, (str, PathLike)) and Path(features).suffix in (".yaml", ".yml"):
        import yaml

        source = str(features)
        try:
            content = yaml.safe_load(read_bytes(features, MeasurementError).decode("utf-8"))
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            raise MeasurementError(f"expected YAML, found {str(error).splitlines()[0]}", file=source) from None
        if not isinstance(content, list) or not all(isinstance(row, dict) for row in content):
            raise MeasurementError("expected a list of features, each with feature and kind", file=source)
        table = pd.DataFrame([{k: "" if v is None else str(v) for k, v in row.items()} for row in content]).fillna("")
        return _rows_of(InputTable(table, source))
    return _rows_of(InputTable.read(features, ["feature", "kind"]))


def _rows_of(table: InputTable) -> list[dict[str, str]]:
    known = (*TEXT, *LENGTHS, *imaging.NUMBERS)
    columns.check_header(table.names, ["feature", "kind"], table.source, known)
    cells = table.cells
    for name in table.names:
        if name in TEXT:
            table.texts(name)
        else:
            cells = cells.assign(**{name: cells[name].mask(np.isnan(table.numbers(name, lost=True)), "")})
    return [
        {str(k): str(v).strip() for k, v in record.items()} | {"row": str(row), "source": table.source}
        for row, record in zip(table.rows, cells.to_dict("records"), strict=True)
    ]


def filled(pattern: str, table: InputTable, row: Mapping[str, str]) -> NameArray:
    """A name for each row of the measurements, from a pattern with columns in braces."""
    out = np.full(len(table), pattern, dtype=object)
    for column in dict.fromkeys(BRACES.findall(pattern)):
        if column not in table:
            raise MeasurementError(
                f"{pattern} asks for the column {column}, which {table.source} does not have: it has {table.listed}",
                file=row["source"],
                row=int(row["row"]),
                column="feature",
            )
        values = table.filled(column)
        out = np.array([a.replace(f"{{{column}}}", str(b)) for a, b in zip(out, values, strict=True)], dtype=object)
    return InputTable(pd.DataFrame({"feature": out}, index=table.cells.index), table.source).texts("feature")


def known_features(
    rows: list[dict[str, str]], table: InputTable, names: NameArray, name_of: str
) -> tuple[dict[str, Feature], tuple[Length, ...]]:
    """Features and lengths with all names filled in."""
    by_name: dict[str, Feature] = {}
    lengths: dict[str, Length] = {}
    measured = set(names)
    imaging.shared(rows)
    for row in rows:
        value = {name: float(row[name]) * MM if row.get(name) else None for name in LENGTHS}
        if not row["feature"] or not row["kind"]:
            raise MeasurementError("expected a feature and its kind", file=row["source"], row=int(row["row"]))
        labels = filled(row["feature"], table, row) if BRACES.search(row["feature"]) else [row["feature"]]
        ends = [filled(row.get(name, ""), table, row) for name in ("first", "second")]
        if row["kind"] == DISTANCE:
            length = value["length_mm"]
            if length is None or length <= 0.0 or not row.get("first") or not row.get("second"):
                raise MeasurementError(
                    "a distance needs first, second and length_mm", file=row["source"], row=int(row["row"])
                )
            triples = set(zip(labels if len(labels) > 1 else labels * len(table), *ends, strict=True))
            present = sorted(triple for triple in triples if triple[1] in measured and triple[2] in measured)
            if not present and not any(BRACES.search(row[key]) for key in ("first", "second")):
                lost = row["first"] if row["first"] not in measured else row["second"]
                raise MeasurementError(
                    f"no row is at {lost}, between which and another {row['feature']} is known",
                    file=row["source"],
                    row=int(row["row"]),
                )
            for label, first, second in present:
                lengths[label] = Length(label, first, second, length, value["u95_mm"] or LENGTH_U95)
            continue
        xyz = [value[f"{axis}_mm"] for axis in "xyz"]
        if any(x is None for x in xyz) and any(x is not None for x in xyz):
            raise MeasurementError("expected x_mm, y_mm and z_mm, all or none", file=row["source"], row=int(row["row"]))
        centre = None if xyz[0] is None else np.array(xyz, dtype=float)
        for label in dict.fromkeys(labels):
            by_name[label] = Feature(
                label,
                row["kind"],
                row.get("target") or TARGET,
                value["radius_mm"],
                value["offset_mm"],
                centre,
                value["u95_mm"],
                imaging.imaging_of(row) if row["kind"] in imaging.TARGETS else None,
            )
    return by_name, tuple(lengths.values())
