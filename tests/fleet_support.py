"""SIMULATED measurements of a fleet, and lists of them."""

import numpy as np
import pandas as pd

import irbcal


def measured(folder, name, robot_seed, seed, poses=24, moved=0.0):
    """A measurement file; ``moved`` is by how much joint 3's zero moved, radians."""
    found = irbcal.simulate("irb1600", random=poses, robot_seed=robot_seed, seed=seed, without=["visibility"])
    if moved:
        plan = found.poses.q.copy()
        plan[:, 2] += moved
        found = irbcal.simulate("irb1600", plan, robot_seed=robot_seed, seed=seed, without=["visibility"])
        table = found.to_frame()
        table["q3_deg"] -= np.degrees(moved)
        table.to_csv(folder / name, index=False)
        return
    found.to_frame().to_csv(folder / name, index=False)


def manifest(folder, rows):
    pd.DataFrame(rows, columns=["id", "serial", "measurements", "robot", "date", "options"]).to_csv(
        folder / "manifest.csv", index=False
    )
    return folder / "manifest.csv"
