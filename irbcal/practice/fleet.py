"""Robots of one type, measured in March and in July; the zero of a joint of one of them moved meanwhile: SIMULATED."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pandas as pd

from irbcal.practice.measured import ROBOT, TARGETS
from irbcal.practice.sample import Sample, csv
from irbcal.simulation.pose_list import drawn
from irbcal.simulation.shipped import open_cell
from irbcal.simulation.simulated_files import measurement_table
from irbcal.units import DEG

ROBOTS, POSES = 2, 40
MOVED_DEG = 0.05
"""By how much joint 3's zero of the last robot moved between the months."""
MONTHS = (("march", "2026-03-02"), ("july", "2026-07-06"))
OPTIONS = "model=34"


def files() -> Iterator[Sample]:
    """A list for each month, and its robots' measurements."""
    for later, (month, day) in enumerate(MONTHS):
        rows = []
        for k in range(ROBOTS):
            name, path = f"cell-{k + 1}", f"{month}/cell-{k + 1}.csv"
            moved = MOVED_DEG if later and k == ROBOTS - 1 else 0.0
            yield Sample(f"fleet/{path}", csv(_measured(20 + k, 30 + 10 * later + k, moved)), f"{name} in {month}")
            rows.append((name, f"1600-1012{k + 1}", path, ROBOT, day, OPTIONS))
        table = pd.DataFrame(rows, columns=["id", "serial", "measurements", "robot", "date", "options"])
        line = f"irbcal fleet calibrate fleet/{month}.csv --out {month}"
        yield Sample(f"fleet/{month}.csv", csv(table), f"a list of robots, measured in {month}", line)


def _measured(robot: int, seed: int, moved_deg: float) -> pd.DataFrame:
    """A measurement file of a robot whose joint 3 is not where its zero says."""
    cell = open_cell(ROBOT, seed=seed, robot_seed=robot).with_targets(TARGETS)
    poses = drawn(cell, POSES, seed)
    run = cell.measure(poses.q + moved_deg * DEG * np.eye(6)[2], poses.asked(cell), poses.wait_s)
    return measurement_table(run, poses, cell.arm)  # the joints that were commanded
