"""Files of other programs as lines of text: workbooks and archives opened, encodings recognised.

What stands in a workbook or an archive is addressed by the file's name, ``!`` and the name inside: ``a.xlsx!Sheet1``.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Collection
from io import BytesIO, StringIO
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from irbcal.errors import MeasurementError
from irbcal.safe_files import read_bytes, zip_archive, zip_member
from irbcal.wording import first_of

LARGEST_FILE = 200 * 10**6
"""Bytes of a file."""
MOST_MEMBERS = 1000
"""Files of an archive, sheets of a workbook."""
WORKBOOKS, ARCHIVES = (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods"), (".zip",)
MARKS = ((b"\xef\xbb\xbf", "utf-8-sig"), (b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"))
OLDER_CODECS = ("cp1252", "gbk", "shift_jis", "euc_kr", "big5", "cp1251", "cp1250")
"""Encodings of files of older programs, the likelier first."""
COMMA_NUMBER = re.compile(r"[+-]?(?:\d+|\d{1,3}(?:\.\d{3})+),\d+")
THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")


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
    while "!" in text and not Path(text).exists():
        text = text.rpartition("!")[0]
    return Path(text if Path(text).exists() else str(source))


def text_lines(source: str, encoding: str = "auto") -> list[str]:
    """Lines of a text file; rows of a workbook's sheet with tabs between their cells.

    Raises
    ------
    MeasurementError
        If it cannot be read.
    """
    container, mark, sheet = source.rpartition("!")
    if mark and Path(container).suffix.lower() in WORKBOOKS and not Path(source).exists():
        return _sheet_lines(_workbook(source_bytes(container), container), sheet, container)
    members = [] if Path(source).suffix.lower() not in (*WORKBOOKS, *ARCHIVES) else parts_of(source)
    if len(members) == 1:
        return text_lines(members[0], encoding)
    if members:
        names = first_of([short(part.rpartition("!")[2]) for part in members], 20)
        raise MeasurementError(f"expected file.sheet, which names one of {names}", file=source)
    return _decode(source_bytes(source), encoding, source)


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
            texts = [t.replace(".", "").replace(",", ".") if COMMA_NUMBER.fullmatch(t) else t for t in texts]
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
    if mark and not Path(source).exists() and Path(container.rpartition("!")[0] or container).suffix:
        archive = zip_archive(source_bytes(container), container, MeasurementError, LARGEST_FILE)
        data = zip_member(archive, member, source, MeasurementError)
    else:
        data = read_bytes(Path(source), MeasurementError, limit_bytes=LARGEST_FILE)
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
    codec = next((codec for mark, codec in MARKS if data.startswith(mark)), None)
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


def _decode(data: bytes, encoding: str, source: str) -> list[str]:
    """Lines of a file."""
    marked = next((codec for mark, codec in MARKS if data.startswith(mark)), None)
    codec = marked or ("utf-8" if encoding == "auto" else encoding)
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
