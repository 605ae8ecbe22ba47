import numpy as np
import pandas as pd
import pytest

from irbcal.errors import OptionError
from irbcal.validation.ballbar_check import ballbar, by_joints, circle, predict, tool_frame, trace_of_points

TOOL, BAR = (0.0, 0.065, 0.149), 0.15
JOINTS = np.radians([10.0, 0, 0, 0, 90, 0])
TILT = np.radians(0.02)


def readings(record, offset):
    """What a ballbar shows of the calibrated robot with offsets of its joints: the oracle walks the circle with both."""
    nominal = record.arm(calibrated=False)
    path = circle(nominal, JOINTS, BAR, tool_frame(TOOL))
    robot = record.robot_calibrated()
    q = predict(path, robot, nominal, JOINTS, 0, tool_frame(TOOL)).q
    points = (robot.poses(q + offset) @ tool_frame(TOOL))[:, :3, 3]
    noise = 1e-6 * np.random.default_rng(0).standard_normal(len(q))
    trace = trace_of_points(path, points)
    return pd.DataFrame({"angle_deg": np.degrees(trace.angle), "error_mm": (trace.error + noise) * 1e3}), path, robot, q


def test_derivatives_are_those_of_central_differences(record):
    _, path, robot, q = readings(record, 0.0)
    angle = np.linspace(0, 2 * np.pi, 50, endpoint=False)
    J = by_joints(path, robot, q, tool_frame(TOOL), angle)
    for j in (1, 2, 4):
        ends = []
        for h in (1e-4, -1e-4):
            step = np.zeros(6)
            step[j] = h
            trace = trace_of_points(path, (robot.poses(q + step) @ tool_frame(TOOL))[:, :3, 3])
            ends.append(trace.at(angle))
        slope = (ends[0] - ends[1]) / 2e-4
        assert np.abs((slope - slope.mean()) - (J[:, j] - J[:, j].mean())).max() < 0.05 * np.abs(J[:, j]).max()


def test_a_joint_that_lost_its_zero_is_found(record, tmp_path):
    offset = np.zeros(6)
    offset[2] = TILT
    old, new = (readings(record, step)[0] for step in (np.zeros(6), offset))
    found = ballbar(record, new, tool=TOOL, joints=JOINTS, arcs=0, baseline=old)
    change = found.since["measured"]
    assert change.before > 5e-6
    assert change.after < 0.3 * change.before
    values = np.array([item.value for item in change.offsets])
    std = np.array([item.std for item in change.offsets])
    assert (np.abs(values - offset) < 3 * std).all()
    assert "Since the baseline it has changed by" in found.summary()
    assert found.to_dict()["measured"]["measured"]["since_baseline"]["rms_mm"] == pytest.approx(change.before * 1e3)
    same = ballbar(record, old, tool=TOOL, joints=JOINTS, arcs=0, baseline=old).since["measured"]
    assert same.before < 1e-12
    assert not any(item.clear for item in same.offsets)


def test_a_baseline_needs_readings_of_the_same_runs(record):
    old = readings(record, 0.0)[0]
    with pytest.raises(OptionError, match="name its file, too"):
        ballbar(record, tool=TOOL, joints=JOINTS, baseline=old)
    with pytest.raises(OptionError, match="the baseline has other runs"):
        ballbar(record, old, tool=TOOL, joints=JOINTS, baseline=old.assign(run="a"))
