"""Repeats of a place, by hand and by all pairs."""

from dataclasses import replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from support import arm, measured, random_robot

from irbcal import pipeline
from irbcal.identification import fit
from irbcal.identification.fit import identify
from irbcal.measurement import places
from irbcal.measurement.points import distances

HUNDREDTH = np.radians(0.01)


def points_at(q, names=None):
    robot = random_robot(arm(), "11", np.random.default_rng(1))
    points = measured(robot, np.asarray(q, dtype=float), 2e-5, np.random.default_rng(2))
    return points if names is None else replace(points, pose_ids=np.array(names, dtype=object))


def test_joints_within_a_hundredth_of_a_degree_are_one_place():
    q = np.zeros((4, 6))
    q[1, 2], q[2, 5], q[3, 0] = 0.99 * HUNDREDTH, 1.01 * HUNDREDTH, -0.5
    # by joints the third is beside the first two: farther than a hundredth in joint 6 alone
    assert places.places(points_at(q)).tolist() == [0, 0, 1, 2]


def test_many_poses_are_numbered_as_few_are(monkeypatch):
    q = arm().random_joints(40, 3)[np.random.default_rng(3).integers(0, 40, 90)]
    q[::7] += 0.5 * HUNDREDTH
    points = points_at(q, [f"P{k % 50}" for k in range(90)])
    few = places.places(points)
    monkeypatch.setattr(places, "MANY", 0)
    assert np.array_equal(places.places(points), few)


def test_cycles_of_one_name_are_one_place_in_one_session_only():
    q = arm().random_joints(5, 1)
    points = points_at(q, ["P1", "P2", "P1", "P3", "P2"])
    assert places.places(points).tolist() == [0, 1, 0, 2, 1]
    sessions = np.array(["mon", "mon", "tue", "tue", "tue"], dtype=object)
    assert places.places(replace(points, session=sessions)).tolist() == [0, 1, 2, 3, 4]
    again = replace(points, session=sessions, q=np.vstack([q[:4], q[:1]]))
    assert places.places(again).tolist() == [0, 1, 2, 3, 0]


@given(st.lists(st.tuples(st.integers(0, 6), st.integers(0, 2)), min_size=1, max_size=14))
def test_places_by_all_pairs(stops):
    q = np.array([[0.6 * HUNDREDTH * a, 0.3 * b] for a, b in stops])
    near = (np.abs(q[:, None] - q[None]).max(axis=2) <= HUNDREDTH).astype(int)
    joined = np.linalg.matrix_power(near, len(q)) > 0
    found = places.of_joints(q)
    np.testing.assert_array_equal(found[:, None] == found[None], joined)
    first = [found.tolist().index(k) for k in range(found.max() + 1)]
    assert first == sorted(first)


def test_copies_and_repeats_are_told():
    q = np.repeat(arm().random_joints(6, 3), 2, axis=0)
    points = points_at(q)
    assert places.copies(points) == 0
    assert places.notes(points)[0].startswith("The 12 poses are 6 places")
    copied = replace(points, xyz=np.repeat(points.xyz.reshape(6, 2, 3, 3)[:, 0], 2, axis=0).reshape(-1, 3))
    assert places.copies(copied) == 18
    assert "18 points stand in the measurements again" in places.notes(copied)[1]
    assert places.notes(points_at(q[::2])) == []


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
    monkeypatch.setattr(pipeline, "places", apart)
    monkeypatch.setattr(fit, "places", apart)
    flattered = np.mean([claimed_over_true(seed) for seed in seeds], axis=0)
    assert (flattered < 0.85 * honest).all()
