"""Pass, fail or not proven: by hand-made errors with known statistics."""

import numpy as np
import pytest

import irbcal
from irbcal.errors import OptionError
from irbcal.io import robots
from irbcal.measurement.statistics import statistics
from irbcal.units import MM
from irbcal.validation import accuracy
from irbcal.validation.conformity import check_options, conformity, expanded_uncertainty, upper_bound
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
    return conformity(
        values,
        errors,
        place,
        found,
        tolerance_mm * MM,
        rule,
        poses=len(np.unique(place)),
        tracker=(tracker, "as stated"),
    )


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
    kept = conformity(values, ERRORS, PLACE, found, 2 * MM, poses=200)
    assert kept.outcome == "not proven"
    assert any(words in reason for reason in kept.against)


@pytest.mark.parametrize(
    ("tolerance", "rule", "words"),
    [
        (0.5, None, "half a millimetre is 0.0005"),
        (0.0, None, "above 0"),
        (-1e-3, None, "tolerance"),
        (float("nan"), None, "tolerance"),
        (1e-3, "mean", "rule"),
        (None, "max", "only a tolerance"),
    ],
)
def test_options_are_checked(tolerance, rule, words):
    with pytest.raises(OptionError, match=words):
        check_options(tolerance, rule)


@pytest.mark.parametrize(("tolerance", "tracker"), [(None, 1e-5), (1e-3, -1e-5), (1e-3, 0.5), (1e-3, float("nan"))])
def test_the_uncertainty_of_the_tracker_is_checked(tolerance, tracker):
    with pytest.raises(OptionError, match="tracker_u95"):
        check_options(tolerance, None, tracker)


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
