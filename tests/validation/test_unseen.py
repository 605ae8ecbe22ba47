"""What the fit has seen is no proof: counted out, or refused where nothing is left."""

import pandas as pd
import pytest

import irbcal
from irbcal.errors import MeasurementError
from irbcal.io import robots


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
    assert irbcal.evaluate(made, one, include_fitted=True).calibrated["n"] == len(made.proven.fit_points)


def test_of_a_mixed_file_the_rest_counts(made, table):
    found = irbcal.evaluate(made, table)
    assert found.calibrated["n"] == made.record.heldout.all.n
    assert any("and are counted out" in note for note in found.notes)


def test_verify_with_fitted_poses_is_refused_or_counted_out(table):
    one, two = halves(table)
    with pytest.raises(MeasurementError, match=r"all \d+ poses are at joints that are fitted"):
        irbcal.calibrate(one, "irb1600", "26", verify=one)
    moved = one.assign(x_mm=one["x_mm"] + 0.03)  # measured anew at the same joints: still the same errors of the robot
    with pytest.raises(MeasurementError, match="so they prove nothing"):
        irbcal.calibrate(one, "irb1600", "26", verify=moved)
    mixed = irbcal.calibrate(one, "irb1600", "26", verify=table)
    assert two["pose"].nunique() - 5 <= mixed.record.poses_heldout <= two["pose"].nunique()
    assert any("poses are at joints that are fitted" in note for note in mixed.record.notes)


def test_a_load_that_was_never_fitted_is_called_so(made, table):
    one, _ = halves(table)
    fitted = irbcal.calibrate(one.assign(payload_kg=1.0), "irb1600", "26")
    loaded = irbcal.evaluate(fitted, one.assign(payload_kg=7.0), tolerance=5e-3, same_tool=True)
    assert "at fitted joints with a load that was never fitted" in loaded.verdict.words
    assert loaded.conformity.outcome == "not proven"
    assert "that were fitted" not in loaded.verdict.words


def test_nothing_held_out_is_a_reason_in_the_file(table):
    made = irbcal.calibrate(halves(table)[0], "irb1600", "26", holdout=0)
    assert not made.verdict.trusted
    assert any("no proof of accuracy" in doubt for doubt in made.verdict.doubts)
    assert made.record.doubts == list(made.verdict.doubts)
