"""A small calibration with groups, and measurements of a thousand poses of the same (simulated) robot."""

import numpy as np
import pandas as pd
import pytest
from support import arm, measured, random_robot, write_measurements
from viewer_urdf import write_stl

import irbcal
from irbcal.viewer import shapes


def with_column(path, name, values):
    table = pd.read_csv(path)
    table[name] = values(table)
    table.to_csv(path, index=False)
    return path


@pytest.fixture(scope="session")
def cell(tmp_path_factory):
    """Folder with ``cal`` (an IRB 1600), ``poses.csv`` (40 poses, groups a and b) and ``many.csv`` (1,000 x 3)."""
    folder = tmp_path_factory.mktemp("view")
    nominal = arm("irb1600")
    rng = np.random.default_rng(5)
    T = np.eye(4)
    T[:3, :3] = [[0, 1, 0], [-1, 0, 0], [0, 0, 1]]
    T[:3, 3] = 2.5, 0.5, -0.6  # the tracker stands away from the robot
    truth = random_robot(nominal, "34", rng, T_world_base=T)
    for name, n, seed in (("fit", 60, 1), ("poses", 40, 2), ("many", 1000, 3)):
        points = measured(truth, nominal.random_joints(n, seed), 5e-5, rng)
        write_measurements(folder / f"{name}.csv", points)
    with_column(folder / "poses.csv", "group", lambda t: np.where(t["pose"] < 15, "a", "b"))
    irbcal.save(irbcal.calibrate(folder / "fit.csv", "irb1600", "34", holdout=10), folder / "cal")
    return folder


@pytest.fixture(scope="session")
def view(cell):
    return irbcal.view(cell / "cal", cell / "poses.csv")


@pytest.fixture
def packages(tmp_path):
    write_stl(tmp_path / "ws" / "my_robot" / "meshes" / "part.stl", shapes.box([1, 1, 1]))
    write_stl(tmp_path / "secret.stl", shapes.box([1, 1, 1]))
    return tmp_path / "ws"
