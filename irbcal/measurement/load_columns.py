"""Columns of the load: the payload's mass and place, and the torques that the robot reports."""

from __future__ import annotations

import re
from collections.abc import Iterable

from irbcal.errors import MeasurementError
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
