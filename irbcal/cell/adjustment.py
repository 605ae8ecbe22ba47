"""Least squares for tools and work objects: residuals of touches, their derivatives, and what the touches leave open.

Unknown are the tip ``p`` of each tool (in the tip link), each place ``x`` that a tool touches (in the base link) and
each work object ``T_b_o``. A touch at joints q, the tip link being at ``T_b_f(q)``, says one of::

    T_b_f p - x = 0                     a place of a tool
    T_b_o^-1 T_b_f p - c = 0            a point of a work object: c from CAD, or 0 for its origin
    y, z of T_b_o^-1 T_b_f p are 0      x: a point on the half-line +x
    z of it is 0                        xy: a point in the half-plane +y

All touches are adjusted together, so that an error of a tool goes on into the work objects touched with it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from irbcal.arrays import FloatArray, IntArray, lock
from irbcal.cell.cell_file import TOOL, WORK_OBJECT, Touch
from irbcal.cell.touches import TAUGHT
from irbcal.errors import MeasurementError
from irbcal.modeling import frames
from irbcal.units import MM

ITERATIONS = 50
ENOUGH = 1e-14
"""Radians and metres: a smaller step ends the iteration."""
LEAST_SIDES = 3
LEAST_TURN = 0.02
"""Root mean square of the tip link's turns about the axis it turns about least, radians: less shows no tip."""
LEAST_LENGTH = 1.0 * MM
"""Between points of a work object, and of the third from the line through the others."""
COMPONENTS: dict[str, tuple[int, ...]] = {"x": (1, 2), "xy": (2,)}
"""Components of a point in the work object that are zero, where not all three are."""


@dataclass(frozen=True, eq=False)
class Adjusted:
    """Tools and work objects by one robot.

    Attributes
    ----------
    tips : dict of str to ndarray, shape (3,)
        Of tools, in the tip link, metres.
    work_objects : dict of str to ndarray, shape (4, 4)
        In the base link.
    residual : ndarray, shape (touches, 3)
        In the base link, metres; zero in directions in which a touch says nothing.
    jacobian : ndarray, shape (equations, unknowns)
        Of residuals by the unknowns: tips, places, then small motions of the work objects (in their own axes).
    touch, component : ndarray of int, shape (equations,)
        Which touch, and which component of its residual.
    axes : ndarray, shape (touches, 3, 3)
        From the base link to the axes in which the components are: the base link's, or a work object's.
    """

    tips: Mapping[str, FloatArray]
    work_objects: Mapping[str, FloatArray]
    residual: FloatArray
    jacobian: FloatArray
    touch: IntArray
    component: IntArray
    axes: FloatArray

    def __post_init__(self) -> None:
        lock(self)

    @property
    def values(self) -> FloatArray:
        """Residuals of the equations, shape (equations,), metres."""
        return np.asarray(np.einsum("nij,nj->ni", self.axes, self.residual)[self.touch, self.component])

    @property
    def redundancy(self) -> int:
        """Equations less unknowns."""
        return self.jacobian.shape[0] - self.jacobian.shape[1]

    def columns(self, frame: str, name: str) -> slice:
        """Columns of a tip (three) or of a work object (six) in the Jacobian."""
        if frame == TOOL:
            start = 3 * list(self.tips).index(name)
            return slice(start, start + 3)
        start = self.jacobian.shape[1] - 6 * len(self.work_objects) + 6 * list(self.work_objects).index(name)
        return slice(start, start + 6)


def adjust(touches: Sequence[Touch], T_base_tip: FloatArray, sigma: FloatArray, source: str) -> Adjusted:
    """Adjust tools and work objects to touches.

    Parameters
    ----------
    touches : sequence of Touch, length n
    T_base_tip : ndarray, shape (n, 4, 4)
        By the robot that is asked, metres.
    sigma : ndarray, shape (n,)
        Standard deviation of each touch in each direction, metres.
    source : str
        Name of the table, for messages.

    Returns
    -------
    Adjusted

    Raises
    ------
    MeasurementError
        If the touches do not determine a tool or a work object: the sentence says what is missing.
    """
    tools = list(dict.fromkeys(one.name for one in touches if one.frame == TOOL))
    objects = list(dict.fromkeys(one.name for one in touches if one.frame == WORK_OBJECT))
    places = list(dict.fromkeys((one.name, one.point) for one in touches if one.frame == TOOL))
    tips: dict[str, FloatArray] = {}
    x: dict[tuple[str, str], FloatArray] = {}
    for name in tools:
        tips[name], more = _first_tip(name, touches, T_base_tip, source)
        x |= more
    T: dict[str, FloatArray] = {}
    for name in objects:
        T[name] = _first_frame(name, touches, T_base_tip, tips, source)
    for _ in range(ITERATIONS):
        found = _linearised(touches, T_base_tip, tips, x, T)
        weight = 1.0 / sigma[found.touch]
        step = np.linalg.lstsq(found.jacobian * weight[:, None], -found.values * weight, rcond=None)[0]
        for k, name in enumerate(tools):
            tips[name] = tips[name] + step[3 * k : 3 * k + 3]
        for k, place in enumerate(places, len(tools)):
            x[place] = x[place] + step[3 * k : 3 * k + 3]
        for name in objects:
            motion = step[found.columns(WORK_OBJECT, name)]
            T[name] = T[name] @ frames.transform(frames.rotation_from_vector(motion[:3]), motion[3:])
        if np.abs(step).max(initial=0.0) < ENOUGH:
            break
    found = _linearised(touches, T_base_tip, tips, x, T)
    _check_sides(touches, T_base_tip, found, source)
    return found


def _linearised(
    touches: Sequence[Touch],
    T_base_tip: FloatArray,
    tips: Mapping[str, FloatArray],
    x: Mapping[tuple[str, str], FloatArray],
    T: Mapping[str, FloatArray],
) -> Adjusted:
    """Residuals and their derivatives."""
    at_tool = {name: 3 * k for k, name in enumerate(tips)}
    at_place = {place: 3 * k for k, place in enumerate(x, len(tips))}
    at_object = {name: 3 * (len(tips) + len(x)) + 6 * k for k, name in enumerate(T)}
    unknowns = 3 * (len(tips) + len(x)) + 6 * len(T)
    residual, axes = np.zeros((len(touches), 3)), np.tile(np.eye(3), (len(touches), 1, 1))
    rows: list[FloatArray] = []
    touch: list[int] = []
    component: list[int] = []
    for k, one in enumerate(touches):
        R, p = T_base_tip[k, :3, :3], tips[one.tool]
        tip = R @ p + T_base_tip[k, :3, 3]
        J = np.zeros((3, unknowns))
        said = (0, 1, 2) if one.xyz is not None else COMPONENTS.get(one.point, (0, 1, 2))
        if one.frame == TOOL:
            place, said = (one.name, one.point), (0, 1, 2)
            value, axis = tip - x[place], np.eye(3)
            J[:, at_place[place] : at_place[place] + 3] = -np.eye(3)
        else:
            axis = T[one.name][:3, :3].T
            c = axis @ (tip - T[one.name][:3, 3])
            value = c - (np.zeros(3) if one.xyz is None else one.xyz)
            at = at_object[one.name]
            J[:, at : at + 3] = [[0, -c[2], c[1]], [c[2], 0, -c[0]], [-c[1], c[0], 0]]
            J[:, at + 3 : at + 6] = -np.eye(3)
        J[:, at_tool[one.tool] : at_tool[one.tool] + 3] = axis @ R
        axes[k] = axis
        residual[k] = axis[list(said)].T @ value[list(said)]
        rows.append(J[list(said)])
        touch += [k] * len(said)
        component += said
    return Adjusted(dict(tips), dict(T), residual, np.concatenate(rows), np.array(touch), np.array(component), axes)


def _first_tip(
    name: str, touches: Sequence[Touch], T_base_tip: FloatArray, source: str
) -> tuple[FloatArray, dict[tuple[str, str], FloatArray]]:
    """The tip of a tool by its own rows, and the places that it touched: linear least squares."""
    mine: dict[str, list[int]] = {
        point: [] for point in dict.fromkeys(t.point for t in touches if (t.frame, t.name) == (TOOL, name))
    }
    for k, one in enumerate(touches):
        if (one.frame, one.name) == (TOOL, name):
            mine[one.point].append(k)
    for point, rows in mine.items():
        if len(rows) < 2 or sum(map(len, mine.values())) < LEAST_SIDES:
            raise MeasurementError(
                f"tool {name}: its tip was brought to {point!r} from {len(rows)} side{'s'[: len(rows) != 1]}: it takes "
                f"{LEAST_SIDES} or more, turned about different axes (of several places, two of each)",
                file=source,
            )
    R = np.concatenate([T_base_tip[rows, :3, :3] - T_base_tip[rows, :3, :3].mean(axis=0) for rows in mine.values()])
    t = np.concatenate([T_base_tip[rows, :3, 3] - T_base_tip[rows, :3, 3].mean(axis=0) for rows in mine.values()])
    if np.linalg.svd(R.reshape(-1, 3), compute_uv=False)[-1] < LEAST_TURN * np.sqrt(len(R)):
        raise MeasurementError(
            f"tool {name}: all sides are turned about one axis, along which its tip stays unknown: touch the place "
            "with the tool tilted another way, too",
            file=source,
        )
    p: FloatArray = np.linalg.lstsq(R.reshape(-1, 3), -t.reshape(-1), rcond=None)[0]
    places = {
        (name, point): (T_base_tip[rows, :3, :3] @ p + T_base_tip[rows, :3, 3]).mean(axis=0)
        for point, rows in mine.items()
    }
    return p, places


def _first_frame(
    name: str, touches: Sequence[Touch], T_base_tip: FloatArray, tips: Mapping[str, FloatArray], source: str
) -> FloatArray:
    """A work object by its points: those with coordinates, else origin, x and xy."""
    known: list[tuple[FloatArray, FloatArray]] = []
    taught: dict[str, FloatArray] = {}
    for k, one in enumerate(touches):
        if (one.frame, one.name) != (WORK_OBJECT, name):
            continue
        if one.tool not in tips:
            raise MeasurementError(
                f"work object {name} was touched with tool {one.tool}, of which there are no rows: bring the tip of "
                f"that tool to one place from {LEAST_SIDES} or more sides, too",
                file=source,
                row=one.row,
                column="tool",
            )
        tip = T_base_tip[k, :3, :3] @ tips[one.tool] + T_base_tip[k, :3, 3]
        if one.xyz is None:
            taught.setdefault(one.point, tip)
        else:
            known.append((one.xyz, tip))
    if len(known) >= 3:
        c, tip = (np.array(part) for part in zip(*known, strict=True))
        if np.linalg.svd(c - c.mean(axis=0), compute_uv=False)[1] < LEAST_LENGTH:
            raise MeasurementError(f"work object {name}: its points with coordinates are on a line", file=source)
        return frames.rigid_fit(c, tip)
    missing = [point for point in TAUGHT if point not in taught]
    if missing:
        raise MeasurementError(
            f"work object {name}: {', '.join(missing)} {'is' if len(missing) == 1 else 'are'} missing, and of three or "
            f"more points with x_mm, y_mm, z_mm there are {len(known)}: it takes one or the other",
            file=source,
        )
    origin, along, over = (taught[point] for point in TAUGHT)
    length = float(np.linalg.norm(along - origin))
    x = (along - origin) / max(length, 1e-12)
    normal = np.cross(x, over - origin)
    if min(length, float(np.linalg.norm(normal))) < LEAST_LENGTH:
        raise MeasurementError(f"work object {name}: origin, x and xy are on a line", file=source)
    z = normal / np.linalg.norm(normal)
    return frames.transform(np.column_stack([x, np.cross(z, x), z]), origin)


def _check_sides(touches: Sequence[Touch], T_base_tip: FloatArray, found: Adjusted, source: str) -> None:
    """Refuse points that the adjustment put on the wrong side of the origin."""
    for k, one in enumerate(touches):
        if one.frame == TOOL or one.xyz is not None or one.point not in COMPONENTS:
            continue
        tip = T_base_tip[k, :3, :3] @ found.tips[one.tool] + T_base_tip[k, :3, 3]
        c = frames.apply(frames.inverse(found.work_objects[one.name]), tip[None])[0]
        if c[0 if one.point == "x" else 1] <= 0.0:
            raise MeasurementError(
                f"work object {one.name}: point {one.point} lies on the negative side of the frame by the other points",
                file=source,
                row=one.row,
                column="point",
            )
