"""The ROS package ``urdf/irbcal_description``: complete, made from its URDF files, calibrated by joint_origins.yaml."""

import os
import runpy
import subprocess
import sys
import types
import xml.etree.ElementTree as ET
from pathlib import Path
from unittest.mock import MagicMock

import numpy as np
import pinocchio as pin
import pytest
import xacro
import yaml
from support import assert_same_poses, measured, random_robot, write_measurements

import irbcal
from irbcal.io import robots, urdf, urdf_check

ROOT = Path(__file__).parents[1]
PACKAGE = robots.urdf_folder() / "irbcal_description"
ROBOTS = pytest.mark.parametrize("robot", robots.ROBOTS)


@pytest.fixture(scope="module")
def calibrations(tmp_path_factory):
    """A calibration folder of each shipped robot, from simulated measurements."""
    out = {}
    for name in robots.ROBOTS:
        top, rng = tmp_path_factory.mktemp(name), np.random.default_rng(3)
        truth = random_robot(urdf.read(name).arm, "26", rng)
        file = write_measurements(top / "m.csv", measured(truth, truth.arm.random_joints(40, 1), 3e-5, rng))
        irbcal.save(irbcal.calibrate(file, name, "26"), top / "cal")
        out[name] = top / "cal"
    return out


def described(robot, **mappings):
    """The URDF that xacro makes."""
    return xacro.process_file(str(PACKAGE / "urdf" / f"{robot}.urdf.xacro"), mappings=mappings).toxml().encode()


def test_the_files_are_made_from_the_urdf(capsys):
    script = str(ROOT / "scripts" / "make_description")
    done = subprocess.run([sys.executable, script, "--check"], capture_output=True, text=True)
    assert (done.returncode, done.stdout.split()[:4]) == (0, ["6", "files,", "0", "differ"])


@ROBOTS
def test_without_a_calibration_it_is_the_nominal_robot(robot):
    arm = urdf.read(robot).arm
    q = arm.random_joints(100, 1)
    made = described(robot)
    assert_same_poses(urdf_check.poses(made, arm, q), urdf_check.poses(read(robot), arm, q), 0.0, 0.0)
    assert shapes(made) == shapes(read(robot))
    masses = [[i.mass, *i.lever, *i.inertia.ravel()] for i in model(made).inertias]
    assert masses == [[i.mass, *i.lever, *i.inertia.ravel()] for i in model(read(robot)).inertias]
    assert np.array_equal(model(made).upperPositionLimit, model(read(robot)).upperPositionLimit)


@ROBOTS
def test_with_joint_origins_it_is_the_calibrated_robot(robot, calibrations):
    arm = irbcal.load(calibrations[robot]).arm()
    q = arm.random_joints(200, 2)
    made = described(robot, kinematics_params=str(calibrations[robot] / "joint_origins.yaml"))
    expected = urdf_check.poses((calibrations[robot] / "calibrated.urdf").read_bytes(), arm, q)
    assert_same_poses(urdf_check.poses(made, arm, q), expected, 1e-12, 1e-12)
    assert np.abs(expected - urdf_check.poses(read(robot), arm, q)).max() > 1e-5


def test_a_prefix_names_every_link_and_joint():
    root = ET.fromstring(described("irb120", prefix="left_"))
    names = [element.get("name") for tag in ("link", "joint") for element in root.findall(tag)]
    assert len(names) == 17
    assert all(name.startswith("left_") for name in names)
    assert pin.buildModelFromXML(described("irb120", prefix="left_").decode()).existBodyName("left_tool0")


@ROBOTS
def test_check_urdf_accepts_all(robot, calibrations, tmp_path):
    """The checker of urdfdom, which comes with Pinocchio."""
    prefix = Path(pin.__file__).parents[4]
    if not (prefix / "bin" / "check_urdf").is_file():
        pytest.skip("check_urdf is not installed")
    (tmp_path / "made.urdf").write_bytes(described(robot))
    irbcal.load(calibrations[robot]).save(tmp_path / "paths", mesh_paths="absolute")
    calibrated = [folder / "calibrated.urdf" for folder in (calibrations[robot], tmp_path / "paths")]
    for file in (robots.robot_file(robot), tmp_path / "made.urdf", *calibrated):
        done = subprocess.run(
            [prefix / "bin" / "check_urdf", file],
            env=os.environ | {"LD_LIBRARY_PATH": str(prefix / "lib")},
            capture_output=True,
            text=True,
        )
        assert done.returncode == 0, done.stdout + done.stderr
        assert "Successfully Parsed XML" in done.stdout
        assert "root Link: base_link" in done.stdout


def test_the_package_is_complete():
    root = ET.parse(PACKAGE / "package.xml").getroot()
    assert root.findtext("version") == irbcal.__version__
    assert root.findtext("license") == "BSD-2-Clause"
    assert root.findtext("maintainer") == "irbcal authors"
    assert (PACKAGE / "LICENSE").read_bytes() == (ROOT / "LICENSE").read_bytes()
    (line,) = [line for line in (PACKAGE / "CMakeLists.txt").read_text().splitlines() if "install(DIRECTORY" in line]
    folders = line.partition("DIRECTORY ")[2].partition(" DESTINATION")[0].split()
    assert set(folders) == {path.name for path in PACKAGE.iterdir() if path.is_dir()}


def test_the_launch_file_starts_what_the_package_depends_on(monkeypatch):
    """ROS is not here: its classes are stood in for, and what they were called with is looked at."""
    found = {}
    for name in ("launch", "launch.actions", "launch.substitutions", "launch_ros", "launch_ros.actions"):
        found[name] = types.ModuleType(name)
    for name in ("launch_ros.parameter_descriptions", "launch_ros.substitutions"):
        found[name] = types.ModuleType(name)
    node = MagicMock()
    parts = {"launch": ["LaunchDescription"], "launch.actions": ["DeclareLaunchArgument"]}
    parts["launch.substitutions"] = ["Command", "LaunchConfiguration", "PathJoinSubstitution"]
    parts["launch_ros.parameter_descriptions"], parts["launch_ros.substitutions"] = (
        ["ParameterValue"],
        ["FindPackageShare"],
    )
    for name, classes in parts.items():
        for item in classes:
            setattr(found[name], item, lambda *a, _name=item, **k: (_name, *a))
    found["launch_ros.actions"].Node = node
    for name, module in found.items():
        monkeypatch.setitem(sys.modules, name, module)
    entities = runpy.run_path(str(PACKAGE / "launch" / "display.launch.py"))["generate_launch_description"]()[1]
    assert [entity[1] for entity in entities[:3]] == ["robot", "kinematics_params", "model"]
    needed = {element.text for element in ET.parse(PACKAGE / "package.xml").getroot().findall("exec_depend")}
    started = {call.kwargs["package"] for call in node.call_args_list}
    assert started == {"robot_state_publisher", "joint_state_publisher_gui", "rviz2"}
    assert started | {"xacro", "launch", "launch_ros"} == needed
    shown = yaml.safe_load((PACKAGE / "rviz" / "display.rviz").read_text())["Visualization Manager"]
    assert shown["Displays"][1]["Description Topic"]["Value"] == "/robot_description"
    assert shown["Global Options"]["Fixed Frame"] == "base_link"


def read(robot):
    return robots.robot_file(robot).read_bytes()


def model(data):
    return pin.buildModelFromXML(data.decode())


def shapes(data):
    return [element.get("filename") for element in ET.fromstring(data).iter("mesh")]
