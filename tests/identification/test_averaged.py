"""The robot of an average of error models: simulated robots of the thesis, and what it says of itself."""

import pickle

import numpy as np
import pytest
from support import arm, measured, random_robot

from irbcal.errors import IdentificationError
from irbcal.identification.evidence import identify_evidence
from irbcal.identification.fit import identify
from irbcal.measurement.points import distances
from irbcal.modeling.terms.situation import Motion
from irbcal.validation.coverage import coverage


def cell(seed, poses=100, noise=2e-5):
    model, rng = arm("irb120"), np.random.default_rng(seed)
    robot = random_robot(model, "34", rng)
    return model, measured(robot, model.random_joints(poses, seed), noise, rng), robot


@pytest.fixture(scope="module")
def found():
    model, points, _ = cell(4)
    return identify_evidence(model, points, Motion.in_order(points.q))


def test_robots_of_the_thesis_keep_the_accuracy_of_its_level():
    ratios = []
    for seed in range(1, 7):
        model, points, robot = cell(seed)
        test = measured(robot, model.random_joints(300, 2))
        level = distances(identify(model, points, "34").robot, test).mean()
        average = identify_evidence(model, points, Motion.in_order(points.q))
        ratios.append(distances(average.robot, test).mean() / level)
    assert np.mean(ratios) < 1.04
    assert max(ratios) < 1.10


def test_parameters_are_those_of_the_covariance(found):
    rows = found.parameters()
    assert len(rows) == found.parameter_count == len(found.certainty.covariance)
    assert {row.state for row in rows} == {"identified"}
    assert len({row.name for row in rows}) == len(rows)
    std = {row.name: row.std for row in rows}
    spread = np.sqrt(np.diagonal(found.certainty.covariance))
    names = [row.name for row in rows]
    assert std["delta_a2"] == pytest.approx(1e3 * spread[names.index("delta_a2")], rel=1e-9)
    assert std["delta_alpha3"] == pytest.approx(np.degrees(spread[names.index("delta_alpha3")]), rel=1e-9)
    value = {row.name: row.value for row in rows}
    table, nominal = found.robot.arm.table, arm("irb120").table
    assert value["delta_a3"] == pytest.approx(1e3 * (table.a - nominal.a)[2], abs=1e-9)
    assert value["delta_alpha5"] == pytest.approx(np.degrees((table.alpha - nominal.alpha)[4]), abs=1e-9)
    assert 0 < found.rank <= found.parameter_count


def test_intervals_hold(found):
    _, _, robot = cell(4)
    test = measured(robot, arm("irb120").random_joints(300, 3), 2e-5, np.random.default_rng(8))
    assert 0.9 < coverage(found.robot, test)["parts"]["all"]["inside"] <= 1.0


def test_it_speaks_and_can_be_pickled(found):
    text = found.summary()
    for word in ("weight", "log evidence", "Valid within the joint ranges", "Groups of terms"):
        assert word in text
    weights = [row.weight for row in found.term_sets if row.weight]
    assert sum(weights) == pytest.approx(1.0, abs=1e-12)
    assert f"({max(weights):.0%})" in found.explanation()
    assert len(repr(found)) < 2000
    again = pickle.loads(pickle.dumps(found))
    q = arm("irb120").random_joints(5, 1)
    assert np.array_equal(again.robot.poses(q), found.robot.poses(q))
    assert list(found.to_frame()["name"]) == [row.name for row in found.parameters()]
    assert found.lag() is None


def test_too_few_poses_are_refused():
    model, points, _ = cell(4, poses=8)
    with pytest.raises(IdentificationError, match="8 poses are too few to weigh"):
        identify_evidence(model, points, Motion(points.q))
