"""External axes of a cell: a track or gantry under the robot, positioners and conveyors under work objects.

Each axis is an edge of the cell's graph of frames (`irbcal.modeling.cell_graph`), at zero of all axes the identity. An
axis that carries what an axis before it carries, too, stands on that one.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import ConfigDict, Field

from irbcal.arrays import FloatArray, Locked
from irbcal.measurement.column_names import POSITION
from irbcal.measurement.input_table import InputTable, TableLike
from irbcal.modeling import cell_graph, frames
from irbcal.modeling.cell_graph import BASE, FLOOR, Edge
from irbcal.section import Name, Numbers
from irbcal.units import joint_unit

ROBOT = "robot"
"""What a track carries."""
DIRECTION = ("dx", "dy", "dz")
COLUMN = re.compile(r"e[1-6]_(mm|deg)")


@dataclass(frozen=True, eq=False)
class ExternalAxis(Locked):
    """An external axis."""

    __pydantic_config__ = ConfigDict(extra="forbid")

    column: Annotated[str, Field(alias="axis", pattern=f"^{COLUMN.pattern}$")]
    """``e1_mm`` … of sliding axes, ``e1_deg`` … of turning ones: its column in tables."""
    carries: tuple[Name, ...]
    """``robot``, or names of work objects in lower case."""
    screw: Annotated[FloatArray, Numbers(6), Field(alias="screw_rad_m")]
    """Shape (6,). Turn and shift by one radian (metre), in the base link at zero of all axes."""
    nominal: Annotated[FloatArray, Numbers(6), Field(alias="nominal_rad_m")]
    """Shape (6,). Likewise, as the controller has it."""

    @property
    def name(self) -> str:
        """``e1`` …, as programs number them."""
        return self.column.partition("_")[0]

    @property
    def slides(self) -> bool:
        """Whether it slides; else it turns."""
        return self.column.endswith("mm")

    @property
    def unit(self) -> float:
        """Of its column, SI."""
        return joint_unit(self.slides)[1]

    def departure(self, e: FloatArray, point: FloatArray) -> tuple[float, float]:
        """Largest turn (radians) and shift of a point (3,) in the base link (metres) against the controller's axis."""
        T = frames.inverse(cell_graph.screw_motion(self.nominal, e)) @ cell_graph.screw_motion(self.screw, e)
        turns = frames.rotation_distance(T[:, :3, :3], np.eye(3))
        shift = T[:, :3, :3] @ point + T[:, :3, 3] - point
        return float(turns.max()), float(np.linalg.norm(shift, axis=1).max())


def read_axes(table: TableLike) -> tuple[ExternalAxis, ...]:
    """Read external axes as the controller has them.

    Parameters
    ----------
    table : str, Path or DataFrame
        A row for each: ``axis`` (``e1_mm`` …), ``carries`` (``robot``, or work objects with blanks between), ``dx``,
        ``dy``, ``dz`` (direction) and, of axes that turn, ``x_mm``, ``y_mm``, ``z_mm`` (a point on it), in the base
        link at zero of all axes.

    Raises
    ------
    MeasurementError
        If it cannot be read or does not keep the format.
    """
    rows = InputTable.read(table, ["axis", "carries", *DIRECTION], ["axis", "carries", *DIRECTION, *POSITION])
    columns, carried = rows.filled("axis"), rows.filled("carries")
    rows.refuse_repeats("axis", columns)
    directions = np.column_stack([rows.numbers(name) for name in DIRECTION])
    points = np.column_stack([rows.optional(name) for name in POSITION])
    out = []
    for k, (column, text) in enumerate(zip(columns, carried, strict=True)):
        if COLUMN.fullmatch(column) is None:
            raise rows.fault(f"expected e1_mm … e6_mm or e1_deg … e6_deg, found {column!r}", k, "axis")
        length = float(np.linalg.norm(directions[k]))
        if not length > 0.0:
            raise rows.fault("expected the direction of the axis, found a length of zero", k, [*DIRECTION])
        along, slides = directions[k] / length, column.endswith("mm")
        if not slides and not np.isfinite(points[k]).all():
            raise rows.fault(f"{column} turns: expected a point on it", k, [*POSITION])
        screw = np.r_[np.zeros(3), along] if slides else np.r_[along, frames.cross(points[k], along)]
        out.append(ExternalAxis(column, tuple(text.lower().split()), screw, screw))
    return tuple(out)


def edges(axes: Sequence[ExternalAxis], e: FloatArray, nominal: bool = False) -> list[Edge]:
    """Edges of the axes at positions e, shape (rows, axes), radians (metres)."""
    tracks = [axis for axis in axes if ROBOT in axis.carries]
    out = []
    for k, axis in enumerate(axes):
        child = BASE if tracks and axis is tracks[-1] else axis.column
        parent = _under(axes[:k], axis.carries) or root(axes)
        out.append(Edge(parent, child, screw=axis.nominal if nominal else axis.screw, e=e[:, k]))
    return out


def root(axes: Sequence[ExternalAxis]) -> str:
    """The frame that stands still: `FLOOR` where a track carries the robot, else `BASE`."""
    return FLOOR if any(ROBOT in axis.carries for axis in axes) else BASE


def stand(axes: Sequence[ExternalAxis], work_object: str) -> str:
    """The frame in which a work object stands."""
    return _under(axes, (work_object.lower(),)) or root(axes)


def _under(axes: Sequence[ExternalAxis], carried: Sequence[str]) -> str | None:
    return next((axis.column for axis in reversed(axes) if set(carried) <= set(axis.carries)), None)


def moving(axes: Sequence[ExternalAxis], work_object: str | None) -> list[ExternalAxis]:
    """The axes that move the robot, or a work object."""
    return [axis for axis in axes if {ROBOT, (work_object or "").lower()} & set(axis.carries)]


def carried(
    axes: Sequence[ExternalAxis], work_object: str, e: Mapping[str, float], nominal: bool = False
) -> FloatArray:
    """How axes move a work object in the base link against where it is at zero, (4, 4), metres.

    Parameters
    ----------
    axes : sequence of ExternalAxis
    work_object : str
    e : dict of str to float
        Positions by the names of axes, in the units of their columns; axes that do not matter may be missing.
    nominal : bool
        Whether as the controller has it.
    """
    row = np.array([[e.get(axis.name, 0.0) * axis.unit for axis in axes]])
    joined = edges(axes, row, nominal)
    transforms = {edge.child: edge.at(None) for edge in joined}
    return cell_graph.view(joined, transforms, BASE, stand(axes, work_object), 1).T[0]
