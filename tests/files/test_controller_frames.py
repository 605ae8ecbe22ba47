"""Where the controller's world and flange are, against yourdfpy's forward kinematics."""

import numpy as np
import pytest
from maker_cases import robot_of

from irbcal.files.controller_frames import controller_frames, unknown

URDF = b"""<robot name="r"><link name="base_link"/><link name="base"/><link name="l1"/><link name="flange"/><link name="tool0"/>
<joint name="b" type="fixed"><parent link="base_link"/><child link="base"/><origin rpy="0 0 3.141592653589793" xyz="0 0 0.5"/></joint>
<joint name="j" type="revolute"><parent link="base_link"/><child link="l1"/></joint>
<joint name="f" type="fixed"><parent link="l1"/><child link="flange"/><origin xyz="0.1 0 0"/></joint>
<joint name="t" type="fixed"><parent link="flange"/><child link="tool0"/><origin rpy="0 1.5707963267948966 0" xyz="0 0 0"/></joint>
</robot>"""


def test_fixed_links_are_found_up_and_down():
    found = controller_frames(URDF, "r", "base_link", "l1")
    assert found.base_known
    assert found.flange_known
    np.testing.assert_allclose(
        found.T_base_world[:3], [[-1, 0, 0, 0], [0, -1, 0, 0], [0, 0, 1, 0.5]], rtol=0, atol=1e-15
    )
    np.testing.assert_allclose(
        found.T_tip_flange[:3], [[0, 0, 1, 0.1], [0, 1, 0, 0], [-1, 0, 0, 0]], rtol=0, atol=1e-15
    )
    at_tool = controller_frames(URDF, "r", "base_link", "tool0")
    np.testing.assert_allclose(at_tool.T_tip_flange, np.eye(4), rtol=0, atol=0)


def test_links_that_are_not_there():
    found = controller_frames(URDF.replace(b'"base"', b'"other"'), "r", "base_link", "l1")
    assert not found.base_known
    np.testing.assert_array_equal(found.T_base_world, np.eye(4))
    assert not unknown().flange_known


@pytest.mark.parametrize(("name", "height"), [("m20ia", 0.525), ("gp8", 0.33), ("rx160", 0.55), ("kr120r2500pro", 0.0)])
def test_public_urdfs(name, height):
    at = robot_of(name)[2]
    assert at.base_known
    assert at.T_base_world[2, 3] == height
