"""Two payloads compared: a joint that bends by known amounts, and pairs that are none."""

from dataclasses import replace

import numpy as np
import pytest
from moving import moves, simulated, there_and_back

from irbcal.joint_behaviour.behaviour import JointBehaviour
from irbcal.joint_behaviour.moves import analyse_moves
from irbcal.joint_behaviour.payloads import payload_effects
from irbcal.measurement.last_moves import last_moves
from irbcal.measurement.points import PointSet

ANGLES = there_and_back(-90, 90, 10)


def bent(amounts, radius=1.2, height=0.3, drop=0.0):
    """One reflector that joint 2 turns about z and that lags by amount * sin(angle); a series for each payload."""
    q = np.vstack([moves(2, ANGLES)] * len(amounts))
    kg = np.repeat(list(amounts), len(ANGLES))
    turn = q[:, 1] + np.concatenate([amount * np.sin(ANGLES) for amount in amounts.values()])
    xyz = np.column_stack([radius * np.cos(turn), radius * np.sin(turn), np.full(len(q), height)])
    xyz[:, 2] -= np.where(kg == max(amounts), drop, 0.0)
    n = len(q)
    groups = np.full(n, "axis2", object)
    points = PointSet(q, np.arange(n), np.zeros(n, int), xyz, ("smr1",), np.arange(n), groups, payload_kg=kg)
    return points, last_moves(q, groups)


def test_table_4_3_by_hand():
    points, step = bent({1.8: 2e-3, 4.8: 2.5e-3}, drop=1e-3)
    (joint,) = analyse_moves(points, step)
    assert [s.payload_kg for s in joint.series] == [1.8, 4.8]
    (effect,) = payload_effects(joint.series)
    assert (effect.joint, effect.target, effect.light_kg, effect.heavy_kg) == (2, "smr1", 1.8, 4.8)
    # at 90 degrees it lags by the whole amount; neither moves the circle
    assert effect.light == pytest.approx(1.2 * 2e-3, rel=1e-5)
    assert effect.heavy == pytest.approx(1.2 * 2.5e-3, rel=1e-5)
    assert effect.shift == pytest.approx(np.hypot(1.2 * 0.5e-3, 1e-3), rel=1e-5), "what the circles do not show"
    found = JointBehaviour("moves.csv", True, (joint,), None)
    assert "SIMULATED data: Largest errors with two payloads" in found.summary()
    (plain,) = found.to_dict()["payloads"]
    assert plain["difference_mm"] == pytest.approx(0.6, rel=1e-5)
    assert plain["home_deg"][1] is None


def test_a_bending_arm_with_two_loads_and_noise():
    """Of a robot whose stiffness model bends half as much again: the shift is that of its own kinematics."""
    q = moves(2, ANGLES, (0, 0, -90, 0, 0, 0))
    groups = np.full(len(q), "axis2", object)
    parts = []
    for seed, factor in enumerate((1.0, 1.5)):
        stiffness = tuple(factor * np.array([8e-4, 5e-4]))
        parts.append(simulated(q, groups, noise=1e-6, rng=np.random.default_rng(seed), stiffness=stiffness)[0])
    n = len(q)
    both = replace(
        parts[0],
        q=np.vstack([q, q]),
        pose=np.concatenate([parts[0].pose, parts[1].pose + n]),
        target=np.concatenate([p.target for p in parts]),
        xyz=np.vstack([p.xyz for p in parts]),
        pose_ids=np.arange(2 * n),
        groups=np.concatenate([groups, groups]),
        payload_kg=np.repeat([1.8, 4.8], n),
    )
    (effect,) = payload_effects(analyse_moves(both, last_moves(both.q, both.groups))[0].series)
    mine = parts[0].names() == effect.target
    direct = np.linalg.norm(parts[1].xyz[mine] - parts[0].xyz[mine], axis=1)
    assert effect.shift == pytest.approx(direct[1:].max(), abs=1e-5)
    assert effect.heavy > 1.2 * effect.light


def test_other_homes_joints_and_untold_loads_are_not_compared():
    points, step = bent({1.8: 2e-3, 4.8: 2.5e-3})
    series = analyse_moves(points, step)[0].series
    assert payload_effects([series[0], replace(series[1], joint=3)]) == ()
    assert payload_effects([series[0], replace(series[1], payload_kg=float("nan"))]) == ()
    elsewhere = series[1].q + np.array([0, 0, 0.2, 0, 0, 0])
    assert payload_effects([series[0], replace(series[1], q=elsewhere)]) == ()
    assert payload_effects([series[0], replace(series[1], payload_kg=1.8)]) == ()
