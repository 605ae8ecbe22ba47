"""Cutting paths: the fewest moves that keep a tolerance, and what is refused."""

import numpy as np
import pytest
from support import arm, random_robot

from irbcal.correction.path import Circle, Line
from irbcal.correction.subdivision import subdivide
from irbcal.errors import RobotError
from irbcal.modeling import frames


def small_circle(nominal):
    """The circle of annex VI, first test: radius 300 mm about a point in front of the robot, horizontal."""
    seed = np.radians([-3.984, 5.733483, 4.519, -0.017, 79.885, -273.988])
    T = nominal.forward(seed[None])[0]
    start = T.copy()
    start[0, 3] += 0.15
    return Circle.full(start, T[:3, 3], [0, 0, 1]), seed


@pytest.mark.parametrize("kind", ["line", "circle"])
def test_more_moves_keep_the_true_path_closer(kind):
    nominal = arm()
    robot = random_robot(nominal, "34", np.random.default_rng(4), size=0.2)
    path, seed = small_circle(nominal)
    if kind == "line":
        path = Line(path.poses([0.0])[0], path.poses([0.4])[0])
    whole = subdivide(path, robot, nominal, seed, tolerance=1e-5)
    assert whole.deviation <= 1e-5 < whole.uncut
    moves = (len(whole.s) - 1) // (2 if kind == "circle" else 1)
    fewer = subdivide(path, robot, nominal, seed, length=1.0001 * path.length / (moves - 1))
    assert fewer.deviation > 1e-5, "the fewest moves that keep the tolerance were taken"
    assert whole.corrected.ok.all()
    assert len(whole.to_frame()) == len(whole.s)
    assert f"{1e3 * whole.deviation:.4f} mm" in repr(whole)
    by_length = subdivide(path, robot, nominal, seed, length=0.03)
    assert len(by_length.s) - 1 == (2 if kind == "circle" else 1) * int(np.ceil(path.length / 0.03))


def test_a_whole_circle_takes_two_moves_at_least():
    nominal = arm()
    robot = random_robot(nominal, "34", np.random.default_rng(4), size=0.2)
    path, seed = small_circle(nominal)
    coarse = subdivide(path, robot, nominal, seed, length=10.0)
    assert len(coarse.s) == 5
    # halves of the circle keep near it: an arc through a wrong point would leave by its diameter
    assert coarse.deviation == coarse.uncut < 5e-4


def test_impossible_wishes_are_refused():
    nominal = arm()
    robot = random_robot(nominal, "34", np.random.default_rng(4), size=0.2)
    path, seed = small_circle(nominal)
    with pytest.raises(RobotError, match="by a tolerance or by a length"):
        subdivide(path, robot, nominal, seed)
    with pytest.raises(RobotError, match="takes more than 8 moves"):
        subdivide(path, robot, nominal, seed, tolerance=1e-12, most=8)
    far = Line(path.T_start, frames.transform(path.T_start[:3, :3], [4.0, 0, 1]))
    with pytest.raises(RobotError, match="does not reach point"):
        subdivide(far, robot, nominal, seed, length=0.1)
