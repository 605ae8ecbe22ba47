"""Balls touched in place of a tracker's points: SIMULATED."""

from __future__ import annotations

from collections.abc import Iterator

from irbcal.practice.sample import Sample, csv
from irbcal.simulation.device_simulation import simulate_device

POSES = 80


def files() -> Iterator[Sample]:
    """Rows at four balls, and what is known of these."""
    found = simulate_device("irb1600", "balls", POSES, seed=11)
    line = "irbcal calibrate touched.csv --features balls.csv --robot my_robot.urdf --out touched"
    yield Sample("touched.csv", csv(found.to_frame()), "four balls touched, no tracker", line)
    yield Sample("balls.csv", csv(found.features()), "what is known of the balls", line)
