"""Rows of files on stdout, and lists of numbers from the command line."""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING

from irbcal.names import without_formulas

if TYPE_CHECKING:
    import pandas as pd


def write(frame: pd.DataFrame, as_json: bool) -> None:
    """A table for programs on stdout: CSV, or a line of JSON for each row, with null where there is no number."""
    if not as_json:
        without_formulas(frame).to_csv(sys.stdout, index=False, float_format="%.9f")
        return
    for record in frame.astype(object).where(frame.notna(), None).to_dict(orient="records"):
        sys.stdout.write(json.dumps(record) + "\n")


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
