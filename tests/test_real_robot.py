"""A real IRB 120 and a real tracker: held-out accuracy against an independent calculation."""

import numpy as np
import pytest

from irbcal import workflow
from irbcal.measurement import cleaning, table
from irbcal.validation.accuracy import distances, statistics

INDEPENDENT_MEAN_MM = {"nominal": 0.826, "11": 0.571, "16": 0.506, "26": 0.498, "34": 0.439}
"""Fit on the first 200 clean poses, verified on the other 296: computed outside this project."""

LARGEST_MM = {"nominal": 2.68, "11": 2.76, "16": 2.87, "26": 2.94, "34": 2.27}


@pytest.fixture(scope="module")
def irb120_file(shared_data):
    return shared_data / "irb120_laser_tracker" / "measurements.csv"


@pytest.mark.parametrize("level", INDEPENDENT_MEAN_MM)
def test_held_out_accuracy(irb120_file, level):
    outcome = workflow.calibrate(irb120_file, "irb120", level, holdout=296, order="last")
    assert outcome.fit_points.poses == 200
    assert outcome.heldout_points.poses == 296
    found = statistics(distances(outcome.fit.robot, outcome.heldout_points))
    assert found["mean_mm"] <= 1.01 * INDEPENDENT_MEAN_MM[level]
    assert found["max_mm"] <= LARGEST_MM[level]


def test_four_poses_with_wrong_references_are_left_out(irb120_file):
    found = cleaning.clean(table.read(irb120_file))
    wrong = {e.pose for e in found.excluded if e.reason.startswith("wrong reference")}
    assert wrong == {"21", "50", "135", "399"}
    assert found.points.poses == 496
    lost = [(e.pose, e.target) for e in found.excluded if e.reason.startswith("lost")]
    assert len(lost) == 9
    assert all(target.startswith("ref") for _, target in lost)


def test_registration_removes_the_drift_of_the_tracker(irb120_file):
    found = cleaning.clean(table.read(irb120_file))
    assert found.registration.residual < 5e-6
    assert 2e-5 < found.registration.largest_shift < 1e-4


def test_parallel_axes_never_run_apart(irb120_file):
    outcome = workflow.calibrate(irb120_file, "irb120", "34", holdout=296, order="last")
    rows = {row.name: row for row in outcome.fit.parameters()}
    lengths = [row.value for name, row in rows.items() if name.startswith(("delta_a", "delta_d")) and row.unit == "mm"]
    assert np.abs(lengths).max() < 1.6
    assert rows["delta_d2"].state == "tied"
