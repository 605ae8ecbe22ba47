"""Numbers of programs: what is written, and what comes back."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import arm

from irbcal.correction.notation import number_text, numbers_from_poses, poses_from_numbers


@given(st.floats(-1e9, 1e9), st.sampled_from([6, 9]))
def test_number_text(value, decimals):
    text = number_text(value, decimals)
    assert re.fullmatch(r"-?(0|[1-9]\d*)(\.\d*[1-9])?", text)
    assert text != "-0"
    assert abs(float(text) - value) <= 0.5 * 10.0**-decimals + 1e-15 * abs(value)


def test_poses_come_through():
    T = arm().forward(arm().random_joints(200, 1))
    numbers = numbers_from_poses(T)
    assert (numbers[:, 3] >= 0).all()
    assert np.abs(np.linalg.norm(numbers[:, 3:], axis=1) - 1).max() < 1e-12
    assert np.abs(poses_from_numbers(numbers) - T).max() < 1e-12
    near = -numbers[:, 3:] + 0.01
    assert np.abs(numbers_from_poses(T, near)[:, 3:] + numbers[:, 3:]).max() < 1e-12, "the sign is that of the old one"


def test_what_is_no_pose_is_refused():
    for wrong in (2 * np.eye(4), np.diag([1.0, 1, -1, 1]), np.full((4, 4), np.nan)):
        with pytest.raises(ValueError, match="rigid"):
            numbers_from_poses(wrong)
