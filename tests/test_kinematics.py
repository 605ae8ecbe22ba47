"""Forward and inverse kinematics by a robot's name: arrays and files, all kinds of robots, refusals."""

import json
import pickle
import re

import numpy as np
import pandas as pd
import pytest
from support import (
    arm,
    assert_same_poses,
    example_robot,
    measured,
    on_a_rail,
    random_robot,
    write_measurements,
)
from typer.testing import CliRunner

import irbcal
from irbcal.cli.main import app
from irbcal.errors import IrbcalError, MeasurementError, OptionError, RobotError
from irbcal.io import calibration_folder, urdf
from irbcal.io.opening import open_robot
from irbcal.kinematics import forward_kinematics, inverse_kinematics
from irbcal.measurement.input_table import poses_to_frame
from irbcal.modeling.inverse import closed_form


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A calibration of a simulated IRB 120."""
    nominal, rng = arm("irb120"), np.random.default_rng(1)
    truth = random_robot(nominal, "34", rng)
    points = measured(truth, nominal.random_joints(50, 1), 3e-5, rng)
    path = write_measurements(tmp_path_factory.mktemp("data") / "m.csv", points)
    calibration = irbcal.calibrate(path, "irb120", "34", holdout=0.3)
    out = tmp_path_factory.mktemp("saved") / "calibration"
    calibration_folder.write(out, calibration.record, calibration.urdf, "")
    return out


Q = np.radians([[10.0, 20, 30, 40, 50, 60], [-50, -10, 5, -20, 40, 130]])


def test_all_names_of_a_calibration_and_both_behaviours(folder):
    record = irbcal.load(folder)
    for source in (folder, str(folder), record, open_robot(folder)):
        found = forward_kinematics(source, Q)
        assert_same_poses(found.T_base_tip, record.robot_calibrated().poses(Q), 0.0, 0.0)
    nominal = forward_kinematics(folder, Q, nominal=True)
    assert_same_poses(nominal.T_base_tip, arm("irb120").forward(Q), 1e-12, 1e-12)
    assert_same_poses(forward_kinematics("irb120", Q[0]).T_base_tip, arm("irb120").forward(Q[:1]), 1e-14, 1e-14)


def test_a_target_and_its_uncertainty(folder):
    record = irbcal.load(folder)
    found = forward_kinematics(folder, Q, target="smr2", uncertainty=True)
    np.testing.assert_allclose(found.points, record.robot_calibrated().points(Q, "smr2"), rtol=0, atol=1e-15)
    np.testing.assert_allclose(found.std, record.robot_calibrated().position_std(Q, "smr2"), rtol=1e-12)
    assert found.heldout_mean == pytest.approx(record.record.heldout.all.mean_mm * 1e-3, rel=1e-12)
    table = found.to_frame()
    assert list(table.columns) == ["x_mm", "y_mm", "z_mm", "std_x_mm", "std_y_mm", "std_z_mm"]
    np.testing.assert_allclose(table[["x_mm", "y_mm", "z_mm"]], found.points * 1e3, rtol=0, atol=1e-9)
    assert f"mean {record.record.heldout.all.mean_mm:.3f} mm" in found.summary()
    tip = forward_kinematics(record, Q, uncertainty=True)
    np.testing.assert_allclose(tip.std, record.robot_calibrated().position_std(Q), rtol=1e-12)
    assert list(tip.to_frame().columns)[3:] == ["qw", "qx", "qy", "qz", "std_x_mm", "std_y_mm", "std_z_mm"]


def test_files_and_arrays_are_the_same(folder, tmp_path):
    joints, poses = tmp_path / "q.csv", tmp_path / "p.csv"
    pd.DataFrame(np.degrees(Q), columns=[f"q{k}_deg" for k in range(1, 7)]).to_csv(joints, index=False)
    found = forward_kinematics(folder, joints)
    assert_same_poses(found.T_base_tip, forward_kinematics(folder, Q).T_base_tip, 1e-12, 1e-12)
    found.to_frame().to_csv(poses, index=False)
    from_file = inverse_kinematics(folder, poses, near=Q[0])
    from_array = inverse_kinematics(folder, found.T_base_tip, near=Q[0])
    np.testing.assert_allclose(from_file.joints, from_array.joints, rtol=0, atol=1e-9)
    np.testing.assert_allclose(from_file.joints[0], Q[0], rtol=0, atol=1e-9)
    with pytest.raises(MeasurementError, match="there is no such file"):
        forward_kinematics(folder, tmp_path / "nothing.csv")


def test_every_branch(folder):
    T = forward_kinematics(folder, Q).T_base_tip
    every = inverse_kinematics(folder, T, all_branches=True)
    assert every.solved.all()
    assert every.row.tolist() == sorted(every.row)
    assert set(every.row) == {0, 1}
    assert_same_poses(forward_kinematics(folder, every.joints).T_base_tip, T[every.row], 1e-9, 1e-9)
    limits = arm("irb120")
    assert (every.joints >= limits.lower - 1e-9).all()
    assert (every.joints <= limits.upper + 1e-9).all()
    assert set(every.branch) <= set(closed_form.BRANCH_NAMES)
    assert len({(row, branch) for row, branch in zip(every.row, every.branch, strict=True)}) == len(every)
    table = every.to_frame()
    assert list(table.columns) == ["row", "branch", *limits.joint_columns, "note"]
    assert table["row"].tolist() == (every.row + 1).tolist()
    assert f"{len(every)} ways to reach 2 poses" in repr(every)


def test_poses_without_joints_say_why(folder):
    T = forward_kinematics(folder, Q).T_base_tip.copy()
    T[0, 0, 3] += 5.0
    found = inverse_kinematics(folder, T)
    assert found.solved.tolist() == [False, True]
    assert np.isnan(found.joints[0]).all()
    assert "out of the robot's reach" in found.note[0]
    assert not found.note[1]
    assert "joints for 1 of 2 poses" in found.summary()
    assert found.to_frame()["q1_deg"].isna().tolist() == [True, False]
    assert not len(inverse_kinematics(folder, T[:1], all_branches=True))


def test_arms_without_a_closed_form(tmp_path):
    path = on_a_rail(tmp_path / "rail.urdf")
    rail = urdf.read(path, "rail_base", "tool0").arm
    q = 0.5 * rail.random_joints(5, 1)
    links = {"base_link": "rail_base", "tip_link": "tool0"}
    T = forward_kinematics(path, q, **links).T_base_tip
    found = inverse_kinematics(path, T, near=q[0], **links)
    assert_same_poses(rail.forward(found.joints[found.solved]), T[found.solved], 1e-9, 1e-9)
    assert found.solved.sum() >= 4
    assert list(found.to_frame().columns) == [*rail.joint_columns, "note"]
    with pytest.raises(RobotError, match="closed-form inverse is for arms with six revolute joints"):
        inverse_kinematics(path, T, all_branches=True, **links)
    ur = example_robot("ur_description/urdf/ur3_robot.urdf")
    with pytest.raises(RobotError, match="the closed-form inverse of ur3 needs"):
        inverse_kinematics(ur, urdf.read(ur).arm.forward(np.zeros((1, 6))), all_branches=True)


def test_refusals(folder):
    T = np.eye(4)[None]
    for call, words, named in (
        (lambda: forward_kinematics("irb120", Q, target="smr1"), "a URDF has no reflectors", "target"),
        (lambda: forward_kinematics(folder, Q, target="smr9"), "unknown target 'smr9'", "target"),
        (lambda: forward_kinematics("irb120", Q, uncertainty=True), "knows its uncertainty", "uncertainty"),
        (lambda: forward_kinematics(folder, Q, uncertainty=True, nominal=True), "uncertainty", "uncertainty"),
        (lambda: forward_kinematics(folder, np.degrees(Q)), "these look like degrees", "q"),
        (lambda: forward_kinematics(folder, Q[:, :5]), "shape (n, 6), found (2, 5)", "q"),
        (lambda: inverse_kinematics(folder, T, near=np.degrees(Q[0])), "these look like degrees", "q"),
        (lambda: inverse_kinematics(folder, T, near=Q), "near: expected 6 numbers (joint_1, ", "near"),
        (lambda: inverse_kinematics(folder, T, near=[np.nan] * 6), "near: expected 6 numbers", "near"),
        (lambda: inverse_kinematics(folder, np.eye(3)), "poses need shape (n, 4, 4), found (3, 3)", "T_base_tip"),
        (lambda: forward_kinematics(folder, Q, tip_link="flange"), "a calibration has its own tip_link", "tip_link"),
        (lambda: forward_kinematics(open_robot(folder), Q, nominal=True), "this robot is open", None),
    ):
        with pytest.raises(RobotError, match=re.escape(words)) as caught:
            call()
        assert caught.value.parameter == named


def test_results_speak_and_can_be_pickled(folder):
    found = forward_kinematics(folder, np.tile(Q, (50, 1)))
    assert found.summary().startswith("100 poses of tool0 in base_link")
    assert "the first 10 of 100 rows" in found.summary()
    back = inverse_kinematics(folder, found.T_base_tip)
    for result in (found, back):
        assert len(result) == 100
        assert len(repr(result)) < 200
        assert "<table>" in result._repr_html_()
        again = pickle.loads(pickle.dumps(result))
        pd.testing.assert_frame_equal(again.to_frame(), result.to_frame())
    with pytest.raises(ValueError, match="read-only"):
        found.T_base_tip[0, 0, 3] = 0.0


def test_poses_as_a_table():
    robot = open_robot("irb1600").robot
    table = poses_to_frame(robot.poses(np.zeros((1, 6))))
    np.testing.assert_allclose(table.iloc[0, :3], [815, 0, 1186.5], rtol=0, atol=1e-9)
    np.testing.assert_allclose(table.iloc[0, 3:], [np.sqrt(0.5), 0, np.sqrt(0.5), 0], rtol=0, atol=1e-12)


def test_tables_of_joints_are_in_degrees_as_files_are(folder):
    table = pd.DataFrame(np.degrees(Q), columns=[f"q{k}_deg" for k in range(1, 7)])
    expected = forward_kinematics(folder, Q).T_base_tip
    assert_same_poses(forward_kinematics(folder, table).T_base_tip, expected, 1e-12, 1e-12)
    rows = table.assign(pose=["a", "b"], target="smr1", x_mm=1.0, y_mm=2.0, z_mm=3.0)
    assert_same_poses(forward_kinematics(folder, irbcal.read_measurements(rows)).T_base_tip, expected, 1e-12, 1e-12)


def test_what_one_direction_gives_the_other_takes(folder):
    there = forward_kinematics(folder, Q)
    for poses in (there, there.to_frame()):
        back = inverse_kinematics(folder, poses, near=Q[0])
        assert_same_poses(forward_kinematics(folder, back).T_base_tip, there.T_base_tip, 1e-8, 1e-8)


def test_results_become_dicts_for_json(folder):
    there = forward_kinematics(folder, Q, target="smr1")
    found = json.loads(json.dumps(there.to_dict()))
    assert (found["target"], found["tip"], len(found["rows"])) == ("smr1", there.tip, 2)
    far = np.tile(np.eye(4), (1, 1, 1))
    far[:, 0, 3] = 50.0
    rows = json.loads(json.dumps(inverse_kinematics(folder, far).to_dict()))["rows"]
    assert rows[0]["q1_deg"] is None
    assert rows[0]["note"]


@pytest.mark.parametrize(
    ("q", "words"),
    [
        ([[0, 0, 0, np.nan, 0, 0]], "row 1 has no number for joint_4"),
        ([[np.inf, 0, 0, 0, 0, 0]], "degrees|no number"),
        ([["abc"]], "array of numbers"),
        (None, "array of numbers|shape"),
    ],
)
def test_joints_that_are_no_numbers_are_refused(q, words):
    with pytest.raises(RobotError, match=words) as refused:
        forward_kinematics("irb120", q)
    assert refused.value.parameter == "q"


@pytest.mark.parametrize("T", ["there_is_no_file.csv", np.eye(3), [["abc"]], None])
def test_what_is_no_pose_is_refused(T):
    with pytest.raises(IrbcalError, match=r"no such file|shape"):
        inverse_kinematics("irb120", T)


@pytest.mark.parametrize("robot", [None, 5])
def test_what_is_no_robot_is_refused(robot):
    with pytest.raises(RobotError, match=r"expected a robot .* found") as refused:
        forward_kinematics(robot, Q)
    assert refused.value.parameter == "robot"


def test_all_branches_are_not_the_nearest():
    with pytest.raises(OptionError, match="near: all branches are asked for") as refused:
        inverse_kinematics("irb120", np.eye(4), near=Q[0], all_branches=True)
    assert refused.value.parameter == "near"


START = np.radians([0, 20, -10, 0, 20, 0])


@pytest.fixture(scope="module")
def swing():
    """Poses that pass next to the wrist's singularity of the IRB 120."""
    q = np.linspace(START, START - np.radians([0, 0, 0, 0, 40, 0]), 9)
    T = irbcal.forward_kinematics("irb120", q).T_base_tip.copy()
    T[:, :3, :3] = T[:, :3, :3] @ np.array([[1, -1e-4, 0], [1e-4, 1, 0], [0, 0, 1.0]])
    u, _, v = np.linalg.svd(T[:, :3, :3])
    T[:, :3, :3] = u @ v
    T[4:, :3, :3] = np.array([[1, -2e-4, 0], [2e-4, 1, 0], [0, 0, 1]]) @ T[4:, :3, :3]
    u, _, v = np.linalg.svd(T[:, :3, :3])
    T[:, :3, :3] = u @ v
    return T


def test_a_path_and_what_stands_in_its_way(swing, tmp_path):
    found = irbcal.inverse_kinematics("irb120", swing, near=START, path=True)
    (place,) = found.singular
    assert "singularity" in found.summary()
    assert place.in_words() in found.summary()
    poses_to_frame(swing).to_csv(tmp_path / "p.csv", index=False)
    words = ["ik", "irb120", "--poses", str(tmp_path / "p.csv"), "--path", "--near", "0,20,-10,0,20,0"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0
    assert f"irbcal: {place.in_words()}"[:60] in done.stderr
    assert done.stdout.splitlines()[0].endswith("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,note")


def test_a_criterion_for_seven_joints():
    path = example_robot("panda_description/urdf/panda.urdf")
    q = np.array([[0, 0.2, 0, -1.8, 0.2, 1.9, 0.3], [0.3, 0.4, 0.2, -1.5, 0.2, 1.7, 0.3]])
    T = irbcal.forward_kinematics(path, q, tip_link="panda_link8").T_base_tip
    found = irbcal.inverse_kinematics(path, T, tip_link="panda_link8", redundancy="near", near=q[0])
    assert found.joints[0] == pytest.approx(q[0], abs=1e-6)
    assert found.solved.all()
    again = irbcal.forward_kinematics(path, found.joints, tip_link="panda_link8").T_base_tip
    assert np.abs(again - T).max() < 1e-9


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"redundancy": "limits"}, "irb120_3_058 has 6 joints, none to spare"),
        ({"redundancy": "elbow"}, "redundancy: expected limits or near, found 'elbow'"),
        ({"all_branches": True, "path": True}, "all_branches: goes neither with a path nor with a criterion"),
    ],
)
def test_wrong_options_are_refused(swing, options, words):
    with pytest.raises(OptionError, match=words):
        irbcal.inverse_kinematics("irb120", swing, **options)
