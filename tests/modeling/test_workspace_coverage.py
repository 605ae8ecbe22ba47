"""Calibrations from a corner of the workspace: the warning comes, names the size of the danger, and only then comes."""

from dataclasses import replace

import numpy as np
import pytest
from evidence_cases import Truth, irb120
from support import arm, measured, random_robot

import irbcal
from irbcal.identification.evidence import identify_evidence
from irbcal.identification.fit import certainty_of, identify
from irbcal.measurement.points import distances
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.workspace_coverage import WorkspaceCoverage, _limits, workspace_coverage
from irbcal.units import MM

MIDDLE = np.radians([20.0, 20, 0, 30, 40, 10])


def box(model, width, n, seed):
    """Random joints in a box about some pose, ``width`` of the limits wide."""
    half = 0.5 * width * (model.upper - model.lower)
    middle = np.clip(MIDDLE, model.lower + half, model.upper - half)
    return middle + half * np.random.default_rng(seed).uniform(-1.0, 1.0, (n, 6))


def fitted(points, motion, level):
    """Calibrated robot with its certainty, and the nominal one."""
    model = arm("irb120")
    nominal = identify(model, points, "nominal").robot
    if level == "auto":
        return identify_evidence(model, points, motion).robot, nominal
    fit = identify(model, points, level)
    return fit.robot.replace(certainty=certainty_of(fit)), nominal


def case(width, seed, level):
    """What is expected elsewhere of a robot with physics beyond the levels, and its true errors (rms, metres) there."""
    truth = Truth(["gravity", "gain", "harmonics"], seed)
    motion = Motion(box(truth.nominal, width, 60, seed))
    robot, nominal = fitted(truth.measured(motion, 3e-5), motion, level)
    test = truth.measured(Motion(truth.nominal.random_joints(200, 99)), 0.0)
    errors = [float(np.sqrt(np.mean(distances(item, test) ** 2))) for item in (robot, nominal)]
    return workspace_coverage(robot, nominal, motion.q), errors


@pytest.mark.parametrize(("width", "level"), [(0.1, "34"), (0.2, "auto"), (0.2, "placement")])
def test_a_corner_is_told_with_its_danger(width, level):
    found, (true, _) = case(width, 1, level)
    assert found.narrow
    np.testing.assert_allclose(found.shares[:5], width, rtol=0.2)
    assert true > 3.0 * found.here_mm * MM  # the danger is real
    words = found.in_words()
    assert words.startswith("Calibrated only where measured: ")
    assert f"{found.there_mm / found.here_mm:.1f} times those at poses like the fitted ones" in words


@pytest.mark.parametrize(("width", "seed"), [(0.1, 1), (0.2, 2), (0.4, 3)])
def test_the_expected_error_of_an_average_is_that_of_the_truth(width, seed):
    found, (true, _) = case(width, seed, "auto")
    assert 0.5 < found.there_mm * MM / true < 2.0


def test_worse_than_nominal_is_never_silent():
    worse = 0
    for width, seed in ((0.05, 1), (0.05, 4), (0.05, 5), (0.07, 1), (0.07, 3), (0.1, 2)):
        found, (true, nominal) = case(width, seed, "34")
        worse += true > nominal
        assert true < nominal or "may be worse than the nominal robot" in found.in_words()
    assert worse >= 3


def test_a_plan_leads_to_no_warning():
    q = irbcal.plan("irb120").q
    robot = random_robot(arm("irb120"), "34", np.random.default_rng(3), size=0.1)
    points = measured(robot, q, 3e-5, np.random.default_rng(4))
    for level in ("auto", "34"):
        found = workspace_coverage(*fitted(points, Motion.in_order(q), level), q)
        assert not found.narrow
        assert found.in_words() == ""
        assert found.share > 0.9


def test_a_robot_measured_in_its_cell_has_none(shared_data):
    seen = irb120(shared_data)
    rows = np.arange(seen.points.poses) < 200
    points, motion = seen.points.select(rows), seen.motion.select(rows)
    found = workspace_coverage(*fitted(points, motion, "auto"), motion.q)
    assert not found.narrow
    assert 0.7 < found.share < 0.9


def test_joints_that_turn_for_ever_are_looked_at_for_one_turn():
    model = arm("irb120")
    endless = replace(model, lower=np.array([-np.inf, *model.lower[1:]]), upper=np.array([np.inf, *model.upper[1:]]))
    ranges = np.array([model.lower, model.upper]) * 0.5 + 0.2
    lower, upper = _limits(endless, ranges)
    assert (lower[0], upper[0]) == pytest.approx((0.2 - np.pi, 0.2 + np.pi))
    turn = _limits(model, ranges)
    np.testing.assert_array_equal(lower[1:5], model.lower[1:5])
    assert turn[1][5] - turn[0][5] == pytest.approx(2 * np.pi)  # joint 6 may turn by 800 degrees
    assert model.lower[5] - 1e-12 <= turn[0][5]
    assert turn[1][5] <= model.upper[5] + 1e-12


def test_without_certainty_nothing_is_said():
    robot = random_robot(arm("irb120"), "34", np.random.default_rng(3))
    assert workspace_coverage(robot, robot, np.zeros((3, 6))) is None


def test_words():
    wide = WorkspaceCoverage(shares=[0.9] * 6, here_mm=0.1, there_mm=0.2, difference_mm=1.0)
    assert wide.in_words() == ""
    grown = wide.model_copy(update={"there_mm": 0.4})
    assert "errors of 0.400 mm (rms) or more must be expected, 4.0 times" in grown.in_words()
    assert "nominal" in grown.in_words()
    assert "nominal" not in grown.model_copy(update={"difference_mm": 2.0}).in_words()
    assert wide.model_copy(update={"shares": [0.4] * 6}).narrow


def test_proof_poses_all_over_the_limits_leave_nothing_to_expect():
    """Circles of 40 degrees on clean data of one robot: proven at 300 poses anywhere, which no expectation outweighs."""
    model, q = arm(), np.zeros((108, 6))
    q[:, 4] = np.radians(30.0)
    for joint in range(6):
        q[18 * joint : 18 * joint + 18, joint] = np.radians(np.linspace(-40.0, 40.0, 18))
    points = measured(random_robot(model, "26", np.random.default_rng(3)), q, 1e-5, np.random.default_rng(4))
    fit, nominal = identify(model, points, "26"), identify(model, points, "nominal").robot
    robot = fit.robot.replace(certainty=certainty_of(fit))
    proof = model.random_joints(300, 5)
    assert workspace_coverage(robot, nominal, q).narrow
    assert workspace_coverage(robot, nominal, q, proof) is None
    corner = np.vstack([0.3 * proof, model.lower, model.upper])
    assert workspace_coverage(robot, nominal, q, corner).narrow, "two poses at the ends are no proof in between"


def test_a_joint_that_cannot_move_is_covered():
    model = replace(arm(), lower=np.append(arm().lower[:5], 0.2), upper=np.append(arm().upper[:5], 0.2))
    q = 0.3 * model.random_joints(60, 1)
    q[:, 5] = 0.2
    points = measured(random_robot(model, "11", np.random.default_rng(3)), q, 1e-5, np.random.default_rng(4))
    fit, nominal = identify(model, points, "11"), identify(model, points, "nominal").robot
    found = workspace_coverage(fit.robot.replace(certainty=certainty_of(fit)), nominal, q)
    assert found.shares[5] == 1.0
    assert max(found.shares[:5]) < 0.4


def test_what_is_expected_is_bounded_by_the_difference_from_the_nominal_robot():
    """Scatter of a combination that the poses hardly show is no error of the size of the cell."""
    truth = Truth(["gravity"], 1)
    motion = Motion(box(truth.nominal, 0.1, 60, 1))
    robot, nominal = fitted(truth.measured(motion, 3e-5), motion, "34")
    vague = replace(robot.certainty, covariance=1e8 * robot.certainty.covariance)
    found = workspace_coverage(robot.replace(certainty=vague), nominal, motion.q)
    assert found.there_mm <= found.here_mm + 2.0 * found.difference_mm + 1e-9
