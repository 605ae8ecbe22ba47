"""Joints at which a SIMULATED robot touches something."""

import numpy as np

TIP = np.array([0.012, -0.03, 0.21])
"""Of the tool in the tip link."""
SOCKET = np.array([0.85, 0.1, 0.5])
START = np.radians([0.0, 20.0, 15.0, 10.0, 40.0, 0.0])


def reach(robot, place, rng, local=TIP):
    """Joints that bring a point of the tool to a place, from a side of their own: Newton's method with differences."""
    q = START + rng.uniform(-0.5, 0.5, 6)
    steps = np.vstack([np.zeros(6), 1e-6 * np.eye(6)])
    for _ in range(30):
        T = robot.poses(q + steps)
        tips = T[:, :3, :3] @ local + T[:, :3, 3]
        q = q + np.linalg.lstsq((tips[1:] - tips[0]).T / 1e-6, place - tips[0], rcond=1e-9)[0]
    return q
