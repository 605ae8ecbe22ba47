"""The region of proof poses: what they cover of the calibrated ranges, and that a corner is no proof of the rest."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import irbcal
from irbcal.io import robots
from irbcal.reports import certificate
from irbcal.units import DEG, MM
from irbcal.validation.conformity import region

PROOF = robots.demo_file("demo_verification.csv")
JOINTS = [f"q{k}_deg" for k in range(1, 7)]


@pytest.fixture(scope="module")
def fit(record):
    return record.used_points(heldout=False)[0]


def test_an_even_share_of_each_range_is_that_share(record, fit):
    robot = record.robot_calibrated()
    low, high = fit.q.min(axis=0), fit.q.max(axis=0)
    even = np.random.default_rng(3).permuted(np.tile(np.linspace(0.0, 1.0, fit.poses)[:, None], 6), axis=0)
    for share in (1.0, 0.5, 0.2):
        covered = region(robot, replace(fit, q=low + share * even * (high - low)), fit)
        np.testing.assert_allclose(covered.joint_shares, share, atol=0.02)
        np.testing.assert_allclose(covered.joints, np.array([low, low + share * (high - low)]) / DEG, atol=1e-9)
        assert covered.whole == (share == 1.0)


def test_one_pose_far_away_does_not_widen_a_corner(record, fit):
    q = np.tile(fit.q[0], (fit.poses, 1)) + np.random.default_rng(1).uniform(-0.05, 0.05, fit.q.shape)
    q[0], q[1] = fit.q.min(axis=0), fit.q.max(axis=0)
    covered = region(record.robot_calibrated(), replace(fit, q=q), fit)
    assert (covered.joint_shares < 0.6).all()


def test_unknown_fitted_points_prove_no_region(record, fit):
    covered = region(record.robot_calibrated(), fit, None)
    assert not covered.whole
    assert "not known" in covered.narrow_in_words()


@pytest.fixture(scope="module")
def corner():
    """Poses of the verification on one side: joints 1 and 2 in less than half of their ranges."""
    table = pd.read_csv(PROOF)
    first = table.groupby("pose")[JOINTS].first()
    names = first.index[(first["q1_deg"] > 20) & (first["q2_deg"] > 10)]
    return table[table["pose"].isin(names)]


def test_a_proof_in_a_corner_is_none_of_the_rest(record, corner):
    judged = irbcal.evaluate(record, corner, tolerance=2 * MM)
    assert judged.conformity.outcome == "not proven"
    (against,) = judged.conformity.against
    assert "beyond the region" in against
    assert "of joint_1" in against
    assert "of joint_4" not in against
    only = irbcal.evaluate(record, corner, tolerance=2 * MM, region_only=True)
    assert only.conformity.outcome == "pass"
    assert "region of these poses only" in only.conformity.sentence()
    page = certificate.render(only)
    assert "for this region only" in page
    assert only.region.joints_in_words() in page
    assert only.region.box_in_words() in page
    assert only.to_dict()["region"]["whole"] is False


@pytest.mark.parametrize(
    "again",
    [
        lambda q, rng: q + rng.uniform(0.01, 1.15, q.shape) * rng.choice([-1, 1], q.shape),
        lambda q, rng: q + np.where(np.arange(6) == 5, 360.0, 0.0),
    ],
    ids=["moved by 0.01 to 1.15 degrees", "joint 6 by a full turn"],
)
def test_fitted_poses_in_disguise_are_refused(record, again):
    table = pd.read_csv(robots.demo_file("demo_identification.csv"))
    known = {name for name, heldout in zip(record.poses.pose, record.poses.heldout, strict=True) if not heldout}
    table = table[table["pose"].astype(str).isin(known)].copy()
    poses = table.groupby("pose")[JOINTS].transform("first").to_numpy()
    moves = table.groupby("pose").ngroup().to_numpy()
    table[JOINTS] = again(poses[np.unique(moves, return_index=True)[1]], np.random.default_rng(0))[moves]
    with pytest.raises(irbcal.IrbcalError, match="prove nothing"):
        irbcal.evaluate(record, table, tolerance=2 * MM)
