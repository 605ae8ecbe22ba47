r"""Expected error of a part: of robot, tool and work object together, by one covariance.

The tool centre point in the work object is off by ``e = Ot^-1 C(q) Tt - P``. To first order, with small motions ``m``
of tool and work object in their own axes (rotation ``w``, translation ``v``) and errors ``d`` of the robot's
parameters::

    e = Ro' (J d + Rf Rt v_t) - (w_o x p + v_o),    m = touching + G d

The robot's terms act in the touches as in the program, so what both have in common cancels: the variances of robot and
frames must not be added.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.cell.cell_file import TOOL, WORK_OBJECT, CellFile
from irbcal.correction.true_frames import CELL, FramesOfGoals
from irbcal.modeling.certainty import HISTORY, Certainty
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms.situation import Motion


def part_errors(robot: Robot, cell: CellFile | None, q: FloatArray, at: FramesOfGoals) -> FloatArray:
    """Mean and 95 % of the distance of the tool centre point from where it is wanted in the work object.

    Parameters
    ----------
    robot : Robot
        Calibrated, with its certainty.
    cell : CellFile or None
    q : ndarray, shape (n, joints)
        Commanded, radians (metres).
    at : FramesOfGoals
        Of the n targets. Frames that are not of the cell file count as exact, unless their origin is unknown.

    Returns
    -------
    ndarray, shape (n, 2)
        Metres; NaN where tool or work object are of unknown origin or none of them is of the cell file, and everywhere
        if the certainty of the robot is not known or the cell was computed with another one.
    """
    out = np.full((len(q), 2), np.nan)
    rows = np.flatnonzero((at.origins == CELL) & np.isfinite(q).all(axis=1))
    if cell is None or robot.certainty is None or not len(rows):
        return out
    if cell.robot_gain.shape[1] not in (0, len(robot.certainty.covariance)):
        return out
    by_robot, by_frames, left_over = _derivatives(robot, robot.certainty, cell, q[rows], at, rows)
    if cell.robot_gain.shape[1]:
        by_robot = by_robot + by_frames @ cell.robot_gain
    C = by_robot @ robot.certainty.covariance @ np.swapaxes(by_robot, 1, 2)
    C = C + by_frames @ cell.touch_covariance @ np.swapaxes(by_frames, 1, 2) + left_over[:, None, None] * np.eye(3)
    out[rows] = np.column_stack(lengths(C))
    return out


def lengths(C: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean and 95 % quantile of the length of Gaussian vectors with covariances (n, 3, 3).

    The squared length counts as a multiple of chi squared with the same mean and variance (Satterthwaite 1946): exact
    for errors along one line and for those alike in all directions, within 2 % between.
    """
    from scipy.special import gammaln
    from scipy.stats import chi2

    trace, square = np.trace(C, axis1=1, axis2=2), np.sum(C * C, axis=(1, 2))
    scale = np.divide(square, trace, out=np.zeros_like(trace), where=trace > 0)
    freedom = np.divide(trace**2, square, out=np.ones_like(trace), where=square > 0)
    mean = np.sqrt(2.0 * scale) * np.exp(gammaln((freedom + 1.0) / 2.0) - gammaln(freedom / 2.0))
    return mean, np.sqrt(scale * chi2.ppf(0.95, freedom))


def _derivatives(
    robot: Robot, certainty: Certainty, cell: CellFile, q: FloatArray, at: FramesOfGoals, rows: Any
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of the errors (n, 3) in the work object by the robot's parameters and by the small motions of all frames.

    And the variance of each coordinate that neither explains: what the fit leaves over, and last moves.
    """
    load: dict[str, Any] = {**robot.joint_map.load(len(q))}
    motion = replace(Motion(q), **load)
    path = robot.walk(motion)
    T = robot.forward(q)
    tcp = np.einsum("nij,nj->ni", T[:, :3, :3], at.T_tool[rows, :3, 3]) + T[:, :3, 3]
    unknown = np.zeros(len(q), dtype=bool)
    J = np.asarray(certainty.jacobian(path, tcp.T, motion, unknown, None).transpose(2, 1, 0)).copy()
    history = np.flatnonzero([term.basis in HISTORY for term in certainty.terms]) + J.shape[2] - len(certainty.terms)
    size = np.diagonal(certainty.covariance)[history] + certainty.coefficients[history - J.shape[2]] ** 2
    left_over = np.sum(J[:, :, history] ** 2 * size, axis=(1, 2)) / 3.0 + certainty.determined_left_out(None) ** 2 / 3.0
    J[:, :, history] = 0.0

    to_object = np.swapaxes(at.T_object[rows, :3, :3], 1, 2)
    p = np.einsum("nij,nj->ni", to_object, tcp - at.T_object[rows, :3, 3])
    F = np.zeros((len(q), 3, len(cell.touch_covariance)))
    tools = {name.lower(): name for name in cell.tools}
    work_objects = {name.lower(): name for name in cell.work_objects}
    for n, row in enumerate(rows):
        if at.tool_origins[row] == CELL:
            name = tools[at.tools[row]]
            here = cell.rows(TOOL, name)
            R = cell.tools[name].T_true[:3, :3]
            F[n, :, here.start + 3 : here.stop] = to_object[n] @ T[n, :3, :3] @ R
        if at.object_origins[row] == CELL:
            here = cell.rows(WORK_OBJECT, work_objects[at.work_objects[row]])
            x, y, z = p[n]
            F[n, :, here.start : here.start + 3] = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])  # -(w x p) = p x w
            F[n, :, here.start + 3 : here.stop] = -np.eye(3)
    return to_object @ J, F, left_over
