"""Frame terms from end to end: a robot that has them, measured, calibrated with terms all, saved, and used."""

import json

import numpy as np
import pandas as pd
import pytest
from support import assert_same_poses, measured, write_measurements
from term_cases import framed_robot

import irbcal
from irbcal.correction.fake_targets import correct_joints
from irbcal.errors import CalibrationError, OptionError, RobotError
from irbcal.measurement.points import distances
from irbcal.modeling.inverse import any_arm, calibrated_arm
from irbcal.modeling.robot import Robot
from irbcal.planners.calibrated_model import CalibratedModel


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    robot, folder = framed_robot("irb120", np.random.default_rng(2)), tmp_path_factory.mktemp("all")
    points = measured(robot, robot.arm.random_joints(160, 3), 5e-6, np.random.default_rng(1))
    write_measurements(folder / "m.csv", points)
    return irbcal.calibrate(folder / "m.csv", "irb120", terms="all", holdout=30)


@pytest.fixture(scope="module")
def folder(made, tmp_path_factory):
    path = tmp_path_factory.mktemp("saved") / "cal"
    made.save(path)
    return path


@pytest.mark.parametrize("name", ["irb120", "panda"])
def test_the_inverse_finds_the_pose_again(name):
    """Six and seven joints, to the inverse's tolerance."""
    robot = framed_robot(name, np.random.default_rng(5))
    nominal = robot.joint_map.terms.arm
    q = 0.6 * nominal.random_joints(200, 1) + 0.4 * np.clip(0.3, nominal.lower, nominal.upper)
    wanted = robot.poses(q)
    assert robot.moved_by_frame_terms(q).max() > 1e-5
    if name == "irb120":
        found = calibrated_arm.solve(robot, nominal, wanted, seed=q)
    else:
        found = any_arm.solve(robot, nominal, wanted, q)
    assert found.converged.mean() > 0.98
    good = found.converged
    assert_same_poses(robot.poses(found.joints[good]), wanted[good], 1e-10, 1e-10)


def test_terms_of_the_joint_map_are_no_frame_terms():
    robot = framed_robot("irb120", np.random.default_rng(5))
    with pytest.raises(RobotError, match="belong to the joint map"):
        Robot(robot.arm, frame_terms=robot.joint_map.terms)


def test_they_make_held_out_poses_right(made, tmp_path):
    """The simulated robot has frame terms: without them ten times more is left."""
    data = write_measurements(tmp_path / "m.csv", made.validated.fit_points)
    plain = irbcal.calibrate(data, "irb120", holdout=0)
    assert plain.record.frame_terms is None
    heldout = made.validated.heldout_points
    robot = made.validated.fit.robot
    assert distances(robot, heldout).mean() < 0.5 * distances(plain.validated.fit.robot, heldout).mean()
    assert distances(robot.replace(frame_terms=None), heldout).mean() > 2 * distances(robot, heldout).mean()


def test_what_was_made_is_what_is_loaded(made, folder):
    loaded = irbcal.load(folder)
    q, previous = made.arm().random_joints(100, 1), made.arm().random_joints(100, 2)
    one, two = made.validated.fit.robot, loaded.robot_calibrated()
    assert_same_poses(one.poses(q), two.poses(q), 1e-12, 1e-12)
    assert_same_poses(one.forward(q, previous), two.forward(q, previous), 1e-12, 1e-12)
    assert json.loads((folder / "calibration.json").read_text())["frame_terms"]["schema"] == "irbcal-frame-terms-1"
    assert irbcal.verify(folder, folder / "calibrated.urdf")
    expected = one.predict(q, target="smr2").covariance
    std = np.sqrt(np.diagonal(expected, axis1=1, axis2=2))
    assert loaded.record.robot_calibrated().position_std(q, "smr2") == pytest.approx(std, rel=1e-3)


def test_everyone_is_told_that_urdf_and_joint_map_are_not_all(made, folder):
    words = made.record.frame_terms.in_words
    assert words in made.record.notes
    assert words.replace("-", "") in (folder / "calibrated.urdf").read_text().replace("-", "")
    for name in ("report.html", "joint_origins.yaml"):
        assert "INCOMPLETE" in (folder / name).read_text()


def test_planners_are_refused_with_the_numbers(made, folder):
    pytest.importorskip("pinocchio")
    with pytest.raises(CalibrationError, match=f"by {made.record.frame_terms.median_mm:.3f} mm in the median"):
        CalibratedModel.load(folder)
    model, q = CalibratedModel.load(folder, without_frame_terms=True), made.arm().random_joints(5, 1)
    plain = made.robot_calibrated().replace(frame_terms=None)
    assert_same_poses(model.placement(q), plain.poses(q), 1e-12, 1e-12)


def test_fake_targets_reach_what_was_wanted(made, folder, program, tmp_path):
    nominal, robot = made.arm(calibrated=False), made.robot_calibrated()
    q = 0.5 * nominal.random_joints(60, 6)
    q[:, 4] = np.where(np.abs(q[:, 4]) < 0.2, 0.4, q[:, 4])
    found = correct_joints(robot, nominal, q)
    assert found.ok.all()
    assert_same_poses(robot.poses(found.q), nominal.forward(q), 1e-10, 1e-10)
    columns = [f"q{k}_deg" for k in range(1, 7)]
    pd.DataFrame(np.degrees(q), columns=columns).to_csv(tmp_path / "q.csv", index=False)
    program("filter", folder, tmp_path / "q.csv", "--out", tmp_path / "fake.csv")
    fake = np.radians(pd.read_csv(tmp_path / "fake.csv", comment="#")[columns].to_numpy())
    before = np.vstack([np.full(6, np.nan), fake[:-1]])
    assert_same_poses(robot.forward(fake, before), nominal.forward(q), 1e-7, 1e-7)


def test_the_view_says_what_is_drawn(made, folder, tmp_path):
    data = write_measurements(tmp_path / "m.csv", made.validated.heldout_points)
    view = irbcal.view(folder, data)
    assert any("drawn from its URDF and effective joints" in note for note in view.scene.notes)
    points, T, robot = view.scene.points, view.scene.T_scene_world, made.validated.fit.robot
    names = [list(view.scene.targets)[k] for k in points.target]
    off = [
        np.abs(model.points(view.scene.q[points.pose], names) @ T[:3, :3].T + T[:3, 3] - points.calibrated).max()
        for model in (robot, robot.replace(frame_terms=None))
    ]
    assert off[0] < 2e-5 < 1e-4 < off[1]  # the points also know the last move


def test_they_belong_to_model_auto(tmp_path):
    for options in ({"model": "34"}, {"hold": ["gain1"]}):
        with pytest.raises(OptionError, match="terms: only model auto takes it: leave it out"):
            irbcal.calibrate(tmp_path / "m.csv", "irb120", terms="all", **options)


def test_exports_refuse_them_and_leave_them_out_if_told(folder, tmp_path):
    with pytest.raises(CalibrationError, match="frame terms"):
        irbcal.export(folder, "python", tmp_path / "out")
    found = irbcal.export(folder, "python", tmp_path / "out", without_frame_terms=True)
    assert "INCOMPLETE" in found.notes[0]
    assert "INCOMPLETE" in (tmp_path / "out" / found.files[0]).read_text()
