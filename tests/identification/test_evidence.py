"""Identification by evidence: simulated truth found again, and figures of real robots computed elsewhere."""

import pickle
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from evidence_cases import Measured, Truth, assert_documented, irb120, moves
from hypothesis import given, settings
from hypothesis import strategies as st
from support import TARGETS, arm, example_robot, measured, random_robot

from irbcal.errors import IdentificationError
from irbcal.identification import evidence, evidence_fit, leave_one_out, term_sets
from irbcal.identification.evidence import average_repeats, identify_evidence
from irbcal.identification.fit import identify
from irbcal.io import urdf
from irbcal.measurement import cleaning, table
from irbcal.measurement.points import PointSet, distances
from irbcal.modeling.terms.harmonics import pair
from irbcal.modeling.terms.payload import Payload
from irbcal.modeling.terms.situation import Motion
from irbcal.validation.accuracy import coverage

# --- simulated truth ----------------------------------------------------------------------------------------


def test_simulated_terms_are_found_again():
    truth = Truth(["gain", "gravity", "harmonics", "direction"])
    motion = replace(moves(truth.nominal, 150, 3), elapsed=None)
    found = identify_evidence(truth.nominal, truth.measured(motion, 2e-5), motion, gear_scan=False)
    true = dict(zip([t.name for t in truth.map.terms], truth.map.coefficients, strict=True)) | truth.constants
    error = np.array([c - true.get(t.name, 0.0) for t, c in zip(found.terms, found.coefficients, strict=True)])
    off = np.abs(error / found.std)
    assert (off < 3.0).mean() > 0.985
    assert off.max() < 5.0
    named = {t.name: s for t, s in zip(found.terms, found.std, strict=True)}
    # large ones are known much better than by their prior
    assert named["rz2 direction 0.00872665"] < 0.1 * 1e-4
    assert found.average.sigma_mm == pytest.approx(2e-2, rel=0.25)
    # and what it says of other poses holds: the truth is within the interval of the parameters alone
    test = Motion.in_order(truth.nominal.random_joints(100, 9))
    seen = found.robot.predict(test.q, test.q - test.moves, "smr2")
    error = seen.position - truth.points(replace(test, elapsed=None), "smr2")
    assert np.linalg.norm(error, axis=1).mean() < 2.5e-5
    spread = np.sqrt(np.diagonal(seen.covariance, axis1=1, axis2=2))
    assert 0.8 < np.mean(np.abs(error) < 1.96 * spread) <= 1.0
    assert np.mean(np.abs(error) < seen.interval) > 0.99


def test_harmonics_beyond_the_long_series_join_where_they_are(monkeypatch):
    """SIMULATED waves of 5 to 65 cycles per turn of two joints: the longer series has the weight, and halves errors."""
    monkeypatch.setattr(evidence, "LONGEST", 70)
    rng = np.random.default_rng(0)
    waves = [t for j in range(2) for k in range(5, 66) for t in pair(j, k, "rz", 2e-4, "harmonics", "harmonics")]
    truth = Truth([], extra=[(t, 4e-5 * rng.standard_normal()) for t in waves])
    motion, test = Motion(truth.nominal.random_joints(180, 3)), Motion(truth.nominal.random_joints(200, 9))
    points, errors = truth.measured(motion, 2e-5), []
    for poses in (180, 181):  # from which the longer series is tried
        monkeypatch.setattr(evidence, "FEWEST_FOR_LONGEST", poses)
        found = identify_evidence(truth.nominal, points, motion, gear_scan=False)
        top = max(found.term_sets, key=lambda row: row.weight)
        assert top.name.endswith("harmonics to 70" if poses == 180 else "harmonics to 45")
        predicted = found.robot.predict(test.q, None, "smr2").position
        errors.append(np.linalg.norm(predicted - truth.points(test, "smr2"), axis=1).mean())
    assert errors[0] < 1e-4
    assert errors[0] < 0.5 * errors[1]


@pytest.fixture
def quick(monkeypatch):
    """Without the term sets of long series of harmonics, which take most of the time."""
    monkeypatch.setattr(term_sets, "CHOICES", [c for c in term_sets.CHOICES if c[1] <= term_sets.LOW])


def test_payload_is_carried_over_to_another_mass(quick):
    loads = np.repeat([1.0, 4.0], 60)
    extra = [(t, 2e-5 * (j + 1)) for j, t in enumerate(Payload((0.0, 0.0, 0.1)).terms(arm("irb120")))]
    truth = Truth(["gravity"], extra=extra)
    q = truth.nominal.random_joints(120, 3)
    motion = Motion(q, inputs={"payload_kg": loads})
    found = identify_evidence(
        truth.nominal, truth.measured(motion, 1e-5), motion, gear_scan=False, payload_centre=(0.0, 0.0, 0.1)
    )
    test = Motion(truth.nominal.random_joints(40, 8), inputs={"payload_kg": np.full(40, 7.0)})
    T = found.T_world_base @ found.term_map().forward(found.arm, test)
    p = T[:, :3, :3] @ found.targets["smr1"] + T[:, :3, 3]
    error = np.linalg.norm(p - truth.points(test, "smr1"), axis=1)
    assert error.mean() < 3e-5
    unloaded = Motion(test.q)
    assert np.linalg.norm(truth.points(unloaded, "smr1") - truth.points(test, "smr1"), axis=1).mean() > 3e-4


def test_comparison_on_some_poses_then_all(monkeypatch, quick):
    truth = Truth(["gravity"])
    motion = Motion(truth.nominal.random_joints(60, 3))
    points = truth.measured(motion, 2e-5)
    whole = identify_evidence(truth.nominal, points, motion, gear_scan=False)
    monkeypatch.setattr(evidence, "COMPARED", 30)
    part = identify_evidence(truth.nominal, points, motion, gear_scan=False)
    assert part.average.poses == 60
    difference = part.robot.predict(motion.q[:20]).position - whole.robot.predict(motion.q[:20]).position
    assert np.abs(difference).max() < 2e-5


def test_what_cannot_be_done_is_refused():
    truth = Truth(["gravity"])
    motion = Motion(truth.nominal.random_joints(20, 3))
    points = truth.measured(motion, 2e-5)
    with pytest.raises(IdentificationError, match="joint-map or all"):
        identify_evidence(truth.nominal, points, motion, terms="some")
    with pytest.raises(IdentificationError, match="stops"):
        identify_evidence(truth.nominal, points, Motion(motion.q[:5]))
    with pytest.raises(IdentificationError, match="too few to weigh"):
        identify_evidence(truth.nominal, points.select(np.arange(20) < 2), motion.select(slice(0, 2)))


def test_the_average_is_the_weighted_sum_of_its_dictionaries(quick):
    truth = Truth(["gravity"], scale=0.3)
    motion = Motion(truth.nominal.random_joints(25, 3))
    found = identify_evidence(truth.nominal, truth.measured(motion, 5e-5), motion, gear_scan=False)
    weights = [row.weight for row in found.term_sets]
    assert sum(weights) == pytest.approx(1.0)
    assert sum(w > 0.0 for w in weights) > 1
    for row in found.term_sets:
        assert (row.sigma_mm is None) == (row.leave_one_out_mm is None) == (row.weight == 0.0)
    # the average of residual variances, and left-out residuals that no dictionary alone need have
    kept = [row for row in found.term_sets if row.weight]
    assert found.average.sigma_mm**2 == pytest.approx(sum(row.weight * row.sigma_mm**2 for row in kept), rel=1e-9)
    assert found.average.leave_one_out_mm[""] <= max(row.leave_one_out_mm for row in kept)


def test_left_out_residuals_grow_by_the_coordinate_that_was_projected_out():
    model, rng = arm("irb120"), np.random.default_rng(2)
    points = measured(random_robot(model, "26", rng), model.random_joints(400, 3), 2e-5, rng)
    common = rng.standard_normal((400, 3))  # what all points of a pose have in common
    away = rng.standard_normal((400, 3))
    away /= np.linalg.norm(away, axis=1)[:, None]
    projected = common - np.einsum("ni,ni->n", common, away)[:, None] * away
    pose, row = np.repeat(points.pose, 3), np.repeat(np.arange(len(points)), 3)
    linear = SimpleNamespace(target=points.target, target_names=points.target_names, projected=False)
    whole = leave_one_out.lengths(linear, common[points.pose].ravel(), pose, row)
    not_known = leave_one_out.lengths(linear, projected[points.pose].ravel(), pose, row)
    linear.projected = True
    seen = leave_one_out.lengths(linear, projected[points.pose].ravel(), pose, row)
    assert seen[""] == pytest.approx(whole[""], rel=0.05)
    assert seen["smr2"] == pytest.approx(seen[""], rel=1e-9)
    assert not_known[""] < 0.85 * whole[""]


def test_a_known_target_stays_where_it_is(quick):
    truth = Truth(["gravity"])
    motion = Motion(truth.nominal.random_joints(60, 3))
    known = {name: np.array(place) for name, place in TARGETS.items()}
    found = identify_evidence(truth.nominal, truth.measured(motion, 2e-5), motion, gear_scan=False, known_targets=known)
    assert found.fitted_targets == ()
    np.testing.assert_array_equal(found.targets["smr2"], TARGETS["smr2"])
    assert len(found.covariance) == 6 + len(found.terms)


# --- real robots: figures of an independent calculation -----------------------------------------------------


@pytest.fixture(scope="module")
def irb120_commands(shared_data):
    return irb120(shared_data)


CHECKED = {  # what the name of a term set ends with: columns, log evidence, sigma and leave-one-out error in mm
    "geometry": (45, 221.3, 0.1358, 0.258),
    "gravity, gain": (81, 766.9, 0.0452, 0.0844),
    "harmonics to 2": (178, 797.0, 0.0397, 0.0770),
    "harmonics to 2, direction, move": (196, 805.7, 0.0382, 0.0754),
    "harmonics to 2, direction, move, warm-up": (232, 893.9, 0.0303, 0.0629),
    "wobble": (352, 919.2, 0.0262, 0.0562),
}


def test_log_evidences_of_an_irb120(irb120_commands):
    found = irb120_commands.first(200, terms="all", gear_scan=False)
    rows = {end: next(row for row in found.term_sets if row.name.endswith(end)) for end in CHECKED}
    for end, (columns, value, sigma, loo) in CHECKED.items():
        row = rows[end]
        assert row.terms == columns
        assert row.log_evidence == pytest.approx(value, abs=6.0)
        if row.weight:
            assert row.sigma_mm == pytest.approx(sigma, rel=0.03)
            assert row.leave_one_out_mm == pytest.approx(loo, rel=0.03)
    assert rows["wobble"].weight == pytest.approx(0.92, abs=0.05)
    assert rows["harmonics to 2, direction, move, warm-up"].weight == pytest.approx(0.07, abs=0.05)
    found = irb120_commands.first(200, terms="joint-map", gear_scan=False)
    row = next(row for row in found.term_sets if row.name.endswith("harmonics to 2, direction, move, warm-up"))
    assert row.terms == 159
    assert row.log_evidence == pytest.approx(855.9, abs=4.0)
    assert row.sigma_mm == pytest.approx(0.0356, rel=0.02)
    assert row.leave_one_out_mm == pytest.approx(0.0700, rel=0.02)
    assert max(found.term_sets, key=lambda row: row.weight) is row


HELDOUT = {  # terms, poses, gears: mean and largest error in mm on the rest of the file
    ("all", 200, False): (0.0556, 0.251),
    ("all", 200, True): (0.0473, 0.26),
    ("joint-map", 200, False): (0.0695, 0.241),
    ("all", 45, False): (0.125, 0.54),
    ("joint-map", 400, False): (0.0595, 0.17),
}


@pytest.mark.parametrize(("terms", "poses", "gears"), HELDOUT)
def test_held_out_errors_of_an_irb120(irb120_commands, terms, poses, gears):
    found = irb120_commands.first(poses, terms=terms, gear_scan=gears)
    mean, largest, inside = irb120_commands.heldout(found, poses)
    expected = HELDOUT[terms, poses, gears]
    assert mean < 1.05 * expected[0]
    assert largest < 1.1 * expected[1]
    assert_documented(("IRB 120", terms, poses, gears), mean, largest, inside)
    if poses >= 200:
        assert 0.93 < inside < 0.985


@pytest.mark.parametrize(("level", "poses"), [("34b", 45), ("34", 200), ("34b", 200), ("34b", 400)])
def test_levels_of_the_thesis_on_an_irb120(irb120_commands, level, poses):
    assert_documented(("IRB 120", f"level {level}", poses, False), *irb120_commands.of_level(poses, level))


def test_readings_of_an_irb120(shared_data, irb120_commands):
    read = irb120(shared_data, "q")
    found = read.first(200, terms="joint-map")
    assert found.average.readings_lag
    assert found.average.readings_gain > 4.0
    # at programmed joints, which it has never seen
    error = irb120_commands.heldout(found, 200)
    assert_documented(("IRB 120, readings only", "joint-map", 200, True), *error)
    # at readings, with the share of the last move that they tell
    first = np.arange(len(read.motion)) < 200
    lag = evidence_fit.lag(found, read.points.select(first), read.motion.select(first))
    there = replace(read.motion, q=lag.programmed(found, read.motion))
    error = Measured(read.model, read.points, there).heldout(found, 200)
    assert_documented(("IRB 120, readings only, judged at them", "joint-map", 200, True), *error[:2])


def test_held_out_errors_of_a_ur10(shared_data, tmp_path):
    rows = pd.read_csv(shared_data / "ur10_laser_tracker_6d" / "measurements.csv", dtype=str)
    rows[rows["group"] == "grid"].to_csv(tmp_path / "ur10.csv", index=False)
    points = replace(cleaning.clean(table.read(tmp_path / "ur10.csv")).points, rotation=None)
    model = urdf.read(example_robot("ur_description/urdf/ur10_robot.urdf")).arm
    data = Measured(model, points, Motion.in_order(points.q))
    found = data.first(300, gear_scan=False)
    assert_documented(("UR10 grid", "joint-map", 300, False), *data.heldout(found, 300))
    parts = coverage(found.robot, points.select(np.arange(points.poses) >= 300))["parts"]
    assert 0.92 < parts["all"]["inside"] < 0.98
    assert parts["outside"]["n"] > 100
    assert parts["outside"]["inside"] > 0.8
    assert_documented(("UR10 grid", "level 34", 300, False), *data.of_level(300, "34"))


def cell(seed, poses=100, noise=2e-5):
    model, rng = arm("irb120"), np.random.default_rng(seed)
    robot = random_robot(model, "34", rng)
    return model, measured(robot, model.random_joints(poses, seed), noise, rng), robot


@pytest.fixture(scope="module")
def found():
    model, points, _ = cell(4)
    return identify_evidence(model, points, Motion.in_order(points.q))


def test_robots_of_the_thesis_keep_the_accuracy_of_its_level():
    ratios = []
    for seed in range(1, 4):
        model, points, robot = cell(seed)
        test = measured(robot, model.random_joints(300, 2))
        level = distances(identify(model, points, "34").robot, test).mean()
        average = identify_evidence(model, points, Motion.in_order(points.q))
        ratios.append(distances(average.robot, test).mean() / level)
    assert np.mean(ratios) < 1.04
    assert max(ratios) < 1.10


def test_parameters_are_those_of_the_covariance(found):
    rows = found.parameters()
    assert len(rows) == found.parameter_count == len(found.certainty.covariance)
    assert {row.state for row in rows} == {"identified"}
    assert len({row.name for row in rows}) == len(rows)
    std = {row.name: row.std for row in rows}
    spread = np.sqrt(np.diagonal(found.certainty.covariance))
    names = [row.name for row in rows]
    assert std["delta_a2"] == pytest.approx(1e3 * spread[names.index("delta_a2")], rel=1e-9)
    assert std["delta_alpha3"] == pytest.approx(np.degrees(spread[names.index("delta_alpha3")]), rel=1e-9)
    value = {row.name: row.value for row in rows}
    table, nominal = found.robot.arm.table, arm("irb120").table
    assert value["delta_a3"] == pytest.approx(1e3 * (table.a - nominal.a)[2], abs=1e-9)
    assert value["delta_alpha5"] == pytest.approx(np.degrees((table.alpha - nominal.alpha)[4]), abs=1e-9)
    assert 0 < found.rank <= found.parameter_count


def test_intervals_hold(found):
    _, _, robot = cell(4)
    test = measured(robot, arm("irb120").random_joints(300, 3), 2e-5, np.random.default_rng(8))
    assert 0.9 < coverage(found.robot, test)["parts"]["all"]["inside"] <= 1.0


def test_it_speaks_and_can_be_pickled(found):
    text = found.summary()
    for word in ("weight", "log evidence", "Valid within the joint ranges", "Groups of terms"):
        assert word in text
    weights = [row.weight for row in found.term_sets if row.weight]
    assert sum(weights) == pytest.approx(1.0, abs=1e-12)
    assert f"({max(weights):.0%})" in found.explanation()
    assert len(repr(found)) < 2000
    again = pickle.loads(pickle.dumps(found))
    q = arm("irb120").random_joints(5, 1)
    assert np.array_equal(again.robot.poses(q), found.robot.poses(q))
    assert list(found.to_frame()["name"]) == [row.name for row in found.parameters()]
    assert found.lag() is None


def test_too_few_poses_are_refused():
    model, points, _ = cell(4, poses=8)
    with pytest.raises(IdentificationError, match="8 poses are too few to weigh"):
        identify_evidence(model, points, Motion(points.q))


def test_repeats_of_a_stop_are_averaged(quick):
    truth = Truth(["gravity"])
    motion = Motion(np.repeat(truth.nominal.random_joints(30, 3), 3, axis=0))
    points = truth.measured(motion, 3e-5)
    merged, shorter = average_repeats(points, motion)
    assert merged.poses == len(shorter) == 30
    expected = points.xyz.reshape(30, 3, 3, 3).mean(axis=1).reshape(-1, 3)
    np.testing.assert_allclose(merged.xyz, expected, atol=1e-12)
    assert identify_evidence(truth.nominal, points, motion, gear_scan=False).average.poses == 30


@settings(max_examples=40)
@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 1)), min_size=1, max_size=15), st.integers(0, 999))
def test_means_by_a_dictionary_of_stops(stops, seed):
    # stops (joints, move) in any order, each seeing some of two targets
    rng = np.random.default_rng(seed)
    q = np.array([[0.1 * s, 0.2] for s, _ in stops])
    move = np.array([[0.05 * m, 0.0] for _, m in stops])
    seen = [(n, t) for n in range(len(stops)) for t in range(2) if t == n % 2 or rng.uniform() < 0.5]
    pose, target = (np.array([s[k] for s in seen]) for k in range(2))
    xyz, u95 = rng.normal(size=(len(seen), 3)), rng.uniform(size=len(seen))
    n = len(stops)
    points = PointSet(q, pose, target, xyz, ("a", "b"), np.arange(n), np.full(n, "", dtype=object), u95=u95)
    motion = Motion(q, move, np.arange(n, dtype=float), {"payload_kg": np.full(n, 2.0)})
    merged, shorter = average_repeats(points, motion)
    order = list(dict.fromkeys(stops))
    assert merged.poses == len(shorter) == len(order)
    for p, t, place, u in zip(merged.pose, merged.target, merged.xyz, merged.u95, strict=True):
        mine = [k for k in range(len(seen)) if stops[pose[k]] == order[p] and target[k] == t]
        np.testing.assert_allclose(place, xyz[mine].mean(axis=0), rtol=0, atol=1e-12)
        np.testing.assert_allclose(u, u95[mine].mean(), rtol=1e-12)
    for p, stop in enumerate(order):
        when = [k for k in range(n) if stops[k] == stop]
        np.testing.assert_allclose(shorter.elapsed[p], np.mean(when), rtol=1e-12)
        np.testing.assert_array_equal(shorter.q[p], q[when[0]])
        assert merged.pose_ids[p] == when[0]
    assert (np.diff(merged.pose) >= 0).all()


def test_other_masses_and_orientations_are_not_averaged():
    truth = Truth(["gravity"])
    q = np.repeat(truth.nominal.random_joints(4, 3), 2, axis=0)
    motion = Motion(q, inputs={"payload_kg": np.tile([1.0, 2.0], 4)})
    points = truth.measured(motion, 1e-5)
    assert average_repeats(points, motion)[0].poses == 8
    once = replace(motion, inputs={"payload_kg": np.ones(8), "torques": np.arange(48.0).reshape(8, 6)})
    told = replace(points, inputs={**once.inputs, "payload_centre": np.tile([0.0, 0.0, 0.1], (8, 1))})
    merged, shorter = average_repeats(told, once)
    assert {merged.poses, *map(len, merged.inputs.values())} == {4}
    np.testing.assert_allclose(
        shorter.inputs["torques"], once.inputs["torques"].reshape(4, 2, 6).mean(axis=1), rtol=1e-14
    )
    apart = replace(once, inputs={**once.inputs, "payload_centre": np.arange(24.0).reshape(8, 3)})
    assert average_repeats(told, apart)[0].poses == 8
    turned = replace(points, rotation=np.tile(np.eye(3), (len(points), 1, 1)))
    assert average_repeats(turned, Motion(q))[0] is turned
    assert average_repeats(points, Motion(q))[0].poses == 4


@pytest.mark.parametrize("best", [1.0, 2.0, 3.0, 4.0])
@pytest.mark.parametrize("start", [1.0, 2.0, 3.0, 4.0])
def test_the_best_time_constant_is_looked_for_on_both_sides(monkeypatch, start, best):
    monkeypatch.setattr(term_sets, "with_tau", lambda term_set, terms, tau: tau)
    averaging, tried = object.__new__(evidence.Averaging), []
    averaging.superset, averaging.evidence_likelihood_power = [], 1.0

    def fit(tau, *_):
        tried.append(tau)
        return SimpleNamespace(log_evidence=-abs(tau - best))

    monkeypatch.setattr(averaging, "fit", fit)
    candidate = evidence.ComparedTermSet(start, fit(start))
    assert averaging._choose_tau(candidate, start, [1.0, 2.0, 3.0, 4.0]) == candidate.term_set == best
    assert len(tried) == len(set(tried))
