"""What several tests of the virtual cell need: arms of all kinds, and what one effect does to joints."""

import numpy as np
import pytest
from support import example_robot

from irbcal.io import robots
from irbcal.simulation import cell as cells
from irbcal.simulation.effect import Motion
from irbcal.simulation.shipped import open_cell
from irbcal.units import DEG

THREE = ("smr1", "smr2", "smr3")


ON_A_RAIL = """<joint name="rail" type="prismatic">
    <parent link="rail_base"/><child link="base_link"/>
    <origin xyz="0 0.1 0.05" rpy="0 0.2 0.3"/><axis xyz="0 1 0"/>
    <limit lower="-0.2" upper="2.5" effort="1" velocity="1"/>
  </joint>
  <link name="rail_base"/>
</robot>"""


@pytest.fixture(scope="module")
def cell():
    """The shipped cell with three targets."""
    return open_cell("irb1600").with_targets(THREE)


def robot_file(name, folder):
    """A shipped robot, one of example-robot-data, or an IRB 120 on a tilted rail."""
    files = {"panda": "panda_description/urdf/panda.urdf", "ur10": "ur_description/urdf/ur10_robot.urdf"}
    if name in files:
        return example_robot(files[name])
    if name != "rail":
        return robots.robot_file(name)
    path = folder / "rail.urdf"
    path.write_text(robots.robot_file("irb120").read_text().replace("</robot>", ON_A_RAIL))
    return path


OTHERS = {"panda": (None, "panda_link8"), "ur10": (None, None), "rail": ("rail_base", "tool0")}


def change_of_joints(cell, effect, joints, **options):
    """What an effect adds to the effective joints, degrees, read from the arm's own parameters."""
    motion = motion_of(cell, joints, **options)
    return effect.joints(motion, np.random.default_rng(0)) / DEG


def motion_of(cell, joints, wait_s=4.0, time_s=0.0):
    joints = np.radians(np.atleast_2d(joints))
    n = len(joints)
    still = np.zeros_like(joints)
    return Motion(
        joints,
        cells.directions(joints, np.zeros(6)),
        np.broadcast_to(time_s, n),
        np.broadcast_to(wait_s, n),
        still,
        still,
        np.zeros(6, dtype=bool),
        np.diff(joints, axis=0, prepend=np.zeros((1, 6))),
        np.zeros((n, 6, 2)),
    )
