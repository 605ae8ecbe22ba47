"""Optimal control with CasADi on a calibrated robot: the gentlest motion to a pose within limits of acceleration.

CasADi knows nothing of the joint map: it plans effective joints on the kinematics of the corrected URDF, which are
written as a symbolic chain of Pinocchio's joint placements. The motion then becomes commands with their speeds and
accelerations, whose limits are checked between the nodes; where they do not hold it goes a little slower.

Run it with ``python scripts/examples/optimal_motion_with_casadi.py [CALIBRATION_FOLDER]``.
"""

import casadi as ca
import numpy as np
import virtual_robot

from irbcal.units import DEG, MM

NODES, STEP = 30, 0.05
"""One and a half seconds of motion."""
ACCELERATION = 12.0
"""Largest acceleration of a joint, rad/s²."""


def placement(model, frame, q):
    """Rotation and place of a frame in the universe, symbolic, for a chain of revolute joints; one unknown each."""
    number = model.getFrameId(frame)
    joints, joint = [], model.frames[number].parentJoint
    while joint:
        joints, joint = [joint, *joints], model.parents[joint]
    R, p = ca.DM.eye(3), ca.DM.zeros(3)
    for joint in joints:
        there, kind = model.jointPlacements[joint], model.joints[joint].shortname()
        p, R = p + R @ there.translation, R @ there.rotation
        axis = "XYZ".find(kind[-1])
        axis = np.eye(3)[axis] if axis >= 0 else np.array(model.joints[joint].extract().axis)
        R = R @ turn(axis, q[model.joints[joint].idx_q])
    tool = model.frames[number].placement
    return R @ tool.rotation, p + R @ tool.translation


def turn(axis, angle):
    """Rotation about an axis (Rodrigues)."""
    K = ca.skew(ca.DM(axis))
    return ca.DM.eye(3) + ca.sin(angle) * K + (1 - ca.cos(angle)) * (K @ K)


def solver(model, frame):
    """The problem as a function of start and goal.

    Parameters
    ----------
    model : pinocchio.Model
    frame : str

    Returns
    -------
    callable
        From a configuration (nq,) and a goal (4, 4) to positions, speeds (NODES + 1, nq) and accelerations.
    """
    opti = ca.Opti()
    n = model.nq
    q, v, a = opti.variable(n, NODES + 1), opti.variable(n, NODES + 1), opti.variable(n, NODES + 1)
    start, R_goal, p_goal = opti.parameter(n), opti.parameter(3, 3), opti.parameter(3)
    # accelerations go straight from node to node: speeds and positions between are polynomials
    opti.subject_to(v[:, 1:] == v[:, :-1] + 0.5 * STEP * (a[:, :-1] + a[:, 1:]))
    opti.subject_to(q[:, 1:] == q[:, :-1] + STEP * v[:, :-1] + STEP**2 / 6 * (2 * a[:, :-1] + a[:, 1:]))
    opti.subject_to(q[:, 0] == start)
    for still in (v[:, 0], v[:, -1], a[:, 0], a[:, -1]):
        opti.subject_to(still == 0)
    opti.subject_to(opti.bounded(-ACCELERATION, ca.vec(a), ACCELERATION))
    for k in range(n):
        opti.subject_to(opti.bounded(model.lowerPositionLimit[k], q[k, 1:].T, model.upperPositionLimit[k]))
        opti.subject_to(opti.bounded(-model.velocityLimit[k], v[k, 1:].T, model.velocityLimit[k]))
    R, p = placement(model, frame, q[:, -1])
    opti.subject_to(p == p_goal)
    lack = R_goal.T @ R
    opti.subject_to(ca.vertcat(lack[2, 1] - lack[1, 2], lack[0, 2] - lack[2, 0], lack[1, 0] - lack[0, 1]) == 0)
    opti.minimize(ca.sumsqr(a) / NODES + 1e-3 * ca.sumsqr(ca.diff(a, 1, 1)))
    opti.solver("ipopt", {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-10}})

    def solve(configuration, T_universe_goal):
        opti.set_value(start, configuration)
        opti.set_value(R_goal, T_universe_goal[:3, :3])
        opti.set_value(p_goal, T_universe_goal[:3, 3])
        opti.set_initial(q, np.tile(configuration[:, None], (1, NODES + 1)))
        opti.set_initial(v, 0.0)
        opti.set_initial(a, 0.0)
        found = opti.solve()
        return tuple(np.array(found.value(x)).T for x in (q, v, a))

    return solve


def motions(calibrated, frame, T_universe_goals):
    """Commands of a motion from the home position to each goal.

    Returns
    -------
    list of irbcal.Trajectory
    """
    solve = solver(calibrated.model, frame)
    start = calibrated.model_from_command(virtual_robot.home(calibrated))[0]
    times = STEP * np.arange(NODES + 1)
    found = []
    for goal in T_universe_goals:
        planned = calibrated.trajectory(times, *solve(start, goal))
        found.append(calibrated.command_trajectory(planned, acceleration_limits=1.02 * ACCELERATION).in_time())
    return found


def plan(calibrated, frame, T_universe_goals):
    """First and last command of the motion to each goal, (n, 2, joints)."""
    return np.array([motion.q[[0, -1]] for motion in motions(calibrated, frame, T_universe_goals)])


def main(folder, n=8):
    """Move to some goals; on the simulated demo, also see what the calibration is worth."""
    side = virtual_robot.calibrated(folder)
    frame, T_world_goals = virtual_robot.frame_to_place(side), virtual_robot.goals(side, n)
    T_universe_goals = side.in_universe(T_world_goals)
    found = motions(side.model, frame, T_universe_goals)
    ends, starts = ([m.q[k] for m in found] for k in (-1, 0))
    left = side.model.placement(ends, frame, "universe", starts)[:, :3, 3] - T_universe_goals[:, :3, 3]
    fastest = max(np.abs(m.dq).max() for m in found) / DEG
    hardest = max(np.abs(m.dense().ddq).max() for m in found)
    print(
        f"{n} motions of {max(m.times[-1] for m in found):.2f} s at most for {frame}, at most {fastest:.0f} degrees/s "
        f"and {hardest:.1f} rad/s²; by the calibrated model they end {np.linalg.norm(left, axis=1).max() / MM:.1e} mm "
        "from their goals"
    )
    if virtual_robot.is_demo(folder):
        return virtual_robot.compare_on_the_simulated_robot(folder, plan, T_world_goals)
    return None


if __name__ == "__main__":
    main(virtual_robot.folder_from_command_line(__doc__))
