"""What must not happen on the command line: names that act, inputs overwritten, files half-written, blocked trackers."""

import json
import re

import numpy as np
import pytest
from support import arm, example_robot
from typer.testing import CliRunner

from irbcal.cli import main
from irbcal.errors import CalibrationError, MeasurementError
from irbcal.io import robots, urdf_check
from irbcal.planning.collisions import CollisionModel


@pytest.fixture(scope="module")
def verification():
    """The first rows of the simulated verification."""
    return "\n".join(robots.demo_file("demo_verification.csv").read_text().splitlines()[:400]) + "\n"


def test_names_that_look_like_markup_are_shown_as_they_are(program, demo_calibration, verification, tmp_path):
    for name in ("run 3 [/dev/tty]", "[red]range", "[link=x]y"):
        lines = verification.splitlines()
        half = [line.replace("iso_cube", name) for line in lines[200:]]
        (tmp_path / "m.csv").write_text("\n".join([*lines[:200], *half]) + "\n")
        assert name in program("evaluate", demo_calibration, tmp_path / "m.csv")


@pytest.mark.parametrize(("old", "new", "column"), [("iso_cube", "a\x1b[31mred", "group"), ("smr1", "T\x01", "target")])
def test_control_characters_in_names_are_refused(program, demo_calibration, verification, tmp_path, old, new, column):
    (tmp_path / "m.csv").write_text(verification.replace(old, new))
    with pytest.raises(MeasurementError, match=rf"m\.csv: row \d+, column {column}: "):
        program("evaluate", demo_calibration, tmp_path / "m.csv")


def test_what_is_read_is_never_overwritten(program, demo_calibration, tmp_path):
    job = "q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n10,-10,20,15,40,-30\n"
    (tmp_path / "job.csv").write_text(job)
    (tmp_path / "link.csv").symlink_to(tmp_path / "job.csv")
    for out in ("job.csv", "link.csv"):
        with pytest.raises(CalibrationError):
            program("filter", demo_calibration, tmp_path / "job.csv", "--out", tmp_path / out)
        with pytest.raises(CalibrationError):
            program("simulate", tmp_path / "job.csv", "--robot", "irb1600", "--out", tmp_path / out)
    assert (tmp_path / "job.csv").read_text() == job


def test_a_folder_is_no_file_to_write(program, demo_calibration, tmp_path):
    (tmp_path / "job.csv").write_text("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n10,-10,20,15,40,-30\n")
    (tmp_path / "out").mkdir()
    with pytest.raises(CalibrationError, match=r"out: .*folder"):
        program("filter", demo_calibration, tmp_path / "job.csv", "--out", tmp_path / "out")


def test_readings_of_several_targets_are_no_drift(program, verification, tmp_path):
    lines = verification.splitlines()
    rows = [f"{line},{k}" for k, line in enumerate(lines[1:])]
    (tmp_path / "m.csv").write_text("\n".join([lines[0] + ",time_s", *rows]))
    with pytest.raises(MeasurementError, match=r"column target: .*found ref1"):
        program("tracker", tmp_path / "m.csv", "--check", "drift")


@pytest.mark.parametrize("name", ["irb1600", "ur10"])
def test_the_tracker_is_an_obstacle(name):
    """Where the tip goes, a ball is touched; far away it is not; nothing else changes."""
    path = robots.robot_file(name) if name == "irb1600" else example_robot("ur_description/urdf/ur10_robot.urdf")
    nominal = arm(path)
    model = CollisionModel(path.read_bytes(), nominal, package_dirs=robots.package_dirs())
    q = nominal.random_joints(40, 1)
    before = model.touching(q)
    model.add_obstacle([50.0, 0.0, 0.0], 0.25)
    assert (model.touching(q) == before).all()
    row = int(np.flatnonzero(~before)[0])
    tip = urdf_check.poses(path.read_bytes(), nominal, q[row : row + 1])[0, :3, 3]
    model.add_obstacle(tip, 0.25)
    after = model.touching(q)
    assert after[row]
    assert (after >= before).all()


def test_no_plan_runs_into_the_tracker(program, tmp_path):
    """The middle of the cube: what is left keeps its distance; inside the base it is refused."""
    with pytest.raises(MeasurementError, match="--tracker: expected a place at least 300 mm from the base link"):
        program("plan", "--robot", "irb1600", "--out", tmp_path / "p", "--tracker", "0,0,200")


# --- what made tracebacks once, as a user meets it ---------------------------------------------------------------

JOB = "q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n10,-10,20,15,40,-30\n"
BALLBAR = ("--bar", "150", "--tool", "0,65,149", "--joints", "10,0,0,0,90,0")
REPEATS = "position,x_mm,y_mm,z_mm\n" + "".join(f"P1,{900 + k / 100},0,0\n" for k in range(8))
POSES = "x_mm,y_mm,z_mm,qw,qx,qy,qz\n{},0,700,0,1,0,0\n"

HOSTILE = {
    "a tool that is nan": (["filter", "CAL", "job.csv", "--out", "o.csv", "--tool", "X=nan,0,0,1,0,0,0"], "X=nan", 2),
    "a tool that is only nan": (["filter", "CAL", "job.csv", "--out", "o.csv", "--tool", "X=nan"], "X=nan", 2),
    "an empty ballbar file": (["ballbar", "CAL", "empty.csv", *BALLBAR], "empty.csv", 1),
    "a ballbar file of a heading": (["ballbar", "CAL", "heading.csv", *BALLBAR], "no readings|no rows|empty", 1),
    "an input with a long name": (["fk", "CAL", "--joints", "x" * 300], "the name is too long", 1),
    "an output with a long name": (["filter", "CAL", "job.csv", "--out", "x" * 300 + ".csv"], "too long", 1),
    "a calibration with a long name": (["verify", "x" * 300], "the name is too long", 1),
    "a pose of a program at 1e308": (["filter", "CAL", "far.csv", "--out", "o.csv"], "1e\\+?308", 1),
    "a pose at 1e308": (["ik", "CAL", "--poses", "far.csv"], "row 2, column x_mm: expected a position within 1 km", 1),
    "a huge value in a plot": (["tracker", "huge.csv", "--check", "repeat", "--plot", "t.svg"], "huge.csv", 1),
    "a drift to infinity": (["tracker", "drift.csv", "--check", "drift", "--plot", "t.png"], "drift.csv", 1),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_call_ends_in_one_sentence(name, demo_calibration, tmp_path, monkeypatch, capsys):
    """Exit code 1 or 2, one sentence, and no file."""
    words, says, code = HOSTILE[name]
    for file, text in {
        "job.csv": JOB,
        "empty.csv": "",
        "heading.csv": "angle_deg,radius_mm\n",
        "far.csv": POSES.format("1e308"),
        "huge.csv": REPEATS.replace("900.03", "1e308"),
        "drift.csv": "time_s,x_mm,y_mm,z_mm\n" + "".join(f"{k},1e{k}00,0,0\n" for k in range(1, 4)),
    }.items():
        (tmp_path / file).write_text(text)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["irbcal", *(str(demo_calibration) if word == "CAL" else word for word in words)])
    with pytest.raises(SystemExit) as end:
        main.main()
    err = capsys.readouterr().err
    assert (end.value.code, "Traceback" in err) == (code, False), err
    flat = " ".join(err.replace("\u2502", " ").split())
    assert re.search(says, flat), flat
    assert code == 2 or len(err.splitlines()) == 1
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_pose_far_away_is_out_of_reach(demo_calibration, tmp_path):
    (tmp_path / "far.csv").write_text(POSES.format("9e5"))
    done = CliRunner().invoke(main.app, ["ik", str(demo_calibration), "--poses", str(tmp_path / "far.csv")])
    assert "out of the robot's reach" in done.stdout
    assert "nan" not in done.stdout


def test_a_joint_without_limits_is_null_in_json(tmp_path, monkeypatch, capsys):
    (tmp_path / "dh.csv").write_text("alpha_deg,a_mm,theta_deg,d_mm\n0,0,0,290\n-90,0,-90,0\n0,270,0,0\n")
    monkeypatch.setattr(
        "sys.argv",
        [
            "irbcal",
            "urdf",
            "--dh",
            str(tmp_path / "dh.csv"),
            "--convention",
            "modified",
            "--out",
            str(tmp_path / "a.urdf"),
            "--json",
        ],
    )
    with pytest.raises(SystemExit):
        main.main()
    rows = json.loads(capsys.readouterr().out)["joints"]
    assert [row["lower"] for row in rows] == [None] * 3
