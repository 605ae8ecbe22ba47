"""What validation takes out of tables of readings: names of rows, places."""

from __future__ import annotations

from typing import TYPE_CHECKING

from irbcal.arrays import FloatArray, NameArray
from irbcal.units import MM

if TYPE_CHECKING:
    import pandas as pd

XYZ = ("x_mm", "y_mm", "z_mm")
AXES, ANGLES = "xyz", "abc"
"""Endings of names: along the axes of the base link, and about them."""


def places(table: pd.DataFrame) -> FloatArray:
    """Positions of the rows, shape (rows, 3), metres."""
    return table[list(XYZ)].to_numpy(dtype=float) * MM


def names(table: pd.DataFrame, column: str) -> NameArray | None:
    """What a column calls each row, shape (rows,); None without the column."""
    if column not in table.columns:
        return None
    return table[column].astype(str).str.strip().to_numpy(dtype=object)


def in_order(labels: NameArray) -> list[str]:
    """Different names in the order of their first rows."""
    return [str(name) for name in dict.fromkeys(labels)]


def is_simulated(table: pd.DataFrame) -> bool:
    """Whether a table of readings says so itself, as a measurement file does: not ``no`` in a column ``simulated``."""
    values = names(table, "simulated")
    return values is not None and any(str(value).lower() not in ("", "no", "0", "false", "nan") for value in values)


def start_of(simulated: bool) -> str:
    """How the first sentence on simulated data begins."""
    return "SIMULATED data: " if simulated else ""
