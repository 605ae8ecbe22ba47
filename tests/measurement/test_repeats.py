"""Repeats of poses, poses near fitted ones, and the searches for neighbours behind both."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import arm, measured, random_robot

from irbcal import pipeline
from irbcal.identification import fit
from irbcal.identification.fit import identify
from irbcal.measurement import repeats
from irbcal.measurement.points import distances
from irbcal.units import DEG, MM

HUNDREDTH = np.radians(0.01)


def points_at(q, names=None):
    robot = random_robot(arm(), "11", np.random.default_rng(1))
    points = measured(robot, np.asarray(q, dtype=float), 2e-5, np.random.default_rng(2))
    return points if names is None else replace(points, pose_ids=np.array(names, dtype=object))


def test_joints_within_a_hundredth_of_a_degree_are_one_place():
    q = np.zeros((4, 6))
    q[1, 2], q[2, 5], q[3, 0] = 0.99 * HUNDREDTH, 1.01 * HUNDREDTH, -0.5
    # by joints the third is beside the first two: farther than a hundredth in joint 6 alone
    assert repeats.repeat_groups(points_at(q)).tolist() == [0, 0, 1, 2]


def test_many_poses_are_numbered_as_few_are(monkeypatch):
    q = arm().random_joints(40, 3)[np.random.default_rng(3).integers(0, 40, 90)]
    q[::7] += 0.5 * HUNDREDTH
    points = points_at(q, [f"P{k % 50}" for k in range(90)])
    few = repeats.repeat_groups(points)
    monkeypatch.setattr(repeats, "MANY", 0)
    assert np.array_equal(repeats.repeat_groups(points), few)


def test_cycles_of_one_name_are_one_place_in_one_session_only():
    q = arm().random_joints(5, 1)
    points = points_at(q, ["P1", "P2", "P1", "P3", "P2"])
    assert repeats.repeat_groups(points).tolist() == [0, 1, 0, 2, 1]
    sessions = np.array(["mon", "mon", "tue", "tue", "tue"], dtype=object)
    assert repeats.repeat_groups(replace(points, session=sessions)).tolist() == [0, 1, 2, 3, 4]
    again = replace(points, session=sessions, q=np.vstack([q[:4], q[:1]]))
    assert repeats.repeat_groups(again).tolist() == [0, 1, 2, 3, 0]


@given(st.lists(st.tuples(st.integers(0, 6), st.integers(0, 2)), min_size=1, max_size=14))
def test_places_by_all_pairs(stops):
    q = np.array([[0.6 * HUNDREDTH * a, 0.3 * b] for a, b in stops])
    near = (np.abs(q[:, None] - q[None]).max(axis=2) <= HUNDREDTH).astype(int)
    joined = np.linalg.matrix_power(near, len(q)) > 0
    found = repeats.repeats_of_joints(q)
    np.testing.assert_array_equal(found[:, None] == found[None], joined)
    first = [found.tolist().index(k) for k in range(found.max() + 1)]
    assert first == sorted(first)


def test_copies_and_repeats_are_told():
    q = np.repeat(arm().random_joints(6, 3), 2, axis=0)
    points = points_at(q)
    assert repeats.copied_points(points) == 0
    assert repeats.repeat_notes(points)[0].startswith("The 12 poses are 6 places")
    copied = replace(points, xyz=np.repeat(points.xyz.reshape(6, 2, 3, 3)[:, 0], 2, axis=0).reshape(-1, 3))
    assert repeats.copied_points(copied) == 18
    assert "18 points stand in the measurements again" in repeats.repeat_notes(copied)[1]
    assert repeats.repeat_notes(points_at(q[::2])) == []


def claimed_over_true(seed, repeats=3, n=32):
    """Held-out error over the error at other poses of a robot with errors that its level does not describe."""
    nominal = arm()
    rng = np.random.default_rng(seed)
    robot = random_robot(nominal, "34", rng)
    wave, phase = rng.normal(size=(6, 3)), rng.uniform(0, 6, (6, 3))

    def reached(q):
        return q + 1.5e-4 * sum(wave[:, k] * np.sin((3 + k) * q + phase[:, k]) for k in range(3))

    q = np.repeat(nominal.random_joints(n, seed), repeats, axis=0)
    points = replace(measured(robot, reached(q), 1e-5, rng), q=q)
    aside = pipeline.held_out(points, 0.25, "random", seed)
    found = identify(nominal, points.select(~aside), "34").robot
    other = nominal.random_joints(400, seed + 500)
    truth = replace(measured(robot, reached(other)), q=other)
    folds = np.mean(fit.choose_level(nominal, points, seed, ["34"]).table[0].mean_mm)
    whole = identify(nominal, points, "34").robot
    return (
        distances(found, points.select(aside)).mean() / distances(found, truth).mean(),
        1e-3 * folds / distances(whole, truth).mean(),
    )


def test_what_is_claimed_is_true_with_repeats_and_too_good_without_grouping(monkeypatch):
    seeds = range(12)
    honest = np.mean([claimed_over_true(seed) for seed in seeds], axis=0)
    np.testing.assert_allclose(honest, 1.0, atol=0.08)
    apart = lambda points: np.arange(points.poses)  # noqa: E731
    monkeypatch.setattr(pipeline, "repeat_groups", apart)
    monkeypatch.setattr(fit, "repeat_groups", apart)
    flattered = np.mean([claimed_over_true(seed) for seed in seeds], axis=0)
    assert (flattered < 0.85 * honest).all()


@pytest.fixture
def both(monkeypatch):
    def run(function, *arguments, **options):
        few = function(*arguments, **options)
        monkeypatch.setattr(repeats, "MOST_PAIRS", 0)
        many = function(*arguments, **options)
        monkeypatch.undo()
        return few, many

    return run


@pytest.mark.parametrize("radius", [0.02, 0.1, 0.5])
def test_pairs(both, radius):
    x = np.random.default_rng(5).uniform(size=(120, 3))
    few, many = both(repeats.near_pairs, x, radius)
    assert {tuple(sorted(pair)) for pair in few} == {tuple(sorted(pair)) for pair in many}
    assert len(few) > 0 or radius < 0.1


def test_rows_within_reach_up_to_full_periods(both):
    rng = np.random.default_rng(7)
    period = np.array([40.0, 0.0, 25.0])
    x, y = rng.uniform(-60.0, 60.0, (150, 3)), rng.uniform(-60.0, 60.0, (400, 3))
    x[:20] = y[:20] + rng.uniform(-0.9, 0.9, (20, 3)) + rng.integers(-2, 3, (20, 3)) * period
    few, many = both(repeats.near_any, x, y, period)
    assert np.array_equal(few, many)
    assert few[:20].all()
    assert not few[20:].all()


def test_parts(both):
    rng = np.random.default_rng(6)
    for edges in (
        np.zeros((0, 2), dtype=int),
        rng.integers(0, 60, (40, 2)),
        np.column_stack([np.arange(59, 0, -1), np.arange(58, -1, -1)]),
    ):
        few, many = both(repeats.connected, 60, edges)
        assert len(np.unique(few)) == len(np.unique(many)) == len(np.unique(np.column_stack([few, many]), axis=0))


REVOLUTE = np.zeros(6, dtype=bool)


def simulated(n=30):
    nominal = arm()
    rng = np.random.default_rng(4)
    return measured(random_robot(nominal, "34", rng), nominal.random_joints(n, 3), 3e-5, rng)


def turned(points):
    q = points.q.copy()
    q[:, 5] += 2.0 * np.pi
    q[::2, 3] -= 2.0 * np.pi
    return replace(points, q=q)


@pytest.mark.parametrize(
    "again",
    [
        lambda p, rng: replace(p, xyz=np.round(p.xyz, 5), q=np.round(p.q, 8)),
        lambda p, rng: replace(p, xyz=p.xyz + rng.normal(0.0, 1e-3, p.xyz.shape)),
        lambda p, rng: replace(p, q=p.q + rng.uniform(-1.99, 1.99, p.q.shape) * DEG),
        lambda p, rng: turned(p),
    ],
    ids=["rounded", "measured anew", "moved by less than two degrees", "full turns"],
)
def test_fitted_poses_stay_fitted(again):
    points = simulated()
    fit = points.select(np.arange(points.poses) < 10)
    found = repeats.near_fitted(again(points, np.random.default_rng(1)), fit, REVOLUTE)
    np.testing.assert_array_equal(found, np.arange(points.poses) < 10)


def test_one_joint_more_than_two_degrees_away_is_another_pose():
    points = simulated()
    q = points.q.copy()
    q[:, 4] += 2.01 * DEG
    assert not repeats.near_fitted(replace(points, q=q), points, REVOLUTE).any()


def test_prismatic_joints_have_no_turns():
    points = simulated(5)
    slides = REVOLUTE | (np.arange(6) == 5)
    for shift, same in ((2.0 * np.pi, False), (19.0 * MM, True), (21.0 * MM, False)):
        q = points.q.copy()
        q[:, 5] += shift
        assert (repeats.near_fitted(replace(points, q=q), points, slides) == same).all()


def test_other_arms_and_empty_sets_have_nothing_in_common():
    points = simulated(5)
    none = points.select(np.zeros(5, dtype=bool))
    assert not repeats.near_fitted(points, none, REVOLUTE).any()
    assert len(repeats.near_fitted(none, points, REVOLUTE)) == 0
    seven = replace(points, q=np.column_stack([points.q, points.q[:, 0]]))
    assert not repeats.near_fitted(points, seven, np.zeros(7, dtype=bool)).any()


@pytest.mark.parametrize(("known", "expected"), [((0.0, 5.0), [True, True, False, True]), (None, [True] * 4)])
def test_a_load_that_was_never_fitted(known, expected):
    points = replace(simulated(4), inputs={"payload_kg": np.array([0.0, 5.05, 12.0, np.nan])})
    fit = simulated(2)
    fit = fit if known is None else replace(fit, inputs={"payload_kg": np.array(known)})
    np.testing.assert_array_equal(repeats.with_fitted_load(points, fit), expected)
