"""A robot whose joint map depends on the side that joints come from, and its measurements."""

from dataclasses import replace

import numpy as np
from support import TARGETS, arm, measured

from irbcal.modeling import frames
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms import families
from irbcal.modeling.terms.term_map import TermMap


def sided_robot(name="irb120", size=3.0, others=(), seed=1):
    """A robot with terms of the last move of ``size`` natural sizes, and other families of terms of one."""
    nominal = arm(name)
    rng = np.random.default_rng(seed)
    terms, values = [], []
    for family, factor in (*((f, 1.0) for f in others), ("direction", size), ("move", size / 3)):
        mine = [t for t in families()[family].terms(nominal) if t.parameters.get("cycles_per_turn", 0) <= 2]
        terms += mine
        values += [factor * t.size * rng.standard_normal() for t in mine]
    lengths = {k: getattr(nominal.table, k) + 3e-4 * rng.standard_normal(6) for k in ("a", "d")}
    calibrated = nominal.with_table(replace(nominal.table, **lengths))
    joint_map = JointMap(TermMap(nominal, tuple(terms), np.array(values)))
    return Robot(calibrated, joint_map, frames.from_xyz_angles([0.4, -1.0, 0.2, 0.1, 0.2, -2.0]), TARGETS)


def sided_points(robot, n=40, seed=3, noise=0.0, q=None):
    """Points of stops in an order, at random joints unless given, measured as the robot goes there."""
    q = robot.arm.random_joints(n, seed) if q is None else q
    previous = np.vstack([np.full((1, q.shape[1]), np.nan), q[:-1]])
    points = replace(measured(robot, q), previous=previous)
    rng = np.random.default_rng(seed)
    return replace(points, xyz=points.predicted(robot) + noise * rng.standard_normal(points.xyz.shape))
