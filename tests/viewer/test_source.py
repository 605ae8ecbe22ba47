"""What a view is opened on."""

import numpy as np
import pytest

import irbcal
from irbcal.errors import CalibrationError, RobotError
from irbcal.files.calibration_folder import opened
from irbcal.viewer.source import open_source


def test_a_folder_and_its_record_are_the_same_robot(cell):
    folder, record = open_source(cell / "cal"), open_source(irbcal.load(cell / "cal"))
    q = folder.nominal.random_joints(5, 1)
    assert folder.title == record.title == "irb1600_6_145, model 34"
    for one in (folder, record):
        np.testing.assert_allclose(one.urdf.arm.forward(q), one.record.arm().forward(q), rtol=0, atol=1e-9)
        np.testing.assert_allclose(one.ghost_urdf.arm.forward(q), one.nominal.forward(q), rtol=0, atol=1e-9)
    assert folder.folder == cell / "cal"
    assert (record.folder / "irb1600_6_145.urdf").is_file()


def test_a_record_of_another_robot_has_no_looks(cell):
    record = opened(irbcal.load(cell / "cal"))
    other = record.model_copy(update={"robot": record.robot.model_copy(update={"urdf_sha256": "0" * 64})})
    with pytest.raises(CalibrationError, match="does not hold the robot's looks: give its folder"):
        open_source(other)


def test_a_urdf_has_no_ghost(tmp_path):
    found = open_source(irbcal.shipped.robot_file("irb120"))
    assert (found.record, found.ghost, found.ghost_urdf) == (None, None, None)
    assert found.title == "irb120_3_058"
    with pytest.raises(RobotError, match="does not exist"):
        open_source(tmp_path / "none.urdf")
