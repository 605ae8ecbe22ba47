import numpy as np
import pytest
from support import arm, measured, random_robot

from irbcal.identification import fit
from irbcal.measurement import cleaning, table


@pytest.fixture(scope="session")
def fanuc(shared_data):
    """A large arm whose axes were measured one at a time, axis 1 from another home pose than the others."""
    return cleaning.clean(table.read(shared_data / "fanuc_r2000_axis_by_axis" / "measurements.csv")).points


@pytest.fixture(scope="session")
def case():
    """A level-34 fit, and two groups of points that it does not use."""
    nominal = arm()
    rng = np.random.default_rng(0)
    robot = random_robot(nominal, "34", rng)
    problems = [
        fit.make_problem(nominal, measured(robot, nominal.random_joints(poses, seed), 5e-5, rng), "34")[0]
        for seed, poses in enumerate((30, 20, 20))
    ]
    return problems[0], {"iso cube": problems[1], "all range": problems[2]}
