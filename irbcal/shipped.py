"""Files that come with irbcal, by the name that this module had first: see `irbcal.files.robots`."""

from irbcal.files.robots import ROBOTS, demo_file, mesh_file, package_dirs, robot_file, urdf_folder

__all__ = ["ROBOTS", "demo_file", "mesh_file", "package_dirs", "robot_file", "urdf_folder"]
