"""Ready measurements keep the way back to the file's columns."""

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from iso9283_files import CYCLES, cycles, write
from support import arm, random_robot

import irbcal
from irbcal.errors import MeasurementError
from irbcal.io import robots
from irbcal.measurement.table import read
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
    return prepare(read(path))


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


def test_notes_name_poses_as_the_file_does(ready):
    rows = ready.measurements.to_frame()
    third = rows.index[rows["pose"] == "P3"][:3]
    assert list(rows.loc[third, "target"]) == ["smr1", "smr2", "smr3"]
    rows.loc[third, "target"] = ["smr2", "smr1", "smr3"]
    notes = prepare(read(rows)).notes
    assert any("smr1 and smr2 are swapped in pose P3: correct" in note for note in notes)


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
    ready = prepare(read(write(tmp_path / "iso.csv", more, q, T, ("smr1", "smr9"))), record)
    assert set(ready.points.names()) == {"smr1"}
    assert {item.target for item in ready.excluded} == {"smr9"}


@settings(max_examples=100)
@given(st.lists(st.lists(st.sampled_from([0.0, -0.0, 1.0, -1.0, 0.1, 1e-300]), min_size=3, max_size=3), max_size=12))
def test_rows_that_may_be_copies_are_those_that_are(rows):
    array = np.array(rows).reshape(-1, 3)
    _, group, count = np.unique(array, axis=0, return_inverse=True, return_counts=True)
    assert cleaned_points._alike(array).tolist() == np.flatnonzero(count[group.ravel()] > 1).tolist()


@pytest.fixture(scope="module")
def table():
    frame = pd.read_csv(robots.demo_file("demo_identification.csv"))
    first = frame["pose"].drop_duplicates().head(90)
    return frame[frame["pose"].isin(first)]


def halves(frame):
    poses = frame["pose"].drop_duplicates().to_numpy()
    return frame[frame["pose"].isin(poses[:60])], frame[frame["pose"].isin(poses[60:])]


@pytest.fixture(scope="module")
def made(table):
    one, two = halves(table)
    return irbcal.calibrate(one, "irb1600", "26", verify=two)


def test_verification_data_are_not_said_to_be_fitted(made, table):
    """The file that proved it is no training file, though the calibration knows it."""
    found = irbcal.evaluate(made, halves(table)[1])
    assert found.calibrated["n"] == made.record.heldout.all.n
    assert not any("fitted" in note for note in found.notes)


def test_training_data_prove_nothing(made, table):
    one, _ = halves(table)
    with pytest.raises(MeasurementError, match=r"all \d+ poses were fitted by this calibration"):
        irbcal.evaluate(made, one)
    renamed = one.assign(pose="again " + one["pose"].astype(str)).iloc[::-1]
    with pytest.raises(MeasurementError, match="they prove nothing"):
        irbcal.evaluate(made, renamed)
    assert irbcal.evaluate(made, one, include_fitted=True).calibrated["n"] == len(made.validated.fit_points)


def test_of_a_mixed_file_the_rest_counts(made, table):
    found = irbcal.evaluate(made, table)
    assert found.calibrated["n"] == made.record.heldout.all.n
    assert any("and are left out" in note for note in found.notes)


def test_verify_with_fitted_poses_is_refused_or_left_out(table):
    one, two = halves(table)
    with pytest.raises(MeasurementError, match=r"all \d+ poses are at joints of fitted poses"):
        irbcal.calibrate(one, "irb1600", "26", verify=one)
    moved = one.assign(x_mm=one["x_mm"] + 0.03)  # measured anew at the same joints: still the same errors of the robot
    with pytest.raises(MeasurementError, match="so they prove nothing"):
        irbcal.calibrate(one, "irb1600", "26", verify=moved)
    mixed = irbcal.calibrate(one, "irb1600", "26", verify=table)
    assert two["pose"].nunique() - 5 <= mixed.record.poses_heldout <= two["pose"].nunique()
    assert any("poses are at joints of fitted poses" in note for note in mixed.record.notes)


def test_a_load_that_was_never_fitted_is_called_so(made, table):
    one, _ = halves(table)
    fitted = irbcal.calibrate(one.assign(payload_kg=1.0), "irb1600", "26")
    loaded = irbcal.evaluate(fitted, one.assign(payload_kg=7.0), tolerance=5e-3, same_tool=True)
    assert "at fitted joints with a load that was never fitted" in loaded.verdict.statement
    assert loaded.conformity.outcome == "not proven"
    assert "that were fitted" not in loaded.verdict.statement


def test_nothing_held_out_is_a_reason_in_the_file(table):
    made = irbcal.calibrate(halves(table)[0], "irb1600", "26", holdout=0)
    assert not made.verdict.trusted
    assert any("no proof of accuracy" in doubt for doubt in made.verdict.doubts)
    assert made.record.doubts == list(made.verdict.doubts)


@pytest.fixture(scope="module")
def rows():
    table = pd.read_csv(robots.demo_file("demo_verification.csv"))
    return table[(table["pose"] <= 40) & ~table["target"].str.startswith("ref")]


def test_points_from_elsewhere_are_refused(record, rows):
    with pytest.raises(MeasurementError, match="not measured in its frame"):
        irbcal.evaluate(record, rows.assign(x_mm=rows["x_mm"] + 3000.0, y_mm=rows["y_mm"] * 0.7))


def test_larger_errors_than_ever_are_doubted(record, rows):
    xyz, noisy = ["x_mm", "y_mm", "z_mm"], rows.copy()
    noisy[xyz] += np.random.default_rng(2).normal(0, 1.5, (len(rows), 3))
    found = irbcal.evaluate(record, noisy)
    assert any("something has changed since" in doubt for doubt in found.verdict.doubts)
    assert not any("something has changed since" in doubt for doubt in irbcal.evaluate(record, rows).verdict.doubts)
