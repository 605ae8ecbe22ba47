"""The test cube against the thesis's test poses, and the plan as a table."""

import json

import numpy as np
import pytest
from support import arm

from irbcal.errors import RobotError
from irbcal.validation import pose_check

THESIS = np.array(
    [
        [0, -14, 14, 0, 0, 0],
        [17.690, 18.084, -46.521, -33.814, 33.095, 29.298],
        [-17.690, 18.084, -46.521, 33.814, 33.095, -29.298],
        [-41.374, -24.789, 47.145, -66.643, -46.052, 58.108],
        [41.374, -24.789, 47.145, 66.643, -46.052, -58.108],
    ]
)
"""Table A I-1 with its columns and signs restored, degrees."""


def test_five_poses_of_the_thesis():
    found = pose_check.five_poses(arm())
    assert np.abs(np.degrees(found.q) - THESIS).max() < 0.0015, "printed to 0.001 degrees"
    offset = (found.T_base_tip[:, :3, 3] - found.T_base_tip[0, :3, 3]) * 1e3
    signs = np.array([[0, 0, 0], [1, 1, 1], [1, -1, 1], [-1, -1, -1], [-1, 1, -1]])
    assert np.abs(offset - 271.93 * signs).max() < 0.005


def test_five_poses_of_other_cubes_and_robots():
    irb120 = arm("irb120")
    found = pose_check.five_poses(irb120)
    assert np.abs(irb120.forward(found.q) - found.T_base_tip).max() < 1e-9
    assert ((found.q >= irb120.lower) & (found.q <= irb120.upper)).all()
    for plane, (i, j, sign) in {"x=z": (0, 2, 1), "x=-z": (0, 2, -1), "y=z": (1, 2, 1), "y=-z": (1, 2, -1)}.items():
        p = pose_check.five_poses(irb120, [0.35, 0, 0.4], 0.2, plane=plane, fraction=0.1).T_base_tip[:, :3, 3]
        p = p - [0.35, 0, 0.4]
        assert np.abs(p[:, i] - sign * p[:, j]).max() < 1e-15, "all five lie on the plane"
        assert np.abs(p[1:3] + p[3:]).max() < 1e-15, "P2 and P4, P3 and P5 on the same diagonals"
        assert np.abs(np.linalg.norm(p[1:], axis=1) - 0.4 * 0.2 * np.sqrt(3)).max() < 1e-15
    with pytest.raises(RobotError, match="does not reach P2"):
        pose_check.five_poses(irb120, [0.6, 0, 0.3], 0.6)
    with pytest.raises(RobotError, match="inclined planes"):
        pose_check.five_poses(irb120, plane="z=0")


def test_the_poses_become_a_dict_for_json():
    found = json.loads(json.dumps(pose_check.five_poses(arm()).to_dict()))
    assert found["robot"] == arm().name
    assert [row["pose"] for row in found["poses"]] == list(pose_check.POSES)
