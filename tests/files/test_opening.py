"""Opening a robot by whatever names it: one answer for folder, loaded calibration, URDF and shipped robot."""

from types import SimpleNamespace

import numpy as np
import pytest
from support import arm, assert_same_poses, measured, outcome_of, random_robot, write_measurements

import irbcal
from irbcal.errors import CalibrationError, RobotError
from irbcal.files import calibration_folder, document, robots
from irbcal.files.opening import open_robot


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A calibration of a simulated IRB 1600."""
    nominal, rng = arm(), np.random.default_rng(1)
    truth = random_robot(nominal, "34", rng)
    points = measured(truth, nominal.random_joints(40, 1), 3e-5, rng)
    path = write_measurements(tmp_path_factory.mktemp("data") / "m.csv", points)
    content, urdf = document.build(outcome_of(path, "irb1600", "34", holdout=0.3))
    out = tmp_path_factory.mktemp("saved") / "calibration"
    calibration_folder.write(out, content, urdf, "")
    return out


def test_a_shipped_robot_and_its_file_are_the_same():
    by_name, by_path = open_robot("irb120"), open_robot(robots.robot_file("irb120"))
    q = arm("irb120").random_joints(5, 1)
    assert_same_poses(by_name.robot.poses(q), arm("irb120").forward(q), 0.0, 0.0)
    assert_same_poses(by_path.robot.poses(q), by_name.robot.poses(q), 0.0, 0.0)
    for opened in (by_name, by_path):
        assert opened.record is None
        assert opened.nominal is opened.urdf.arm
        assert opened.nominal_urdf is opened.urdf
        assert opened.folder == robots.robot_file("irb120").parent
        assert len(repr(opened)) < 300
        assert opened.urdf_bytes == robots.robot_file("irb120").read_bytes()


def test_links_of_a_urdf_can_be_chosen():
    opened = open_robot("irb1600", base_link="link_1", tip_link="flange")
    assert (opened.nominal.base_link, opened.nominal.tip_link) == ("link_1", "flange")
    assert len(opened.nominal.joint_names) == 5


def test_folder_record_and_result_are_the_same_calibration(folder):
    loaded = irbcal.load(folder)
    record = loaded.record
    q = arm().random_joints(20, 2)
    expected = record.robot_calibrated().poses(q)
    for source in (folder, str(folder), loaded, record, SimpleNamespace(record=record)):
        opened = open_robot(source)
        assert opened.record.fingerprint == record.fingerprint
        assert_same_poses(opened.robot.poses(q), expected, 0.0, 0.0)
        assert_same_poses(opened.nominal.forward(q), arm().forward(q), 1e-12, 1e-12)
        # the URDF has the geometry of the robot, and can be had with that of the nominal arm
        theta = opened.robot.joint_map.effective(q)
        assert_same_poses(opened.urdf.arm.forward(theta), expected, 1e-9, 1e-9)
        assert_same_poses(opened.nominal_urdf.arm.forward(q), arm().forward(q), 1e-9, 1e-9)
        assert opened.folder == (
            folder
            if source is loaded or isinstance(source, (str, type(folder)))
            else robots.robot_file("irb1600").parent
        )


def test_the_nominal_behaviour_of_a_calibration(folder):
    record = irbcal.load(folder)
    opened = open_robot(folder, nominal=True)
    q = arm().random_joints(20, 3)
    expected = record.robot_nominal()
    assert_same_poses(opened.robot.poses(q), expected.poses(q), 0.0, 0.0)
    np.testing.assert_allclose(opened.robot.points(q, "smr1"), expected.points(q, "smr1"), rtol=0, atol=1e-12)
    assert_same_poses(opened.urdf.arm.forward(q), arm().forward(q), 1e-9, 1e-9)


def test_a_loaded_calibration_of_another_robot_has_no_urdf(folder):
    record = irbcal.load(folder).record
    foreign = record.model_copy(update={"robot": record.robot.model_copy(update={"urdf_sha256": "0" * 64})})
    opened = open_robot(foreign)
    assert (opened.folder, opened.urdf, opened.urdf_bytes, opened.nominal_urdf) == (None, None, None, None)
    assert opened.robot.poses(np.zeros((1, 6))).shape == (1, 4, 4)


def test_what_cannot_be_opened(folder, tmp_path):
    with pytest.raises(RobotError, match=r"robot file 'nothing\.urdf' does not exist; robots by name are irb1600"):
        open_robot("nothing.urdf")
    with pytest.raises(CalibrationError, match="not a calibration folder"):
        open_robot(tmp_path)
    for source, name in ((folder, str(folder)), (irbcal.load(folder), "IRB")):
        with pytest.raises(RobotError, match="a calibration has its own base and tip link") as caught:
            open_robot(source, tip_link="flange")
        assert str(caught.value).lower().startswith(name.lower())
        assert caught.value.parameter == "tip_link"


def test_the_file_in_a_calibration_folder_is_the_calibration(folder):
    assert open_robot(folder / "calibration.json").record == irbcal.load(folder).record
