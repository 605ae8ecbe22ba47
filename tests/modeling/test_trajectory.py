"""Trajectories: what lies between their points, against polynomials and scipy."""

import numpy as np
import pytest

from irbcal.errors import RobotError
from irbcal.modeling.trajectory import ReversalOffset, Trajectory
from irbcal.units import DEG, MM

TIMES = np.array([0.0, 0.3, 0.5, 1.1, 1.6])


def fifth(t):
    """A polynomial of fifth order for two joints, with its derivatives, each of shape (n, 2)."""
    polynomials = [np.polynomial.Polynomial([0.1, -0.5, 0.3, 0.8, -1.1, 0.4]), np.polynomial.Polynomial([1, 0, -2, 1])]
    return [np.column_stack([p.deriv(order)(t) if order else p(t) for p in polynomials]) for order in range(3)]


def test_quintics_are_exact_for_polynomials_of_fifth_order():
    dense = Trajectory(TIMES, *fifth(TIMES)).dense(7)
    assert len(dense) == 7 * 4 + 1
    for found, expected in zip((dense.q, dense.dq, dense.ddq), fifth(dense.times), strict=True):
        assert found == pytest.approx(expected, abs=1e-12)


def test_cubics_where_speeds_are_given_and_a_spline_where_positions_stand_alone():
    q, dq, _ = fifth(TIMES)
    for some in (Trajectory(TIMES, q[:, 1:], dq[:, 1:]), Trajectory(TIMES, q[:, 1:])):  # a cubic: both are exact
        dense = some.dense(5)
        for found, expected in zip((dense.q, dense.dq, dense.ddq), fifth(dense.times), strict=True):
            assert found[:, 0] == pytest.approx(expected[:, 1], abs=1e-12)
        assert some.with_derivatives().ddq[:, 0] == pytest.approx(fifth(TIMES)[2][:, 1], abs=1e-12)


def test_one_point_stands_still():
    one = Trajectory([2.0], [[0.1, 0.2]]).dense()
    assert one.q.tolist() == [[0.1, 0.2]]
    assert not one.dq.any()
    assert not one.ddq.any()


def test_slower_is_the_same_path():
    q, dq, ddq = fifth(TIMES)
    lean = ReversalOffset(q, dq, ddq)
    slow = Trajectory(TIMES + 1.0, q, dq, ddq, lean=lean).slowed(2.0)
    assert slow.times == pytest.approx(1.0 + 2.0 * TIMES)
    assert slow.at([1.0 + 2 * 0.4]).q == pytest.approx(fifth(np.array([0.4]))[0], abs=1e-12)
    assert slow.at([1.0 + 2 * 0.4]).ddq == pytest.approx(fifth(np.array([0.4]))[2] / 4, abs=1e-12)
    assert slow.lean.rate == pytest.approx(dq / 2)
    assert slow.lean.second == pytest.approx(ddq / 4)


@pytest.mark.parametrize("factor", [0.0, -2.0, np.nan, np.inf])
def test_only_a_positive_number_slows_a_path(factor):
    with pytest.raises(RobotError) as refused:
        Trajectory(TIMES, fifth(TIMES)[0]).slowed(factor)
    assert refused.value.parameter == "factor"


def test_joints_are_found_by_their_names():
    q, dq, _ = fifth(TIMES)
    some = Trajectory(TIMES, q, dq, names=("b", "a"), prismatic=[True, False])
    other = some.in_order_of(["a", "b"])
    assert np.array_equal(other.q, q[:, ::-1])
    assert np.array_equal(other.dq, dq[:, ::-1])
    assert other.columns == ["q1_deg", "q2_mm"]
    frame = other.to_frame()
    assert list(frame.columns) == ["time_s", "q1_deg", "q2_mm", "v1_deg_s", "v2_mm_s"]
    assert frame["v2_mm_s"].to_numpy() == pytest.approx(dq[:, 0] / MM)
    assert frame["q1_deg"].to_numpy() == pytest.approx(q[:, 1] / DEG)
    with pytest.raises(RobotError, match="no joint c: its joints are b, a"):
        some.in_order_of(["a", "c"])


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"times": [0, 0.3, 0.3, 1.1, 1.6]}, "times of a trajectory grow, but point 3 is at 0.3 s after 0.3 s"),
        ({"dq": np.full((5, 2), np.nan)}, "point 1 of the trajectory has no finite number for dq"),
        ({"dq": np.zeros((5, 3))}, r"dq needs shape \(5, 2\), found \(5, 3\)"),
        ({"ddq": np.zeros((5, 2))}, "accelerations needs speeds"),
        ({"names": ("a",)}, "needs as many names"),
        ({"times": [0.0]}, r"found \(1,\) and \(5, 2\)"),
    ],
)
def test_what_is_no_trajectory_is_refused(changed, words):
    with pytest.raises(RobotError, match=words):
        Trajectory(**{"times": TIMES, "q": fifth(TIMES)[0]} | changed)
    with pytest.raises(RobotError, match=r"from 0 s to 1\.6 s, found 1\.7 s"):
        Trajectory(TIMES, fifth(TIMES)[0]).at([1.7])
