"""How well a saved calibration knows where the robot is."""

from __future__ import annotations

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.files.schema import Record
from irbcal.identification.residuals import Problem, State
from irbcal.measurement.points import PointSet
from irbcal.modeling.parameters import all_names, parameter
from irbcal.units import UNIT_OUTSIDE

TIP = "the tip itself"


def position_std(calibration: Record, q: FloatArray, target: str | None = None) -> FloatArray:
    """Standard deviations of predicted positions, from those of the identified parameters.

    Held combinations add nothing, and what the model cannot describe (backlash, ...) is not in it: for that see the
    calibration's held-out errors.

    Parameters
    ----------
    calibration : Record
    q : ndarray, shape (n, joints)
        Commanded joints, radians.
    target : str, optional
        A reflector, in the measuring frame; by default the tip in the base link.

    Returns
    -------
    ndarray, shape (n, 3)
        Of x, y and z, metres.
    """
    robot = calibration.robot_calibrated()
    factor = dict(UNIT_OUTSIDE.values())
    nominal = calibration.arm(calibrated=False)
    rows = [row for row in calibration.parameters if row.name in all_names(nominal)]
    errors = np.array([row.value * factor[row.unit] for row in rows])
    listed = {row.name for row in calibration.parameters}
    names = [*calibration.placement.targets, TIP]
    known = {name: robot.targets[name] for name in robot.targets if f"target_{name}_x" not in listed}
    known[TIP] = np.zeros(3)
    n = len(q)
    index = names.index(TIP if target is None else target)
    points = PointSet(
        q, np.arange(n), np.full(n, index), np.zeros((n, 3)), tuple(names), np.arange(n), np.full(n, "", object)
    )
    problem = Problem(nominal, points, [parameter(r.name) for r in rows], robot.joint_map.phases, known)
    places = np.array([known[name] if name in known else robot.targets[name] for name in names])
    J = problem.jacobian(State(robot.T_world_base, places, errors)).reshape(n, 3, -1)
    C = np.array(calibration.covariance)
    turns = np.arange(problem.outer, len(C) - len(rows))  # orientations of target frames move no position
    C = np.delete(np.delete(C, turns, axis=0), turns, axis=1)
    if target is None:
        J[..., : problem.outer] = 0.0
    else:
        J = robot.T_world_base[:3, :3] @ J
    return np.sqrt(np.einsum("nij,jk,nik->ni", J, C, J))
