"""What an identification by evidence says: predictions with intervals against sampling, words, tables."""

import pickle
from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest
from evidence_cases import Truth, moves
from support import assert_same_poses

from irbcal.identification.evidence import identify_evidence
from irbcal.modeling import frames
from irbcal.modeling.terms.geometry import DHM_COLUMNS
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term_map import TermMap


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
    known, unknown = found.predict(test.q, test.q - test.moves), found.predict(test.q)
    assert (unknown.interval > known.interval).all()
    assert np.abs(unknown.position - known.position).max() > 1e-5
    assert (np.abs(unknown.position - known.position) < unknown.interval).mean() > 0.9


def test_joints_outside_the_ranges_of_the_fit_are_marked():
    truth = Truth(["gravity"])
    motion = Motion(0.3 * truth.nominal.random_joints(40, 3))
    found = identify_evidence(truth.nominal, truth.measured(motion, 2e-5), motion, gear_scan=False)
    q = np.array([motion.q[0], motion.q[0] + np.array([0, 0, 0, 3.0, 0, 0])])
    np.testing.assert_array_equal(found.predict(q).outside, [False, True])


def test_predictions_are_forward_kinematics(found, test_motion):
    q, previous = test_motion.q, test_motion.q - test_motion.moves
    T = found.T_world_base @ found.poses_at(q, previous)
    assert_same_poses(
        T, found.T_world_base @ found.term_map().forward(found.arm, Motion(q, test_motion.moves)), 0.0, 0.0
    )
    for name, place in found.targets.items():
        expected = T[:, :3, :3] @ place + T[:, :3, 3]
        np.testing.assert_allclose(found.predict(q, previous, name).position, expected, rtol=0, atol=1e-13)


def test_covariance_is_that_of_sampled_robots(found, test_motion):
    # base, targets, constants and terms drawn from the posterior; each robot predicts by its own kinematics
    q, previous = test_motion.q, test_motion.q - test_motion.moves
    rng = np.random.default_rng(4)
    L = np.linalg.svd(found.covariance)
    draws = (L[0] * np.sqrt(np.maximum(L[1], 0.0))) @ rng.standard_normal((len(found.covariance), 400))
    flat = len(found.covariance) - len(found.terms)
    name = found.free_targets[1]
    rows = [k for k, t in enumerate(found.terms) if t.family not in ("geometry", "warm_up")]
    out = []
    for d in draws.T:
        columns = {key: getattr(found.arm.table, key).copy() for key in DHM_COLUMNS.values()}
        for t, step in zip(found.terms, d[flat:], strict=True):
            if t.family == "geometry":
                columns[DHM_COLUMNS[t.axis]][t.joint] += step
        arm = found.arm.with_table(replace(found.arm.table, **columns))
        c = found.coefficients[rows] + d[flat:][rows]
        T = TermMap(found.nominal, tuple(found.terms[k] for k in rows), c).forward(arm, Motion(q, test_motion.moves))
        p = T[:, :3, :3] @ (found.targets[name] + d[9:12]) + T[:, :3, 3]
        turn = frames.transform(None, d[3:6]) @ _turn(d[:3])
        out.append((p @ turn[:3, :3].T + turn[:3, 3]) @ found.T_world_base[:3, :3].T + found.T_world_base[:3, 3])
    sampled = np.array(out)
    seen = found.predict(q, previous, name)
    std = np.sqrt(np.diagonal(seen.covariance, axis1=1, axis2=2))
    np.testing.assert_allclose(sampled.std(axis=0), std, rtol=0.15)
    np.testing.assert_allclose(seen.interval, 1.96 * np.sqrt(std**2 + found.loo[name] ** 2 / 3.0), rtol=1e-9)
    np.testing.assert_allclose(
        found.predict(q, previous, name, in_order=True).interval,
        1.96 * np.sqrt(std**2 + found.loo_blocks[name] ** 2 / 3.0),
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
    assert found.tau is None or "warm_up" in cold


def test_it_says_what_was_compared_and_what_was_seen(found):
    text = found.summary()
    lines = [line.split() for line in text.splitlines() if line]
    assert found.headline().startswith("irb120_3_058, model auto of terms all: ")
    assert found.headline() in text
    for row in found.term_sets:
        assert f"{row.log_evidence:.1f}" in text
    assert next(line for line in lines if line[0] == "geometry")[1] == "45"
    assert float(next(line for line in lines if line[:2] == ["gravity", "2"])[3]) > 3.0
    assert all(0.0 <= row.seen <= row.terms for row in found.groups)
    assert len(repr(found)) < 400
    assert found._repr_html_().count("<table>") == 2


def test_predictions_speak(found, test_motion):
    seen = found.predict(test_motion.q)
    assert repr(seen).startswith("<Prediction: 6 predicted positions: 95 % of a coordinate's errors within 0.")
    frame = seen.to_frame()
    np.testing.assert_allclose(frame[["x_mm", "y_mm", "z_mm"]], 1e3 * seen.position)
    np.testing.assert_allclose(frame["y_u95_mm"], 1e3 * seen.interval[:, 1])
    q = test_motion.q.copy()
    q[0, 3] += 9.0
    assert "1 of them outside" in found.predict(q).summary()


def test_results_are_locked_and_pickled(found, test_motion):
    seen = found.predict(test_motion.q)
    for array in (found.coefficients, found.covariance, seen.position, seen.outside, found.targets["smr1"]):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    with pytest.raises(TypeError):
        found.targets["new"] = np.zeros(3)
    with pytest.raises(FrozenInstanceError):
        found.kind = "joint-map"
    again = pickle.loads(pickle.dumps(found))
    assert again.summary() == found.summary()
    np.testing.assert_array_equal(again.predict(test_motion.q).position, seen.position)
    assert repr(pickle.loads(pickle.dumps(seen))) == repr(seen)
