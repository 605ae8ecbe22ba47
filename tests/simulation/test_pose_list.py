"""Poses to measure: from tables and robot programs, and what is refused."""

import numpy as np
import pandas as pd
import pytest
from maker_cases import path_of, pose_numbers, robot_of, well_inside
from typer.testing import CliRunner

import irbcal
from irbcal.cli import main
from irbcal.correction.languages.table import POSE
from irbcal.correction.program_options import ControllerOptions
from irbcal.errors import MeasurementError, ProgramError, RobotError
from irbcal.io import urdf
from irbcal.modeling import frames
from irbcal.simulation import pose_list
from irbcal.summary import Result
from irbcal.units import DEG, MM

TEXT = "pose,group,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,targets,wait_s\nA,g,1,2,3,4,5,6,smr2;smr1,7\nB,g,0,0,0,0,0,9,,\n"


def test_file_table_and_result_give_the_same_poses(cell, tmp_path):
    (tmp_path / "plan.csv").write_text(TEXT)
    table = pd.read_csv(tmp_path / "plan.csv")

    class Plan(Result):
        def to_frame(self):
            return table

        def report(self):
            return []

    found = [pose_list.read_poses(source, cell.arm) for source in (tmp_path / "plan.csv", table, Plan())]
    for poses in found:
        np.testing.assert_allclose(poses.q / DEG, [[1, 2, 3, 4, 5, 6], [0, 0, 0, 0, 0, 9]], rtol=0, atol=1e-12)
        assert poses.pose.tolist() == ["A", "B"]
        assert poses.wait_s.tolist() == [7.0, 4.0]
        assert poses.measured_targets(cell).tolist() == [[True, True, False], [True, True, True]]
        assert poses.extra["group"].tolist() == ["g", "g"]
    assert found[0].source == str(tmp_path / "plan.csv")


def test_joints_as_an_array_are_measured_at_all_targets(cell):
    poses = pose_list.read_poses(np.zeros((3, 6)), cell.arm, 1.5)
    assert poses.pose.tolist() == ["1", "2", "3"]
    assert poses.measured_targets(cell) is None
    assert poses.wait_s.tolist() == [1.5] * 3
    with pytest.raises(RobotError, match=r"need shape \(n, 6\)"):
        pose_list.read_poses(np.zeros((3, 5)), cell.arm)


def test_refusals_carry_file_row_and_column(cell, tmp_path):
    (tmp_path / "plan.csv").write_text(TEXT.replace("smr2;smr1", "smr7"))
    with pytest.raises(MeasurementError) as refusal:
        pose_list.read(tmp_path / "plan.csv", cell.arm).measured_targets(cell)
    assert (refusal.value.file, refusal.value.row, refusal.value.column) == (str(tmp_path / "plan.csv"), 2, "targets")
    assert str(refusal.value).endswith("column targets: expected targets of the tool (smr1, smr2, smr3), found 'smr7'")


def test_drawn_poses_are_numbered_and_seen(cell):
    poses = pose_list.random_list(cell, 5, seed=2, wait_s=1.0)
    assert poses.pose.tolist() == list("12345")
    assert cell.visible(poses.q).all()


def test_a_plan_with_a_row_for_each_target_is_one_with_a_row_for_each_pose(cell):
    row = dict(zip(cell.arm.joint_columns, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0], strict=True))
    table = pd.DataFrame(
        [
            {"pose": "A", "group": "g", **row, "target": "smr1", "expected_x_mm": 1.0},
            {"pose": "A", "group": "g", **row, "target": "smr3", "expected_x_mm": 2.0},
            {"pose": "B", "group": "h", **row, "q6_deg": 9.0, "target": "smr2", "expected_x_mm": 3.0},
        ]
    )
    poses = pose_list.read_poses(table, cell.arm)
    np.testing.assert_allclose(poses.q / DEG, [[1, 2, 3, 4, 5, 6], [1, 2, 3, 4, 5, 9]], rtol=0, atol=1e-12)
    assert poses.pose.tolist() == ["A", "B"]
    assert poses.extra["group"].tolist() == ["g", "h"]
    assert poses.measured_targets(cell).tolist() == [[True, False, True], [False, True, False]]


def job(q, at, nominal, tool):
    """A KRL job of joints and then of the same poses with a tool."""
    axes = ["PTP {" + ", ".join(f"A{k} {v:.6f}" for k, v in enumerate(np.degrees(row), 1)) + "}" for row in q]
    T = frames.inverse(at.T_base_world) @ nominal.forward(q) @ at.T_tip_flange @ tool
    rows = pose_numbers(T, "ZYX")
    poses = ["LIN {" + ", ".join(f"{key} {v:.6f}" for key, v in zip("XYZABC", row, strict=True)) + "}" for row in rows]
    lines = [line for pair in zip(axes, poses, strict=True) for line in pair]
    return "\r\n".join(["DEF job()", "BAS(#TOOL,3)", "BAS(#BASE,0)", *lines, "END", ""])


def test_a_job_is_measured_as_its_joints_are(tmp_path):
    """Poses go through frames and inverse kinematics, joints do not: the virtual robot ends in the same places."""
    nominal, _, at = robot_of("kr120r2500pro")
    q = well_inside(nominal, 4)
    tool = frames.from_xyz_angles([0.01, 0.02, 0.15, 0.0, 0.3, 0.1])
    (tmp_path / "job.src").write_text(job(q, at, nominal, tool), newline="")
    x, y, z, a, b, c = pose_numbers(tool[None], "ZYX")[0]
    words = ["--tool", f"3={x},{y},{z},{a},{b},{c}", "--frame", "0=0,0,0,0,0,0"]
    out = tmp_path / "m.csv"
    done = CliRunner().invoke(
        main.app,
        ["simulate", str(tmp_path / "job.src"), "--robot", str(path_of("kr120r2500pro")), "--out", str(out), *words],
        catch_exceptions=False,
    )
    assert done.exit_code == 0, done.output
    found = pd.read_csv(out)
    assert found["pose"].nunique() == 8
    rows = found.drop_duplicates("pose")[nominal.joint_columns].to_numpy()
    np.testing.assert_allclose(rows, np.degrees(np.repeat(q, 2, axis=0)), rtol=0, atol=2e-6)


def test_wanted_and_corrected_programs_may_be_of_any_language(tmp_path):
    nominal = urdf.read("irb120").arm
    found = irbcal.calibrate(irbcal.simulate("irb120", random=40, seed=3, only=[]), "irb120", model="16")
    irbcal.save(found, tmp_path / "cal")
    q = well_inside(nominal, 5)
    rows = "\n".join(
        f"  MoveAbsJ [[{','.join(f'{v:.6f}' for v in np.degrees(row))}],[9E9,9E9,9E9,9E9,9E9,9E9]],v9,fine,tool0;"
        for row in q
    )
    (tmp_path / "job.mod").write_text(f"MODULE M\n PROC main()\n{rows}\n ENDPROC\nENDMODULE\n")
    irbcal.correct(tmp_path / "cal", tmp_path / "job.mod", out=tmp_path / "new.mod")
    table = pd.DataFrame(np.degrees(q), columns=nominal.joint_columns)
    runs = [
        irbcal.simulate("irb120", tmp_path / "new.mod", wanted=wanted, calibration=tmp_path / "cal", only=[])
        for wanted in (tmp_path / "job.mod", table)
    ]
    assert runs[0].poses.source.endswith("new.mod")
    assert runs[0].to_dict()["wanted"] == pytest.approx(runs[1].to_dict()["wanted"], abs=1e-5)


def test_a_table_of_poses_takes_the_solution_next_to_zero_joints(tmp_path):
    nominal = urdf.read("irb120").arm
    q = np.radians([[10.0, 20.0, -30.0, 40.0, 50.0, -60.0], [-20.0, 10.0, 5.0, -30.0, 40.0, 70.0]])
    T = nominal.forward(q)
    rows = np.column_stack([T[:, :3, 3] / MM, frames.quaternion_from_matrix(T[:, :3, :3])])
    table = pd.DataFrame(rows, columns=POSE).assign(pose=["A", "B"], wait_s=[1, 2])
    table.to_csv(tmp_path / "p.csv", index=False)
    for source in (table, tmp_path / "p.csv"):
        found = pose_list.read_poses(source, nominal)
        np.testing.assert_allclose(found.q, q, rtol=0, atol=1e-6)
        assert found.pose.tolist() == ["A", "B"]
        assert found.wait_s.tolist() == [1.0, 2.0]
    table["x_mm"] = [table["x_mm"][0], 9000.0]
    with pytest.raises(MeasurementError, match="row 2: expected a pose that irb120_3_058 reaches"):
        pose_list.read_poses(table, nominal)


def test_folders_and_what_is_no_program(tmp_path):
    nominal, _, _ = robot_of("kr120r2500pro")
    (tmp_path / "none.src").write_text("DEF none()\nEND\n")
    given = pose_list.given_for(path_of("kr120r2500pro"), nominal, tmp_path / "none.src", ControllerOptions())
    with pytest.raises(ProgramError, match="found no move"):
        pose_list.read_program(tmp_path / "none.src", nominal, given)
    assert pose_list.is_program(tmp_path)
    assert not pose_list.is_program(tmp_path / "a.csv")
    assert not pose_list.is_program(np.zeros((1, 6)))
    (tmp_path / "job.abc").write_text("&ACCESS RVP\nDEF job()\nPTP {A1 0, A2 -90, A3 90, A4 0, A5 0, A6 0}\nEND\n")
    assert pose_list.is_program(tmp_path / "job.abc")
    q, digest = pose_list.read_program(tmp_path / "job.abc", nominal, given)
    assert np.degrees(q).tolist() == [[0, -90, 90, 0, 0, 0]]
    assert len(digest) == 64


def test_what_is_no_regular_file_is_refused_before_it_is_read():
    with pytest.raises(ProgramError, match="/proc/self/mem"):
        pose_list.is_program("/proc/self/mem")
