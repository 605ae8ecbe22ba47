"""Repeats of a stop against means by hand."""

from dataclasses import replace

import numpy as np
from evidence_cases import Truth
from hypothesis import given
from hypothesis import strategies as st

from irbcal.identification.evidence import average_repeats, identify_evidence
from irbcal.measurement.points import PointSet
from irbcal.modeling.terms.situation import Motion


def test_repeats_of_a_stop_are_averaged():
    truth = Truth(["gravity"])
    motion = Motion(np.repeat(truth.nominal.random_joints(30, 3), 3, axis=0))
    points = truth.measured(motion, 3e-5)
    merged, shorter = average_repeats(points, motion)
    assert merged.poses == len(shorter) == 30
    expected = points.xyz.reshape(30, 3, 3, 3).mean(axis=1).reshape(-1, 3)
    np.testing.assert_allclose(merged.xyz, expected, atol=1e-12)
    assert identify_evidence(truth.nominal, points, motion, gear_scan=False).poses == 30


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
    motion = Motion(q, move, np.arange(n, dtype=float), np.full(n, 2.0))
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
    motion = Motion(q, payload_kg=np.tile([1.0, 2.0], 4))
    points = truth.measured(motion, 1e-5)
    assert average_repeats(points, motion)[0].poses == 8
    once = replace(motion, payload_kg=np.ones(8), torques=np.arange(48.0).reshape(8, 6))
    told = replace(points, payload_kg=np.ones(8), payload_place=np.tile([0.0, 0.0, 0.1], (8, 1)), torques=once.torques)
    merged, shorter = average_repeats(told, once)
    assert merged.poses == len(merged.payload_kg) == len(merged.payload_place) == 4
    np.testing.assert_allclose(shorter.torques, once.torques.reshape(4, 2, 6).mean(axis=1), rtol=1e-14)
    apart = replace(once, payload_place=np.arange(24.0).reshape(8, 3))
    assert average_repeats(told, apart)[0].poses == 8
    turned = replace(points, rotation=np.tile(np.eye(3), (len(points), 1, 1)))
    assert average_repeats(turned, Motion(q))[0] is turned
    assert average_repeats(points, Motion(q))[0].poses == 4
