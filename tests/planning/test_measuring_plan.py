"""Plans from Python: seeds, what they say, and a run in the virtual cell."""

import pickle
from dataclasses import FrozenInstanceError, replace

import numpy as np
import pandas as pd
import pytest
from design_support import PLACES, TARGETS, poses
from maker_cases import path_of, robot_of
from rapid_modules import parsed
from support import arm, measured, random_robot

import irbcal
from irbcal.correction.program_options import ControllerOptions
from irbcal.errors import OptionError
from irbcal.identification.fit import identify
from irbcal.modeling import frames
from irbcal.planning import measuring_plan
from irbcal.planning.conditions import SOLID
from irbcal.planning.measuring_plan import plan
from irbcal.planning.optimal_design import Model
from irbcal.planning.plan_options import READINGS_S, PlanOptions
from irbcal.safe_files import write_together
from irbcal.simulation import pose_list, simulation
from irbcal.simulation.shipped_cells import open_cell
from irbcal.simulation.simulation import simulate
from irbcal.units import DEG, MM


def test_expected_points_and_times_are_those_of_the_poses():
    made = plan("irb1600", axis=0, cube=3, all_range=0, ignore=SOLID, level="nominal", references=2, wait_s=3.0)
    pose, target, xyz, time = made.expected()
    assert len(pose) == made.measured.sum()
    T = made.scene.setting.arm.forward(made.q)
    for k in range(len(pose)):
        local = made.scene.setting.targets.positions[target[k]]
        there = frames.apply(made.scene.T_world_base, T[pose[k], :3, :3] @ local + T[pose[k], :3, 3])
        np.testing.assert_allclose(xyz[k], there, rtol=0, atol=1e-12)
    first = np.flatnonzero(np.diff(pose, prepend=-1))
    np.testing.assert_allclose(time[first], made.stops + 3.0, rtol=0, atol=1e-9)
    count = made.measured[-1].sum() + 2
    assert made.duration_s == made.stops[-1] + 3.0 + READINGS_S * count


def test_times_follow_from_speed_wait_and_readings():
    """The first axis move: 30 degrees with the tip 815 mm from axis 1, at 250 mm/s."""
    moves = {"cube": 0, "all_range": 0, "level": "nominal", "wait_s": 3.0, "ignore": SOLID}
    made = plan("irb1600", speed=0.25, references=0, **moves)
    _, _, _, time = made.expected()
    first = np.pi / 6 * 0.815 / 0.25
    assert time[:4] == pytest.approx([first + 3, first + 5.5, first + 8, first + 10.5 + first + 3], rel=1e-3)
    quick = plan("irb1600", speed=7.0, **moves)
    assert quick.stops[0] == pytest.approx(30 / 150)  # joint 1 turns 150 degrees a second


def test_predicted_deviations_are_those_of_simulated_calibrations():
    nominal, noise, runs = arm(), 0.1 * MM, 150
    q, seen = poses(40, 7)
    model = Model(nominal, TARGETS, "16", noise)
    found = measuring_plan.predict(model, q, seen)
    rng = np.random.default_rng(0)
    robot = random_robot(nominal, "16", rng, targets=dict(zip(TARGETS.names, PLACES, strict=True)))
    exact, there = measured(robot, q), nominal.random_joints(40, 8)
    errors, misses = [], []
    for _ in range(runs):
        points = measured(robot, q, noise, rng).take(seen.ravel())
        fit = identify(nominal, points, "16")
        errors.append(fit.solution.state.errors)
        misses.append(np.sum((fit.robot.points(there, "smr2") - robot.points(there, "smr2")) ** 2, axis=1))
    assert len(exact) == 120
    deviations = np.std(errors, axis=0)
    factor = {"mm": MM, "deg": DEG}
    for item, seen_deviation in zip(found.parameters, deviations, strict=True):
        if item.state == "identified":
            assert seen_deviation == pytest.approx(item.std * factor[item.unit], rel=0.25), item.name
    assert sum(item.state == "identified" for item in found.parameters) >= 8
    predicted = found.position_std(there, "smr2")
    assert np.sqrt(np.mean(misses, axis=0)) == pytest.approx(predicted, rel=0.3)
    assert np.sqrt(np.mean(misses)) == pytest.approx(np.sqrt(np.mean(predicted**2)), rel=0.05)


def test_what_no_pose_shows_is_held_and_has_no_deviation():
    model = Model(arm(), TARGETS, "34")
    states = {item.name: item for item in measuring_plan.predict(model, *poses(60, 1)).parameters}
    assert states["delta_d6"].state == states["delta_theta6"].state == "held"
    assert states["delta_d2"].state == states["delta_d3"].state == "tied"
    assert states["delta_d6"].std is None
    assert states["delta_a2"].std > 0


def test_reflectors_that_no_pose_measures_are_left_out():
    q, seen = poses(40, 2)
    seen[:, 1] = False
    seen[~seen.any(axis=1), 0] = True
    found = measuring_plan.predict(Model(arm(), TARGETS, "11"), q, seen)
    assert found.model.targets.names == ("smr1", "smr3")
    assert found.position_std(q, "smr3").shape == (40,)


PULSES = (1341.4, 1341.4, -1341.4, 1000.0, 1000.0, 622.0)
SMALL = {"axis": 0, "cube": 0, "all_range": 4, "level": "nominal"}


@pytest.fixture(scope="module")
def made():
    return plan("irb1600", ignore=SOLID, **SMALL)


def test_ways_over_home_stand_in_the_program(made):
    def joints(plan):
        return [target.value for target in parsed(measuring_plan.program_files(plan)["plan.mod"]).targets]

    direct = joints(made)
    over = joints(replace(made, over_home=np.array([False, True, False, True])))
    assert len(direct) == 6
    assert len(over) == 8
    assert [not q.any() for q in over] == [True, False, True, False, False, True, False, True]
    np.testing.assert_allclose(direct[1:-1], made.q, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("robot", "language"),
    [
        ("gp8", "inform"),
        ("irb2400", "rapid"),
        ("kr120r2500pro", "krl"),
        ("m20ia", "fanuc"),
        ("rx160", "val3"),
        ("rs007n", "kawasaki"),
    ],
)
def test_the_language_is_the_makers(robot, language):
    arm = robot_of(robot)[0]
    assert measuring_plan.language_of(arm, PlanOptions("irb1600", pulses=PULSES)) == (language, "")
    assert measuring_plan.language_of(arm, PlanOptions("irb1600", language="csv")) == ("", "")
    for name in ("", "noname_xy7"):
        found, note = measuring_plan.language_of(replace(arm, name=name), PlanOptions("irb1600"))
        assert found == ""
        assert "the name of the robot does not tell its maker" in note


def test_what_cannot_be_written_is_said():
    arm = robot_of("gp8")[0]
    assert "pulses" in measuring_plan.language_of(arm, PlanOptions("irb1600"))[1]
    for language, expected in (("krl", "axes point along"), ("inform", "pulses"), ("basic", "basic")):
        with pytest.raises(OptionError, match=expected):
            measuring_plan.language_of(arm, PlanOptions("irb1600", language=language))


def test_the_run_takes_as_long_as_the_plan_says(made):
    """Moves with the joint speeds of the program, and its rests: the hours of the plan."""
    run = measuring_plan.moves(made)
    way = np.abs(np.diff(run.q, axis=0)).max(axis=1)
    seconds = sum(move.wait_s for move in run.moves) + sum(
        part / move.joint_speed for part, move in zip(way, run.moves[1:], strict=True)
    )
    assert seconds - way[-1] / run.moves[-1].joint_speed == pytest.approx(made.duration_s, rel=0.05)
    assert all(0.01 <= move.share <= 0.5 for move in run.moves)


@pytest.mark.parametrize("robot", ["gp8", "kr120r2500pro", "m20ia", "rs007n", "rx160"])
def test_the_virtual_robot_runs_it(robot, tmp_path):
    """The program of a plan commands, through the reader of its language, what the plan's table does."""
    nominal = robot_of(robot)[0]
    path = path_of(robot)
    plan = irbcal.plan(path, **SMALL, pulses=PULSES)
    plan.save(tmp_path)
    file = next(file for file in tmp_path.iterdir() if pose_list.is_program(file))
    q, _ = pose_list.read_program(
        file, nominal, pose_list.given_for(path, nominal, file, ControllerOptions(pulses=PULSES))
    )
    assert np.abs(q[1:-1] - plan.q).max() < (0.9e-3 * DEG if robot == "gp8" else 2e-4 * DEG)


def test_files_hold_what_the_tables_say():
    made = plan("irb1600", axis=0, cube=0, all_range=3, ignore=SOLID, level="nominal", payload=2.5)
    found = measuring_plan.files(made, page="<html></html>")
    assert list(found) == ["plan.csv", "poses.csv", "plan.json", "plan.mod", "plan.html"]
    rows = found["plan.csv"].decode().splitlines()
    assert rows[0].endswith("target,expected_x_mm,expected_y_mm,expected_z_mm,time_s,payload_kg")
    cells = rows[1].split(",")
    assert all(len(cell.split(".")[1]) == 4 for cell in cells[2:8])
    assert [len(cell.split(".")[1]) for cell in cells[9:13]] == [3, 3, 3, 1]
    assert len(rows) == 1 + made.measured.sum() == 1 + len(measuring_plan.plan_table(made))
    assert found["plan.mod"].decode().count("WaitTime") == 3


def test_seeds_decide_the_plan():
    kinds = {"axis": 0, "cube": 3, "all_range": 3, "optimal": 3, "candidates": 30, "level": "11"}
    texts = [measuring_plan.files(plan("irb1600", seed=seed, ignore=SOLID, **kinds))["plan.csv"] for seed in (4, 4, 5)]
    assert texts[0] == texts[1] != texts[2]


def test_a_tracker_finds_each_target_where_the_plan_says(tmp_path):
    """In the virtual cell with 2 mm to find a target: the base comes from 18 axis poses, then a plan for others."""
    cell = open_cell("irb1600", seed=3).with_targets(("smr1", "smr2", "smr3")).without("lost", "visibility")
    axis = plan("irb1600", cube=0, all_range=0, level="nominal", ignore=SOLID)
    (tmp_path / "poses.csv").write_bytes(measuring_plan.files(axis)["poses.csv"])
    asked = pose_list.read(tmp_path / "poses.csv", cell.arm)
    assert asked.targets is not None
    run = cell.measure(asked.q, asked.measured_targets(cell), asked.wait_s)
    write_together(tmp_path, simulation.files(run, asked, cell, tmp_path / "axis.csv", "irb1600"))
    found = {}
    for model in ("nominal", "26"):
        irbcal.calibrate(tmp_path / "axis.csv", "irb1600", model=model, holdout=0).save(tmp_path / model)
        made = plan(tmp_path / model, axis=0, cube=60, all_range=60, ignore=SOLID, min_height=(0.7, 1.1))
        pose, target, expected, _ = made.expected()
        index = [cell.tool.names.index(made.scene.setting.targets.names[k]) for k in target]
        miss = np.linalg.norm(cell.measure(made.q, run=1).xyz[pose, index] - expected, axis=1) / MM
        found[model] = (miss < 2.0).mean(), miss.max()
    print(found)
    assert found["nominal"][0] > 0.97


# --- the front door ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def small():
    """A plan with few poses of every kind."""
    return plan("irb1600", cube=4, all_range=4, axis=18, optimal=4, candidates=40, level="11", seed=3)


def test_the_result_says_what_it_is_and_cannot_be_changed(small):
    assert small.headline().startswith("irb1600_6_145: 30 poses, ")
    assert len(repr(small)) < 2000
    text = small.summary()
    for part in (
        "What each condition removed",
        "axis moves",
        "Model 11, scatter of 0.1 mm",
        "Note: no --tracker given",
    ):
        assert part in text
    assert "<table>" in small._repr_html_()
    with pytest.raises(ValueError, match="read-only"):
        small.q[0] = 0.0
    with pytest.raises(TypeError, match="cannot be changed"):
        small.tallies["axis"] = None


def test_a_plan_can_be_kept_and_taken_up_again(small):
    again = pickle.loads(pickle.dumps(small))
    np.testing.assert_array_equal(again.q, small.q)
    assert again.to_dict() == small.to_dict()
    solids = again.scene.setting.solids
    assert solids.touching(small.q).tolist() == small.scene.setting.solids.touching(small.q).tolist()
    inside = small.scene.setting.tracker_position  # the ball around the tracker is there again
    assert len(solids.geometry.collisionPairs) == len(small.scene.setting.solids.geometry.collisionPairs)
    assert np.isfinite(inside).all()


def test_the_table_of_poses_is_the_file(small, tmp_path):
    names = [path.name for path in small.save(tmp_path / "plan")]
    assert names == ["plan.csv", "poses.csv", "plan.json", "plan.mod"]
    written, table = pd.read_csv(tmp_path / "plan" / "poses.csv"), small.to_frame()
    pd.testing.assert_frame_equal(written, table, check_dtype=False)
    assert table["targets"].iloc[-1].split() == [
        name for name, on in zip(small.scene.setting.targets.names, small.measured[-1], strict=True) if on
    ]


def test_a_plan_is_measured_in_the_cell_without_a_file(small):
    found = simulate("irb1600", small, seed=1)
    np.testing.assert_allclose(found.poses.q, small.q, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(found.run.measured[:, :3], small.measured)


def test_the_usual_plan_is_that_of_the_thesis():
    """Nubiola 2011, section 7.2: 18 axis moves, 52 poses in the cube, 50 in the whole range."""
    made = plan("irb1600", ignore=SOLID, level="nominal")
    count = {name: int((made.groups == name).sum()) for name in ("iso_cube", "all_range")}
    assert count == {"iso_cube": 52, "all_range": 50}
    assert len(made.q) == 120


@pytest.mark.parametrize(
    ("options", "parameter", "sentence"),
    [
        ({"criterion": "A"}, "criterion", "criterion: expected position or D, found 'A'"),
        ({"volume": "sphere"}, "volume", "volume: expected both, cube or range, found 'sphere'"),
        ({"ignore": ["luck"]}, "ignore", "ignore: expected limits, height, acceptance, collision, sight or path"),
        ({"axis": 17}, "axis", "expected 18, 158 or 0 axis moves, found 17"),
        ({"cube_edge": 0.4}, "cube_centre", "cube_centre and cube_edge go together"),
        ({"noise": 0.0}, "noise", "noise: expected more than zero, found 0.0"),
        ({"tracker": [1.0, 2.0]}, "tracker", "of the tracker"),
        ({"axis": 0, "cube": 0, "all_range": 0}, None, "the plan has no poses"),
    ],
)
def test_wrong_options_are_refused_by_name(options, parameter, sentence):
    with pytest.raises(OptionError, match=sentence) as refusal:
        plan("irb1600", **options)
    assert refusal.value.parameter == parameter


def test_the_robot_must_be_named():
    with pytest.raises(TypeError):
        plan()


def test_a_plan_takes_no_new_attributes_and_its_prediction_is_printed_short():
    found = plan("irb1600", axis=0, cube=6, all_range=6, level=11, ignore=("collision", "sight", "path"))
    assert found.options.level == 11
    with pytest.raises(FrozenInstanceError):
        found.more = 1
    assert 10 < len(repr(found.prediction)) < 200


def test_how_many_are_best_is_a_number():
    with pytest.raises(OptionError, match="optimal: expected a whole number from 0 to 100000, found 'x'"):
        plan("irb1600", optimal="x")
