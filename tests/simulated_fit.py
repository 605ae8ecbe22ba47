"""A simulated least-squares problem, solved, for the objectives that start from it."""

from dataclasses import replace

import numpy as np
from support import arm, measured, random_robot

from irbcal.identification import fit, initial_guess, least_squares


def simulated(level="16", poses=25, noise=5e-5, seed=0, outliers=0):
    nominal = arm()
    rng = np.random.default_rng(seed)
    robot = random_robot(nominal, level, rng)
    points = measured(robot, nominal.random_joints(poses, seed), noise, rng)
    if outliers:
        xyz = points.xyz.copy()
        xyz[rng.choice(len(xyz), outliers, replace=False)] += 5e-3 * rng.standard_normal((outliers, 3))
        points = replace(points, xyz=xyz)
    problem, _ = fit.make_problem(nominal, points, level)
    return problem, least_squares.solve(problem, initial_guess.first_state(problem)), robot
