"""Base and tool without a guess."""

import numpy as np
import pytest
from support import arm, measured, random_robot, random_rotation

from irbcal.errors import IdentificationError
from irbcal.identification import initial_guess
from irbcal.identification.fit import identify
from irbcal.identification.problem import Problem
from irbcal.measurement.points import PointSet
from irbcal.modeling import frames


def anywhere(rng, robot):
    """The same robot with tracker and tool somewhere else."""
    targets = {f"t{k}": rng.uniform(-0.4, 0.4, 3) for k in range(3)}
    return robot.replace(T_world_base=frames.transform(random_rotation(rng), rng.uniform(-8, 8, 3)), targets=targets)


def test_a_hundred_tracker_places_and_tools_reach_the_same_minimum():
    """20 poses, 3 targets, 0.05 mm of noise in the base link: base and tool are free, so the minimum is the same."""
    nominal = arm()
    rng = np.random.default_rng(11)
    robot = random_robot(nominal, "34", rng)
    q = nominal.random_joints(20, 3)
    noise = 5e-5 * rng.standard_normal((60, 3))
    reference = measured(robot, q)
    corners = frames.apply(frames.inverse(robot.T_world_base), reference.xyz)  # true points in the base link
    rss, errors = [], []
    for _ in range(100):
        T = frames.transform(random_rotation(rng), rng.uniform(-8, 8, 3))
        points = type(reference)(
            q, reference.pose, reference.target, frames.apply(T, corners + noise), reference.target_names,
            reference.pose_ids, reference.groups,
        )  # fmt: skip
        fit = identify(nominal, points, "34")
        rss.append(fit.solution.rss)
        errors.append(fit.solution.state.errors)
    spread = np.ptp(np.array(rss)) / np.mean(rss)
    assert spread < 1e-9
    assert np.ptp(np.array(errors), axis=0).max() < 1e-9


def test_a_hundred_tool_geometries_are_found_too():
    nominal = arm()
    rng = np.random.default_rng(12)
    robot = random_robot(nominal, "11", rng)
    q = nominal.random_joints(20, 4)
    worst = 0.0
    for _ in range(100):
        other = anywhere(rng, robot)
        fit = identify(nominal, measured(other, q), "11")
        predicted = np.concatenate([fit.robot.points(q, name) - other.points(q, name) for name in other.targets])
        worst = max(worst, np.abs(predicted).max())
    assert worst < 1e-9


@pytest.mark.parametrize("known", [0, 1, 3])
def test_closed_form_is_exact_for_a_nominal_robot_with_some_targets_known(known):
    nominal = arm()
    robot = random_robot(nominal, "nominal", np.random.default_rng(0))
    targets = {name: robot.targets[name] for name in [*robot.targets][:known]}
    problem = Problem(nominal, measured(robot, nominal.random_joints(10, 0)), (), known_targets=targets)
    state, spread = initial_guess.closed_form(problem)
    assert spread > 1e-3
    assert np.abs(state.T_world_base - robot.T_world_base).max() < 1e-10
    assert np.abs(state.targets - np.array(list(robot.targets.values()))).max() < 1e-10


def test_data_on_which_the_closed_form_is_open_still_find_the_minimum():
    """Three poses of two targets: as many equations as the linear start has unknowns, and those dependent."""
    nominal = arm()
    rng = np.random.default_rng(1)
    robot = random_robot(nominal, "nominal", rng, targets={"a": [0.1, 0, 0.2], "b": [0, 0.1, 0.1]})
    q = nominal.random_joints(3, 5)
    fit = identify(nominal, measured(robot, q), "nominal")
    assert max(np.abs(fit.robot.points(q, t) - robot.points(q, t)).max() for t in robot.targets) < 1e-9


def test_too_few_points_for_a_start_are_counted():
    nominal = arm()
    robot = random_robot(nominal, "nominal", np.random.default_rng(0), targets={"a": [0.1, 0, 0.2]})
    with pytest.raises(IdentificationError, match="3 points of 3 poses"):
        identify(nominal, measured(robot, nominal.random_joints(3, 1)), "nominal")


def test_poses_that_only_turn_one_joint_are_refused():
    nominal = arm()
    robot = random_robot(nominal, "nominal", np.random.default_rng(0))
    q = np.zeros((20, 6))
    q[:, 0] = np.linspace(-1, 1, 20)
    with pytest.raises(IdentificationError, match="do not determine base and tool"):
        identify(nominal, measured(robot, q), "nominal")


@pytest.mark.parametrize("moving", [(0, 1), (3, 4), (0, 1, 2)])
def test_full_poses_with_some_joints_moving(moving):
    """A grid over a few joints of seven: the minimum is that from the true base and tool, at any place of these."""
    import irbcal

    nominal = irbcal.read_urdf("panda").arm
    rng = np.random.default_rng(3)
    q = np.tile([0.0, 0.0, 0.0, -1.8, 0.0, 1.9, 0.5], (49, 1))
    q[:, moving] += rng.uniform(-0.6, 0.6, (49, len(moving)))
    for _ in range(5):
        T_world_base = frames.transform(random_rotation(rng), rng.uniform(-3, 3, 3))
        T_tip_target = frames.transform(random_rotation(rng), rng.uniform(-0.2, 0.2, 3))
        T = T_world_base @ nominal.forward(q) @ T_tip_target
        T[:, :3, 3] += 3e-4 * rng.standard_normal((49, 3))
        count = np.arange(49)
        points = PointSet(
            q, count, np.zeros(49, dtype=int), T[:, :3, 3], ("probe",), count.astype(str), np.full(49, ""),
            rotation=T[:, :3, :3],
        )  # fmt: skip
        fit = identify(nominal, points, "nominal")
        off = frames.rotation_distance(fit.robot.T_world_base[:3, :3], T_world_base[:3, :3])
        assert fit.rms < 1e-3
        assert off < 2e-3
        hand_eye = initial_guess.hand_eye(Problem(nominal, points, ()))
        assert frames.rotation_distance(hand_eye.T_world_base[:3, :3], T_world_base[:3, :3]) < 1e-6
        assert np.abs(hand_eye.targets[0] - T_tip_target[:3, 3]).max() < 2e-3
