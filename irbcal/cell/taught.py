"""Tools and work objects of a cell, computed with the calibrated robot from touches, with what is known of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray
from irbcal.cell.adjustment import Adjusted, adjust
from irbcal.cell.cell_file import TOOL, WORK_OBJECT, CellFile, FrameInCell, Touch
from irbcal.cell.touches import U95_BY_EYE, read_touches
from irbcal.errors import MeasurementError, OptionError, RobotError
from irbcal.io.calibration_folder import CalibrationLike, opened
from irbcal.measurement.columns import TableLike
from irbcal.modeling import frames
from irbcal.modeling.certainty import COVERAGE, HISTORY, Certainty
from irbcal.modeling.robot import Robot, loaded
from irbcal.modeling.terms.situation import Motion
from irbcal.overwriting import refuse_overwriting
from irbcal.units import MM

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
        See `irbcal.cell.touches`.
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
    record = opened(calibration)
    robot = loaded(record.robot_calibrated(), payload, payload_place)
    certainty = robot.certainty
    if certainty is None:
        raise RobotError(f"nothing is known of how certain {robot.arm.name} is: calibrate it", parameter="calibration")
    nominal = Robot(record.arm(calibrated=False))
    rows, source = read_touches(touches, nominal.arm)
    theirs = {TOOL: _given(tool, "tool", TOOL, rows), WORK_OBJECT: _given(wobj, "wobj", WORK_OBJECT, rows)}
    J = _by_robot(robot, certainty, rows, source)
    rows, J, sigma, found, left_out = _without_outliers(rows, J, robot, certainty, source)
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
    out = {}
    for name, value in (given or {}).items():
        T = np.asarray(value, dtype=float)
        if name.lower() not in names:
            raise OptionError(f"{parameter}: no touch is of {frame.replace('_', ' ')} {name}", parameter=parameter)
        if T.shape != (4, 4) or np.abs(frames.inverse(T) @ T - np.eye(4)).max() > 1e-6:
            raise OptionError(f"{parameter}: {name} is no rigid transform of shape (4, 4)", parameter=parameter)
        out[names[name.lower()]] = T
    return out


def _joints(rows: Sequence[Touch]) -> FloatArray:
    return np.array([one.q for one in rows])


def _by_robot(robot: Robot, certainty: Certainty, rows: Sequence[Touch], source: str) -> FloatArray:
    """Derivative of the tips by the robot's parameters, shape (touches, 3, parameters), in the base link.

    The tips are those of a first adjustment: millimetres of them do not matter here.
    """
    q = _joints(rows)
    tips = adjust(rows, robot.poses(q), np.array([one.u95 for one in rows]), source).tips
    load: dict[str, Any] = {**robot.joint_map.load(len(q))}
    motion = replace(Motion(q), **load)
    path = robot.walk(motion)
    place = np.array([tips[one.tool] for one in rows])
    p = path.tip[3] + np.einsum("acn,na->cn", path.tip[:3], place)
    unknown = np.zeros(len(q), dtype=bool)
    return np.asarray(certainty.jacobian(path, p, motion, unknown, None).transpose(2, 1, 0))


def _scatter(rows: Sequence[Touch], J: FloatArray, certainty: Certainty) -> tuple[FloatArray, FloatArray]:
    """Standard deviation of each touch, and the derivative without terms of the last move.

    What varies from touch to touch: touching itself, what the calibrated robot leaves over at poses that it was not
    fitted to, and terms of the last move, which touches do not tell.
    """
    J = J.copy()
    history = np.flatnonzero([term.basis in HISTORY for term in certainty.terms]) + J.shape[2] - len(certainty.terms)
    size = np.diagonal(certainty.covariance)[history] + certainty.coefficients[history - J.shape[2]] ** 2
    moves = np.sum(J[:, :, history] ** 2 * size, axis=(1, 2)) / 3.0
    J[:, :, history] = 0.0
    touching = np.array([one.u95 for one in rows]) / COVERAGE
    return np.sqrt(touching**2 + certainty.determined_left_out(None) ** 2 / 3.0 + moves), J


def _without_outliers(
    rows: list[Touch], J: FloatArray, robot: Robot, certainty: Certainty, source: str
) -> tuple[list[Touch], FloatArray, FloatArray, Adjusted, list[str]]:
    """Adjust, leave out the worst touch, and again, as long as one is far out and the others are enough without it."""
    left_out: list[str] = []
    sigma, J = _scatter(rows, J, certainty)
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
