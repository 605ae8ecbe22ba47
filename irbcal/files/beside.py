"""Points and poses of large calibrations: Parquet files beside ``calibration.json``, which has their hashes.

A file of many points as JSON is large and slow. What is read is the same: one schema, sections `points` and `poses`.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from irbcal.errors import CalibrationError
from irbcal.files.schema import Record
from irbcal.files.section import Section
from irbcal.reading import read_bytes

MANY = 30_000
"""Points that stand in ``calibration.json`` at most."""
SCHEMA, WITH_TABLES = "irbcal-calibration-1", "irbcal-calibration-2"
"""What a file is called that holds all of it, and one with tables beside it: earlier versions refuse that name."""
FILES = {"points": "calibration.points.parquet", "poses": "calibration.poses.parquet"}
SIGNS = "came_from"
"""A column of characters."""


def parted(record: Record) -> tuple[dict[str, Any], dict[str, bytes]]:
    """What stands in ``calibration.json``, and the files beside it.

    Parameters
    ----------
    record : Record

    Returns
    -------
    document : dict
        For JSON, without its seal.
    files : dict of str to bytes
        Empty where there are few points, or pyarrow is not installed.
    """
    tables: dict[str, Section | None] = {name: getattr(record, name) for name in FILES}
    if len(record.points.pose) <= MANY or not _pyarrow():
        return record.model_dump(mode="json"), {}
    files = {FILES[name]: _parquet(table) for name, table in tables.items() if table is not None}
    document = record.model_dump(mode="json", exclude=set(FILES)) | {"schema_name": WITH_TABLES}
    for name, table in tables.items():
        document[name] = None if table is None else _reference(FILES[name], files[FILES[name]])
    return document, files


def joined(document: Mapping[str, Any], folder: Path) -> Mapping[str, Any]:
    """The content of a ``calibration.json`` with the tables that stand beside it.

    Parameters
    ----------
    document : dict
        As JSON has it.
    folder : Path

    Returns
    -------
    dict

    Raises
    ------
    CalibrationError
        If a table is missing, is not the one that the file names, or cannot be read.
    """
    if document.get("schema_name") != WITH_TABLES:
        return document
    tables = {name: document.get(name) for name in FILES}
    read = {name: None if value is None else _read(value, folder, FILES[name]) for name, value in tables.items()}
    return {**document, **read, "schema_name": SCHEMA}


def _reference(name: str, content: bytes) -> dict[str, str]:
    return {"file": name, "sha256": hashlib.sha256(content).hexdigest()}


def _pyarrow() -> bool:
    from importlib.util import find_spec

    return find_spec("pyarrow") is not None


def _parquet(table: Section) -> bytes:
    """A section of columns as Parquet; columns for each joint are numbered."""
    import pyarrow as pa
    from pyarrow import parquet

    columns: dict[str, Any] = {}
    for name, values in table:
        if name == SIGNS or (values and isinstance(values[0], list)):
            columns |= {f"{name}.{k}": pa.array(list(column)) for k, column in enumerate(values)}
        elif values:
            columns[name] = pa.array(values)
    buffer = BytesIO()
    names = [name for name, column in columns.items() if not pa.types.is_floating(column.type)]
    parquet.write_table(pa.table(columns), buffer, compression="zstd", use_dictionary=names)
    return buffer.getvalue()


def _read(reference: Any, folder: Path, name: str) -> dict[str, list[Any]]:
    """The columns of a table, as JSON would have them."""
    content = read_bytes(folder / name, CalibrationError)
    if reference != _reference(name, content):
        raise CalibrationError("this is not the table that calibration.json was written with", file=folder / name)
    try:
        from pyarrow import parquet
    except ImportError:
        raise CalibrationError(
            "reading Parquet needs the package pyarrow, which is absent", file=folder / name
        ) from None
    try:
        table = parquet.read_table(BytesIO(content))
    except Exception as error:  # whatever pyarrow raises on a damaged file
        raise CalibrationError(f"this is no Parquet file: {error}", file=folder / name) from None
    del content
    columns: dict[str, list[Any]] = {}
    for label in table.column_names:
        part, dot, _ = label.partition(".")
        values = _values(table.column(label))
        if not dot:
            columns[part] = values
        else:
            columns.setdefault(part, []).append("".join(values) if part == SIGNS else values)
    return columns


def _values(column: Any) -> list[Any]:
    """The values of a column; those of text share their words, of which a long table has few."""
    import pyarrow as pa

    if not pa.types.is_string(column.type):
        return column.to_pylist()
    coded = column.combine_chunks().dictionary_encode()
    words = np.array([*coded.dictionary.to_pylist(), None], dtype=object)
    return words[coded.indices.fill_null(len(words) - 1).to_numpy()].tolist()
