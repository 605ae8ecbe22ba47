"""Arms of all kinds for the tests of the virtual cell."""

from support import example_robot

from irbcal.io import robots

THREE = ("smr1", "smr2", "smr3")


ON_A_RAIL = """<joint name="rail" type="prismatic">
    <parent link="rail_base"/><child link="base_link"/>
    <origin xyz="0 0.1 0.05" rpy="0 0.2 0.3"/><axis xyz="0 1 0"/>
    <limit lower="-0.2" upper="2.5" effort="1" velocity="1"/>
  </joint>
  <link name="rail_base"/>
</robot>"""


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
