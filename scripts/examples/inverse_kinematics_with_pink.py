"""Differential inverse kinematics with pink on a calibrated robot.

Pink plans on the calibrated model, whose joints are effective angles; the joint map turns its result into commands.
Joint limits are pink's own, from the model, which keeps every command within the controller's limits.

Run it with ``python scripts/examples/inverse_kinematics_with_pink.py [CALIBRATION_FOLDER]``.
"""

import warnings

import numpy as np
import pink
import pinocchio as pin
import virtual_robot
from qpsolvers.warnings import SparseConversionWarning

from irbcal.units import MM

CLOSE = 1e-8
"""Task error at which the search ends, metres and radians."""
STEP = 0.1
"""Seconds for each step: with the URDF's speed limits, how far joints turn at once."""


def solve(model, start, frame, T_universe_goal, steps=200):
    """Configuration that brings a frame to a goal.

    Parameters
    ----------
    model : pinocchio.Model
    start : ndarray, shape (nq,)
    frame : str
    T_universe_goal : ndarray, shape (4, 4)
    steps : int

    Returns
    -------
    ndarray, shape (nq,)
    """
    task = pink.FrameTask(frame, position_cost=1.0, orientation_cost=0.3)
    task.set_target(pin.SE3(T_universe_goal))
    configuration = pink.Configuration(model, model.createData(), start)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SparseConversionWarning)  # a problem of six unknowns
        for _ in range(steps):
            if np.abs(task.compute_error(configuration)).max() < CLOSE:
                break
            velocity = pink.solve_ik(configuration, [task], STEP, solver="clarabel")
            configuration.integrate_inplace(velocity, STEP)
    return configuration.q


def plan(calibrated, frame, T_universe_goals):
    """Commands from the home position that bring a frame to each goal.

    Parameters
    ----------
    calibrated : CalibratedModel
    frame : str
    T_universe_goals : ndarray, shape (n, 4, 4)

    Returns
    -------
    ndarray, shape (n, 2, joints)
        Start and end.
    """
    start = calibrated.model_from_command(virtual_robot.home(calibrated))[0]
    ends = [solve(calibrated.model, start, frame, goal) for goal in T_universe_goals]
    # joints lean to the side that they come from: each goal is reached from the home position
    return np.array([calibrated.command_from_model([start, end], path=True) for end in ends])


def main(folder, n=8):
    """Reach some goals; on the simulated demo, also see what the calibration is worth."""
    side = virtual_robot.calibrated(folder)
    frame, T_world_goals = virtual_robot.frame_to_place(side), virtual_robot.goals(side, n)
    T_universe_goals = side.in_universe(T_world_goals)
    q = plan(side.model, frame, T_universe_goals)
    left = side.model.placement(q[:, 1], frame, "universe", q[:, 0])[:, :3, 3] - T_universe_goals[:, :3, 3]
    print(f"{n} goals for {frame}; by the calibrated model it ends {np.abs(left).max() / MM:.1e} mm from them")
    if virtual_robot.is_demo(folder):
        return virtual_robot.compare_on_the_simulated_robot(folder, plan, T_world_goals)
    return None


if __name__ == "__main__":
    main(virtual_robot.folder_from_command_line(__doc__))
