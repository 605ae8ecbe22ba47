"""Limits along a trajectory: sines whose extremes are known."""

import numpy as np
import pytest

from irbcal.errors import RobotError
from irbcal.modeling.trajectory import Trajectory
from irbcal.modeling.trajectory_limits import Limits, check, limits_in_order

FAR = np.full(2, np.inf)
W = 2.0


def sine(n=40, amplitude=1.0):
    """The first joint is ``sin 2 t``, the second stands."""
    t = np.linspace(0.05, 3.0, n)
    parts = (amplitude * f for f in (np.sin(W * t), W * np.cos(W * t), -W * W * np.sin(W * t)))
    return Trajectory(t, *(np.column_stack([p, 0 * p]) for p in parts), names=("joint_a", "joint_b"))


def test_limits_that_hold():
    found = check(sine(), Limits(-FAR, FAR, [2.01, 1.0], [4.01, 1.0]))
    assert found.within
    assert found.slower == 1.0
    assert found.in_time() is found.trajectory


def test_each_limit_is_named_with_joint_time_and_size():
    found = check(sine(), Limits(-FAR, [0.9, 9.0], [1.9, 9.0], [3.0, 9.0]))
    position, speed, acceleration = found.exceeded
    assert position.in_words.startswith("joint_a passes its limit of position at 0.78")
    assert (position.time, position.value, position.limit) == pytest.approx((np.pi / 4, 1.0, 0.9), abs=1e-2)
    assert position.value == pytest.approx(1.0, abs=1e-4)
    assert (position.start, position.end) == pytest.approx(
        (np.arcsin(0.9) / 2, np.pi / 2 - np.arcsin(0.9) / 2), abs=0.01
    )
    assert (speed.time, speed.value, speed.limit) == pytest.approx((np.pi / 2, -2.0, -1.9), abs=1e-2)
    assert abs(acceleration.value) == pytest.approx(4.0, abs=1e-3)
    assert found.slower == pytest.approx(np.sqrt(4 / 3), abs=1e-3)
    assert " degrees/s, 5.73 beyond -108.862" in speed.in_words
    with pytest.raises(RobotError, match="going slower does not help"):
        found.in_time()
    assert found.to_frame()["kind"].tolist() == ["position", "speed", "acceleration"]


def test_stretched_in_time_speeds_and_accelerations_hold():
    limits = Limits(-FAR, FAR, [1.5, 9.0], [3.5, 9.0])
    found = check(sine(), limits)
    assert found.slower == pytest.approx(2 / 1.5, abs=1e-3)
    again = check(found.in_time(), limits)
    assert again.within
    assert "stretched in time by 1.333" in found.summary()


def test_what_passes_between_points_is_seen():
    sparse = Trajectory([0.0, np.pi], [[0.0], [0.0]], [[1.0], [-1.0]], [[0.0], [0.0]], names=("a",))
    assert np.abs(sparse.q).max() == 0.0
    (found,) = check(sparse, Limits([-9.0], [0.5])).exceeded
    assert found.time == pytest.approx(np.pi / 2, abs=1e-9)
    assert found.value > 0.9


def test_limits_that_are_none_are_refused():
    assert limits_in_order({"b": 1, "a": 2}, ("a", "b"), "speed").tolist() == [2.0, 1.0]
    assert limits_in_order(3.0, ("a", "b"), "speed").tolist() == [3.0, 3.0]
    with pytest.raises(RobotError, match="speed: there is no limit for b"):
        limits_in_order({"a": 1}, ("a", "b"), "speed")
    with pytest.raises(RobotError, match="speed: expected 2 limits above zero"):
        Limits(-FAR, FAR, [1.0, 0.0])
