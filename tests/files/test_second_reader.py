"""yourdfpy without meshes computes what it computes with its scene, which can be had afterwards."""

import subprocess
import sys
from io import BytesIO

import numpy as np
import pytest

from irbcal.files import robots, second_reader, urdf


@pytest.mark.parametrize("name", ["irb1600", "panda", "z1"])
def test_the_same_as_its_scene_graph(name):
    robot = next(r for r in robots.robots().robots if r.name == name)
    arm, data = urdf.read(robot.name).arm, robot.path().read_bytes()
    q = arm.random_joints(5, 2)
    found = second_reader.poses(data, arm.joint_names, arm.base_link, arm.tip_link, q)
    scene = second_reader.yourdfpy().URDF.load(BytesIO(data), load_meshes=False)
    for row, T in zip(q, found, strict=True):
        scene.update_cfg(dict(zip(arm.joint_names, row.tolist(), strict=True)))
        np.testing.assert_allclose(T, scene.get_transform(arm.tip_link, arm.base_link), atol=1e-14)


def test_a_version_without_it_is_asked_for_its_scene(monkeypatch):
    robot = robots.robots().robots[0]
    arm, data = urdf.read(robot.name).arm, robot.path().read_bytes()
    given = data, arm.joint_names, arm.base_link, arm.tip_link, arm.random_joints(5, 2)
    alone = second_reader.poses(*given)
    monkeypatch.setattr(second_reader, "ALONE", "_called_otherwise")
    np.testing.assert_allclose(second_reader.poses(*given), alone, atol=1e-14)


LATER = """
import sys
from irbcal.files import second_reader
yourdfpy = second_reader.yourdfpy()
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
