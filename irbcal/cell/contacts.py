"""Two robots of a cell: touches of the tips of their tools, or of one socket by both, tie their bases.

In a table of touches (`irbcal.cell_frames`) the other robot's base link is a work object, and a row of kind
``contact`` touches a point of it: the tip of the other robot's ``other_tool`` at its joints ``other_q1_deg`` …::

    frame,name,point,tool,kind,other_tool,q1_deg,...,q6_deg,other_q1_deg,...,other_q6_deg

The other robot's calibration and cell file say where that tip is in its base link; their errors go on into where the
base is.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from irbcal.arrays import FloatArray, IntArray, Locked
from irbcal.cell.cell_file import TOOL, WORK_OBJECT, CellFile, cell_of
from irbcal.cell.robot_derivatives import point_derivatives
from irbcal.errors import RobotError
from irbcal.io.opening import CalibrationLike, open_calibration
from irbcal.measurement.column_names import POSITION
from irbcal.measurement.input_table import InputTable, TableLike
from irbcal.units import MM

CONTACT = "contact"


@dataclass(frozen=True, eq=False)
class Contacts(Locked):
    """Touches with the points of the other robot in place of its joints."""

    table: pd.DataFrame
    """For `irbcal.cell_frames`."""
    rows: IntArray
    """Shape (n,). Of the contacts, counted from 0."""
    covariance: FloatArray
    """Shape (3 n, 3 n). Of their points in the other robot's base link, m^2."""
    simulated: bool
    """Whether the other robot's calibration or cell is from simulated data."""


def with_contacts(touches: TableLike, other: CalibrationLike, other_cell: CellFile | str | Path) -> Contacts:
    """Touches whose contacts with another robot are points of its base link.

    Parameters
    ----------
    touches : str, Path or DataFrame
    other : str, Path, Record or a result that holds one
        Calibration of the other robot.
    other_cell : CellFile, str or Path
        With the tools of the other robot.

    Raises
    ------
    MeasurementError
        If a contact names a tool that the other cell does not have, or has no joints of the other robot.
    CalibrationError
        If a file cannot be read, or the cell is of another calibration.
    RobotError
        If nothing is known of the other robot's certainty.
    """
    record = open_calibration(other)
    robot = record.robot_calibrated()
    certainty = robot.certainty
    if certainty is None:
        raise RobotError(f"nothing is known of how certain {robot.arm.name} is: calibrate it", parameter="other")
    cell = cell_of(other_cell, record.fingerprint)
    columns = [f"other_{name}" for name in robot.arm.joint_columns]
    rows = InputTable.read(touches, ["frame", "name", "point", "kind", "other_tool", *columns])
    contact = np.flatnonzero(rows.texts("kind") == CONTACT)
    of_contacts = rows[contact]
    tools = of_contacts.filled("other_tool")
    for k, name in enumerate(tools):
        if name not in cell.tools:
            raise of_contacts.fault(f"expected a tool of the other cell, found {name!r}", k, "other_tool")
        if of_contacts.texts("frame")[k] != WORK_OBJECT:
            message = f"a {CONTACT} shows where the other robot stands: expected {WORK_OBJECT}"
            raise of_contacts.fault(message, k, "frame")
    q = robot.arm.from_controller(of_contacts.si(columns))
    tips = np.array([cell.tools[name].T_true[:3, 3] for name in tools]).reshape(-1, 3)
    points, J, variance = point_derivatives(robot, certainty, q, tips)
    T = robot.poses(q)
    by_frames = np.zeros((len(q), 3, len(cell.touch_covariance)))
    for k, name in enumerate(tools):
        at = cell.rows(TOOL, name)
        by_frames[k, :, at.start + 3 : at.stop] = T[k, :3, :3] @ cell.tools[name].T_true[:3, :3]
    by_robot = (J + by_frames @ cell.robot_gain).reshape(3 * len(q), -1)
    by_touching = by_frames.reshape(3 * len(q), -1)
    covariance = by_robot @ certainty.covariance @ by_robot.T + by_touching @ cell.touch_covariance @ by_touching.T
    table = rows.cells.drop(columns=["other_tool", *columns])
    for name, values in zip(POSITION, points.T, strict=True):
        column = table[name].astype(str) if name in table else pd.Series("", index=table.index)
        column.iloc[contact] = [repr(float(value) / MM) for value in values]
        table[name] = column
    table["kind"] = np.where(rows.texts("kind") == CONTACT, "point", rows.texts("kind"))
    return Contacts(table, contact, covariance + np.diag(np.repeat(variance, 3)), record.simulated or cell.simulated)
