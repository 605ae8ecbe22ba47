"""No URDF is written that independent readers understand otherwise."""

from io import BytesIO

import numpy as np
import pytest
import yourdfpy

import irbcal
from irbcal.errors import CalibrationError
from irbcal.files import robots, urdf, urdf_check


def test_a_urdf_that_pinocchio_reads_otherwise_is_never_written(outcome, tmp_path, monkeypatch):
    from irbcal.files import urdf

    honest = urdf.to_bytes
    monkeypatch.setattr(
        urdf, "to_bytes", lambda *a, **k: honest(*a, **k).replace(b'<axis xyz="0 1 0"', b'<axis xyz="0 -1 0"', 1)
    )
    with pytest.raises(CalibrationError, match="Pinocchio disagrees with the calibrated robot"):
        irbcal.save(outcome, tmp_path / "out")
    assert list((tmp_path / "out").iterdir()) == []


def poses_by_yourdfpy(urdf_bytes, arm, q):
    robot = yourdfpy.URDF.load(
        BytesIO(urdf_bytes), build_scene_graph=True, load_meshes=False, build_collision_scene_graph=False
    )
    out = np.empty((len(q), 4, 4))
    for k, row in enumerate(q):
        robot.update_cfg(dict(zip(arm.joint_names, row.tolist(), strict=True)))
        out[k] = robot.get_transform(arm.tip_link, arm.base_link)
    return out


def test_yourdfpy_and_pinocchio_agree_on_all_named_robots():
    """Two readers of URDF that share no code, on the files of several makers."""
    for robot in robots.robots().robots:
        found = urdf.read(robot.name)
        q = found.arm.random_joints(20, 3)
        data = robot.path().read_bytes()
        theirs = poses_by_yourdfpy(data, found.arm, q)
        assert np.abs(theirs - urdf_check.poses(data, found.arm, q)).max() < 1e-9, robot.name
        assert np.abs(theirs - found.arm.forward(q)).max() < 1e-9, robot.name


def test_a_wrong_urdf_is_stopped(monkeypatch):
    found = urdf.read("irb120")
    data = urdf.to_bytes(found, found.arm)
    honest = urdf_check.poses
    monkeypatch.setattr(urdf_check, "poses", lambda *a: honest(*a) + 2e-9)
    with pytest.raises(CalibrationError, match="disagrees with the calibrated robot"):
        urdf_check.check(data, found.arm)
    monkeypatch.undo()
    assert urdf_check.check(data, found.arm)["poses"] == urdf_check.CHECK_POSES


def test_yourdfpy_reads_a_calibrated_urdf_as_irbcal_does(folder):
    """A second reader, which shares no code with Pinocchio."""
    calibrated = irbcal.load(folder).robot_calibrated().arm
    q = calibrated.random_joints(50, 4)
    assert (
        np.abs(
            poses_by_yourdfpy((folder / "calibrated.urdf").read_bytes(), calibrated, q) - calibrated.forward(q)
        ).max()
        < 1e-9
    )
