"""The verdict in words: no number that looks good may hide that a calibration is none."""

import numpy as np
import pytest

from irbcal.measurement.cleaning import Exclusion
from irbcal.validation.verdict import rejected_count, verdict

POSE = np.repeat(np.arange(40), 3)


def errors(mean, seed):
    return np.random.default_rng(seed).gamma(4.0, mean / 4.0, len(POSE))


@pytest.mark.parametrize(
    ("nominal", "calibrated", "outcome"), [(1.0, 0.3, "better"), (0.96, 2.2, "worse"), (0.5, 0.5, "no better")]
)
def test_outcomes(nominal, calibrated, outcome):
    found = verdict(errors(nominal, 1), errors(calibrated, 2), POSE)
    assert found.outcome == outcome
    assert bool(found) is (outcome == "better")
    assert ("WORSE" in found.statement) is (outcome == "worse")
    assert ("NOT SIGNIFICANTLY BETTER" in found.statement) is (outcome == "no better")


def test_points_of_one_pose_are_no_poses_of_their_own():
    """One pose, however many points, shows nothing beyond chance."""
    found = verdict(np.full(300, 1.0), np.full(300, 0.1), np.zeros(300))
    assert found.outcome == "no better"
    assert "on 1 pose that" in found.statement


def test_what_was_left_out_is_part_of_it():
    good = verdict(errors(1.0, 1), errors(0.3, 2), POSE, left_out=20)
    assert good
    assert "left out" not in good.statement
    most = verdict(errors(1.0, 1), errors(0.3, 2), POSE, left_out=180)
    assert most.outcome == "better"
    assert not most
    assert "60% of the points were left out" in most.statement
    assert any("60%" in doubt for doubt in most.doubts)


def test_fitted_poses_prove_nothing():
    found = verdict(errors(1.0, 1), errors(0.3, 2), POSE, proven=False)
    assert not found
    assert "which proves nothing" in found.statement
    assert any("no proof" in doubt for doubt in found.doubts)


def test_doubts_are_part_of_it():
    found = verdict(errors(1.0, 1), errors(0.3, 2), POSE, doubts=["The tracker moved."])
    assert found.outcome == "better"
    assert not found
    assert found.sentence().startswith("NOT TO BE TRUSTED, though better than")
    head, doubt = found.report()
    assert doubt == "Doubt: The tracker moved."
    assert head.good is doubt.good is False
    assert verdict(errors(1.0, 1), errors(0.3, 2), POSE).report()[0].good is True
    assert found.to_dict()["doubts"] == ["The tracker moved."]


def test_the_nominal_robot_is_no_better_than_itself():
    same = errors(1.0, 1)
    found = verdict(same, same, POSE)
    assert not found
    assert found.statement.startswith("the nominal robot itself")


def test_lost_points_were_never_there_to_be_used():
    reasons = ("lost: no position", "target unknown to the calibration", "outlier: 9 mm", "swapped: this is smr2")
    assert rejected_count([Exclusion(pose="1", target="smr1", reason=reason) for reason in reasons]) == 2


@pytest.mark.parametrize("spread", [0.02, 3.0])
def test_poses_of_one_point_are_judged_alike_by_number_and_by_name(spread):
    rng = np.random.default_rng(4)
    nominal, calibrated = 1.0 + spread * rng.random((2, 300))
    by_number, by_name = (
        verdict(nominal, calibrated, labels) for labels in (np.arange(300), [f"p{k:03}" for k in range(300)])
    )
    assert by_number == by_name
