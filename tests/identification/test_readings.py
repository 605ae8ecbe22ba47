"""Readings taken before the arm stood still: simulated shares found again."""

from dataclasses import replace

import numpy as np
import pytest
from evidence_cases import Truth, moves

from irbcal.identification import evidence_fit
from irbcal.identification.evidence import identify_evidence
from irbcal.modeling.terms.situation import Motion


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
    assert found.readings_projected
    assert not any(term.family == "move" for term in found.terms)
    test = Motion.in_order(truth.nominal.random_joints(100, 9))
    there = found.predict(test.q, test.q - test.moves, "smr1").position
    error = np.linalg.norm(there - truth.points(replace(test, elapsed=None), "smr1"), axis=1)
    assert error.mean() < 1e-5


def test_readings_that_lag_are_recognised(lagging):
    truth, commands, share, points, motion, found = lagging
    assert found.readings_projected
    assert found.readings_gain > 3.0
    assert "before the arm stood still" in found.summary()
    shares = evidence_fit.shares(found, points, motion)
    assert np.abs(shares - share)[5:].mean() < 2e-5
    lag = evidence_fit.lag(found, points, motion)
    assert np.abs(lag.share(found, motion)[5:] - share[5:]).mean() < 2.5e-4
    assert repr(lag).startswith("<Lag: readings lag behind the programmed joints by 4.")
    # exact readings are left alone
    motion = Motion(commands.q, commands.moves, readings=True)
    found = identify_evidence(truth.nominal, points, motion, gear_scan=False)
    assert not found.readings_projected
    assert found.readings_gain < 1.2
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
