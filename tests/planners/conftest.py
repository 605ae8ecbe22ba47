"""Models for planners that several tests need."""

import numpy as np
import pytest
from support import example_robot, random_robot, with_thesis
from thesis_formula import ThesisMap

from irbcal.io import urdf
from irbcal.modeling import frames
from irbcal.planners.calibrated_model import CalibratedModel

T_TIP_SMR1 = frames.transform(frames.rot_x(0.3) @ frames.rot_z(-1.1), [-0.087, 0.087, 0.11])


@pytest.fixture(scope="session")
def cell():
    """A simulated IRB 1600 with large errors, in a URDF whose root is a measuring frame far from the base."""
    found = urdf.read("irb1600")
    robot = random_robot(found.arm, "34", np.random.default_rng(3), size=1.0)
    robot = robot.replace(joint_map=with_thesis(robot.joint_map, gain=1e-3 * np.arange(-2, 4)))
    content = urdf.with_links(urdf.to_bytes(found, robot.arm), robot.arm, robot.T_world_base)
    return robot, CalibratedModel(content, robot.arm, robot.joint_map, {"target_smr1": T_TIP_SMR1})


@pytest.fixture(scope="session")
def kinova():
    """A real URDF with three continuous joints, with simulated gains and joint-6 series."""
    path = example_robot("kinova_description/robots/kinova.urdf")
    found = urdf.read(path, tip_link="j2s6s200_end_effector")
    joint_map = ThesisMap(gain=1e-3 * np.arange(1, 7), fourier=[1e-3, -2e-3, 5e-4, 1e-3]).joint_map(found.arm)
    return CalibratedModel(path.read_bytes(), found.arm, joint_map)
