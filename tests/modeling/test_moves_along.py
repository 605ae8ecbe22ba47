"""Last moves along trajectories: against the rule for stops, a simulated play, and splines of what is mapped."""

import numpy as np
import pytest
from history_cases import sided_robot
from scipy.interpolate import CubicSpline
from support import arm
from thesis_formula import ThesisMap

from irbcal.errors import RobotError
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.moves_along import STRIDE, lean_along, to_commands, to_effective
from irbcal.modeling.trajectory import Trajectory
from irbcal.units import DEG

AMPLITUDES = np.array([0.5, 0.3, 0.4, 0.8, 0.6, 1.0])
SPEEDS = np.array([1.0, 1.3, 0.7, 2.1, 1.7, 0.4])


@pytest.fixture(scope="module")
def sided():
    """The joint map of a robot whose joints lean to the side that they come from, with gears and gravity."""
    return sided_robot(others=("gain", "harmonics", "gravity")).joint_map


def swinging(n=2001, seconds=3.0):
    """All joints swing, each with its own time and phase."""
    t = np.linspace(0.0, seconds, n)
    phase = np.outer(t, SPEEDS) + np.arange(6)
    q, dq = AMPLITUDES * np.sin(phase), AMPLITUDES * SPEEDS * np.cos(phase)
    return Trajectory(t, q, dq, -(SPEEDS**2) * q)


def test_a_steady_motion_leans_as_a_long_move_does(sided):
    """In the middle of a straight way it is what the joint map says of a stop that is a stride behind."""
    t = np.linspace(0.0, 2.0, 50)
    speed = np.array([0.5, -0.2, 0.3, 0.4, -0.5, 0.1])
    some = Trajectory(t, np.outer(t, speed), np.tile(speed, (50, 1)), np.zeros((50, 6)))
    lean = lean_along(sided, some)
    move = speed / 0.5 * STRIDE[False]
    expected = sided.effective(some.q, some.q - move) - sided.effective(some.q)
    assert np.abs(lean.lean - expected)[-1].max() < 0.05 * np.abs(expected).max()
    assert np.abs(lean.rate[-1]).max() < 1e-8
    from_rest = lean_along(sided, some, previous=np.full(6, np.nan))
    assert np.abs(from_rest.lean[-1] - lean.lean[-1]).max() < 1e-8


def test_the_side_changes_within_the_width_of_play(sided):
    """A joint goes there and back: at the turn its side is the old one, a width later the new one, without a jump."""
    way = np.r_[np.arange(0.0, 10.0, 0.01), np.arange(10.0, 5.0, -0.01)] * DEG
    q = np.outer(way, [1.0, 0, 0, 0, 0, 0])
    lean = lean_along(sided, Trajectory(np.arange(1500) * 0.01, q)).lean[:, 0]
    turn, width = 1000, 50  # half a degree
    direction = next(c for t, c in zip(sided.history.terms, sided.history.coefficients, strict=True) if t.joint == 0)
    # exp(-2), and tanh of it for the stop, are what is left of the old side two widths later
    assert lean[turn + 2 * width] - lean[turn] == pytest.approx(-2 * direction * (1 - np.exp(-2)), rel=0.2)
    assert np.abs(np.diff(lean)[turn - 300 :]).max() < 0.05 * abs(direction)


def test_derivatives_are_those_of_the_mapped_positions(sided):
    commands = swinging()
    effective = to_effective(
        sided, Trajectory(commands.times, commands.q, commands.dq, commands.ddq, lean=lean_along(sided, commands))
    )
    spline, inner = CubicSpline(effective.times, effective.q), slice(50, -50)
    speed = np.abs(spline(effective.times, 1) - effective.dq)[inner]
    bend = np.abs(spline(effective.times, 2) - effective.ddq)[inner]
    assert speed.max() < 2e-4  # where a joint turns back, accelerations jump a little
    assert np.median(speed.max(axis=1)) < 1e-7
    assert np.median(bend.max(axis=1)) < 1e-3
    moved = np.abs(effective.dq - commands.dq)
    assert np.median(moved.max(axis=1)) > 5e-4  # what the derivatives of the map are worth


def test_the_path_decides_not_the_time(sided):
    fast = swinging()
    slow = lean_along(sided, fast.slowed(3.0))
    expected = lean_along(sided, fast)
    assert slow.lean == pytest.approx(expected.lean, abs=1e-12)
    assert slow.rate == pytest.approx(expected.rate / 3.0, abs=1e-12)
    assert slow.second == pytest.approx(expected.second / 9.0, abs=1e-10)


def test_rests_keep_the_side_and_the_end_of_a_path_is_a_stop(sided):
    """From stop to stop with rests: what the joint map says of a stop, but for the length of its move."""
    goal = np.array([0.6, -0.3, 0.2, 0.5, -0.4, 0.7])
    t = np.linspace(0.0, 1.0, 101)
    s = 10 * t**3 - 15 * t**4 + 6 * t**5
    q = np.vstack([np.outer(s, goal), np.tile(goal, (50, 1))])
    times = np.r_[t, 1.0 + 0.01 * np.arange(1, 51)]
    lean = lean_along(sided, Trajectory(times, q)).lean
    assert np.abs(lean[-1] - lean[100]).max() < 1e-9
    stop = sided.effective(goal[None], np.zeros((1, 6)))[0] - sided.effective(goal[None])[0]
    assert lean[-1] == pytest.approx(stop, abs=0.4 * np.abs(stop).max())
    assert np.abs(stop).max() > 2e-4


def test_maps_without_history_do_not_lean():
    some = swinging(20)
    assert lean_along(JointMap.identity(arm()), some) is None
    joint_map = ThesisMap(gain=1e-3 * np.arange(6), stiffness=[2e-3, 1e-3], fourier=[1e-3, 0, 2e-3, 1e-3]).joint_map(
        arm()
    )
    back = to_commands(joint_map, to_effective(joint_map, some))
    for name in ("q", "dq", "ddq"):
        assert getattr(back, name) == pytest.approx(getattr(some, name), abs=1e-12)


def test_a_stop_before_of_another_arm_is_refused(sided):
    with pytest.raises(RobotError, match=r"previous: expected 6 joints, found shape \(7,\)"):
        lean_along(sided, swinging(5), previous=np.zeros(7))
