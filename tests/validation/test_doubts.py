"""Doubts about data that contradict the model: none about good runs, and the right ones about bad ones."""

from dataclasses import replace

import numpy as np
import pytest
from support import TARGETS, arm, measured, random_robot

from irbcal.identification.fit import identify
from irbcal.validation import doubts
from irbcal.validation.doubts import PoseEquations


def simulated(seed, poses=80, **options):
    rng = np.random.default_rng(seed)
    robot = random_robot(arm(), "34", rng, **options)
    return robot, measured(robot, arm().random_joints(poses, seed), 5e-5, rng)


def said(points, level="34"):
    fits = [identify(arm(), points, name) for name in ("nominal", level)]
    return doubts.doubts(*fits, points, [points])


@pytest.mark.parametrize("seed", range(6))
def test_good_runs_are_not_doubted(seed):
    _, points = simulated(seed)
    assert said(points) == []
    assert doubts.contradicting_parts(PoseEquations(arm(), points)) == []


def test_a_tool_that_was_changed():
    robot, points = simulated(1)
    other = robot.replace(targets={name: np.add(place, [0.0, 0.0, 2e-3]) for name, place in TARGETS.items()})
    late = points.pose >= 40
    (words,) = said(replace(points, xyz=np.where(late[:, None], points.predicted(other), points.xyz)))
    assert words.startswith("The poses before and after pose 40 or thereabouts contradict one another")


def test_another_robot():
    robot, points = simulated(2)
    other = random_robot(arm(), "34", np.random.default_rng(9), T_world_base=robot.T_world_base)
    late = points.pose >= 40
    found = said(replace(points, xyz=np.where(late[:, None], points.predicted(other), points.xyz)))
    assert any("contradict one another" in words or "moved" in words for words in found)


def test_parts_of_other_joints_are_not_compared():
    """A program that moves one joint after the other has parts that differ, whatever the robot."""
    robot, _ = simulated(3)
    q = np.zeros((90, 6))
    for k in range(6):
        q[15 * k : 15 * k + 15, k] = np.linspace(-0.8, 0.8, 15)
    points = measured(robot, q + 0.1, 5e-5, np.random.default_rng(3))
    assert doubts.contradicting_parts(PoseEquations(arm(), points)) == []


def test_a_wrong_scale_is_no_link_length():
    _, points = simulated(4)
    (words,) = said(replace(points, xyz=points.xyz * 1.006))
    assert words.startswith("All positions are 0.48% too long for this robot")


def test_residuals_that_no_robot_leaves():
    _, points = simulated(5)
    rough = points.xyz + np.random.default_rng(5).normal(0.0, 2e-3, points.xyz.shape)
    assert any("still misses the fitted points" in words for words in said(replace(points, xyz=rough)))


def test_a_lost_zero_that_the_model_explains_is_no_doubt_but_said():
    _, points = simulated(6)
    q = points.q.copy()
    q[:, 2] += np.radians(3.0)
    off = replace(points, q=q)
    nominal, fit = (identify(arm(), off, level) for level in ("nominal", "34"))
    assert doubts.doubts(nominal, fit, off, [off]) == []
    (words,) = doubts.cautions(nominal, fit)
    assert "was a joint's zero lost" in words


def test_an_arm_that_warms_up_is_not_a_tracker_that_moves():
    """The demonstration (SIMULATED) begins with a cold arm; a tracker that moves besides is still seen."""
    import pandas as pd

    import irbcal
    from irbcal.io import robots

    table = pd.read_csv(robots.demo_file("demo_identification.csv"))
    found = irbcal.calibrate(table, "irb1600", holdout=0)
    assert found.proven.doubts == ()
    fit = found.proven.fit
    elapsed = np.asarray(fit.motion.elapsed)
    away = np.linalg.norm(fit.warmth(fit.points, elapsed), axis=1)
    warm = fit.warmth(fit.points, np.full_like(elapsed, elapsed.max()))
    assert np.abs(warm).max() < 1e-12, "it counts from the end of the measurement"
    left = fit.points.xyz - fit.points.predicted(fit.robot)
    cold = fit.points.pose < 12
    assert away[cold].mean() > 5e-5
    better = np.linalg.norm(left - fit.warmth(fit.points, elapsed), axis=1)[cold].mean()
    assert better < 0.5 * np.linalg.norm(left[cold], axis=1).mean()
    rows = (table["pose"] > 60) & ~table["target"].str.startswith("ref")
    table.loc[rows, "x_mm"] += 1.0
    assert any("From pose 6" in doubt for doubt in irbcal.calibrate(table, "irb1600", holdout=0).record.doubts)
