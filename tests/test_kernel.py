"""The compiled kernel computes what numpy's plain functions compute, and refuses what it was not made for."""

import copy
import os
import pickle
import shutil
import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path

import exported
import mpmath
import numpy as np
import pytest
from support import arm, random_robot
from term_cases import framed_robot

from irbcal import kernel
from irbcal.errors import RobotError
from irbcal.modeling.inverse import calibrated_arm, closed_form, fixed_point
from irbcal.modeling.inverse.orthoparallel import OrthoParallel
from irbcal.modeling.inverse.result import Method, Reason
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.term_sums import compiled as kernel_of
from irbcal.planners.calibrated_model import CalibratedModel

ROOT = Path(__file__).parents[1]
ROUNDING = 1e-14
"""Metres, radians, and what a Jacobian has of both."""
ROBOTS = ("irb1600", "ur10", "panda", "rail", "level", "plain", "framed")

compiled = pytest.mark.skipif(kernel.Kernel is None, reason=kernel.STATE)


@pytest.fixture(scope="module")
def robots(tmp_path_factory):
    """Robots with every kind of term and with none, on six and seven joints, turning and sliding."""
    folder = tmp_path_factory.mktemp("robots")
    framed = {"framed": framed_robot("irb1600", np.random.default_rng(1))}
    return {name: exported.robot(name, folder) for name in ROBOTS if name != "framed"} | framed


def by_numpy(monkeypatch, robot):
    """The same robot, new, where nothing that is made from now on has a kernel."""
    monkeypatch.setattr(kernel, "Kernel", None)
    maps = robot.joint_map
    fixed_point.kernel_of.cache_clear()
    return robot.replace(joint_map=JointMap(maps.terms, maps.ranges, maps.payload_kg))


def stops(robot, n=203):
    """Commanded joints, and the stops before them: some not known, some short moves."""
    q, previous = (robot.arm.random_joints(n, seed) for seed in (4, 5))
    previous[::4] = np.nan
    previous[1::4] = q[1::4] + 1e-3 * previous[1::4]
    return q, previous


@compiled
@pytest.mark.parametrize("name", ROBOTS)
def test_forward_and_joint_map_are_those_of_numpy(robots, name, monkeypatch):
    robot = robots[name]
    q, previous = stops(robot)
    rng = np.random.default_rng(6)
    load = {"payload_kg": rng.uniform(0, 5, len(q)), "payload_centre": rng.uniform(-0.2, 0.2, (len(q), 3))}
    load["torques"] = rng.normal(0, 30, q.shape)
    for values in load.values():  # what is no number is not known
        values.reshape(-1)[::7] = np.nan
    situations = [
        {"previous": previous},
        {"payload_kg": load["payload_kg"]},
        {"previous": previous, "payload_centre": load["payload_centre"]},
        {"torques": load["torques"]},
        {"previous": previous, **load},
        {"payload_kg": 2.0, "payload_centre": [0.1, 0.0, 0.2]},
    ]
    assert robot.kernel is not None

    def computed(robot):
        each = [(robot.forward(q, **at), robot.joint_map.effective(q, **at)) for at in situations]
        return [robot.poses(q), robot.forward(q[:1]), *(values for pair in each for values in pair)]

    def slopes(robot):
        maps, dq = robot.joint_map, np.sin(q)
        return maps.jacobian(q), maps.jacobian(q, previous), maps.jacobian(q[:1]), maps.jacobian_derivative(q, dq)

    found, slopes_found, plain = computed(robot), slopes(robot), by_numpy(monkeypatch, robot)
    assert plain.kernel is None
    # numpy takes differences for what a payload's slopes change by in time
    for ours, theirs, digits in zip(slopes_found, slopes(plain), (1e-14, 1e-13, 1e-14, 1e-11), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=digits)
    for ours, theirs in zip(found, computed(plain), strict=True):
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=ROUNDING)


@compiled
@pytest.mark.parametrize("name", ROBOTS)
def test_a_pose_has_the_same_numbers_alone_and_among_others(robots, name):
    robot = robots[name]
    q, _ = stops(robot, 37)
    np.testing.assert_array_equal(robot.poses(q), np.concatenate([robot.poses(row[None]) for row in q]))


@compiled
@pytest.mark.parametrize(
    ("name", "frame"), [("irb1600", None), ("ur10", "target_a"), ("panda", "third link"), ("panda", None)]
)
def test_placements_and_jacobians_are_those_of_numpy_and_pinocchio(name, frame, monkeypatch):
    robot, data, _ = exported.described(name)
    if frame == "third link":
        frame = robot.arm.joint_names[2]
    frames = {"target_a": np.array([[0.0, -1.0, 0.0, 0.1], [1.0, 0.0, 0.0, -0.2], [0, 0, 1.0, 0.3], [0, 0, 0, 1]])}
    q, _ = stops(robot, 25)
    references = ("LOCAL", "WORLD", "LOCAL_WORLD_ALIGNED")

    def values():
        model = CalibratedModel(data, robot.arm, robot.joint_map, frames)
        jacobians = [model.jacobian(q, frame, reference) for reference in references]
        return model.placement(q, frame), jacobians, [model.jacobian_derivative(q, dq, frame, r) for r in references]

    dq = np.random.default_rng(2).uniform(-1, 1, q.shape)
    T, jacobians, rates = values()
    by_numpy(monkeypatch, robot)
    T_plain, jacobians_plain, rates_plain = values()
    digits = ROUNDING if frame in (None, "target_a") else 1e-12  # of the URDF's numbers
    np.testing.assert_allclose(T, T_plain, rtol=0, atol=digits)
    np.testing.assert_allclose(jacobians, jacobians_plain, rtol=0, atol=digits)
    # numpy takes differences for what a payload's slopes change by in time
    np.testing.assert_allclose(rates, rates_plain, rtol=0, atol=1e-11)
    # against Pinocchio by the forward kinematics of its own model, for which the map is undone
    import pinocchio as pin

    model = CalibratedModel(data, robot.arm, robot.joint_map, frames)
    state, number = model.model.createData(), model.model.getFrameId(frame or robot.arm.tip_link)
    base = model.model.getFrameId(robot.arm.base_link)
    for row, place in zip(model.model_from_command(q), T, strict=True):
        pin.framesForwardKinematics(model.model, state, row)
        expected = state.oMf[base].actInv(state.oMf[number]).homogeneous
        np.testing.assert_allclose(place, expected, rtol=0, atol=1e-12)


@compiled
def test_sines_and_cosines_to_the_last_digit():
    one_joint = kernel.of_robot({"slides": np.zeros(1), "chain": np.tile(np.eye(3, 4), (2, 1, 1))})
    rng = np.random.default_rng(1)
    quarter = np.pi / 2 * np.arange(-40, 41)
    angles = np.concatenate([rng.uniform(-7, 7, 500), rng.uniform(-1e4, 1e4, 500), quarter, quarter + 1e-9])[:, None]
    for rows in (angles, angles[:3]):
        T = np.empty((len(rows), 4, 4))
        assert one_joint.poses(rows, None, True, T)
        with mpmath.workdps(40):
            exact = np.array([[float(mpmath.cos(x)), float(mpmath.sin(x))] for x in rows[:, 0]])
        error = np.abs(T[:, :2, 0] - exact) / np.spacing(np.abs(exact))
        assert error.max() <= 1.0


@compiled
@pytest.mark.parametrize("name", ["irb1600", "irb120"])
def test_all_branches_are_those_of_numpy(name, monkeypatch):
    nominal = arm(name)
    T = nominal.forward(nominal.random_joints(101, 3))
    T[5, :3, 3] *= 3.0  # out of reach
    T[6, 0, 0], T[7, 3, 0], T[8, 1, 3] = np.nan, 1.0, np.inf
    T[9, :3, :3] *= 1.1
    found = closed_form.branches(nominal, T)
    monkeypatch.setattr(kernel, "Kernel", None)
    OrthoParallel.from_arm.cache_clear()
    expected = closed_form.branches(nominal, T)
    OrthoParallel.from_arm.cache_clear()
    np.testing.assert_array_equal(np.isnan(found.joints), np.isnan(expected.joints))
    np.testing.assert_array_equal(found.valid, expected.valid)
    turned = np.abs(found.joints - expected.joints)
    assert np.nanmax(np.minimum(turned, np.abs(turned - 2 * np.pi))) < 1e-11  # digits are lost next to singularities
    poses = np.isfinite(found.shoulder)
    assert np.flatnonzero(~poses).tolist() == [6, 7, 8, 9]
    np.testing.assert_allclose(found.shoulder[poses], expected.shoulder[poses], rtol=0, atol=ROUNDING)
    np.testing.assert_allclose(found.reach_margin[poses], expected.reach_margin[poses], rtol=0, atol=ROUNDING)


@compiled
@pytest.mark.parametrize("size", [0.3, 3.0])
def test_the_inverse_is_that_of_numpy(size, monkeypatch):
    nominal = arm()
    robot = random_robot(nominal, "34", np.random.default_rng(7), size=size)
    q = nominal.random_joints(300, 8)
    T, seed = robot.poses(q), q + 0.01 * np.random.default_rng(1).standard_normal(q.shape)
    T[3] = np.nan
    found = calibrated_arm.solve(robot, nominal, T, seed, thorough=False)
    some = [calibrated_arm.solve(robot, nominal, T[k : k + 1], seed[k], thorough=False) for k in range(40)]
    expected = calibrated_arm.solve(by_numpy(monkeypatch, robot), nominal, T, seed, thorough=False)
    fixed_point.kernel_of.cache_clear()
    np.testing.assert_array_equal(found.converged, expected.converged)
    assert found.converged.sum() > 290
    reached = robot.poses(np.nan_to_num(found.joints))[found.converged]
    assert np.abs(reached - T[found.converged]).max() < 2e-10
    regular = np.abs(np.sin(found.joints[:, 4])) > 0.2  # elsewhere the tolerance leaves more of joints 4 and 6 open
    np.testing.assert_allclose(found.joints[regular], expected.joints[regular], rtol=0, atol=1e-8)
    for k, one in enumerate(some):
        for field in fields(one):
            np.testing.assert_array_equal(getattr(one, field.name), getattr(found, field.name)[k : k + 1])


@compiled
@pytest.mark.parametrize("asked", ["seed, not thorough", "configuration", "seed and configuration"])
def test_what_stays_unsolved_is_told_as_by_numpy(asked, monkeypatch):
    """Next to singularities, at limits, beyond limits and reach: joints, reasons and the errors that are left."""
    nominal, rng = arm(), np.random.default_rng(4)
    robot = random_robot(nominal, "34b", np.random.default_rng(3))
    q = nominal.random_joints(75, 3)
    q[:12, 4] = rng.uniform(-0.01, 0.01, 12)
    q[12:25, 2] = -np.pi / 2  # the arm stretched
    q[25:30, 2] = nominal.upper[2] - 1e-6
    q[30:45] += rng.uniform(-1.0, 1.0, (15, 6))
    T = robot.poses(q)
    T[12:20, :3, 3] *= 1.0 + rng.uniform(0.0, 3e-3, (8, 1))  # a little beyond the reach, then far
    T[20:50, :3, 3] *= rng.uniform(0.5, 1.6, (30, 1))
    T[3], T[4, :3, :3] = np.nan, 1.1 * T[4, :3, :3]
    seed = q + 1e-2 * rng.standard_normal(q.shape)
    seed[4:6, 1] = np.nan
    how = {"thorough": False} if "not" in asked else {}
    how |= {"seed": seed} if "seed" in asked else {}
    how |= {"configuration": rng.integers(0, 8, len(q))} if "configuration" in asked else {}
    assert fixed_point.kernel_of(robot, nominal) is not None
    found = calibrated_arm.solve(robot, nominal, T, **how)
    plain = by_numpy(monkeypatch, robot)
    expected = calibrated_arm.solve(plain, nominal, T, **how)
    fixed_point.kernel_of.cache_clear()
    for name in ("converged", "inside", "configuration", "branch_kept", "method", "reason"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), err_msg=name)
    assert set(found.method) == {Method.NONE, Method.FIXED_POINT, Method.NEWTON}
    assert {Reason.NOT_A_POSE, Reason.OUT_OF_REACH, Reason.NOT_FOUND} < set(found.reason)
    assert (found.reason == Reason.BAD_SEED).sum() == ("seed" in asked)
    lost = ~found.converged
    np.testing.assert_array_equal(np.isnan(found.joints).any(axis=1), lost)
    for name in ("position_residual", "rotation_residual"):
        left = getattr(found, name)[lost]
        np.testing.assert_allclose(left, getattr(expected, name)[lost], rtol=0, atol=1e-9)
        assert np.isnan(left).sum() == (3 if "seed" in asked else 2)
    assert np.abs(plain.forward(found.joints[~lost]) - T[~lost]).max() < 3e-10


@compiled
def test_what_is_not_for_it_is_left_to_the_plain_functions(robots):
    robot = robots["irb1600"]
    q, _ = stops(robot, 8)
    expected = robot.poses(q)
    for other in (q.tolist(), np.asfortranarray(q), np.repeat(q, 2, axis=1)[:, ::2]):
        np.testing.assert_array_equal(robot.poses(other), expected)
    np.testing.assert_array_equal(robot.poses(q[0]), expected[:1])
    for wrong in (np.degrees(q), q[:, :5], np.zeros((2, 2, 6))):
        with pytest.raises(RobotError):
            robot.poses(wrong)
    T = np.empty((8, 4, 4))
    assert not robot.kernel.poses(q.astype(np.float32), None, True, T)
    assert not robot.kernel.poses(q, None, True, T[:7])
    assert not robot.kernel.poses(q, q[:7], True, T)
    assert not robot.kernel.poses(np.degrees(q), None, True, T)
    locked = np.empty((8, 4, 4))
    locked.setflags(write=False)
    assert not robot.kernel.poses(q, None, True, locked)
    with pytest.raises(TypeError, match="expected 4 arguments, found 1"):
        robot.kernel.poses(q)
    assert np.isnan(robot.poses(np.full((1, 6), np.nan))[0, :3, 3]).all()
    assert robot.poses(np.zeros((0, 6))).shape == (0, 4, 4)


@compiled
@pytest.mark.parametrize(
    ("numbers", "fault"),
    [
        ({}, "slides: expected 1 to 12 joints"),
        ({"slides": np.zeros(13)}, "slides"),
        ({"slides": np.zeros(2)}, "chain: there is none"),
        ({"slides": np.zeros(2), "chain": np.zeros(12)}, "chain: expected an array of doubles, 36 for each"),
        ({"slides": np.zeros(2), "chain": np.zeros(36), "waves": np.array([5.0, 1, 1, 1])}, "none of the robot's"),
        ({"slides": np.zeros(2), "chain": np.zeros(36), "levers": np.array([0.0, 0, 9, 1, 0])}, "none of the robot's"),
        ({"slides": np.zeros(2), "chain": np.zeros(36), "cosine": np.zeros(2)}, "even number of orders"),
        ({"slides": np.zeros(2), "chain": np.zeros(36), "closed_form": np.zeros(41)}, "six joints"),
        ({"slides": np.zeros(2), "chain": np.zeros(36), "depth": np.array([3.0])}, "none of the robot's"),
        ({"slides": np.zeros(2), "chain": np.zeros(36), "gain": np.zeros(2)}, "none of the robot's"),
        ({"slides": np.zeros(2), "chain": np.zeros(36), "tiltings": np.full(14, 9.0)}, "none of the robot's"),
        ({"slides": np.zeros(2), "chain": np.zeros(36), "bendings": np.full(12, 9.0)}, "none of the robot's"),
    ],
)
def test_wrong_numbers_are_refused(numbers, fault):
    with pytest.raises(ValueError, match=fault):
        kernel.of_robot(numbers)


@compiled
def test_robots_are_pickled_and_copied_with_it(robots):
    robot = robots["panda"]
    q, _ = stops(robot, 5)
    for other in (pickle.loads(pickle.dumps(robot)), copy.deepcopy(robot)):
        np.testing.assert_array_equal(other.poses(q), robot.poses(q))


def test_long_chains_and_terms_that_are_not_known_have_none():
    framed = framed_robot("irb1600", np.random.default_rng(1))
    terms = framed.frame_terms
    other = replace(terms, terms=(replace(terms.terms[0], also=(3,)), *terms.terms[1:]))
    assert framed.replace(frame_terms=other).kernel is None
    long = copy.copy(arm())  # another test may have the same one
    object.__setattr__(long, "joint_names", tuple(f"j{k}" for k in range(kernel.MOST_JOINTS + 1)))
    assert kernel_of(long) is None


@compiled
def test_a_kernel_of_other_sources_is_left_aside(tmp_path):
    shutil.copytree(ROOT / "irbcal", tmp_path / "irbcal", ignore=shutil.ignore_patterns("__pycache__"))
    header = tmp_path / "irbcal" / "kernel" / "kernel.hpp"
    header.write_text(header.read_text() + "\n")
    run = {"cwd": tmp_path, "env": os.environ | {"PYTHONPATH": str(tmp_path)}, "capture_output": True, "text": True}
    state = subprocess.run([sys.executable, "-c", "from irbcal import kernel; print(kernel.STATE)"], **run).stdout
    assert state.startswith("numpy: the compiled kernel is of another version")
