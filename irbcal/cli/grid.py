"""Plain tables and rows of files on stdout, and lists of numbers from the command line."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, TypeAlias

from irbcal.names import without_formulas

if TYPE_CHECKING:
    import pandas as pd

Cell: TypeAlias = "str | int | float | tuple[float, int] | None"
"""Text, a number, a number with its decimals, or nothing."""


def write(frame: pd.DataFrame, as_json: bool) -> None:
    """A table for programs on stdout: CSV, or a line of JSON for each row, with null where there is no number."""
    if not as_json:
        without_formulas(frame).to_csv(sys.stdout, index=False, float_format="%.9f")
        return
    for record in frame.astype(object).where(frame.notna(), None).to_dict(orient="records"):
        sys.stdout.write(json.dumps(record) + "\n")


def table(title: str, columns: Sequence[str], rows: Sequence[Sequence[Cell]]) -> None:
    """Print a table.

    Parameters
    ----------
    title : str
    columns : sequence of str
        Headings, with units; the first column is text.
    rows : sequence of sequence
        Text, numbers (printed with three decimals unless given as (value, digits)), or None for nothing.
    """
    from rich import box
    from rich.console import Console
    from rich.table import Table

    from irbcal.cli.show import say

    say(title)
    grid = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for k, name in enumerate(columns):
        grid.add_column(name, justify="right" if k else "left", no_wrap=True)
    for row in rows:
        grid.add_row(*(cell(value) for value in row))
    Console(width=max(100, len(columns) * 14), markup=False).print(grid)


def cell(value: Cell, digits: int = 3) -> str:
    """A value as text: numbers with three decimals unless given as (value, digits)."""
    if isinstance(value, tuple):
        value, digits = value
    if value is None:
        return "–"
    if isinstance(value, float):
        return format(value, f".{digits}f")
    return str(value)


def interval(ends: Sequence[float] | None, digits: int = 3) -> str:
    """An interval as text, or a dash."""
    return "–" if ends is None else f"{ends[0]:.{digits}f} … {ends[1]:.{digits}f}"


def numbers(text: str, counts: Sequence[int], option: str, names: Sequence[str] = ()) -> list[float]:
    """Numbers separated by commas; a wrong call if their count is another, ``names`` says of what."""
    import math

    import typer

    try:
        values = [float(value) for value in text.split(",")]
    except ValueError:
        values = []
    if len(values) not in counts or not all(map(math.isfinite, values)):
        expected = f"{' or '.join(map(str, counts))} numbers" + (f" ({', '.join(names)})" if names else "")
        raise typer.BadParameter(f"expected {expected}, found {text!r}", param_hint=option)
    return values


def metres(text: str | None, option: str) -> list[float] | None:
    """A place given as x,y,z in mm, in metres; None where it was not given."""
    from irbcal.units import MM

    return None if text is None else [value * MM for value in numbers(text, (3,), option, "xyz")]
