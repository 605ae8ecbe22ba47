"""Robots and points come back from calibration.json."""

import numpy as np

import irbcal


def test_nominal_robot_comes_back_too(outcome, folder):
    q = outcome.urdf.arm.random_joints(50, 5)
    found = irbcal.load(folder).robot_nominal().points(q, "smr1")
    assert np.abs(found - outcome.nominal.robot.points(q, "smr1")).max() < 1e-9


def test_a_record_and_its_parts_are_printed_short(folder):
    record = irbcal.load(folder).record
    assert repr(record) == str(record)
    assert repr(record).startswith(f"<Record of {record.robot.name}: ")
    for part in (record, record.points, record.poses, record.robot, record.joint_map, record.observability, record.fit):
        assert 10 < len(repr(part)) < 1000
        assert "\n" not in repr(part)
    assert f"n={record.fit.all.n}" in repr(record.fit.all)
