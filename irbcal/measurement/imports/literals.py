"""Joints that stand as literals in the text of a robot program: RAPID, KRL, FANUC LS, URScript.

Only the joints are taken, in the order in which they stand; what the program does with them is not looked at (for that:
`irbcal.correction.languages`). Degrees, but radians in URScript.
"""

from __future__ import annotations

import re
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from irbcal.measurement.imports.part import ROW
from irbcal.units import DEG

_N = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_LIST = rf"\[\s*({_N}(?:\s*,\s*{_N}){{4,6}})\s*\]"


class _Language(NamedTuple):
    """Endings of a language's files, what a literal looks like, and degrees of one of its units."""

    endings: tuple[str, ...]
    literal: re.Pattern[str]
    unit: float
    comment: str


LANGUAGES = (
    _Language(
        (".mod", ".sys", ".prg", ".modx"),
        re.compile(rf"(?:jointtarget\s+(?P<name>\w+)(?:\{{\d+\}})?\s*:=\s*)?\[\s*{_LIST}\s*,\s*\[[^\]]*\]\s*\]", re.I),
        1.0,
        "!",
    ),
    _Language(
        (".src", ".dat", ".sub"),
        re.compile(
            rf"(?:(?:E6)?AXIS\s+(?P<name>\w+)\s*=\s*)?\{{[^{{}}]*?(A1\s+{_N}(?:\s*,\s*A[2-6]\s+{_N}){{5}})", re.I
        ),
        1.0,
        ";",
    ),
    _Language(
        (".ls",),
        re.compile(
            rf"(?:P\[\s*(?P<name>\d+)[^\]]*\]\s*\{{[^{{}}]*?)(J1\s*=\s*{_N}\s*deg(?:\s*,\s*J\d\s*=\s*{_N}\s*deg)+)",
            re.I,
        ),
        1.0,
        "!",
    ),
    _Language((".script", ".urscript"), re.compile(rf"(?:(?P<name>\w+)\s*=\s*|(?<![p\w])){_LIST}"), 1.0 / DEG, "#"),
)


def read(path: str | PathLike[str]) -> pd.DataFrame | None:
    """Joints of a program by its ending.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    DataFrame or None
        ``q1_deg`` …, ``pose`` where all literals have names of their own, and their lines; None if it is no program, or
        has no joints in its text.
    """
    path = Path(path)
    language = next((one for one in LANGUAGES if path.suffix.lower() in one.endings), None)
    if language is None or not path.is_file():
        return None
    text = path.read_bytes().decode("utf-8-sig", errors="replace")
    blank = re.compile(rf"{re.escape(language.comment)}[^\n]*")
    text = blank.sub(lambda found: " " * len(found[0]), text)
    rows, names, lines = [], [], []
    for found in language.literal.finditer(text):
        listed = found[found.lastindex or 0]
        values = re.sub(r"[AJ]\d\s*=?", " ", listed, flags=re.I) if language.unit == 1.0 else listed
        rows.append([float(value) * language.unit for value in re.findall(_N, values)])
        names.append(found["name"])
        lines.append(text.count("\n", 0, found.start()) + 1)
    if not rows or len({len(row) for row in rows}) > 1:
        return None
    table = pd.DataFrame(np.array(rows), columns=[f"q{k}_deg" for k in range(1, len(rows[0]) + 1)])
    table[ROW] = lines
    if all(names) and len(set(names)) == len(names):
        table["pose"] = [f"P{name}" if name.isdigit() else name for name in names]
    return table
