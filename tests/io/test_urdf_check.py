"""Pinocchio and yourdfpy compute what irbcal computes, or the URDF is refused."""

import subprocess
import sys
from dataclasses import replace
from io import BytesIO

import numpy as np
import pytest

import irbcal
from irbcal.errors import CalibrationError
from irbcal.io import robots, urdf, urdf_check


@pytest.mark.parametrize("name", ["irb1600", "panda", "z1"])
def test_the_same_as_its_scene_graph(name):
    robot = next(r for r in robots.robots().robots if r.name == name)
    arm, data = urdf.read(robot.name).arm, robot.path().read_bytes()
    q = arm.random_joints(5, 2)
    found = urdf_check.poses_by_yourdfpy(data, arm, q)
    scene = urdf_check.yourdfpy().URDF.load(BytesIO(data), load_meshes=False)
    for row, T in zip(q, found, strict=True):
        scene.update_cfg(dict(zip(arm.joint_names, row.tolist(), strict=True)))
        np.testing.assert_allclose(T, scene.get_transform(arm.tip_link, arm.base_link), atol=1e-14)


def test_a_version_without_it_is_asked_for_its_scene(monkeypatch):
    robot = robots.robots().robots[0]
    arm, data = urdf.read(robot.name).arm, robot.path().read_bytes()
    given = data, arm, arm.random_joints(5, 2)
    alone = urdf_check.poses_by_yourdfpy(*given)
    monkeypatch.setattr(urdf_check, "JOINT_TRANSFORM", "_called_otherwise")
    np.testing.assert_allclose(urdf_check.poses_by_yourdfpy(*given), alone, atol=1e-14)


LATER = """
import sys
from irbcal.io import urdf_check
yourdfpy = urdf_check.yourdfpy()
assert not any(name.split(".")[0] in ("trimesh", "scipy", "networkx") for name in sys.modules)
import trimesh
text = b'<robot name="r"><link name="a"><visual><geometry><box size="1 2 3"/></geometry></visual></link></robot>'
from io import BytesIO
scene = yourdfpy.URDF.load(BytesIO(text)).scene
assert isinstance(scene, trimesh.Scene) and scene.extents.tolist() == [1.0, 2.0, 3.0]
assert trimesh.transformations is sys.modules["trimesh.transformations"]
"""


def test_meshes_are_loaded_when_they_are_asked_for():
    subprocess.run([sys.executable, "-c", LATER], check=True)


def test_a_urdf_that_pinocchio_reads_otherwise_is_never_made(validated, monkeypatch):
    honest = urdf.to_bytes
    monkeypatch.setattr(
        urdf, "to_bytes", lambda *a, **k: honest(*a, **k).replace(b'<axis xyz="0 1 0"', b'<axis xyz="0 -1 0"', 1)
    )
    with pytest.raises(CalibrationError, match="Pinocchio disagrees with the calibrated robot"):
        irbcal.calibrate(validated.measurements, "irb1600", "34")


def test_yourdfpy_and_pinocchio_agree_on_all_named_robots():
    """Two readers of URDF that share no code, on the files of several makers."""
    for robot in robots.robots().robots:
        found = urdf.read(robot.name)
        q = found.arm.random_joints(5, 3)
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
    assert urdf_check.check(data, found.arm).witnesses == {
        "Pinocchio": urdf_check.CHECK_POSES,
        "yourdfpy": urdf_check.SECOND_POSES,
    }


def test_without_pinocchio_two_other_readers_stop_a_wrong_urdf(monkeypatch):
    robot = urdf.read("irb120")
    data = urdf.to_bytes(robot, robot.arm)
    monkeypatch.setitem(sys.modules, "pinocchio", None)
    assert list(urdf_check.check(data, robot.arm).witnesses) == ["irbcal's reader", "yourdfpy"]
    wrong = robot.arm.with_table(replace(robot.arm.table, a=robot.arm.table.a + 2e-9))
    with pytest.raises(CalibrationError, match="irbcal's reader disagrees with the calibrated robot"):
        urdf_check.check(data, wrong)
    honest = urdf_check.poses_by_yourdfpy
    monkeypatch.setattr(urdf_check, "poses_by_yourdfpy", lambda *a: honest(*a) + 2e-9)
    with pytest.raises(CalibrationError, match="yourdfpy disagrees with the calibrated robot"):
        urdf_check.check(data, robot.arm)
