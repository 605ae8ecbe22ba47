"""Tools and work objects of a cell, computed with the calibrated robot from touches, with what is known of them.

One row a touch: which joints bring the tip of a tool to which point of what::

    frame,name,point,tool,q1_deg,...,q6_deg[,x_mm,y_mm,z_mm,u95_mm]

Rows of a ``tool`` bring its tip to places, one a ``point``, from several sides. Rows of a ``work_object`` bring the tip
of ``tool`` to its ``origin``, to a point ``x`` on its half-line +x, to a point ``xy`` in its half-plane +y, or to any
point of which the coordinates in the work object are known (``x_mm``, ``y_mm``, ``z_mm``).

Unknown are the tip ``p`` of each tool (in the tip link), each place ``x`` that a tool touches (in the base link) and
each work object ``T_b_o``. A touch at joints q, the tip link being at ``T_b_f(q)``, says one of::

    T_b_f p - x = 0                     a place of a tool
    T_b_o^-1 T_b_f p - c = 0            a point of a work object: c from CAD, or 0 for its origin
    y, z of T_b_o^-1 T_b_f p are 0      x: a point on the half-line +x
    z of it is 0                        xy: a point in the half-plane +y

All touches are adjusted together by least squares, so that an error of a tool goes on into the work objects touched
with it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, IntArray, lock
from irbcal.cell.cell_file import TOOL, WORK_OBJECT, CellFile, FrameInCell, Touch, frames_by_name
from irbcal.errors import MeasurementError, OptionError, RobotError
from irbcal.io.opening import CalibrationLike, open_calibration
from irbcal.measurement import columns
from irbcal.measurement.columns import POSITION, TableLike
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.certainty import COVERAGE, HISTORY, Certainty
from irbcal.modeling.robot import Robot, loaded
from irbcal.modeling.terms.situation import Motion
from irbcal.overwriting import refuse_overwriting
from irbcal.units import MM

ITERATIONS = 50
ENOUGH = 1e-12
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
    if isinstance(table, pd.DataFrame) and "tool" in table.columns:
        # pandas reads numbers beside empty cells as 3.0
        table = table.assign(tool=table["tool"].convert_dtypes())
    cells, source, _ = columns.read(table, ["frame", "name", "point", *joints])
    known = (*TEXT, *joints, *POSITION, "u95_mm")
    strange = [str(name) for name in cells.columns if name not in known]
    if strange:
        raise MeasurementError(
            f"there is a column {strange[0]}: touches have the columns {', '.join(known)}",
            file=source,
            row=columns.header_row(source),
        )
    lengths = (*POSITION, "u95_mm")
    values = pd.DataFrame(
        {name: columns.numbers(cells, name, source, lost=True) if name in cells else np.nan for name in lengths},
        index=range(len(cells)),
    )
    q = arm.from_controller(columns.in_si(cells, joints, source))
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


OUTLIER = 6.3e-5
"""Chance of a touch as far away as this among good ones: four standard deviations of one coordinate."""
DOUBTFUL = 1e-3
"""Chance of touches that scatter so much with the uncertainty that they are said to have."""
MOST_OUTLIERS = 5
"""One touch of so many may be left out."""
SHOWN = 1e-3
"""Share of a touch's variance below which its residual shows nothing."""


def cell_frames(
    calibration: CalibrationLike,
    touches: TableLike,
    out: str | PathLike[str] | None = None,
    *,
    tool: Mapping[str, ArrayLike] | None = None,
    wobj: Mapping[str, ArrayLike] | None = None,
    payload: float | None = None,
    payload_place: ArrayLike | None = None,
) -> CellFile:
    """Tools and work objects by the calibrated robot, from touches.

    Parameters
    ----------
    calibration : str, Path, Record or a result that holds one
    touches : str, Path or DataFrame
        Touches, a row each, as this module's docstring says.
    out : str or Path, optional
        File to write, ``cell.json``.
    tool, wobj : dict of str to array_like, shape (4, 4), optional
        What the controller has, metres: a tool in the tip link, a work object in the base link. A tool that is taught
        by its tip alone has the axes that the controller has.
    payload : float, optional
        Mass carried at the touches, kg.
    payload_place : array_like, shape (3,), optional
        Its centre in the tip link, metres.

    Returns
    -------
    CellFile

    Raises
    ------
    MeasurementError
        If the table cannot be read, or does not determine a tool or a work object.
    CalibrationError
        If the calibration is not whole, or the file cannot be written.
    OptionError
        If the controller's frames are no transforms, or of names that no row has.
    RobotError
        If nothing is known of the robot's certainty, or of the payload.
    """
    refuse_overwriting({"out": out}, [touches] if isinstance(touches, (str, PathLike)) else [], calibration)
    record = open_calibration(calibration)
    robot = loaded(record.robot_calibrated(), payload, payload_place)
    certainty = robot.certainty
    if certainty is None:
        raise RobotError(f"nothing is known of how certain {robot.arm.name} is: calibrate it", parameter="calibration")
    nominal = Robot(record.arm(calibrated=False))
    rows, source = read_touches(touches, nominal.arm)
    theirs = {TOOL: _given(tool, "tool", TOOL, rows), WORK_OBJECT: _given(wobj, "wobj", WORK_OBJECT, rows)}
    rows, J, sigma, found, left_out = _without_outliers(rows, robot, certainty, source)
    by_nominal = adjust(rows, nominal.poses(_joints(rows)), sigma, source)
    touch_covariance, gain, doubt = _certain(found, J, sigma)
    cell = CellFile(
        record.fingerprint,
        record.robot.name,
        record.simulated,
        _tools(found, by_nominal, theirs[TOOL]),
        _work_objects(found, by_nominal, theirs[WORK_OBJECT]),
        *_of_motions(found, theirs[TOOL], touch_covariance, gain, certainty.covariance),
        touches=tuple(
            replace(one, residual=found.residual[k], residual_nominal=by_nominal.residual[k])
            for k, one in enumerate(rows)
        ),
        left_out=tuple(left_out),
        notes=tuple(filter(None, (doubt, *_notes(record.robot.tip_link, rows, theirs[TOOL], certainty)))),
    )
    if out is not None:
        cell.save(out)
    return cell


def _given(
    given: Mapping[str, ArrayLike] | None, parameter: str, frame: str, rows: Sequence[Touch]
) -> dict[str, FloatArray]:
    """The controller's frames by the names of the rows."""
    names = {one.name.lower(): one.name for one in rows if one.frame == frame}
    frames_given = frames_by_name(given, parameter)
    for name in frames_given:
        if name not in names:
            raise OptionError(f"{parameter}: no touch is of {frame.replace('_', ' ')} {name}", parameter=parameter)
    return {names[name]: T for name, T in frames_given.items()}


def _joints(rows: Sequence[Touch]) -> FloatArray:
    return np.array([one.q for one in rows])


def point_derivatives(
    robot: Robot, certainty: Certainty, q: FloatArray, place: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points of the tip link in the base link, and how they depend on the robot's parameters.

    Parameters
    ----------
    robot : Robot
        Calibrated.
    certainty : Certainty
        Of its parameters.
    q : ndarray, shape (n, joints)
        Commanded, radians (metres).
    place : ndarray, shape (n, 3)
        In the tip link, metres.

    Returns
    -------
    points : ndarray, shape (n, 3)
    jacobian : ndarray, shape (n, 3, parameters)
        Without terms of the last move, which is not known.
    variance : ndarray, shape (n,)
        Of a coordinate: what the calibrated robot leaves over at poses that it was not fitted to, and terms of the last
        move.
    """
    load: dict[str, Any] = {**robot.joint_map.load(len(q))}
    motion = replace(Motion(q), **load)
    path = robot.walk(motion)
    points = path.tip[3] + np.einsum("acn,na->cn", path.tip[:3], place)
    J = np.asarray(
        certainty.jacobian(path, points, motion, np.zeros(len(q), dtype=bool), None).transpose(2, 1, 0)
    ).copy()
    history = np.flatnonzero([term.basis in HISTORY for term in certainty.terms]) + J.shape[2] - len(certainty.terms)
    size = np.diagonal(certainty.covariance)[history] + certainty.coefficients[history - J.shape[2]] ** 2
    variance = (np.sum(J[:, :, history] ** 2 * size, axis=(1, 2)) + certainty.determined_left_out(None) ** 2) / 3.0
    J[:, :, history] = 0.0
    return points.T, J, variance


def _without_outliers(
    rows: list[Touch], robot: Robot, certainty: Certainty, source: str
) -> tuple[list[Touch], FloatArray, FloatArray, Adjusted, list[str]]:
    """Adjust, leave out the worst touch, and again, as long as one is far out and the others are enough without it."""
    left_out: list[str] = []
    q, u95 = _joints(rows), np.array([one.u95 for one in rows])
    tips = adjust(rows, robot.poses(q), u95, source).tips  # millimetres of them do not matter to the derivatives
    _, J, variance = point_derivatives(robot, certainty, q, np.array([tips[one.tool] for one in rows]))
    sigma = np.sqrt((u95 / COVERAGE) ** 2 + variance)
    most = len(rows) // MOST_OUTLIERS
    found = adjust(rows, robot.poses(_joints(rows)), sigma, source)
    while True:
        worst, chance, away = _worst(found, sigma)
        if chance > OUTLIER:
            return rows, J, sigma, found, left_out
        one, keep = rows[worst], np.arange(len(rows)) != worst
        what = f"row {one.row} ({one.frame.replace('_', ' ')} {one.name}, {one.point})"
        words = f"{what} is {away / MM:.2f} mm beside what the other touches say"
        rest = [row for k, row in enumerate(rows) if keep[k]]
        if len(left_out) >= most:
            break
        try:
            again = adjust(rest, robot.poses(_joints(rest)), sigma[keep], source)
        except MeasurementError:
            break
        if not again.redundancy:
            break
        left_out.append(f"{words}: it is left out")
        rows, J, sigma, found = rest, J[keep], sigma[keep], again
    return rows, J, sigma, found, [*left_out, f"{words}; there are too few touches to leave it out: touch again"]


def _worst(found: Adjusted, sigma: FloatArray) -> tuple[int, float, float]:
    """The touch that the others contradict most, the chance of that, and how far it is from where they put it."""
    from scipy.stats import chi2

    weight = 1.0 / sigma[found.touch]
    basis = np.linalg.qr(found.jacobian * weight[:, None])[0]
    residual = found.values * weight
    worst = (0, 1.0, 0.0)
    for k in range(len(sigma)):
        mine = np.flatnonzero(found.touch == k)
        values, vectors = np.linalg.eigh(np.eye(len(mine)) - basis[mine] @ basis[mine].T)
        shown = values > SHOWN
        along = vectors[:, shown].T @ residual[mine]
        if shown.any():
            chance = float(chi2.sf(np.sum(along**2 / values[shown]), int(shown.sum())))
            if chance < worst[1]:
                worst = (k, chance, float(np.linalg.norm(along / values[shown]) * sigma[k]))
    return worst


def _certain(found: Adjusted, J: FloatArray, sigma: FloatArray) -> tuple[FloatArray, FloatArray, str]:
    """Covariance of the unknowns by touching, their derivative by the robot's parameters, and what is to be doubted.

    ``u = -(A'A)^-1 A' r`` of residuals r and their derivative A, both in standard deviations.
    """
    from scipy.stats import chi2

    weight = 1.0 / sigma[found.touch]
    A = found.jacobian * weight[:, None]
    pseudo = np.asarray(np.linalg.pinv(A), dtype=float)
    by_robot = np.einsum("nij,njp->nip", found.axes, J)[found.touch, found.component] * weight[:, None]
    square = float(np.sum((found.values * weight) ** 2))
    factor, doubt = 1.0, ""
    if found.redundancy and chi2.sf(square, found.redundancy) < DOUBTFUL:
        factor = square / found.redundancy
        doubt = f"the touches scatter {np.sqrt(factor):.1f} times as much as u95_mm says: the intervals are widened"
    return factor * (pseudo @ pseudo.T), -pseudo @ by_robot, doubt


def _tools(found: Adjusted, by_nominal: Adjusted, theirs: Mapping[str, FloatArray]) -> dict[str, FrameInCell]:
    """Tools by both robots, with the axes that the controller has."""
    out = {}
    for name, tip in found.tips.items():
        R = theirs.get(name, np.eye(4))[:3, :3]
        true, nominal = (frames.transform(R, p) for p in (tip, by_nominal.tips[name]))
        out[name] = FrameInCell(name, true, nominal, theirs.get(name), position_only=True)
    return out


def _work_objects(found: Adjusted, by_nominal: Adjusted, theirs: Mapping[str, FloatArray]) -> dict[str, FrameInCell]:
    """Work objects by both robots."""
    return {
        name: FrameInCell(name, T, by_nominal.work_objects[name], theirs.get(name))
        for name, T in found.work_objects.items()
    }


def _of_motions(
    found: Adjusted, theirs: Mapping[str, FloatArray], touching: FloatArray, gain: FloatArray, robot: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of the small motions of all frames: covariance by touching, whole covariance, derivative by the robot."""
    size = 6 * (len(found.tips) + len(found.work_objects))
    M = np.zeros((size, found.jacobian.shape[1]))
    for k, name in enumerate(found.tips):
        M[6 * k + 3 : 6 * k + 6, found.columns(TOOL, name)] = theirs.get(name, np.eye(4))[:3, :3].T
    for k, name in enumerate(found.work_objects, len(found.tips)):
        M[6 * k : 6 * k + 6, found.columns(WORK_OBJECT, name)] = np.eye(6)
    C, G = M @ touching @ M.T, M @ gain
    return C, C + G @ robot @ G.T, G


def _notes(tip: str, rows: Sequence[Touch], theirs: Mapping[str, FloatArray], certainty: Certainty) -> list[str]:
    """What a reader must know of how this was computed."""
    outside = certainty.outside_in_words(_joints(rows), "touches")
    notes = [outside] if outside else []
    alone = [name for name in dict.fromkeys(one.name for one in rows if one.frame == TOOL) if name not in theirs]
    if alone:
        notes.append(f"a tip alone tells no axes: tool {', '.join(alone)} has those of {tip}")
    if any(one.u95 == U95_BY_EYE for one in rows):
        notes.append(f"touches without u95_mm count as made by eye, u95 {U95_BY_EYE / MM:.1f} mm")
    if certainty.free_targets:
        notes.append(
            "base and flange of a calibration by unknown reflectors are its own: use these frames with this calibration"
        )
    return notes
