"""Moves cut to a tolerance: the fewest points, and reasons where there are none. Whole programs: test_paths of RAPID."""

import numpy as np
import pytest
from support import arm, random_robot

from irbcal.correction.cutting import Ends, PathMove, cut_move
from irbcal.correction.fake_targets import correct_joints
from irbcal.modeling import frames

Q = np.radians([[-30, -10, 20, 0, 40, 10], [0, -10, 20, 5, 45, 15], [30, 10, 10, 10, 50, 20], [30, 10, 10, 10, 50, 20]])


@pytest.fixture(scope="module")
def robots():
    nominal = arm()
    robot = random_robot(nominal, "34", np.random.default_rng(1), size=0.3)
    fake = correct_joints(robot, nominal, Q)
    return nominal, robot, {k: Ends(fake.T_wanted[k], Q[k], fake.q[k], fake.T_fake[k]) for k in range(len(Q))}


def move(start=0, to=2, via=None, zones=(0.0, 0.0), why=""):
    return PathMove(1, "MoveL p", start, via, to, frames.transform(None, [0, 0, 0.1]), zones, why)


@pytest.mark.parametrize("via", [None, 1])
def test_one_piece_less_would_not_do(robots, via):
    nominal, robot, ends = robots
    found = cut_move(move(via=via), ends, robot, nominal, 5e-5)
    assert found.why == ""
    assert found.deviation <= 5e-5 < found.uncut
    assert found.pieces > 1
    less = cut_move(move(via=via), ends, robot, nominal, found.deviation * 1.0001)
    assert less.pieces == found.pieces
    assert cut_move(move(via=via), ends, robot, nominal, 0.9999 * found.deviation).pieces > found.pieces


@pytest.mark.parametrize(
    ("wish", "tolerance", "words"),
    [
        ({"start": None}, 1e-4, "does not tell where it starts"),
        ({"to": 9}, 1e-4, "not all of its points are corrected"),
        ({"via": 3}, 1e-4, "do not lie on a line"),
        ({}, 1e-9, "pieces of 2 mm still leave the path"),
        ({"zones": (0.2, 0.2)}, 1e-5, "outside the zones of its ends"),
        ({"why": "there are external axes"}, 1e-5, "mm, and there are external axes"),
    ],
)
def test_why_a_move_is_not_cut(robots, wish, tolerance, words):
    nominal, robot, ends = robots
    found = cut_move(move(**wish), ends, robot, nominal, tolerance)
    assert words in found.why
    assert found.pieces == 1


def test_a_move_that_goes_nowhere(robots):
    nominal, robot, ends = robots
    found = cut_move(move(2, 3), ends, robot, nominal, 1e-6)
    assert (found.deviation, found.why) == (0.0, "")
