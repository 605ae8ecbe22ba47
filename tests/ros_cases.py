"""Trajectories of ROS as text."""

import yaml

NAMES = [f"joint_{k}" for k in range(1, 7)]
ECHO = """header:
  stamp: {sec: 0, nanosec: 0}
  frame_id: ''   # größe
joint_names: [joint_2, gripper, joint_1, joint_3, joint_4, joint_5, joint_6]
points:
- positions: [0.2, 9.5, 0.1, 0.3, 0.4, 0.5, 6e-1]
  velocities: []
  accelerations: []
  effort: []
  time_from_start:
    sec: 0
    nanosec: 500000000
- positions:
  - 0.3
  - 9.5
  - -0.1
  - 0.3
  - 0.4
  - 0.5
  - 1
  velocities: []
  accelerations: []
  effort: [1.0]
  time_from_start: {secs: 2, nsecs: 250000000}
---
"""


def message(n=3, wrong=None, **points):
    """A trajectory with speeds as text, something in it changed."""
    row = [{"positions": [0.1 * k] * 6, "velocities": [0.1] * 6, "time_from_start": 0.5 * k} for k in range(n)]
    row[-1] |= points
    return yaml.safe_dump({"joint_names": NAMES, "points": row} | (wrong or {}), default_flow_style=None)
