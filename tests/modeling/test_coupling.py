"""Coupled joints: how they are written, and that they change nothing but the numbers in files."""

import json

import numpy as np
import pandas as pd
import pytest

import irbcal
from irbcal.errors import RobotError
from irbcal.io.robots import robot_file
from irbcal.measurement.input_table import poses_to_frame
from irbcal.modeling import coupling


@pytest.mark.parametrize(
    ("given", "entries"),
    [
        ("3+2", {(2, 1): 1.0}),
        ("3+2, 6-0.5*5", {(2, 1): 1.0, (5, 4): -0.5}),
        ("", None),
        (None, None),
        (np.eye(6).tolist(), None),
    ],
)
def test_what_is_written(given, entries):
    found = coupling.matrix(given, 6)
    if entries is None:
        assert found is None
        return
    expected = np.eye(6)
    for place, value in entries.items():
        expected[place] = value
    np.testing.assert_array_equal(found, expected)
    np.testing.assert_array_equal(coupling.matrix(coupling.in_words(found), 6), found)


@pytest.mark.parametrize(
    "given", ["3+3", "7+2", "3+x", "3+2 junk", [[1, 2], [3, 4]], np.zeros((6, 6)).tolist(), 5, "3*2"]
)
def test_what_is_refused(given):
    with pytest.raises(RobotError, match="coupling"):
        coupling.matrix(given, 6)


def test_joints_there_and_back():
    arm = irbcal.read_urdf("irb1600").arm
    import dataclasses

    arm = dataclasses.replace(arm, coupling=coupling.matrix("3+2, 6-0.5*5", 6))
    p = np.array([[0.1, 0.2, 0.3, 0.4, 0.5, 0.6]])
    np.testing.assert_allclose(arm.from_controller(p), [[0.1, 0.2, 0.5, 0.4, 0.5, 0.35]], atol=1e-15)
    np.testing.assert_allclose(arm.to_controller(arm.from_controller(p)), p, atol=1e-15)


def test_the_same_robot_counted_otherwise(tmp_path):
    """Plan to corrected program of one robot, whose joints are counted in two ways: only joint 3 in files differs.

    The coupling is an option where the robot is named, against what the file beside the URDF says.
    """
    data = robot_file("irb1600").read_bytes()
    done = {}
    for name in ("plain", "coupled"):
        folder = tmp_path / name
        folder.mkdir()
        robot = folder / "arm.urdf"
        robot.write_bytes(data)
        if name == "coupled":
            (folder / "arm.coupling.yaml").write_text("coupling: 2+3\n")
        option = {"plain": "none", "coupled": "3+2"}[name]
        seen = irbcal.simulate(robot, random=30, seed=5, coupling=option)
        table = seen.to_frame()
        found = irbcal.calibrate(table, robot, model="placement", coupling=option)
        irbcal.save(found, folder / "cal")
        program = table.drop_duplicates("pose")[["pose", *(f"q{i}_deg" for i in range(1, 7))]].head(12)
        program.to_csv(folder / "job.csv", index=False)
        fixed = irbcal.correct(folder / "cal", folder / "job.csv", out=folder / "new.csv")
        saved = irbcal.load(folder / "cal")
        tip = irbcal.forward_kinematics(folder / "cal", folder / "job.csv").T_base_tip
        joints = irbcal.inverse_kinematics(folder / "cal", tip).to_frame()
        done[name] = table, found, program, fixed.to_frame(), saved, tip, joints
    (table, found, program, fixed, saved, tip, joints), coupled = done["plain"], done["coupled"]
    columns = [f"q{i}_deg" for i in range(1, 7)]

    def as_counted(rows):
        rows = rows[columns].to_numpy(dtype=float).copy()
        rows[:, 2] -= rows[:, 1]
        return rows

    np.testing.assert_allclose(coupled[0][columns].to_numpy(), as_counted(table), atol=2e-6)
    np.testing.assert_allclose(coupled[0][["x_mm", "y_mm", "z_mm"]], table[["x_mm", "y_mm", "z_mm"]], rtol=0, atol=1e-9)
    first, second = found.record, coupled[1].record
    assert second.heldout.all.mean_mm == pytest.approx(first.heldout.all.mean_mm, rel=1e-5)
    assert [row.value for row in second.parameters] == pytest.approx([row.value for row in first.parameters], abs=1e-4)
    np.testing.assert_allclose(coupled[3][columns].to_numpy(), as_counted(fixed), atol=2e-5)
    np.testing.assert_allclose(coupled[5], tip, atol=1e-7)
    np.testing.assert_allclose(coupled[6][columns].to_numpy(dtype=float), as_counted(joints), atol=2e-5)
    assert first.robot.coupling is None
    written = json.loads((tmp_path / "coupled" / "cal" / "calibration.json").read_text())["robot"]["coupling"]
    np.testing.assert_array_equal(written, coupling.matrix("3+2", 6))
    np.testing.assert_array_equal(coupled[4].arm().coupling, written)
    # a plan, poses of the nominal robot and the controller's own report count so, too
    robot = tmp_path / "plain" / "arm.urdf"
    q = as_counted(program)
    nominal = irbcal.forward_kinematics(robot, pd.DataFrame(q, columns=columns), coupling="3+2").T_base_tip
    np.testing.assert_allclose(nominal, irbcal.forward_kinematics(robot, program).T_base_tip, atol=1e-9)
    joints = irbcal.inverse_kinematics(robot, nominal, coupling="3+2").to_frame()
    plain = irbcal.inverse_kinematics(robot, nominal).to_frame()
    np.testing.assert_allclose(joints[columns].to_numpy(dtype=float), as_counted(plain), atol=1e-6)
    reported = poses_to_frame(nominal).join(pd.DataFrame(q, columns=columns))
    assert irbcal.controller(reported, robot, coupling="3+2").median_mm() < 1e-6
    made = [
        irbcal.plan(robot, axis=0, cube=0, all_range=6, ignore=["sight"], coupling=c).to_frame()
        for c in ("3+2", "none")
    ]
    np.testing.assert_allclose(made[0][columns].to_numpy(), as_counted(made[1]), atol=1e-5)
    with pytest.raises(RobotError, match="coupling"):
        irbcal.forward_kinematics(tmp_path / "plain" / "cal", program, coupling="3+2")
