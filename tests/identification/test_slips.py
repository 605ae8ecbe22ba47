"""Slips of the pen that are found by hypothesis, and files in which there are none."""

import dataclasses
import shlex

import numpy as np
import pytest
from support import arm, example_robot, measured, random_robot, write_measurements

import irbcal
from irbcal.identification import data_entry_errors, outliers
from irbcal.io import urdf
from irbcal.measurement import cleaning, table
from irbcal.measurement.points import distances


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
    **{f"joint {k + 1} with its sign turned": turned(k) for k in range(6)},
    "joints 2 and 5 with their signs turned": turned(1, 4),
    "joints 2, 3 and 5 with their signs turned": turned(1, 2, 4),
    "joints 1 and 6 swapped": swapped(0, 5),
    "joints 3 and 4 swapped": swapped(2, 3),
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
def test_a_slip_is_named_and_its_remedy_mends_the_file(words, tmp_path, monkeypatch, program):
    monkeypatch.chdir(tmp_path)
    nominal = arm()
    good = seen = points(nominal, poses=40)
    for change in PAIRS.get(words) or (CASES[words],):
        seen = change(seen)
    slip = data_entry_errors.find_entry_error(nominal, seen)
    assert slip is not None
    assert slip.looks_like == words
    # read so, the points are as near as before the slip was made
    near = np.median(distances(outliers.trimmed(nominal, good), good))
    assert slip.after == pytest.approx(near, rel=0.2)
    remedy = slip.remedy("m.csv")
    if "one pose" in words:
        where = "up" if "late" in words else "down"
        assert remedy == f"to mend it, move the columns of target and position 1 pose {where}"
        return
    write_measurements(tmp_path / "m.csv", seen)
    program(*shlex.split(remedy.removeprefix("to read them so: "))[1:])
    mended = cleaning.clean(table.read("mended.csv")).points
    assert np.median(distances(outliers.trimmed(nominal, mended), mended)) == pytest.approx(near, rel=0.2)


def test_a_slip_is_found_among_gross_errors():
    nominal = arm()
    rng = np.random.default_rng(4)
    seen = turned(2)(points(nominal))
    xyz = seen.xyz.copy()
    wrong = rng.random(len(xyz)) < 0.15
    xyz[wrong] += rng.uniform(-0.5, 0.5, (wrong.sum(), 3))
    slip = data_entry_errors.find_entry_error(nominal, dataclasses.replace(seen, xyz=xyz))
    assert slip is not None
    assert slip.looks_like == "joint 3 with its sign turned"


def test_what_cannot_be_told_apart_is_told():
    # a wrist's joint 5 turned the other way is joint 4 half a turn on: base and tool take up the rest
    nominal = arm()
    slip = data_entry_errors.find_entry_error(nominal, turned(4)(points(nominal)))
    assert [other.words for other in slip.also] == [("joint 4 with its zero elsewhere (±180 degrees)",)]
    assert "as well with joint 4" in slip.in_words()


@pytest.mark.parametrize("seed", range(4))
def test_nothing_is_named_where_there_is_nothing(seed):
    nominal = arm()
    seen = points(nominal, seed, poses=(15, 40, 60, 120)[seed])
    assert data_entry_errors.find_entry_error(nominal, seen) is None
    noise = np.random.default_rng(seed).normal(size=seen.xyz.shape)
    assert data_entry_errors.find_entry_error(nominal, dataclasses.replace(seen, xyz=noise)) is None
    assert data_entry_errors.find_entry_error(arm("irb120"), seen) is None


def test_too_few_poses_name_nothing():
    nominal = arm()
    assert data_entry_errors.find_entry_error(nominal, turned(2)(points(nominal, poses=9))) is None


@pytest.mark.parametrize(
    ("name", "robot"),
    [("irb120_laser_tracker/measurements.csv", "irb120"), ("ur10_laser_tracker_6d/measurements.csv", "ur10")],
)
def test_measured_robots_have_no_slip_unless_one_is_made(shared_data, name, robot):
    nominal = irbcal.read_urdf(robot).arm
    seen = cleaning.clean(table.read(shared_data / name)).points
    seen = seen.select((seen.groups == seen.groups[-1]) & (np.arange(seen.poses) % 4 < 2))  # base and tool of one group
    assert data_entry_errors.find_entry_error(nominal, seen) is None
    slip = data_entry_errors.find_entry_error(nominal, turned(2)(seen))
    assert slip.looks_like == "joint 3 with its sign turned"


def test_calibrate_names_the_slip(tmp_path):
    nominal = arm()
    write_measurements(tmp_path / "m.csv", turned(2)(points(nominal)))
    with pytest.raises(
        irbcal.MeasurementError, match="these look like joint 3 with its sign turned: read so"
    ) as caught:
        irbcal.calibrate(tmp_path / "m.csv", "irb1600")
    assert "irbcal import" in str(caught.value)
    assert "'joints.signs=[1, 1, -1, 1, 1, 1]'" in str(caught.value)


@pytest.mark.parametrize("seed", [1, 7, 9])
def test_none_is_named_where_points_do_not_tell_base_and_tool(seed):
    """A grid over joints 1 and 2 alone: nearly any hypothesis fits."""
    nominal = urdf.read(example_robot("panda_description/urdf/panda.urdf"), None, "panda_link8").arm
    rng = np.random.default_rng(seed)
    robot = random_robot(nominal, "placement", rng, size=0.2)
    middle = (nominal.lower + nominal.upper) / 2
    grid = np.array(np.meshgrid(*[np.linspace(-0.8, 0.8, 10)] * 2)).reshape(2, -1).T
    q = np.tile(middle + 0.3 * rng.uniform(-1, 1, 7), (100, 1))
    q[:, :2] = middle[:2] + 1.5 * grid
    assert data_entry_errors.find_entry_error(nominal, measured(robot, q, 3e-5, rng)) is None
