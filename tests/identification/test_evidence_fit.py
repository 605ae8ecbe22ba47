"""What an identification by evidence says: predictions with intervals against sampling, words, tables."""

import pickle
import sys
from dataclasses import FrozenInstanceError, replace
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path

import numpy as np
import pytest
from evidence_cases import Truth, moves
from support import assert_same_poses

from irbcal.identification import evidence, evidence_fit
from irbcal.identification.evidence import identify_evidence
from irbcal.identification.fit_sections import FamilyShown, sentence
from irbcal.modeling import frames
from irbcal.modeling.terms import families
from irbcal.modeling.terms.geometry import DHM_COLUMNS
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term_map import TermMap
from irbcal.units import MM


@pytest.fixture(scope="module")
def truth():
    return Truth(["gravity", "gain", "direction"])


@pytest.fixture(scope="module")
def found(truth):
    motion = moves(truth.nominal, 80, 3)
    return identify_evidence(truth.nominal, truth.measured(motion, 3e-5), motion, terms="all", gear_scan=False)


@pytest.fixture(scope="module")
def test_motion(truth):
    return moves(truth.nominal, 6, 11)


def test_an_unknown_stop_before_widens_the_interval():
    truth = Truth(["gravity", "direction"], scale=2.0)
    motion = replace(moves(truth.nominal, 100, 3), elapsed=None)
    found = identify_evidence(truth.nominal, truth.measured(motion, 1e-5), motion, gear_scan=False)
    test = moves(truth.nominal, 30, 5)
    known, unknown = found.robot.predict(test.q, test.q - test.moves), found.robot.predict(test.q)
    assert (unknown.interval > known.interval).all()
    assert np.abs(unknown.position - known.position).max() > 1e-5
    assert (np.abs(unknown.position - known.position) < unknown.interval).mean() > 0.9


def test_joints_outside_the_ranges_of_the_fit_are_marked():
    truth = Truth(["gravity"])
    motion = Motion(0.3 * truth.nominal.random_joints(40, 3))
    found = identify_evidence(truth.nominal, truth.measured(motion, 2e-5), motion, gear_scan=False)
    q = np.array([motion.q[0], motion.q[0] + np.array([0, 0, 0, 3.0, 0, 0])])
    np.testing.assert_array_equal(found.robot.predict(q).outside, [False, True])


def test_predictions_are_forward_kinematics(found, test_motion):
    q, previous = test_motion.q, test_motion.q - test_motion.moves
    T = found.T_world_base @ found.robot.forward(q, previous)
    assert_same_poses(
        T, found.T_world_base @ found.term_map().forward(found.arm, Motion(q, test_motion.moves)), 1e-14, 1e-14
    )
    for name, place in found.targets.items():
        expected = T[:, :3, :3] @ place + T[:, :3, 3]
        np.testing.assert_allclose(found.robot.predict(q, previous, name).position, expected, rtol=0, atol=1e-13)


def test_covariance_is_that_of_sampled_robots(found, test_motion):
    # base, targets, constants and terms drawn from the posterior; each robot predicts by its own kinematics
    q, previous = test_motion.q, test_motion.q - test_motion.moves
    rng = np.random.default_rng(4)
    L = np.linalg.svd(found.covariance)
    draws = (L[0] * np.sqrt(np.maximum(L[1], 0.0))) @ rng.standard_normal((len(found.covariance), 400))
    nuisance = len(found.covariance) - len(found.terms)
    name = found.fitted_targets[1]
    rows = [k for k, t in enumerate(found.terms) if t.family not in ("geometry", "warm_up")]
    out = []
    for d in draws.T:
        columns = {key: getattr(found.arm.table, key).copy() for key in DHM_COLUMNS.values()}
        for t, step in zip(found.terms, d[nuisance:], strict=True):
            if t.family == "geometry":
                columns[DHM_COLUMNS[t.axis]][t.joint] += step
        arm = found.arm.with_table(replace(found.arm.table, **columns))
        c = found.coefficients[rows] + d[nuisance:][rows]
        T = TermMap(found.nominal, tuple(found.terms[k] for k in rows), c).forward(arm, Motion(q, test_motion.moves))
        p = T[:, :3, :3] @ (found.targets[name] + d[9:12]) + T[:, :3, 3]
        turn = frames.transform(None, d[3:6]) @ _turn(d[:3])
        out.append((p @ turn[:3, :3].T + turn[:3, 3]) @ found.T_world_base[:3, :3].T + found.T_world_base[:3, 3])
    sampled = np.array(out)
    seen = found.robot.predict(q, previous, name)
    std = np.sqrt(np.diagonal(seen.covariance, axis1=1, axis2=2))
    np.testing.assert_allclose(sampled.std(axis=0), std, rtol=0.15)
    np.testing.assert_allclose(
        seen.interval, 1.96 * np.sqrt(std**2 + found.certainty.left_out(name) ** 2 / 3.0), rtol=1e-9
    )
    np.testing.assert_allclose(
        found.robot.predict(q, previous, name, in_order=True).interval,
        1.96 * np.sqrt(std**2 + found.certainty.left_out(name, in_order=True) ** 2 / 3.0),
        rtol=1e-9,
    )


def _turn(vector):
    from scipy.spatial.transform import Rotation

    return frames.transform(Rotation.from_rotvec(vector).as_matrix())


def test_constants_are_those_of_the_table(found):
    for name, (value, std) in found.constants().items():
        column, joint = name.removeprefix("delta_")[:-1], int(name[-1]) - 1
        change = getattr(found.arm.table, column)[joint] - getattr(found.nominal.table, column)[joint]
        assert value == pytest.approx(change, abs=1e-15)
        assert std > 0.0


def test_the_warm_arm_has_no_warm_up(found):
    assert "warm_up" not in {t.family for t in found.term_map().terms}
    assert "geometry" not in {t.family for t in found.term_map(warm=False).terms}
    cold = {t.family for t in found.term_map(warm=False).terms}
    assert found.average.warm_up_tau is None or "warm_up" in cold


@pytest.mark.parametrize(("evidence", "moves_mm", "shown"), [(-0.4, 0.0008, False), (40.0, 0.1, True)])
def test_a_drift_is_reported_where_the_data_show_it(found, evidence, moves_mm, shown):
    warm_up = FamilyShown(family="warm_up", determined=1.0, evidence=evidence, moves_mm=moves_mm)
    average = found.average.model_copy(update={"families": (warm_up,), "warm_up_tau": 20.0})
    text = " ".join(replace(found, average=average).sentences())
    assert ("The arm drifted as it warmed up, with a time constant of 20 poses" in text) == shown
    assert ("Not shown: warm-up." in text) != shown


def test_it_says_what_was_compared_and_what_was_seen(found):
    text = found.summary()
    lines = [line.split() for line in text.splitlines() if line]
    assert found.headline().startswith("irb120_3_058, model auto of terms all: ")
    assert found.headline() in text
    for row in found.term_sets:
        assert f"{row.log_evidence:.1f}" in text
    assert next(line for line in lines if line[0] == "geometry")[1] == "45"
    assert float(next(line for line in lines if line[:2] == ["gravity", "2"])[3]) > 3.0
    assert all(0.0 <= row.determined <= row.terms for row in found.average.groups)
    assert len(repr(found)) < 400
    assert found._repr_html_().count("<table>") == 2


def test_predictions_speak(found, test_motion):
    seen = found.robot.predict(test_motion.q)
    assert repr(seen).startswith("<Prediction: 6 predicted positions: 95 % of a coordinate's errors within 0.")
    frame = seen.to_frame()
    np.testing.assert_allclose(frame[["x_mm", "y_mm", "z_mm"]], 1e3 * seen.position, rtol=0, atol=1e-9)
    np.testing.assert_allclose(frame["y_u95_mm"], 1e3 * seen.interval[:, 1], rtol=0, atol=1e-9)
    q = test_motion.q.copy()
    q[0, 3] += 9.0
    assert "1 of them outside" in found.robot.predict(q).summary()


def test_results_are_locked_and_pickled(found, test_motion):
    seen = found.robot.predict(test_motion.q)
    for array in (found.coefficients, found.covariance, seen.position, seen.outside, found.targets["smr1"]):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    with pytest.raises(TypeError):
        found.targets["new"] = np.zeros(3)
    with pytest.raises(FrozenInstanceError):
        found.level = "34"
    again = pickle.loads(pickle.dumps(found))
    assert again.summary() == found.summary()
    np.testing.assert_array_equal(again.robot.predict(test_motion.q).position, seen.position)
    assert repr(pickle.loads(pickle.dumps(seen))) == repr(seen)


@pytest.fixture(scope="module")
def lagging():
    """A fit from lagging readings: truth, commands, true shares, points, motion as read, fit."""
    truth = Truth(["gravity"])
    commands = moves(truth.nominal, 120, 3)
    rng = np.random.default_rng(6)
    share = np.abs(4e-4 + 2e-4 * rng.standard_normal(120))
    points = truth.measured(replace(commands, elapsed=None), 1e-5)
    read = commands.q - share[:, None] * commands.moves
    motion = Motion(read, np.diff(read, axis=0, prepend=read[:1]), readings=True)
    return truth, commands, share, points, motion, identify_evidence(truth.nominal, points, motion, gear_scan=False)


def test_joints_that_lag_by_different_shares_leave_no_terms_of_the_robot():
    truth = Truth(["gravity"])
    commands = moves(truth.nominal, 150, 3)
    rng = np.random.default_rng(6)
    turn = np.radians(0.05) * np.abs(1.0 + 0.3 * rng.standard_normal(150))  # of the joint that moved most
    share = (turn / np.maximum(np.abs(commands.moves).max(axis=1), 1e-3))[:, None] * np.linspace(0.85, 1.15, 6)
    points = truth.measured(replace(commands, elapsed=None), 1e-5)
    read = commands.q - share * commands.moves
    motion = Motion(read, np.diff(read, axis=0, prepend=read[:1]), readings=True)
    found = identify_evidence(truth.nominal, points, motion, gear_scan=False)
    assert found.average.readings_lag
    assert not any(term.family == "move" for term in found.terms)
    test = Motion.in_order(truth.nominal.random_joints(100, 9))
    there = found.robot.predict(test.q, test.q - test.moves, "smr1").position
    error = np.linalg.norm(there - truth.points(replace(test, elapsed=None), "smr1"), axis=1)
    assert error.mean() < 1e-5


def test_readings_that_lag_are_recognised(lagging):
    truth, commands, share, points, motion, found = lagging
    assert found.average.readings_lag
    assert found.average.readings_gain > 3.0
    assert "stood still" in found.summary()
    shares = evidence_fit.shares(found, points, motion)
    assert np.abs(shares - share)[5:].mean() < 2e-5
    lag = evidence_fit.lag(found, points, motion)
    assert np.abs(lag.share(found, motion)[5:] - share[5:]).mean() < 2.5e-4
    assert repr(lag).startswith("<Lag: readings lag behind the programmed joints by 4.")
    # exact readings are left alone
    motion = Motion(commands.q, commands.moves, readings=True)
    found = identify_evidence(truth.nominal, points, motion, gear_scan=False)
    assert not found.average.readings_lag
    assert found.average.readings_gain < 1.2
    assert "taken at rest" in found.summary()


def test_programmed_joints_are_nearer_than_readings(lagging):
    _, commands, _, points, motion, found = lagging
    lag = evidence_fit.lag(found, points, motion)
    off = np.abs(lag.programmed(found, motion) - commands.q)[5:].mean()
    assert off < 0.5 * np.abs(motion.q - commands.q)[5:].mean()
    np.testing.assert_array_equal(lag.shares, evidence_fit.shares(found, points, motion))


def test_features_of_a_move_by_hand(lagging):
    found, motion = lagging[-1], lagging[-2]
    q = motion.q[:3]
    move = np.array([[0.1, -0.2, 0.0, 0.05, 0.0, 0.0], [0.0] * 6, [1e-4, 0.0, 0.0, 0.0, 0.0, 0.0]])
    rows = evidence_fit.features(found, Motion(q, move))
    assert rows.shape == (3, 16)
    assert rows[0, 0] == 1.0
    assert rows[0, 1] == pytest.approx(5.0)
    np.testing.assert_allclose(rows[0, 4:10], np.abs(move[0]) / 0.04, rtol=1e-12)
    np.testing.assert_allclose(rows[0, 10:], move[0] ** 2 / 0.008, rtol=1e-12)
    T = found.arm.forward(np.array([q[0], q[0] - move[0]]))
    place = np.append(next(iter(found.targets.values())), 1.0)
    path = np.linalg.norm((T[0] - T[1])[:3] @ place)
    np.testing.assert_allclose(rows[0, 2:4], [1.0 / path, path / 0.04], rtol=1e-9)
    assert not rows[1:].any()  # no move, or one below a tenth of a degree


SCRIPT = Path(__file__).parents[2] / "scripts" / "false_alarms"


@pytest.fixture(scope="module")
def robots():
    """Robots of the script that counts a hundred: one whose points err by themselves, one with a tracker's errors."""
    sys.dont_write_bytecode, before = True, sys.dont_write_bytecode
    loader = SourceFileLoader("false_alarms", str(SCRIPT))
    script = module_from_spec(spec_from_loader("false_alarms", loader))
    sys.modules["false_alarms"] = script  # dataclasses look their module up
    loader.exec_module(script)
    sys.dont_write_bytecode = before
    return script, [script.prove("irb120", s, white=w) for s, w in ((10, True), (2, False))]


def test_no_family_is_shown_that_is_not_there_and_none_is_missed(robots):
    for robot in robots[1]:
        assert robot.there
        assert not robot.alarms
        assert not robot.missed


def test_gears_coefficients_positions_and_intervals_are_right(robots):
    *found, tracked = robots[1]
    assert sum(len(robot.gears) for robot in found) >= 4
    assert all(robot.gears == robot.gears_found for robot in found)
    for name, low, high in (("coefficients", 0.99, 1.0), ("positions", 0.99, 1.0), ("coordinates", 0.93, 0.97)):
        pairs = [getattr(robot, name) for robot in found]
        assert low <= sum(a for a, _ in pairs) / sum(b for _, b in pairs) <= high, name
    assert max(robot.mean for robot in found) < 0.006 * MM
    # errors common to a pose: deviations are a little too small, intervals hold
    for name, low in (("coefficients", 0.96), ("positions", 0.97), ("coordinates", 0.93)):
        inside, count = getattr(tracked, name)
        assert inside / count > low, name


def test_the_script_says_what_it_counted(robots):
    script, found = robots
    wrong = replace(found[0], there=set(), shown={"gravity", "thesis"})
    told = script.summary([*found, wrong])
    assert "3 SIMULATED robots, 1 with a false alarm (2 of" in told
    assert "gravity: shown 1 of" in told
    assert "thesis: shown 1 times where none of ('gravity', 'harmonics') is there" in told
    assert "false alarms ['gravity', 'thesis']" in wrong.line()


def test_a_family_is_worth_what_a_fit_without_it_lacks(monkeypatch):
    """Against identifications of robots with and without it, not against the fast sub-blocks."""
    truth = Truth(["gravity", "direction"])
    motion = replace(moves(truth.nominal, 100, 3), elapsed=None)
    points = truth.measured(motion, 1e-5)
    # evidences are compared where coordinates count alike: without its family the errors of a pose are no noise
    monkeypatch.setattr(evidence, "_each_counts", lambda averaging, compared: False)
    found = identify_evidence(truth.nominal, points, motion, gear_scan=False)
    rows = {row.family: row for row in found.average.families}
    assert rows["gravity"].supported
    assert rows["direction"].supported
    assert not {"gain", "harmonics", "move"} & {name for name, row in rows.items() if row.supported}
    monkeypatch.setattr(type(families()["direction"]), "of_moves", False)
    still = identify_evidence(truth.nominal, points, motion, gear_scan=False)
    best = max(row.log_evidence for row in found.term_sets) - max(row.log_evidence for row in still.term_sets)
    assert rows["direction"].evidence == pytest.approx(best, rel=0.05)
    before = motion.q - motion.moves
    change = np.concatenate(
        [
            found.robot.predict(motion.q, before, name).position - still.robot.predict(motion.q, before, name).position
            for name in points.target_names
        ]
    )
    assert rows["direction"].moves_mm == pytest.approx(np.sqrt(np.mean(np.sum(change**2, axis=1))) / MM, rel=0.2)


def shown(family, evidence, moves_mm):
    return FamilyShown(family=family, determined=3.0, evidence=evidence, moves_mm=moves_mm)


def test_sentences():
    there = shown("gravity", 500.0, 0.2134), shown("warm_up", 9.0, 0.0051)
    small, doubtful = shown("move", 90.0, 0.001), shown("thesis", 4.0, 1.0)
    assert sentence([*reversed(there), small, doubtful]) == (
        "What the data show beside errors of the geometry (in brackets, how far points move if a model does without): "
        "gravity (0.213 mm), warm-up (0.005 mm). Not shown: move, arm stiffness and joint-6 series."
    )
    assert sentence([small]) == "Beside errors of the geometry the data show nothing. Not shown: move."
    assert sentence([]) == "Beside errors of the geometry the data show nothing."
