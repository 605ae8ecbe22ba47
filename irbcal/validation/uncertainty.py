"""How well a saved calibration knows where the robot is."""

from __future__ import annotations

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.files.schema import Record
from irbcal.identification.evidence_fit import HISTORY
from irbcal.identification.residuals import Problem, State
from irbcal.measurement.points import PointSet
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.parameters import all_names, parameter
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms import chain
from irbcal.modeling.terms.geometry import FAMILY as GEOMETRY
from irbcal.modeling.terms.situation import Situation
from irbcal.modeling.terms.term_joint_map import TermJointMap
from irbcal.modeling.terms.term_map import basis_values, term_columns
from irbcal.units import UNIT_OUTSIDE

TIP = "the tip itself"


def position_std(
    calibration: Record, q: FloatArray, target: str | None = None, robot: Robot | None = None
) -> FloatArray:
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
    robot : Robot, optional
        The calibrated robot, where it carries another payload than the calibration's usual one.

    Returns
    -------
    ndarray, shape (n, 3)
        Of x, y and z, metres.
    """
    robot = calibration.robot_calibrated() if robot is None else robot
    if isinstance(robot.joint_map, TermJointMap):
        return _of_terms(calibration, robot, robot.joint_map, q, target)
    assert isinstance(robot.joint_map, JointMap)
    phases = robot.joint_map.phases
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
    problem = Problem(nominal, points, [parameter(r.name) for r in rows], phases, known)
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


def _of_terms(
    calibration: Record, robot: Robot, joint_map: TermJointMap, q: FloatArray, target: str | None
) -> FloatArray:
    """As `position_std` for a joint map of terms, the stop before unknown."""
    nominal, n = calibration.arm(calibrated=False), len(q)
    constants, terms = GEOMETRY.terms(nominal), list(joint_map.terms.terms)
    motion, pose = joint_map.motion(q), np.arange(n)
    path = chain.walk(robot.arm, robot.joint_map.effective(q))
    place = np.zeros(3) if target is None else robot.targets[target]
    p = path.tip[3] + np.einsum("acn,a->cn", path.tip[:3], place)
    here = Situation(nominal, motion, joint_map.terms.gravity)
    C = np.array(calibration.covariance)
    # what depends on the last move is zero in the prediction: its size joins the uncertainty
    sizes = [c * c if t.basis in HISTORY else 0.0 for t, c in zip(terms, joint_map.terms.coefficients, strict=True)]
    C[-len(sizes) :, -len(sizes) :] += np.diag(sizes)
    flat = len(C) - len(constants) - len(terms)
    J = np.zeros((len(C), 3, n))
    if target is not None:
        for k in range(3):
            J[k, (k + 1) % 3], J[k, (k + 2) % 3], J[3 + k, k] = -p[(k + 2) % 3], p[(k + 1) % 3], 1.0
        listed = [row.name for row in calibration.parameters]
        if f"target_{target}_x" in listed:
            at = listed.index(f"target_{target}_x")
            J[at : at + 3] = path.tip[:3]
    for some, start, constant in ((constants, flat, True), (terms, flat + len(constants), False)):
        columns = chain.point_columns(path, p, pose, constant)
        values = basis_values(some, here)
        values[[term.basis in HISTORY for term in some]] = 1.0
        J[start : start + len(some)] = term_columns(some, columns, values, pose)
    if target is not None:
        J = np.einsum("ij,kjn->kin", robot.T_world_base[:3, :3], J)
    spread = np.einsum("kin,kin->ni", J, (C @ J.reshape(len(C), -1)).reshape(J.shape))
    return np.sqrt(np.maximum(spread, 0.0))
