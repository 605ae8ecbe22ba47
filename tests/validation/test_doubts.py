"""Doubts about data that contradict the model: none about good runs, and the right ones about bad ones."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from support import TARGETS, arm, measured, random_robot

import irbcal
from irbcal.identification.fit import identify
from irbcal.io import robots
from irbcal.units import MM
from irbcal.validation import doubts
from irbcal.validation.length_scale import length_scale
from irbcal.validation.two_robots import PoseEquations, contradicting_parts


def simulated(seed, poses=80, **options):
    rng = np.random.default_rng(seed)
    robot = random_robot(arm(), "34", rng, **options)
    return robot, measured(robot, arm().random_joints(poses, seed), 5e-5, rng)


def said(points, level="34"):
    fits = [identify(arm(), points, name) for name in ("nominal", level)]
    return doubts.doubts(*fits, points, [points])


@pytest.mark.parametrize("seed", range(3))
def test_good_runs_are_not_doubted(seed):
    _, points = simulated(seed)
    assert said(points) == []
    assert contradicting_parts(PoseEquations(arm(), points)) == []


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
    table = pd.read_csv(robots.demo_file("demo_identification.csv"))
    table = table[table["target"] != "smr3"]
    found = irbcal.calibrate(table, "irb1600", holdout=0)
    assert found.validated.doubts == ()
    fit = found.validated.fit
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


@pytest.fixture(scope="module")
def points():
    rng = np.random.default_rng(8)
    nominal = arm()
    return measured(random_robot(nominal, "26", rng, size=0.06), nominal.random_joints(60, 8), 2e-5, rng)


def fits(points):
    return [identify(arm(), points, level) for level in ("nominal", "26")]


@pytest.mark.parametrize("scale", [1.0005, 0.9986])
def test_the_share_is_that_of_the_tracker(points, scale):
    plain, scaled = (fits(p)[1].robot.arm for p in (points, replace(points, xyz=scale * points.xyz)))
    before, after = (length_scale(arm(), robot) for robot in (plain, scaled))
    assert after.share - before.share == pytest.approx(scale - 1.0, rel=0.1)
    assert abs(before.share) < 3.0 * before.std


@pytest.mark.parametrize(("scale", "doubted"), [(1.0, False), (1.001, True)])
def test_a_wrong_scale_of_the_tracker_is_a_doubt(points, scale, doubted):
    seen = replace(points, xyz=scale * points.xyz)
    nominal, fit = fits(seen)
    assert fit.rms < 5e-5, "no residual shows it"
    said = doubts.doubts(nominal, fit, seen, [seen])
    assert any("scale bar" in words for words in said) == doubted


def test_large_errors_of_few_lengths_are_no_scale():
    """SIMULATED robots whose lengths scatter by a millimetre: 1 in 1,000 seems too long by Student's t, 3.3 sigma are 1 in 100."""
    rng = np.random.default_rng(3)
    doubted = np.zeros(2, dtype=int)
    for _ in range(400):
        table = arm().table
        a = table.a + np.where(table.a != 0.0, 1e-3, 0.0) * rng.standard_normal(len(table.a))
        d = table.d + np.where(table.d != 0.0, 1e-3, 0.0) * rng.standard_normal(len(table.d))
        scale = length_scale(arm(), arm().with_table(replace(table, a=a, d=d)))
        doubted += scale.beyond_machining, abs(scale.share) > 3.3 * scale.std
    assert doubted[0] <= 2
    assert doubted[1] >= 5


def test_no_length_identified_says_nothing():
    assert length_scale(arm(), arm()) is None


def test_the_certificate_says_that_the_scale_is_not_proven(record):
    proof = robots.demo_file("demo_verification.csv")
    judged = irbcal.evaluate(record, proof, tolerance=0.95 * MM)
    (words,) = [words for words in judged.origin.scope if "scale" in words]
    assert "not proven" in words
    assert f"Note: {words}" in judged.report()
    stated = irbcal.evaluate(record, proof, tolerance=0.95 * MM, info={"scale_bar": "1001.2 mm, no. 7"})
    assert any("1001.2 mm, no. 7" in words for words in stated.origin.scope)
    assert not any("not proven" in words for words in stated.origin.scope)
