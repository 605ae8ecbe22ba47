"""A robot is opened by whatever names it."""

import logging
import shutil
import warnings
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
import yourdfpy
from support import arm, assert_same_poses, measured, random_robot, write_measurements
from typer.testing import CliRunner

import irbcal
from irbcal.cli.main import app
from irbcal.correction.opened_programs import opened_calibration
from irbcal.errors import CalibrationError, OptionError, RobotError
from irbcal.io import calibration_folder, opening, robots, urdf
from irbcal.io.opening import open_robot


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
    found = open_robot(folder / "cal", nominal=True).nominal_urdf
    q = start.random_joints(50, 3)
    assert np.abs(found.arm.forward(q) - start.forward(q)).max() < 1e-9
    assert urdf.fingerprint(urdf.to_bytes(found, found.arm), "nominal") is None
    assert opening.calibration_at(folder / "my_arm.urdf") is None
    copied = tmp_path / "calibrated.urdf"  # a calibrated URDF alone is a URDF as any other
    copied.write_bytes((folder / "cal/calibrated.urdf").read_bytes())
    assert opening.calibration_at(copied) is None
    with pytest.raises(RobotError, match="a calibration has its own tip_link"):
        open_robot(folder / "cal", nominal=True, tip_link="link_3")
    with pytest.raises(RobotError, match="a calibration has its own coupling"):
        open_robot(folder / "cal", nominal=True, coupling="3+2")


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


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A calibration of a simulated IRB 1600."""
    nominal, rng = arm(), np.random.default_rng(1)
    truth = random_robot(nominal, "34", rng)
    points = measured(truth, nominal.random_joints(40, 1), 3e-5, rng)
    path = write_measurements(tmp_path_factory.mktemp("data") / "m.csv", points)
    calibration = irbcal.calibrate(path, "irb1600", "34", holdout=0.3)
    out = tmp_path_factory.mktemp("saved") / "calibration"
    calibration_folder.write(out, calibration.record, calibration.urdf, "")
    return out


def test_a_shipped_robot_and_its_file_are_the_same():
    by_name, by_path = open_robot("irb120"), open_robot(robots.robot_file("irb120"))
    q = arm("irb120").random_joints(5, 1)
    assert_same_poses(by_name.robot.poses(q), arm("irb120").forward(q), 1e-14, 1e-14)
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


def test_a_calibration_is_opened_with_its_robot(folder):
    loaded = irbcal.load(folder)
    for source in (folder, str(folder / "calibration.json"), loaded):
        record, opened = opening.open_calibration(source), open_robot(source)
        assert record is opened.record
        assert (record, opened.urdf_bytes, opened.folder) == (loaded.record, loaded.urdf, folder)
    assert opened_calibration(loaded.record).ends.flange_known  # of a shipped robot
    with pytest.raises(CalibrationError, match="not a calibration folder"):
        opening.open_calibration("irb1600")


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
    assert (opened.folder, opened.urdf, opened.urdf_bytes) == (None, None, None)
    with pytest.raises(CalibrationError, match="give its folder"):
        assert opened.nominal_urdf
    assert opened.robot.poses(np.zeros((1, 6))).shape == (1, 4, 4)


def test_what_cannot_be_opened(folder, tmp_path):
    with pytest.raises(RobotError, match=r"robot file 'nothing\.urdf' does not exist; robots by name are irb1600"):
        open_robot("nothing.urdf")
    with pytest.raises(CalibrationError, match="not a calibration folder"):
        open_robot(tmp_path)
    for source, name in ((folder, str(folder)), (irbcal.load(folder), "IRB")):
        with pytest.raises(RobotError, match="a calibration has its own tip_link") as caught:
            open_robot(source, tip_link="flange")
        assert str(caught.value).lower().startswith(name.lower())
        assert caught.value.parameter == "tip_link"


def test_the_file_in_a_calibration_folder_is_the_calibration(folder):
    assert open_robot(folder / "calibration.json").record == irbcal.load(folder).record


def test_an_open_folder_is_checked_again_after_every_change(folder, tmp_path):
    moving = tmp_path / "cal"
    shutil.copytree(folder, moving)
    opened = open_robot(moving)
    assert open_robot(moving) is opened
    assert open_robot(moving, nominal=True) is not opened
    for name in ("calibrated.urdf", "joint_origins.yaml", "calibration.json"):
        whole = (moving / name).read_bytes()
        (moving / name).write_bytes(whole.replace(b"0.1", b"0.2", 1))
        with pytest.raises(CalibrationError):
            open_robot(moving)
        (moving / name).write_bytes(whole)
        assert open_robot(moving) is opened


LIMITS_DEG = {
    "irb1600": [(-180, 180), (-90, 120), (-245, 65), (-200, 200), (-115, 115), (-400, 400)],
    "irb120": [(-165, 165), (-110, 110), (-110, 70), (-160, 160), (-120, 120), (-400, 400)],
}
SPEEDS_DEG = {"irb1600": [150, 160, 170, 320, 400, 460], "irb120": [250, 250, 250, 320, 320, 420]}
LINKS = ["base_link", *(f"link_{i}" for i in range(1, 7)), "flange", "tool0"]


@pytest.mark.parametrize("name", robots.ROBOTS)
def test_yourdfpy_reads_it_without_a_warning_and_agrees(name, caplog):
    with warnings.catch_warnings(), caplog.at_level(logging.WARNING):
        warnings.simplefilter("error")
        seen = yourdfpy.URDF.load(str(robots.robot_file(name)), load_meshes=False)
    assert caplog.records == []
    assert seen.validate()
    robot = urdf.read(name).arm
    for q in robot.random_joints(20, 0):
        seen.update_cfg(q)
        assert np.abs(seen.get_transform("tool0", "base_link") - robot.forward(q[None])[0]).max() < 1e-12


@pytest.mark.parametrize("name", robots.ROBOTS)
def test_frames_limits_speeds_and_masses(name):
    path = str(robots.robot_file(name))
    model = pin.buildModelFromUrdf(path)
    assert model.njoints == 7
    assert np.abs(np.degrees(model.lowerPositionLimit) - [low for low, _ in LIMITS_DEG[name]]).max() < 1e-9
    assert np.abs(np.degrees(model.upperPositionLimit) - [high for _, high in LIMITS_DEG[name]]).max() < 1e-9
    assert np.abs(np.degrees(model.velocityLimit) - SPEEDS_DEG[name]).max() < 1e-9
    data = model.createData()
    pin.framesForwardKinematics(model, data, np.zeros(6))
    for link in LINKS[:-1]:
        assert np.abs(data.oMf[model.getFrameId(link)].rotation - np.eye(3)).max() < 1e-15, link
    for inertia in list(model.inertias)[1:]:
        principal = np.linalg.eigvalsh(inertia.inertia)
        assert inertia.mass > 0
        assert principal[0] > 0
        assert principal[0] + principal[1] >= principal[2]


def test_masses():
    small = pin.buildModelFromUrdf(str(robots.robot_file("irb120")))
    assert [i.mass for i in list(small.inertias)[1:]] == [3.07, 3.91, 2.94, 1.33, 0.55, 0.14]
    large = pin.buildModelFromUrdf(str(robots.robot_file("irb1600")))
    assert sum(i.mass for i in list(large.inertias)[2:]) == pytest.approx(50, abs=5)
    text = robots.robot_file("irb1600").read_text()
    assert "estimated" in text
    assert "unconfirmed by the maker" in text


def test_the_list_of_robots_is_a_collection():
    found = robots.robots()
    assert len(found) == len(found.to_frame())
    assert [robot.name for robot in found] == list(found.to_frame()["name"])
    assert "irb120" in found
    assert found["irb120"] in found
    assert "irb999" not in found
    with pytest.raises(OptionError, match=r"name: expected irb1600, .*, found 'irb999'") as refused:
        found["irb999"]
    assert refused.value.parameter == "name"


@pytest.mark.parametrize("robot", [None, 5])
def test_what_is_no_name_is_refused(robot):
    with pytest.raises(RobotError, match="expected the path of a URDF or a robot's name, found") as refused:
        urdf.read(robot)
    assert refused.value.parameter == "robot"


def test_a_robot_by_name_may_have_a_calibration_of_that_name(cell, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copytree(cell[0] / "cal", "irb1600")
    for folder in ("ur5", "no_robot"):
        Path(folder).mkdir()
    assert robots.robot_file("ur5").is_file()
    assert open_robot("ur5").name == str(robots.robot_file("ur5"))
    Path("ur5", "calibrated.urdf").touch()
    with pytest.raises(CalibrationError):  # a part of a calibration is no empty folder
        open_robot("ur5")
    assert open_robot("irb1600").record is not None
    for name in ("irb1600", "ur5"):
        opened = open_robot(name, nominal=True)
        assert (opened.record, opened.name) == (None, str(robots.robot_file(name)))
    with pytest.raises(RobotError, match="a folder"):
        robots.robot_file("no_robot")
    line = ["calibrate", str(cell[0] / "old.csv"), "--robot", "irb1600", "--model", "11", "--out", "irb1600"]
    assert CliRunner().invoke(app, line).exit_code == 1
    assert CliRunner().invoke(app, [*line, "--force"]).exit_code == 0
    record = calibration_folder.read("irb1600").record
    assert record.model == "11"
    assert len(record.poses.pose) == 80, "the measurements of the folder that was there are not added"


def test_the_urdf_of_a_calibration_stands_for_it(cell, tmp_path):
    q = arm().random_joints(20, 4)
    whole, by_urdf = (open_robot(cell[0] / name).robot.poses(q) for name in ("cal", "cal/calibrated.urdf"))
    assert_same_poses(by_urdf, whole, 1e-12, 1e-12)
    shutil.copy(cell[0] / "cal" / "calibrated.urdf", tmp_path / "calibrated.urdf")  # alone it is its geometry
    assert open_robot(tmp_path / "calibrated.urdf").record is None
