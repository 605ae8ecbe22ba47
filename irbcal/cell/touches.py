"""Touches, as a table has them: which joints bring the tip of a tool to which point of what.

One row a touch::

    frame,name,point,tool,q1_deg,...,q6_deg[,x_mm,y_mm,z_mm,u95_mm,kind,radius_mm,tracker_x_mm,tracker_y_mm,tracker_z_mm]

Rows of a ``tool`` bring its tip to places, one a ``point``, from several sides; with a ``kind`` to a ball
(``sphere``), a ``plane`` or a ``line`` of unknown place. Rows ``x`` and ``xy`` bring a point of the tool's half-line +x
and of its half-plane +y to the place that its tip touches: they show its axes. Rows of a ``work_object`` bring the tip
of ``tool`` to its ``origin``, to a point ``x`` on its half-line +x, to a point ``xy`` in its half-plane +y, or to any
point of which the coordinates in the work object are known (``x_mm`` …). A tracker that stands in the measuring frame
of the calibration may measure the tip of a tool (``tracker_x_mm`` …), or a point of a work object of known
coordinates: such rows have no joints.

Where the robot holds the part, rows of a ``fixed_tool`` bring the tip of ``tool`` to its tip (``origin``), or to points
that show its axes, too, as of a work object; rows of a ``held_part`` bring points of the part to the tip of the fixed
``tool`` (`irbcal.cell.held_parts`). Columns ``e1_mm``, ``e2_deg`` … say where external axes were
(`irbcal.cell.external_axes`). Places of tools stand on the floor; on a work object that an axis carries any point
without coordinates may be touched at several positions of the axis.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import get_args

import numpy as np
import pandas as pd

from irbcal.arrays import FloatArray
from irbcal.cell.cell_file import FIXED_TOOL, HELD_PART, ON_FLANGE, STANDING, TOOL, WORK_OBJECT, Touch, TouchKind
from irbcal.cell.external_axes import ExternalAxis
from irbcal.measurement.column_names import POSITION
from irbcal.measurement.input_table import InputTable, TableLike
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.units import MM

TEXT_COLUMNS = ("frame", "name", "point", "tool")
TOUCH_KINDS: tuple[TouchKind, ...] = get_args(TouchKind)
"""What a tip may touch, or be on."""
TRACKER = [f"tracker_{name}" for name in POSITION]
U95_BY_EYE = 0.2 * MM
"""How well a tip is brought to a point by eye, metres: for rows that do not say it."""
U95_BY_TRACKER = 0.05 * MM
"""The same of a point that a tracker measured."""
TAUGHT = ("origin", "x", "xy")
"""Points of a work object that need no coordinates, as pendants call them; the last two show a tool's axes, too."""
SIDES: Mapping[str, tuple[str, FloatArray, int]] = {
    "x": ("line", frames.with_third(np.array([1.0, 0.0, 0.0])), 0),
    "xy": ("plane", np.eye(3), 1),
}
"""Of points on a half-line or in a half-plane of a frame: kind, axes, and the coordinate that must be positive."""


def read_touches(table: TableLike, arm: Arm, axes: Sequence[ExternalAxis] = ()) -> tuple[list[Touch], str]:
    """Read touches.

    Parameters
    ----------
    table : str, Path or DataFrame
    arm : Arm
        Whose joints they are.
    axes : sequence of ExternalAxis, optional
        Whose columns every row has.

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
    if isinstance(table, pd.DataFrame) and "tool" in table.columns:
        # pandas reads numbers beside empty cells as 3.0
        table = table.assign(tool=table["tool"].convert_dtypes())
    external = [axis.column for axis in axes]
    known = (*TEXT_COLUMNS, *joints, *external, *POSITION, "u95_mm", "kind", "radius_mm", *TRACKER)
    rows = InputTable.read(table, ["frame", "name", "point", *joints, *external], known)
    e = rows.si(external) if axes else np.zeros((len(rows), 0))
    positions, tracked = (np.column_stack([rows.optional(name) for name in names]) for names in (POSITION, TRACKER))
    u95s, radii, texts = (
        rows.optional("u95_mm"),
        rows.optional("radius_mm"),
        [rows.filled(name) for name in TEXT_COLUMNS[:3]],
    )
    tools, kinds = rows.texts("tool"), rows.texts("kind")
    kinds = np.where(kinds == "", "point", kinds)
    at_rest = np.isfinite(tracked).all(axis=1) & np.isin(texts[0], STANDING)
    at_rest &= rows.cells[joints].astype(str).apply(lambda column: column.str.strip() == "").all(axis=1).to_numpy()
    cells = rows.cells.copy()
    cells.loc[at_rest, joints] = "0"
    q = arm.from_controller(InputTable(cells, rows.source).si(joints))
    touches = []
    for k, (frame, name, point) in enumerate(zip(*texts, strict=True)):
        tool, kind = tools[k], kinds[k]
        counts = int(np.isfinite(positions[k]).sum()), int(np.isfinite(tracked[k]).sum())
        point = point[1:] if frame == TOOL and point == "+x" else point
        carried = any(name.lower() in axis.carries for axis in axes)
        fault = _fault(frame, name, point, tool, kind, counts, bool(at_rest[k]), carried)
        if fault is not None:
            raise rows.fault(fault[1], k, fault[0])
        touches.append(
            Touch(
                int(rows.rows[k]),
                frame,
                name,
                point,
                name if frame == TOOL else tool,
                q[k],
                (U95_BY_TRACKER if counts[1] else U95_BY_EYE) if np.isnan(u95s[k]) else float(u95s[k]),
                positions[k] if counts[0] else None,
                kind=kind,
                radius=None if np.isnan(radii[k]) else float(radii[k]),
                tracker=tracked[k] if counts[1] else None,
                axis_positions=e[k],
            )
        )
    kinds_of: dict[tuple[bool, str], str] = {}
    for k, touch in enumerate(touches):
        for kind, name in (touch.on_flange, touch.standing):
            if name and kinds_of.setdefault((kind in ON_FLANGE, name.lower()), kind) != kind:
                both = " and ".join(
                    word.replace("_", " ") for word in (kinds_of[kind in ON_FLANGE, name.lower()], kind)
                )
                raise rows.fault(f"{name} is the name of a {both}: give them different names", k, "name")
    return touches, rows.source


def _fault(
    frame: str, name: str, point: str, tool: str, kind: str, counts: tuple[int, int], at_rest: bool, carried: bool
) -> tuple[str | list[str], str] | None:
    """Column and sentence where a row is no touch; ``counts`` of coordinates known in the work object, and measured.

    ``carried``: whether an external axis carries the work object.
    """
    with_coordinates, tracked = counts
    stands, title = frame in STANDING, frame.replace("_", " ")
    if frame not in (*ON_FLANGE, *STANDING):
        return "frame", f"expected {', '.join((TOOL, WORK_OBJECT, HELD_PART))} or {FIXED_TOOL}, found {frame!r}"
    if carried and frame == FIXED_TOOL:
        return "frame", "a fixed tool stands still, this one is carried by an external axis: name it a work object"
    if with_coordinates not in (0, 3):
        return POSITION, f"expected the point's coordinates in the {title}, all or none"
    if tracked not in (0, 3):
        return TRACKER, "expected the point's coordinates in the measuring frame of the calibration, all or none"
    if kind not in TOUCH_KINDS:
        return "kind", f"expected {', '.join(TOUCH_KINDS)}, found {kind!r}"
    if kind != "point" and (frame != TOOL or tracked or point in SIDES):
        return "kind", f"a {kind} shows the tip of a tool: expected a row of a tool that touches it, nothing else"
    if frame == TOOL and with_coordinates:
        return POSITION, "coordinates belong to points of a work object, the place that a tool touches has none"
    if frame == TOOL and tool not in ("", name):
        return "tool", f"a row of tool {name} is touched with this tool, found {tool!r}"
    if frame != TOOL and tracked:
        if not with_coordinates:
            return POSITION, f"a point that the tracker measured needs its coordinates in the {title}"
        if stands and not at_rest:
            return "tool", "no tool touches a point that the tracker measured: leave the joints out"
        return None
    if frame == HELD_PART and not tool:
        return "tool", f"expected the fixed tool that held part {name} was brought to, found nothing"
    if stands and not tool:
        return "tool", f"expected the tool that touched {title} {name}, found nothing"
    if frame != TOOL and not with_coordinates and point not in TAUGHT and not carried:
        return "point", f"expected {', '.join(TAUGHT)}, or x_mm, y_mm and z_mm of the point, found {point!r} without"
    return None
