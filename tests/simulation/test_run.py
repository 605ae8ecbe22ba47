"""Runs: the points that were seen, as a calibration takes them."""

import numpy as np


def test_points_are_the_targets_that_were_seen(cell, q):
    run = cell.without("visibility").measure(q[:50])
    points = run.points(["g"] * 50)
    seen = np.isfinite(run.xyz[:, :3]).all(axis=2)
    assert len(points.xyz) == seen.sum() < 150
    np.testing.assert_array_equal(points.xyz, run.xyz[:, :3][seen])
    assert set(points.groups) == {"g"}
    assert points.target_names == ("smr1", "smr2", "smr3")


def test_a_run_is_printed_short(cell):
    run = cell.measure(np.zeros((3, 6)))
    assert repr(run).startswith("<Run: SIMULATED, 3 poses, ")
    assert len(repr(run)) < 300
