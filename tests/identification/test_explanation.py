"""What each family of terms explains, against robots whose families are known and against fits of its own."""

from dataclasses import replace

import numpy as np
import pytest
from evidence_cases import Truth

from irbcal.identification import explanation
from irbcal.identification.evidence import identify_evidence
from irbcal.identification.explanation import explain
from irbcal.measurement.points import distances
from irbcal.modeling.terms.gear import gear_terms
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term_map import TermMap
from irbcal.modeling.terms.warm_up import WarmUp

MM = 1e-3
NOISE = 1e-5


def measured(truth, poses, seed, noise=NOISE):
    """Points of random poses in an order, and their motion."""
    motion = Motion.in_order(truth.nominal.random_joints(poses, seed))
    points = truth.measured(motion, noise, seed)
    return replace(points, previous=motion.q - motion.moves), motion


def by_words(stages):
    return {stage.added.split(" (")[0]: stage for stage in stages}


@pytest.fixture(scope="module")
def weighed():
    """Gravity, gains and one gear, nothing else."""
    extra = [(term, 1.5e-4) for term in gear_terms(3, 202)]
    truth = Truth(["gravity", "gain"], extra=extra)
    points, motion = measured(truth, 120, 1)
    heldout, _ = measured(truth, 60, 2)
    return truth, identify_evidence(truth.nominal, points, motion), heldout


def test_the_families_that_are_there_explain_and_others_do_not(weighed):
    _, fit, heldout = weighed
    stages = explain(fit, heldout)
    found = by_words(stages)
    assert [stage.added for stage in stages] == [
        "geometry",
        "gravity, gain",
        "harmonics to 2",
        "direction, move",
        "gears (1)",
        "bending, wobble: terms all",
    ]
    assert found["geometry"].mean_mm > 3 * found["gravity, gain"].mean_mm
    assert found["harmonics to 2"].mean_mm == pytest.approx(found["gravity, gain"].mean_mm, rel=0.1)
    assert found["direction, move"].mean_mm == pytest.approx(found["gravity, gain"].mean_mm, rel=0.1)
    assert found["gears"].mean_mm < 0.6 * found["direction, move"].mean_mm
    assert found["bending, wobble: terms all"].mean_mm == pytest.approx(found["gears"].mean_mm, rel=0.2)
    assert found["gears"].mean_mm < 2.0 * NOISE / MM
    assert [stage.carried for stage in stages] == [True] * 5 + [False]
    assert all(stage.max_mm > stage.mean_mm for stage in stages)
    assert [stage.terms for stage in stages] == sorted(stage.terms for stage in stages)
    # poses of another run: nothing is known of how warm the arm was
    assert all(stage.timed_mean_mm is None for stage in stages)
    # leave-one-out and held-out errors tell the same; that is a root mean square
    for stage in stages[:2]:
        assert stage.leave_one_out_mm == pytest.approx(stage.mean_mm, rel=0.5)


def test_a_family_that_is_offered_with_no_other_has_a_stage(weighed, monkeypatch):
    _, fit, heldout = weighed
    whole = by_words(explain(fit, heldout))
    monkeypatch.setattr(explanation, "STAGES", [names for names in explanation.STAGES if "gravity" not in names])
    found = by_words(explain(fit, heldout))
    assert {"gravity", "gain"} <= set(found)
    assert found["gears"].terms == whole["gears"].terms
    assert found["gears"].mean_mm < 2.0 * NOISE / MM


def test_a_long_series_of_a_robot_with_a_type_prior_is_explained(weighed):
    _, fit, heldout = weighed
    row = fit.term_sets[0].model_copy(update={"name": "thesis, harmonics to 6; type prior", "weight": 1.0})
    assert "harmonics to 6" in by_words(explain(replace(fit, term_sets=[row]), heldout))


def test_the_last_stage_is_about_what_the_calibration_is(weighed):
    _, fit, heldout = weighed
    found = by_words(explain(fit, heldout))
    own = float(distances(fit.robot, heldout).mean()) / MM
    assert found["gears"].mean_mm == pytest.approx(own, abs=0.003)


def test_warmth_is_told_apart_from_use():
    """An arm that drifts: at the time of each pose the model is right, and the warm robot misses the cold poses."""
    truth = Truth(["gravity", "warm_up"], scale=1.0)
    motion = Motion.in_order(truth.nominal.random_joints(150, 3))
    points = replace(truth.measured(motion, NOISE, 3), previous=motion.q - motion.moves)
    aside = np.arange(150) % 5 == 2
    fit = identify_evidence(truth.nominal, points.select(~aside), motion.select(~aside))
    stages = explain(fit, points.select(aside), motion.elapsed[aside])
    last = by_words(stages)["warm-up"]
    assert last.timed_mean_mm < 3 * NOISE / MM
    assert last.mean_mm > 2 * last.timed_mean_mm
    assert all(stage.timed_mean_mm is None for stage in stages[: stages.index(last)])


def test_the_time_constant_of_the_warm_up_is_found():
    """A quarter of the measurement: evidence rises from half of it to there, and falls beyond."""
    truth, rng = Truth(["gravity"], scale=1.0), np.random.default_rng(5)
    motion = Motion.in_order(truth.nominal.random_joints(150, 3))
    span = float(np.ptp(motion.elapsed))
    warm = WarmUp(0.25 * span, span).terms(truth.nominal)
    values = [*truth.map.coefficients, *(term.size * rng.standard_normal() for term in warm)]
    truth.map = TermMap(truth.nominal, (*truth.map.terms, *warm), np.array(values))
    points = replace(truth.measured(motion, NOISE, 3), previous=motion.q - motion.moves)
    assert identify_evidence(truth.nominal, points, motion).average.warm_up_tau == pytest.approx(0.25 * span)


def test_nothing_held_out_leaves_the_poses_that_are_left_out_one_at_a_time(weighed):
    _, fit, heldout = weighed
    none = heldout.select(np.zeros(heldout.poses, dtype=bool))
    for stage, other in zip(explain(fit, none), explain(fit, heldout), strict=True):
        assert stage.mean_mm is None
        assert stage.max_mm is None
        assert stage.leave_one_out_mm == other.leave_one_out_mm


def test_targets_that_the_fit_never_saw_do_not_count(weighed):
    _, fit, heldout = weighed
    names = (*heldout.target_names[:-1], "another")
    fewer = explain(fit, replace(heldout, target_names=names))
    known = heldout.take(heldout.target != len(names) - 1)
    assert [stage.mean_mm for stage in fewer] == [stage.mean_mm for stage in explain(fit, known)]


def test_what_was_expected_of_a_group_and_what_was_found(weighed):
    """Root mean squares of the true coefficients are found, in natural sizes; what is not there shrinks."""
    truth, fit, *_ = weighed
    groups = {group.name: group for group in fit.average.groups}
    gain = groups["gain"]
    true = [c for term, c in zip(truth.map.terms, truth.map.coefficients, strict=True) if term.family == "gain"]
    assert gain.estimate == pytest.approx(float(np.sqrt(np.mean(np.square(true)))) / 5e-4, rel=0.15)
    assert gain.natural == {"1": 5e-4}
    assert gain.std < 0.3 * gain.size
    assert groups["geometry"].natural == {"deg": pytest.approx(np.degrees(1e-3)), "mm": 0.5}
    gear = groups["gear_4_202"]
    assert gear.family == "gear"
    assert gear.estimate * 5e-5 == pytest.approx(1.5e-4, rel=0.1)
    for name, group in groups.items():
        if group.family == "harmonics":
            assert group.estimate < 0.3, name


def test_the_scan_keeps_what_it_saw(weighed):
    _, fit, *_ = weighed
    seen = fit.average.spectrum
    chi2 = np.array(seen.chi2)
    joint, column = divmod(int(chi2.argmax()), chi2.shape[1])
    assert (seen.joints[joint], (202 - seen.first) // seen.step) == (4, column)
    (gear,) = fit.average.gears
    assert chi2.max() == round(gear.chi2, 1)
    assert gear.chi2 > seen.limit


def test_no_scan_no_spectrum(weighed):
    truth, *_ = weighed
    points, motion = measured(truth, 40, 5)
    assert identify_evidence(truth.nominal, points, motion, gear_scan=False).average.spectrum is None
