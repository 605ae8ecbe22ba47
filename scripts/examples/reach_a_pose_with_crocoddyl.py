"""Smooth motion to a pose with crocoddyl on a calibrated robot.

Crocoddyl knows nothing of the joint map: it plans with the robot's dynamics on the Pinocchio model of the corrected
URDF, and its path of effective joints becomes commands at the end. Crocoddyl's wheels work beside the Pinocchio they
were compiled with only (crocoddyl 3.2.1: Pinocchio 4.0.0, as in scripts/constraints.txt).

Run it with ``python scripts/examples/reach_a_pose_with_crocoddyl.py [CALIBRATION_FOLDER]``.
"""

import crocoddyl
import numpy as np
import pinocchio as pin
import virtual_robot

from irbcal.units import DEG, MM

NODES, STEP = 40, 0.025
"""One second of motion."""
GOAL, REST, ACCELERATION, LIMITS = 1e7, 1e2, 1e-2, 1e4
"""Weights of the costs."""


def shooting_problem(model, start, frame, T_universe_goal):
    """From rest at a configuration to a pose of a frame, at rest again.

    Parameters
    ----------
    model : pinocchio.Model
    start : ndarray, shape (nq,)
    frame : str
    T_universe_goal : ndarray, shape (4, 4)

    Returns
    -------
    crocoddyl.ShootingProblem
    """
    state = crocoddyl.StateMultibody(model)
    actuation = crocoddyl.ActuationModelFull(state)
    x0 = np.concatenate([start, np.zeros(model.nv)])
    place = crocoddyl.ResidualModelFramePlacement(state, model.getFrameId(frame), pin.SE3(T_universe_goal))
    bounds = crocoddyl.ActivationBounds(
        np.concatenate([model.lowerPositionLimit, -model.velocityLimit]),
        np.concatenate([model.upperPositionLimit, model.velocityLimit]),
    )
    inside = crocoddyl.ActivationModelQuadraticBarrier(bounds)
    speeds = crocoddyl.ActivationModelWeightedQuad(np.repeat([0.0, 1.0], model.nv))
    everywhere = {
        "smooth": (
            crocoddyl.CostModelResidual(state, crocoddyl.ResidualModelJointAcceleration(state, actuation.nu)),
            ACCELERATION,
        ),
        "limits": (
            crocoddyl.CostModelResidual(state, inside, crocoddyl.ResidualModelState(state, 0.0 * x0)),
            LIMITS,
        ),
    }
    at_the_end = {
        "goal": (crocoddyl.CostModelResidual(state, place), GOAL),
        "rest": (crocoddyl.CostModelResidual(state, speeds, crocoddyl.ResidualModelState(state, x0)), REST),
    }

    def node(costs, step):
        total = crocoddyl.CostModelSum(state)
        for name, (cost, weight) in costs.items():
            total.addCost(name, cost, weight)
        dynamics = crocoddyl.DifferentialActionModelFreeFwdDynamics(state, actuation, total)
        return crocoddyl.IntegratedActionModelEuler(dynamics, step)

    return crocoddyl.ShootingProblem(x0, [node(everywhere, STEP)] * NODES, node(at_the_end, 0.0))


def motion(calibrated, frame, T_universe_goal):
    """Commands of a motion from the home position to a goal.

    Parameters
    ----------
    calibrated : CalibratedModel
    frame : str
    T_universe_goal : ndarray, shape (4, 4)

    Returns
    -------
    ndarray, shape (NODES + 1, joints)
    """
    model = calibrated.model
    start = calibrated.model_from_command(virtual_robot.home(calibrated))[0]
    problem = shooting_problem(model, start, frame, T_universe_goal)
    solver = crocoddyl.SolverFDDP(problem)
    solver.th_stop = 1e-9
    x0 = problem.x0
    solver.solve([x0] * (NODES + 1), problem.quasiStatic([x0] * NODES), 100, False)
    path = np.array(solver.xs)[:, : model.nq]
    return calibrated.command_from_model(path, path=True)


def plan(calibrated, frame, T_universe_goals):
    """First and last command of the motion to each goal, (n, 2, joints)."""
    return np.array([motion(calibrated, frame, goal)[[0, -1]] for goal in T_universe_goals])


def main(folder, n=8):
    """Move to some goals; on the simulated demo, also see what the calibration is worth."""
    side = virtual_robot.calibrated(folder)
    frame, T_world_goals = virtual_robot.frame_to_place(side), virtual_robot.goals(side, n)
    T_universe_goals = side.in_universe(T_world_goals)
    paths = np.array([motion(side.model, frame, goal) for goal in T_universe_goals])
    left = side.model.placement(paths[:, -1], frame, "universe", paths[:, 0])[:, :3, 3] - T_universe_goals[:, :3, 3]
    fastest = np.abs(np.diff(paths, axis=1)).max() / STEP / DEG
    print(
        f"{n} motions of {NODES * STEP:g} s for {frame}, at most {fastest:.0f} degrees/s; "
        f"by the calibrated model they end {np.linalg.norm(left, axis=1).max() / MM:.1e} mm from their goals"
    )
    if virtual_robot.is_demo(folder):
        return virtual_robot.compare_on_the_simulated_robot(folder, plan, T_world_goals)
    return None


if __name__ == "__main__":
    main(virtual_robot.folder_from_command_line(__doc__))
