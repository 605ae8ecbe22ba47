"""The command line as a user meets it: real files in, files and figures out, one sentence for bad input."""

import json
import os
import re
import subprocess
import sys

import numpy as np
import pandas as pd
import pytest
from support import arm, measured, random_robot, started, write_measurements
from typer.main import get_command

import irbcal
from irbcal.cli.main import app


def refused(*arguments):
    """The one sentence of a refusal."""
    done = started(*arguments)
    assert done.returncode == 1, done.stderr
    assert "Traceback" not in done.stderr
    assert done.stderr.count("\n") == 1
    assert done.stdout == ""
    return done.stderr


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    """A folder with good measurements of a simulated IRB 120."""
    folder = tmp_path_factory.mktemp("cli")
    nominal = arm("irb120")
    rng = np.random.default_rng(3)
    truth = random_robot(nominal, "34", rng)
    points = measured(truth, nominal.random_joints(60, 1), 3e-5, rng)
    write_measurements(folder / "good.csv", points)
    return folder


@pytest.fixture(scope="module")
def calibration(data):
    """The same calibrated by the program."""
    done = started(
        "calibrate", data / "good.csv", "--robot", "irb120", "--model", "34", "--out", data / "cal", "--json"
    )
    assert done.returncode == 0, done.stderr
    return data / "cal", json.loads(done.stdout)


def edited(data, name, change):
    """A copy of the good file with its table changed."""
    table = pd.read_csv(data / "good.csv")
    change(table).to_csv(data / name, index=False)
    return data / name


@pytest.mark.parametrize("arguments", [["calibrate"], ["nonsense"]])
def test_wrong_calls_exit_with_2(arguments):
    assert started(*arguments).returncode == 2


def test_calibrate_json_keeps_its_contract(calibration):
    folder, result = calibration
    assert result["out"] == str(folder)
    assert result["poses"] == {"fit": 45, "heldout": 15, "excluded": 0}
    assert result["objective"]["name"] == "rms"
    assert result["objective"]["lower_bound_mm"] is None
    assert (result["rank"], result["parameters"]) == (38, 43)
    assert result["heldout"]["mean_mm"] < 0.2 < result["nominal_heldout"]["mean_mm"]
    for key in ("fit", "heldout", "nominal_heldout"):
        assert set(result[key]) == {"n", "mean_mm", "sigma_mm", "max_mm", "mean_plus_3sigma_mm", "rms_mm"}
    assert 0 <= result["urdf_witnesses"]["position_m"] < 1e-9
    assert 0 <= result["urdf_witnesses"]["rotation_rad"] < 1e-9
    assert sorted(path.name for path in folder.iterdir()) == [
        "calibrated.urdf",
        "calibration.json",
        "joint_origins.yaml",
        "report.html",
    ]


def test_evaluate_json_keeps_its_contract(calibration, data):
    done = started("evaluate", calibration[0], data / "good.csv", "--json")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert set(result["per_target"]) == {"smr1", "smr2", "smr3"}
    assert result["per_target"]["smr1"]["calibrated"]["n"] == 15  # the 45 that were fitted are left out
    assert result["calibrated"]["rms_mm"] < 0.1 * result["nominal"]["rms_mm"]
    assert result["excluded"] == []
    assert any("45 of these 60 poses" in note and "left out" in note for note in result["notes"])
    whole = json.loads(started("evaluate", calibration[0], data / "good.csv", "--include-fitted", "--json").stdout)
    assert whole["per_target"]["smr1"]["calibrated"]["n"] == 60


def test_tables_for_people(calibration, data):
    done = started("evaluate", calibration[0], data / "good.csv")
    assert done.returncode == 0
    assert "model 34" in done.stdout
    assert "left out" in done.stdout
    assert max(map(len, done.stdout.splitlines()[1:12])) <= 100


def test_moved_tracker_is_noticed_and_can_be_placed_anew(calibration, data):
    def moved(table):
        table["x_mm"] += 5000
        return table

    path = edited(data, "moved.csv", moved)
    assert "evaluate with --refit-base" in refused("evaluate", calibration[0], path)
    done = started("evaluate", calibration[0], path, "--refit-base", "--json")
    assert json.loads(done.stdout)["calibrated"]["mean_mm"] < 0.1


def test_fk_of_urdf_and_calibration(calibration, data):
    folder, _ = calibration
    joints = data / "joints.csv"
    joints.write_text("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n0,0,0,0,0,0\n10,20,30,40,50,60\n")
    done = started("fk", "irb1600", "--joints", joints)
    lines = done.stdout.splitlines()
    assert lines[0] == "q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,x_mm,y_mm,z_mm,qw,qx,qy,qz"
    assert np.abs(np.array(lines[1].split(","), float)[6:9] - [815, 0, 1186.5]).max() < 1e-6
    assert np.abs(np.array(lines[1].split(","), float)[9:] - [np.sqrt(0.5), 0, np.sqrt(0.5), 0]).max() < 1e-8
    robot = irbcal.load(folder).robot_calibrated()
    q = np.radians([[0, 0, 0, 0, 0, 0], [10, 20, 30, 40, 50, 60]])
    done = started("fk", folder, "--joints", joints, "--json")
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert np.abs([[r["x_mm"], r["y_mm"], r["z_mm"]] for r in rows] - robot.poses(q)[:, :3, 3] * 1e3).max() < 1e-9
    done = started("fk", folder, "--joints", joints, "--target", "smr2", "--json")
    rows = [json.loads(line) for line in done.stdout.splitlines()]
    assert np.abs([[r["x_mm"], r["y_mm"], r["z_mm"]] for r in rows] - robot.points(q, "smr2") * 1e3).max() < 1e-9
    assert "unknown target 'smr9'" in refused("fk", folder, "--joints", joints, "--target", "smr9")


def test_demo_calls_its_data_simulated(tmp_path):
    done = started("demo", "--out", tmp_path / "demo")
    assert done.returncode == 0, done.stderr
    assert "SIMULATED" in done.stdout
    loaded = irbcal.load(tmp_path / "demo")
    assert loaded.record.simulated
    assert loaded.record.poses_heldout == 1000
    assert loaded.record.heldout.all.mean_mm < 0.05 < 0.9 < loaded.record.heldout_nominal.all.mean_mm
    assert "simulated" in (tmp_path / "demo" / "report.html").read_text().lower()


def test_same_input_gives_the_same_calibration(calibration, data, tmp_path):
    started("calibrate", data / "good.csv", "--robot", "irb120", "--model", "34", "--out", tmp_path / "two")
    texts = [(folder / "calibrated.urdf").read_text() for folder in (calibration[0], tmp_path / "two")]
    without_date = [re.sub(r" on \d{4}-[\d:T+-]+: ", "", text) for text in texts]
    assert without_date[0] == without_date[1] != texts[1]


# --- bad input -----------------------------------------------------------------------------------------


def test_a_bad_measurement_file_leaves_nothing(data, tmp_path):
    bad = edited(data, "bad.csv", lambda table: table.drop(columns="target"))
    message = refused("calibrate", bad, "--robot", "irb120", "--out", tmp_path / "out")
    assert "row 1: missing column target" in message
    assert not (tmp_path / "out" / "calibration.json").exists()


def test_bad_robots_and_folders(data, tmp_path):
    assert "'nothing.urdf'" in refused(
        "calibrate", data / "good.csv", "--robot", "nothing.urdf", "--out", tmp_path / "out"
    )
    message = refused("calibrate", data / "good.csv", "--robot", "irb120", "--out", "/proc/irbcal")
    assert "/proc/irbcal" in message
    assert "cannot hold out 70 of 60" in refused(
        "calibrate", data / "good.csv", "--robot", "irb120", "--out", tmp_path / "o", "--holdout", 70
    )


def test_a_folder_without_write_permission_is_refused_before_any_work(data, tmp_path):
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    if os.access(locked, os.W_OK):
        pytest.skip("this user may write anywhere; the refusal is tested on /proc as well")
    message = refused("calibrate", data / "good.csv", "--robot", "irb120", "--out", locked)
    assert "Permission denied" in message


# --- ways of identifying -------------------------------------------------------------------------------


def calibrated(data, out, *options):
    done = started("calibrate", data / "good.csv", "--robot", "irb120", "--out", out, "--json", *options)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), irbcal.load(out).record


def test_largest_error_with_its_certificate(data, tmp_path):
    result, loaded = calibrated(data, tmp_path / "out", "--objective", "max")
    objective = result["objective"]
    assert objective["name"] == "max"
    assert objective["lower_bound_mm"] <= objective["value_mm"] <= 1.0001 * objective["lower_bound_mm"]
    assert objective["value_mm"] == pytest.approx(result["fit"]["max_mm"], abs=1e-6)
    assert loaded.heldout_least_squares is not None
    assert "calibrated by rms" in (tmp_path / "out" / "report.html").read_text()


def test_level_chosen_by_cross_validation(data, tmp_path):
    result, loaded = calibrated(data, tmp_path / "out", "--model", "best-level")
    assert result["model"] == "34"
    assert [row["level"] for row in result["choice"]["table"]][:2] == ["nominal", "11"]
    assert loaded.choice.explanation in (tmp_path / "out" / "report.html").read_text()


def test_parameters_freed_and_held_and_known_targets(data, tmp_path):
    table = tmp_path / "targets.csv"
    table.write_text(
        "target,x_mm,y_mm,z_mm\nsmr1,-87.37,87.202,110.02\nsmr2,84.419,84.26,109.928\nsmr3,85.99,-85.788,109.959\n"
    )
    _, loaded = calibrated(data, tmp_path / "out", "--free", "gain*", "--hold", "delta_d5", "--targets", table)
    rows = {row.name: row for row in loaded.parameters}
    assert "gain3" in rows
    assert "delta_d5" not in rows
    assert rows["delta_d6"].state == "identified"
    assert not any(name.startswith("target_") for name in rows)
    assert loaded.placement.targets_mm["smr1"] == pytest.approx([-87.37, 87.202, 110.02], abs=1e-9)


def test_three_targets_as_one_pose_and_the_same_tool_again(data, tmp_path):
    result, loaded = calibrated(data, tmp_path / "out", "--as-poses", "--model", "34")
    assert list(loaded.placement.targets_mm) == ["tool"]
    assert loaded.heldout.orientation.max_deg < 0.05 < loaded.heldout_nominal.orientation.max_deg
    done = started("evaluate", tmp_path / "out", data / "good.csv", "--json")
    again = json.loads(done.stdout)
    assert again["calibrated"]["n"] == 15
    assert again["orientation"]["calibrated"]["mean_deg"] < 0.04
    assert again["calibrated"]["mean_mm"] < 2 * result["heldout"]["mean_mm"]


# --- inverse kinematics ---------------------------------------------------------------------------------


def test_ik_gives_the_joints_of_fk_back(calibration, data):
    folder, _ = calibration
    joints, poses = data / "there.csv", data / "poses.csv"
    joints.write_text("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n10,20,30,40,50,60\n-50,-10,5,-20,40,130\n")
    poses.write_text(started("fk", folder, "--joints", joints).stdout)
    expected = np.array([[10, 20, 30, 40, 50, 60], [-50, -10, 5, -20, 40, 130.0]])
    for near, row in zip(("10,20,30,40,50,60", "-50,-10,5,-20,40,130"), (0, 1), strict=True):
        done = started("ik", folder, "--poses", poses, "--near", near)
        assert done.returncode == 0, done.stderr
        found = np.array(done.stdout.splitlines()[1 + row].split(",")[-7:-1], float)
        assert np.abs(found - expected[row]).max() < 1e-5, "poses carry nine decimals"
    every = started("ik", "irb120", "--poses", poses, "--all-branches").stdout.splitlines()
    assert every[0].endswith(",row,branch,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,note")
    assert len(every) == 5, "two branches within the limits for each pose"


def test_ik_says_which_poses_it_cannot_reach(data):
    far = data / "far.csv"
    far.write_text("x_mm,y_mm,z_mm,qw,qx,qy,qz\n5000,0,0,1,0,0,0\n")
    done = started("ik", "irb1600", "--poses", far, "--json")
    assert done.returncode == 0
    assert json.loads(done.stdout)["q1_deg"] is None
    assert "1 of 1 poses have no joints" in done.stderr
    assert "row 2, columns qw, qx, qy, qz: " in refused_ik(data, "1,0,0,2,0,0,0")
    assert started("ik", "irb1600", "--poses", far, "--near", "1,2").returncode == 2


def refused_ik(data, row):
    path = data / "bad_poses.csv"
    path.write_text(f"x_mm,y_mm,z_mm,qw,qx,qy,qz\n{row}\n")
    return refused("ik", "irb1600", "--poses", path)


# --- fake targets ---------------------------------------------------------------------------------------

MODULE = """MODULE Job
  ! Å comment with ; and [brackets]
  CONST jointtarget jA:=[[0,-14,14,0,30,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  VAR jointtarget jZero:=[[0,0,0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];
  PROC main()
    MoveAbsJ jA,v500,fine,tool0;
    {more}
  ENDPROC
ENDMODULE
"""


def test_filter_writes_fake_targets_and_refuses_them_the_second_time(calibration, tmp_path):
    folder, _ = calibration
    source = tmp_path / "job.mod"
    source.write_bytes(MODULE.format(more="").replace("\n", "\r\n").encode("latin-1"))
    done = started("filter", folder, source, "--out", tmp_path / "new.mod", "--changes", tmp_path / "c.csv", "--json")
    assert done.returncode == 0, done.stderr
    result = json.loads(done.stdout)
    assert result["corrected"] == 1
    assert 0 < result["max_shift_mm"] < 20
    new = (tmp_path / "new.mod").read_bytes()
    assert b"\xc5 comment with ; and [brackets]\r\n" in new
    assert b"! irbcal: fake targets" in new
    assert b"jZero:=[[0,0,0,0,0,0]," in new, "no move uses it"
    assert pd.read_csv(tmp_path / "c.csv")["target"].tolist() == ["jA"]
    message = refused("filter", folder, tmp_path / "new.mod", "--out", tmp_path / "twice.mod")
    assert "new.mod" in message
    assert not (tmp_path / "twice.mod").exists()


def test_filter_writes_nothing_unless_everything_is_corrected_or_partial_is_allowed(calibration, tmp_path):
    folder, _ = calibration
    source = tmp_path / "job.mod"
    source.write_text(MODULE.format(more="MoveJ Offs(CRobT(),0,0,10),v500,fine,tool0;"))
    done = started("filter", folder, source, "--out", tmp_path / "new.mod")
    assert done.returncode == 1
    assert "its target is computed" in done.stdout
    assert not (tmp_path / "new.mod").exists()
    done = started("filter", folder, source, "--out", tmp_path / "new.mod", "--allow-partial")
    assert done.returncode == 0
    assert (tmp_path / "new.mod").exists()


def test_filter_refuses_unknown_tools_and_broken_modules(calibration, tmp_path):
    folder, _ = calibration
    source = tmp_path / "job.mod"
    target = "[[500,0,500],[0,0,1,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]]"
    source.write_text(MODULE.format(more=f"MoveL {target},v500,fine,tGun;"))
    done = started("filter", folder, source, "--out", tmp_path / "n.mod")
    assert done.returncode == 1
    assert "--tool tgun=…" in " ".join(done.stdout.split())
    assert started("filter", folder, source, "--out", tmp_path / "n.mod", "--tool", "tGun=1,2").returncode == 2
    source.write_text("MODULE Job\nCONST jointtarget j:=[[0,0,")
    assert "job.mod: " in refused("filter", folder, source, "--out", tmp_path / "n.mod")


def test_help_does_not_list_robots():
    """There are more than the shipped ones; `irbcal robots` names them all."""
    for name, command in get_command(app).commands.items():
        for parameter in command.params:
            assert "irb1600, irb120" not in (getattr(parameter, "help", "") or ""), name


END = """
import atexit, sys
from irbcal import __main__
atexit.register(lambda: print("tidied up"))
print("nothing is lost", end=" ")
sys.argv = ["irbcal", *sys.argv[1:]]
__main__.start()
print("not reached")
"""


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (["--version"], 0, f"nothing is lost irbcal {irbcal.__version__}\ntidied up\n"),
        (["fk", "no-such-robot"], 2, "nothing is lost tidied up\n"),
        (["evaluate", "/nowhere", "no.csv"], 1, "nothing is lost tidied up\n"),
    ],
)
def test_the_end_of_a_command_is_that_of_any_program(words, code, said):
    """Output that was held back is written, what was to be done at the end is done, the exit code is kept."""
    done = subprocess.run([sys.executable, "-c", END, *words], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout) == (code, said), done.stderr


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs a device that is always full")
def test_output_that_cannot_be_written_is_not_called_done():
    with open("/dev/full", "w") as full:
        words = [sys.executable, "-m", "irbcal", "--version"]
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True, timeout=60)
    assert done.returncode != 0
    assert "No space left" in done.stderr
