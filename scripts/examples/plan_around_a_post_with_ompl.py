"""A way around a post with OMPL on a calibrated robot, collisions by coal where the real links are.

OMPL samples effective joints within the limits of the calibrated model; a state is valid where the solids of the
corrected URDF do not touch one another, and stay away from the post by a margin: OMPL checks states, not what lies
between them. The way becomes commands through the joint map, and these are
followed once more: the clearance that is printed is that of the commands.

Run it with ``python scripts/examples/plan_around_a_post_with_ompl.py [CALIBRATION_FOLDER]``.
"""

import check_collisions_with_coal as collisions
import numpy as np
import pinocchio as pin
import virtual_robot
from ompl import base, geometric, util

from irbcal.modeling import frames
from irbcal.modeling.inverse import any_arm
from irbcal.modeling.robot import Robot
from irbcal.units import DEG, MM

SECONDS = 10.0
"""For a way; it takes a fraction of that."""
MARGIN = 10 * MM
"""Distance from the post that states keep."""
RESOLUTION = 0.005
"""Share of the space between two states that are checked."""

util.setLogLevel(util.LogLevel.LOG_ERROR)
util.RNG.setSeed(1)


def configuration_at(calibrated, frame, T_universe_goal):
    """Effective joints with a frame at a goal, near the home position, as a configuration (nq,)."""
    model, arm = calibrated.model, calibrated.arm
    tip = calibrated.placement(virtual_robot.home(calibrated))
    T_tip_frame = frames.inverse(tip) @ calibrated.placement(virtual_robot.home(calibrated), frame)
    T = frames.inverse(calibrated.T_universe_base) @ T_universe_goal @ frames.inverse(T_tip_frame[0])
    near = calibrated.model_from_command(virtual_robot.home(calibrated))[0]
    found = any_arm.solve(Robot(arm), arm, T[None], near)
    if not found.converged[0] or (found.joints < model.lowerPositionLimit).any():
        raise SystemExit("the goal is out of reach")
    return found.joints[0]


def way(model, geometry, start, goal):
    """A way between two configurations that touches nothing.

    Parameters
    ----------
    model : pinocchio.Model
    geometry : pinocchio.GeometryModel
    start, goal : ndarray, shape (nq,)

    Returns
    -------
    ndarray, shape (n, nq)
    """
    bounds = base.RealVectorBounds(model.nq)
    for k in range(model.nq):
        bounds.setLow(k, float(model.lowerPositionLimit[k]))
        bounds.setHigh(k, float(model.upperPositionLimit[k]))
    space = base.RealVectorStateSpace(model.nq)
    space.setBounds(bounds)
    setup = geometric.SimpleSetup(space)
    data, placed = model.createData(), geometry.createData()
    for k, pair in enumerate(geometry.collisionPairs):
        if "post" in (geometry.geometryObjects[pair.first].name, geometry.geometryObjects[pair.second].name):
            placed.collisionRequests[k].security_margin = MARGIN

    def free(state):
        q = np.array([state[k] for k in range(model.nq)])
        return not pin.computeCollisions(model, data, geometry, placed, q, True)

    setup.setStateValidityChecker(free)
    information = setup.getSpaceInformation()
    information.setStateValidityCheckingResolution(RESOLUTION)
    setup.setPlanner(geometric.RRTConnect(information))
    ends = []
    for q in (start, goal):
        state = space.allocState()
        for k in range(model.nq):
            state[k] = float(q[k])
        ends.append(state)
    setup.setStartAndGoalStates(*ends)
    if not setup.solve(SECONDS) or not setup.haveExactSolutionPath():
        raise SystemExit("no way was found")
    setup.simplifySolution(1.0)
    path = setup.getSolutionPath()
    path.interpolate(80)
    return np.array([[path.getState(i)[k] for k in range(model.nq)] for i in range(path.getStateCount())])


def commands(calibrated, frame, T_universe_goal):
    """Commands from the home position, turned away by 30 degrees, to a goal, (n, joints); and their clearance."""
    geometry = collisions.solids(calibrated)
    collisions.add_obstacle(calibrated.model, geometry, "post", *collisions.post_under(calibrated))
    start = collisions.paths(calibrated)["straight"][:1]
    start = calibrated.model_from_command(start)[0]
    goal = configuration_at(calibrated, frame, T_universe_goal)
    q = calibrated.command_from_model(way(calibrated.model, geometry, start, goal), path=True)
    return q, collisions.follow(calibrated, geometry, q)


def behind_the_post(side, n):
    """Poses of the frame to place in the measuring frame, behind the post, (n, 4, 4)."""
    end = collisions.paths(side.model)["straight"][-1]
    q = end + np.random.default_rng(3).uniform(-8, 8, (n, 6)) * DEG
    T = side.model.placement(q, virtual_robot.frame_to_place(side), "universe")
    return side.robot.T_world_base @ frames.inverse(side.model.T_universe_base) @ T


def plan(calibrated, frame, T_universe_goals):
    """The last two commands of the way to each goal, (n, 2, joints)."""
    return np.array([commands(calibrated, frame, goal)[0][-2:] for goal in T_universe_goals])


def main(folder, n=3):
    """Go around the post to some goals; on the simulated demo, also see what the calibration is worth."""
    side = virtual_robot.calibrated(folder)
    frame, T_world_goals = virtual_robot.frame_to_place(side), behind_the_post(side, n)
    found = []
    for goal in side.in_universe(T_world_goals):
        q, distances = commands(side.model, frame, goal)
        metres, step, pair = distances.closest_to("post")
        found.append((q, distances))
        print(f"{len(q)} commands around the post, nearest {metres / MM:.1f} mm at {step + 1}, {' and '.join(pair)}")
    if virtual_robot.is_demo(folder):
        return found, virtual_robot.compare_on_the_simulated_robot(folder, plan, T_world_goals)
    return found, None


if __name__ == "__main__":
    main(virtual_robot.folder_from_command_line(__doc__))
