"""Arms of all kinds for the tests of the virtual cell."""

from support import example_robot, on_a_rail

from irbcal.io import robots

THREE = ("smr1", "smr2", "smr3")


def robot_file(name, folder):
    """A shipped robot, one of example-robot-data, or an IRB 120 on a tilted rail."""
    files = {"panda": "panda_description/urdf/panda.urdf", "ur10": "ur_description/urdf/ur10_robot.urdf"}
    if name in files:
        return example_robot(files[name])
    if name != "rail":
        return robots.robot_file(name)
    return on_a_rail(folder / "rail.urdf", tilt=0.2)


OTHERS = {"panda": (None, "panda_link8"), "ur10": (None, None), "rail": ("rail_base", "tool0")}
