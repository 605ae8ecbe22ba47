"""Several loads: an arm whose joints give way, fitted on two, judged on a third with its tool identified anew."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support import TARGETS, arm, example_robot

from irbcal.identification.evidence import identify_evidence
from irbcal.io import urdf
from irbcal.measurement.points import PointSet, distances
from irbcal.modeling import frames
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms import families
from irbcal.modeling.terms.geometry import DHM_COLUMNS
from irbcal.modeling.terms.payload import Payload
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term_map import TermMap
from irbcal.validation.accuracy import coverage

MM = 1e-3
NOISE = 0.01 * MM
PLACE = (0.02, -0.01, 0.06)


class Loaded:
    """An arm with errors of its geometry, gravity and compliant joints that measures itself (SIMULATED)."""

    def __init__(self, nominal, seed=1):
        rng = np.random.default_rng(seed)
        self.nominal = nominal
        columns = {name: getattr(nominal.table, name).copy() for name in DHM_COLUMNS.values()}
        for t in families()["geometry"].terms(nominal):
            columns[DHM_COLUMNS[t.axis]][t.joint] += 0.5 * t.size * rng.standard_normal()
        payload = Payload(PLACE).terms(nominal)
        others = [t for name in ("gravity", "gain") for t in families()[name].terms(nominal)]
        values = [0.3 * t.size * rng.standard_normal() for t in others]
        self.compliance = rng.uniform(0.3, 1.5, len(payload)) * 1e-5
        terms = TermMap(nominal, (*others, *payload), np.concatenate([values, self.compliance]))
        base = frames.from_xyz_angles([0.4, -1.0, 0.2, 0.1, 0.2, -2.0])
        self.robot = Robot(nominal.with_table(replace(nominal.table, **columns)), JointMap(terms, None, 0.0), base)

    def measured(self, kg, poses, seed):
        """Poses with a load, its reflectors remounted: their names end with it."""
        rng = np.random.default_rng(seed)
        q = self.nominal.random_joints(poses, seed)
        tool = {f"{name}@{kg:g}": np.array(xyz) + 5 * MM * rng.standard_normal(3) for name, xyz in TARGETS.items()}
        robot = self.robot.carrying(kg).replace(targets=tool)
        xyz = np.stack([robot.points(q, name) for name in tool], axis=1).reshape(-1, 3)
        xyz += NOISE * rng.standard_normal(xyz.shape)
        pose, target = np.repeat(np.arange(poses), 3), np.tile(np.arange(3), poses)
        empty = np.full(poses, "", dtype=object)
        return PointSet(
            q, pose, target, xyz, tuple(tool), np.arange(poses), empty, inputs={"payload_kg": np.full(poses, kg)}
        )


def together(first, second):
    """Two point sets as one."""
    n, k = first.poses, len(first.target_names)
    return PointSet(
        np.concatenate([first.q, second.q]),
        np.concatenate([first.pose, n + second.pose]),
        np.concatenate([first.target, k + second.target]),
        np.concatenate([first.xyz, second.xyz]),
        (*first.target_names, *second.target_names),
        np.arange(n + second.poses),
        np.concatenate([first.groups, second.groups]),
        inputs={"payload_kg": np.concatenate([first.inputs["payload_kg"], second.inputs["payload_kg"]])},
    )


def judged(robot, points, known=10):
    """Mean error (mm) of the poses after the first ones, from which the places of the targets are found."""
    T = robot.T_world_base @ points.tips(robot)
    local = np.einsum("mji,mj->mi", T[points.pose, :3, :3], points.xyz - T[points.pose, :3, 3])
    first = points.pose < known
    tool = {name: local[first & (points.target == k)].mean(axis=0) for k, name in enumerate(points.target_names)}
    rest = points.select(np.arange(points.poses) >= known)
    return distances(robot.replace(targets=tool), rest).mean() / MM


def fitted(truth, points, **options):
    motion = Motion(points.q, inputs=points.inputs)
    return identify_evidence(truth.nominal, points, motion, payload_centre=PLACE, **options)


@pytest.fixture(scope="module", params=["irb120", "panda"])
def case(request):
    if request.param == "panda":
        nominal = urdf.read(example_robot("panda_description/urdf/panda.urdf"), None, "panda_link8").arm
    else:
        nominal = arm("irb120")
    truth = Loaded(nominal)
    points = together(truth.measured(0.0, 60, 1), truth.measured(2.0, 50, 2))
    return truth, points, fitted(truth, points)


@pytest.fixture(scope="module")
def of_one_load(case):
    """The fit to the poses with 2 kg alone."""
    truth, points, _ = case
    return fitted(truth, points.select(points.inputs["payload_kg"] == 2.0).with_seen_targets())


def test_it_extrapolates_to_a_third_load(case, of_one_load):
    truth, points, found = case
    third = truth.measured(4.0, 110, 3)
    with_term = judged(found.robot, third)
    untold = judged(fitted(truth, replace(points, inputs={})).robot, third)
    heavier = truth.measured(6.0, 110, 3)
    assert with_term < 0.03  # the noise is 0.016 mm long in the mean, that of the tool's ten poses comes to it
    assert untold > 4 * with_term
    assert judged(of_one_load.robot, heavier) > 4 * judged(found.robot, heavier)


def test_a_mass_wrong_by_a_tenth_costs_little(case):
    truth, points, found = case
    if len(truth.nominal.joint_names) == 6:
        pytest.skip("one arm is enough")
    third = truth.measured(4.0, 110, 3)
    right = judged(found.robot, third)
    # wrong at use, and wrong for one of the loads of the fit
    assert judged(found.robot, replace(third, inputs={"payload_kg": 1.1 * third.inputs["payload_kg"]})) < right + 0.05
    wrong = fitted(truth, replace(points, inputs={"payload_kg": 1.1 * points.inputs["payload_kg"]}))
    assert judged(wrong.robot, third) < right + 0.05
    # wrong alike everywhere: nothing but another unit
    assert (
        abs(judged(wrong.robot, replace(third, inputs={"payload_kg": 1.1 * third.inputs["payload_kg"]})) - right)
        < 0.002
    )


def test_compliances_are_found_with_their_uncertainty(case):
    truth, _, found = case
    terms = found.terms
    rows = [k for k, term in enumerate(terms) if term.basis == "payload"]
    off = found.coefficients[rows] - truth.compliance
    # a load has no lever about the first axis, which is upright, and little about those of the wrist
    assert (found.std[rows][1:3] < 0.2e-5).all()
    assert (np.abs(off) < 3.5 * found.std[rows]).all()


def test_it_is_for_the_load_of_most_poses_and_says_so(case):
    truth, points, found = case
    joint_map = found.robot.joint_map
    assert joint_map.payload_kg == 0.0
    assert np.abs(joint_map.payload_centre - PLACE).max() < 1e-15
    assert any("payloads of 0, 2 kg: where no payload is given, " in line for line in found.sentences())
    again = fitted(truth, points, usual_kg=2.0).robot.joint_map
    q = points.q[:20]
    assert np.abs(again.effective(q) - joint_map.carrying(2.0).effective(q)).max() < 1e-12
    # intervals hold for either load, and only if the load is told
    inside = coverage(found.robot, points)["parts"]["all"]["inside"]
    untold = coverage(found.robot, replace(points, inputs={}))["parts"]["all"]["inside"]
    assert inside > 0.93
    assert untold < inside - 0.1


def test_one_load_gives_no_term_and_says_whose_the_map_is(of_one_load):
    joint_map = of_one_load.robot.joint_map
    assert not joint_map.knows_loads
    assert joint_map.payload_kg == 2.0
    assert any("All poses were measured with a payload of 2 kg" in line for line in of_one_load.sentences())


def test_reported_torques_serve_where_the_mass_is_not_known(case):
    truth, points, found = case
    if len(truth.nominal.joint_names) == 6:
        pytest.skip("one arm is enough")
    rng = np.random.default_rng(4)

    def with_torques(seen):
        """What a robot reports: the load's torque and that of its own links, with friction."""
        motion = Motion(seen.q, inputs=seen.inputs)
        joint_map = truth.robot.joint_map
        load = (joint_map.terms.effective(motion) - joint_map.terms.effective(Motion(seen.q))) / truth.compliance
        return replace(seen, inputs={"torques": load + rng.normal(0.0, 0.5, seen.q.shape)})

    third = truth.measured(4.0, 110, 3)
    by_torques = fitted(truth, with_torques(points))
    felt = judged(by_torques.robot, with_torques(third))
    blind = judged(by_torques.robot, replace(third, inputs={}))
    known = judged(found.robot, third)
    assert known < felt < 0.05
    assert blind > 3 * felt
    assert any("torques that the robot reports" in line for line in by_torques.sentences())


def test_the_page_s_example(capsys):
    page = (Path(__file__).parents[1] / "docs" / "calibration-auto.md").read_text(encoding="utf-8")
    names = {}
    exec(re.search(r"```python\n(import numpy.*?)```", page, re.DOTALL)[1], names)
    said = [float(x) for x in re.search(r"It prints a mean of (\S+) mm .* and (\S+) mm", page, re.DOTALL).groups()]
    found = [names[name].calibrated["mean_mm"] for name in ("third", "untold")]
    assert found == pytest.approx(said, rel=0.1)
    assert 0.3 < -1e3 * names["sag"][2] < 0.6
