"""The comment line that marks a corrected RAPID module."""

from __future__ import annotations

import re
from collections.abc import Sequence

from irbcal.correction.languages.rapid.syntax import Reader
from irbcal.correction.languages.rapid.tokens import decode
from irbcal.errors import ProgramError

MARK = "! irbcal: fake targets, calibration "
"""Begin of the line; the fingerprint of the calibration follows."""

HEADER = 500
"""Tokens and comments among which the line with ``MODULE`` is looked for first."""

_MARK = re.compile(r"!\s*irbcal: fake targets(?:, calibration (\S+))?", re.IGNORECASE)


def mark(data: bytes, fingerprint: str, source: str = "program") -> bytes:
    """Bytes of a module with the comment line that says what its targets are corrected for.

    The line comes behind the one with ``MODULE``; all other bytes stay.

    Parameters
    ----------
    data : bytes
    fingerprint : str
        Of the calibration: one word.
    source : str
        File name for messages.

    Returns
    -------
    bytes
    """
    if not fingerprint.isascii() or not fingerprint.isprintable() or fingerprint.split() != [fingerprint]:
        raise ValueError("expected a fingerprint of one word")
    text, encoding = decode(data, source)
    try:
        reader = Reader(text, source, HEADER)
        end = reader.tokens[reader.header() - 1].end
    except ProgramError:
        reader = Reader(text, source)
        end = reader.tokens[reader.header() - 1].end
    line_end = re.search(r"\r\n|\n|\r", text)
    newline = line_end[0] if line_end else "\n"
    rest = re.match(r"[ \t]*(?:![^\r\n]*)?(\r\n|\n|\r)", text[end:])
    at, before = (end + rest.end(), "") if rest else (end, newline)
    return (text[:at] + before + MARK + fingerprint + newline + text[at:]).encode(encoding)


def in_comments(comments: Sequence[str]) -> str | None:
    """Fingerprint in the first mark among comments; empty where it names none, None without mark."""
    marks = [found[1] or "" for found in map(_MARK.match, comments) if found]
    return marks[0] if marks else None


def fingerprint(data: bytes, source: str = "program") -> str | None:
    """Fingerprint in the mark of a module; empty where it names none, None without mark.

    Raises
    ------
    ProgramError
        If this is no RAPID module.
    """
    text, _ = decode(data, source)
    reader = Reader(text, source)
    reader.header()
    return in_comments(reader.comments)
