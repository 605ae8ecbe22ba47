"""Names from files: what they may hold, and how they get into comments of robot programs and cells of tables.

A name goes to terminals, pages, tables and comments of programs that a robot runs. A line break in it (there are eight
in Unicode) would end the comment, and what follows would run as code. So names are refused where they enter, and
comments are written through one function that cannot emit a second line.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from os import PathLike
from typing import TYPE_CHECKING, Any

from irbcal.errors import IrbcalError

if TYPE_CHECKING:
    import pandas as pd

LONGEST_NAME = 200
"""Characters."""
LONGEST_COMMENT = 160
"""Characters of a comment's text; the rest is cut off."""
FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")
"""With which a spreadsheet takes a cell for a formula."""

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\Z")


def fault_of(name: str, longest: float = LONGEST_NAME) -> str | None:
    """What is wrong with a name, as the end of a sentence; None if nothing is.

    Parameters
    ----------
    name : str
    longest : float
        Characters that it may have.
    """
    if not name.replace("\u00a0", "").isprintable():
        return f"expected a name of printable characters on one line, found {name[:LONGEST_NAME]!a}"
    if len(name) > longest:
        return f"expected a name of at most {longest:g} characters, found {len(name)} ({name[:30]!r} …)"
    return None


def check_names(
    names: Iterable[str | None],
    error: type[IrbcalError],
    *,
    file: str | PathLike[str] | None = None,
    parameter: str | None = None,
) -> None:
    """Refuse names that would act instead of being shown.

    Parameters
    ----------
    names : iterable of str or None
        None stands for no name.
    error : type
        The kind of error to raise.
    file, parameter
        Where they come from, for the sentence.

    Raises
    ------
    IrbcalError
        Of the kind ``error``, for the first such name.
    """
    for name in names:
        fault = None if name is None else fault_of(name)
        if fault is not None:
            text = fault if parameter is None else f"{parameter}: {fault}"
            raise error(text, file=file, parameter=parameter)


def comment(text: str) -> str:
    """A text as it may stand in a comment of a robot program: one line of printable ASCII, whatever it was.

    Returns
    -------
    str
        Other characters are ``?``, white space is single blanks, at most `LONGEST_COMMENT` characters.
    """
    plain = "".join(char if " " <= char <= "~" else " " if char.isspace() else "?" for char in text)
    return " ".join(plain.split())[:LONGEST_COMMENT]


def cell(text: str) -> str:
    """A name as it is written into a CSV cell that people open in a spreadsheet: never a formula.

    Returns
    -------
    str
        With an apostrophe before a first character that would begin a formula; numbers stay.
    """
    return f"'{text}" if text.startswith(FORMULA_STARTS) and not _NUMBER.match(text) else text


def from_cell(text: str) -> str:
    """The name that `cell` wrote."""
    return text[1:] if text[:1] == "'" and text[1:].startswith(FORMULA_STARTS) else text


def without_formulas(table: pd.DataFrame) -> pd.DataFrame:
    """A table as it is written for people: no text in it begins like a formula.

    Returns
    -------
    DataFrame
        The same where there is nothing to do.
    """
    texts = [k for k, kind in enumerate(table.dtypes) if kind.kind not in "biufcmM"]
    out = table
    for k in texts:
        column = table.iloc[:, k]
        if column.map(lambda value: isinstance(value, str) and cell(value) != value).any():
            out = table.copy() if out is table else out
            out.isetitem(k, column.map(lambda value: cell(value) if isinstance(value, str) else value))
    return out


def csv_bytes(table: pd.DataFrame, **options: Any) -> bytes:
    """A table as a CSV file for people, without formulas; options are those of ``DataFrame.to_csv``."""
    return without_formulas(table).to_csv(index=False, lineterminator="\n", **options).encode("utf-8")
