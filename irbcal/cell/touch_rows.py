"""Touches as rows at features, and what they must show: see `irbcal.cell.touches` and `irbcal.measurement.features`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.cell.cell_file import FIXED_TOOL, HELD_PART, ON_FLANGE, STANDING, TOOL, Touch
from irbcal.cell.touches import SIDES, TAUGHT
from irbcal.errors import MeasurementError
from irbcal.identification.feature_problem import FeatureProblem
from irbcal.measurement.features import Feature, FeatureSet
from irbcal.modeling.arm import Arm
from irbcal.modeling.cell_graph import FLANGE, WORLD
from irbcal.modeling.terms import chain
from irbcal.units import MM
from irbcal.wording import inflected

LEAST_SIDES = 3
LEAST_TURN = 0.02
"""Root mean square of the tip link's turns about the axis it turns about least, radians: less shows no tip."""
LEAST_LENGTH = 1.0 * MM
"""Between points of a work object, and of the third from the line through the others."""
ALONE = 5
"""Points with coordinates that show a tool without rows of its own along with their work object."""


def frame_name(kind: str, name: str) -> str:
    """Name of a tool or a work object in the cell's graph of frames."""
    return f"{kind.replace('_', ' ')} {name}"


def shows_axes(touch: Touch) -> bool:
    """Whether a touch makes its frame one with axes: of tools and fixed tools only some do, of the others all."""
    if touch.frame == TOOL:
        return touch.point in SIDES
    return touch.frame != FIXED_TOOL or touch.xyz is not None or touch.point in SIDES


class _TouchRow(NamedTuple):
    """A touch at a feature; without one at a point whose coordinates in the frame are known."""

    feature: Feature | None
    target: str
    frame: str
    """In which the feature is known."""
    carrier: str
    """The frame whose point touches it."""
    xyz: FloatArray | None = None
    """Shape (3,). Coordinates in the frame, metres."""
    point: FloatArray | None = None
    """Shape (3,). The point that touches, in the carrier, metres; its origin unless given."""


def rows_of_touches(
    touches: Sequence[Touch], framed: set[str], u95: FloatArray, arm: Arm, source: str, root: str
) -> FeatureSet:
    """Touches as rows at features: frames in which these are known, and carriers whose points touch them.

    Parameters
    ----------
    touches : sequence of Touch, length n
    framed : set of str
        Names of the frames that have axes.
    u95 : ndarray, shape (n,)
        Of each touch, metres.
    arm : Arm
    source : str
        Name of the table, for messages.
    root : str
        The frame that stands still.

    Raises
    ------
    MeasurementError
        If the axes of a tool are shown at several places.
    """
    rows = [_row(touch, touches, framed, source, root) for touch in touches]
    return FeatureSet.computed(
        arm,
        q=np.array([touch.q for touch in touches]),
        pose=np.array([str(k) for k in range(len(rows))], dtype=object),
        kind=["point" if row.feature is None else row.feature.kind for row in rows],
        feature=["" if row.feature is None else row.feature.name for row in rows],
        target=[row.target for row in rows],
        u95=u95,
        features={row.feature.name: row.feature for row in rows if row.feature is not None},
        source=source,
        row=np.array([touch.row for touch in touches]),
        xyz=np.array([np.full(3, np.nan) if row.xyz is None else row.xyz for row in rows]),
        point=np.array([np.zeros(3) if row.point is None else row.point for row in rows]),
        frame=np.array([row.frame for row in rows], dtype=object),
        carrier=np.array([row.carrier for row in rows], dtype=object),
    )


def _row(touch: Touch, touches: Sequence[Touch], framed: set[str], source: str, root: str) -> _TouchRow:
    frame = frame_name(touch.frame, touch.name)
    tip = frame_name(*touch.on_flange)
    tip = tip if tip in framed else FLANGE
    if touch.tracker is not None:
        on_flange = touch.frame in ON_FLANGE
        target = touch.tool if touch.frame == TOOL else frame
        return _TouchRow(None, target, WORLD, tip if on_flange else frame, touch.tracker, touch.xyz)
    if touch.frame == HELD_PART:
        return _of_held_part(touch, frame, framed, root)
    if touch.frame == FIXED_TOOL and frame not in framed:
        return _TouchRow(Feature(frame, "point", touch.tool), touch.tool, root, tip)
    if touch.point in SIDES and touch.xyz is None:
        side = _side(touch, frame, touch.tool)
        if touch.frame in STANDING:
            return _TouchRow(side, touch.tool, frame, tip)
        points = {t.point for t in touches if _at_place(t, touch.name)}
        if len(points) != 1:
            raise MeasurementError(
                f"{frame}: its axes are shown at the place that its tip touches, of which there are {len(points)}",
                file=source,
                row=touch.row,
                column="point",
            )
        return _TouchRow(side, f"{points.pop()} of {frame}", frame, root)
    name = f"{touch.point} of {frame}"
    if touch.frame not in STANDING:
        return _TouchRow(Feature(name, touch.kind, touch.tool, touch.radius), touch.tool, root, tip)
    if touch.xyz is None and touch.point != TAUGHT[0]:
        return _TouchRow(Feature(name, "point", touch.tool), touch.tool, frame, tip)
    return _TouchRow(None, touch.tool, frame, tip, np.zeros(3) if touch.xyz is None else touch.xyz)


def _of_held_part(touch: Touch, part_name: str, framed: set[str], root: str) -> _TouchRow:
    """A point of a part that the robot brings to the tip of a fixed tool."""
    tool = frame_name(*touch.standing)
    at = tool if tool in framed else root
    if touch.point in SIDES and touch.xyz is None:
        return _TouchRow(_side(touch, part_name, tool), tool, part_name, at)
    if at == root:
        return _TouchRow(Feature(tool, "point", part_name), part_name, root, part_name, point=touch.xyz)
    return _TouchRow(None, part_name, tool, part_name, np.zeros(3), touch.xyz)


def _side(touch: Touch, frame: str, target: str) -> Feature:
    """The half-line or half-plane of a frame that a touch shows."""
    kind, axes, _ = SIDES[touch.point]
    return Feature(f"{touch.point} of {frame}", kind, target, centre=np.zeros(3), axes=axes)


def _at_place(touch: Touch, tool: str) -> bool:
    """Whether the tip of a tool touches a place of its own."""
    own_place = (touch.frame, touch.name, touch.kind) == (TOOL, tool, "point") and touch.tracker is None
    return own_place and touch.point not in SIDES


def refuse_too_few(touches: Sequence[Touch], problem: FeatureProblem, source: str) -> None:
    """Refuse tools and work objects that their rows cannot show.

    Raises
    ------
    MeasurementError
        With what is missing.
    """
    _refuse_tools(touches, problem, source)
    _refuse_fixed_tools(touches, source)
    _refuse_work_objects(touches, source)


def _refuse_tools(touches: Sequence[Touch], problem: FeatureProblem, source: str) -> None:
    T = chain.poses(problem.robot.walk(problem.motion)) if problem.robot is not None else np.zeros((0, 4, 4))
    for name in dict.fromkeys(t.tool for t in touches if t.tool and t.frame != HELD_PART):
        sides = {t.point for t in touches if t.frame == TOOL and t.name == name} & set(SIDES)
        if len(sides) == 1:
            raise MeasurementError(
                f"tool {name}: its axes take points x and xy, {(set(SIDES) - sides).pop()} is missing", file=source
            )
        of_tool = [t for t in touches if t.frame == TOOL and t.name == name and t.point not in SIDES]
        by_points = sum(t.frame in STANDING and t.tool == name and t.xyz is not None for t in touches)
        if not of_tool and by_points < ALONE:
            touch = next(t for t in touches if t.tool == name and t.frame != HELD_PART)
            raise MeasurementError(
                f"{frame_name(touch.frame, touch.name)} was touched with tool {name}, of which there are no rows: "
                f"bring the tip of that tool to one place from {LEAST_SIDES} or more sides, too",
                file=source,
                row=touch.row,
                column="tool",
            )
        if by_points >= ALONE or not all(_at_place(t, name) for t in of_tool):
            continue
        of_place = {
            point: [k for k, t in enumerate(touches) if _at_place(t, name) and t.point == point]
            for point in dict.fromkeys(t.point for t in of_tool)
        }
        for point, at in of_place.items():
            if len(at) < 2 or len(of_tool) < LEAST_SIDES:
                raise MeasurementError(
                    f"tool {name}: its tip was brought to {point!r} from {len(at)} side{'s'[: len(at) != 1]}: it takes "
                    f"{LEAST_SIDES} or more, turned about different axes (of several places, two of each)",
                    file=source,
                )
        R = np.concatenate([T[at, :3, :3] - T[at, :3, :3].mean(axis=0) for at in of_place.values()])
        if np.linalg.svd(R.reshape(-1, 3), compute_uv=False)[-1] < LEAST_TURN * np.sqrt(len(R)):
            raise MeasurementError(
                f"tool {name}: all sides are turned about one axis, along which its tip stays unknown: touch the place "
                "with the tool tilted another way, too",
                file=source,
            )


def _refuse_fixed_tools(touches: Sequence[Touch], source: str) -> None:
    for kind, name in dict.fromkeys(t.standing for t in touches if t.frame == HELD_PART and t.tool):
        at_tip = [t for t in touches if t.standing == (kind, name)]
        if len(at_tip) < LEAST_SIDES and all(t.frame == HELD_PART for t in at_tip):
            raise MeasurementError(
                f"fixed tool {name} has no rows of its own, and {len(at_tip)} of parts: bring the tip of a tool to it, "
                f"or {LEAST_SIDES} points of a part or more",
                file=source,
                row=at_tip[0].row,
                column="tool",
            )


def _refuse_work_objects(touches: Sequence[Touch], source: str) -> None:
    for kind, name in dict.fromkeys((t.frame, t.name) for t in touches if t.frame != TOOL):
        of_object = [t for t in touches if (t.frame, t.name) == (kind, name)]
        if not any(map(shows_axes, of_object)):
            continue
        title = frame_name(kind, name)
        given_points = np.array([t.xyz for t in of_object if t.xyz is not None]).reshape(-1, 3)
        if len(given_points) >= LEAST_SIDES:
            if np.linalg.svd(given_points - given_points.mean(axis=0), compute_uv=False)[1] < LEAST_LENGTH:
                raise MeasurementError(f"{title}: its points with coordinates are on a line", file=source)
            continue
        missing = [point for point in TAUGHT if point not in {t.point for t in of_object if t.xyz is None}]
        if missing:
            raise MeasurementError(
                f"{title}: {', '.join(missing)} {inflected(len(missing), 'is', 'are')} missing, and of "
                f"three or more points with x_mm, y_mm, z_mm there are {len(given_points)}: it takes one or the other",
                file=source,
            )
