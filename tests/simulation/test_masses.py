"""Masses of a URDF, and a payload added to them, by hand."""

import numpy as np
import pytest

from irbcal.errors import RobotError
from irbcal.io import robots, urdf
from irbcal.simulation import masses

TWO_LINKS = """<robot name="two"><link name="base_link"/>
<link name="a"><inertial><origin xyz="0.2 0 0"/><mass value="3"/></inertial></link>
<link name="b"><inertial><origin xyz="0 0 0.1"/><mass value="1"/></inertial></link>
<link name="finger"><inertial><mass value="2"/></inertial></link><link name="tool0"/>
<joint name="j1" type="revolute"><parent link="base_link"/><child link="a"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="stuck" type="fixed"><parent link="a"/><child link="b"/><origin xyz="0.6 0 0"/></joint>
<joint name="j2" type="revolute"><parent link="b"/><child link="tool0"/><origin xyz="0.4 0 0"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="grip" type="prismatic"><parent link="tool0"/><child link="finger"/><origin xyz="0 0.5 0"/>
<axis xyz="0 1 0"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint></robot>"""


def test_links_on_fixed_joints_and_branches_count_with_the_link_they_sit_on():
    found = masses.bodies(urdf.from_bytes(TWO_LINKS.encode(), "two", "base_link", "tool0"))
    np.testing.assert_allclose(found.mass, [4.0, 2.0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.centre[0], [(3 * 0.2 + 0.6) / 4, 0.0, 0.1 / 4], rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(found.centre[1]), 0.5, rtol=0, atol=1e-12)


def test_a_payload_moves_the_centre_of_the_last_body():
    bodies = masses.Bodies([1.0, 2.0], [[0, 0, 0], [0.3, 0, 0]])
    T = np.eye(4)
    T[:3, 3] = [0.0, 0.0, 0.1]
    loaded = bodies.with_payload(4.0, [0.0, 0.6, 0.0], T)
    np.testing.assert_allclose(loaded.mass, [1.0, 6.0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(loaded.centre[1], [0.1, 0.4, 0.4 / 6], rtol=0, atol=1e-12)
    assert bodies.with_payload(0.0, [1, 1, 1], T) is bodies
    with pytest.raises(ValueError, match="read-only"):
        loaded.mass[0] = 7.0


def test_masses_that_are_no_numbers_are_refused():
    text = robots.robot_file("irb120").read_text().replace('<mass value="3.91"/>', '<mass value="heavy"/>')
    with pytest.raises(RobotError, match="link 'link_2', mass: expected 1 numbers, found 'heavy'"):
        masses.bodies(urdf.from_bytes(text.encode(), "irb120"))
