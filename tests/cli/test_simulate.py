"""``irbcal simulate`` as a user meets it: plans in, measurements and truth out, and the whole way round."""

import json

import numpy as np
import pandas as pd
import pytest
from support import started
from typer.testing import CliRunner

import irbcal
from irbcal.cli import main
from irbcal.errors import IrbcalError
from irbcal.io import robots
from irbcal.measurement import table
from irbcal.measurement.column_names import JOINTS
from irbcal.simulation.effects import ALL, EFFECT_NAMES


def run(*arguments):
    """Run the command in this process; returns what it printed on stdout."""
    done = CliRunner().invoke(main.app, ["simulate", *map(str, arguments)], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.stdout


def refused(*arguments):
    """The sentence of a refusal."""
    with pytest.raises(IrbcalError) as caught:
        CliRunner().invoke(main.app, ["simulate", *map(str, arguments)], catch_exceptions=False)
    return str(caught.value)


def wrong_call(*arguments):
    """What is printed for a wrong call."""
    done = CliRunner(env={"COLUMNS": "200", "NO_COLOR": "1", "TERM": "dumb"}).invoke(
        main.app, ["simulate", *map(str, arguments)]
    )
    assert done.exit_code == 2
    return done.output


@pytest.fixture
def plan(tmp_path):
    """A plan with every optional column."""
    path = tmp_path / "plan.csv"
    path.write_text(
        "note,pose,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg,group,cycle,targets,wait_s\n"
        "a,P1,0,-14,14,0,0,0,iso9283,1,smr1 smr3,4\n"
        'b,P2,17.69,18.084,-46.521,-33.814,33.095,29.298,iso9283,1,"smr2;ref9",0.5\n'.replace(";ref9", "")
        + "c,P1,0,-14,14,0,0,0,iso9283,2,,\n"
    )
    return path


def test_a_plan_becomes_a_measurement_file_with_the_truth_beside_it(plan, tmp_path):
    out = tmp_path / "m.csv"
    result = json.loads(
        run(plan, "--robot", "irb1600", "--out", out, "--payload", 6, "--without", "visibility", "--json")
    )
    frame = pd.read_csv(out)
    asked = [(str(p), c) for p, c in zip(frame["pose"], frame["target"], strict=True) if c.startswith("smr")]
    assert asked == [("P1", "smr1"), ("P1", "smr3"), ("P2", "smr2"), ("P1", "smr1"), ("P1", "smr2"), ("P1", "smr3")]
    assert (frame["payload_kg"] == 6.0).all()
    assert (frame["group"] == "iso9283").all()
    assert (frame["simulated"] == "yes").all()
    assert (np.diff(frame["time_s"]) > 0).all()
    assert frame["q1_deg"].iloc[-1] == 0.0  # commanded, not reached
    seen = table.read(out)
    assert seen.simulated
    assert seen.poses == 3
    assert result["poses"] == 3
    assert result["points"] == len(frame) == 6 + 3 * 4
    truth = json.loads((tmp_path / "m.truth.json").read_text())
    assert truth["simulated"] is True
    assert set(truth["effects"]) == set(EFFECT_NAMES) - {"visibility"} == set(result["effects"])
    assert truth["effects"]["backlash"]["peak_to_peak_deg"][5] == 0.05
    assert truth["payload_kg"] == 6.0
    assert truth["parameters"]["delta_beta3"] == 0.014
    assert len(truth["poses"]) == 3
    # P1 of the ISO poses: the flange nominally at (645.65, 0, 1165.70) mm, tool axis along x
    assert np.linalg.norm(np.subtract(truth["poses"][0][:3], [645.65, 0.0, 1165.70])) < 4.0
    # the second P1 came from P2, the first from zero joints: not the same place
    assert 0.001 < np.linalg.norm(np.subtract(truth["poses"][0], truth["poses"][2])) < 0.2
    assert np.linalg.norm(truth["poses"][0][3:]) == pytest.approx(1.0, abs=1e-8)


def test_same_call_same_bytes_another_seed_others(tmp_path):
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        run("--random", 12, "--robot", "irb120", "--out", tmp_path / name / "m.csv", "--seed", seed)
    a, b, c = ([(tmp_path / n / f).read_bytes() for f in ("m.csv", "m.truth.json")] for n in "abc")
    assert a == b
    assert a[0] != c[0]
    truth = [json.loads(x[1]) for x in (a, c)]
    assert truth[0]["parameters"] == truth[1]["parameters"]
    assert truth[0]["effects"] == truth[1]["effects"]


def test_round_trip_plan_simulate_calibrate_filter_simulate_verify(tmp_path):
    """With the corrected program the robot's targets come to lie where the uncorrected one wanted them."""
    run("--random", 100, "--robot", "irb1600", "--out", tmp_path / "measured.csv", "--seed", 1)
    irbcal.calibrate(tmp_path / "measured.csv", "irb1600", "34").save(tmp_path / "cal")
    run("--random", 40, "--robot", "irb1600", "--out", tmp_path / "other.csv", "--seed", 2)
    joints = pd.read_csv(tmp_path / "other.csv").drop_duplicates("pose")[["pose", *JOINTS]]
    joints.to_csv(tmp_path / "plan.csv", index=False)
    paths = [str(tmp_path / name) for name in ("cal", "plan.csv", "corrected.csv")]
    call = ["filter", *paths[:2], "--out", paths[2], "--allow-partial"]
    filtered = CliRunner().invoke(main.app, call, catch_exceptions=False)
    assert filtered.exit_code == 0, filtered.output
    off = {}
    for name in ("plan", "corrected"):
        found = run(
            *(tmp_path / f"{name}.csv", "--robot", "irb1600", "--out", tmp_path / f"{name}-reached.csv", "--seed", 3),
            *("--wanted", tmp_path / "plan.csv", "--calibration", tmp_path / "cal", "--json"),
        )
        off[name] = json.loads(found)["wanted"]
    assert 0.7 < off["plan"]["mean_mm"] < 1.6
    assert off["corrected"]["mean_mm"] < 0.3
    # the same from the truth: reached tips against nominal ones in the calibration's base, by another way
    saved = irbcal.load(tmp_path / "cal")
    q = np.radians(joints[JOINTS].to_numpy())
    truth = json.loads((tmp_path / "corrected-reached.truth.json").read_text())
    reached = np.array(truth["poses"])[:, :3] / 1e3
    wanted = saved.arm(calibrated=False).forward(q)[:, :3, 3]
    from irbcal.modeling import frames

    T = frames.rigid_fit(wanted, reached)
    assert np.linalg.norm(frames.apply(T, wanted) - reached, axis=1).mean() < 0.3e-3


def test_only_and_without_choose_effects(tmp_path):
    common = ("--random", 5, "--robot", "irb1600", "--json", "--out", tmp_path / "m.csv")
    assert json.loads(run(*common, "--only", "noise", "--only", "drift"))["effects"] == ["noise", "drift"]
    assert json.loads(run(*common, "--only", "none"))["effects"] == []
    assert "backlash" not in json.loads(run(*common, "--without", "backlash"))["effects"]
    assert json.loads(run(*common, "--targets", "smr5,smr6"))["targets"] == ["smr5", "smr6"]
    assert json.loads(run(*common, "--targets", "9"))["targets"] == [f"smr{k}" for k in range(1, 10)]
    run(*common, "--tracker", "3000,0,1000", "--only", "none")
    truth = json.loads((tmp_path / "m.truth.json").read_text())
    assert truth["parameters"]["base_rz"] == 142.917  # its axes stay, its place is new
    distance = np.linalg.norm([truth["parameters"][f"base_{axis}"] for axis in "xyz"])
    assert distance == pytest.approx(np.hypot(3000.0, 1000.0), abs=1e-6)


def test_effects_are_listed_without_a_robot():
    assert [line.split()[0] for line in run("--list").splitlines()] == [effect.name for effect in ALL]
    listed = json.loads(run("--list", "--json"))
    assert [item["name"] for item in listed] == [effect.name for effect in ALL]
    assert listed[EFFECT_NAMES.index("noise")]["parameters"]["across_um"] == 2.0


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("q1_deg,q2_deg\n0,0\n", "row 1: missing column"),
        ("{joints}\n0,0,0,0,0,0\n0,x,0,0,0,0\n", "row 3, column q2_deg: "),
        ("{joints}\n0,0,0,0,99999,0\n", "row 2, column q5_deg: "),
        (
            "{joints},targets\n0,0,0,0,0,0,smr1 smr9\n",
            "row 2, column targets: expected targets of the tool (smr1, smr2",
        ),
        ("{joints},pose\n0,0,0,0,0,0,1\n1,0,0,0,0,0,1\n", "row 3, column pose"),
        ("{joints},wait_s\n0,0,0,0,0,0,-1\n", "row 2, column wait_s: expected 0 to 86400 seconds, found '-1'"),
        ("x_mm,y_mm,z_mm,qw,qx,qy,qz\n0,0,0,1,0,0,0\n", "row 2: "),
        ("{joints}\n", "a header but no rows"),
    ],
)
def test_bad_plans_are_refused_and_nothing_is_written(tmp_path, text, sentence):
    path = tmp_path / "plan.csv"
    path.write_text(text.replace("{joints}", ",".join(JOINTS)))
    found = refused(path, "--robot", "irb1600", "--out", tmp_path / "new" / "m.csv")
    assert str(path) in found
    assert sentence in found
    assert "\n" not in found
    assert [item.name for item in tmp_path.iterdir()] == ["plan.csv"]


def test_refusals_and_wrong_calls(tmp_path, plan):
    common = ("--robot", "irb1600", "--out", tmp_path / "m.csv")
    assert "'friction'" in refused(plan, *common, "--only", "friction")
    assert "unknown target 'nose': targets are smr1" in refused(plan, *common, "--targets", "nose")
    assert "'kuka'" in refused(plan, "--robot", "kuka", "--out", tmp_path / "m.csv")
    assert "missing" in wrong_call(plan, "--robot", "irb1600")
    assert "either a plan or" in wrong_call(*common)
    assert "exclude each other" in wrong_call(plan, *common, "--only", "noise", "--without", "lost")
    assert "go together" in wrong_call(plan, *common, "--wanted", plan)
    assert "expected 3 numbers" in wrong_call(plan, *common, "--tracker", "1,2")
    assert "expected 1 to 9 targets" in wrong_call(plan, *common, "--targets", "12")
    assert not (tmp_path / "m.csv").exists()


def test_a_tracker_that_sees_nothing_is_refused(tmp_path, monkeypatch):
    from irbcal.simulation import pose_list as cell_procedure

    monkeypatch.setattr(cell_procedure, "MOST_BLOCKS", 2)
    inside = ("--tracker", "0,0,200")  # within the robot's base
    sentence = refused("--random", 50, "--robot", "irb1600", "--out", tmp_path / "m.csv", *inside)
    assert "random poses" in sentence
    assert "tracker's sight" in sentence


def test_a_plan_with_hidden_targets_says_so(tmp_path):
    rows = [",".join(JOINTS), *(f"{angle},0,0,0,0,0" for angle in (90, 120, 150))]
    (tmp_path / "plan.csv").write_text("\n".join(rows) + "\n")
    out = run(tmp_path / "plan.csv", "--robot", "irb1600", "--out", tmp_path / "m.csv", "--without", "lost")
    assert "Note: the tracker did not see" in " ".join(out.split())
    frame = pd.read_csv(tmp_path / "m.csv")
    assert (
        frame["x_mm"].isna().sum()
        == frame["target"].str.startswith("smr").sum()
        - frame[frame["target"].str.startswith("smr")]["x_mm"].notna().sum()
        > 0
    )


def test_links_without_masses_and_bad_masses(tmp_path):
    text = robots.robot_file("irb120").read_text()
    (tmp_path / "bad.urdf").write_text(text.replace('<mass value="3.91"/>', '<mass value="heavy"/>'))
    sentence = refused("--random", 5, "--robot", tmp_path / "bad.urdf", "--out", tmp_path / "m.csv")
    assert "'link_2', mass: " in sentence


def test_a_file_that_is_not_there_is_one_sentence_on_the_error_stream(tmp_path):
    done = started("simulate", tmp_path / "absent.csv", "--robot", "irb1600", "--out", tmp_path / "m.csv")
    assert done.returncode == 1
    assert done.stderr == f"irbcal: {tmp_path / 'absent.csv'}: there is no such file\n"


def test_readings_that_lag_are_written_beside_what_was_commanded(tmp_path):
    common = ("--robot", "irb1600", "--random", 20, "--seed", 3, "--json")
    plain = json.loads(run(*common, "--out", tmp_path / "plain.csv"))
    also = json.loads(run(*common, "--also", "reading_lag", "--out", tmp_path / "also.csv"))
    assert also["effects"] == [*plain["effects"], "reading_lag"]
    without, beside = table.read(tmp_path / "plain.csv"), table.read(tmp_path / "also.csv")
    assert not without.programmed
    np.testing.assert_array_equal(beside.joints(), without.joints())
    assert beside.reading_lag().before_standstill
    assert "unknown effect 'lag'" in refused(*common, "--also", "lag", "--out", tmp_path / "no.csv")
