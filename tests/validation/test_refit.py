"""Base and tool fitted again: known truth, and what is judged."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats
from sessions_cases import truth
from support import arm, assert_same_poses, measured, write_measurements

import irbcal
from irbcal.errors import MeasurementError, OptionError
from irbcal.modeling import frames
from irbcal.validation.refit import Refit

NOISE = 2e-5


@pytest.fixture(scope="module")
def robots():
    return truth("26")


@pytest.fixture(scope="module")
def folder(robots, tmp_path_factory):
    path = tmp_path_factory.mktemp("refit")
    points = measured(robots["mon"], arm().random_joints(60, 1), NOISE, np.random.default_rng(1))
    irbcal.calibrate(write_measurements(path / "m.csv", points), "irb1600", "26").save(path / "cal")
    return path


def new(robots, folder, which, poses=40, seed=2):
    """Measurements with another base, another tool or both."""
    robot, other = robots["mon"], robots["wed"]
    if "base" in which:
        robot = robot.replace(T_world_base=other.T_world_base)
    if "tool" in which:
        robot = robot.replace(targets={f"new{k}": place for k, place in enumerate(other.targets.values())})
    points = measured(robot, arm().random_joints(poses, seed), NOISE, np.random.default_rng(seed))
    return write_measurements(folder / f"{'-'.join(which)}-{poses}.csv", points)


@pytest.mark.parametrize("which", [("base",), ("tool",), ("base", "tool")])
def test_what_was_moved_is_found(robots, which):
    true, other = robots["mon"], robots["wed"]
    moved = true
    if "base" in which:
        moved = moved.replace(T_world_base=other.T_world_base)
    if "tool" in which:
        moved = moved.replace(targets=other.targets)
    points = measured(moved, arm().random_joints(8, 5))
    found = Refit("base" in which, "tool" in which).placed(true, points, "m.csv")
    assert_same_poses(found.T_world_base[None], moved.T_world_base[None], 1e-10, 1e-10)
    for name, place in moved.targets.items():
        np.testing.assert_allclose(found.targets[name], place, rtol=0, atol=1e-10)


def test_orientations_place_the_target_frame(robots):
    turned = {name: frames.from_xyz_angles([0, 0, 0, 0.3, -0.2, 1])[:3, :3] for name in robots["mon"].targets}
    moved = robots["wed"].replace(target_rotations=turned)
    points = measured(moved, arm().random_joints(8, 5))
    points = replace(points, rotation=points.predicted_rotations(moved))
    found = Refit(base=True, tool=True).placed(robots["mon"], points, "m.csv")
    for name, rotation in turned.items():
        np.testing.assert_allclose(found.target_rotations[name], rotation, rtol=0, atol=1e-9)


def test_evaluate_says_what_was_placed_and_judges_the_others(program, robots, folder):
    data = new(robots, folder, ("tool",))
    found = program("evaluate", folder / "cal", data, "--refit-tool", "--json")
    assert found["calibrated"]["n"] == 3 * 20
    # noise, and what the calibration misses by itself
    assert found["calibrated"]["mean_mm"] < 4e3 * NOISE
    note = (
        "The tool was fitted again to 20 poses of these measurements, for each model; errors are those of the other 20"
    )
    assert any(text.startswith(note) for text in found["notes"])
    text = program(
        "evaluate",
        folder / "cal",
        new(robots, folder, ("base", "tool")),
        "--refit-tool",
        "--refit-base",
        "--refit-from",
        10,
    )
    assert "The base and tool were fitted again to 10 poses" in text
    assert " 90 " in text


def test_the_base_alone_is_placed_on_all_points_unless_a_number_is_given(robots, folder):
    data = new(robots, folder, ("base",))
    every = irbcal.evaluate(folder / "cal", data, refit_base=True)
    assert every.calibrated["n"] == 120
    assert "relative errors" in every.summary()
    some = irbcal.evaluate(folder / "cal", data, refit_base=True, refit_from=10)
    assert some.calibrated["n"] == 90
    assert "relative errors" not in some.summary()


def test_judging_the_poses_that_placed_the_tool_would_be_too_good(robots, folder):
    data = new(robots, folder, ("base", "tool"), poses=12, seed=9)
    honest, flattered = [], []
    for seed in range(6):
        done = irbcal.evaluate(folder / "cal", data, refit_base=True, refit_tool=True, refit_from=5, seed=seed)
        honest.append(done.calibrated["mean_mm"])
        refit = Refit(True, True, 5, seed)
        points = irbcal.validation.cleaned_points.prepare(irbcal.read_measurements(data), None).points
        mine = points.select(refit.chosen(points, "m")[0])
        robot = refit.placed(irbcal.load(folder / "cal").robot_calibrated(), mine, "m")
        flattered.append(1e3 * np.linalg.norm(mine.xyz - mine.predicted(robot), axis=1).mean())
    assert np.mean(flattered) < 0.8 * np.mean(honest)


def test_wrong_wishes(robots, folder):
    data = new(robots, folder, ("tool",))
    with pytest.raises(OptionError, match="refit_from: say what to fit again"):
        irbcal.evaluate(folder / "cal", data, refit_from=5)
    with pytest.raises(OptionError, match="refit_from"):
        irbcal.evaluate(folder / "cal", data, refit_tool=True, refit_from=2)
    with pytest.raises(MeasurementError, match="leave none to judge"):
        irbcal.evaluate(folder / "cal", data, refit_tool=True, refit_from=40)
    one = measured(robots["wed"], np.tile(arm().random_joints(1, 5), (8, 1)))
    with pytest.raises(MeasurementError, match="do not determine the base and tool"):
        Refit(True, True).placed(robots["mon"], one, "m.csv")
    with pytest.raises(MeasurementError, match="--refit-tool if the reflectors"):
        irbcal.evaluate(folder / "cal", new_names_kept(robots, folder))


def new_names_kept(robots, folder):
    far = robots["mon"].replace(targets={name: place + 0.3 for name, place in robots["mon"].targets.items()})
    return write_measurements(folder / "far.csv", measured(far, arm().random_joints(9, 3)))


LOST = {3: np.radians(0.4), 5: np.radians(-0.7)}


def crashed(robot, lost=LOST):
    theta = np.array(robot.arm.table.theta)
    for joint, by in lost.items():
        theta[joint - 1] += by
    return robot.replace(arm=robot.arm.with_table(replace(robot.arm.table, theta=theta)))


@pytest.mark.parametrize("which", [(), ("base",), ("base", "tool")])
def test_lost_zeros_are_found(robots, which):
    true, other = robots["mon"], robots["wed"]
    moved = true.replace(**({"T_world_base": other.T_world_base} if "base" in which else {}))
    moved = crashed(moved.replace(targets=other.targets) if "tool" in which else moved)
    points = measured(moved, arm().random_joints(8, 5))
    refit = Refit("base" in which, "tool" in which, zeros=(3, 5))
    placed = refit.placed(true, points, "m.csv")
    np.testing.assert_allclose(placed.arm.table.theta, moved.arm.table.theta, rtol=0, atol=1e-10)
    np.testing.assert_allclose(placed.poses(points.q), moved.poses(points.q), rtol=0, atol=1e-9)
    assert "Joint 3 stands +0.4000 ± 0.0000 degrees" in refit.zeros_in_words(true, placed, points)[0]


def test_intervals_hold(robots):
    """Noise of each pose alike for its targets, drawn 200 times: about 95 % of the estimates are within."""
    true, moved = robots["mon"], crashed(robots["mon"])
    points = measured(moved, arm().random_joints(6, 5))
    refit, held = Refit(base=True, zeros=(3, 5)), []
    rng = np.random.default_rng(1)
    counts, columns = np.arange(3, 200), 6 + 2  # of base and zeros
    student = stats.t.ppf(0.975, 3 * counts - columns)
    of_count = dict(zip(counts.tolist(), student * np.sqrt(6 / counts) / student[counts == 6], strict=True))
    for _ in range(200):
        noisy = replace(points, xyz=points.xyz + rng.normal(scale=1e-4, size=(points.poses, 3))[points.pose])
        placed = refit.placed(true, noisy, "m.csv")
        *of_joints, enough = refit.zeros_in_words(true, placed, noisy)
        halves = []
        for joint, words in zip((3, 5), of_joints, strict=True):
            value, _, half = words.split("stands ")[1].split()[:3]
            held.append(abs(float(value) - np.degrees(LOST[joint])) < float(half))
            halves.append(float(half))
        most, count = max(halves), int(enough.split()[0])
        assert (most - 5e-5) * of_count[count] <= 0.01 < (most + 5e-5) * of_count[count - 1]
        assert enough.endswith("poses like these are enough for zeros within 0.01 degrees (95 %)")
    assert 0.92 < np.mean(held) < 0.98


@pytest.mark.parametrize(("which", "joint"), [({"base": True}, 1), ({"base": True, "tool": True}, 6)])
def test_what_base_or_tool_hide_is_refused(robots, which, joint):
    points = measured(robots["mon"], arm().random_joints(8, 5))
    with pytest.raises(MeasurementError, match="the zero of the first joint cannot be separated"):
        Refit(**which, zeros=(joint,)).placed(robots["mon"], points, "m.csv")


def test_evaluate_tells_the_zeros_of_a_calibrated_robot(program, robots, folder, tmp_path):
    moved = crashed(robots["mon"].replace(T_world_base=robots["wed"].T_world_base))
    few = measured(moved, arm().random_joints(8, 7), NOISE, np.random.default_rng(2))
    data = write_measurements(tmp_path / "few.csv", few)
    found = program("evaluate", folder / "cal", data, "--refit-base", "--refit-zeros", "3,5", "--json")
    for joint, note in zip((3, 5), found["notes"][:2], strict=True):
        words = note.split()
        assert words[1] == str(joint)
        value, half = float(words[3]), float(words[5])
        assert abs(value - np.degrees(LOST[joint])) < max(1.5 * half, 1e-3)
        assert half < 0.01
    assert found["calibrated"]["mean_mm"] < 0.1
    without = irbcal.evaluate(folder / "cal", data, refit_base=True)
    assert without.calibrated["mean_mm"] > 1.0


@pytest.mark.parametrize("zeros", [(7,), (0,), (3, 3), (2.5,)])
def test_joints_that_are_none_are_refused(folder, zeros):
    with pytest.raises(OptionError, match="refit_zeros"):
        irbcal.evaluate(folder / "cal", folder / "m.csv", refit_zeros=zeros)
