"""Slips of the pen that are found by hypothesis, and files in which there are none."""

import dataclasses
import itertools
import shlex

import numpy as np
import pandas as pd
import pytest
import yaml
from support import arm, example_robot, measured, random_robot, write_measurements

import irbcal
from irbcal.identification import data_entry_errors, outliers
from irbcal.io import urdf
from irbcal.measurement import cleaning, table
from irbcal.measurement.imports import column_map, reader, source_file
from irbcal.measurement.points import PointSet, distances


def points(nominal, seed=1, poses=60, share=0.7):
    """A simulated robot, measured: points whose joints are in order and whose steps from pose to pose are large."""
    rng = np.random.default_rng(seed)
    robot = random_robot(nominal, "placement", rng)
    return measured(robot, share * nominal.random_joints(poses, seed), 3e-5, rng)


def read_as(change):
    def changed(seen):
        q = seen.q.copy()
        change(q)
        return dataclasses.replace(seen, q=q)

    return changed


def turned(*joints):
    def change(q):
        q[:, joints] *= -1

    return read_as(change)


def added(joint, other, sign):
    def change(q):
        q[:, joint] += sign * q[:, other]

    return read_as(change)


def swapped(a, b):
    def change(q):
        q[:, [a, b]] = q[:, [b, a]]

    return read_as(change)


def moved(joint, degrees):
    def change(q):
        q[:, joint] += np.radians(degrees)

    return read_as(change)


def scaled(factor):
    return lambda seen: dataclasses.replace(seen, xyz=seen.xyz * np.asarray(factor))


def shifted(rows):
    return lambda seen: dataclasses.replace(seen, q=np.roll(seen.q, rows, axis=0))


RADIANS = read_as(lambda q: q.__imul__(np.pi / 180))

CASES = {
    "joint 1 with its sign turned": turned(0),
    "joint 6 with its sign turned": turned(5),
    "joints 2, 3 and 5 with their signs turned": turned(1, 2, 4),
    "joints 1 and 6 swapped": swapped(0, 5),
    "joint 3 shown with joint 2 in it (joint 2 is to be added to it)": added(2, 1, -1),
    "joint 3 shown with joint 2 in it (joint 2 is to be taken from it)": added(2, 1, 1),
    "joint 2 with its zero elsewhere (-90 degrees)": moved(1, 90),
    "joint 3 with its zero elsewhere (+90 degrees)": moved(2, -90),
    "joints in radians instead of degrees": RADIANS,
    "positions in metres instead of millimetres": scaled(1e-3),
    "positions in inches instead of millimetres": scaled(1 / 25.4),
    "left-handed points (one axis mirrored, or two swapped)": scaled([1, -1, 1]),
    "points one pose late (they belong to the joints of the row before)": shifted(-1),
    "points one pose early (they belong to the joints of the row behind)": shifted(1),
}

PAIRS = {
    "joints in radians instead of degrees and positions in metres instead of millimetres": (RADIANS, scaled(1e-3)),
    "joint 2 with its zero elsewhere (-90 degrees) and joint 3 with its zero elsewhere (+90 degrees)": (
        moved(1, 90),
        moved(2, -90),
    ),
    "joint 3 shown with joint 2 in it (joint 2 is to be taken from it) and joint 2 with its sign turned": (
        turned(1),
        added(2, 1, 1),
    ),
}


@pytest.mark.parametrize("words", [*CASES, *PAIRS])
def test_a_data_entry_error_is_named_and_its_remedy_mends_the_file(words, tmp_path, monkeypatch, program):
    monkeypatch.chdir(tmp_path)
    nominal = arm()
    good = seen = points(nominal, poses=40)
    for change in PAIRS.get(words) or (CASES[words],):
        seen = change(seen)
    data_entry_error = data_entry_errors.find_data_entry_error(nominal, seen)
    assert data_entry_error is not None
    assert data_entry_error.looks_like == words
    # read so, the points are as near as before the data-entry error was made
    near = np.median(distances(outliers.least_trimmed_squares(nominal, good), good))
    assert data_entry_error.median_after == pytest.approx(near, rel=0.2)
    remedy = data_entry_error.remedy("m.csv")
    if "one pose" in words:
        where = "up" if "late" in words else "down"
        assert remedy == f"to mend it, move the columns of target and position 1 pose {where}"
        return
    write_measurements(tmp_path / "m.csv", seen)
    program(*shlex.split(remedy.removeprefix("to read them so: "))[1:])
    mended = cleaning.clean(table.read("mended.csv")).points
    assert np.median(distances(outliers.least_trimmed_squares(nominal, mended), mended)) == pytest.approx(near, rel=0.2)


def test_every_remedy_reads_joints_as_its_hypothesis_does():
    """All single hypotheses and each 19th pair of them; the import's own rules for signs, sums and zeros are the oracle."""
    nominal = arm()
    columns = tuple(f"q{k}_deg" for k in range(1, 7))
    shown = np.random.default_rng(1).uniform(-3.0, 3.0, (4, 6))
    single = list(data_entry_errors.hypotheses(nominal))
    remedies = 0
    for hypothesis in [*single, *list(data_entry_errors._pairs(single))[::19]]:
        error = data_entry_errors.DataEntryError(hypothesis, 1.0, 0.0, joint_columns=columns)
        words = shlex.split(error.remedy("m.csv"))
        values = dict(text.split("=", 1) for key, text in itertools.pairwise(words) if key == "--set")
        if not values or hypothesis.late:
            continue
        remedies += 1
        joints = {key.removeprefix("joints."): yaml.safe_load(text) for key, text in values.items()}
        rules = column_map.JointRules(**{key: joints[key] for key in ("signs", "offsets_deg", "add") if key in joints})
        order = yaml.safe_load(values.get("columns.joints", str(list(columns))))
        read = pd.DataFrame(np.degrees(shown), columns=columns)[order].set_axis(columns, axis=1)
        if values.get("units.joints") == "rad":
            read = np.degrees(read)
        read = reader.joint_rules_applied(read.assign(**{source_file.SOURCE: "m.csv"}), rules)[list(columns)].to_numpy()
        expected = np.degrees(hypothesis.joints(shown))
        np.testing.assert_allclose(read, expected, rtol=1e-9, atol=1e-7, err_msg=error.looks_like)
    assert remedies > 200


def test_a_data_entry_error_is_found_among_outliers():
    nominal = arm()
    rng = np.random.default_rng(4)
    seen = turned(2)(points(nominal))
    xyz = seen.xyz.copy()
    wrong = rng.random(len(xyz)) < 0.15
    xyz[wrong] += rng.uniform(-0.5, 0.5, (wrong.sum(), 3))
    data_entry_error = data_entry_errors.find_data_entry_error(nominal, dataclasses.replace(seen, xyz=xyz))
    assert data_entry_error is not None
    assert data_entry_error.looks_like == "joint 3 with its sign turned"


def test_what_cannot_be_told_apart_is_told():
    # a wrist's joint 5 turned the other way is joint 4 half a turn on: base and tool take up the rest
    nominal = arm()
    data_entry_error = data_entry_errors.find_data_entry_error(nominal, turned(4)(points(nominal)))
    assert [other.descriptions for other in data_entry_error.also] == [
        ("joint 4 with its zero elsewhere (±180 degrees)",)
    ]
    assert "as well with joint 4" in data_entry_error.in_words()


@pytest.mark.parametrize("seed", [0, 2])
def test_nothing_is_named_where_there_is_nothing(seed):
    nominal = arm()
    seen = points(nominal, seed, poses=(15, 40, 60, 120)[seed])
    assert data_entry_errors.find_data_entry_error(nominal, seen) is None
    noise = np.random.default_rng(seed).normal(size=seen.xyz.shape)
    assert data_entry_errors.find_data_entry_error(nominal, dataclasses.replace(seen, xyz=noise)) is None
    assert data_entry_errors.find_data_entry_error(arm("irb120"), seen) is None


def test_too_few_poses_name_nothing():
    nominal = arm()
    assert data_entry_errors.find_data_entry_error(nominal, turned(2)(points(nominal, poses=9))) is None


@pytest.mark.parametrize(
    ("name", "robot"),
    [("irb120_laser_tracker/measurements.csv", "irb120"), ("ur10_laser_tracker_6d/measurements.csv", "ur10")],
)
def test_measured_robots_have_no_data_entry_error_unless_one_is_made(shared_data, name, robot):
    nominal = irbcal.read_urdf(robot).arm
    seen = cleaning.clean(table.read(shared_data / name)).points
    seen = seen.select((seen.groups == seen.groups[-1]) & (np.arange(seen.poses) % 4 < 2))  # base and tool of one group
    assert data_entry_errors.find_data_entry_error(nominal, seen) is None
    data_entry_error = data_entry_errors.find_data_entry_error(nominal, turned(2)(seen))
    assert data_entry_error.looks_like == "joint 3 with its sign turned"


def test_calibrate_names_the_data_entry_error(tmp_path):
    nominal = arm()
    write_measurements(tmp_path / "m.csv", turned(2)(points(nominal)))
    with pytest.raises(
        irbcal.MeasurementError, match="these look like joint 3 with its sign turned: read so"
    ) as caught:
        irbcal.calibrate(tmp_path / "m.csv", "irb1600")
    assert "irbcal import" in str(caught.value)
    assert "'joints.signs=[1, 1, -1, 1, 1, 1]'" in str(caught.value)


@pytest.mark.parametrize("seed", [1, 7])
def test_none_is_named_where_points_do_not_tell_base_and_tool(seed):
    """A grid over joints 1 and 2 alone: nearly any hypothesis fits."""
    nominal = urdf.read(example_robot("panda_description/urdf/panda.urdf"), None, "panda_link8").arm
    rng = np.random.default_rng(seed)
    robot = random_robot(nominal, "placement", rng, size=0.2)
    middle = (nominal.lower + nominal.upper) / 2
    grid = np.array(np.meshgrid(*[np.linspace(-0.8, 0.8, 10)] * 2)).reshape(2, -1).T
    q = np.tile(middle + 0.3 * rng.uniform(-1, 1, 7), (100, 1))
    q[:, :2] = middle[:2] + 1.5 * grid
    assert data_entry_errors.find_data_entry_error(nominal, measured(robot, q, 3e-5, rng)) is None


TOOL = {"smr": np.array([0.05, 0.02, 0.1])}


def points_lost_rows(nominal, seed=1, poses=60, targets=None):
    """A simulated robot, measured at random poses."""
    rng = np.random.default_rng(seed)
    robot = random_robot(nominal, "placement", rng, targets=targets)
    return robot, measured(robot, 0.7 * nominal.random_joints(poses, seed), 3e-5, rng)


def beside(seen, joints, positions):
    """The joints of some poses, one after the other, beside the positions of others."""
    n, k = min(len(joints), len(positions)), len(seen.target_names)
    xyz = seen.xyz.reshape(seen.poses, k, 3)[positions[:n]].reshape(-1, 3)
    pose, target = np.repeat(np.arange(n), k), np.tile(np.arange(k), n)
    return PointSet(seen.q[joints[:n]], pose, target, xyz, seen.target_names, np.arange(1, n + 1), np.full(n, ""))


def damaged(seen, how, place):
    """The file with a row lost or doubled, and how late positions are behind it."""
    every = np.arange(seen.poses)
    lost, doubled = np.delete(every, place), np.insert(every, place, place - 1)
    cases = {
        "position lost": (every, lost, -1),
        "position doubled": (every, doubled, 1),
        "joints lost": (lost, every, 1),
        "joints doubled": (doubled, every, -1),
    }
    joints, positions, late = cases[how]
    return beside(seen, joints, positions), late


def with_outliers(seen, share, seed=0):
    rng = np.random.default_rng(seed)
    xyz = seen.xyz.copy()
    wrong = rng.random(len(xyz)) < share
    xyz[wrong] += rng.uniform(-0.5, 0.5, (wrong.sum(), 3))
    return dataclasses.replace(seen, xyz=xyz)


@pytest.mark.parametrize("how", ["position lost", "position doubled", "joints lost", "joints doubled"])
@pytest.mark.parametrize("place", [5, 30, 54])
def test_the_place_is_found_anywhere(how, place):
    nominal = arm()
    robot, seen = points_lost_rows(nominal, targets=TOOL if place % 2 else None)
    wrong, late = damaged(seen, how, place)
    for found in (data_entry_errors.find_lost_row(nominal, wrong), data_entry_errors.lost_row_of_robot(robot, wrong)):
        assert found is not None
        assert found.late == late
        assert abs(int(found.pose) - 1 - place) <= 1  # of a row that has no partner nobody knows the side
        assert found.median_before > 8 * found.median_after


def test_it_is_found_among_outliers():
    nominal = arm()
    wrong, late = damaged(points_lost_rows(nominal)[1], "position lost", 25)
    found = data_entry_errors.find_lost_row(nominal, with_outliers(wrong, 0.1))
    assert found is not None
    assert (found.late, abs(int(found.pose) - 26) <= 1) == (late, True)


@pytest.mark.parametrize("seed", range(4))
def test_nothing_is_named_where_there_is_nothing_lost_rows(seed):
    nominal = arm(("irb1600", "irb120", "ur10", "panda")[seed % 4])
    robot, seen = points_lost_rows(nominal, seed, poses=(25, 60, 90)[seed % 3], targets=TOOL if seed % 2 else None)
    for share in (0.0, 0.1, 0.3):
        wrong = with_outliers(seen, share, seed)
        assert data_entry_errors.find_lost_row(nominal, wrong) is None
        assert data_entry_errors.lost_row_of_robot(robot, wrong) is None
    noise = np.random.default_rng(seed).normal(size=seen.xyz.shape)
    assert data_entry_errors.find_lost_row(nominal, dataclasses.replace(seen, xyz=noise)) is None


def test_small_steps_between_poses():
    """Neighbours are then nearly as near as the row's own partner."""
    nominal = arm()
    rng = np.random.default_rng(3)
    ends = 0.5 * nominal.random_joints(2, 3)
    q = ends[0] + np.linspace(0, 1, 80)[:, None] * 0.1 * (ends[1] - ends[0])
    q += 0.05 * np.sin(np.arange(80)[:, None] * np.array([0.11, 0.13, 0.17, 0.19, 0.23, 0.29]))
    robot = random_robot(nominal, "placement", rng)
    seen = measured(robot, q, 3e-5, rng)
    assert data_entry_errors.find_lost_row(nominal, seen) is None
    found = data_entry_errors.find_lost_row(nominal, damaged(seen, "position lost", 40)[0])
    assert found is None or found.pose == "41"


def test_too_few_poses_name_nothing_lost_rows():
    nominal = arm()
    assert (
        data_entry_errors.find_lost_row(
            nominal, damaged(points_lost_rows(nominal, poses=20)[1], "position lost", 10)[0]
        )
        is None
    )


def test_the_row_is_told_by_calibrate_and_evaluate(tmp_path):
    nominal = arm()
    _, seen = points_lost_rows(nominal, poses=80, targets=TOOL)
    good = write_measurements(tmp_path / "good.csv", beside(seen, np.arange(80), np.arange(80)))
    middle = write_measurements(tmp_path / "middle.csv", damaged(seen, "position lost", 40)[0])
    begin = write_measurements(tmp_path / "begin.csv", damaged(seen, "position lost", 20)[0])
    end = write_measurements(tmp_path / "end.csv", damaged(seen, "joints lost", 70)[0])
    words = (
        "from pose 41 on the points are one pose early: a position is missing or a row of joints is doubled at about "
    )
    with pytest.raises(irbcal.MeasurementError) as caught:
        irbcal.calibrate(middle, "irb1600")
    assert words + "row 42 of middle.csv" in str(caught.value)
    # where the rest is enough for a calibration it is a note
    made = irbcal.calibrate(end, "irb1600", "34")
    assert any("the points are one pose late" in note and "of end.csv" in note for note in made.validated.notes)
    calibration = irbcal.calibrate(good, "irb1600", "34")
    assert not any("one pose" in note for note in (*calibration.validated.notes, *calibration.validated.doubts))
    calibration.save(tmp_path / "cal")
    with pytest.raises(irbcal.MeasurementError, match="from pose 21 on the points are one pose early"):
        irbcal.evaluate(tmp_path / "cal", begin, include_fitted=True)
    found = irbcal.evaluate(tmp_path / "cal", end, include_fitted=True)
    assert any("one pose late" in note for note in found.notes)
