"""The hat matrix and the jackknife against fits by brute force."""

import numpy as np
import pytest
from moving import random_commands, simulated

from irbcal.joint_behaviour.linearised import Linearised


def test_what_left_out_poses_say_agrees_with_leaving_them_out():
    # 30 poses: the errors of poses left out, by the hat matrix, against as many fits by brute force
    points, step, robot = simulated(
        random_commands(30, 4), None, np.radians([0.05, 0, 0, 0, 0, 0]), noise=1e-4, rng=np.random.default_rng(4)
    )
    model = Linearised(robot, points, step)
    X = -0.5 * model.per_joint(np.sign(step))[:, :1]
    found = model.test(X)
    design = np.hstack([model.basis(), X])
    errors, estimates = np.empty_like(model.r), []
    for pose in range(30):
        out = model.flat_pose == pose
        solution = np.linalg.lstsq(design[~out], model.r[~out], rcond=None)[0]
        errors[out] = model.r[out] - design[out] @ solution
        estimates.append(solution[-1])
    assert found.after == pytest.approx(model.size(errors), rel=1e-9)
    jackknife = 29 / 30 * np.sum((np.array(estimates) - found.beta[0]) ** 2)
    assert found.C[0, 0] == pytest.approx(jackknife, rel=1e-9)
