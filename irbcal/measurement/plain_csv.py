"""Plain CSV files read fast, columns of numbers as numbers.

A file is plain where no cell is quoted, no line is blank, lines end with a line feed and all numbers are numbers. Any
other file, and one that is wrong, is read cell by cell as text (`irbcal.measurement.columns`), which can say what is
wrong where.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pandas as pd

from irbcal.arrays import FloatArray

BOM = b"\xef\xbb\xbf"
LONG = 1_000_000
"""Bytes from which both cores read."""


def parse(data: bytes, names: Sequence[str], typed: Callable[[str], bool]) -> pd.DataFrame | None:
    """Cells of a plain file.

    Parameters
    ----------
    data : bytes
    names : sequence of str
        Of the columns, as the first line has them.
    typed : callable
        Tells by its name whether a column is one of numbers.

    Returns
    -------
    DataFrame or None
        Numbers, NaN where nothing stands, and text; the index holds the lines of the file. None for a file that is not
        plain, or without pyarrow.
    """
    if b'"' in data or b"\r" in data:
        return None
    try:
        import pyarrow as pa
        from pyarrow import compute, csv
    except ImportError:
        return None
    numbers = {name for name in names if typed(name)}
    start = len(BOM) if data.startswith(BOM) else 0
    rows = data.count(b"\n") - data.endswith(b"\n")
    try:
        table = csv.read_csv(
            pa.BufferReader(pa.py_buffer(data).slice(start)),
            csv.ReadOptions(use_threads=len(data) > LONG, column_names=list(names), skip_rows=1),
            csv.ParseOptions(quote_char=False),
            csv.ConvertOptions(
                column_types={name: pa.float64() if name in numbers else pa.string() for name in names},
                null_values=[""],
            ),
        )
    except pa.ArrowInvalid:
        return None
    if table.num_rows != rows:  # blank lines
        return None
    columns: dict[str, Any] = {}
    empty = np.ones(rows, dtype=bool)
    text = pd.StringDtype("pyarrow", na_value=np.nan)
    for name in names:
        column = table.column(name)
        columns[name] = column.to_numpy() if name in numbers else pd.array(column, dtype=text)
        if name not in numbers:
            if empty.any():
                empty &= compute.equal(column, "").to_numpy()
        else:
            empty &= np.isnan(columns[name])
            if np.isinf(columns[name]).any() or np.isnan(columns[name]).sum() != column.null_count:  # "nan" as text
                return None
    if empty.any():  # a line of commas is no row
        return None
    return pd.DataFrame(columns, index=pd.RangeIndex(2, rows + 2), copy=False)


def floats(text: pd.Series) -> FloatArray | None:
    """Numbers of a column of text that pyarrow holds; None where it does not, or a cell is no plain number."""
    to_arrow = getattr(text.array, "__arrow_array__", None)
    if to_arrow is None or not isinstance(text.dtype, pd.StringDtype) or text.dtype.storage != "pyarrow":
        return None
    import pyarrow as pa

    try:
        return np.asarray(to_arrow().cast(pa.float64()))
    except pa.ArrowInvalid:
        return None
