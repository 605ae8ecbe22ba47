"""Tables of readings for validation: numbers and labels by column, checked."""

import pandas as pd

from irbcal.errors import MeasurementError
from irbcal.measurement.table import POSITION, QUATERNION, _check_quaternions, _names, _numbers, _read_columns


def read(path, numbers, labels=(), optional=()):
    """Read a CSV (or Parquet) file of readings.

    Parameters
    ----------
    path : str or Path
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
        If the file cannot be read or does not keep the format.
    """
    raw, source, _ = _read_columns(path, [*labels, *numbers])
    table = pd.DataFrame({"row": raw.index})
    for name in numbers:
        table[name] = _numbers(raw, name, source, "a number")
    for name in labels:
        table[name] = _names(raw, name, source)
    for name in [c for c in raw.columns if c not in table.columns]:
        if name in (*optional, *QUATERNION):
            table[name] = _numbers(raw, name, source, "a number or nothing", lost=True)
        else:
            table[name] = raw[name].to_numpy()
    _check_quaternions(table, source)
    table.attrs["source"] = source
    return table


def read_points(path, labels=(), numbers=(), optional=()):
    """As `read`, with the columns ``x_mm``, ``y_mm``, ``z_mm``; rows of lost points (empty or 0,0,0) are left out.

    Raises
    ------
    MeasurementError
        As `read`, or if all points are lost.
    """
    table = read(path, numbers, labels, (*POSITION, *optional))
    missing = [name for name in POSITION if name not in table.columns]
    if missing:
        raise MeasurementError(f"{table.attrs['source']}: row 1: missing column {', '.join(missing)}")
    xyz = table[POSITION].to_numpy()
    lost = pd.isna(xyz).any(axis=1) | (xyz == 0.0).all(axis=1)
    if lost.all():
        raise MeasurementError(f"{table.attrs['source']}: every point is lost")
    attrs = table.attrs | {"lost": int(lost.sum())}
    table = table[~lost].reset_index(drop=True)
    table.attrs.update(attrs)
    return table


def rotations(table):
    """Orientations of a table's rows, shape (rows, 3, 3); None without quaternion columns or with gaps in them."""
    from scipy.spatial.transform import Rotation

    if QUATERNION[0] not in table.columns or table[QUATERNION].isna().any(axis=None):
        return None
    return Rotation.from_quat(table[["qx", "qy", "qz", "qw"]].to_numpy()).as_matrix()
