"""Plans as their files say: every pose checked anew from plan.csv, plan.json and the URDF alone."""

import json
import sys

import numpy as np
import pandas as pd
import pytest
import trimesh
import typer
from rapid_modules import parsed
from solids import hulls, link_frames, touches_itself
from support import arm
from typer.testing import CliRunner

from irbcal.cli.main import app, main
from irbcal.errors import IrbcalError, MeasurementError
from irbcal.io import urdf_check
from irbcal.io.robots import robot_file
from irbcal.measurement import table
from irbcal.planning import choosing
from irbcal.planning.collisions import BEAM_GAP
from irbcal.planning.conditions import CONDITIONS
from irbcal.units import DEG, MM

JOINTS = [f"q{i}_deg" for i in range(1, 7)]


EXPECTED = ["expected_x_mm", "expected_y_mm", "expected_z_mm"]


LOWER = np.array([-180, -90, -245, -200, -115, -400])


UPPER = np.array([180, 120, 65, 200, 115, 400])


def call(*arguments):
    """Run the command in this process; errors come through."""
    robot = [] if "--robot" in arguments else ["--robot", "irb1600"]
    words = ["plan", *robot, *map(str, arguments)]
    return CliRunner().invoke(app, words, catch_exceptions=False, standalone_mode=False)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A plan with poses of every kind: folder, plan.csv, what --json printed."""
    out = tmp_path_factory.mktemp("plan") / "new" / "plan"
    kinds = ("--axis", 18, "--cube", 12, "--all-range", 12, "--optimal", 12, "--candidates", 150)
    done = call("--out", out, *kinds, "--targets", "thesis", "--payload", 3, "--json")
    return out, pd.read_csv(out / "plan.csv"), json.loads(done.stdout)


def test_a_plan_with_a_load_is_replaced_by_one_without_but_not_where_it_was_measured(tmp_path):
    few = ("--out", tmp_path, "--axis", 0, "--cube", 3, "--all-range", 0)
    call(*few, "--payload", 3)
    call(*few)
    plan = pd.read_csv(tmp_path / "plan.csv")
    assert "payload_kg" not in plan
    plan.assign(x_mm=1.0, y_mm=2.0, z_mm=3.0).to_csv(tmp_path / "plan.csv", index=False)
    with pytest.raises(IrbcalError, match="--force"):
        call(*few)


def poses_of(plan):
    """Joints (n, 6) in radians and groups of the poses."""
    first = plan.drop_duplicates("pose")
    return first[JOINTS].to_numpy() * DEG, first["group"].to_numpy()


def test_the_folder_holds_all_files_and_json_says_the_same(made):
    out, plan, printed = made
    assert sorted(path.name for path in out.iterdir()) == [
        "plan.csv",
        "plan.html",
        "plan.json",
        "plan.mod",
        "poses.csv",
    ]
    saved = json.loads((out / "plan.json").read_text())
    assert saved == {"irbcal": "plan"} | {key: value for key, value in printed.items() if key not in ("out", "files")}
    assert saved["poses"] == plan["pose"].nunique() == 54
    assert saved["points"] == len(plan)
    groups = plan.drop_duplicates("pose")["group"].value_counts()
    assert [groups[f"axis{k}"] for k in range(1, 7)] == [3] * 6
    assert groups["iso_cube"] == groups["all_range"] == 12
    assert groups["optimal_iso_cube"] + groups["optimal_all_range"] == 12
    for tally in saved["counts"].values():
        assert tally["tried"] == tally["accepted"] + sum(tally["removed"].values())
    compared = saved["compared_with_random"]
    assert compared["optimal"]["value"] < compared["random"][0]["value"]
    assert compared["random"][0]["poses"] == 12
    alone = compared["scatter_alone"]  # errors that no model describes come on top
    assert alone["optimal"]["error_mm"] < compared["optimal"]["error_mm"]
    assert compared["optimal"]["error_mm"] == pytest.approx(1e3 * compared["optimal"]["value"] ** 0.5)
    assert (plan["payload_kg"] == 3).all()
    assert plan["time_s"].is_monotonic_increasing
    assert saved["duration_s"] > plan["time_s"].iloc[-1]


def test_every_planned_pose_meets_its_conditions(made):
    """Limits, cube, heights, acceptance, self-collision and line of sight, none by the code that planned them."""
    _, plan, printed = made
    settings = printed["settings"]
    place = np.array(settings["tracker_mm"]) * MM
    assert printed["conditions"] == list(CONDITIONS)
    assert (settings["margin_deg"], settings["acceptance_deg"]) == (2.0, 30.0)
    q, groups = poses_of(plan)
    T = urdf_check.poses(robot_file("irb1600").read_bytes(), arm(), q)
    for k, (joints, group, pose) in enumerate(zip(q, groups, T, strict=True), start=1):
        assert (np.degrees(joints) >= LOWER + 2 - 1e-9).all()
        assert (np.degrees(joints) <= UPPER - 2 + 1e-9).all()
        shares = np.linspace(0, 1, 6)[1:] if k % 12 == 0 else [1.0]  # of some, the way from home too
        assert not any(touches_itself("irb1600", share * joints) for share in shares), k
        random = not group.startswith("axis")
        if "iso_cube" in group:
            assert np.abs(pose[:3, 3] - [0.64565, 0, 1.1657]).max() <= 0.325
        at = link_frames("irb1600", joints)
        scene = trimesh.util.concatenate([hull.copy().apply_transform(at[link]) for link, hull in hulls("irb1600")])
        names = plan.loc[plan["pose"] == k, "target"]
        assert 1 <= len(names) <= 3
        for name in names:
            point = pose[:3, :3] @ np.array(settings["targets_mm"][name]) * MM + pose[:3, 3]
            way = place - point
            length = np.sqrt(way @ way)
            hit, _, _ = scene.ray.intersects_location([place], [-way], multiple_hits=False)
            assert not len(hit) or np.linalg.norm(hit[0] - place) >= length - BEAM_GAP - 1e-5, (k, name)
            if random:
                look = pose[:3, :3] @ np.array(settings["targets_look_along"][name])
                assert np.degrees(np.arccos(look @ way / length)) <= 30.0
        if random:
            tool = np.array(list(settings["targets_mm"].values())) * MM
            for p in [pose[:3, 3], *(tool @ pose[:3, :3].T + pose[:3, 3])]:
                assert p[2] >= (0.7 if p[0] >= 0.15 else 1.1)


def test_axis_moves_come_first_with_the_same_reflectors_in_a_group(made):
    _, plan, _ = made
    q, groups = poses_of(plan)
    assert groups[:18].tolist() == [f"axis{k}" for k in range(1, 7) for _ in range(3)]
    moves = [a * np.eye(6)[k] for k in range(6) for a in (-30.0, 0.0, 30.0)]
    assert np.abs(np.degrees(q[:18]) - moves).max() < 1e-12
    for k in range(1, 7):
        sets = plan[plan["group"] == f"axis{k}"].groupby("pose")["target"].agg(tuple)
        assert sets.nunique() == 1


def test_expected_coordinates_are_where_pinocchio_puts_the_reflectors(made):
    _, plan, printed = made
    T_tracker_base = np.array(printed["settings"]["T_tracker_base"])
    assert np.linalg.inv(T_tracker_base)[:3, 3] / MM == pytest.approx(printed["settings"]["tracker_mm"])
    T = urdf_check.poses(robot_file("irb1600").read_bytes(), arm(), plan[JOINTS].to_numpy() * DEG)
    local = np.array([printed["settings"]["targets_mm"][name] for name in plan["target"]]) * MM
    points = np.einsum("ij,njk,nk->ni", T_tracker_base[:3, :3], T[:, :3, :3], local)
    points += T[:, :3, 3] @ T_tracker_base[:3, :3].T + T_tracker_base[:3, 3]
    assert np.abs(plan[EXPECTED].to_numpy() - points / MM).max() <= 0.5e-3 + 1e-9


def test_a_plan_cannot_be_taken_for_measurements(made):
    with pytest.raises(MeasurementError, match="missing column x_mm, y_mm, z_mm"):
        table.read(made[0] / "plan.csv")


def test_the_rapid_module_commands_the_same_joints_and_holds_still_long_enough(made):
    out, plan, _ = made
    program = parsed((out / "plan.mod").read_bytes())
    q, _ = poses_of(plan)
    assert not program.unchanged_moves
    joints = np.array([target.value for target in program.targets])
    assert joints[[0, -1]].tolist() == [[0.0] * 6] * 2  # it begins and ends at home
    assert np.abs(joints[1:-1] - q).max() < 1e-12
    assert {use.tool for target in program.targets for use in target.uses} == {"tool0"}
    text = (out / "plan.mod").read_text()
    waits = [float(line.split()[1].rstrip(";")) for line in text.splitlines() if "WaitTime" in line]
    assert waits == [4 + 2.5 * (count + 3) for count in plan.groupby("pose").size()]
    assert text.isascii()


def test_the_page_plays_the_plan(made):
    page = (made[0] / "plan.html").read_text(encoding="utf-8")
    assert "irb1600_6_145" in page
    assert "optimal_all_range" in page
    assert "smr1" in page


def test_refusals_name_conditions_and_counts_and_leave_nothing_behind(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(choosing, "MOST_TRIED", 50_000)
    arguments = ["--out", tmp_path / "new" / "plan", "--acceptance", 1, "--cube", 50, "--axis", 0]
    monkeypatch.setattr(sys, "argv", ["irbcal", "plan", "--robot", "irb1600", *map(str, arguments)])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 1
    sentence = capsys.readouterr().err
    assert sentence.count("\n") == 1
    assert "of 50 iso_cube poses" in sentence
    assert "of 50,000 candidates" in sentence
    for name in CONDITIONS:
        assert f"{name} removed " in sentence
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--robot", "nothing.urdf"), "nothing.urdf"),
        (("--targets", "smr1,smr77"), "unknown target 'smr77': expected a file, a number from 1 to 9 or names"),
        (("--level", "35"), "unknown model '35'"),
        (("--axis", "0", "--cube", "1", "--all-range", "0"), "1 pose"),
    ],
)
def test_bad_wishes_are_refused_in_one_sentence(tmp_path, arguments, message):
    out = tmp_path / "plan"
    with pytest.raises(IrbcalError) as refusal:
        call("--out", out, *arguments, "--ignore", "collision", "--ignore", "sight", "--ignore", "path")
    assert message in str(refusal.value)
    assert not out.exists()


def test_an_earlier_plan_stays_where_a_new_one_is_refused(tmp_path):
    (tmp_path / "plan.csv").write_text("earlier")
    with pytest.raises(IrbcalError):
        call("--out", tmp_path, "--level", "35")
    assert (tmp_path / "plan.csv").read_text() == "earlier"
    assert [path.name for path in tmp_path.iterdir()] == ["plan.csv"]


def test_wrong_calls_are_told_apart_from_refusals(tmp_path):
    for arguments in (
        ("--tracker", "1,2"),
        ("--cube-centre", "1,2,3"),
        ("--min-height", "7"),
        ("--ignore", "luck"),
        ("--axis", "17"),
        ("--cube-edge", "400"),
        ("--axis", "0", "--cube", "0", "--all-range", "0"),
    ):
        done = CliRunner().invoke(app, ["plan", "--robot", "irb1600", "--out", str(tmp_path / "p"), *arguments])
        assert done.exit_code == 2, arguments
    assert not (tmp_path / "p").exists()


@pytest.mark.parametrize(
    ("option", "words"),
    [
        (("--acceptance", "90.5"), "expected 90 degrees or less, found 90.5"),
        (("--prior", "2"), "is for --device and --compare-devices"),
        (("--approach", "50"), "is for --device and --compare-devices"),
        (("--cube", "9", "--device", "balls"), "--device does not take it"),
    ],
)
def test_what_is_for_devices_is_refused_without_one(tmp_path, option, words):
    with pytest.raises(typer.BadParameter) as refusal:
        call("--out", tmp_path / "p", *option)
    assert refusal.value.message.endswith(words)
    assert refusal.value.param_hint == option[0]


def test_there_is_no_robot_without_its_name(tmp_path):
    done = CliRunner(env={"COLUMNS": "200", "NO_COLOR": "1"}).invoke(app, ["plan", "--out", str(tmp_path / "p")])
    assert done.exit_code == 2
    assert "Missing option '--robot'" in done.output
    assert not (tmp_path / "p").exists()


RAIL = """<robot name="rail"><link name="base_link"/><link name="a"/><link name="b"/><link name="tool0"/>
<joint name="slide" type="prismatic"><parent link="base_link"/><child link="a"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="1" velocity="0.2"/></joint>
<joint name="turn" type="revolute"><parent link="a"/><child link="b"/><origin xyz="0 0 0.5"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="lift" type="revolute"><parent link="b"/><child link="tool0"/><origin xyz="0.6 0 0"/><axis xyz="0 1 0"/>
<limit lower="-1.5" upper="1.5" effort="1" velocity="1"/></joint></robot>"""


def test_arms_of_other_joints_get_no_rapid_module(tmp_path):
    (tmp_path / "rail.urdf").write_text(RAIL)
    cube = ("--cube-centre", "500,0,500", "--cube-edge", "400")
    rest = (
        "--ignore",
        "collision",
        "--ignore",
        "sight",
        "--ignore",
        "path",
        "--cube",
        4,
        "--all-range",
        20,
        "--json",
    )
    done = call("--robot", tmp_path / "rail.urdf", "--out", tmp_path / "plan", *cube, *rest)
    printed = json.loads(done.stdout)
    assert "plan.mod" not in printed["files"]
    assert printed["conditions"] == ["limits", "acceptance"]
    assert printed["conditions_off"] == ["height", "collision", "sight", "path"]
    assert printed["predicted"]["model"] == "placement"
    plan = pd.read_csv(tmp_path / "plan" / "plan.csv")
    assert list(plan.columns[2:5]) == ["q1_mm", "q2_deg", "q3_deg"]
    assert plan["q1_mm"].abs().max() <= 980  # 2 degrees of margin are 20 mm
    assert plan.drop_duplicates("pose")["q1_mm"].tolist()[:3] == [-300, 0, 300]
    assert plan["pose"].nunique() == 9 + 24
