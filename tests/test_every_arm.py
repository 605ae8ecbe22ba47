"""Other makers' arms, from plan to corrected program, with no option that helps; `scripts/every_arm` does all of them."""

import os
from pathlib import Path

import numpy as np
import pytest

import irbcal

ARMS = Path(os.environ.get("IRBCAL_SHARED_DATA", "../shared/data")) / "other_arms"


def robot_of(name):
    path = ARMS / f"{name}.urdf"
    if not path.is_file():
        pytest.skip(f"{path} is not here")
    return path


@pytest.mark.parametrize("name", ["m20ia"])
def test_from_plan_to_corrected_program(name, tmp_path):
    """Axis 3 against axis 2 and no meshes: the corrected robot ends as near as held-out poses promise."""
    robot = robot_of(name)
    irbcal.plan(robot, axis=0, cube=30, all_range=50).save(tmp_path / "plan")
    irbcal.plan(robot, axis=0, cube=10, all_range=10, seed=5).save(tmp_path / "job")
    job = tmp_path / "job" / "poses.csv"
    found = irbcal.calibrate(irbcal.simulate(robot, tmp_path / "plan" / "poses.csv"), robot)
    assert found.record.model == "auto"
    irbcal.save(found, tmp_path / "cal")
    fixed = irbcal.correct(tmp_path / "cal", job, out=tmp_path / "new.csv")
    assert len(fixed.targets) == 20
    run = irbcal.simulate(robot, tmp_path / "new.csv", wanted=job, calibration=tmp_path / "cal", seed=3)
    reached = run.to_dict()["wanted"]["mean_mm"]
    heldout = found.record.heldout.all.mean_mm
    assert reached < 1.1 * heldout
    assert heldout < 0.2 * found.record.heldout_nominal.all.mean_mm


@pytest.mark.parametrize("name", ["gp8", "m20ia", "kr120r2500pro", "rx160"])
def test_reachable_poses_are_solved(name):
    robot = robot_of(name)
    check_inverse(robot, 2000)


@pytest.mark.parametrize("name", ["panda", "z1"])
def test_reachable_poses_are_solved_or_flagged(name):
    check_inverse(name, 100)


def check_inverse(robot, n):
    arm = irbcal.read_urdf(robot).arm
    T = arm.forward(arm.random_joints(n, 11))
    found = irbcal.inverse_kinematics(robot, T)
    flagged = np.array([bool(note) for note in found.note])
    assert (found.solved | flagged).all()
    assert flagged.mean() < 0.02
    back = arm.forward(found.joints[~flagged])
    assert np.abs(back - T[~flagged]).max() < 1e-8
    inside = (found.joints[~flagged] >= arm.lower - 1e-8) & (found.joints[~flagged] <= arm.upper + 1e-8)
    assert inside.all()


def test_nothing_but_base_and_tool_of_more_than_six_joints(tmp_path):
    found = irbcal.calibrate(irbcal.simulate("panda", random=40, seed=3), "panda", model="nominal")
    irbcal.save(found, tmp_path / "cal")  # the report looks at each joint
    assert (tmp_path / "cal" / "report.html").is_file()
