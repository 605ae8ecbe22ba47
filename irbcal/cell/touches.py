"""Touches of a cell: which joints bring the tip of a tool to which point of what.

One row a touch::

    frame,name,point,tool,q1_deg,...,q6_deg[,x_mm,y_mm,z_mm,u95_mm]

Rows of a ``tool`` bring its tip to places, one a ``point``, from several sides. Rows of a ``work_object`` bring the tip
of ``tool`` to its ``origin``, to a point ``x`` on its half-line +x, to a point ``xy`` in its half-plane +y, or to any
point of which the coordinates in the work object are known (``x_mm``, ``y_mm``, ``z_mm``).
"""

from __future__ import annotations

import pandas as pd

from irbcal.cell.cell_file import TOOL, WORK_OBJECT, Touch
from irbcal.errors import MeasurementError
from irbcal.measurement import columns
from irbcal.measurement.columns import POSITION, POSITION_BOUNDS, TableLike
from irbcal.modeling.arm import Arm
from irbcal.units import MM

TEXT = ("frame", "name", "point", "tool")
U95_BY_EYE = 0.2 * MM
"""How well a tip is brought to a point by eye, metres: for rows that do not say it."""
TAUGHT = ("origin", "x", "xy")
"""Points of a work object that need no coordinates, as pendants call them."""


def read_touches(table: TableLike, arm: Arm) -> tuple[list[Touch], str]:
    """Read touches.

    Parameters
    ----------
    table : str, Path or DataFrame
    arm : Arm
        Whose joints they are.

    Returns
    -------
    touches : list of Touch
    source : str
        Name of the table for messages.

    Raises
    ------
    MeasurementError
        If the table cannot be read or does not keep the format.
    """
    joints = arm.joint_columns
    cells, source, _ = columns.read(table, ["frame", "name", "point", *joints])
    known = (*TEXT, *joints, *POSITION, "u95_mm")
    strange = [str(name) for name in cells.columns if name not in known]
    if strange:
        raise MeasurementError(
            f"there is a column {strange[0]}: touches have the columns {', '.join(known)}",
            file=source,
            row=columns.header_row(source),
        )
    values = pd.DataFrame({"row": cells.index})
    for name in joints:
        values[name] = columns.numbers(cells, name, source, columns.expected_joint(name))
    for name in (*POSITION, "u95_mm"):
        there = name in cells.columns
        values[name] = (
            columns.numbers(cells, name, source, "a length in mm or nothing", True) if there else float("nan")
        )
    columns.check_joint_sizes(values, joints, source)
    columns.refuse_outside(
        values, [*POSITION_BOUNDS, ("u95_mm", 1e-6, 100.0, "an uncertainty above zero in mm")], source
    )
    q = arm.from_controller(values[joints].to_numpy() * columns.joint_units(joints))
    texts = [columns.names(cells, name, source) for name in TEXT[:3]]
    tools = cells["tool"].astype(str).str.strip() if "tool" in cells.columns else pd.Series("", index=cells.index)
    if tools.ne("").any():
        columns.names(cells[tools.ne("")], "tool", source)
    touches = []
    for k, (frame, name, point) in enumerate(zip(*texts, strict=True)):
        row, tool = int(cells.index[k]), tools.iloc[k]
        xyz = values.loc[k, POSITION].to_numpy(dtype=float)
        known_xyz = int(pd.notna(xyz).sum())
        fault = _fault(frame, name, point, tool, known_xyz)
        if fault is not None:
            raise MeasurementError(fault[1], file=source, row=row, column=fault[0])
        u95 = float(values.loc[k, "u95_mm"])
        touches.append(
            Touch(
                row,
                frame,
                name,
                point,
                name if frame == TOOL else tool,
                q[k],
                U95_BY_EYE if u95 != u95 else u95 * MM,
                xyz * MM if known_xyz else None,
            )
        )
    return touches, source


def _fault(frame: str, name: str, point: str, tool: str, known: int) -> tuple[str | list[str], str] | None:
    """Column and sentence where a row is no touch."""
    if frame not in (TOOL, WORK_OBJECT):
        return "frame", f"expected {TOOL} or {WORK_OBJECT}, found {frame!r}"
    if known not in (0, 3):
        return POSITION, "expected the point's coordinates in the work object, all or none"
    if frame == TOOL and known:
        return POSITION, "coordinates belong to points of a work object, the place that a tool touches has none"
    if frame == TOOL and tool not in ("", name):
        return "tool", f"a row of tool {name} is touched with this tool, found {tool!r}"
    if frame == WORK_OBJECT and not tool:
        return "tool", f"expected the tool that touched work object {name}, found nothing"
    if frame == WORK_OBJECT and not known and point not in TAUGHT:
        return "point", f"expected {', '.join(TAUGHT)}, or x_mm, y_mm and z_mm of the point, found {point!r} without"
    return None
