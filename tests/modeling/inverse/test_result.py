"""What an inverse tells of itself: counts, notes, tables."""

import pickle

import numpy as np
import pytest
from support import arm, random_robot

from irbcal.modeling.inverse import calibrated_arm
from irbcal.modeling.inverse.result import Method, Reason


@pytest.fixture(scope="module")
def result():
    """Four poses: reached, out of reach, no pose, beyond the limits."""
    nominal = arm()
    robot = random_robot(nominal, "34", np.random.default_rng(0))
    q = np.radians([[10.0, 20, -30, 20, 40, 30], [0, 0, 0, 0, 30, 0], [0, 0, 0, 0, 30, 0], [0, 0, 0, 0, 120, 0]])
    T = robot.poses(q)
    T[1, 0, 3] += 9.0
    T[2, 0, 0] = np.nan
    return calibrated_arm.solve(robot, nominal, T, seed=q)


def test_notes_say_what_is_wrong_with_each_pose(result):
    assert result.notes().tolist() == [
        "",
        Reason.OUT_OF_REACH.in_words,
        Reason.NOT_A_POSE.in_words,
        "outside the joint limits",
    ]


def test_the_table_has_a_row_for_each_pose(result):
    table = result.to_frame()
    assert len(table) == len(result) == 4
    assert np.array_equal(table[[f"q{k}" for k in range(1, 7)]], result.joints, equal_nan=True)
    assert table["converged"].tolist() == [True, False, False, True]
    assert table["inside"].tolist() == [True, False, False, False]
    assert table["method"].tolist() == [Method(code).name.lower() for code in result.method]
    assert table["note"].tolist() == result.notes().tolist()


def test_the_summary_counts(result):
    for text in (result.summary(), repr(result), result._repr_html_()):
        assert "4 poses" in text
        assert "1 where the target holds NaN" in text
        assert len(text) < 2000


def test_results_cannot_be_changed_and_can_be_pickled(result):
    with pytest.raises(ValueError, match="read-only"):
        result.joints[0, 0] = 0.0
    again = pickle.loads(pickle.dumps(result))
    assert np.array_equal(again.joints, result.joints, equal_nan=True)
    assert again.summary() == result.summary()
