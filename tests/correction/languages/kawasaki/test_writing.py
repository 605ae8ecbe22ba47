"""Where the controller's base and flange are, by one pair of joints and pose."""

import numpy as np
import pytest
from maker_cases import robot_of

from irbcal.correction.languages.kawasaki.writing import ends
from irbcal.errors import OptionError
from irbcal.modeling import frames

Q = np.radians([20.0, 30.0, -80.0, 40.0, 60.0, 10.0])


def turned(k, height=0.0):
    return frames.from_xyz_angles([0.0, 0.0, height, 0.0, 0.0, k * np.pi / 2])


@pytest.mark.parametrize(("base", "flange", "height"), [(0, 0, 0.0), (2, 2, 0.36), (1, 3, -0.1)])
def test_quarter_turns_and_the_height_are_found(base, flange, height):
    nominal = robot_of("rs007n")[0]
    B, F = turned(base, height), turned(flange)
    pose = frames.inverse(B) @ nominal.forward(Q[None])[0] @ F
    pose[0, 3] += 5e-6  # as far as a pendant rounds
    found = ends(nominal, Q, pose)
    np.testing.assert_allclose(found.T_base_world, B, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.T_tip_flange, F, rtol=0, atol=1e-9)


def test_other_pairs_are_refused():
    nominal = robot_of("rs007n")[0]
    pose = nominal.forward(Q[None])[0]
    with pytest.raises(OptionError, match=r"nearest is \d+\.\d mm and \d+\.\d\d degrees off"):
        ends(nominal, Q, pose @ frames.from_xyz_angles([0.0, 0.0, 0.1, 0.0, 0.2, 0.0]))
    upright = nominal.forward(np.zeros((1, 6)))[0]
    with pytest.raises(OptionError, match="fits several turns"):
        ends(nominal, np.zeros(6), upright)
