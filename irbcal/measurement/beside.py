"""Tables that keep what they were made from: columns of an input beside what was computed for its rows."""

from __future__ import annotations

import numpy as np
import pandas as pd

from irbcal.arrays import IntArray

GIVEN = "given_"
"""Put before the name of a column of the input that was computed, too."""
NAMES = ("pose", "target", "group", "session", "cycle")
"""Columns that are names even where they look like numbers."""


def beside(
    inputs: pd.DataFrame | None, computed: pd.DataFrame, as_written: bool = False, row: IntArray | None = None
) -> pd.DataFrame:
    """Columns of an input, then those computed for its rows.

    Parameters
    ----------
    inputs : DataFrame or None
        The input's cells, texts as they stand in a file; None: there are none.
    computed : DataFrame
        What was computed.
    as_written : bool
        Leave the texts as they are; else columns in which nothing but numbers stands are numbers.
    row : ndarray of int, shape (rows of found,), optional
        The input's row, from 0, of each computed row; the same number unless given.

    Returns
    -------
    DataFrame
        Columns of the input whose names are taken are called ``given_NAME``.
    """
    if inputs is None:
        return computed
    columns_in = (inputs if as_written else _as_numbers(inputs)).reset_index(drop=True)
    if row is not None:
        columns_in = columns_in.iloc[row].reset_index(drop=True)
    names_used = {*map(str, inputs.columns), *map(str, computed.columns)}
    names: dict[str, str] = {}
    for name in map(str, columns_in.columns):
        new = name
        while (new != name and new in names_used) or new in computed.columns:
            new = GIVEN + new
        names_used.add(new)
        names[name] = new
    return pd.concat([columns_in.rename(columns=names), computed.reset_index(drop=True)], axis=1)


def _as_numbers(cells: pd.DataFrame) -> pd.DataFrame:
    """Texts of a file with the columns as numbers in which finite numbers (or nothing) stand alone; not names."""
    out = {}
    for name in cells.columns:
        text = cells[name].str.strip()
        values = pd.to_numeric(text.where(text != ""), errors="coerce")
        finite = values.notna() & ~np.isinf(values)
        number = name not in NAMES and finite.any() and (finite | (text == "")).all()
        out[name] = values.astype(float) if number else cells[name]
    return pd.DataFrame(out, index=cells.index)
