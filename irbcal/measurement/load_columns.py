"""Columns of the load: the payload's mass and place, and the torques that the robot reports."""

from __future__ import annotations

import re
from collections.abc import Iterable

import numpy as np
import pandas as pd

from irbcal.arrays import BoolArray, FloatArray
from irbcal.errors import MeasurementError
from irbcal.measurement import columns
from irbcal.measurement.columns import header_row, joint_columns, listed

MASS = "payload_kg"
PLACE = ["payload_x_mm", "payload_y_mm", "payload_z_mm"]
"""Centre of the payload in the tip link."""

_TORQUE = re.compile(r"tau([1-9]\d?)_nm")


def is_torque(name: str) -> bool:
    """Whether a column is one of torques."""
    return bool(_TORQUE.fullmatch(name))


def torque_columns(names: Iterable[str], source: str) -> list[str]:
    """Columns of measured joint torques (``tau1_nm`` …) among column names, in the order of the joints; none or all.

    Raises
    ------
    MeasurementError
        If they are not for the joints of the joint columns.
    """
    names = list(names)
    present = [name for name in names if _TORQUE.fullmatch(name)]
    expected = [f"tau{k}_nm" for k in range(1, len(joint_columns(names)) + 1)]
    if not present or set(present) == set(expected):
        return expected if present else []
    wrong = [name for name in expected if name not in present] or [name for name in present if name not in expected]
    raise MeasurementError(
        f"column {wrong[0]}: torques are for all joints (tau1_nm … tau{len(expected)}_nm) or for none, found "
        f"{listed(present)}",
        file=source,
        row=header_row(source),
    )


def place_columns(names: Iterable[str], source: str) -> list[str]:
    """The columns of the payload's place, `PLACE`, where they are there; none or all.

    Raises
    ------
    MeasurementError
        If some are missing, or there is no column payload_kg.
    """
    names = list(names)
    present = [name for name in PLACE if name in names]
    missing = [name for name in (MASS, *PLACE) if name not in names]
    if present and missing:
        raise MeasurementError(
            f"missing column {missing[0]}: a payload has a mass and all three of {', '.join(PLACE)}",
            file=source,
            row=header_row(source),
        )
    return present


def payloads(cells: pd.DataFrame, source: str) -> tuple[FloatArray | None, FloatArray | None]:
    """Mass at each row (m,), kg, and its centre in the tip link (m, 3), metres; None where they are not told.

    A row without a mass has that of the others, where they all have one.

    Raises
    ------
    MeasurementError
        If there is something that is no mass or place, or it is not told which of several masses a row has.
    """
    centre_columns = place_columns(cells.columns, source)
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
