"""Trajectories as YAML: what ROS's own reader of YAML makes of them."""

import numpy as np
import pytest
import yaml

from irbcal.correction.languages import ros
from irbcal.modeling.trajectory import Trajectory


def test_written_messages_are_what_they_say():
    rng = np.random.default_rng(1)
    times = np.array([0.0, 0.1, 0.30000000004, 12.999999999999])
    q, dq = rng.standard_normal((2, 4, 2))
    found = yaml.safe_load(ros.to_yaml(Trajectory(times, q, dq, names=("a", "b")), "base"))
    assert found["joint_names"] == ["a", "b"]
    assert found["header"]["frame_id"] == "base"
    points = found["points"]
    assert np.array([p["positions"] for p in points]) == pytest.approx(q, abs=1e-12)
    assert np.array([p["velocities"] for p in points]) == pytest.approx(dq, abs=1e-12)
    assert all(p["accelerations"] == [] for p in points)
    assert points[2]["time_from_start"] == {"sec": 0, "nanosec": 300000000}
    assert points[3]["time_from_start"] == {"sec": 13, "nanosec": 0}
