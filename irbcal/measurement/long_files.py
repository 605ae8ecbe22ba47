"""Long measurement files in pieces of some ten thousand rows: memory does not grow with the file."""

from __future__ import annotations

import csv
import hashlib
import re
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from io import BytesIO
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from irbcal.errors import IrbcalError, MeasurementError
from irbcal.measurement import table
from irbcal.measurement.column_names import header_row
from irbcal.measurement.table import MeasurementSet
from irbcal.measurement.table_columns import lines_are_rows, names_of_csv

LONG = 1_000_000
"""Rows from which a file is read in pieces."""
ROWS = 50_000
"""Rows of a piece, about: it ends where a pose ends."""
BLOCK = 1 << 24
"""Bytes that are looked through at a time."""


@dataclass(frozen=True)
class Piece:
    """Rows of a long file, those of a pose together."""

    path: str
    begin: int
    end: int
    """Bytes of a CSV file, rows of a Parquet file."""
    row: int
    """Of the file, for messages: that before the first."""


@dataclass(frozen=True)
class LongFile:
    """A long file."""

    path: str
    sha256: str
    """Of its content."""
    columns: tuple[str, ...]
    """Their names."""
    pieces: tuple[Piece, ...]


def long_table(path: Path) -> LongFile | None:
    """The pieces of a CSV or Parquet file of a million rows and more, cut between any two rows; None for all else."""
    try:
        if path.suffix not in (".csv", ".parquet") or not path.is_file():
            return None
        return _csv(path, None) if path.suffix == ".csv" else _parquet(path, None)
    except (OSError, UnicodeDecodeError, csv.Error, MeasurementError):
        return None


def long_file(source: object) -> LongFile | None:
    """The pieces of a file that is long enough for them; None for all else, which is read as a whole.

    Rows of one pose must stand together, as trackers write them: a pose that comes again counts as another.
    """
    if not isinstance(source, (str, PathLike)) or not Path(source).is_file():
        return None
    path = Path(source)
    try:
        return _parquet(path) if path.suffix == ".parquet" else _csv(path)
    except (OSError, UnicodeDecodeError, csv.Error, MeasurementError):
        return None  # the reader of the whole says what is wrong


def _csv(path: Path, column: str | None = "pose") -> LongFile | None:
    """Cut where a line begins that has another name of a pose than the line before."""
    size = path.stat().st_size
    with open(path, "rb") as stream:
        header, first = stream.readline(), stream.readline()
        names = names_of_csv(header, str(path))
        if not first.strip() or size / len(first) < 0.5 * LONG:
            return None
        if column is not None and (column not in names or "session" in names):
            return None
        k = None if column is None else names.index(column)
        stream.seek(0)
        digest, lines, begins = hashlib.sha256(), 0, [(len(header), 1)]
        step = len(first) * ROWS
        carry, at = b"", 0
        for block in iter(lambda: stream.read(BLOCK) + stream.readline(), b""):
            digest.update(block)
            data, offset = carry + block, at - len(carry)
            if not lines_are_rows(block):
                return None
            goal = begins[-1][0] + step
            while goal < offset + len(data) - 64 * len(first):
                begin = max(goal - offset, 0)
                cut = data.find(b"\n", begin) + 1 if k is None else _change_of_pose(data, begin, k)
                if cut is None:
                    break
                begins.append((offset + cut, lines + data.count(b"\n", 0, cut)))
                goal = begins[-1][0] + step
            kept = max(len(data) - 128 * len(first), 0)
            lines += data.count(b"\n", 0, kept)
            carry, at = data[kept:], offset + len(data)
    if lines < LONG // 2:
        return None
    ends = [begin for begin, _ in begins[1:]] + [size]
    pieces = [Piece(str(path), begin, end, row - 1) for (begin, row), end in zip(begins, ends, strict=True)]
    return LongFile(str(path), digest.hexdigest(), tuple(names), tuple(pieces))


def _change_of_pose(data: bytes, goal: int, column: int) -> int | None:
    """Where the first line after a place begins whose pose is another than that of the line before."""
    begin = data.find(b"\n", goal) + 1
    previous: bytes | None = None
    while begin:
        end = data.find(b"\n", begin)
        if end < 0:
            return None
        row = data[begin:end]
        pose = row.split(b",", column + 1)[column : column + 1]
        if b'"' in row:
            pose = [cell.encode() for cell in next(csv.reader([row.decode()]))[column : column + 1]]
        if previous is not None and pose and pose[0].strip() != previous:
            return begin
        previous = pose[0].strip() if pose else previous
        begin = end + 1
    return None


def _parquet(path: Path, column: str | None = "pose") -> LongFile | None:
    """Cut where the name of the pose changes, or anywhere."""
    try:
        from pyarrow import ArrowException, parquet
    except ImportError:
        return None
    try:
        file = parquet.ParquetFile(path)
        names = file.schema_arrow.names
        rows = file.metadata.num_rows
        if rows < LONG or (column is not None and (column not in names or "session" in names)):
            return None
        begins, row, previous = [0] if column else [*range(0, rows, ROWS)], 0, None
        for batch in file.iter_batches(ROWS, columns=[column]) if column else ():
            poses = batch.column(0).to_numpy(zero_copy_only=False)
            changes = np.flatnonzero(poses[1:] != poses[:-1]) + 1
            if row and previous != poses[0]:
                changes = np.concatenate([[0], changes])
            if row and len(changes):
                begins.append(row + int(changes[0]))
            row, previous = row + len(poses), poses[-1]
    except (ArrowException, ValueError, TypeError):
        return None
    pieces = [Piece(str(path), begin, end, begin) for begin, end in zip(begins, [*begins[1:], rows], strict=True)]
    return LongFile(str(path), digest_of(path), tuple(name.strip() for name in names), tuple(pieces))


def digest_of(path: Path) -> str:
    """SHA-256 of a file that may be larger than memory."""
    digest = hashlib.sha256()
    with open(path, "rb") as stream:
        for block in iter(lambda: stream.read(BLOCK), b""):
            digest.update(block)
    return digest.hexdigest()


def once(sentences: Iterable[str], count: int) -> tuple[str, ...]:
    """Sentences of so many pieces, each once; of those that differ in their numbers alone the first."""
    first: dict[str, str] = {}
    times: Counter[str] = Counter()
    for sentence in sentences:
        key = re.sub(r"\d[\d.,]*", "#", sentence)
        first.setdefault(key, sentence)
        times[key] += 1
    return tuple(
        sentence if times[key] == 1 or count == 1 else f"{sentence} (The like in {times[key]} pieces of the file.)"
        for key, sentence in first.items()
    )


def with_row_of_file(error: IrbcalError, offset: int) -> IrbcalError:
    """A refusal of a piece, with the row of the file."""
    if error.row is None:
        return error
    return type(error)(error.message, file=error.file, row=error.row + offset, column=error.column)


def read(piece: Piece, sha256: str = "") -> MeasurementSet:
    """The measurements of a piece; rows are those of the file.

    Raises
    ------
    MeasurementError
        As `irbcal.measurement.table.read`, with the row of the file.
    """
    try:
        measured = _read(piece)
    except MeasurementError as error:
        if error.row == header_row(piece.path):
            raise
        raise with_row_of_file(error, piece.row) from None
    return measured.changed({"row": measured.cells["row"] + piece.row}, sha256=sha256 or measured.sha256)


def _read(piece: Piece) -> MeasurementSet:
    if piece.path.endswith(".parquet"):
        return table.of_frame(_rows(piece.path, piece.begin, piece.end).to_pandas(), piece.path)
    return table.parse(content(piece)[0], piece.path)


def content(piece: Piece, lead: int = 0) -> tuple[bytes, int]:
    """A piece as a file of its own, with so many rows before it; and how many of these there are."""
    if piece.path.endswith(".parquet"):
        from pyarrow import parquet

        lead, out = min(lead, piece.begin), BytesIO()
        parquet.write_table(_rows(piece.path, piece.begin - lead, piece.end), out, compression="none")
        return out.getvalue(), lead
    with open(piece.path, "rb") as stream:
        header = stream.readline()
        begin = max(piece.begin - 2 * lead * len(stream.readline()), len(header)) if lead else piece.begin
        stream.seek(begin)
        data, rows = stream.read(piece.end - begin), 0
    if begin < piece.begin:
        lines = data[: piece.begin - begin].split(b"\n")[:-1]
        rows = min(lead, len(lines) - (begin > len(header)))  # the first may be part of a row
        data = b"".join(line + b"\n" for line in lines[len(lines) - rows :]) + data[piece.begin - begin :]
    return header + data, rows


def _rows(path: str, first: int, last: int) -> Any:
    """Rows of a Parquet file as an Arrow table."""
    from pyarrow import Table, parquet

    file = parquet.ParquetFile(path)
    out, begin = [], 0
    for group in range(file.metadata.num_row_groups):
        end = begin + file.metadata.row_group(group).num_rows
        if begin < last and end > first:
            for batch in file.iter_batches(ROWS, row_groups=[group]):
                low, high = max(first - begin, 0), min(last - begin, len(batch))
                if low < high:
                    out.append(batch.slice(low, high - low))
                begin += len(batch)
                if begin >= last:
                    break
        begin = end
    return Table.from_batches(out)
