"""No URDF is written that independent readers understand otherwise."""

import numpy as np
import pytest

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


def test_yourdfpy_and_pinocchio_agree_on_all_named_robots():
    """Two readers of URDF that share no code, on the files of several makers."""
    for robot in robots.robots().robots:
        found = urdf.read(robot.name)
        q = found.arm.random_joints(20, 3)
        data = robot.path().read_bytes()
        theirs = urdf_check.poses_by_yourdfpy(data, found.arm, q)
        assert np.abs(theirs - urdf_check.poses(data, found.arm, q)).max() < 1e-9, robot.name
        assert np.abs(theirs - found.arm.forward(q)).max() < 1e-9, robot.name


@pytest.mark.parametrize("reader", ["poses", "poses_by_yourdfpy"])
def test_each_reader_alone_stops_a_wrong_urdf(monkeypatch, reader):
    found = urdf.read("irb120")
    data = urdf.to_bytes(found, found.arm)
    honest = getattr(urdf_check, reader)
    monkeypatch.setattr(urdf_check, reader, lambda *a: honest(*a) + 2e-9)
    with pytest.raises(CalibrationError, match="disagrees with the calibrated robot"):
        urdf_check.check(data, found.arm)
    monkeypatch.undo()
    assert urdf_check.check(data, found.arm)["yourdfpy_poses"] == urdf_check.SECOND_POSES
