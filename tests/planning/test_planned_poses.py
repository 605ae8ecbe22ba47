"""A plan as data: when each reflector is measured, and where it is expected."""

import numpy as np
import pytest
from design_support import PLACES, TARGETS, poses
from support import arm, measured, random_robot

from irbcal.identification.fit import identify
from irbcal.modeling import frames
from irbcal.planning import measuring_plan
from irbcal.planning.choosing import READINGS_S, Wish
from irbcal.planning.conditions import SOLID
from irbcal.planning.measuring_plan import make, plan
from irbcal.planning.optimal_design import Model
from irbcal.planning.scene import open_scene
from irbcal.units import DEG, MM


def test_expected_points_and_times_are_those_of_the_poses():
    made = plan("irb1600", axis=0, cube=3, all_range=0, without=SOLID, level="nominal", references=2, wait_s=3.0)
    pose, target, xyz, time = made.expected()
    assert len(pose) == made.asked.sum()
    T = made.scene.setting.arm.forward(made.q)
    for k in range(len(pose)):
        local = made.scene.setting.targets.places[target[k]]
        there = frames.apply(made.scene.T_world_base, T[pose[k], :3, :3] @ local + T[pose[k], :3, 3])
        np.testing.assert_allclose(xyz[k], there, rtol=0, atol=1e-12)
    first = np.flatnonzero(np.diff(pose, prepend=-1))
    np.testing.assert_allclose(time[first], made.stops + 3.0, rtol=0, atol=1e-9)
    count = made.asked[-1].sum() + 2
    assert made.duration_s == made.stops[-1] + 3.0 + READINGS_S * count


def test_times_follow_from_speed_wait_and_readings():
    """The first axis move: 30 degrees with the tip 815 mm from axis 1, at 250 mm/s."""
    scene = open_scene("irb1600", without=SOLID)
    made = make(scene, Wish(cube=0, all_range=0, level="nominal", speed=0.25, wait_s=3.0, references=0))
    _, _, _, time = made.expected()
    first = np.pi / 6 * 0.815 / 0.25
    assert time[:4] == pytest.approx([first + 3, first + 5.5, first + 8, first + 10.5 + first + 3], rel=1e-3)
    quick = make(scene, Wish(cube=0, all_range=0, level="nominal", speed=7.0, wait_s=3.0))
    assert quick.stops[0] == pytest.approx(30 / 150)  # joint 1 turns 150 degrees a second


def test_predicted_deviations_are_those_of_simulated_calibrations():
    nominal, noise, runs = arm(), 0.1 * MM, 150
    q, seen = poses(40, 7)
    model = Model(nominal, TARGETS, "16", noise)
    found = measuring_plan.predict(model, q, seen)
    rng = np.random.default_rng(0)
    robot = random_robot(nominal, "16", rng, targets=dict(zip(TARGETS.names, PLACES, strict=True)))
    exact, there = measured(robot, q), nominal.random_joints(40, 8)
    errors, misses = [], []
    for _ in range(runs):
        points = measured(robot, q, noise, rng).take(seen.ravel())
        fit = identify(nominal, points, "16")
        errors.append(fit.solution.state.errors)
        misses.append(np.sum((fit.robot.points(there, "smr2") - robot.points(there, "smr2")) ** 2, axis=1))
    assert len(exact) == 120
    deviations = np.std(errors, axis=0)
    factor = {"mm": MM, "deg": DEG}
    for item, seen_deviation in zip(found.parameters, deviations, strict=True):
        if item.state == "identified":
            assert seen_deviation == pytest.approx(item.std * factor[item.unit], rel=0.25), item.name
    assert sum(item.state == "identified" for item in found.parameters) >= 8
    predicted = found.position_std(there, "smr2")
    assert np.sqrt(np.mean(misses, axis=0)) == pytest.approx(predicted, rel=0.3)
    assert np.sqrt(np.mean(misses)) == pytest.approx(np.sqrt(np.mean(predicted**2)), rel=0.05)


def test_what_no_pose_shows_is_held_and_has_no_deviation():
    model = Model(arm(), TARGETS, "34")
    states = {item.name: item for item in measuring_plan.predict(model, *poses(60, 1)).parameters}
    assert states["delta_d6"].state == states["delta_theta6"].state == "held"
    assert states["delta_d2"].state == states["delta_d3"].state == "tied"
    assert states["delta_d6"].std is None
    assert states["delta_a2"].std > 0


def test_reflectors_that_no_pose_measures_are_left_out():
    q, seen = poses(40, 2)
    seen[:, 1] = False
    seen[~seen.any(axis=1), 0] = True
    found = measuring_plan.predict(Model(arm(), TARGETS, "11"), q, seen)
    assert found.model.targets.names == ("smr1", "smr3")
    assert found.position_std(q, "smr3").shape == (40,)
