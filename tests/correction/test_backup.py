"""Backups: where the robot stands, tools and frames beside programs, archives, controllers that correct by themselves."""

import gzip
import io
import zipfile

import numpy as np
import pytest
from maker_cases import given, pose_numbers, robot_of, well_inside
from scipy.spatial.transform import Rotation
from support import arm

from irbcal.correction import backup
from irbcal.correction.languages import by_name, fanuc, inform, krl, rapid
from irbcal.correction.program import ControllerSetup
from irbcal.errors import ProgramError
from irbcal.io.controller_model import unknown_frames

ROOT = "FRAME $ROBROOT={X 1000.0,Y -200.0,Z 500.0,A 90.0,B 0.0,C 0.0}\n"
MOC = (
    'MOC:CFG_1.0:6:0::\n#\nROBOT_TYPE:\n\n      -name "ROB1_X" -base_frame_pos_x 9\n#\nROBOT:\n\n'
    '      -name "ROB_1" -use_robot_type "ROB1_X" -use_old_smb -use_robot_calib "r1_uncalib"\\\n'
    "      -base_frame_pos_x 1 -base_frame_pos_y -0.2 -base_frame_pos_z 0.5\\\n"
    '      -base_frame_orient_u0 0.70710678118 -base_frame_orient_u3 0.70710678118\n#\nSINGLE:\n\n      -name "T"\n'
)
PLACE = np.eye(4)
PLACE[:3, :3], PLACE[:3, 3] = Rotation.from_euler("z", 90, degrees=True).as_matrix(), [1.0, -0.2, 0.5]


def laid(folder, files):
    for name, text in files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(text if isinstance(text, bytes) else text.encode("latin-1"))
    return [folder / name for name in files]


def test_kuka_bases_count_from_the_world_in_which_the_robot_stands(tmp_path):
    nominal, _, at = robot_of("kr120r2500pro")
    q = well_inside(nominal, 4)
    test_krl = languages_test("krl")
    world = PLACE @ nominal.forward(q)
    points = [
        f"LIN {{{test_krl.text(row)},S {s},T {t}}}"
        for row, (s, t) in zip(
            pose_numbers(world, "ZYX"), [test_krl.status_and_turn(nominal, row) for row in q], strict=True
        )
    ]
    src = "\n".join(["DEF job()", "$TOOL=$NULLFRAME", "$BASE=$NULLFRAME", *points, "END", ""])
    files = laid(
        tmp_path, {"KRC/R1/Program/job.src": src, "KRC/R1/Mada/$machine.dat": f"DEFDAT $MACHINE\n{ROOT}ENDDAT\n"}
    )
    found = krl.backup(files[:1])
    np.testing.assert_allclose(found.T_world_base, PLACE, rtol=0, atol=1e-12)
    assert not found.accuracy
    (seen,) = krl.read_for(nominal, files[:1], given(at)._replace(T_world_base=found.T_world_base))
    (batch,) = seen.wanted_targets()
    np.testing.assert_allclose(batch.values, nominal.forward(q), rtol=0, atol=5e-8)
    np.testing.assert_allclose(batch.joints, q, rtol=0, atol=1e-6)


def languages_test(name):
    from maker_cases import language_tests

    return language_tests(name)


def test_abb_work_objects_count_from_the_world_in_which_the_robot_stands(tmp_path):
    nominal = arm()
    q = np.radians([10, -15, 25, 15, 45, 30])
    T = PLACE @ nominal.forward(q[None])[0]
    x, y, z, w = Rotation.from_matrix(T[:3, :3]).as_quat()
    numbers = ",".join(f"{1e3 * v:.6f}" for v in T[:3, 3]), ",".join(f"{v:.9f}" for v in (w, x, y, z))
    pose = f"[[{numbers[0]}],[{numbers[1]}],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
    text = f"MODULE M\nPROC main()\nMoveL {pose},v100,fine,tool0;\nENDPROC\nENDMODULE\n"
    files = laid(tmp_path, {"b/RAPID/TASK1/PROGMOD/M.mod": text, "b/SYSPAR/MOC.cfg": MOC})
    found = rapid.backup(files[:1])
    np.testing.assert_allclose(found.T_world_base, PLACE, rtol=0, atol=1e-10)
    assert not found.accuracy, "r1_uncalib: switched off"
    setup = ControllerSetup({}, {}, unknown_frames(), T_world_base=found.T_world_base)
    (seen,) = rapid.read_for(nominal, files[:1], setup)
    (batch,) = seen.wanted_targets()
    np.testing.assert_allclose(batch.values[0], nominal.forward(q[None])[0], rtol=0, atol=1e-8)


def test_robots_in_different_places_are_refused(tmp_path):
    two = MOC.replace("#\nSINGLE:", '\n      -name "ROB_2" -base_frame_pos_x 2\n#\nSINGLE:')
    files = laid(tmp_path, {"b/RAPID/TASK1/M.mod": "MODULE M\nENDMODULE\n", "b/SYSPAR/moc.cfg": two})
    with pytest.raises(ProgramError, match="robots stand in different places"):
        rapid.backup(files[:1])
    plain = laid(
        tmp_path / "c",
        {"b/RAPID/TASK1/M.mod": "MODULE M\nENDMODULE\n", "b/SYSPAR/MOC.cfg": 'ROBOT:\n\n -name "ROB_1"\n'},
    )
    assert rapid.backup(plain[:1]).T_world_base is None
    odd = laid(tmp_path / "d", {"b/RAPID/M.mod": "", "b/SYSPAR/MOC.cfg": MOC.replace("u0 0.707", "u0 0.2")})
    with pytest.raises(ProgramError, match="expected a unit quaternion"):
        rapid.backup(odd[:1])


WAYPOINT = b'<Waypoint><Kinematics status="LINEARIZED" validChecksum="true"><a value="0"/></Kinematics></Waypoint>'


@pytest.mark.parametrize(
    ("language", "files", "words"),
    [
        (
            "rapid",
            {"b/RAPID/M.mod": "", "b/SYSPAR/MOC.cfg": MOC.replace("uncalib", "calib")},
            "use_robot_calib r1_calib",
        ),
        ("krl", {"KRC/R1/a.src": "", "KRC/R1/Mada/$machine.dat": "BOOL $ABS_ACCUR=TRUE\n"}, "absolutely accurate"),
        ("krl", {"KRC/R1/a.src": "", "KRC/R1/Mada/$machine.dat": "BOOL $ABS_ACCUR=FALSE\n;$ABS_ACCUR=TRUE\n"}, ""),
        ("krl", {"KRC/R1/a.src": "", "KRC/Roboter/12.PID": "x"}, "12.PID is in the backup"),
        ("krl", {"KRC/R1/a.src": "", "Roboter/Rdc/12.pid": "x"}, "12.pid is in the backup"),
        ("krl", {"KRC/R1/a.src": "", "Other/12.pid": "x"}, ""),
        ("krl", {"KRC/R1/a.src": "", "KRC/12.pid": "x", "KRC/$custom.dat": "$DEACTIVATE_ABS_ACCUR=TRUE\n"}, ""),
        ("krl", {"KRC/R1/a.src": "DEF a()\n$ABS_ACCUR = TRUE\nEND\n"}, "a.src switches on"),
        ("krl", {"a.src": "DEF a()\n; $ABS_ACCUR=TRUE\nEND\n"}, ""),
        ("urscript", {"a.script": "", "a.urp": gzip.compress(WAYPOINT)}, "waypoints of a.urp"),
        ("urscript", {"a.script": "", "a.urp": gzip.compress(WAYPOINT.replace(b"LINEARIZED", b"NOT_INITIALIZED"))}, ""),
        ("urscript", {"a.script": "", "a.urp": b"\x1f\x8bdamaged"}, ""),
        ("urscript", {"a.script": "", "calibration.conf": "[mounting]\ncalibration_status = 2\n"}, "calibration.conf"),
        ("urscript", {"a.script": "", "calibration.conf": "[mounting]\ncalibration_status = 0\n"}, ""),
        ("fanuc", {"a.ls": ""}, ""),
    ],
)
def test_controllers_that_correct_their_robot_are_recognised(tmp_path, language, files, words):
    found = by_name()[language].backup(laid(tmp_path, files)[:1])
    assert (words in found.accuracy) if words else not found.accuracy


def test_files_of_a_backup_without_any_entry_say_nothing(tmp_path):
    laid(tmp_path, {"TOOL.CND": "", "UFRAME.CND": "no heading\n"})
    assert inform.backup_of(tmp_path) == ({}, {}, {})
    laid(tmp_path, {"SYSFRAME.VA": "", "RAPID/a.mod": "\n", "SYSPAR/MOC.cfg": "-name\n"})
    assert fanuc.frames_beside(tmp_path) == ({}, {})
    assert rapid.backup([tmp_path / "RAPID/a.mod"]).accuracy == ""


def test_yaskawa_tools_and_user_frames_stand_beside_the_job(tmp_path):
    nominal, _, at = robot_of("gp8")
    job = (
        "/JOB\r\n//NAME J\r\n//POS\r\n///NPOS 1,0,0,0,0,0\r\n///USER 2\r\n///TOOL 3\r\n///POSTYPE USER\r\n///RECTAN\r\n"
        "///RCONF 0,0,0,0,0,0,0,0\r\nC00000=400.000,10.000,200.000,180.0000,10.0000,20.0000\r\n//INST\r\n///GROUP1 RB1\r\n"
        "NOP\r\nMOVL C00000 V=10\r\nEND\r\n"
    )
    tools = (
        "//TOOL 0\n///NAME \n0,0,0,0,0,0\n0.0\n//TOOL 3\n///NAME grip\n10.5,-2,150,0.0000,30.0000,0.0000\n1.2\n0,0,0\n"
    )
    users = "//UFRAME 2\n///NAME part\n///TOOL 3\n////BUSER 100,200,-50.5,0.0000,0.0000,90.0000\n//UFRAME 4\n///NAME\n"
    laid(tmp_path, {"J.JBI": job, "TOOL.CND": tools.replace("\n", "\r\n"), "UFRAME.CND": users.replace("\n", "\r\n")})
    found = inform.backup_of(tmp_path)[:2]
    assert {name: list(values) for name, values in zip("tu", found, strict=True)} == {"t": ["0", "3"], "u": ["2"]}
    np.testing.assert_allclose(found[0]["3"][:3, 3], [0.0105, -0.002, 0.15], rtol=0, atol=1e-12)
    R = Rotation.from_euler("xyz", [0, 30, 0], degrees=True).as_matrix()
    np.testing.assert_allclose(found[0]["3"][:3, :3], R, rtol=0, atol=1e-12)
    np.testing.assert_allclose(found[1]["2"] @ [1, 0, 0, 1], [0.1, 1.2, -0.0505, 1], rtol=0, atol=1e-12)
    (seen,) = inform.read_for(nominal, [tmp_path / "J.JBI"], given(at))
    assert seen.correctable(), seen.unchanged_targets()
    assert any("tool 3, user frame 2: the numbers are those of TOOL.CND" in note.text for note in seen.notes)
    (tmp_path / "TOOL.CND").write_text(tools + "//TOOL 3\n///NAME other\n1,2,3,0,0,0\n")
    (seen,) = inform.read_for(nominal, [tmp_path / "J.JBI"], given(at))
    assert not seen.correctable(), "two tools of one number are none"


PR = "".join(f"   {k}:  PR[9,{k}]={v} ;\n" for k, v in enumerate(["10", "(-20.5)", "150", "0", "30", "0"], 1))


@pytest.mark.parametrize(
    ("lines", "tool", "why"),
    [
        (f"{PR}   7:  UTOOL[9]=PR[9] ;\n", [10, -20.5, 150, 0, 30, 0], ""),
        (f"{PR}   7:  UTOOL[9]=PR[9] ;\n", [10, -20.5, 151, 0, 30, 0], "give --tool 9=10,-20.5,150,0,30,0"),
        (f"{PR}   7:  LBL[1] ;\n   8:  UTOOL[9]=PR[9] ;\n", [10, -20.5, 150, 0, 30, 0], "changes UTOOL[9]"),
        (f"{PR}   7:  PR[9]=LPOS ;\n   8:  UTOOL[9]=PR[9] ;\n", [10, -20.5, 150, 0, 30, 0], "changes UTOOL[9]"),
        (f"{PR}   7:  PR[R[1]]=LPOS ;\n   8:  UTOOL[9]=PR[9] ;\n", [10, -20.5, 150, 0, 30, 0], "changes UTOOL[9]"),
        (f"{PR}   7:  PR[9,2]=R[1] ;\n   8:  UTOOL[9]=PR[9] ;\n", [10, -20.5, 150, 0, 30, 0], "changes UTOOL[9]"),
        ("   7:  UTOOL[9]=PR[9] ;\n", [10, -20.5, 150, 0, 30, 0], "changes UTOOL[9]"),
    ],
)
def test_a_fanuc_tool_set_from_numbers_is_known_where_the_caller_says_the_same(lines, tool, why):
    nominal, _, at = robot_of("m20ia")
    tests = languages_test("fanuc")
    q = tests.in_front(nominal, 1)
    T = np.linalg.inv(at.T_base_world) @ nominal.forward(q)
    point = tests.point(1, pose_numbers(T, "xyz")[0], tests.config(q[0]), 0, 9)
    text = f"/PROG  A\n/ATTR\n/MN\n{lines}   9:L P[1] 100mm/sec FINE ;\n/POS\n{point}/END\n"
    T_tool = fanuc.FANUC.frame(tool)
    seen = fanuc.parse(nominal, text.encode(), "a.ls", given(at, tools={"9": T_tool}))
    (target,) = seen.targets
    assert (why in target.reason) if why else target.correctable, target.reason


def zipped(files, name="b.zip"):
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as archive:
        for member, content in files.items():
            # of no date: tests are named by it
            archive.writestr(zipfile.ZipInfo(member), content, zipfile.ZIP_DEFLATED)
    return data.getvalue()


def test_an_archive_is_searched_like_a_folder_and_written_in_its_shape(tmp_path):
    files = {"KRC/R1/a.src": b"DEF a()\nEND\n", "am.ini": b"[x]\r\n", "KRC\\R1\\b.dat": b"DEFDAT b\nENDDAT\n"}
    (tmp_path / "b.zip").write_bytes(zipped(files))
    with backup.unpacked([tmp_path / "b.zip", tmp_path / "other.src"]) as opened:
        folder, other = opened.programs
        assert other == tmp_path / "other.src"
        assert sorted(path.name for path in folder.rglob("*.*")) == ["a.src", "am.ini", "b.dat"]
        assert opened.with_archives(str(folder / "KRC/R1/a.src")) == f"{tmp_path}/b.zip!KRC/R1/a.src"
    assert not folder.exists()
    new = backup.packed(tmp_path / "b.zip", {"KRC/R1/a.src": b"new", "changes.csv": b"table"})
    with zipfile.ZipFile(io.BytesIO(new)) as archive:
        assert archive.read("KRC/R1/a.src") == b"new"
        assert archive.read("changes.csv") == b"table"
        assert len(archive.namelist()) == 4
        assert archive.read("am.ini") == files["am.ini"]
    with pytest.raises(ProgramError, match=r"b\.zip!KRC/R1/a\.src"), backup.unpacked([tmp_path / "b.zip"]) as opened:
        raise ProgramError("no", file=opened.programs[0] / "KRC/R1/a.src")


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (zipped({"../a.src": b"x"}), "would lie outside of its folder"),
        (zipped({"/etc/a.src": b"x"}), "would lie outside"),
        (zipped({"C:/a.src": b"x"}), "would lie outside"),
        (zipped({"a\\..\\..\\b.src": b"x"}), "would lie outside"),
        (zipped({"a": b"x", "a/b": b"x"}), "of the archive"),
        (b"PK\x03\x04 no archive", "not a zip archive"),
        (zipped({"a.src": b"x" * 1000})[:-30], "not a zip archive"),
    ],
)
def test_archives_that_would_do_harm_are_refused(tmp_path, data, words):
    (tmp_path / "b.zip").write_bytes(data)
    with pytest.raises(ProgramError, match=words), backup.unpacked([tmp_path / "b.zip"]):
        pass
    assert [path.name for path in tmp_path.rglob("*")] == ["b.zip"]


def test_large_archives_are_refused_before_they_are_unpacked(tmp_path, monkeypatch):
    monkeypatch.setattr(backup, "LARGEST_ARCHIVE", 10_000)
    (tmp_path / "b.zip").write_bytes(zipped({"a.src": b"0" * 20_000}))
    assert (tmp_path / "b.zip").stat().st_size < 1000
    with pytest.raises(ProgramError, match="at most 50000 files of together"), backup.unpacked([tmp_path / "b.zip"]):
        pass
