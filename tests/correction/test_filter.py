"""The filter end to end: read, correct, write, and what the controller then makes of the file."""

import numpy as np
import pandas as pd
import pytest
from support import arm, assert_same_poses, random_robot

from irbcal.correction import program as programs
from irbcal.correction.filter import configuration_of, filter_module, filter_table, quadrants, seeds_of
from irbcal.correction.languages import rapid, table
from irbcal.errors import ProgramError
from irbcal.modeling import frames
from irbcal.modeling.inverse import closed_form

FAR = "[9E9,9E9,9E9,9E9,9E9,9E9]"
TOOL = frames.from_xyz_angles([0.01, 0.02, 0.15, 0.0, 0.3, 0.1])
WOBJ = frames.from_xyz_angles([0.5, 0.0, 0.3, 0.0, 0.0, 0.2])


def literal(T):
    numbers = programs.numbers_from_poses(T[None])[0]
    return ",".join(programs.number_text(v, 6) for v in numbers[:3]), ",".join(f"{v:.9f}" for v in numbers[3:])


def frame_text(T):
    xyz, q = literal(T)
    return f"[[{xyz}],[{q}]]"


def well_inside(nominal, n):
    """Random joints away from limits and from all singularities."""
    q = 0.6 * nominal.random_joints(20 * n, 4)
    branches = closed_form.branches(nominal, nominal.forward(q))
    near = branches.singular(wrist=0.1, shoulder=0.1, elbow=0.02)
    return q[~(near["wrist"] | near["shoulder"] | near["elbow"]).any(axis=1)][:n]


@pytest.fixture(scope="module")
def robots():
    nominal = arm()
    return nominal, random_robot(nominal, "34", np.random.default_rng(1), size=0.1)


@pytest.fixture(scope="module")
def module(robots):
    """A module with joint and pose targets, configuration data as the controller would write them."""
    nominal, _ = robots
    q = well_inside(nominal, 30)
    T = frames.inverse(WOBJ) @ nominal.forward(q) @ TOOL
    branch = closed_form.configuration(nominal, q)
    lines = [
        "MODULE M",
        f"PERS tooldata tGrip:=[TRUE,{frame_text(TOOL)},[1,[0,0,1],[1,0,0,0],0,0,0]];",
        f'PERS wobjdata wTable:=[FALSE,TRUE,"",{frame_text(WOBJ)},[[0,0,0],[1,0,0,0]]];',
    ]
    for k in range(30):
        joints = ",".join(f"{v:.6f}" for v in np.degrees(q[k]))
        conf = configuration_of(q[k], int(branch[k]))
        xyz, quaternion = literal(T[k])
        lines.append(f"CONST jointtarget j{k}:=[[{joints}],{FAR}];")
        lines.append(
            f"CONST robtarget p{k}:=[[{xyz}],[{quaternion}],[{conf.cf1},{conf.cf4},{conf.cf6},{conf.cfx}],{FAR}];"
        )
    lines.append("PROC main()")
    lines += [f"MoveAbsJ j{k},v100,fine,tGrip\\WObj:=wTable;" for k in range(30)]
    lines += [f"MoveJ p{k},v100,fine,tGrip\\WObj:=wTable;" for k in range(30)]
    return "\r\n".join([*lines, "ENDPROC", "ENDMODULE", ""]).encode(), q


def controller(nominal, program):
    """Joints that a controller with the nominal model commands for the module's targets."""
    joints = np.array([program.targets[k].value for k in program.correctable("joint")])
    poses = program.correctable("pose")
    confs = [program.targets[k].configuration for k in poses]
    q, told = seeds_of(nominal, programs.tip_poses(program, poses), confs)
    assert told.all()
    return joints, q


def test_the_controller_reads_the_configuration_data_as_meant(robots, module):
    nominal, _ = robots
    joints, q = controller(nominal, rapid.parse(module[0]))
    assert np.abs(joints - module[1]).max() < 1e-7
    assert np.abs(q - module[1]).max() < 1e-5


def test_filtered_module_takes_the_calibrated_robot_to_the_wanted_poses(robots, module):
    nominal, robot = robots
    data, q = module
    found = filter_module(robot, nominal, rapid.parse(data), "abc123", rapid.mark)
    assert found.left == []
    assert len(found.changes) == 60
    fake = rapid.parse(found.data)
    joints, from_poses = controller(nominal, fake)
    wanted = nominal.forward(q)
    # six decimals of a degree and of a millimetre, nine of a quaternion
    assert_same_poses(robot.poses(joints), wanted, 1e-7, 2e-7)
    assert_same_poses(robot.poses(from_poses), wanted, 1e-7, 2e-7)
    assert 0.05 < found.changes["shift_mm"].mean() < 10
    changed = [
        a != b
        for a, b in zip(data.splitlines(), [x for x in found.data.splitlines() if b"irbcal" not in x], strict=True)
    ]
    assert sum(changed) == 60, "only the targets' lines changed"
    with pytest.raises(ProgramError, match="fake targets already for calibration abc123"):
        filter_module(robot, nominal, fake, "abc123", rapid.mark)


def test_quadrants_are_floors_of_ninety_degrees():
    q = np.radians([[10, 0, 0, 90, 0, 180], [-10, 0, 0, -90.5, 0, 359], [0, 0, 0, 190, 0, -181]])
    assert quadrants(q).tolist() == [[0, 1, 2], [-1, -2, 3], [0, 2, -3]]


def test_targets_that_cannot_be_corrected_are_left_as_they_were(robots):
    nominal, robot = robots
    data = (
        f"MODULE M\nCONST jointtarget ok:=[[0,0,0,0,30,0],{FAR}];\nCONST jointtarget straight:=[[0,0,0,0,0,0],{FAR}];\n"
        f"CONST robtarget far:=[[9000,0,0],[1,0,0,0],[0,0,0,0],{FAR}];\nPROC main()\nMoveAbsJ ok,v1,fine,tool0;\n"
        "MoveAbsJ straight,v1,fine,tool0;\nMoveJ far,v1,fine,tool0;\nENDPROC\nENDMODULE\n"
    ).encode()
    found = filter_module(robot, nominal, rapid.parse(data), "f", rapid.mark)
    assert [(name, line) for name, line, _ in found.left] == [("straight", 3), ("far", 4)]
    assert "does not reach" in found.left[1][2]
    kept = found.data.decode().splitlines()
    assert f"CONST jointtarget straight:=[[0,0,0,0,0,0],{FAR}];" in kept
    assert found.changes["target"].tolist() == ["ok"]


def test_tables_of_joints_and_poses(robots, tmp_path):
    nominal, robot = robots
    q = well_inside(nominal, 200)
    columns = {f"q{i + 1}_deg": np.degrees(q[:, i]) for i in range(6)}
    pd.DataFrame({"speed": "v100", **columns}).to_csv(tmp_path / "j.csv", index=False)
    found = filter_table(robot, nominal, table.read(tmp_path / "j.csv"), "f")
    assert found.left == []
    (tmp_path / "f.csv").write_bytes(found.data)
    again = table.read(tmp_path / "f.csv")
    assert_same_poses(robot.poses(again.values), nominal.forward(q), 1e-7, 2e-7)
    assert (again.table["speed"] == "v100").all()
    with pytest.raises(ProgramError, match="fake targets already"):
        filter_table(robot, nominal, again, "f")
