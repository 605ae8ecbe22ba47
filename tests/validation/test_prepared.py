"""Ready measurements keep the way back to the file's columns."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from iso9283_files import CYCLES, cycles, write
from support import arm, random_robot

from irbcal.measurement import table
from irbcal.validation import cleaned_points
from irbcal.validation.cleaned_points import prepare


@pytest.fixture(scope="module")
def ready(tmp_path_factory):
    robot = random_robot(arm(), "11", np.random.default_rng(0))
    q, T, *_ = cycles(robot)
    extra = [[(100 * p + c, 0.5 * c) for c in range(CYCLES)] for p in range(5)]
    path = write(tmp_path_factory.mktemp("ready") / "iso.csv", robot, q, T, extra=extra, columns=["mark", "time_s"])
    lines = path.read_text().splitlines()
    # the first pose of the second cycle is lost as a whole, one point of the next
    for k in (16, 17, 18, 19):
        cells = lines[k].split(",")
        cells[10:13] = ["0", "0", "0"]
        lines[k] = ",".join(cells)
    path.write_text("\n".join(lines))
    return prepare(table.read(path))


def test_cycles_stay_apart(ready):
    assert ready.points.poses == 5 * CYCLES - 1
    assert ready.points.pose_ids[:7].tolist() == ["P1", "P2", "P3", "P4", "P5", "P2", "P3"]
    assert ready.number[:7].tolist() == [0, 1, 2, 3, 4, 6, 7]
    assert ready.labels("mark")[:7].tolist() == ["0", "100", "200", "300", "400", "101", "201"]
    assert ready.labels("time_s")[4:6].tolist() == ["0", "0.5"]
    assert set(ready.labels("absent")) == {""}
    assert [(item.pose, item.target) for item in ready.excluded] == [
        *[("P1", f"smr{k}") for k in (1, 2, 3)],
        ("P2", "smr1"),
    ]


def test_kept_points_and_poses(ready):
    first = ready.keep(ready.points.target == 0)
    assert first.points.poses == 5 * CYCLES - 2, "P2 of the second cycle has lost it"
    assert first.labels("mark")[4:6].tolist() == ["400", "201"]
    fifth = ready.select(ready.points.pose_ids == "P5")
    assert fifth.points.poses == CYCLES
    assert fifth.labels("mark")[:2].tolist() == ["400", "401"]
    with pytest.raises(ValueError, match="read-only"):
        ready.number[0] = 3


def test_targets_of_the_calibration(record, tmp_path):
    robot = record.robot_calibrated()
    q, T, *_ = cycles(robot)
    more = robot.replace(targets={**robot.targets, "smr9": np.array([0.1, 0.0, 0.1])})
    ready = prepare(table.read(write(tmp_path / "iso.csv", more, q, T, ("smr1", "smr9"))), record)
    assert set(ready.points.names()) == {"smr1"}
    assert {item.target for item in ready.excluded} == {"smr9"}


@settings(max_examples=100)
@given(st.lists(st.lists(st.sampled_from([0.0, -0.0, 1.0, -1.0, 0.1, 1e-300]), min_size=3, max_size=3), max_size=12))
def test_rows_that_may_be_copies_are_those_that_are(rows):
    array = np.array(rows).reshape(-1, 3)
    _, group, count = np.unique(array, axis=0, return_inverse=True, return_counts=True)
    assert cleaned_points._alike(array).tolist() == np.flatnonzero(count[group.ravel()] > 1).tolist()
