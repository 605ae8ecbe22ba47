"""Text of tables: workbooks, archives and compressed files opened, encodings, delimiters and decimal commas recognised.

What stands in a workbook or an archive is addressed by the file's name, ``!`` and the name inside: ``a.xlsx!Sheet1``.
"""

from __future__ import annotations

import csv
import os
import re
from collections.abc import Collection
from io import BytesIO, StringIO
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from irbcal.errors import MeasurementError
from irbcal.measurement.column_names import DECLARED, NAMES, declared
from irbcal.safe_files import GZIP_MARK, gzip_content, read_bytes, zip_archive, zip_member
from irbcal.wording import first_of

LARGEST_FILE = 200 * 10**6
"""Bytes of a file."""
MOST_MEMBERS = 1000
"""Files of an archive, sheets of a workbook."""
WORKBOOKS, ARCHIVES = (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods"), (".zip",)
MARKS = ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"))
OLDER_CODECS = ("cp1252", "gbk", "shift_jis", "euc_kr", "big5", "cp1251", "cp1250")
"""Encodings of files of older programs, the likelier first."""
COMMA_NUMBER = re.compile(r"[+-]?(?:\d+|\d{1,3}(?:\.\d{3})+),\d+(?:[eE][+-]?\d+)?")
POINT_NUMBER = re.compile(r"[+-]?\d*\.\d+(?:[eE][+-]?\d+)?")
THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")


LONGEST_HEADER = 100_000
"""Bytes in which the header of a table stands."""


def short(text: str, limit: int = 40) -> str:
    """A cell for messages."""
    return text if len(text) <= limit else text[:limit] + "…"


def parts_of(path: str | PathLike[str]) -> list[str]:
    """What a file holds, as sources: the sheets of a workbook, the files of an archive; else the file itself.

    Raises
    ------
    MeasurementError
        If it cannot be read.
    """
    source = str(path)
    suffix = Path(source).suffix.lower()
    if suffix in WORKBOOKS:
        return [f"{source}!{name}" for name in _workbook(source_bytes(source), source).sheet_names]
    if suffix in ARCHIVES:
        archive = zip_archive(source_bytes(source), source, MeasurementError, LARGEST_FILE)
        members = [name for name in archive.namelist() if not name.endswith("/")]
        if len(members) > MOST_MEMBERS:
            raise MeasurementError(f"expected at most {MOST_MEMBERS} files, found {len(members)}", file=source)
        return [part for name in members for part in parts_of(f"{source}!{name}")]
    return [source]


def file_of(source: str | PathLike[str]) -> Path:
    """The file in which a source stands."""
    text = str(source)
    while "!" in text and not os.path.exists(text):
        text = text.rpartition("!")[0]
    return Path(text if os.path.exists(text) else str(source))


def text_lines(source: str, encoding: str = "auto") -> list[str]:
    """Lines of a text file; rows of a workbook's sheet with tabs between their cells.

    Raises
    ------
    MeasurementError
        If it cannot be read.
    """
    container, mark, sheet = source.rpartition("!")
    if mark and Path(container).suffix.lower() in WORKBOOKS and not os.path.exists(source):
        return _sheet_lines(_workbook(source_bytes(container), container), sheet, container)
    members = [] if Path(source).suffix.lower() not in (*WORKBOOKS, *ARCHIVES) else parts_of(source)
    if len(members) == 1:
        return text_lines(members[0], encoding)
    if members:
        names = first_of([short(part.rpartition("!")[2]) for part in members], 20)
        raise MeasurementError(
            f"expected one sheet: {names}; name it as FILE!SHEET, or by file.sheet of a map", file=source
        )
    return _decode(source_bytes(source), encoding, source)


def is_workbook(source: str) -> bool:
    """Whether a source is a workbook, or a sheet of one."""
    return file_of(source).suffix.lower() in WORKBOOKS


def table_bytes(source: str) -> bytes:
    """Content of a file, unpacked; of a workbook's sheet its rows, with tabs between their cells."""
    if is_workbook(source):
        return "\n".join(text_lines(source)).encode()
    return _plain(read_bytes(source, MeasurementError), source)


def _plain(data: bytes, source: str) -> bytes:
    """The content of a file, of a table that gzip compressed (``a.csv.gz``) that of the table."""
    if not data.startswith(GZIP_MARK):
        return data
    return gzip_content(data, source, MeasurementError, LARGEST_FILE)


def header_of(data: bytes) -> tuple[list[str], str]:
    """Names in the first line of a table that is not blank, and what parts them: a comma, a semicolon or a tab."""
    text = data[:LONGEST_HEADER].decode(_marked(data) or "utf-8", errors="replace")
    line = next((line for line in text.splitlines() if line.strip()), "")
    delimiter = max(",;\t", key=line.count)
    return [name.strip() for name in next(csv.reader([line], delimiter=delimiter), [])], delimiter


def with_commas(data: bytes, source: str) -> bytes:
    """A table with commas between its columns and points in its numbers, in UTF-8.

    Parameters
    ----------
    data : bytes
        In UTF-8 or, with its mark, in UTF-16; commas, semicolons or tabs between the columns. Beside semicolons and
        tabs, as spreadsheets write them, also in older encodings, and numbers may have decimal commas, if none has a
        point.
    source : str
        File name for messages.

    Returns
    -------
    bytes
        The same where it is so already, or where it is no text.

    Raises
    ------
    MeasurementError
        If quotes do not end.
    """
    codec, (names, delimiter) = _marked(data) or "utf-8", header_of(data)
    if delimiter == "," and codec != "utf-16":
        return data
    if codec == "utf-8" and not data.isascii() and (older := encoding_of(data)) in OLDER_CODECS:
        codec = older
    try:
        rows = list(csv.reader(StringIO(data.decode(codec), newline=""), delimiter=delimiter, strict=True))
    except UnicodeDecodeError:
        return data
    except csv.Error as error:
        raise MeasurementError(f"not a table: {error}", file=source) from None
    numbers = [k for k, name in enumerate(names) if name not in NAMES]
    known = [k for k in numbers if declared(names[k]) is not DECLARED[".*"]]  # a remark may have a point
    cells = [row[k].strip() for row in rows for k in known or numbers if k < len(row)]
    commas = [cell for cell in cells if COMMA_NUMBER.fullmatch(cell)]
    # 1,234 alone could be thousands, which nobody separates so where semicolons separate the columns
    decimal = delimiter == ";" or (delimiter == "\t" and not all(map(THOUSANDS.fullmatch, commas)))
    if decimal and not any(map(POINT_NUMBER.fullmatch, cells)):
        for row in rows:
            for k in numbers[: len(row)]:
                row[k] = _with_point(row[k])
    text = StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue().encode()


def _with_point(cell: str) -> str:
    """A number with a decimal comma as one with a point; any other cell as it is."""
    return cell.replace(".", "").replace(",", ".") if COMMA_NUMBER.fullmatch(cell.strip()) else cell


def _workbook(data: bytes, source: str) -> Any:
    from python_calamine import CalamineError, CalamineWorkbook

    if data.startswith(b"PK"):
        zip_archive(data, source, MeasurementError, LARGEST_FILE)  # its size
    try:
        return CalamineWorkbook.from_filelike(BytesIO(data))
    except (CalamineError, ValueError, OSError) as error:
        raise MeasurementError(f"not a workbook: {' '.join(str(error).split())}", file=source) from None


def _sheet_lines(workbook: Any, sheet: str, source: str) -> list[str]:
    if sheet not in workbook.sheet_names:
        raise MeasurementError(
            f"expected a sheet of {first_of([*map(short, workbook.sheet_names)], 20)}, found {short(sheet)!r}",
            file=source,
        )
    text = StringIO()
    writer = csv.writer(text, delimiter="\t", lineterminator="\n")
    cells = workbook.get_sheet_by_name(sheet).to_python(skip_empty_area=False)
    flat = [cell for row in cells for cell in row]
    commas = [cell.strip() for cell in flat if isinstance(cell, str) and COMMA_NUMBER.fullmatch(cell.strip())]
    # beside numbers, a text such as 1234,5 is a number, too; 1,234 alone could be thousands
    as_numbers = any(type(cell) in (int, float) for cell in flat) and not all(map(THOUSANDS.fullmatch, commas))
    for row in cells:
        texts = [" ".join(_cell_text(cell).split()) for cell in row]
        if as_numbers:
            texts = [*map(_with_point, texts)]
        writer.writerow(texts)
    return text.getvalue().split("\n")


def _cell_text(cell: Any) -> str:
    """A workbook's cell: numbers as Python writes them, whole ones without a point."""
    if isinstance(cell, float) and not isinstance(cell, bool):
        return str(int(cell)) if cell.is_integer() and abs(cell) < 1e15 else repr(cell)
    return str(cell)


def source_bytes(source: str) -> bytes:
    """Content of a file, or of one in an archive."""
    container, mark, member = source.rpartition("!")
    if mark and not os.path.exists(source) and Path(container.rpartition("!")[0] or container).suffix:
        archive = zip_archive(source_bytes(container), container, MeasurementError, LARGEST_FILE)
        data = zip_member(archive, member, source, MeasurementError)
    else:
        data = _plain(read_bytes(Path(source), MeasurementError, limit_bytes=LARGEST_FILE), source)
    if not data.strip():
        raise MeasurementError("the file is empty, expected rows", file=source)
    return data


def encoding_of(data: bytes, words: Collection[str] = ()) -> str:
    """The encoding of a text: what a mark says, UTF-16 by its zeros, UTF-8, else the likeliest of older ones.

    Parameters
    ----------
    data : bytes
    words : collection of str
        Words that are likely; the encoding in which most of them stand is taken.
    """
    codec = _marked(data)
    if codec is not None:
        return codec
    start = data[:100_000]
    zeros = np.frombuffer(start[: len(start) // 2 * 2], dtype=np.uint8).reshape(-1, 2) == 0
    if len(zeros) and zeros.any():
        share = zeros.mean(axis=0)
        return "utf-16-le" if share[1] > share[0] else "utf-16-be"
    try:
        data.decode("utf-8")
        return "utf-8"
    except UnicodeDecodeError:
        pass
    counts: dict[str, int] = {}
    for codec in OLDER_CODECS:
        try:
            text = data.decode(codec).casefold()
        except UnicodeDecodeError:
            continue
        counts[codec] = sum(word in text for word in words if not word.isascii())
    best = max(counts, key=lambda codec: counts[codec], default="latin-1")
    if counts.get(best):
        return best
    from charset_normalizer import from_bytes

    match = from_bytes(start, cp_isolation=list(counts) or None).best()
    return best if match is None else str(match.encoding)


def _marked(data: bytes) -> str | None:
    """The encoding that a mark at the beginning names."""
    return next((codec for mark, codec in MARKS if data.startswith(mark)), None)


def _decode(data: bytes, encoding: str, source: str) -> list[str]:
    """Lines of a file."""
    codec = _marked(data) or ("utf-8" if encoding == "auto" else encoding)
    try:
        text = data.decode(codec)
    except UnicodeDecodeError as error:
        line = data[: error.start].count(b"\n") + 1
        name = codec.removesuffix("-sig")
        hint = "; older Windows programs write latin-1 or cp1252" if codec == "utf-8" else ""
        raise MeasurementError(
            f"expected text in {name} (file.encoding), found other bytes{hint}", file=source, row=line
        ) from None
    strange = re.search(r"[\x00-\x08\x0e-\x1f]", text)
    if strange:
        line = text.count("\n", 0, strange.start()) + 1
        raise MeasurementError("expected a text file, found binary data", file=source, row=line)
    return text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
