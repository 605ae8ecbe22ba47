"""Tools and work objects of a cell, computed with the calibrated robot from touches, with what is known of them.

The touches (`irbcal.cell.touches`) are adjusted by the calibrated and by the nominal robot
(`irbcal.cell.adjusted_cell`); those that all others contradict are left out, and the frames get the covariance that
touching and robot leave.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray
from irbcal.cell import external_axes
from irbcal.cell.adjusted_cell import LEAST_SHARE, Adjusted, adjust, adjust_zeros
from irbcal.cell.cell_file import (
    AXIS,
    FIXED_TOOL,
    HELD_PART,
    TOOL,
    WORK_OBJECT,
    CellFile,
    FrameInCell,
    Touch,
    frames_by_name,
)
from irbcal.cell.contacts import Contacts, with_contacts
from irbcal.cell.external_axes import ExternalAxis
from irbcal.cell.touch_rows import frame_name
from irbcal.cell.touches import U95_BY_EYE, read_touches
from irbcal.distributions import NORMAL_95
from irbcal.errors import MeasurementError, OptionError, RobotError
from irbcal.identification.feature_problem import edge_key
from irbcal.io.opening import CalibrationLike
from irbcal.io.robot_section import RobotSection
from irbcal.io.schema import Record
from irbcal.measurement.input_table import TableLike
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.certainty import Certainty
from irbcal.modeling.lost_zeros import lost_joints, zeros_in_words
from irbcal.modeling.robot import Robot
from irbcal.units import MM

OUTLIER_CHANCE = 6.3e-5
"""Chance of a touch as far away as this among good ones: four standard deviations of one coordinate."""
DOUBTFUL = 1e-3
"""Chance of touches that scatter so much with the uncertainty that they are said to have."""
ROWS_FOR_AN_OUTLIER = 5
"""One touch of so many may be left out."""


def frames_from_touches(
    record: Record,
    touches: TableLike,
    *,
    robot: Robot | None = None,
    tools: Mapping[str, ArrayLike] | None = None,
    work_objects: Mapping[str, ArrayLike] | None = None,
    axes: TableLike | None = None,
    other: CalibrationLike | None = None,
    other_cell: CellFile | str | Path | None = None,
    refit_zeros: Sequence[int] = (),
) -> CellFile:
    """Tools and work objects by the calibrated robot; options and errors as of `irbcal.cell_frames`.

    Parameters
    ----------
    robot : Robot, optional
        The calibrated robot with what it carries at the touches; with its usual load unless given.
    tools, work_objects : dict of str to array_like, shape (4, 4), optional
        What the controller has, metres: a tool in the tip link, a work object in the base link. A tool that is taught
        by its tip alone has the axes that the controller has.
    """
    robot = record.robot_calibrated() if robot is None else robot
    certainty = robot.certainty
    if certainty is None:
        raise RobotError(f"nothing is known of how certain {robot.arm.name} is: calibrate it", parameter="calibration")
    contacts = None
    if other is not None and other_cell is not None:
        contacts = with_contacts(touches, other, other_cell)
        touches = contacts.table
    axes_before = () if axes is None else external_axes.read_axes(axes)
    all_rows, source = read_touches(touches, robot.arm, axes_before)
    for axis in axes_before:
        touched = {t.standing[1].lower() for t in all_rows}
        unknown = sorted({*axis.carries} - touched - {external_axes.ROBOT})
        if unknown:
            message = f"axes: {axis.column} carries {unknown[0]}, which is neither robot nor a touched work object"
            raise OptionError(message, parameter="axes")
    of_controller = {
        kind: _of_controller(frames_given, parameter, kind, all_rows)
        for kind, frames_given, parameter in ((TOOL, tools, "tool"), (WORK_OBJECT, work_objects, "wobj"))
    }
    zeros = lost_joints(refit_zeros, robot.arm)
    adjusted, sigma, left_out = _without_outliers(all_rows, robot, certainty, source, axes_before, zeros)
    rows = adjusted.touches
    by_nominal = adjust(rows, record.robot_nominal(), sigma, source, axes_before, nominal=True)
    if contacts is not None:
        contacts = replace(contacts, rows=np.array([all_rows[k].row for k in contacts.rows]))
    C, G, doubt = _covariance(adjusted, certainty, [touch.row for touch in rows], contacts)
    of_cell: dict[str, dict[str, FrameInCell]] = {TOOL: {}, WORK_OBJECT: {}}
    M = []
    for mount, frames_of_mount in of_cell.items():
        for kind, name in dict.fromkeys(t.on_flange if mount == TOOL else t.standing for t in rows):
            if not name:
                continue
            T_controller = of_controller[mount].get(name)
            alone = adjusted.position_only(kind, name)
            axes = frames.transform(T_controller[:3, :3]) if alone and T_controller is not None else np.eye(4)
            T_true, T_nominal = (each.frame(kind, name) @ axes for each in (adjusted, by_nominal))
            reverse = kind in (HELD_PART, FIXED_TOOL)
            frames_of_mount[name] = FrameInCell(name, T_true, T_nominal, T_controller, alone, reverse)
            M.append(adjusted.motions(kind, name, axes[:3, :3]))
    axes_of_cell = []
    for axis, edge in zip(axes_before, external_axes.edges(axes_before, np.zeros((1, len(axes_before)))), strict=True):
        axes_of_cell.append(replace(axis, screw=adjusted.state.values[edge_key(edge)]))
        M.append(adjusted.motions(AXIS, edge.child, np.eye(3)))
    motions = np.concatenate(M)
    touching, gain = motions @ C @ motions.T, motions @ G
    sentences = [doubt, *_zeros_in_words(adjusted, robot.arm, all_rows, C + G @ certainty.covariance @ G.T)]
    return CellFile(
        record.fingerprint,
        record.robot.name,
        record.simulated or (contacts is not None and contacts.simulated),
        of_cell[TOOL],
        of_cell[WORK_OBJECT],
        touching,
        touching + gain @ certainty.covariance @ gain.T,
        gain,
        tuple(axes_of_cell),
        touches=tuple(
            replace(touch, residual=adjusted.residual[k], residual_nominal=by_nominal.residual[k])
            for k, touch in enumerate(rows)
        ),
        left_out=tuple(left_out),
        notes=tuple(filter(None, (*sentences, *_notes(record.robot, rows, of_cell, certainty)))),
    )


def _of_controller(
    frames_given: Mapping[str, ArrayLike] | None, parameter: str, kind: str, rows: Sequence[Touch]
) -> dict[str, FloatArray]:
    """The controller's frames by the names of the rows."""
    pairs = [t.on_flange if kind == TOOL else t.standing for t in rows]
    names = {name.lower(): name for _, name in pairs if name}
    by_name = frames_by_name(frames_given, parameter)
    for name in by_name:
        if name not in names:
            raise OptionError(f"{parameter}: no touch is of {kind.replace('_', ' ')} {name}", parameter=parameter)
    return {names[name]: T for name, T in by_name.items()}


def _without_outliers(
    rows: Sequence[Touch],
    robot: Robot,
    certainty: Certainty,
    source: str,
    axes: Sequence[ExternalAxis],
    zeros: Sequence[int],
) -> tuple[Adjusted, FloatArray, list[str]]:
    """Adjust, leave out the worst touch, and again, as long as one is far out and the others are enough without it."""
    left_out: list[str] = []
    u95 = np.array([touch.u95 for touch in rows])
    variance = adjust_zeros(rows, robot, u95 / NORMAL_95, source, zeros, axes).by_robot(certainty)[1]
    sigma = np.sqrt((u95 / NORMAL_95) ** 2 + variance)
    most = len(rows) // ROWS_FOR_AN_OUTLIER
    adjusted = adjust_zeros(rows, robot, sigma, source, zeros, axes)
    while True:
        worst, chance, distance = _worst(adjusted, sigma)
        if chance > OUTLIER_CHANCE:
            return adjusted, sigma, left_out
        touch, keep = rows[worst], np.arange(len(rows)) != worst
        words = (
            f"row {touch.row} ({frame_name(touch.frame, touch.name)}, {touch.point}) is {distance / MM:.2f} mm beside "
            "what the other touches say"
        )
        rest = [row for k, row in enumerate(rows) if keep[k]]
        if len(left_out) >= most:
            break
        try:
            again = adjust_zeros(rest, robot, sigma[keep], source, zeros, axes)
        except MeasurementError:
            break
        if not again.redundancy:
            break
        left_out.append(f"{words}: it is left out")
        rows, sigma, adjusted = rest, sigma[keep], again
    return adjusted, sigma, [*left_out, f"{words}; there are too few touches to leave it out: touch again"]


def _zeros_in_words(adjusted: Adjusted, arm: Arm, before: Sequence[Touch], C: FloatArray) -> list[str]:
    """What the touches say of zeros that were lost; C: covariance of the unknowns, the last are the zeros."""
    if not adjusted.zeros:
        return []
    row = {touch.row: touch for touch in before}[adjusted.touches[0].row]
    moved = (adjusted.touches[0].q - row.q)[np.array(adjusted.zeros) - 1]
    half = NORMAL_95 * np.sqrt(np.diagonal(C)[-len(adjusted.zeros) :])
    return [
        *zeros_in_words(arm, adjusted.zeros, moved, half),
        "tools and work objects here are those after mastering, and so are the joints of the touches in this file",
    ]


def _worst(adjusted: Adjusted, sigma: FloatArray) -> tuple[int, float, float]:
    """The touch that the others contradict most, the chance of that, and how far it is from where they put it."""
    from scipy.special import chdtrc

    A, residual, touch = adjusted.rows
    basis = np.linalg.qr(A)[0]
    worst = (0, 1.0, 0.0)
    for k in range(len(sigma)):
        equations = np.flatnonzero(touch == k)
        values, vectors = np.linalg.eigh(np.eye(len(equations)) - basis[equations] @ basis[equations].T)
        above_limit = values > LEAST_SHARE
        along = vectors[:, above_limit].T @ residual[equations]
        if above_limit.any():
            chance = float(chdtrc(int(above_limit.sum()), np.sum(along**2 / values[above_limit])))
            if chance < worst[1]:
                worst = (k, chance, float(np.linalg.norm(along / values[above_limit]) * sigma[k]))
    return worst


def _covariance(
    adjusted: Adjusted, certainty: Certainty, rows: Sequence[int] = (), contacts: Contacts | None = None
) -> tuple[FloatArray, FloatArray, str]:
    """Covariance of the unknowns by touching, their derivative by the robot's parameters, and what is to be doubted.

    ``u = (A'A)^-1 A' r`` of residuals r and the derivative A of the predictions, both in standard deviations. Errors of
    the points of another robot that were touched (``rows`` are the numbers of the touches) count as errors of touching.
    """
    from scipy.special import chdtrc

    A, residual, touch = adjusted.rows
    pseudo = np.asarray(np.linalg.pinv(A), dtype=float)
    square = float(residual @ residual)
    factor, doubt = 1.0, ""
    if adjusted.redundancy and chdtrc(adjusted.redundancy, square) < DOUBTFUL:
        factor = square / adjusted.redundancy
        doubt = f"the touches scatter {np.sqrt(factor):.1f} times as much as u95_mm says: the intervals are widened"
    C = factor * (pseudo @ pseudo.T)
    if contacts is not None:
        kept = [k for k, row in enumerate(contacts.rows) if row in rows]
        equations = np.concatenate([np.flatnonzero(touch == rows.index(contacts.rows[k])) for k in kept])
        weight = adjusted.problem.weights[touch[equations]] * NORMAL_95 / adjusted.problem.typical
        moved = pseudo[:, equations] * weight
        points = (3 * np.array(kept)[:, None] + np.arange(3)).ravel()
        C = C + moved @ contacts.covariance[np.ix_(points, points)] @ moved.T
    return C, -pseudo @ adjusted.by_robot(certainty)[0], doubt


def _notes(
    robot: RobotSection, rows: Sequence[Touch], of_cell: Mapping[str, Mapping[str, FrameInCell]], certainty: Certainty
) -> list[str]:
    """What a reader must know of how this was computed."""
    touched = np.array([touch.q for touch in rows if touch.on_flange[1]])
    outside = certainty.outside_in_words(touched, "touches") if len(touched) else ""
    notes = [outside] if outside else []
    for mount, word, link in ((TOOL, "tool", robot.tip_link), (WORK_OBJECT, "fixed tool", robot.base_link)):
        of_mount = of_cell[mount].items()
        alone = [name for name, frame in of_mount if frame.position_only and frame.T_controller is None]
        if alone:
            notes.append(f"a tip alone gives no axes: {word} {', '.join(alone)} has those of {link}")
    if any(touch.u95 == U95_BY_EYE for touch in rows):
        notes.append(f"touches without u95_mm count as made by eye, u95 {U95_BY_EYE / MM:.1f} mm")
    return [*notes, *filter(None, [certainty.open_ends_in_words()])]
