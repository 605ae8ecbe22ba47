"""What a fit says of its own certainty, against simulation."""

import numpy as np
import pytest
from support import arm, measured, random_robot

from irbcal.errors import IdentificationError
from irbcal.identification.fit import identify
from irbcal.modeling.parameters import selected_parameters
from irbcal.modeling.thesis_map import ThesisMap


def test_intervals_hold_the_truth_in_95_of_100_cases():
    """300 noisy repetitions: every identified parameter and a predicted position, value +- 1.96 standard deviations."""
    nominal = arm()
    truth = random_robot(nominal, "34", np.random.default_rng(1), size=0.1)
    q, there = nominal.random_joints(60, 1), nominal.random_joints(1, 9)
    clean = identify(nominal, measured(truth, q), "34")
    true = {row.name: row.value for row in clean.parameters() if row.state == "identified"}
    at = truth.points(there, "smr1")[0]
    hits, total, inside = 0, 0, 0
    rng = np.random.default_rng(2)
    for _ in range(300):
        fit = identify(nominal, measured(truth, q, 5e-5, rng), "34")
        for row in fit.parameters():
            # L_G2 is a ratio of two small numbers and far from normal; A and B carry the same information
            if row.name in true and row.name != "stiffness_L_G2":
                total += 1
                hits += abs(row.value - true[row.name]) < 1.96 * row.std
        std = np.sqrt(np.diag(fit.predicted_covariance(there, "smr1")[0]))
        inside += (np.abs(fit.robot.points(there, "smr1")[0] - at) < 1.96 * std).sum()
    assert total > 300 * 35
    assert 0.93 < hits / total < 0.97
    assert 0.93 < inside / 900 < 0.97


def test_singular_values_and_indices_by_hand():
    """Against the singular values of the explicit Jacobian projected off base and targets."""
    nominal = arm()
    truth = random_robot(nominal, "34", np.random.default_rng(3))
    fit = identify(nominal, measured(truth, nominal.random_joints(50, 1), 3e-5, np.random.default_rng(4)), "34")
    information, problem = fit.solution.information, fit.problem
    J = problem.jacobian(fit.solution.state)
    scale = np.array([p.scale for p in problem.parameters])
    base = J[:, : problem.outer]
    rest = J[:, problem.outer :] * scale
    rest -= base @ np.linalg.lstsq(base, rest, rcond=None)[0]
    s = np.linalg.svd(rest, compute_uv=False)
    seen = information.seen.sum()
    assert seen == 23
    assert np.abs(information.singular_values[:seen] / s[:seen] - 1).max() < 1e-4
    s = s[:seen]
    found = information.indices(50)
    assert found["O1"] == pytest.approx(np.prod(s) ** (1 / seen) / np.sqrt(50), rel=1e-3)
    assert found["O2"] == pytest.approx(s[-1] / s[0], rel=1e-3)
    assert found["O3"] == pytest.approx(s[-1], rel=1e-3)
    assert found["O4"] == pytest.approx(s[-1] ** 2 / s[0], rel=1e-3)
    assert found["O5"] == pytest.approx(1 / (1 / s).sum(), rel=1e-3)
    assert found["condition"] == pytest.approx(s[0] / s[-1], rel=1e-3)


def test_correlated_pairs_are_named():
    """With joint 2 moving little, its offset and the stiffness of the upper arm look alike."""
    nominal = arm()
    truth = random_robot(nominal, "34", np.random.default_rng(5))
    q = nominal.random_joints(80, 1)
    q[:, 1] = 0.2 * np.sin(q[:, 1])
    fit = identify(nominal, measured(truth, q, 1e-5, np.random.default_rng(6)), "34")
    names = [p.name for p in fit.problem.parameters]
    pairs = [(names[i], names[j], c) for i, j, c in fit.solution.information.correlations(0.9)]
    assert pairs == sorted(pairs, key=lambda pair: -abs(pair[2]))
    assert all(abs(c) > 0.9 for *_, c in pairs)
    assert any("delta_theta2" in pair or "stiffness_A" in pair for pair in pairs)
    everywhere = identify(nominal, measured(truth, nominal.random_joints(80, 1), 1e-5, np.random.default_rng(6)), "34")
    assert abs(everywhere.solution.information.correlations(0.5)[0][2]) < abs(pairs[0][2]) - 0.03


def test_single_parameters_are_freed_and_held_by_name():
    names = [p.name for p in selected_parameters("11", free=["gain*", "delta_a3"], hold=["gain1", "delta_theta6"])]
    assert names == [
        "delta_theta2",
        "delta_theta3",
        "delta_theta4",
        "delta_theta5",
        *(f"gain{i}" for i in range(2, 7)),
        "delta_a3",
    ]
    with pytest.raises(IdentificationError, match="no error parameter is called 'delta_q3'"):
        selected_parameters("11", free=["delta_q3"])
    with pytest.raises(IdentificationError, match="no error parameter is called 'gian'"):
        selected_parameters("11", hold=["gian"])


def test_joint_gains_are_identified_on_any_level():
    nominal = arm()
    rng = np.random.default_rng(7)
    truth = random_robot(nominal, "11", rng)
    gains = np.array([1e-3, -5e-4, 8e-4, 3e-4, -2e-4, 4e-4])
    truth = truth.replace(joint_map=ThesisMap(gain=gains).joint_map(truth.joint_map.terms.arm))
    chosen = selected_parameters("11", free=["gain*"])
    fit = identify(nominal, measured(truth, nominal.random_joints(60, 1)), "11", parameters=chosen)
    rows = {row.name: row for row in fit.parameters()}
    assert [abs(rows[f"gain{i + 1}"].value - gains[i]) < 1e-9 for i in range(6)] == [True] * 6


def test_level_34b_finds_the_tilt_between_parallel_axes():
    nominal = arm()
    rng = np.random.default_rng(8)
    truth = random_robot(nominal, "34b", rng)
    fit = identify(nominal, measured(truth, nominal.random_joints(80, 1)), "34b")
    rows = {row.name: row for row in fit.parameters()}
    assert rows["delta_beta3"].state == "identified"
    assert abs(np.radians(rows["delta_beta3"].value) - truth.table.beta[2]) < 1e-9
    assert rows["delta_d2"].state == "identified"
    q = nominal.random_joints(200, 2)
    assert np.abs(fit.robot.points(q, "smr1") - truth.points(q, "smr1")).max() < 1e-9
