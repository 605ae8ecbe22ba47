"""Poses made from joints within the limits, of many arms: random ones, and those at and next to singularities and limits."""

import numpy as np
from support import random_robot

from irbcal.io import urdf
from irbcal.io.opening import Opened
from irbcal.kinematics import inverse_kinematics
from irbcal.modeling import frames
from irbcal.modeling.inverse import any_arm
from irbcal.modeling.inverse.newton import CalibratedChain
from irbcal.modeling.inverse.poses import pose_columns
from irbcal.modeling.robot import Robot

GRID = 60


def with_errors(name, millimetres, seed=0):
    """A robot by its name, with errors of its frames that move the tip by about so much at most; SIMULATED."""
    arm = urdf.read(name).arm
    q = arm.random_joints(500, 0)
    q -= 2 * np.pi * np.rint(q / (2 * np.pi)) * ~arm.table.prismatic
    size, level = 0.1, "34" if arm.bends_like_the_thesis else "placement"
    for _ in range(4):
        robot = random_robot(arm, level, np.random.default_rng(seed), size)
        size *= 1e-3 * millimetres / np.linalg.norm((robot.poses(q) - arm.forward(q))[:, :3, 3], axis=1).max()
    return Opened(name, robot, arm, None, None, None, None)


def unsolved(opened, T, near=None):
    """Which poses (n, 4, 4) have no joints within the limits whose forward kinematics is the pose."""
    arm, q = opened.nominal, inverse_kinematics(opened, T, near=near).joints
    solved = np.isfinite(q).all(axis=1)
    reached = opened.robot.poses(np.where(solved[:, None], q, 0.0))
    off = np.maximum(
        np.linalg.norm(reached[:, :3, 3] - T[:, :3, 3], axis=1),
        frames.rotation_distance(reached[:, :3, :3], T[:, :3, :3]),
    )
    inside = ((q >= arm.lower - 1e-9) & (q <= arm.upper + 1e-9)).all(axis=1)
    return ~(solved & inside & (off < 1e-9))


def random(opened, n, rng):
    """Anywhere within the limits."""
    return opened.nominal.random_joints(n, int(rng.integers(2**31)))


def at_limits(opened, n, rng):
    """A third of the joints at a limit."""
    arm, q = opened.nominal, random(opened, n, rng)
    ends = np.where(rng.random(q.shape) < 0.5, arm.lower, arm.upper)
    return np.where((rng.random(q.shape) < 0.33) & np.isfinite(ends), ends, q)


def singular(opened, n, rng, q=None, joints=(1, 2, 4)):
    """One joint turned until the nominal arm is at a singularity: to rounding; those that have none are left out."""
    arm, chain = opened.nominal, CalibratedChain(Robot(opened.nominal), any_arm.reach(opened.nominal))
    q = random(opened, n, rng) if q is None else q
    rows, joint = np.arange(n), rng.choice(joints, n)

    def determinant(value):
        many = np.repeat(q[:, None], value.shape[1], axis=1)
        many[rows, :, joint] = value
        flat = many.reshape(-1, q.shape[1]).T.copy()
        J = chain.linearised(pose_columns(np.broadcast_to(np.eye(4), (flat.shape[1], 4, 4))), flat)[0]
        return np.linalg.det(J[:, :, :6]).reshape(n, -1)  # an arm with seven: while the last joint stays

    low, high = (np.clip(limit, -np.pi, np.pi)[joint][:, None] for limit in (arm.lower, arm.upper))
    value = low + (high - low) * np.linspace(0, 1, GRID)
    sign = determinant(value)
    roots = (sign[:, 1:] * sign[:, :-1] < 0) * rng.random((n, GRID - 1))
    k = roots.argmax(axis=1)
    low, high, at_low = (x[rows, i][:, None] for x, i in ((value, k), (value, k + 1), (sign, k)))
    for _ in range(60):
        middle = 0.5 * (low + high)
        same = determinant(middle) * at_low > 0
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    has = roots[rows, k] > 0
    q = q.copy()
    q[rows[has], joint[has]] = low[has, 0]
    return q[has]


def near_singular(opened, n, rng):
    """Next to a singularity, by 1e-12 to 1e-2 rad."""
    q = singular(opened, n, rng)
    q += 10.0 ** rng.uniform(-12, -2, (len(q), 1)) * rng.standard_normal(q.shape)
    return np.clip(q, opened.nominal.lower, opened.nominal.upper)


def singular_at_limits(opened, n, rng):
    """At a singularity, with a third of the joints at a limit."""
    return singular(opened, n, rng, at_limits(opened, n, rng))


def twice_singular(opened, n, rng):
    """At a singularity of the wrist and at one of the arm, of the shoulder or of the elbow."""
    seed = int(rng.integers(2**31))
    arm = singular(opened, n, np.random.default_rng(seed), joints=(1, 2))
    q5 = singular(opened, len(arm), rng, arm + 1e-3, joints=(4,))
    arm = arm[: len(q5)]
    arm[:, 4] = q5[:, 4]
    return arm


KINDS = (random, at_limits, singular, near_singular, singular_at_limits, twice_singular)
