"""Commanded poses: programmed joints come back, and the evidence says how far to trust them."""

import numpy as np
import pandas as pd
import pytest

import irbcal
from irbcal.errors import MeasurementError
from irbcal.identification import commanded_poses
from irbcal.io.urdf import read_urdf
from irbcal.measurement import table
from irbcal.measurement.table import GOAL_ANGLES, GOAL_POSITIONS, GOAL_QUATERNION
from irbcal.modeling import frames
from irbcal.units import DEG, MM

T_TOOL = frames.transform(frames.rotation_from_vector([0.3, -0.5, 1.2]), [0.05, -0.02, 0.18])
T_BASE = frames.transform(frames.rotation_from_vector([0.0, 0.0, 2.0]), [0.4, 0.1, -0.3])
READING, TRACKER = 0.01 * DEG, 0.02 * MM


@pytest.fixture(scope="module")
def arm():
    return read_urdf("irb1600").arm


def simulated(arm, poses=60, reading=READING, command=0.0, seed=0):
    """SIMULATED: an arm with zero offsets, sent to poses that its controller inverts with the nominal arm.

    Readings err by ``reading``, what the poses say of the programmed joints by ``command`` (radians).
    """
    rng = np.random.default_rng(seed)
    programmed = arm.random_joints(poses, seed) * 0.6
    goal = T_BASE @ arm.forward(programmed + command * rng.standard_normal(programmed.shape)) @ T_TOOL
    q = programmed + reading * rng.standard_normal(programmed.shape)
    offsets = 0.1 * DEG * rng.standard_normal(6)
    T = arm.forward(programmed + offsets)
    xyz = T[:, :3, 3] + T[:, :3, :3] @ [0.05, 0.03, 0.1] + TRACKER * rng.standard_normal((poses, 3))
    data = pd.DataFrame(q / DEG, columns=[f"q{k}_deg" for k in range(1, 7)])
    data = data.assign(pose=np.arange(poses).astype(str), target="smr", simulated="yes")
    data[["x_mm", "y_mm", "z_mm"]] = xyz / MM
    data[list(GOAL_POSITIONS[0])] = goal[:, :3, 3] / MM
    data[list(GOAL_QUATERNION)] = frames.quaternion_from_matrix(goal[:, :3, :3])
    return data, programmed, goal


def test_programmed_joints_come_back(arm):
    """The two transforms are known as well as noise of 60 readings shows them."""
    data, programmed, goal = simulated(arm)
    q = data[[f"q{k}_deg" for k in range(1, 7)]].to_numpy() * DEG
    exact = commanded_poses.commands(arm, programmed, goal)
    np.testing.assert_allclose(exact.T_world_base, T_BASE, rtol=0, atol=1e-9)
    np.testing.assert_allclose(exact.T_flange_tool, T_TOOL, rtol=0, atol=1e-9)
    by_readings = commanded_poses.commands(arm, q, goal)
    error = np.abs(q + by_readings.difference - programmed)
    assert by_readings.solved.mean() > 0.95
    assert np.median(error) < 0.45 * READING  # of readings it is 0.67
    assert error.max() < 6.0 * READING  # near a singularity of the wrist the readings stay
    known = commanded_poses.commands(arm, q, goal, exact)
    assert np.median(np.abs(q + known.difference - programmed)) < 0.02 * READING
    goal[3] = np.nan
    some = commanded_poses.commands(arm, q, goal)
    assert not some.difference[3].any()
    assert list(np.flatnonzero(by_readings.solved & ~some.solved)) == [3]


@pytest.mark.parametrize("turns", [GOAL_QUATERNION, *GOAL_ANGLES])
def test_poses_are_read_as_they_are_written(arm, turns):
    data, _, goal = simulated(arm, 5)
    if turns is not GOAL_QUATERNION:
        rpy = np.array([frames.rpy_from_matrix(T[:3, :3]) for T in goal])
        data = data.drop(columns=list(GOAL_QUATERNION))
        data[list(turns)] = rpy / (DEG if turns[0].endswith("deg") else 1.0)
    np.testing.assert_allclose(commanded_poses.goals(table.read(data)), goal, rtol=0, atol=1e-9)
    with pytest.raises(MeasurementError, match=f"{turns[1]} is missing"):
        commanded_poses.goals(table.read(data.drop(columns=turns[1])))


@pytest.mark.parametrize(
    ("reading", "command", "shares"),
    [(READING, 0.0, (0.85, 1.0)), (0.0, READING, (0.0, 0.15)), (READING, READING, (0.3, 0.7))],
    ids=["readings err", "commands err", "both err alike"],
)
def test_the_evidence_chooses(arm, reading, command, shares):
    """Held-out errors with commands are never larger than without; the share is that of the two variances."""
    data, _, _ = simulated(arm, 120, 3 * reading, 3 * command, 5)
    with_goals = irbcal.calibrate(data, "irb1600", model="11")
    without = irbcal.calibrate(
        data.drop(columns=[name for name in data if name.startswith("goal_")]), "irb1600", model="11"
    )
    note = next(note for note in with_goals.record.notes if "commanded poses give" in note)
    share = 0.0 if "the readings are taken" in note else float(note.split("%")[0].split()[-1]) / 100
    assert shares[0] <= share <= shares[1]
    mean, mean_without = (result.record.heldout.all.mean_mm for result in (with_goals, without))
    assert mean <= mean_without * 1.05
    if command == 0.0:
        assert mean < 0.5 * mean_without


def test_poses_of_another_file_are_not_taken(arm):
    data, _, _ = simulated(arm, 40)
    shuffled = data.copy()
    columns = [*GOAL_POSITIONS[0], *GOAL_QUATERNION]
    shuffled[columns] = data[columns].sample(frac=1.0, random_state=1).to_numpy()
    result = irbcal.calibrate(shuffled, "irb1600", model="11")
    assert any("Commanded poses do not belong to these joints" in note for note in result.record.notes)


def test_real_commands_are_as_good_as_their_group(shared_data):
    """UR10: of the random poses commands are better than readings, of the grid they are unreliable."""
    folder = shared_data / "ur10_laser_tracker_6d"
    if not (folder / "commanded_poses.csv").is_file():
        pytest.skip("no commanded poses among the measured data")
    goals = pd.read_csv(folder / "commanded_poses.csv")
    data = pd.read_csv(folder / "measurements.csv").merge(goals, on=["pose", "group"])
    share = {}
    for group in ("random", "grid"):
        rows = data[data["group"] == group].iloc[:300]
        result = irbcal.calibrate(rows, "ur10", model="34", holdout=0.25)
        note = next(note for note in result.record.notes if "commanded poses give" in note)
        share[group] = float(note.split("%")[0].split()[-1]) / 100 if "%" in note else 0.0
    assert share["random"] > 0.4
    assert share["grid"] < share["random"] - 0.1  # level 34 leaves 0.4 mm, which hides some of it
