"""The filter end to end: read, correct, write, and what the controller then makes of the file."""

import gc
import json
import pickle
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from rapid_modules import parsed
from support import arm, assert_same_poses, measured, random_robot, write_measurements

import irbcal
from irbcal.cell.cell_file import CellFile
from irbcal.correction import notation
from irbcal.correction.corrected_program import CorrectedProgram, NotWritten
from irbcal.correction.corrected_targets import CorrectionModel
from irbcal.correction.filter import _without_garbage_collection, correct
from irbcal.correction.filter_program import filter_program
from irbcal.correction.languages import rapid, table
from irbcal.correction.maker import configuration_of, seeds_of
from irbcal.correction.opened_programs import fingerprints_of
from irbcal.correction.program import ControllerSetup, Note, Unchanged
from irbcal.errors import CalibrationError, OptionError, ProgramError, RobotError
from irbcal.io.controller_model import unknown_frames
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.dhm import DHMTable
from irbcal.modeling.inverse import closed_form
from irbcal.units import DEG, MM

FAR = "[9E9,9E9,9E9,9E9,9E9,9E9]"
TOOL = frames.from_xyz_angles([0.01, 0.02, 0.15, 0.0, 0.3, 0.1])
WOBJ = frames.from_xyz_angles([0.5, 0.0, 0.3, 0.0, 0.0, 0.2])


def literal(T):
    numbers = notation.numbers_from_poses(T[None])[0]
    return ",".join(notation.number_text(v, 6) for v in numbers[:3]), ",".join(f"{v:.9f}" for v in numbers[3:])


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
    q, told = seeds_of(nominal, program.tip_poses(poses), confs)
    assert told.all()
    return joints, q


def test_the_controller_reads_the_configuration_data_as_meant(robots, module):
    nominal, _ = robots
    joints, q = controller(nominal, parsed(module[0]))
    assert np.abs(joints - module[1]).max() < 1e-7
    assert np.abs(q - module[1]).max() < 1e-5


def test_filtered_module_takes_the_calibrated_robot_to_the_wanted_poses(robots, module):
    nominal, robot = robots
    data, q = module
    found = filter_program(parsed(data), CorrectionModel(robot, nominal, "abc123"))
    assert found.unchanged_targets == ()
    assert len(found.to_frame()) == 60
    fake = parsed(found.data)
    joints, from_poses = controller(nominal, fake)
    wanted = nominal.forward(q)
    # six decimals of a degree and of a millimetre, nine of a quaternion
    assert_same_poses(robot.poses(joints), wanted, 1e-7, 2e-7)
    assert_same_poses(robot.poses(from_poses), wanted, 1e-7, 2e-7)
    assert 0.05 < found.to_frame()["shift_mm"].mean() < 10
    changed = [
        a != b
        for a, b in zip(data.splitlines(), [x for x in found.data.splitlines() if b"irbcal" not in x], strict=True)
    ]
    assert sum(changed) == 60, "only the targets' lines changed"
    with pytest.raises(
        ProgramError, match="these are fake targets already for calibration abc123: filter the original"
    ):
        filter_program(fake, CorrectionModel(robot, nominal, "abc123"))


def test_targets_that_cannot_be_corrected_are_left_as_they_were(robots):
    nominal, robot = robots
    data = (
        f"MODULE M\nCONST jointtarget ok:=[[0,0,0,0,30,0],{FAR}];\nCONST jointtarget straight:=[[0,0,0,0,0,0],{FAR}];\n"
        f"CONST robtarget far:=[[9000,0,0],[1,0,0,0],[0,0,0,0],{FAR}];\nPROC main()\nMoveAbsJ ok,v1,fine,tool0;\n"
        "MoveAbsJ straight,v1,fine,tool0;\nMoveJ far,v1,fine,tool0;\nENDPROC\nENDMODULE\n"
    ).encode()
    found = filter_program(parsed(data), CorrectionModel(robot, nominal, "f"))
    assert [(name, line) for name, line, _ in found.unchanged_targets] == [("straight", 3), ("far", 4)]
    assert "does not reach" in found.unchanged_targets[1][2]
    kept = found.data.decode().splitlines()
    assert f"CONST jointtarget straight:=[[0,0,0,0,0,0],{FAR}];" in kept
    assert found.to_frame()["target"].tolist() == ["ok"]


def test_tables_of_joints_and_poses(robots, tmp_path):
    nominal, robot = robots
    q = well_inside(nominal, 200)
    columns = {f"q{i + 1}_deg": np.degrees(q[:, i]) for i in range(6)}
    pd.DataFrame({"speed": "v100", **columns}).to_csv(tmp_path / "j.csv", index=False)
    found = filter_program(table.read(tmp_path / "j.csv"), CorrectionModel(robot, nominal, "f"))
    assert found.unchanged_targets == ()
    (tmp_path / "f.csv").write_bytes(found.data)
    again = table.read(tmp_path / "f.csv")
    assert_same_poses(robot.poses(again.values), nominal.forward(q), 1e-7, 2e-7)
    assert (again.table.texts("speed") == "v100").all()
    with pytest.raises(ProgramError, match="fake targets already"):
        filter_program(again, CorrectionModel(robot, nominal, "f"))


# --- the front door --------------------------------------------------------------------------------------

JOB = f"""MODULE Job
CONST jointtarget j1:=[[10,-14,14,0,30,0],{FAR}];
CONST jointtarget straight:=[[0,0,0,0,0,0],{FAR}];
PROC main()
MoveAbsJ j1,v500,fine,tool0;
{{more}}
ENDPROC
ENDMODULE
"""


@pytest.fixture(scope="module")
def calibration(robots, tmp_path_factory):
    nominal, truth = robots
    folder = tmp_path_factory.mktemp("filter")
    points = measured(truth, nominal.random_joints(60, 1), 5e-5, np.random.default_rng(3))
    write_measurements(folder / "fit.csv", points)
    irbcal.save(irbcal.calibrate(folder / "fit.csv", "irb1600", "34", holdout=10), folder / "cal")
    return folder / "cal"


@pytest.fixture
def job(tmp_path):
    path = tmp_path / "job.mod"
    path.write_text(JOB.format(more=""))
    return path


def test_a_program_is_corrected_without_touching_files(calibration, job):
    before = sorted(job.parent.iterdir())
    record = irbcal.load(calibration)
    found = correct(record, job)
    assert sorted(job.parent.iterdir()) == before
    assert found.written is None
    assert found.fingerprint == record.record.fingerprint
    assert found.complete
    (fake,) = [target for target in parsed(found.data).targets if target.name == "j1"]
    wanted = record.arm(calibrated=False).forward(np.radians([[10, -14, 14, 0, 30, 0]]))
    assert_same_poses(record.robot_calibrated().poses(fake.value[None]), wanted, 1e-7, 2e-7)
    np.testing.assert_allclose(found.q[0], fake.value, rtol=0, atol=1e-8)
    assert found.expected_error == pytest.approx(record.record.heldout.all.mean_mm * 1e-3)


def test_files_are_written_when_asked(calibration, job, tmp_path):
    found = correct(str(calibration), job, out=tmp_path / "new" / "job.mod", changes=tmp_path / "changes.csv")
    assert found.written == tmp_path / "new" / "job.mod"
    assert found.written.read_bytes() == found.data
    seen = pd.read_csv(tmp_path / "changes.csv")
    assert seen.columns.tolist() == found.to_frame().columns.tolist()
    assert (seen["target"].tolist(), seen["line"].tolist()) == (["j1"], [2])
    np.testing.assert_allclose(seen["shift_mm"], 1e3 * found.shift, rtol=0, atol=1e-6)


def test_nothing_is_written_unless_all_is_corrected_or_a_part_is_allowed(calibration, job, tmp_path):
    job.write_text(JOB.format(more="MoveAbsJ straight,v500,fine,tool0;\nMoveJ Offs(p,0,0,1),v500,fine,tool0;"))
    out, changes = tmp_path / "new.mod", tmp_path / "changes.csv"
    with pytest.raises(
        NotWritten, match=r"job\.mod: nothing was written, because straight \(line 3\) and 1 more"
    ) as caught:
        correct(calibration, job, out=out, changes=changes)
    assert not out.exists()
    assert not changes.exists()
    assert [item.target for item in caught.value.filtered.unchanged_targets] == ["straight", "MoveJ Offs(p,0,0,1)"]
    assert correct(calibration, job).unchanged_targets == caught.value.filtered.unchanged_targets
    assert correct(calibration, job).summary().startswith("1 target corrected, by ")
    assert caught.value.filtered.summary().startswith("1 target can be corrected, by ")
    found = correct(calibration, job, out=out, allow_partial=True)
    assert out.read_bytes() == found.data
    assert not found.complete
    job.write_text(JOB.format(more="").replace("j1,v500", "straight,v500"))
    with pytest.raises(NotWritten, match="no target could be corrected"):
        correct(calibration, job, out=tmp_path / "none.mod", allow_partial=True)


def test_frames_are_given_in_metres(calibration, job):
    xyz, q = literal(
        np.linalg.inv(WOBJ) @ irbcal.load(calibration).arm(False).forward([[0.1, 0, 0, 0, 0.5, 0]])[0] @ TOOL
    )
    job.write_text(JOB.format(more=rf"MoveL [[{xyz}],[{q}],[0,0,0,0],{FAR}],v1,z1,tGun\WObj:=wFix;"))
    assert "does not define the tool tgun" in correct(calibration, job).unchanged_targets[0].reason
    found = correct(calibration, job, tool={"tGun": TOOL}, wobj={"WFIX": WOBJ.tolist()})
    np.testing.assert_allclose(found.q_before[1], [0.1, 0, 0, 0, 0.5, 0], rtol=0, atol=1e-6)
    for wrong in (np.eye(3), 2 * np.eye(4), np.full((4, 4), np.nan), "here", [[1, 2], [3]]):
        with pytest.raises(OptionError, match="wobj: wFix: expected a rigid transform") as caught:
            correct(calibration, job, tool={"tGun": TOOL}, wobj={"wFix": wrong})
        assert caught.value.parameter == "wobj"


def test_what_is_read_is_not_overwritten(calibration, job, tmp_path):
    for name in ("out", "changes"):
        with pytest.raises(CalibrationError) as caught:
            correct(calibration, job, **{name: job})
        assert caught.value.parameter == name
    with pytest.raises(OptionError) as refusal:
        correct(calibration, job, out=tmp_path / "a.mod", changes=tmp_path / "a.mod")
    with pytest.raises(OptionError) as refused:  # a program of another language by its name
        correct(calibration, job, out=tmp_path / "job.src", allow_partial=True)
    assert refused.value.parameter == "out"
    assert not (tmp_path / "job.src").exists()
    assert refusal.value.parameter == "changes"


def test_rapid_is_for_six_revolute_joints(job):
    with pytest.raises(ProgramError, match=r"job\.mod: RAPID"):
        rapid.LANGUAGE.read_for(seven_joints(), [job], ControllerSetup({}, {}, unknown_frames()))


def seven_joints():
    """An arm that a RAPID target cannot hold."""

    class Arm:
        name, six_revolute, joints_listed = "seven", False, "7 (j1, j2, j3, j4, j5, j6, j7)"

    return Arm()


@pytest.mark.parametrize("kind", ["rapid", "joints", "poses"])
def test_the_fingerprint_is_found_in_what_was_filtered(calibration, job, tmp_path, kind):
    record = irbcal.load(calibration)
    if kind != "rapid":
        job = tmp_path / "job.csv"
        q = np.radians([[10, -14, 14, 0, 30, 0], [0, 0, 0, 0, 0, 0]])
        poses = notation.numbers_from_poses(record.arm(calibrated=False).forward(q))
        frame = pd.DataFrame(np.degrees(q), columns=[f"q{k}_deg" for k in range(1, 7)])
        (frame if kind == "joints" else pd.DataFrame(poses, columns=table.POSE)).to_csv(job, index=False)
    assert fingerprints_of(job) == {job.name: None}
    new = tmp_path / f"new{job.suffix}"
    correct(calibration, job, out=new, allow_partial=True)
    assert fingerprints_of(new) == {new.name: record.record.fingerprint}
    with pytest.raises(ProgramError, match=record.record.fingerprint):
        correct(calibration, new)


def test_fingerprints_of_other_marks_and_files(tmp_path):
    (tmp_path / "old.mod").write_text("MODULE m\n! irbcal: fake targets\nENDMODULE\n")
    assert fingerprints_of(tmp_path / "old.mod") == {"old.mod": ""}
    with pytest.raises(ProgramError, match="there is no such file"):
        fingerprints_of(tmp_path / "none.mod")


def test_arms_without_a_closed_form_need_joints(robots, tmp_path):
    nominal, robot = robots
    skewed = nominal.with_table(robot.arm.table)
    pd.DataFrame(notation.numbers_from_poses(skewed.forward(np.zeros((1, 6)))), columns=table.POSE).to_csv(
        tmp_path / "p.csv", index=False
    )
    with pytest.raises(RobotError, match="has no closed-form inverse"):
        filter_program(table.read(tmp_path / "p.csv"), CorrectionModel(robot, skewed, "f"))


@pytest.mark.parametrize("option", ["tool", "wobj"])
def test_frames_come_with_their_names(option, calibration, job):
    with pytest.raises(OptionError, match=f"{option}: expected frames by their names") as refused:
        correct(calibration, job, **{option: [1, 2]})
    assert refused.value.parameter == option


# --- several files ---------------------------------------------------------------------------------------


def two_modules(folder):
    """Targets and moves in one module, the tool in another, as RobotStudio writes them."""
    folder.mkdir()
    calib = (
        f"MODULE CalibData\nPERS tooldata tGrip:=[TRUE,{frame_text(TOOL)},[1,[0,0,1],[1,0,0,0],0,0,0]];\nENDMODULE\n"
    )
    T = arm().forward(np.radians([[10, -14, 14, 0, 30, 0]]))[0] @ TOOL
    xyz, q = literal(T)
    target = f"CONST robtarget p:=[[{xyz}],[{q}],[0,0,0,0],{FAR}];"
    job = f"MODULE Job\n{target}\nPROC main()\nMoveL p,v1,fine,tGrip;\nENDPROC\nENDMODULE\n"
    (folder / "CalibData.mod").write_text(calib)
    (folder / "Job.mod").write_text(job)
    return folder


def test_a_tool_of_one_module_serves_the_others(calibration, tmp_path):
    folder = two_modules(tmp_path / "job")
    with pytest.raises(NotWritten) as refused:
        correct(calibration, folder / "Job.mod", out=tmp_path / "alone.mod")
    assert "give it with --tool" in refused.value.filtered.unchanged_targets[0].reason
    found = correct(calibration, folder, out=tmp_path / "new")
    assert found.targets.tolist() == ["p in Job.mod"]
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == ["CalibData.mod", "Job.mod", "changes.csv"]
    assert (tmp_path / "new" / "CalibData.mod").read_bytes() == (folder / "CalibData.mod").read_bytes()
    files = [folder / "Job.mod", folder / "CalibData.mod"]
    again = correct(calibration, files)
    assert {Path(name).name for name in again.files} == {"CalibData.mod", "Job.mod"}
    assert again.data == (tmp_path / "new" / "Job.mod").read_bytes()
    alone = correct(calibration, folder / "Job.mod", tool={"tGrip": TOOL})
    np.testing.assert_allclose(again.q, alone.q, rtol=0, atol=1e-7)


def test_several_files_go_into_a_folder_and_never_over_themselves(calibration, tmp_path):
    folder = two_modules(tmp_path / "job")
    for name in ("new.mod", "new.sys"):  # of the files, or of another module
        with pytest.raises(OptionError, match="expected a folder for"):
            correct(calibration, folder, out=tmp_path / name)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises((CalibrationError, OptionError)):
        correct(calibration, folder, out=folder)
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


def test_the_folder_to_write_to_is_no_input(calibration, tmp_path):
    folder = two_modules(tmp_path / "job")
    first = correct(calibration, folder, out=folder / "corrected")
    again = correct(calibration, folder, out=folder / "corrected")
    assert again.files == first.files
    assert any("corrected was skipped: it is the folder to write to" in note.text for note in again.notes)
    with pytest.raises(ProgramError, match="these are fake targets already"):
        correct(calibration, folder)


def test_a_backup_in_an_archive_is_corrected_where_its_robot_stands(calibration, tmp_path):
    """Its work objects count from the world: as if the robot stood at the world's origin and they were moved."""
    folder = tmp_path / "b"
    programs = folder / "RAPID" / "TASK1" / "PROGMOD"
    programs.parent.mkdir(parents=True)
    two_modules(programs)
    (folder / "SYSPAR").mkdir()
    moved = frames.from_xyz_angles([0.0, 0.0, -0.05, 0.0, 0.0, np.radians(-5)])
    turned = f"-base_frame_orient_u0 {np.cos(np.radians(2.5)):.9f} -base_frame_orient_u3 {-np.sin(np.radians(2.5)):.9f}"
    cfg = f'ROBOT:\n\n      -name "ROB_1" -base_frame_pos_z -0.05\\\n      {turned}\n'
    (folder / "SYSPAR" / "MOC.cfg").write_text(cfg)
    archive = tmp_path / "b.zip"
    with zipfile.ZipFile(archive, "w") as file:
        for path in sorted(path for path in folder.rglob("*") if path.is_file()):
            file.write(path, path.relative_to(folder).as_posix())
    found = correct(calibration, archive, out=tmp_path / "new.zip", allow_partial=True)
    assert any("stands at 0.000, 0.000, -50.000 mm" in note.text for note in found.notes)
    assert all(name.startswith(f"{archive}!RAPID/TASK1") for name in found.files)
    with zipfile.ZipFile(tmp_path / "new.zip") as file, zipfile.ZipFile(archive) as old:
        assert file.namelist() == [*old.namelist(), "changes.csv"]
        assert file.read("SYSPAR/MOC.cfg") == cfg.encode()
        assert file.read("RAPID/TASK1/PROGMOD/Job.mod") == found.files[f"{archive}!RAPID/TASK1/PROGMOD/Job.mod"]
    (folder / "SYSPAR" / "MOC.cfg").unlink()
    plain = correct(calibration, folder, wobj={"wobj0": frames.inverse(moved)})
    assert len(plain.targets) == len(found.targets) > 0
    np.testing.assert_allclose(found.q, plain.q, rtol=0, atol=1e-7)
    (folder / "SYSPAR" / "MOC.cfg").write_text(cfg)
    cell = CellFile(found.fingerprint, "robot", True, {}, {}, *[np.zeros((0, 0))] * 3)
    with pytest.raises(OptionError, match="outside of the backup"):
        correct(calibration, folder, cell=cell)
    (folder / "SYSPAR" / "MOC.cfg").write_text(cfg.replace('ROB_1"', 'ROB_1" -use_robot_calib "r1_calib"'))
    with pytest.raises(ProgramError, match="correct it twice; give what the controller computes with"):
        correct(calibration, folder)
    off = correct(calibration, folder, controller_model="nominal")
    np.testing.assert_allclose(off.q, found.q, rtol=0, atol=1e-12)
    with pytest.raises(OptionError, match="a zip archive is written of one that was given"):
        correct(calibration, two_modules(tmp_path / "job"), out=tmp_path / "a.zip")


def test_a_backup_comes_back_in_its_shape_and_one_bad_file_stops_no_other(calibration, tmp_path):
    """Two tasks with modules of one name; a module that is not whole, and one that hides in a folder."""
    backup = tmp_path / "backup"
    for task in ("TASK1", "TASK2"):
        (backup / "RAPID" / task).mkdir(parents=True)
        two_modules(backup / "RAPID" / task / "PROGMOD")
    (backup / "RAPID" / "TASK1" / "PROGMOD" / "Cut.mod").write_text("MODULE Cut\nPROC a()\n")
    (backup / "RAPID" / "TASK2" / "PROGMOD" / "CalibData.mod").unlink()
    with pytest.raises(NotWritten):
        correct(calibration, backup, out=tmp_path / "new")
    assert not (tmp_path / "new").exists()
    found = correct(calibration, backup, out=tmp_path / "new", allow_partial=True)
    assert found.targets.tolist() == ["p in RAPID/TASK1/PROGMOD/Job.mod"]
    reasons = {left.target: left.reason for left in found.unchanged_targets}
    assert "the file is not whole" in reasons["the file in RAPID/TASK1/PROGMOD/Cut.mod"]
    assert "--tool tgrip=…" in reasons["p in RAPID/TASK2/PROGMOD/Job.mod"], "a tool of another task is none"
    new = {path.relative_to(tmp_path / "new").as_posix() for path in (tmp_path / "new").rglob("*.mod")}
    assert new == {"RAPID/TASK1/PROGMOD/CalibData.mod", "RAPID/TASK1/PROGMOD/Job.mod", "RAPID/TASK2/PROGMOD/Job.mod"}
    unchanged = "RAPID/TASK2/PROGMOD/Job.mod"
    assert (tmp_path / "new" / unchanged).read_bytes() == (backup / unchanged).read_bytes()
    alone = correct(calibration, backup / "RAPID" / "TASK1" / "PROGMOD" / "Job.mod", tool={"tGrip": TOOL})
    np.testing.assert_allclose(found.q, alone.q, rtol=0, atol=1e-7)


@pytest.mark.parametrize("pulses", [[1, 2], "abc", [1000.0] * 5 + ["x"], [1000.0] * 5 + [0.0]])
def test_pulses_are_six_numbers(calibration, job, pulses):
    with pytest.raises(OptionError, match="pulses: expected six numbers"):
        correct(calibration, job, pulses=pulses)


def test_a_target_is_corrected_in_the_module_where_it_stands(calibration, tmp_path):
    """The target in one module, its move in another: as if both stood in one, and no other byte changes."""
    alone = two_modules(tmp_path / "alone")
    folder = tmp_path / "apart"
    folder.mkdir()
    job = (alone / "Job.mod").read_text().splitlines()
    (folder / "CalibData.mod").write_text((alone / "CalibData.mod").read_text())
    (folder / "Points.mod").write_bytes(f"MODULE Points\r\n  ! Größe\r\n\t{job[1]}\r\nENDMODULE\r\n".encode("latin-1"))
    (folder / "Job.mod").write_text("\n".join([job[0], *job[2:]]) + "\n")
    found = correct(calibration, folder, out=tmp_path / "new")
    assert found.targets.tolist() == ["p in Points.mod"]
    assert found.unchanged_targets == ()
    one = correct(calibration, alone)
    np.testing.assert_array_equal(found.q, one.q)
    new = (tmp_path / "new" / "Points.mod").read_bytes().decode("latin-1").split("\r\n")
    old = (folder / "Points.mod").read_bytes().decode("latin-1").split("\r\n")
    assert "irbcal: fake targets" in new.pop(1)
    assert [k for k, (a, b) in enumerate(zip(new, old, strict=True)) if a != b] == [2]
    assert new[2].strip() in {Path(name).name: data for name, data in one.files.items()}["Job.mod"].decode()
    for name in ("Job.mod", "CalibData.mod"):
        assert (tmp_path / "new" / name).read_bytes() == (folder / name).read_bytes()
    # by itself: the fake target, taken by the nominal controller, brings the calibrated robot to the wanted pose
    record = irbcal.load(calibration)
    again = parsed((tmp_path / "new" / "Points.mod").read_bytes(), "Points.mod")
    xyz = again.targets[0].value
    wanted = parsed((folder / "Points.mod").read_bytes(), "Points.mod").targets[0].value
    nominal = record.arm(calibrated=False)
    (q,) = found.q
    assert_same_poses(nominal.forward(q[None])[0] @ TOOL, xyz, 1e-7, 2e-7)
    assert_same_poses(record.robot_calibrated().poses(q[None])[0] @ TOOL, wanted, 1e-7, 2e-7)


def filtered(n, slides=(False, True), **more):
    bare, ends = np.zeros(2), (np.eye(4), np.eye(4), ("turns", "slides"), -np.ones(2), np.ones(2), "base", "tip")
    table = DHMTable(bare, bare, bare, bare, prismatic=np.array(slides))
    q = np.ones((n, 2)) * [10 * DEG, 20 * MM]
    return CorrectedProgram(
        source="job.csv",
        files={"job.mod": b""},
        targets=np.array([f"t{k} [red]" for k in range(n)], dtype=object),
        lines=np.arange(n) + 2,
        q_before=q,
        q=q + np.array([-0.5 * DEG, 0.25 * MM]),
        shift=np.full(n, 1.5 * MM),
        turn=np.full(n, 0.1 * DEG),
        residual=np.zeros(n),
        arm=Arm("two", table, *ends),
        fingerprint="abc",
        **{"unchanged_targets": (), "notes": (), **more},
    )


def test_the_frame_is_in_the_units_of_files():
    frame = filtered(3).to_frame()
    assert frame["line"].tolist() == [2, 3, 4]
    first = frame.iloc[0]
    assert first["q1_deg"] - first["q1_deg_before"] == pytest.approx(-0.5, abs=1e-9)
    assert first["q2_mm"] - first["q2_mm_before"] == pytest.approx(0.25, abs=1e-9)
    assert first["shift_mm"] == pytest.approx(1.5, abs=1e-9)
    assert first["turn_deg"] == pytest.approx(0.1, abs=1e-9)
    empty = filtered(0).to_frame()
    assert (len(empty), empty.columns.tolist()) == (0, frame.columns.tolist())


def test_the_summary_tells_the_first_changes_and_everything_that_was_left():
    left = tuple(Unchanged(f"p{k}", k, "out of reach") for k in range(30))
    found = filtered(
        12,
        unchanged_targets=left,
        notes=(Note(7, "a displacement"),),
        expected_error=0.25 * MM,
        written=Path("new.csv"),
    )
    text = found.summary()
    assert text.splitlines()[0] == "12 targets corrected, by 1.500 mm on average and at most 1.500 mm"
    assert "largest joint change deg (mm)" in text
    assert "t9 [red]" in text
    assert "t10 [red]" not in text
    assert "… and 2 more" in text
    assert text.count("left as it was: p") == 30
    assert "Note: line 7: a displacement" in text
    assert "Expected error afterwards: 0.250 mm mean" in text
    assert text.endswith("Written to new.csv")
    assert not found.complete
    assert len(repr(found)) < 200
    assert "0.5000" in found._repr_html_()


def test_of_very_many_left_for_one_reason_the_first_are_told_and_how_many_more():
    left = [Unchanged(f"p{k}", k, "out of reach") for k in range(1, 121)] + [Unchanged("other", 7, "it is computed")]
    text = filtered(2, unchanged_targets=tuple(left)).summary()
    assert text.count("left as it was: p") == 50
    assert "left as it was: other (line 7): it is computed" in text
    assert "left as they were: 70 more in lines 51 to 120: out of reach" in text


def test_nothing_corrected_is_said():
    assert filtered(0).summary() == "no target corrected"
    assert filtered(1).complete


def test_results_are_locked_and_pickle():
    found = filtered(2)
    with pytest.raises(ValueError, match="read-only"):
        found.q[0, 0] = 1.0
    again = pickle.loads(pickle.dumps(found))
    assert again.summary() == found.summary()


def test_it_becomes_a_dict_for_json():
    found = filtered(
        2, unchanged_targets=(Unchanged("p", 4, "out of reach"),), notes=(Note(7, "speed"),), expected_error=0.2 * MM
    )
    data = json.loads(json.dumps(found.to_dict()))
    assert [row["target"] for row in data["targets"]] == ["t0 [red]", "t1 [red]"]
    assert data["left"][0]["reason"] == "out of reach"
    assert data["notes"][0]["text"] == "speed"
    assert data["expected_error_mm"] == pytest.approx(0.2)
    assert data["written"] is None


def fails():
    with _without_garbage_collection():
        assert not gc.isenabled()
        raise KeyError


@pytest.mark.parametrize("more", [{"points": "taught"}, {"path_tolerance": 1e-4}])
def test_points_are_split_of_offline_points_only(calibration, job, more):
    with pytest.raises(OptionError, match="split_points: goes with offline points"):
        correct(calibration, job, split_points=True, **more)


def test_the_collector_is_as_it_was_even_after_an_error():
    assert gc.isenabled()
    with pytest.raises(KeyError):
        fails()
    assert gc.isenabled()
    gc.disable()
    with _without_garbage_collection():
        assert not gc.isenabled()
    assert not gc.isenabled(), "it was off before"
    gc.enable()
