"""Whether a URDF or a program found somewhere is of a calibration."""

import json

import pytest
from support import started

import irbcal
from irbcal.errors import OptionError, ProgramError, RobotError
from irbcal.io import urdf
from irbcal.io.opening import open_robot
from irbcal.validation.verification import verify, verify_bytes


def moved(data, metres):
    """The URDF with joint 4 elsewhere."""
    tree = urdf.from_bytes(data, "moved")
    T = urdf.joint_origins(tree, tree.arm)["joint_4"].copy()
    T[0, 3] += metres
    return urdf.with_joint_origins(data, {"joint_4": T})


def test_verify_tells_calibrations_apart(folders):
    saved = irbcal.load(folders[0]).record
    own, other = ((folder / "calibrated.urdf").read_bytes() for folder in folders)
    nominal = open_robot(folders[0], nominal=True).urdf_bytes
    stripped = own.replace(b"<irbcal_calibration", b"<some_other_tag")
    cases = {
        "own": (own, True, "calibrated", "same"),
        "meshes moved": (own.replace(b"<inertial>", b"<!-- heavier --><inertial>"), True, "calibrated", "same"),
        "without fingerprint": (stripped, True, "calibrated", "absent"),
        "another calibration": (other, False, "other", "other"),
        "nominal": (nominal, False, "nominal", "same"),
        "changed by hand": (moved(own, 1e-5), False, "other", "same"),
        "rounded to a nanometre": (moved(own, 5e-10), True, "calibrated", "same"),
        "rounded to a micrometre": (moved(own, 1e-6), True, "rounded", "same"),
    }
    for name, (data, yes, geometry, mark) in cases.items():
        result = verify_bytes(saved, data, "found.urdf")
        assert (result.is_calibration, result.geometry, result.fingerprint) == (yes, geometry, mark), name
        assert result.same_file == (name == "own")
    changed = verify_bytes(saved, moved(own, 1e-5), "found.urdf")
    assert changed.position_m == pytest.approx(1e-5, rel=1e-3)
    assert "0.01 mm" in changed.explanation
    assert "changed afterwards" in changed.explanation
    with pytest.raises(RobotError, match=r"found\.urdf: there is no chain|found\.urdf: there is no link"):
        verify_bytes(saved, b'<robot name="x"><link name="base_link"/></robot>', "found.urdf")
    with pytest.raises(RobotError, match=r"found\.urdf: expected the joints joint_1, .* found a1, "):
        verify_bytes(saved, own.replace(b'"joint_', b'"a'), "found.urdf")


def test_same_geometry_with_another_joint_map_is_another_calibration(folders):
    saved = irbcal.load(folders[0]).record
    own = (folders[0] / "calibrated.urdf").read_bytes()
    mark = saved.fingerprint.encode()
    result = verify_bytes(saved, own.replace(mark, b"0" * len(mark)), "found.urdf")
    assert not result.is_calibration
    assert "the joint map or the data are not the same" in result.explanation


def test_a_cell_may_give_links_and_joints_a_prefix(folders):
    saved = irbcal.load(folders[0]).record
    own = (folders[0] / "calibrated.urdf").read_bytes()
    cell = (
        own.replace(b'"base_link"', b'"left_base_link"')
        .replace(b'"tool0"', b'"left_tool0"')
        .replace(b'"joint_', b'"left_joint_')
    )
    with pytest.raises(RobotError, match="there is no link 'base_link'"):
        verify_bytes(saved, cell, "cell.urdf")
    assert verify_bytes(saved, cell, "cell.urdf", "left_base_link", "left_tool0").is_calibration


def test_calibrating_a_calibrated_urdf_again_leaves_one_fingerprint(folders, tmp_path):
    again = irbcal.calibrate(folders[0].parent / "second.csv", folders[0] / "calibrated.urdf", "11")
    again.save(tmp_path / "again")
    text = (tmp_path / "again/calibrated.urdf").read_text()
    assert text.count("irbcal_calibration") == 1
    assert irbcal.load(tmp_path / "again").record.fingerprint in text


def test_command_line(folders):
    done = started("verify", folders[0], "--urdf", folders[0] / "calibrated.urdf", "--json")
    assert done.returncode == 0
    assert json.loads(done.stdout)["same_file"]
    done = started("verify", folders[0], "--urdf", folders[1] / "calibrated.urdf")
    assert done.returncode == 1
    assert "is not this calibration" in done.stdout
    done = started("verify", folders[0], "--urdf", folders[0] / "nothing.urdf")
    assert done.returncode == 1
    assert done.stderr.strip().endswith("nothing.urdf: there is no such file")


def test_a_program_bears_the_mark_of_its_calibration(folders, tmp_path):
    (tmp_path / "job.csv").write_text("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n10,20,-30,40,50,60\n")
    module = "MODULE job\n  CONST jointtarget p:=[[10,20,-30,40,50,60],[9E9,9E9,9E9,9E9,9E9,9E9]];\n"
    (tmp_path / "job.mod").write_text(module + "  PROC main()\n    MoveAbsJ p,v100,fine,tool0;\n  ENDPROC\nENDMODULE\n")
    for name in ("job.csv", "job.mod"):
        plain = verify(folders[0], program=tmp_path / name)
        assert (plain.is_calibration, plain.fingerprint) == (False, "absent")
        corrected = tmp_path / f"corrected_{name}"
        irbcal.correct(folders[0], tmp_path / name, out=corrected)
        own, other = (verify(folder, program=corrected) for folder in folders)
        assert (own.is_calibration, own.fingerprint) == (True, "same")
        assert (other.is_calibration, other.fingerprint) == (False, "other")
        assert "ANOTHER calibration" in other.explanation


def test_folders_of_programs_bear_marks_file_by_file(folders, tmp_path):
    source = tmp_path / "backup"
    source.mkdir()
    target = "CONST jointtarget p:=[[10,20,-30,40,50,60],[9E9,9E9,9E9,9E9,9E9,9E9]];"
    (source / "job.mod").write_text(
        f"MODULE job\n{target}\nPROC main()\nMoveAbsJ p,v100,fine,tool0;\nENDPROC\nENDMODULE\n"
    )
    (source / "other.mod").write_text("MODULE other\nPROC pause()\nWaitTime 1;\nENDPROC\nENDMODULE\n")
    assert verify(folders[0], program=source).fingerprint == "absent"
    new = tmp_path / "new"
    irbcal.correct(folders[0], source, out=new)
    for place in (new, new / "job.mod"):
        assert [verify(folder, program=place).fingerprint for folder in folders] == ["same", "other"]
    assert verify(folders[0], program=new).explanation.endswith("no mark, so no corrected target, in other.mod")
    assert "job.mod holds fake targets of ANOTHER" in verify(folders[1], program=new).explanation


def test_verify_needs_one_thing_to_compare(folders, tmp_path):
    with pytest.raises(OptionError, match="one of them"):
        verify(folders[0], urdf=folders[0] / "calibrated.urdf", program="job.mod")
    assert verify(folders[0]).differences == ()
    with pytest.raises(ProgramError):
        verify(folders[0], program=tmp_path / "none.mod")


def test_a_verification_is_true_where_it_is_the_calibration(folders):
    own, other = (verify(folders[0], folder / "calibrated.urdf") for folder in folders)
    assert own
    assert not other
    assert json.loads(json.dumps(own.to_dict()))["geometry"] == "calibrated"


def test_only_the_mark_of_a_program_is_looked_at(folders, tmp_path):
    job = tmp_path / "job.csv"
    job.write_text("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n10,-10,20,15,40,-30\n")
    irbcal.correct(folders[0], job, out=tmp_path / "new.csv")
    own, other = (verify(folder, program=tmp_path / "new.csv") for folder in folders)
    assert own
    assert not other
    assert own.explanation == "this program bears the mark of this calibration (its targets are not checked)"
    assert own.to_dict()["fingerprint"] == "same"
