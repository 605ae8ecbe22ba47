"""Marks say whose calibration a folder is, and are not believed when damaged."""

from dataclasses import replace

import pytest

from irbcal.fleet import manifest, outcomes


def test_a_mark_comes_back(calibrated):
    robot = calibrated.robots[0]
    assert outcomes.read_mark(calibrated.out / "R0") == robot


@pytest.mark.parametrize("damage", [b"", b"[]", b"{}", b'{"irbcal": 1, "colour": "red"}', b"\xff"])
def test_a_damaged_mark_is_none(tmp_path, damage):
    (tmp_path / outcomes.MARK).write_bytes(damage)
    assert outcomes.read_mark(tmp_path) is None


def test_a_robot_is_done_only_with_its_own_files(listed, calibrated, tmp_path):
    entry = manifest.read(listed)[0]
    assert outcomes.done(entry, calibrated.out / "R0") == calibrated.robots[0]
    assert outcomes.done(replace(entry, serial="other"), calibrated.out / "R0") is None
    assert outcomes.done(replace(entry, measurements="none.csv"), calibrated.out / "R0") is None
    (tmp_path / outcomes.MARK).write_bytes(replace(calibrated.robots[0], failed=True).mark())
    assert outcomes.done(entry, tmp_path) is None
