"""Series of one-joint moves: circles, errors, payloads, stiffness."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from moving import moves, simulated, there_and_back

import irbcal
from irbcal.errors import IdentificationError
from irbcal.joint_analysis.behaviour import JointBehaviour
from irbcal.joint_analysis.moves import analyse_moves
from irbcal.joint_analysis.series import equivalent_error, home_poses, payload_effects
from irbcal.measurement.column_names import JOINTS
from irbcal.measurement.motions import last_moves
from irbcal.measurement.points import PointSet
from irbcal.modeling.stiffness import Stiffness


def test_a_circle_by_hand():
    # one reflector at 0, 90, 180, 270 degrees and back; 2 um outwards and inwards in turn, 3 um up and down in turn,
    # 40 urad behind the command on the way up, ahead on the way back: none of it bends a circle through all points
    angle = np.radians([0, 90, 180, 270, 270, 180, 90, 0])
    turn = np.array([1, -1, 1, -1, -1, 1, -1, 1])
    actual = angle + 40e-6 * np.array([-1, -1, -1, -1, -1, 1, 1, 1])
    actual[4] = angle[4] - 40e-6  # measured twice at the top: still reached from below
    radius = 0.5 + 2e-6 * turn
    xyz = np.column_stack([radius * np.cos(actual), radius * np.sin(actual), 1.0 + 3e-6 * turn])
    q = moves(3, angle)
    points = PointSet(q, np.arange(8), np.zeros(8, int), xyz, ("smr",), np.arange(8), np.full(8, "axis3", object))
    (joint,) = analyse_moves(points, last_moves(q, points.groups))
    (series,) = joint.series
    assert series.direction.tolist() == [0, 1, 1, 1, 1, -1, -1, -1]
    assert np.abs(series.radial - 2e-6 * turn).max() < 1e-9
    assert np.abs(series.axial - 3e-6 * turn).max() < 1e-9
    assert np.abs(series.angle - 40e-6 * np.array([-1, -1, -1, -1, -1, 1, 1, 1])).max() < 2e-8
    assert np.abs(series.tangential - 0.5 * series.angle).max() < 1e-9
    assert series.zero == 0.0
    # the top was reached from below only, the start from above and from nobody knows where: two angles are not enough
    assert joint.backlash.note == "2 joint angles were reached from both sides, 3 are needed"
    assert joint.fourier.note == "4 joint angles are too few for order 2: 8 are needed"


def test_a_point_far_from_its_circle_is_left_out_and_named():
    q = moves(5, there_and_back(-90, 90, 15))
    points, step, _ = simulated(q, np.full(len(q), "axis5", object), noise=1e-5, rng=np.random.default_rng(3))
    xyz = points.xyz.copy()
    xyz[10] += [0.0, 0.004, 0.003]
    (joint,) = analyse_moves(replace(points, xyz=xyz), step)
    ((pose, target, off),) = joint.series[0].excluded
    assert (pose, target) == ("3", "smr2")
    assert off > 1e-3
    assert joint.series[0].fit.rms < 3e-5


def test_stiffness_as_one_angle():
    L_1, L_2 = 0.7, 0.6

    def wrist(q2, q3):
        return L_1 * np.exp(1j * q2) + L_2 * np.exp(1j * (q2 + q3 + np.pi / 2))

    for guess in (Stiffness.guess(L_1, L_2), Stiffness(1.8e-3, 0.3, 0.9, 2.0, L_1, L_2)):
        A, B = guess.coefficients
        # stretched, all the way down: eq. 5.16
        found = equivalent_error([np.pi / 2], -np.pi / 2, (A, B), (0, np.pi / 2), (L_1, L_2))
        assert np.sin(found[0]) * (L_1 + L_2) == pytest.approx(guess.delta_L, rel=1e-5)
        # any elbow: the wrist of a plane arm with both joints bent, moved along its circle about joint 2
        for elbow in np.radians([30, 0, -60]):
            q2 = np.radians([-70.0, 25.0, 50.0])

            bent_3 = B * np.cos(q2 + elbow)
            at_zero_3 = B * np.cos(elbow)
            bent = wrist(q2 + A * np.sin(q2) + bent_3, elbow + bent_3) / wrist(q2, elbow)
            at_zero = wrist(at_zero_3, elbow + at_zero_3) / wrist(0.0, elbow)
            expected = np.angle(bent / at_zero)
            found = equivalent_error(q2, elbow, (A, B), (0, np.pi / 2), (L_1, L_2))
            assert found == pytest.approx(expected, abs=3e-6)


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
    points = PointSet(
        q, np.arange(n), np.zeros(n, int), xyz, ("smr1",), np.arange(n), groups, inputs={"payload_kg": kg}
    )
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
    assert plain["home"] == dict.fromkeys(JOINTS, 0.0) | {"q2_deg": None, "q5_deg": pytest.approx(30.0)}


@pytest.mark.parametrize("columns", [("q1_mm", "q2_deg"), ("q1_deg", "q2_deg"), ("q1_mm", *JOINTS[1:], "q7_deg")])
def test_other_joints_have_their_units_and_other_arms_no_elbow(columns, tmp_path):
    """A reflector on a circle about joint 2, with two payloads; the joint before it stands at 1023.6 (mm or degrees)."""
    rows = pd.DataFrame(0.0, range(2 * len(ANGLES)), [*columns, "x_mm", "y_mm", "z_mm"])
    rows["payload_kg"] = kg = np.repeat([1.8, 4.8], len(ANGLES))
    turn = np.tile(ANGLES, 2)
    rows[columns[0]], rows["q2_deg"] = 1023.6, np.degrees(turn)
    turn = turn + 1e-4 * kg * np.sin(turn)
    rows["x_mm"], rows["y_mm"], rows["z_mm"] = 1200.0 * np.cos(turn), 1200.0 * np.sin(turn), 300.0
    rows = rows.assign(pose=range(1, len(rows) + 1), target="smr1", group="axis2")
    found = irbcal.joints(rows, plots=tmp_path / "figures")
    assert not [name for name in found.plots if "stiffness" in name]
    plain = found.to_dict()
    for home in (plain["payloads"][0]["home"], plain["moves"][0]["series"][0]["home"]):
        assert home == dict.fromkeys(columns, 0.0) | {columns[0]: pytest.approx(1023.6), "q2_deg": None}
    assert ("1023.6 mm, –" if columns[0] == "q1_mm" else "1023.6, –") in found.summary()
    rows[columns[0]] = np.linspace(1000.0, 1010.0, len(rows))
    unit = "mm" if columns[0] == "q1_mm" else "degrees"
    with pytest.raises(IdentificationError, match=f"group axis2: joint 1 moves by 10 {unit}"):
        irbcal.joints(rows)


@pytest.mark.parametrize(("column", "turns"), [("q1_mm", False), ("q1_deg", True)])
def test_a_whole_turn_is_the_same_home_pose_of_a_joint_that_turns_only(column, turns):
    columns = (column, *JOINTS[1:])
    q = np.repeat(np.array([[0.0, 0, 0, 0, 0, 0], [2 * np.pi, 0, 0, 0, 0, 0]]), 3, axis=0)
    q[:, 1] = [0.0, 0.1, 0.2] * 2
    homes = home_poses(q, np.ones(6, dtype=bool), 2, "axis2", columns)
    assert [mask.tolist() for mask in homes] == (
        [[True] * 6] if turns else [[True] * 3 + [False] * 3, [False] * 3 + [True] * 3]
    )
    points, step = bent({1.8: 2e-3, 4.8: 2.5e-3})
    first, second = analyse_moves(points, step, columns=columns)[0].series
    assert bool(payload_effects([first, replace(second, q=second.q + q[5] * [1, 0, 0, 0, 0, 0])])) == turns


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
        inputs={"payload_kg": np.repeat([1.8, 4.8], n)},
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
