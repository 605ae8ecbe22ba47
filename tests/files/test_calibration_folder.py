"""The calibration folder: what goes in comes out, and nothing is ever half-written."""

import json
import os

import numpy as np
import pytest
from support import TARGETS, arm, measured, outcome_of, random_robot, write_measurements

import irbcal
from irbcal.errors import CalibrationError
from irbcal.files import atomic, urdf_check
from irbcal.modeling.joint_map import FORMULA
from irbcal.validation.uncertainty import position_std


@pytest.fixture(scope="module")
def outcome(tmp_path_factory):
    """A calibration of a simulated robot."""
    nominal = arm()
    rng = np.random.default_rng(1)
    truth = random_robot(nominal, "34", rng)
    points = measured(truth, nominal.random_joints(60, 1), 3e-5, rng)
    path = write_measurements(tmp_path_factory.mktemp("data") / "m.csv", points)
    return outcome_of(path, "irb1600", "34", holdout=0.3)


@pytest.fixture(scope="module")
def folder(outcome, tmp_path_factory):
    """The same, saved."""
    path = tmp_path_factory.mktemp("saved") / "calibration"
    irbcal.save(outcome, path, world_link=True, target_links=True)
    return path


def test_three_ways_to_predict_agree(outcome, folder):
    """From the fit, from the loaded folder, and from the written URDF in Pinocchio plus the joint map."""
    loaded = irbcal.load(folder)
    q = outcome.urdf.arm.random_joints(500, 3)
    robot = loaded.robot_calibrated()
    theta = robot.joint_map.effective(q)
    T = urdf_check.poses((folder / "calibrated.urdf").read_bytes(), loaded.arm(), theta)
    for name in TARGETS:
        from_fit = outcome.fit.robot.points(q, name)
        base = np.einsum("nij,j->ni", T[:, :3, :3], robot.targets[name]) + T[:, :3, 3]
        from_pinocchio = base @ robot.T_world_base[:3, :3].T + robot.T_world_base[:3, 3]
        assert np.abs(robot.points(q, name) - from_fit).max() < 1e-9
        assert np.abs(from_pinocchio - from_fit).max() < 1e-9


def test_urdf_with_world_and_target_links_needs_no_other_file_than_the_joint_map(outcome, folder):
    import pinocchio as pin

    model = pin.buildModelFromXML((folder / "calibrated.urdf").read_text())
    data = model.createData()
    q = outcome.urdf.arm.random_joints(20, 4)
    theta = outcome.fit.robot.joint_map.effective(q)
    world, target = model.getFrameId("world"), model.getFrameId("target_smr2")
    for row, expected in zip(theta, outcome.fit.robot.points(q, "smr2"), strict=True):
        pin.framesForwardKinematics(model, data, row)
        found = (data.oMf[world].inverse() * data.oMf[target]).translation
        assert np.abs(found - expected).max() < 1e-9


def test_nominal_robot_comes_back_too(outcome, folder):
    q = outcome.urdf.arm.random_joints(50, 5)
    found = irbcal.load(folder).robot_nominal().points(q, "smr1")
    assert np.abs(found - outcome.nominal.robot.points(q, "smr1")).max() < 1e-9


def test_joint_map_can_be_implemented_from_the_file_alone(folder):
    section = json.loads((folder / "calibration.json").read_text())["joint_map"]
    assert section["formula"] == FORMULA
    for vector in section["test_vectors"]:
        q = vector["commanded"]
        theta = [angle * (1 + k) for angle, k in zip(q, section["gain"], strict=True)]
        fore = section["stiffness_B_rad"] * np.sin(q[1] + q[2] + section["phi3_rad"])
        theta[1] += section["stiffness_A_rad"] * np.sin(q[1] + section["phi2_rad"]) + fore
        theta[2] += fore
        theta[5] += section["fourier_a1_rad"] * np.cos(q[5]) + section["fourier_b1_rad"] * np.sin(q[5])
        theta[5] += section["fourier_a2_rad"] * np.cos(2 * q[5]) + section["fourier_b2_rad"] * np.sin(2 * q[5])
        assert np.abs(np.array(theta) - vector["effective"]).max() < 1e-14


def test_statistics_are_those_of_the_held_out_poses(outcome, folder):
    loaded = irbcal.load(folder)
    robot, points = loaded.robot_calibrated(), outcome.heldout_points
    distance = [
        np.linalg.norm(xyz - robot.points(q[None], name)[0])
        for q, xyz, name in zip(points.joints(), points.xyz, points.names(), strict=True)
    ]
    assert loaded.heldout.all.mean_mm == pytest.approx(np.mean(distance) * 1e3, abs=1e-9)
    assert loaded.heldout.all.max_mm == pytest.approx(np.max(distance) * 1e3, abs=1e-9)
    assert loaded.poses_fit + loaded.poses_heldout == 60
    assert set(outcome.fit_points.pose_ids).isdisjoint(points.pose_ids)


def test_every_parameter_is_listed_with_state_and_unit(folder):
    loaded = irbcal.load(folder)
    names = [p.name for p in loaded.parameters]
    assert len(names) == len(set(names))
    for expected in ("base_x", "target_smr3_z", "delta_alpha4", "stiffness_delta_L", "fourier_b2"):
        assert expected in names
    for p in loaded.parameters:
        assert (p.std is None) == (p.state != "identified")
        assert bool(p.reason) or p.state == "identified"
    assert loaded.parameter_count == 43


def test_a_changed_urdf_is_noticed(folder, tmp_path):
    for name in ("calibration.json", "calibrated.urdf"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    assert irbcal.load(tmp_path).model == "34"
    (tmp_path / "calibrated.urdf").write_text("<robot/>")
    with pytest.raises(CalibrationError, match=r"not the URDF that calibration\.json was written with"):
        irbcal.load(tmp_path)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda d: d.pop("model"), "calibration.json: model: Field required"),
        (lambda d: d.update(schema_name="irbcal-calibration-9"), "schema_name: Input should be 'irbcal-calibration-1'"),
        (lambda d: d["robot"]["dhm_calibrated"][2].update(a_mm="long"), "robot.dhm_calibrated.2.a_mm: Input should be"),
        (lambda d: d.update(surprise=1), "surprise: Extra inputs are not permitted"),
    ],
)
def test_damaged_calibrations_are_refused_with_the_place(folder, tmp_path, change, expected):
    content = json.loads((folder / "calibration.json").read_text())
    change(content)
    (tmp_path / "calibration.json").write_text(json.dumps(content))
    (tmp_path / "calibrated.urdf").write_bytes((folder / "calibrated.urdf").read_bytes())
    with pytest.raises(CalibrationError) as caught:
        irbcal.load(tmp_path)
    assert expected in str(caught.value)


def test_not_a_calibration_folder(tmp_path):
    with pytest.raises(CalibrationError, match="not a calibration folder: No such file"):
        irbcal.load(tmp_path)
    (tmp_path / "calibration.json").write_text("{")
    with pytest.raises(CalibrationError, match="Invalid JSON"):
        irbcal.load(tmp_path)


# --- writing: all or nothing ---------------------------------------------------------------------------


def content(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def test_files_replace_earlier_ones_and_leave_others_alone(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    atomic.write_together(tmp_path, {"a": b"1", "b": b"2"})
    atomic.write_together(tmp_path, {"a": b"3", "b": b"4"})
    assert content(tmp_path) == {"a": b"3", "b": b"4", "notes.txt": b"mine"}


@pytest.mark.parametrize("fail_at", [1, 2, 3])
@pytest.mark.parametrize("earlier", [True, False])
@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_an_interrupted_write_leaves_everything_as_it_was(tmp_path, monkeypatch, fail_at, earlier, error):
    folder = tmp_path / "out"
    if earlier:
        atomic.write_together(folder, {"a": b"1", "b": b"2", "c": b"3"})
    before = content(folder) if earlier else {}
    calls, replace = [], os.replace

    def fails(source, target):
        calls.append(target)
        if len(calls) == fail_at:
            raise error
        replace(source, target)

    monkeypatch.setattr(os, "replace", fails)
    with pytest.raises((CalibrationError, KeyboardInterrupt)):
        atomic.write_together(folder, {"a": b"x", "b": b"y", "c": b"z"})
    assert content(folder) == before


def test_a_folder_that_is_a_file_is_refused(tmp_path):
    (tmp_path / "out").write_text("")
    with pytest.raises(CalibrationError, match="expected a folder to write to, found a file"):
        atomic.check_writable(tmp_path / "out")


def test_a_urdf_that_pinocchio_reads_otherwise_is_never_written(outcome, tmp_path, monkeypatch):
    from irbcal.files import urdf

    honest = urdf.to_bytes
    monkeypatch.setattr(
        urdf, "to_bytes", lambda *a, **k: honest(*a, **k).replace(b'<axis xyz="0 1 0"', b'<axis xyz="0 -1 0"', 1)
    )
    with pytest.raises(CalibrationError, match="Pinocchio disagrees with the calibrated robot"):
        irbcal.save(outcome, tmp_path / "out")
    assert list((tmp_path / "out").iterdir()) == []


def test_uncertainty_of_a_saved_calibration_is_that_of_its_fit(outcome, folder):
    loaded = irbcal.load(folder)
    q = outcome.urdf.arm.random_joints(20, 6)
    expected = np.sqrt(np.einsum("nii->ni", outcome.fit.predicted_covariance(q, "smr2")))
    assert np.abs(position_std(loaded, q, "smr2") / expected - 1).max() < 1e-6
    tip = position_std(loaded, q)
    assert tip.shape == (20, 3)
    assert 0 < tip.min() < tip.max() < 1e-3
