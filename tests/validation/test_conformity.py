"""Whether a tolerance is kept, and in which region."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binom

import irbcal
from irbcal.error_statistics import statistics
from irbcal.errors import OptionError
from irbcal.io import robots
from irbcal.modeling import frames
from irbcal.reports import certificate
from irbcal.units import DEG, MM
from irbcal.validation import accuracy
from irbcal.validation.conformity import Requirement, conformity, expanded_uncertainty, region, requirement, upper_bound
from irbcal.validation.verdict import verdict

RNG = np.random.default_rng(5)
ERRORS = np.abs(RNG.normal(0.3, 0.05, 200)) * MM
PLACE = np.arange(200)
U95_MM = 0.04


def judged(
    tolerance_mm, rule="mean3sigma", errors=ERRORS, place=PLACE, proven=True, tracker=U95_MM * MM, **verdict_options
):
    found = verdict(errors / MM + 0.5, errors / MM, place, proven=proven, **verdict_options)
    values = {**statistics(errors), **accuracy.percentiles(errors)}
    required = Requirement(tolerance_mm * MM, rule, tracker)
    return conformity(required, values, errors, place, found, poses=len(np.unique(place)))


@pytest.mark.parametrize(
    ("rule", "value"),
    [
        ("mean3sigma", (ERRORS.mean() + 3 * ERRORS.std(ddof=1)) / MM),
        ("max", ERRORS.max() / MM),
        ("percentile", np.percentile(ERRORS, 95) / MM),
    ],
)
def test_a_pass_needs_the_upper_bound_and_the_tracker_within_the_tolerance(rule, value):
    upper = upper_bound(rule, value * MM, ERRORS, PLACE)[0] / MM
    assert upper > value
    for tolerance, outcome in (
        (value - 1e-6, "fail"),
        (value + 1e-6, "not proven"),
        (upper + U95_MM - 1e-6, "not proven"),
        (upper + U95_MM + 1e-6, "pass"),
    ):
        found = judged(tolerance, rule)
        assert found.outcome == outcome
        assert bool(found) == (outcome == "pass")
        assert found.value_mm == pytest.approx(value, abs=1e-9)
        assert found.upper_mm == pytest.approx(upper, abs=1e-9)
        assert any("may be larger" in words for words in found.against) == (outcome == "not proven")
        for number in (value, upper, upper + U95_MM):
            assert f"{number:.3f} mm" in found.sentence()


@pytest.mark.parametrize(
    ("declared", "stated", "u95_mm", "source"),
    [
        ([0.02, 0.03, np.nan], None, 0.03, "u95_mm"),
        ([0.02, 0.03, np.nan], 0.0, 0.0, "stated"),
        (None, 0.07, 0.07, "stated"),
        ([np.nan] * 3, None, 0.05, "assumed"),
        (None, None, 0.05, "assumed"),
    ],
)
def test_where_the_uncertainty_of_the_tracker_comes_from(declared, stated, u95_mm, source):
    declared = None if declared is None else np.array(declared) * MM
    value, words = expanded_uncertainty(declared, None if stated is None else stated * MM)
    assert value == pytest.approx(u95_mm * MM)
    assert source in words


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"doubts": ["The tracker was moved."]}, "tracker was moved"),
        ({"proven": False}, "no proof of accuracy"),
        ({"left_out": 100}, "were left out"),
        ({"errors": ERRORS[:27], "place": np.arange(27) // 3}, "9 places are too few"),
    ],
)
def test_what_is_not_to_be_trusted_is_no_pass(options, words):
    found = judged(2.0, **options)
    assert found.outcome == "not proven"
    assert not found
    assert any(words in reason for reason in found.against)
    assert judged(0.1, **options).outcome == "fail", "beyond the tolerance is a fail whatever else is said"


@pytest.mark.parametrize(("offset", "words"), [(0.0, "no better"), (0.2, "WORSE")])
def test_a_calibration_that_does_not_serve_is_no_pass(offset, words):
    other = ERRORS / MM - offset + RNG.normal(0, 0.01, 200)
    found = verdict(other, ERRORS / MM, PLACE)
    values = {**statistics(ERRORS), **accuracy.percentiles(ERRORS)}
    kept = conformity(Requirement(2 * MM), values, ERRORS, PLACE, found, poses=200)
    assert kept.outcome == "not proven"
    assert any(words in reason for reason in kept.against)


@pytest.mark.parametrize(
    ("tolerance", "rule", "words"),
    [
        (0.5, None, "half a millimetre is 0.0005"),
        (0.0, None, "from 1e-06 to 0.1"),
        (-1e-3, None, "tolerance"),
        (float("nan"), None, "tolerance"),
        (1e-3, "mean", "rule"),
        (None, "max", "only a tolerance"),
    ],
)
def test_options_are_checked(tolerance, rule, words):
    with pytest.raises(OptionError, match=words):
        requirement(tolerance, rule)


@pytest.mark.parametrize(("tolerance", "tracker"), [(None, 1e-5), (1e-3, -1e-5), (1e-3, 0.5), (1e-3, float("nan"))])
def test_the_uncertainty_of_the_tracker_is_checked(tolerance, tracker):
    with pytest.raises(OptionError, match="tracker_u95"):
        requirement(tolerance, None, tracker)


def test_an_evaluation_judges_by_a_tolerance(record):
    proof = robots.demo_file("demo_verification.csv")
    found = irbcal.evaluate(record, proof, tolerance=0.95 * MM)
    assert found.conformity.outcome == "pass"
    assert found.conformity.value_mm == pytest.approx(found.calibrated["mean_plus_3sigma_mm"], abs=1e-12)
    assert found.report()[0].startswith("Tolerance: PASS.")
    assert "SIMULATED" in found.report()[0]
    assert found.to_dict()["conformity"]["outcome"] == "pass"
    assert irbcal.evaluate(record, proof, tolerance=0.95 * MM, tracker_u95=0.3 * MM).conformity.outcome == "not proven"
    fitted = robots.demo_file("demo_identification.csv")
    seen = irbcal.evaluate(record, fitted, tolerance=0.1, rule="max", include_fitted=True)
    assert seen.conformity.outcome == "not proven"
    assert irbcal.evaluate(record, proof).conformity is None


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
        assert covered.complete == (share == 1.0)


def test_one_pose_far_away_does_not_widen_a_corner(record, fit):
    q = np.tile(fit.q[0], (fit.poses, 1)) + np.random.default_rng(1).uniform(-0.05, 0.05, fit.q.shape)
    q[0], q[1] = fit.q.min(axis=0), fit.q.max(axis=0)
    covered = region(record.robot_calibrated(), replace(fit, q=q), fit)
    assert (covered.joint_shares < 0.6).all()


def test_what_lies_beyond_the_fitted_points_covers_no_more_of_them(record, fit):
    """Proof points from the middle of the fitted box to far beyond it: half of each side."""
    robot = record.robot_calibrated()
    inside = frames.apply(frames.inverse(robot.T_world_base), fit.xyz)
    low, high = inside.min(axis=0), inside.max(axis=0)
    beyond = low + (high - low) * (0.5 + 1.5 * (inside - low) / (high - low))
    covered = region(robot, replace(fit, xyz=frames.apply(robot.T_world_base, beyond)), fit)
    np.testing.assert_allclose(covered.box_shares, 0.5, rtol=0, atol=1e-9)


def test_unknown_fitted_points_prove_no_region(record, fit):
    covered = region(record.robot_calibrated(), fit, None)
    assert not covered.complete
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
    assert only.to_dict()["region"]["complete"] is False


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


DRAWS = 400
SHAPES = {
    "Maxwell": lambda rng, size: np.linalg.norm(rng.standard_normal((*size, 3)), axis=-1),
    "exponential": lambda rng, size: rng.exponential(size=size),
    "Student": lambda rng, size: (
        np.linalg.norm(rng.standard_normal((*size, 3)), axis=-1) / np.sqrt(rng.chisquare(5, size) / 5)
    ),
    "by position": lambda rng, size: (
        0.1 * np.linalg.norm(rng.standard_normal((*size, 3)), axis=-1) + 0.3 + 0.7 * rng.random(size) ** 4
    ),
}
FIGURES = {
    "mean3sigma": lambda d: d.mean() + 3 * d.std(ddof=1),
    "max": np.max,
    "percentile": lambda d: np.percentile(d, 95),
}
TRUE = FIGURES | {"max": lambda d: np.percentile(d, 99)}


@pytest.mark.parametrize("n", [10, 100])
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("rule", FIGURES)
def test_a_robot_beyond_the_tolerance_passes_in_at_most_one_draw_of_twenty(rule, shape, n):
    rng = np.random.default_rng(4)
    tolerance = 0.95 * TRUE[rule](SHAPES[shape](rng, (400_000,)))
    draws = SHAPES[shape](rng, (DRAWS, n))
    passed = sum(upper_bound(rule, FIGURES[rule](d), d, np.arange(n))[0] <= tolerance for d in draws)
    assert passed <= binom.ppf(0.999, DRAWS, 0.05)


@pytest.mark.parametrize(("rule", "enough"), [("percentile", 59), ("max", 299)])
def test_enough_places_need_no_model(rule, enough):
    d = np.random.default_rng(1).random(enough)
    bound, basis = upper_bound(rule, FIGURES[rule](d), d, np.arange(enough))
    assert bound == d.max()
    assert "whatever the distribution" in basis
    bound, basis = upper_bound(rule, FIGURES[rule](d[:-1]), d[:-1], np.arange(enough - 1))
    assert bound > d[:-1].max()
    assert "exponential" in basis


def test_errors_of_one_place_count_once():
    d = np.random.default_rng(2).random(20)
    for rule, figure in FIGURES.items():
        alone = upper_bound(rule, figure(d), d, np.arange(20))[0]
        again = upper_bound(rule, figure(d), np.tile(d, 5), np.tile(np.arange(20), 5))[0]
        assert again == pytest.approx(alone, rel=1e-12)
