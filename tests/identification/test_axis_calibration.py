"""Direct calibration from the joint axes: simulated truth, statistics of many trials, and a real arm."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pinocchio
import pytest
from one_joint import one_joint_moves, own_circles, true_robot
from support import TARGETS, arm, assert_same_poses, measured, random_robot

from irbcal.errors import IrbcalError
from irbcal.identification import axes, axis_calibration
from irbcal.identification.axis_calibration import base_of_axes, calibrate_by_axes, tool_of_axes
from irbcal.io.robots import robot_file
from irbcal.measurement.points import PointSet
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.dhm import DHMTable
from irbcal.modeling.extraction import dhm_from_axes
from irbcal.modeling.robot import Robot

COLUMNS = ("alpha", "a", "theta", "d", "beta")


def largest_error(found, robot, seed=7):
    """Largest difference of predicted points at random joints, metres."""
    q = robot.arm.random_joints(100, seed)
    return max(np.abs(found.points(q, name) - robot.points(q, name)).max() for name in robot.targets)


@pytest.mark.parametrize("known", [None, TARGETS], ids=["unknown tool", "known tool"])
@pytest.mark.parametrize(("parallel", "tilt"), [("hayati", 0.005), ("hayati", 0.0), ("forced", 0.0)])
@pytest.mark.parametrize(("name", "home"), [("irb1600", 0.0), ("irb120", 0.8)])
def test_a_robot_without_noise_is_predicted_exactly(name, home, parallel, tilt, known):
    nominal = arm(name)
    robot = true_robot(nominal, 0, tilt)
    q, groups = one_joint_moves(home, 0)
    found = calibrate_by_axes(nominal, measured(robot, q, groups=groups), parallel, known_targets=known)
    assert largest_error(found.robot, robot) < 1e-12
    assert found.rms < 1e-13
    assert np.array_equal(found.robot.arm.T_last_tip, nominal.T_last_tip)
    assert np.array_equal(found.robot.arm.T_base_0, nominal.T_base_0)
    assert_same_poses(found.robot.T_world_base, robot.T_world_base, 1e-12, 1e-12)
    # behind the parallel axes the table has one form only; without the tool its last turn is not seen
    for kind in ("alpha", "a", "theta", "beta"):
        rows = slice(3, 5 if kind == "theta" else 6)
        assert np.abs(getattr(found.robot.table, kind) - getattr(robot.table, kind))[rows].max() < 1e-12


def test_known_dimensions_of_the_tool_give_the_last_row():
    nominal = arm("irb1600")
    robot = true_robot(nominal, 3)
    q, groups = one_joint_moves()
    points = measured(robot, q, groups=groups)
    one = {"smr2": TARGETS["smr2"]}
    found = calibrate_by_axes(nominal, points, known_targets=one)
    assert found.tool_known
    assert abs(found.robot.table.theta[5] - robot.table.theta[5]) < 1e-12
    assert abs(found.robot.table.d[5] - robot.table.d[5]) < 1e-12
    for name, place in TARGETS.items():
        assert np.abs(found.robot.targets[name] - place).max() < 1e-12
    unknown = calibrate_by_axes(nominal, points)
    assert not unknown.tool_known
    assert unknown.corrections.theta[5] == unknown.corrections.d[5] == 0.0
    assert np.isnan([unknown.std.theta[5], unknown.std.d[5]]).all()


def test_corrections_are_calibrated_minus_nominal():
    nominal = arm("irb1600")
    robot = true_robot(nominal, 5)
    q, groups = one_joint_moves()
    points = measured(robot, q, groups=groups)
    found = calibrate_by_axes(nominal, points, known_targets=TARGETS)
    for kind in COLUMNS:
        value = getattr(found.corrections, kind)
        difference = getattr(found.robot.table, kind) - getattr(nominal.table, kind)
        assert np.abs(value - difference).max() < 1e-15
        assert np.abs(value).max() < 0.01
        assert value[0] == 0.0
    # of the shifts along the parallel axes 2 and 3 only the sum is there to be seen; the tilt moves it little
    true_sum = (robot.table.d - nominal.table.d)[[1, 2]].sum()
    assert abs(found.corrections.d[[1, 2]].sum() - true_sum) < 5e-5
    assert found.corrections.d[1] == 0.0
    assert abs(found.corrections.beta[2] - robot.table.beta[2]) < 2e-5


def test_signs_follow_the_nominal_table_on_either_side_of_zero():
    nominal = arm("irb1600")
    assert nominal.table.a[4] == nominal.table.a[5] == 0.0
    q, groups = one_joint_moves()
    for a5, a6 in ((1e-4, 1e-4), (-1e-4, 1e-4), (1e-4, -1e-4), (-1e-4, -1e-4)):
        a = nominal.table.a + np.array([0, 0, 0, 0, a5, a6])
        robot = random_robot(nominal, "nominal", np.random.default_rng(1))
        robot = robot.replace(arm=nominal.with_table(replace(nominal.table, a=a)))
        found = calibrate_by_axes(nominal, measured(robot, q, groups=groups)).corrections
        assert np.abs(found.a - (a - nominal.table.a)).max() < 1e-12
        assert np.abs(np.concatenate([found.alpha, found.theta, found.beta])).max() < 1e-9
        assert np.abs(found.d).max() < 1e-12


def test_a_calibrated_arm_can_be_the_nominal_one():
    # its shift along axis 2 is not zero, as it is in tables taken from axes
    robot = true_robot(arm("irb1600"), 8)
    assert abs(robot.table.d[1]) > 1e-4
    q, groups = one_joint_moves(0.5)
    found = calibrate_by_axes(robot.arm, measured(robot, q, groups=groups), known_targets=TARGETS)
    for kind in COLUMNS:
        assert np.abs(getattr(found.corrections, kind)).max() < 1e-11
    assert largest_error(found.robot, robot) < 1e-12


def test_a_tip_beside_axis_6_and_a_turned_base_frame_stay():
    nominal = arm("irb1600")
    rng = np.random.default_rng(12)
    T_base_0, T_last_tip = (frames.from_xyz_angles(rng.uniform(-0.3, 0.3, 6)) for _ in range(2))
    first = dict(zip(("alpha", "a", "theta", "d"), rng.uniform(-0.3, 0.3, 4), strict=True))

    def with_first_row(dhm_table):
        columns = {kind: np.r_[value, getattr(dhm_table, kind)[1:]] for kind, value in first.items()}
        changed = replace(dhm_table, **columns)
        return Arm("moved", changed, T_base_0, T_last_tip, nominal.joint_names, nominal.lower, nominal.upper)

    robot = true_robot(nominal, 2)
    robot = robot.replace(arm=with_first_row(robot.table))
    q, groups = one_joint_moves(0.6)
    for known in (None, TARGETS):
        points = measured(robot, q, groups=groups)
        found = calibrate_by_axes(with_first_row(nominal.table), points, known_targets=known)
        assert largest_error(found.robot, robot) < 1e-12
        assert_same_poses(found.robot.T_world_base, robot.T_world_base, 1e-12, 1e-12)
        assert found.robot.table.d[0] == first["d"]


def test_three_parallel_axes_and_an_offset_wrist():
    # laid out like a collaborative arm: axes 2, 3 and 4 parallel, axes 4, 5 and 6 without a common point
    points = [
        [0, 0, 0],
        [0, 0.22, 0.13],
        [0.61, 0.05, 0.13],
        [1.18, 0.05, 0.13],
        [1.18, 0.16, 0.13],
        [1.18, 0.16, 0.01],
    ]
    directions = np.array([[0, 0, 1], [0, 1, 0], [0, 1, 0], [0, 1, 0], [0, 0, -1], [0, 1, 0]], dtype=float)
    T_base_tip = frames.from_xyz_angles([1.18, 0.25, 0.01, -np.pi / 2, 0, 0])
    made, T_base_0, T_last_tip = dhm_from_axes(np.array(points), directions, T_base_tip)
    nominal = Arm("three", made, T_base_0, T_last_tip, tuple("123456"), np.full(6, -3.0), np.full(6, 3.0))
    rng = np.random.default_rng(0)
    off = {kind: rng.uniform(-2e-3, 2e-3, 6) * (np.arange(6) > 0) for kind in COLUMNS}
    off["beta"] *= np.isin(np.arange(6), [2, 3])
    errors = {kind: getattr(made, kind) + off[kind] for kind in COLUMNS}
    T_world_base = frames.from_xyz_angles(rng.uniform(-2, 2, 6))
    robot = Robot(nominal.with_table(replace(made, **errors)), T_world_base=T_world_base, targets=TARGETS)
    q, groups = one_joint_moves(0.7)
    found = calibrate_by_axes(nominal, measured(robot, q, groups=groups), known_targets=TARGETS)
    assert largest_error(found.robot, robot) < 1e-12
    assert max(np.abs(getattr(found.corrections, kind)).max() for kind in COLUMNS) < 0.01


def test_other_groups_and_whole_turns_do_not_matter():
    nominal = arm("irb1600")
    robot = true_robot(nominal, 4)
    q, groups = one_joint_moves(0.5)
    alone = calibrate_by_axes(nominal, measured(robot, q, groups=groups))
    turned = q.copy()
    turned[::2] += 2 * np.pi * np.random.default_rng(2).integers(-1, 2, turned[::2].shape)
    more = np.vstack([turned, nominal.random_joints(20, 3)])
    points = measured(robot, more, groups=[*groups, *["all_range"] * 10, *[""] * 10])
    points = replace(points, xyz=points.xyz + 0.1 * (points.pose >= len(q))[:, None])  # of no use, and not used
    together = calibrate_by_axes(nominal, points)
    assert largest_error(together.robot, alone.robot) < 1e-12


def test_forcing_gives_parallel_axes_one_direction_and_hayati_keeps_the_tilt():
    nominal = arm("irb1600")
    robot = true_robot(nominal, 6, tilt=2e-3)
    q, groups = one_joint_moves()
    points = measured(robot, q, 2e-5, np.random.default_rng(0), groups)
    forced = calibrate_by_axes(nominal, points, "forced")
    assert forced.robot.table.alpha[2] == forced.robot.table.beta[2] == 0.0
    assert forced.std.alpha[2] == forced.std.beta[2] == 0.0
    assert forced.axes.fits[1].direction @ forced.axes.fits[2].direction < 1 - 1e-7
    kept = calibrate_by_axes(nominal, points, "hayati")
    assert abs(kept.robot.table.beta[2] - robot.table.beta[2]) < 5 * kept.std.beta[2]
    assert kept.rms < forced.rms
    narrow = calibrate_by_axes(nominal, points, "forced", tolerance=1e-4)
    assert narrow.robot.table.beta[2] == kept.robot.table.beta[2]


def with_deviations_of_the_first(trials, monkeypatch, count=8):
    """The results of trials (callables without arguments); standard deviations, which take long, of the first only."""
    found = [trial() for trial in trials[:count]]
    unknown = DHMTable(*np.full((5, 6), np.nan))
    monkeypatch.setattr(axis_calibration, "standard_deviations", lambda *_: unknown)
    return found + [trial() for trial in trials[count:]], found


def test_standard_deviations_of_the_table_are_those_of_many_trials(monkeypatch):
    nominal = arm("irb1600")
    robot = true_robot(nominal, 9)
    q, groups = one_joint_moves(0.6, degrees=(-40, -20, 0, 20, 40))
    rng = np.random.default_rng(3)
    clean = measured(robot, q, groups=groups)
    noisy = [replace(clean, xyz=clean.xyz + 3e-5 * rng.standard_normal(clean.xyz.shape)) for _ in range(60)]
    trials, first = with_deviations_of_the_first([partial(calibrate_by_axes, nominal, p) for p in noisy], monkeypatch)
    for kind in COLUMNS:
        scatter = np.std([getattr(t.corrections, kind) for t in trials], axis=0)[1:]
        claimed = np.sqrt(np.mean([getattr(t.std, kind) ** 2 for t in first], axis=0))[1:]
        there = np.isfinite(claimed) & (claimed > 0)
        assert there.sum() >= {"beta": 1, "alpha": 5, "a": 5, "theta": 4, "d": 3}[kind]
        ratio = scatter[there] / claimed[there]
        assert np.all((ratio > 0.7) & (ratio < 1.35)), (kind, ratio)
        assert np.isnan(getattr(trials[0].std, kind)[0])


def test_standard_deviations_of_the_last_row_with_a_known_tool(monkeypatch):
    nominal = arm("irb1600")
    robot = true_robot(nominal, 9)
    q, groups = one_joint_moves(degrees=(-40, -20, 0, 20, 40))
    rng = np.random.default_rng(5)
    clean = measured(robot, q, groups=groups)
    noisy = [replace(clean, xyz=clean.xyz + 3e-5 * rng.standard_normal(clean.xyz.shape)) for _ in range(20)]
    calibrate = partial(calibrate_by_axes, nominal, known_targets=TARGETS)
    trials, first = with_deviations_of_the_first([partial(calibrate, p) for p in noisy], monkeypatch)
    scatter = np.std([[t.corrections.theta[5], t.corrections.d[5]] for t in trials], axis=0)
    # scatter of the targets and errors of the axes come from the same points, but are added as if they did not
    ratio = scatter / np.mean([[t.std.theta[5], t.std.d[5]] for t in first], axis=0)
    assert np.all((ratio > 0.5) & (ratio < 1.3)), ratio


def refused(points, words, nominal=None, **kwargs):
    with pytest.raises(IrbcalError, match=words) as caught:
        calibrate_by_axes(nominal or arm("irb1600"), points, **kwargs)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("joint", range(6))
@pytest.mark.parametrize("name", ["irb1600", "irb120"])
def test_a_joint_that_turns_the_other_way_is_refused(name, joint):
    nominal = arm(name)
    robot = true_robot(nominal, 1)
    q, groups = one_joint_moves(0.4)
    points = measured(robot, q, groups=groups)
    flipped = q * np.where(np.arange(6) == joint, -1, 1)
    refused(replace(points, q=flipped), f"not those of {nominal.name}: .* sense of the joints", nominal)


def test_another_robot_is_refused():
    robot = true_robot(arm("irb120"), 1)
    q, groups = one_joint_moves()
    refused(
        measured(robot, q, groups=groups), "not those of irb1600_6_145: a3 differs by -430 mm; check the robot file"
    )


def test_axes_1_and_2_must_give_a_base():
    nominal = arm("irb1600")
    alpha = nominal.table.alpha.copy()
    alpha[1] = 0.02
    scara = nominal.with_table(replace(nominal.table, alpha=alpha))
    robot = Robot(scara, targets=TARGETS)
    q, groups = one_joint_moves()
    refused(measured(robot, q, groups=groups), "axes 1 and 2 are .* from parallel", scara)


@pytest.mark.parametrize(
    ("kwargs", "words"),
    [
        ({"parallel": "maybe"}, "parallel: expected hayati or forced, found 'maybe'"),
        ({"known_targets": {"smr9": [0, 0, 0]}}, "'smr9' was not measured: found smr1, smr2, smr3"),
        ({"known_targets": {"smr1": [0.1, 0.2]}}, "'smr1' needs three coordinates"),
        ({"known_targets": {"smr1": [0, 0, 0.1]}}, "theta6 needs one beside it"),
    ],
)
def test_wrong_requests_are_refused(kwargs, words):
    robot = true_robot(arm("irb1600"), 0)
    q, groups = one_joint_moves()
    refused(measured(robot, q, groups=groups), words, **kwargs)


def link_geometry(measured_axes):
    """Table of the links between the axes and its standard deviations, NaN where six axes do not say."""
    chain = axis_calibration.AxisChain(measured_axes, "hayati", axis_calibration.PARALLEL)
    table = chain.table(*measured_axes.as_measured())[1]
    std = axis_calibration.standard_deviations(measured_axes, lambda p, z: chain.table(p, z, table)[1])
    return SimpleNamespace(table=axis_calibration.unknown(table), std=axis_calibration.unknown(std))


def test_link_geometry_needs_no_nominal_arm():
    nominal = arm("irb1600")
    robot = true_robot(nominal, 10, tilt=0.0)
    q, groups = one_joint_moves(0.7)
    points = measured(robot, q, groups=groups)
    found = link_geometry(axes.measure_axes(points)).table
    assert np.isnan([found.a[0], found.alpha[0], found.d[0], found.theta[0], found.d[5], found.theta[5]]).all()
    assert np.abs(found.a[1:] - np.abs(robot.table.a[1:])).max() < 1e-12
    assert np.abs(np.cos(found.alpha[1:]) - np.cos(robot.table.alpha[1:])).max() < 1e-12
    assert np.abs(np.abs(found.d[3:5]) - np.abs(robot.table.d[3:5])).max() < 1e-12
    assert abs(abs(found.d[2]) - abs(robot.table.d[1] + robot.table.d[2])) < 1e-12


def test_link_lengths_of_a_real_arm(fanuc):
    found = link_geometry(axes.measure_axes(fanuc))
    a, d, a_std, d_std = (1e3 * v for v in (found.table.a, found.table.d, found.std.a, found.std.d))
    assert a[1] == pytest.approx(311.4, abs=0.2)
    assert a[2] == pytest.approx(1075.6, abs=0.1)
    assert abs(d[3]) == pytest.approx(1279.8, abs=0.5)
    assert a[3] == pytest.approx(226.1, abs=0.2)
    assert np.nanmax(a_std) < 0.15
    assert np.nanmax(d_std) < 0.15
    # a spherical wrist: axes 4, 5 and 6 meet
    assert max(a[4], a[5]) < 0.12
    assert abs(np.degrees(np.arccos(np.cos(found.table.alpha[1]))) - 90) < 0.02
    # leaving out any one reflector changes nothing that the standard deviations do not cover
    for target in range(3):
        other = link_geometry(axes.measure_axes(fanuc.take(fanuc.target != target)))
        for row, column in ((1, "a"), (2, "a"), (3, "a"), (3, "d")):
            change = getattr(other.table, column)[row] - getattr(found.table, column)[row]
            assert abs(change) < 2.5 * np.hypot(getattr(other.std, column)[row], getattr(found.std, column)[row])


def test_the_plain_mean_of_a_real_arms_circles_differs_by_its_own_uncertainty(fanuc):
    # a published-style calculation gives a = 311.4, 1075.6, 223.8 and d = 1279.8 mm: the mean of all circles' normals,
    # although one reflector is 1.6 mm from axes 4 and 6, where its circle says next to nothing about the direction
    measured_axes, fits = axes.measure_axes(fanuc), own_circles(fanuc)
    z = np.array([np.mean([fits[k, t].direction for t in range(3)], axis=0) for k in range(6)])
    z /= np.linalg.norm(z, axis=1)[:, None]
    p = np.array([np.mean([fits[k, t].point for t in range(3)], axis=0) for k in range(6)])
    plain = dhm_from_axes(*axes.at_zero_joints(p, z, measured_axes.homes), np.eye(4))[0]
    assert 1e3 * plain.a[1:4] == pytest.approx([311.4, 1075.6, 223.8], abs=0.05)
    assert 1e3 * abs(plain.d[3]) == pytest.approx(1279.8, abs=0.05)
    common = link_geometry(measured_axes).table
    uncertain = fits[3, 0].direction_std / 3 * abs(common.d[3])  # of a3, by that one normal at the end of the forearm
    assert fits[3, 0].radii[0] < 2e-3
    assert 1e-3 < abs(plain.a[3] - common.a[3]) < 2 * uncertain


def only(points, *groups):
    """Points of some groups."""
    return points.select(np.isin(points.groups.astype(str), groups)).without_empty_poses()


@pytest.mark.parametrize("name", ["irb1600", "irb120"])
def test_points_computed_by_pinocchio_give_base_and_tool(name):
    model = pinocchio.buildModelFromUrdf(str(robot_file(name)))
    data, tip = model.createData(), model.getFrameId("tool0")
    T = frames.from_xyz_angles([2.0, -1.0, 0.4, 0.3, -0.2, 2.5])
    q, groups = one_joint_moves(0.0)
    q[np.array(groups) == "axis2", 0] = 0.4
    q[np.isin(groups, ["axis5", "axis6"]), :4] = [0.3, -0.2, 0.1, 0.5]
    q[np.array(groups) == "axis6", 4] = 0.7
    q[np.array(groups) == "axis5", 5] = -0.6
    xyz = []
    for joints in q:
        pinocchio.framesForwardKinematics(model, data, joints)
        place = data.oMf[tip]
        xyz += [T[:3, :3] @ (place.rotation @ np.array(t) + place.translation) + T[:3, 3] for t in TARGETS.values()]
    n = len(q)
    points = PointSet(
        q,
        np.repeat(np.arange(n), 3),
        np.tile(np.arange(3), n),
        np.array(xyz),
        tuple(TARGETS),
        np.arange(n),
        np.array(groups, dtype=object),
    )
    base = base_of_axes(arm(name), only(points, "axis1", "axis2"))
    assert_same_poses(base.T_world_base, T, 1e-9, 1e-9)
    assert abs(base.angle) + abs(base.distance) < 1e-9
    tool = tool_of_axes(arm(name), only(points, "axis5", "axis6"))
    for target, place in TARGETS.items():
        assert np.abs(tool.targets[target] - place).max() < 1e-9


def test_of_a_robot_with_errors_the_base_is_that_of_its_first_axes_and_the_tool_that_of_its_last():
    nominal = arm("irb1600")
    robot = true_robot(nominal, 3)
    q, groups = one_joint_moves(0.0)
    points = measured(robot, q, groups=groups)
    base = base_of_axes(nominal, points)
    assert_same_poses(base.T_world_base, robot.T_world_base, 1e-12, 1e-12)
    assert base.angle == pytest.approx(robot.table.alpha[1] - nominal.table.alpha[1], abs=1e-12)
    assert base.distance == pytest.approx(robot.table.a[1] - nominal.table.a[1], abs=1e-12)
    # the last row's own errors turn and shift what is seen of the tool, as nobody can tell them apart
    tool, table = tool_of_axes(nominal, points), robot.table
    off = frames.transform(
        frames.rot_z(table.theta[5] - nominal.table.theta[5]), [0, 0, table.d[5] - nominal.table.d[5]]
    )
    to_tip = frames.inverse(nominal.T_last_tip) @ off @ nominal.T_last_tip
    for name, place in robot.targets.items():
        assert np.abs(tool.targets[name] - frames.apply(to_tip, place[None])[0]).max() < 1e-12


def test_standard_deviations_are_those_of_many_trials():
    nominal = arm("irb1600")
    robot = true_robot(nominal, 5)
    q, groups = one_joint_moves(0.0, degrees=(-60, -40, -20, 0, 20, 40, 60))
    rng = np.random.default_rng(1)
    bases, tools, claimed = [], [], []
    for _ in range(30):
        points = measured(robot, q, 3e-5, rng, groups)
        base, tool = base_of_axes(nominal, points), tool_of_axes(nominal, points)
        turn = base.T_world_base[:3, :3] @ robot.T_world_base[:3, :3].T
        bases.append([*base.T_world_base[:3, 3], turn[2, 1], turn[0, 2], turn[1, 0]])
        tools.append(tool.targets["smr1"])
        claimed.append([*base.std, *tool.std["smr1"]])
    ratio = np.hstack([bases, tools]).std(axis=0) / np.mean(claimed, axis=0)
    # the scatter of the tool's points and the axes come from the same points, but count as independent
    assert np.all((ratio > 0.6) & (ratio < 1.4)), ratio


def test_they_tell_what_they_found():
    nominal = arm("irb1600")
    q, groups = one_joint_moves(0.0)
    points = measured(true_robot(nominal, 3), q, groups=groups)
    assert "Base link in the measuring frame, from axes 1 and 2" in base_of_axes(nominal, points).summary()
    assert "smr3" in tool_of_axes(nominal, points).summary()


@pytest.mark.parametrize(
    ("change", "function", "words"),
    [
        (lambda p: only(p, "axis1"), base_of_axes, "joint 2 .*axis2; found axis1"),
        (lambda p: only(p, "axis6"), tool_of_axes, "joint 5 .*axis5; found axis6"),
    ],
)
def test_missing_groups(change, function, words):
    nominal = arm("irb1600")
    q, groups = one_joint_moves(0.0)
    with pytest.raises(IrbcalError, match=words):
        function(nominal, change(measured(true_robot(nominal, 3), q, groups=groups)))


def test_another_arm_and_other_places_are_refused():
    q, groups = one_joint_moves(0.0)
    points = measured(true_robot(arm("irb1600"), 3), q, groups=groups)
    with pytest.raises(IrbcalError, match=r"axes 1 and 2 are not those of irb120.*distance by 149 mm"):
        base_of_axes(arm("irb120"), points)
    q[np.array(groups) == "axis6", 2] = 0.3
    apart = measured(true_robot(arm("irb1600"), 3), q, groups=groups)
    with pytest.raises(IrbcalError, match=r"joint 3 stands 17.2 degrees apart: for the tool both axes"):
        tool_of_axes(arm("irb1600"), apart)
