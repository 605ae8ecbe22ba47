"""Programs and tables of poses in the virtual cell."""

import numpy as np
import pandas as pd
import pytest
from maker_cases import path_of, pose_numbers, robot_of, well_inside
from typer.testing import CliRunner

import irbcal
from irbcal.cli import main
from irbcal.correction.languages.table import POSE
from irbcal.errors import MeasurementError, ProgramError
from irbcal.io import urdf
from irbcal.modeling import frames
from irbcal.simulation import pose_list, programs
from irbcal.units import MM


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
        found = pose_list.taken(source, nominal)
        np.testing.assert_allclose(found.q, q, rtol=0, atol=1e-6)
        assert found.pose.tolist() == ["A", "B"]
        assert found.wait_s.tolist() == [1.0, 2.0]
    table["x_mm"] = [table["x_mm"][0], 9000.0]
    with pytest.raises(MeasurementError, match="row 2: expected a pose that irb120_3_058 reaches"):
        pose_list.taken(table, nominal)


def test_folders_and_what_is_no_program(tmp_path):
    nominal, _, _ = robot_of("kr120r2500pro")
    given = programs.given_for(path_of("kr120r2500pro"), nominal)
    (tmp_path / "none.src").write_text("DEF none()\nEND\n")
    with pytest.raises(ProgramError, match="found no move"):
        programs.read(tmp_path / "none.src", nominal, given)
    assert programs.is_program(tmp_path)
    assert not programs.is_program(tmp_path / "a.csv")
    assert not programs.is_program(np.zeros((1, 6)))
    (tmp_path / "job.abc").write_text("&ACCESS RVP\nDEF job()\nPTP {A1 0, A2 -90, A3 90, A4 0, A5 0, A6 0}\nEND\n")
    assert programs.is_program(tmp_path / "job.abc")
    q, digest = programs.read(tmp_path / "job.abc", nominal, given)
    assert np.degrees(q).tolist() == [[0, -90, 90, 0, 0, 0]]
    assert len(digest) == 64


def test_what_is_no_regular_file_is_refused_before_it_is_read():
    with pytest.raises(ProgramError, match="/proc/self/mem"):
        programs.is_program("/proc/self/mem")
