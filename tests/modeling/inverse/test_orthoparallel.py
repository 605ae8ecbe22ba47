"""The closed form: all branches of all arms that it takes, up to their singularities."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from inverse_cases import assert_all_branches_reach
from support import arm, random_robot, random_rotation

from irbcal.errors import RobotError
from irbcal.modeling import frames
from irbcal.modeling.dhm import DHMTable
from irbcal.modeling.inverse import closed_form
from irbcal.modeling.inverse.orthoparallel import OrthoParallel

MANY = 100_000
ROBOTS = ("irb1600", "irb120")


def whole_turns_apart(a, b):
    """Largest difference of joints (n, 6) modulo whole turns, (n,)."""
    d = np.abs(a - b)
    return np.abs(d - 2 * np.pi * np.rint(d / (2 * np.pi))).max(axis=1)


def changed(nominal, **columns):
    """The arm with entries of its table changed: ``d=(4, 0.01)`` adds 0.01 to d5."""
    values = {}
    for key, (i, delta) in columns.items():
        values[key] = getattr(nominal.table, key).copy()
        values[key][i] += delta
    return nominal.with_table(replace(nominal.table, **values))


def one_of(name, level, seed):
    """A shipped arm with random errors of a level; base and tip links anywhere on it."""
    rng = np.random.default_rng(seed)
    robot = random_robot(arm(name), level, rng, size=1.0)
    T_base_0 = frames.transform(random_rotation(rng), rng.uniform(-1, 1, 3))
    T_last_tip = frames.transform(random_rotation(rng), rng.uniform(-0.3, 0.3, 3))
    return replace(robot.arm, T_base_0=T_base_0, T_last_tip=T_last_tip)


@pytest.mark.parametrize("name", ROBOTS)
def test_random_joints_come_back(name):
    nominal = arm(name)
    q = nominal.random_joints(MANY, 1)
    T = nominal.forward(q)
    branches = closed_form.branches(nominal, T)
    row, branch = np.arange(MANY), closed_form.configuration(nominal, q)
    assert branches.valid[row, branch].all()
    assert_all_branches_reach(nominal, branches, T)
    away = (branches.wrist[row, branch] > 1e-5) & (branches.shoulder > 1e-5) & (branches.elbow[row, branch] > 1e-5)
    assert away.mean() > 0.99
    assert whole_turns_apart(branches.joints[row, branch], q)[away].max() < 1e-9
    for k in range(8):
        valid = branches.valid[:, k] & (branches.wrist[:, k] > 1e-9)
        assert (closed_form.configuration(nominal, branches.joints[valid, k]) == k).mean() > 0.9999


@pytest.mark.parametrize("level", ["11", "16"])
@pytest.mark.parametrize("name", ROBOTS)
def test_offsets_and_lengths_of_a_calibrated_arm(name, level):
    calibrated = one_of(name, level, seed=5)
    q = calibrated.random_joints(20_000, 2)
    T = calibrated.forward(q)
    branches = closed_form.branches(calibrated, T)
    assert_all_branches_reach(calibrated, branches, T)
    assert np.abs(branches.joints[branches.valid]).max() <= np.pi + 1e-12
    found = branches.joints[np.arange(len(q)), closed_form.configuration(calibrated, q)]
    assert np.median(whole_turns_apart(found, q)) < 1e-13


@pytest.mark.parametrize("signs", [(1, 0, 1, 1, 1), (-1, 2, -1, 1, -1), (1, 0, -1, -1, 1), (-1, 0, 1, -1, -1)])
@pytest.mark.parametrize("upper", [0.6, -0.6])
def test_other_directions_of_axes(signs, upper):
    alpha = np.array([0.3, *(np.pi / 2 * s for s in signs)])
    table = DHMTable(alpha, [0.1, 0.2, upper, 0.05, 0, 0], [0.4, -1, 2, 0.7, -3, 1], [0.5, 0.1, 0, -0.7, 0, 0.1])
    d = table.d.copy()
    d[2] = -0.1 if signs[1] == 0 else 0.1  # the shoulder's offset taken back by the elbow
    other = replace(arm(), table=replace(table, d=d), lower=np.full(6, -np.pi), upper=np.full(6, np.pi))
    q = other.random_joints(2_000, 3)
    T = other.forward(q)
    branches = closed_form.branches(other, T)
    assert_all_branches_reach(other, branches, T)
    assert np.abs(branches.joints[branches.valid]).max() <= np.pi + 1e-12
    found = branches.joints[np.arange(len(q)), closed_form.configuration(other, q)]
    assert np.median(whole_turns_apart(found, q)) < 1e-12


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"alpha": (3, 1e-4)}, r"alpha4 = \+-90 degrees, found -89.99"),
        ({"alpha": (2, 1e-4)}, "alpha3 = 0 or 180 degrees"),
        ({"beta": (2, 1e-4)}, "beta3 = 0"),
        ({"a": (4, 1e-4)}, "a5 = 0, found 0.1 mm"),
        ({"d": (4, 1e-4)}, "d5 = 0, found 0.1 mm"),
        ({"d": (2, 1e-4)}, r"d2 \+ d3 = 0, but d2 = 0 mm and d3 = 0.1 mm"),
        ({"a": (2, -0.7)}, "a3 different from zero"),
        ({"d": (3, -0.6)}, "a4 or d4 different from zero"),
        ({"alpha": (3, np.nan)}, "alpha4"),
    ],
)
def test_other_tables_are_refused(change, words):
    with pytest.raises(RobotError, match=words):
        closed_form.branches(changed(arm(), **change), np.eye(4)[None])


@pytest.mark.parametrize("name", ROBOTS)
def test_shoulder_singularity(name):
    nominal = arm(name)
    closed = OrthoParallel.from_arm(nominal)
    q = nominal.random_joints(2_000, 5)
    T = nominal.forward(q)
    # bring the wrist centre over axis 1
    T[:, :2, 3] = T[:, :2, 2] * nominal.table.d[5]
    T[:, 2, 3] = nominal.table.d[0] + 0.4 * closed.reach + T[:, 2, 2] * nominal.table.d[5]
    for distance in (0.0, 1e-9, 1e-7):
        moved = T.copy()
        moved[:, 0, 3] += distance
        branches = closed.branches(moved)
        assert branches.valid.all()
        assert np.abs(branches.shoulder - distance).max() < 1e-15
        assert_all_branches_reach(nominal, branches, moved)
        assert (branches.singular()["shoulder"] == branches.valid).all()


@pytest.mark.parametrize("name", ROBOTS)
def test_elbow_singularity(name):
    nominal = arm(name)
    closed = OrthoParallel.from_arm(nominal)
    q = nominal.random_joints(1_000, 6)
    # forearm along the upper arm, which needs q3 beyond the limits of one of the two
    q[:, 2] = -np.pi / 2 + np.arctan2(closed.a4, closed.d4)
    T = nominal.forward(q)
    branches = closed.branches(T)
    assert_all_branches_reach(nominal, branches, T)
    here = closed_form.configuration(nominal, q) // 4
    row = np.arange(len(q))
    assert np.abs(branches.reach_margin[row, here]).max() < 1e-13
    assert branches.singular()["elbow"].any(axis=1).all()
    # a micrometre further is out of reach, and says by how much
    out = changed(nominal, d=(3, 1e-6))
    branches = closed.branches(out.forward(q))
    assert not branches.valid[row, 4 * here].any()
    assert branches.reach_margin[row, here].max() < -0.5e-6


@settings(max_examples=60, deadline=None)
@given(st.lists(st.floats(-1.0, 1.0), min_size=6, max_size=6), st.sampled_from(ROBOTS), st.integers(0, 2**20))
def test_any_joints_of_any_level_16_arm_come_back(part, name, seed):
    calibrated = one_of(name, "16", seed)
    q = calibrated.lower + (calibrated.upper - calibrated.lower) * (np.array(part)[None] + 1.0) / 2.0
    T = calibrated.forward(q)
    branches = closed_form.branches(calibrated, T)
    assert branches.valid[0, closed_form.configuration(calibrated, q)[0]]
    assert_all_branches_reach(calibrated, branches, T)
