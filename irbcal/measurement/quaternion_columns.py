"""Columns of orientations: unit quaternions, scalar first."""

from __future__ import annotations

import numpy as np
import pandas as pd

from irbcal.arrays import FloatArray
from irbcal.errors import MeasurementError
from irbcal.measurement.columns import QUATERNION, header_row
from irbcal.modeling import frames


def check(table: pd.DataFrame, source: str) -> None:
    """Refuse orientations that are neither whole unit quaternions nor absent; the table's are made exactly unit.

    Parameters
    ----------
    table : DataFrame
        Numbers, with the rows for messages in a column ``row``; changed in place.
    source : str
        File name for messages.

    Raises
    ------
    MeasurementError
        For the first such row, or if there are some of the four columns only.
    """
    present = [name for name in QUATERNION if name in table.columns]
    if not present:
        return
    if len(present) < 4:
        missing = ", ".join(name for name in QUATERNION if name not in present)
        raise MeasurementError(
            f"missing column {missing}; an orientation needs qw, qx, qy, qz", file=source, row=header_row(source)
        )
    q = table[QUATERNION].to_numpy()
    given = np.isfinite(q)
    norm = np.linalg.norm(np.where(given, q, 0.0), axis=1)
    bad = (given.any(axis=1) & ~given.all(axis=1)) | (given.all(axis=1) & (np.abs(norm - 1) > 1e-3))
    if bad.any():
        k = int(np.flatnonzero(bad)[0])
        numbers = ", ".join(f"{value:g}" for value in q[k])
        raise MeasurementError(
            f"expected a unit quaternion or nothing, found {numbers}",
            file=source,
            row=int(table["row"].iloc[k]),
            column=QUATERNION,
        )
    table[QUATERNION] = q / np.where(norm > 0, norm, 1.0)[:, None]


def rotations(table: pd.DataFrame) -> FloatArray | None:
    """Orientations of a table's rows, shape (rows, 3, 3), NaN where there is none; None without quaternion columns."""
    if QUATERNION[0] not in table.columns:
        return None
    return frames.matrix_from_quaternion(table[QUATERNION].to_numpy(dtype=float))
