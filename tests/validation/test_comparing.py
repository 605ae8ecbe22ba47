"""Calibrations side by side: the same figures as evaluations one by one, fitted poses of all left out."""

import json
import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from support import arm, measured, random_robot, with_thesis
from typer.testing import CliRunner

import irbcal
from irbcal.cli.main import app
from irbcal.correction.fake_targets import correct_joints
from irbcal.errors import MeasurementError, OptionError
from irbcal.io import robots
from irbcal.modeling.joint_map import JointMap
from irbcal.validation import accuracy
from irbcal.validation.comparing import Pair

FIT = robots.demo_file("demo_identification.csv")


@pytest.fixture(scope="module")
def proof(tmp_path_factory):
    table = pd.read_csv(robots.demo_file("demo_verification.csv"))
    table["operator"] = "of " + table["pose"].astype(str)
    path = tmp_path_factory.mktemp("compare") / "v.csv"
    table[table["pose"].isin(table["pose"].unique()[::10])].to_csv(path, index=False)
    return path


@pytest.fixture(scope="module")
def three(calibrated, tmp_path_factory):
    root = tmp_path_factory.mktemp("three")
    return [calibrated(root / f"m_{model}&", model) for model in ("11", "34", "26")]


@pytest.fixture(scope="module")
def found(three, proof):
    return irbcal.compare(three, proof)


def test_figures_are_those_of_evaluations(three, proof, found):
    assert found.names == ("m_11&", "m_34&", "m_26&")
    for k, folder in enumerate(three):
        one = irbcal.evaluate(folder, proof)
        mine = found.statistics[found.names[k]]
        assert mine["mean_mm"] == pytest.approx(one.calibrated["mean_mm"], abs=1e-12)
        assert mine["p95_mm"] == pytest.approx(one.percentiles["calibrated"]["p95_mm"], abs=1e-12)
        table = one.to_frame()
        means = table.groupby("pose", sort=False)["calibrated_mm"].mean()
        assert found.error_mm[:, k] == pytest.approx(means.loc[list(found.poses)].to_numpy(), abs=1e-12)
    assert found.statistics["nominal"]["mean_mm"] == pytest.approx(one.nominal["mean_mm"], abs=0.02)
    assert found.trusted


def test_the_verdict_names_the_best(found):
    assert found.ranking[0] == "m_34&"
    words = found.verdict()
    assert words.startswith("On these 100 SIMULATED poses m_34& has the smallest mean error")
    assert "better than m_11& by" in words
    best = {(pair.better, pair.worse): pair for pair in found.pairs}["m_34&", "m_11&"]
    assert best.significant
    low, high = best.interval_mm
    assert low < best.difference_mm < high
    gain = found.error_mm[:, 0] - found.error_mm[:, 1]
    assert best.difference_mm == pytest.approx(gain.mean(), abs=1e-12)
    # three intervals at once are wider than one of 95 %, about as normal quantiles tell (2.394 against 1.960)
    assert high - low == pytest.approx(2 * 2.394 * gain.std(ddof=1) / np.sqrt(len(gain)), rel=0.15)


def test_one_and_the_same_is_not_told_apart(three, proof):
    twice = irbcal.compare({"a": three[1], "b": three[1]}, proof)
    assert "not distinguishable from b" in twice.verdict()
    assert not twice.pairs[0].significant


def test_fitted_poses_of_any_are_counted_out(three):
    table = pd.read_csv(FIT)
    half = table["pose"].unique()[1::2]
    other = irbcal.calibrate(table[table["pose"].isin(half)], "irb1600", "26", holdout=0)
    pair = {"one": three[0], "half": other}
    known = {
        str(name)
        for record in (irbcal.load(three[0]).record, other.record)
        for name, heldout in zip(record.poses.pose, record.poses.heldout, strict=True)
        if not heldout
    }
    found = irbcal.compare(pair, FIT)
    assert known.isdisjoint(found.poses)
    assert found.counted_out == len(known)
    kept = irbcal.compare(pair, FIT, include_fitted=True)
    assert set(kept.fitted_by) == {"one", "half"}
    assert kept.verdict().startswith("NO PROOF")
    assert not kept.trusted
    fitted = table[table["pose"].astype(str).isin(other.record.poses.pose)]
    with pytest.raises(MeasurementError, match=r"calibration half: .*prove nothing"):
        irbcal.compare(pair, fitted)


def test_names_and_wrong_calls(three, proof):
    assert irbcal.compare([three[0], three[0], irbcal.load(three[1])], proof).names[0] == "m_11&"
    for wrong in (three[0], [three[0]], {}, {"nominal": three[0], "b": three[1]}):
        with pytest.raises(OptionError, match="calibrations"):
            irbcal.compare(wrong, proof)


def test_the_command_and_its_files(three, proof, tmp_path):
    call = ["compare", *three, "--measurements", proof]
    files = ["--csv", tmp_path / "c.csv", "--latex", tmp_path / "c.tex", "--plots", tmp_path / "p"]
    done = CliRunner().invoke(app, [str(word) for word in [*call, *files]])
    assert done.exit_code == 0, done.output
    assert "SIMULATED data: position errors" in done.stdout
    rows = pd.read_csv(tmp_path / "c.csv")
    assert list(rows) == ["pose", "group", "m_11&_mm", "m_34&_mm", "m_26&_mm", "simulated", "operator"]
    assert (rows["operator"] == "of " + rows["pose"].astype(str)).all()
    text = (tmp_path / "c.tex").read_text()
    assert r"m\_34\& (34)" in text
    assert not re.search(r"(?<!\\)[_%]", text.replace("% irbcal: SIM", "SIM"))
    assert {path.name for path in (tmp_path / "p").iterdir()} == {"by_pose.png", "shares.png"}
    found = json.loads(CliRunner().invoke(app, [str(word) for word in [*call, "--json"]]).stdout)
    assert found["ranking"][0] == "m_34&"
    assert len(found["per_pose"]["pose"]) == found["poses"] == 100
    alone = CliRunner().invoke(app, ["compare", str(three[0]), "--measurements", str(proof)])
    assert alone.exit_code == 2


def test_better_and_not_told_apart():
    rng = np.random.default_rng(0)
    first, place = 1e-3 * (1 + 0.1 * rng.random(40)), np.arange(40)
    better = Pair.from_errors("B", "A", np.full(40, 1e-4), place)
    assert better.difference_mm == pytest.approx(0.1, abs=1e-12)
    assert better.significant
    assert better.sentence().startswith("better than A by 0.100 mm")
    same = Pair.from_errors("B", "A", 1e-4 * rng.standard_normal(40), place)
    assert not same.significant
    assert "not distinguishable from A" in same.sentence()
    few = Pair.from_errors("B", "A", first[:4], place[:4])
    assert few.interval_mm is None
    assert "too few" in few.sentence()
    repeats = Pair.from_errors("B", "A", first, place // 10)
    assert repeats.interval_mm is None, "repeats of a place are one"


def test_an_interval_that_touches_zero_tells_nothing():
    for low in (-0.1, 0.0):
        assert not Pair("B", "A", 0.1, (low, 0.3)).significant
    assert Pair("B", "A", 0.3, (0.1, 0.5)).sentence() == "better than A by 0.300 mm (0.100 to 0.500 mm)"


def test_verified_errors_of_a_perfect_calibration_are_zero_and_expected_ones_too():
    nominal = arm()
    robot = random_robot(nominal, "34", np.random.default_rng(4))
    q = 0.5 * nominal.random_joints(30, 1)
    corrected = correct_joints(robot, nominal, q)
    keep = corrected.ok
    assert keep.sum() > 25
    expected = measured(robot, q[keep])
    verified = measured(robot, corrected.q[keep])
    found = accuracy.expected_and_verified(robot, nominal, expected, verified)
    assert found["expected"]["max_mm"] < 1e-9
    assert found["verified"]["max_mm"] < 1e-5, "fake targets are found to 1e-10 m at the tip"
    assert found["command_mm"] < 1e-5
    assert found["uncorrected"]["mean_mm"] > 0.1


def test_verified_errors_of_an_imperfect_calibration_are_like_the_expected_ones():
    """Section 7.6: what the calibrated model misses by at the uncorrected poses is what verification finds."""
    nominal = arm()
    truth = random_robot(nominal, "34", np.random.default_rng(4))
    robot = random_robot(nominal, "11", np.random.default_rng(4), targets=truth.targets)
    robot = robot.replace(T_world_base=truth.T_world_base)
    q = 0.5 * nominal.random_joints(200, 1)
    corrected = correct_joints(robot, nominal, q)
    expected, verified = measured(truth, q[corrected.ok]), measured(truth, corrected.q[corrected.ok])
    found = accuracy.expected_and_verified(robot, nominal, expected, verified)
    assert found["poses"] == {"expected": expected.poses, "verified": verified.poses, "set_aside": []}
    assert found["verified"]["mean_mm"] == pytest.approx(found["expected"]["mean_mm"], rel=0.03)
    assert found["verified"]["max_mm"] == pytest.approx(found["expected"]["max_mm"], rel=0.05)
    strangers = replace(verified, pose_ids=np.array([f"x{k}" for k in range(verified.poses)]))
    with pytest.raises(MeasurementError, match="no pose of the same name"):
        accuracy.expected_and_verified(robot, nominal, expected, strangers)


def corrected_poses(poses=30):
    """A perfect calibration: measurements, and a verification at its fake targets."""
    nominal = arm()
    robot = random_robot(nominal, "34", np.random.default_rng(4))
    q = 0.5 * nominal.random_joints(poses, 1)
    found = correct_joints(robot, nominal, q)
    groups = np.where(np.arange(found.ok.sum()) % 2, "a", "b")
    expected, verified = (measured(robot, joints[found.ok], groups=groups) for joints in (q, found.q))
    return robot, nominal, expected, verified


def test_commands_that_are_no_fake_targets_are_set_aside():
    """Unless they are the larger part: then the whole run was made with other fake targets."""
    robot, nominal, expected, verified = corrected_poses()
    off = verified.q.copy()
    off[3] += np.radians(0.05)
    found = accuracy.expected_and_verified(robot, nominal, expected, replace(verified, q=off))
    assert found["poses"]["set_aside"] == ["3"]
    assert found["poses"]["verified"] == verified.poses - 1
    assert found["command_mm"] < 1e-5
    assert found["verified"]["max_mm"] < 1e-5
    half = verified.poses // 2
    off = verified.q.copy()
    off[half:] += np.radians(0.05)
    found = accuracy.expected_and_verified(robot, nominal, expected, replace(verified, q=off))
    assert found["poses"]["set_aside"] == []
    wanted = robot.replace(arm=nominal, joint_map=JointMap.identity(nominal)).poses(expected.q)[:, :3, 3]
    apart = np.linalg.norm(robot.poses(off)[:, :3, 3] - wanted, axis=1)
    assert found["command_mm"] == pytest.approx(apart.max() * 1e3, abs=1e-6)


def test_the_meant_robot_has_the_nominal_arm_and_no_joint_map():
    nominal = arm()
    robot = random_robot(nominal, "34", np.random.default_rng(4))
    robot = robot.replace(joint_map=with_thesis(robot.joint_map, gain=np.full(6, 0.01)))
    q = nominal.random_joints(5, 0)
    meant = accuracy.replace_geometry(robot, nominal)
    assert np.abs(meant.poses(q) - nominal.forward(q)).max() < 1e-14
    assert np.array_equal(meant.T_world_base, robot.T_world_base)
    assert list(meant.targets) == list(robot.targets)


@pytest.mark.parametrize(("away", "aside"), [(0.09, 0), (0.11, 1)])
def test_a_tenth_of_a_millimetre_is_the_same_command(away, aside):
    robot, nominal, expected, verified = corrected_poses()
    # the command misses by so much where joint 1 turns by that over the tip's distance from its axis
    q = verified.q.copy()
    q[0, 0] += away * 1e-3 / np.linalg.norm(robot.poses(q[:1])[0, :2, 3])
    found = accuracy.expected_and_verified(robot, nominal, expected, replace(verified, q=q))
    assert len(found["poses"]["set_aside"]) == aside


def test_groups_and_poses_that_one_of_both_lacks():
    robot, nominal, expected, verified = corrected_poses()
    some = verified.select(np.arange(verified.poses) >= 5)
    strange = replace(some, pose_ids=np.array([f"x{k}" if k == 7 else k for k in some.pose_ids], dtype=object))
    found = accuracy.expected_and_verified(robot, nominal, expected, strange)
    assert found["poses"]["verified"] == some.poses - 1
    assert found["expected"]["n"] == found["uncorrected"]["n"] == found["verified"]["n"], "of the same poses"
    parts = found["per_group"]
    assert list(parts) == ["a", "b"]
    assert parts["a"]["verified"]["n"] + parts["b"]["verified"]["n"] == found["verified"]["n"]
    assert [row["n"] for row in parts["a"].values()] == [parts["a"]["verified"]["n"]] * 3
