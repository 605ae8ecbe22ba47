"""A calibration named where a robot is: the robot that it began from, its joint map kept with its measurements."""

import numpy as np
import pytest
from support import arm, measured, random_robot, write_measurements

import irbcal
from irbcal.errors import RobotError
from irbcal.files import nominal, robots, urdf


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    """A robot measured well once, and a year later in a few poses with another base and tool."""
    folder = tmp_path_factory.mktemp("again")
    start = arm()
    rng = np.random.default_rng(2)
    truth = random_robot(start, "34", rng, size=0.3)
    later = truth.replace(T_world_base=random_robot(start, "nominal", rng).T_world_base)
    write_measurements(folder / "old.csv", measured(truth, start.random_joints(80, 1), 3e-5, rng))
    write_measurements(folder / "new.csv", measured(later, start.random_joints(16, 2), 3e-5, rng))
    own = folder / "my_arm.urdf"  # no robot that is known by name
    own.write_text(robots.robot_file("irb1600").read_text().replace("<robot name=", "<robot  name="))
    irbcal.save(irbcal.calibrate(folder / "old.csv", own, "34"), folder / "cal")
    return folder, start, truth


@pytest.mark.parametrize("name", ["cal", "cal/calibrated.urdf"])
def test_the_joint_map_is_kept_with_the_measurements(cell, name):
    folder, start, truth = cell
    found = irbcal.calibrate(folder / "new.csv", folder / name, holdout=0)
    added = irbcal.calibrate(folder / "new.csv", folder / "my_arm.urdf", with_=folder / "cal", holdout=0)
    q = start.random_joints(200, 9)
    robot = found.robot_calibrated()
    assert np.abs(robot.forward(q) - added.robot_calibrated().forward(q)).max() < 1e-9
    assert any("so that its joint map is kept" in note for note in found.record.notes)
    assert not any("whose joint map is not in it" in note for note in found.record.notes)
    assert found.record.robot.model_dump(exclude={"dhm_nominal", "dhm_calibrated"}) == added.record.robot.model_dump(
        exclude={"dhm_nominal", "dhm_calibrated"}
    )
    effective = robot.joint_map.effective(q) - q
    true = truth.joint_map.effective(q) - q
    kept = np.abs(effective - true)[:, [1, 2]].max()  # stiffness; gains and offsets go elsewhere
    alone = irbcal.calibrate(folder / "new.csv", folder / "my_arm.urdf", "34", holdout=0).robot_calibrated()
    assert kept < 0.5 * np.abs(alone.joint_map.effective(q) - q - true)[:, [1, 2]].max()


def test_the_nominal_robot_comes_back(cell, tmp_path):
    folder, start, _ = cell
    found = nominal.read_nominal(folder / "cal")
    q = start.random_joints(50, 3)
    assert np.abs(found.arm.forward(q) - start.forward(q)).max() < 1e-9
    assert urdf.fingerprint(urdf.to_bytes(found, found.arm), "nominal") is None
    assert nominal.calibration_at(folder / "my_arm.urdf") is None
    copied = tmp_path / "calibrated.urdf"  # a calibrated URDF alone is a URDF as any other
    copied.write_bytes((folder / "cal/calibrated.urdf").read_bytes())
    assert nominal.calibration_at(copied) is None
    with pytest.raises(RobotError, match="a calibration has its own tip_link"):
        nominal.read_nominal(folder / "cal", tip="link_3")
    with pytest.raises(RobotError, match="a calibration has its own coupling"):
        nominal.read_nominal(folder / "cal", coupling="3+2")


def test_with_needs_no_robot_any_more(cell):
    folder, start, _ = cell
    found = irbcal.calibrate(folder / "new.csv", with_=folder / "cal", model="nominal")
    assert found.record.robot.urdf == "my_arm.urdf"
    assert found.record.robot.urdf_sha256 == irbcal.load(folder / "cal").record.robot.urdf_sha256
    q = start.random_joints(20, 3)
    assert np.abs(found.arm(calibrated=False).forward(q) - start.forward(q)).max() < 1e-9


def test_a_calibration_is_simulated_as_its_nominal_robot(cell):
    folder = cell[0]
    seen = irbcal.simulate(folder / "cal", random=12, seed=3, only=())
    own = irbcal.simulate(folder / "my_arm.urdf", random=12, seed=3, only=())
    assert seen.to_frame().equals(own.to_frame())
