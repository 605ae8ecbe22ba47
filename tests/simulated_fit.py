"""A simulated least-squares problem, solved, for the objectives that start from it."""

from dataclasses import replace

import numpy as np
from support import arm, measured, random_robot

from irbcal.identification import fit, initial_guess, least_squares
from irbcal.identification.problem import Problem
from irbcal.measurement.points import PointSet


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


def predicted_covariance(fit, q, target):
    """Covariance of a predicted target from that of the parameters, by the derivatives of the fit's own problem."""
    names, n, state = fit.problem.points.target_names, len(q), fit.solution.state
    at, none = np.arange(n), np.full(n, "")
    there = PointSet(q, at, np.full(n, names.index(target)), np.zeros((n, 3)), names, at, none)
    problem = Problem(fit.problem.arm, there, fit.problem.parameters, fit.problem.known_targets)
    C, turns = fit.solution.information.covariance(), np.arange(problem.nuisance, fit.problem.nuisance)
    C = np.delete(np.delete(C, turns, axis=0), turns, axis=1)  # target frames do not move places
    J = state.T_world_base[:3, :3] @ problem.jacobian(state).reshape(n, 3, -1)
    return J @ C @ J.transpose(0, 2, 1)
