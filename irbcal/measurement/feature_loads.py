"""What the robot carried at rows of features: mass and its place, in the columns that tracker files have."""

from __future__ import annotations

import numpy as np
import pandas as pd

from irbcal.arrays import BoolArray, FloatArray
from irbcal.errors import MeasurementError
from irbcal.measurement import columns, load_columns
from irbcal.measurement.load_columns import MASS, PLACE


def payloads(cells: pd.DataFrame, source: str) -> tuple[FloatArray | None, FloatArray | None]:
    """Mass at each row (m,), kg, and its centre in the tip link (m, 3), metres; None where they are not told.

    A row without a mass has that of the others, where they all have one.

    Raises
    ------
    MeasurementError
        If there is something that is no mass or place, or it is not told which of several masses a row has.
    """
    centre_columns = load_columns.place_columns(cells.columns, source)
    if MASS not in cells.columns:
        return None, None
    load = np.array(columns.numbers(cells, MASS, source, lost=True))
    known = np.unique(load[np.isfinite(load)])
    gaps = np.flatnonzero(~np.isfinite(load))
    if not len(known):
        return None, None
    if len(gaps) and len(known) > 1:
        raise MeasurementError(
            f"expected a mass, others carry {known[0]:g} to {known[-1]:g} kg: write 0 for a bare flange; found nothing",
            file=source,
            row=int(cells.index[gaps[0]]),
            column=MASS,
        )
    load[gaps] = known[0]
    if not centre_columns:
        return load, None
    centres = columns.in_si(cells, PLACE, source, lost=True)
    lost: BoolArray = np.asarray(~np.isfinite(centres).all(axis=1))
    bad = np.flatnonzero(lost & (load > 0.0))
    if len(bad):
        row = int(cells.index[bad[0]])
        raise MeasurementError(
            "expected the place of the payload, found nothing", file=source, row=row, column=PLACE[0]
        )
    return load, np.where(lost[:, None], 0.0, centres)


def usual_place(load: FloatArray, centre: FloatArray | None, usual_kg: float | None) -> tuple[float, float, float]:
    """Centre of the payload that counts where none is told: that of the usual load, else of the heaviest."""
    if centre is None:
        return 0.0, 0.0, 0.0
    usual = np.flatnonzero((load == usual_kg) & (load > 0.0))
    x, y, z = centre[usual[-1] if len(usual) else int(np.argmax(load))].tolist()
    return x, y, z
