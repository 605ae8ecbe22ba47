"""Criteria of attained poses worked out by hand."""

import numpy as np
import pytest

from irbcal.errors import MeasurementError
from irbcal.modeling import frames
from irbcal.validation.pose_check import Attained, criteria


def poses(rows, **more):
    """Attained positions from rows of (pose, cycle, x, y, z) in mm."""
    n = len(rows)
    text = {name: np.array(more.pop(name, [""] * n)) for name in ("group", "direction", "time")}
    columns = {
        "q": np.zeros((n, 6)),
        "pose": np.array([row[0] for row in rows]),
        "cycle": np.array([str(row[1]) for row in rows]),
        "order": np.array([row[1] - 1 for row in rows]),
        "xyz": np.array([row[2:] for row in rows], dtype=float) * 1e-3,
        **text,
        "time": text["time"].astype(object),
    }
    return Attained("poses.csv", "smr1", **columns, **more)


ROWS = [
    ("P4", 1, 100, 0, 1),
    ("P4", 2, 100, 0, -1),
    ("P2", 1, 0, 3, 0),
    ("P2", 2, 0, 5, 0),
]


def test_poses_distance_and_errors_from_the_mean():
    found = criteria(poses(ROWS), 10)
    assert list(found.poses) == ["P2", "P4"]
    p2 = found.poses["P2"]
    assert (p2["n"], p2["AP_mm"]) == (2, None)
    assert [p2[f"l_{what}_mm"] for what in ("mean", "sigma", "max")] == pytest.approx([1, 0, 1])
    assert p2["RP_mm"] == pytest.approx(1.0)
    assert "AP_x_mm" not in p2
    assert found.overall["from"] == "mean"
    assert found.overall["position"]["n"] == 4
    assert found.history["pose"] == ("P4", "P4", "P2", "P2")
    assert found.history["orientation_deg"] is None
    lengths = np.array([np.sqrt(100**2 + 3**2 + 1), np.sqrt(100**2 + 5**2 + 1)])
    assert found.distance["RD_mm"] == pytest.approx(3 * lengths.std(ddof=1))
    assert (found.distance["AD_mm"], found.distance["n"]) == (None, 2)
    assert (found.directions, found.drift) == (None, None)
    with pytest.raises(TypeError, match="cannot be changed"):
        found.poses["P2"]["n"] = 3


def test_errors_from_the_command():
    wanted = np.array([[0.1, 0, 0], [0.1, 0, 0], [0, 0, 0], [0, 0, 0]])
    found = criteria(poses(ROWS, wanted=wanted), 10)
    assert found.poses["P2"]["AP_mm"] == pytest.approx(4.0)
    assert [found.poses["P2"][f"AP_{a}_mm"] for a in "xyz"] == pytest.approx([0, 4, 0])
    assert found.overall["position"]["mean_mm"] == pytest.approx((1 + 1 + 3 + 5) / 4)
    assert found.history["position_mm"] == pytest.approx((1, 1, 3, 5))
    lengths = np.array([np.sqrt(100**2 + 3**2 + 1), np.sqrt(100**2 + 5**2 + 1)])
    assert found.distance["AD_mm"] == pytest.approx(lengths.mean() - 100)


def test_distance_pairs_the_cycles_that_both_have():
    rows = [("P2", 1, 0, 0, 0), ("P2", 2, 0, 0, 0), ("P2", 3, 0, 0, 0), ("P4", 3, 30, 0, 0), ("P4", 2, 10, 0, 0)]
    found = criteria(poses(rows), 10).distance
    assert found["n"] == 2
    assert found["RD_mm"] == pytest.approx(3 * np.std([10, 30], ddof=1))
    assert criteria(poses([*ROWS[:2], ("P2", 1, 0, 0, 0), ("P2", 9, 0, 0, 0)]), 10).distance is None


def test_distance_by_axis_and_angle():
    rows = [("P2", 1, 0, 0, 0), ("P2", 2, 0, 0, 0), ("P4", 1, 101, -1, 2), ("P4", 2, 103, -1, 1)]
    commanded = np.array([[0, 0, 0], [0, 0, 0], [100, 0, 1], [100, 0, 1]]) * 1e-3
    turns = np.radians([0.0, 0.0, 30.2, 30.4])
    rotation = np.array([frames.rot_z(turn) for turn in turns])
    meant = np.array([frames.rot_z(turn) for turn in np.radians([0.0, 0.0, 30.0, 30.0])])
    found = criteria(poses(rows, rotation=rotation, wanted=commanded, wanted_rotation=meant), 10).distance
    assert [found[f"AD_{a}_mm"] for a in "xyz"] == pytest.approx([2, 1, 0.5])
    assert [found[f"RD_{a}_mm"] for a in "xyz"] == pytest.approx([3 * np.sqrt(2), 0, 3 * np.sqrt(0.5)], abs=1e-9)
    assert [found[f"AD_{a}_deg"] for a in "abc"] == pytest.approx([0, 0, 0.3], abs=1e-9)
    assert [found[f"RD_{a}_deg"] for a in "abc"] == pytest.approx([0, 0, 3 * np.sqrt(0.02)], abs=1e-9)
    assert criteria(poses(rows), 10).distance["AD_x_mm"] is None


def test_orientations():
    turns = np.radians([0.1, 0.3, 0.0, 0.2])
    rotation = np.array([frames.rot_z(turn) for turn in turns])
    found = criteria(poses(ROWS, rotation=rotation), 10)
    assert found.poses["P4"]["RP_c_deg"] == pytest.approx(3 * np.std([0.1, 0.3], ddof=1))
    assert "AP_c_deg" not in found.poses["P4"]
    assert found.overall["orientation"]["max_deg"] == pytest.approx(0.1, abs=1e-9)
    wanted = {"wanted": np.zeros((4, 3)), "wanted_rotation": np.tile(np.eye(3), (4, 1, 1))}
    found = criteria(poses(ROWS, rotation=rotation, **wanted), 10)
    assert found.poses["P4"]["AP_c_deg"] == pytest.approx(0.2)
    assert found.overall["orientation"]["max_deg"] == pytest.approx(0.3, abs=1e-9)
    assert found.history["orientation_deg"] == pytest.approx((0.1, 0.3, 0.0, 0.2), abs=1e-9)


def test_directions():
    ways = ["x", "y", "x", "y"]
    found = criteria(poses(ROWS, direction=ways), 10)
    assert (found.poses, found.overall) == ({}, None)
    along = [found.directions["P4"][f"vAP_{axis}_mm"] for axis in "xyz"]
    assert (found.directions["P4"]["directions"], found.directions["P4"]["vAP_mm"]) == (2, pytest.approx(2.0))
    assert np.linalg.norm(along) == pytest.approx(2.0)
    assert along == pytest.approx([0, 0, 2])
    with pytest.raises(MeasurementError, match=r"poses.csv: column direction: pose P2 was approached from x only"):
        criteria(poses(ROWS, direction=["x", "y", "x", "x"]), 10)


def test_drift_sets_with_lost_cycles_and_times():
    cycles = [1, 2, 3, 5, 6, 7, 8, 9]  # the fourth is lost, the last set of four unfinished
    rows = [("P1", c, 0.01 * c, 0, 0) for c in cycles]
    found = criteria(poses(rows, group=["iso9283_drift"] * 8, time=[str(60 * c) for c in cycles]), 4).drift
    assert found["n"] == (3, 4)
    assert found["time_s"] == pytest.approx((120, 390))
    assert found["shift_mm"] == pytest.approx((0, 0.045))
    assert found["dRP_mm"] == pytest.approx(found["RP_mm"][1] - found["RP_mm"][0])
    assert "AP_mm" not in found
    with pytest.raises(MeasurementError, match="has 8 cycles of P1: drift needs two sets of 10"):
        criteria(poses(rows, group=["iso9283_drift"] * 8), 10)


def test_groups_keep_other_rows_out():
    rows = [*ROWS, ("P2", 3, 0, 99, 0)]
    found = criteria(poses(rows, group=["iso9283"] * 4 + ["other"]), 10)
    assert found.poses["P2"]["n"] == 2
    with pytest.raises(MeasurementError, match="no usable row of the groups iso9283 and iso9283_drift"):
        criteria(poses([("P1", 1, 0, 0, 0)], group=["iso9283"]).select(np.array([False])), 10)
    with pytest.raises(MeasurementError, match="pose P1 was measured in one cycle only"):
        criteria(poses([("P1", 1, 0, 0, 0)]), 10)
