"""Tables of readings for validation: numbers and labels by column, checked."""

from collections.abc import Sequence

import pandas as pd

from irbcal.arrays import FloatArray
from irbcal.errors import MeasurementError
from irbcal.measurement import columns, quaternion_columns
from irbcal.measurement.columns import POSITION, QUATERNION, TableLike

LARGEST_NUMBER = 1e12
"""Of seconds, degrees, air: no instrument writes a larger one."""


def read(
    table: TableLike, numbers: Sequence[str], labels: Sequence[str] = (), optional: Sequence[str] = ()
) -> pd.DataFrame:
    """Read a table of readings.

    Parameters
    ----------
    table : str, Path or DataFrame
    numbers : sequence of str
        Columns that must be there with a number in every row.
    labels : sequence of str
        Columns that must be there with a name in every row.
    optional : sequence of str
        Columns of numbers that may be absent; where present, an empty value is NaN.

    Returns
    -------
    DataFrame
        These columns, all others as text, ``row`` (line in the file) and, where there are four quaternion columns,
        unit quaternions. ``attrs`` holds ``source``.

    Raises
    ------
    MeasurementError
        If the table cannot be read or does not keep the format.
    """
    cells, source, _ = columns.read(table, [*labels, *numbers])
    out = pd.DataFrame({"row": cells.index})
    for name in numbers:
        out[name] = columns.numbers(cells, name, source)
    for name in labels:
        out[name] = columns.names(cells, name, source)
    for name in [name for name in cells.columns if name not in out.columns]:
        if name in (*optional, *QUATERNION):
            out[name] = columns.numbers(cells, name, source, lost=True)
        else:
            out[name] = cells[name].to_numpy()
    quaternion_columns.check(out, source)
    out.attrs["source"] = source
    return out


def read_points(
    table: TableLike, labels: Sequence[str] = (), numbers: Sequence[str] = (), optional: Sequence[str] = ()
) -> pd.DataFrame:
    """As `read`, with the columns ``x_mm``, ``y_mm``, ``z_mm``; rows of lost points (empty or 0,0,0) are left out.

    Returns
    -------
    DataFrame
        ``attrs`` also holds ``lost``, the number of rows that are left out.

    Raises
    ------
    MeasurementError
        As `read`, or if all points are lost.
    """
    readings_ = read(table, numbers, labels, (*POSITION, *optional))
    source = readings_.attrs["source"]
    missing = [name for name in POSITION if name not in readings_.columns]
    if missing:
        row = columns.header_row(source)
        raise MeasurementError(f"missing column {', '.join(missing)}", file=source, row=row)
    lost = columns.lost_points(readings_[POSITION].to_numpy())
    if lost.all():
        raise MeasurementError("every point is lost", file=source)
    attrs = readings_.attrs | {"lost": int(lost.sum())}
    readings_ = readings_[~lost].reset_index(drop=True)
    readings_.attrs.update(attrs)
    return readings_


def rotations(table: pd.DataFrame) -> FloatArray | None:
    """Orientations of a table's rows, shape (rows, 3, 3); None without quaternion columns or with gaps in them."""
    if QUATERNION[0] not in table.columns or table[QUATERNION].isna().any(axis=None):
        return None
    return quaternion_columns.rotations(table)
