"""Touches out of programs: the joints of a point are those to which its controller moves for it."""

import json
import os
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from maker_cases import LANGUAGES, language_tests, pose_numbers, robot_of, universal_robot, well_inside
from typer.testing import CliRunner

import irbcal
from irbcal.cell.cell_file import read_cell
from irbcal.cli import main
from irbcal.correction.languages import ProgramFiles, by_name
from irbcal.correction.opened_programs import OpenedPrograms
from irbcal.correction.program import ControllerSetup
from irbcal.correction.program_touches import _points
from irbcal.errors import MeasurementError, ProgramError

FOLDER = Path(os.environ.get("IRBCAL_SHARED_DATA", "../shared/data")) / "cell_example"
TOOL_3 = [0.0328, 0.116472, 182.395218, 0, 0, 0]
"""Of ``$config.dat``: mm, A, B, C in degrees."""


@pytest.mark.parametrize("language", LANGUAGES)
def test_points_have_the_joints_to_which_the_controller_moves(language):
    name, _, _ = LANGUAGES[language]
    tests = language_tests(language)
    robots = nominal, _, at = universal_robot() if name is None else robot_of(name)
    q = tests.joints(3) if language == "urscript" else getattr(tests, "in_front", well_inside)(nominal, 3)
    arguments = {"krl": (nominal, q), "fanuc": (nominal, at, q)}.get(language, (robots, q))
    program = tests.parsed(robots, tests.program(*arguments))
    setup = ControllerSetup({}, {}, at)
    files = ProgramFiles(by_name()[language], [], {}, [])
    points = _points(OpenedPrograms(None, nominal, files, [program], setup, None, None))
    kinds = {"joint": 0, "pose": 0}
    for number in program.correctable():
        target = program.targets[number]
        (point,) = points[target.name.lower()]
        assert point.reason == ""
        assert np.abs(point.q - q).max(axis=1).min() < 1e-4, target.name
        kinds[target.kind] += 1
    assert min(kinds.values()) >= 1, kinds


# ---------------------------------------------------------------- from the touches of the example to its cell


def run(*words):
    return CliRunner(env={"COLUMNS": "300", "NO_COLOR": "1"}).invoke(main.app, [*map(str, words)])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A calibration, and ``taught.src`` with ``taught.dat``: the example's touches as poses in $NULLFRAME."""
    if not FOLDER.is_dir():
        pytest.skip(f"{FOLDER} is not here")
    path = tmp_path_factory.mktemp("touches")
    calibration = irbcal.calibrate(FOLDER / "measurements.csv", FOLDER / "kr16.urdf", "34")
    irbcal.save(calibration, path / "cal")
    touches = pd.read_csv(FOLDER / "touches.csv")
    q = np.radians(touches[[f"q{k}_deg" for k in range(1, 7)]].to_numpy())
    T = calibration.record.arm(calibrated=False).forward(q)
    tool = np.eye(4)
    tool[:3, 3] = np.array(TOOL_3[:3]) * 1e-3
    T[touches["frame"] == "work_object"] @= tool
    dat, src = ["DEFDAT taught PUBLIC"], ["DEF taught()", "BAS(#BASE,0)", "BAS(#TOOL,0)"]
    for k, (joints, numbers) in enumerate(zip(q, pose_numbers(T, "ZYX"), strict=True), 1):
        values = ",".join(f"{name} {value:.6f}" for name, value in zip("XYZABC", numbers, strict=True))
        s = 2 * int(joints[2] > -0.1) | 4 * int(joints[4] < 0)
        dat.append(f"DECL E6POS XP{k}={{{values},S {s},T {sum(1 << j for j in range(6) if joints[j] < 0)}}}")
        src += ["BAS(#TOOL,3)"] * (touches["frame"][k - 1] == "work_object") + [f"PTP XP{k}"]
    (path / "taught.dat").write_text("\n".join([*dat, "DECL E6POS XSPARE={X 1,Y 2,Z 3,A 0,B 0,C 0}", "ENDDAT", ""]))
    (path / "taught.src").write_text("\n".join([*src, "END", ""]))
    return path


def test_the_same_cell_as_from_a_table_of_joints(folder):
    program = ["--program", folder / "taught.src", "--program", FOLDER / "$config.dat"]
    typed = ["tool 3 socket=XP1,XP2,XP3,XP4,XP5,xp6", "work_object 1 origin=XP7", "work_object 1 x 3=XP8"]
    words = [word for text in (*typed, "work_object 1 xy 3=XP9") for word in ("--touch", text)]
    done = run("cell", folder / "cal", *program, *words, "--out", folder / "typed.json", "--as", "kuka")
    assert done.exit_code == 0, done.output
    table = pd.read_csv(FOLDER / "touches.csv", dtype=str)[["frame", "name", "point", "tool"]]
    table.assign(target=[f"XP{k}" for k in range(1, 10)]).to_csv(folder / "pairs.csv", index=False)
    done = run("cell", folder / "cal", folder / "pairs.csv", *program, "--out", folder / "pairs.json")
    assert done.exit_code == 0, done.output
    joints = irbcal.cell_frames(folder / "cal", FOLDER / "touches.csv")
    for name in ("typed", "pairs"):
        cell = read_cell(folder / f"{name}.json")
        np.testing.assert_allclose([t.q for t in cell.touches], [t.q for t in joints.touches], rtol=0, atol=1e-7)
        np.testing.assert_allclose(cell.work_objects["1"].T_true, joints.work_objects["1"].T_true, rtol=0, atol=1e-7)
        # the program's own numbers are those that the controller has
        np.testing.assert_allclose(cell.tools["3"].T_controller[:3, 3] * 1e3, TOOL_3[:3], rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("target", "fault"),
    [
        ("XP77", r"expected a point of taught.src, \$config.dat, such as XP1 of taught.dat, .*, found 'XP77'"),
        ("XSPARE", r"the joints of XSPARE \(line 11 of taught\.\w+\) are not known"),
    ],
)
def test_points_that_tell_nothing_are_refused(folder, target, fault):
    table = pd.DataFrame([["tool", "3", "socket", "3", target]], columns=["frame", "name", "point", "tool", "target"])
    with pytest.raises(MeasurementError, match=fault) as refused:
        irbcal.cell_frames(folder / "cal", table, program=[folder / "taught.src", FOLDER / "$config.dat"])
    assert (refused.value.row, refused.value.column) == (1, "target")


def test_fake_targets_are_no_touches(folder):
    frames = {"tool": {"3": np.eye(4)}}
    irbcal.correct(folder / "cal", folder / "taught.src", out=folder / "fake", allow_partial=True, **frames)
    table = pd.DataFrame([["tool", "3", "socket", "XP1"]], columns=["frame", "name", "point", "target"])
    with pytest.raises(ProgramError):
        irbcal.cell_frames(folder / "cal", table, program=folder / "fake" / "taught.src", **frames)


def test_a_name_in_two_programs_tells_nothing(folder, tmp_path):
    for name in ("a", "b"):
        (tmp_path / f"{name}.src").write_text(f"DEF {name}()\nEND\n")
        (tmp_path / f"{name}.dat").write_text(
            f"DEFDAT {name}\nDECL E6AXIS XP1={{A1 0,A2 -90,A3 90,A4 0,A5 10,A6 0}}\nENDDAT\n"
        )
    table = pd.DataFrame([["tool", "3", "socket", "XP1"]], columns=["frame", "name", "point", "target"])
    with pytest.raises(MeasurementError, match=r"XP1 stands in line 2 of a\.\w+ and in line 2 of b\.\w+"):
        irbcal.cell_frames(folder / "cal", table, program=[tmp_path / "a.src", tmp_path / "b.src"])


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        ([], "give a file, or points of a --program with --touch"),
        (["job.src"], "name it with --program, and its points that are touches with --touch"),
        (["touches.csv", "--touch", "tool 1 a=P1"], "touches stand in a file or are typed, not both"),
        (["--touch", "tool 1 a=P1"], "it goes with --program"),
        (["touches.csv", "--pulses", "1,1,1,1,1,1"], "it goes with --program"),
        (["--program", "job.src", "--touch", "tool 1=P1"], "expected FRAME NAME POINT"),
    ],
)
def test_wrong_calls_say_what_goes_together(words, fault):
    done = run("cell", "nowhere", *words, "--out", "cell.json")
    assert done.exit_code == 2
    assert fault in " ".join(done.output.replace("│", " ").split())


def test_a_backup_lists_its_tools_work_objects_and_the_touches_to_make(folder, tmp_path):
    backup = tmp_path / "KRC" / "R1"
    (backup / "Program").mkdir(parents=True)
    (backup / "System").mkdir()
    point = "{X 1200,Y 0,Z 900,A 0,B 90,C 0,S 2,T 2}"
    moves = [f"BAS(#TOOL,{tool})\nBAS(#BASE,{base})\nLIN {point}" for tool, base in ((3, 1), (3, 1), (5, 0), (0, 0))]
    (backup / "Program" / "a.src").write_text("\n".join(["DEF a()", *moves, "END", ""]))
    config = [
        "DEFDAT $CONFIG",
        "TOOL_DATA[3]={X 1,Y 2,Z 150,A 0,B 0,C 90}",
        "BASE_DATA[1]={X 800,Y 0,Z 300,A 0,B 0,C 0}",
    ]
    (backup / "System" / "$config.dat").write_text("\n".join([*config, "ENDDAT", ""]))
    with zipfile.ZipFile(tmp_path / "backup.zip", "w") as archive:
        for file in sorted(tmp_path.rglob("*.[sd][ra]*")):
            archive.write(file, file.relative_to(tmp_path))
    found = irbcal.needed_touches(folder / "cal", tmp_path / "KRC")
    listed = [(frame.frame, frame.name, frame.tool, frame.targets) for frame in found.frames]
    assert listed == [("tool", "3", "3", 2), ("work_object", "1", "3", 2), ("tool", "5", "5", 1)]
    rows = found.to_frame().set_index("name")
    half = np.sqrt(0.5)
    numbers = ["x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz"]
    np.testing.assert_allclose(rows.loc["3", numbers].astype(float), [1, 2, 150, half, half, 0, 0], rtol=0, atol=1e-9)
    np.testing.assert_allclose(rows.loc["1", numbers].astype(float), [800, 0, 300, 1, 0, 0, 0], rtol=0, atol=1e-9)
    assert rows.loc["5", numbers].isna().all(), "the programs do not say it"
    for source in (tmp_path / "KRC", tmp_path / "backup.zip"):
        done = run("cell", folder / "cal", source, "--out", tmp_path / "touches.csv", "--json")
        assert done.exit_code == 0, done.output
        assert [row["name"] for row in json.loads(done.stdout)["frames"]] == ["3", "1", "5"]
        table = pd.read_csv(tmp_path / "touches.csv", dtype=str)
        assert list(table.columns) == ["frame", "name", "point", "tool", *(f"q{k}_deg" for k in range(1, 7))]
        points = table.groupby(["frame", "name"])["point"].agg(list).to_dict()
        assert points["work_object", "1"] == ["origin", "x", "xy"]
        assert points["tool", "3"] == points["tool", "5"] == ["socket"] * 4
    # with joints at the touches of a tool and a work object it is a table of touches
    example = pd.read_csv(FOLDER / "touches.csv")
    both = table[table["name"] != "5"].copy()
    for frame in ("tool", "work_object"):
        q = example[example["frame"] == frame].filter(like="_deg").to_numpy()
        at = both.index[both["frame"] == frame]
        both.loc[at, [f"q{k}_deg" for k in range(1, 7)]] = q[: len(at)].astype(str)
    cell = irbcal.cell_frames(folder / "cal", both.reset_index(drop=True))
    assert set(cell.tools) == {"3"}
    assert set(cell.work_objects) == {"1"}
    (backup / "Program" / "a.src").write_text(f"DEF a()\n{moves[3]}\nEND\n")
    done = run("cell", folder / "cal", tmp_path / "KRC", "--out", tmp_path / "none.csv")
    assert done.exit_code == 0, done.output
    assert "no tool and no work object" in done.output
    assert not (tmp_path / "none.csv").exists()
    wrong = run("cell", folder / "cal", tmp_path / "KRC", "--out", tmp_path / "t.csv", "--payload", "3")
    assert wrong.exit_code == 2
    assert "--payload" in wrong.output
