"""Six joint axes from moves of one joint at a time: simulated truth, refusals, and a real arm."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from one_joint import one_joint_moves, own_circles, true_robot
from scipy.optimize import least_squares
from support import arm, measured, random_rotation

from irbcal.errors import IdentificationError
from irbcal.identification import axes


def test_axes_are_brought_to_zero_joints_by_the_product_of_turns():
    from scipy.spatial.transform import Rotation

    robot = true_robot(arm("irb1600"), 11)
    q, groups = one_joint_moves(0.9)
    found = axes.measure_axes(measured(robot, q, groups=groups))
    at_zero = axes.measure_axes(measured(robot, one_joint_moves(0.0)[0], groups=groups))
    points, directions = np.array(at_zero.points), np.array(at_zero.directions)  # scipy takes no locked arrays
    for k in range(6):
        turn, shift = Rotation.identity(), np.zeros(3)
        for j in range(k):  # the product of exponentials, from the base outwards
            step = Rotation.from_rotvec(found.homes[k, j] * directions[j])
            shift = shift + turn.apply(points[j] - step.apply(points[j]))
            turn = turn * step
        assert np.abs(turn.apply(directions[k]) - found.fits[k].direction).max() < 1e-12
        arms = turn.apply(points[k]) + shift - found.fits[k].point
        assert np.linalg.norm(np.cross(arms, found.fits[k].direction)) < 1e-12


def refused(points, words):
    with pytest.raises(IdentificationError, match=words) as caught:
        axes.measure_axes(points)
    assert "\n" not in str(caught.value)


def test_missing_groups_are_named():
    robot = true_robot(arm("irb1600"), 0)
    q, groups = one_joint_moves()
    needs = r"needs one-joint moves in the groups axis1 \.\.\. axis6; found "
    refused(measured(robot, q, groups=["iso_cube"] * 9 + ["all_range"] * 9), needs + "all_range, iso_cube$")
    refused(measured(robot, q), needs + "no groups$")
    five = measured(robot, q, groups=groups)
    refused(five.take(five.pose < 15), needs + "axis1, axis2, axis3, axis4, axis5$")


def test_moves_of_another_joint_are_refused():
    robot = true_robot(arm("irb1600"), 0)
    q, groups = one_joint_moves()
    q[7, 4] += 0.01
    refused(measured(robot, q, groups=groups), r"group axis3: joint 5 moves by 0\.573 degrees, but only joint 3")


def test_too_few_angles_are_refused_with_the_group():
    robot = true_robot(arm("irb1600"), 0)
    q, groups = one_joint_moves()
    points = measured(robot, q, groups=groups)
    refused(points.take(points.pose != 10), "group axis4: found 2 different joint angles")


def rms(values):
    return np.sqrt(np.mean(np.square(values)))


def test_circles_of_a_real_arm(fanuc):
    found = axes.measure_axes(fanuc)
    # the three reflectors' distances vary by up to 0.13 mm within a group: no common axis fits to the last micrometre
    assert max(fit.rms for fit in found.fits) < 40e-6
    assert max(rms(np.concatenate([fit.radial, fit.axial])) for fit in found.fits) < 27e-6
    assert max(fit.position_std for fit in found.fits) < 0.12e-3
    assert max(fit.direction_std for fit in found.fits) < 60e-6
    assert np.degrees([fit.arc for fit in found.fits]) == pytest.approx([60, 80, 75, 288, 130, 288])
    assert np.degrees(found.homes[:, 0])[1:].tolist() == pytest.approx([47] * 5)
    # radial residuals of each reflector's own circle: 3 to 23 micrometres by an independent calculation
    radial = [rms(fit.radial) for fit in own_circles(fanuc).values()]
    assert min(radial) > 2.5e-6
    assert max(radial) < 23.5e-6


RADII, HEIGHTS, PHASES = np.array([0.6, 0.75, 0.05]), np.array([-0.1, 0.2, 0.05]), np.array([0.3, 1.1, -2.0])
SPREAD_30 = np.radians(np.linspace(-30, 30, 7))


def drawn(angles, seed=0, noise=0.0, radii=RADII, heights=HEIGHTS, phases=PHASES):
    """Points of targets that turn about an axis anywhere: (xyz, target, angle, direction, a point of the axis)."""
    rng = np.random.default_rng(seed)
    R, origin = random_rotation(rng), rng.uniform(-3, 3, 3)
    turn = angles[:, None] + np.asarray(phases)
    local = np.stack([radii * np.cos(turn), radii * np.sin(turn), np.broadcast_to(heights, turn.shape)], axis=2)
    xyz = local.reshape(-1, 3) @ R.T + origin
    xyz = xyz + noise * rng.standard_normal(xyz.shape)
    target = np.tile(np.arange(len(radii)), len(angles))
    return xyz, target, np.repeat(angles, len(radii)), R[:, 2], origin


def from_axis(point, axis_point, direction):
    return np.linalg.norm(np.cross(point - axis_point, direction))


def test_circle_through_three_points_of_a_known_circle():
    normal, center, radius = axes.circle_through([[1, 3, 5], [4, 0, 5], [1, -3, 5]])
    assert np.abs(np.cross(normal, [0, 0, 1])).max() < 1e-15
    assert np.abs(center - [1, 0, 5]).max() < 1e-14
    assert abs(radius - 3) < 1e-14


def test_circle_through_three_points_solves_the_equations_of_the_thesis():
    p_1, p_2, p_3 = p = np.random.default_rng(4).uniform(-2, 2, (3, 3))
    normal, center, radius = axes.circle_through(p)
    across = np.cross(p_1 - p_2, p_3 - p_2)
    assert np.abs(normal - across / np.linalg.norm(across)).max() < 1e-15  # 3.1
    columns = np.column_stack([center, p_1, p_2, p_3])
    assert abs(np.linalg.det(np.vstack([columns, np.ones(4)]))) < 1e-12  # 3.2
    for p_k in (p_1, p_3):  # 3.3 and 3.4
        assert abs(2 * center @ (p_k - p_2) + p_2 @ p_2 - p_k @ p_k) < 1e-12
    assert np.abs(np.linalg.norm(p - center, axis=1) - radius).max() < 1e-13


@pytest.mark.parametrize("third", [[2, 2, 2], [0, 0, 0], [1, 1, 1]])
def test_three_points_on_a_line_are_refused(third):
    with pytest.raises(IdentificationError, match="one line"):
        axes.circle_through([[0, 0, 0], [1, 1, 1], third])


def test_best_triple_of_a_full_turn_spans_the_circle():
    angles = np.radians(np.arange(0, 361, 10))
    points = np.column_stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)])
    triple, area = axes.best_triple(points)
    assert abs(area - 1.0) < 1e-12  # the diameter and a point a quarter turn off
    assert abs(np.linalg.norm(triple[0] - triple[2]) - 2.0) < 1e-12


def test_best_triple_looks_at_a_selection_of_many_points():
    angles = np.linspace(0.0, 1.0, 20_000)
    triple, _ = axes.best_triple(np.column_stack([np.cos(angles), np.sin(angles), 0 * angles]))
    assert abs(np.linalg.norm(triple[0] - triple[2]) - 2 * np.sin(0.5)) < 1e-12


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 10_000), st.sampled_from([30, 60, 90, 180]), st.integers(3, 12))
def test_an_axis_without_noise_comes_back(seed, half_arc, count):
    angles = np.radians(np.linspace(-half_arc, half_arc, count + (half_arc == 180)))
    xyz, target, angle, direction, origin = drawn(angles, seed)
    found = axes.fit_axis(xyz, target, angle)
    assert np.linalg.norm(found.direction - direction) < 1e-12
    assert from_axis(found.point, origin, direction) < 1e-12
    assert np.abs(found.radii - RADII).max() < 1e-12
    assert np.abs(np.diff(found.heights) - np.diff(HEIGHTS)).max() < 1e-12
    assert found.rms < 1e-13
    assert abs((xyz.mean(axis=0) - found.point) @ found.direction) < 1e-12


def test_the_direction_is_that_of_the_joint():
    xyz, target, angle, direction, _ = drawn(SPREAD_30)
    assert axes.fit_axis(xyz, target, angle).direction @ direction > 0.99
    assert axes.fit_axis(xyz, target, -angle).direction @ direction < -0.99


def test_whole_turns_are_the_same_place():
    angles = np.radians([-360, -216, -72, 72, 216, 360])
    xyz, target, angle, direction, _ = drawn(angles)
    found = axes.fit_axis(xyz, target, angle)
    assert found.direction @ direction > 0.99
    assert abs(np.degrees(found.arc) - 288) < 1e-9


def test_the_fit_is_the_orthogonal_least_squares_of_scipy():
    xyz, target, angle, _, _ = drawn(SPREAD_30, 5, noise=2e-4)
    found = axes.fit_axis(xyz, target, angle)

    def distances(v):  # direction, point, radii, heights; the last two rows fix length and place along the axis
        u = v[:3] / np.linalg.norm(v[:3])
        height = (xyz - v[3:6]) @ u
        radius = np.linalg.norm(xyz - v[3:6] - height[:, None] * u, axis=1)
        fixed = [v[:3] @ v[:3] - 1, (v[3:6] - found.point) @ u]
        return np.concatenate([radius - v[6:9][target], height - v[9:12][target], fixed])

    rng = np.random.default_rng(0)
    start = np.concatenate([found.direction, found.point, found.radii, found.heights])
    other = least_squares(distances, start + 1e-3 * rng.standard_normal(12), xtol=1e-15, ftol=1e-15, gtol=1e-15)
    direction = other.x[:3] / np.linalg.norm(other.x[:3])
    assert abs(np.sqrt(2 * other.cost / len(xyz)) - found.rms) < 1e-12
    assert np.linalg.norm(np.cross(direction, found.direction)) < 1e-7
    assert np.abs(other.x[3:6] - found.point).max() < 1e-7
    assert np.abs(other.x[6:9] - found.radii).max() < 1e-7


def test_standard_deviations_are_those_of_many_trials():
    radii, noise = np.array([0.6, 0.75, 0.3]), 5e-5
    found, truth = [], None
    for seed in range(250):
        rng = np.random.default_rng(1000 + seed)
        xyz, target, angle, *_ = drawn(SPREAD_30, 3, radii=radii)
        truth = axes.fit_axis(xyz, target, angle)
        found.append(axes.fit_axis(xyz + noise * rng.standard_normal(xyz.shape), target, angle))
    tilt = np.array([(f.direction - truth.direction) @ truth.basis.T for f in found])
    shift = []
    for f in found:  # where the axis pierces the plane in which the true one's point lies
        back = (truth.point - f.point) @ truth.direction / (f.direction @ truth.direction)
        shift.append((f.point + back * f.direction - truth.point) @ truth.basis.T)
    scatter = np.cov(np.hstack([tilt, shift]).T)
    claimed = np.mean([f.covariance for f in found], axis=0)
    ratio = np.sqrt(np.diag(scatter) / np.diag(claimed))
    assert np.all((ratio > 0.85) & (ratio < 1.15))
    assert abs(np.mean([f.direction_std for f in found]) / np.sqrt(np.linalg.eigvalsh(scatter[:2, :2])[-1]) - 1) < 0.15
    assert abs(np.mean([f.position_std for f in found]) / np.sqrt(np.linalg.eigvalsh(scatter[2:, 2:])[-1]) - 1) < 0.15


def test_three_points_of_one_target_leave_no_standard_deviation():
    xyz, target, angle, direction, _ = drawn(np.radians([-30, 0, 30]), radii=[0.5], heights=[0.0], phases=[0.0])
    found = axes.fit_axis(xyz, target, angle)
    assert found.direction @ direction > 1 - 1e-12
    assert np.isnan([found.direction_std, found.position_std]).all()


def test_one_target_in_the_middle_of_a_turn_carries_little_but_does_no_harm():
    xyz, target, angle, direction, origin = drawn(SPREAD_30, 1, noise=2e-5, radii=np.array([0.6, 0.75, 1.6e-3]))
    found = axes.fit_axis(xyz, target, angle)
    assert from_axis(found.point, origin, direction) < 1e-4
    assert found.targets.tolist() == [0, 1, 2]


def test_a_target_on_the_axis_is_left_out():
    xyz, target, angle, direction, _ = drawn(SPREAD_30, 2, noise=1e-5, radii=np.array([0.6, 0.0, 0.3]))
    found = axes.fit_axis(xyz, target + 4, angle)
    assert found.targets.tolist() == [4, 6]
    assert np.array_equal(found.used, target != 1)
    assert len(found.radial) == len(found.axial) == found.used.sum()
    assert found.direction @ direction > 1 - 1e-8


def test_points_that_are_missing_do_not_matter():
    xyz, target, angle, direction, origin = drawn(SPREAD_30, 6)
    keep = np.ones(len(xyz), dtype=bool)
    keep[[0, 4, 7, 11, 20]] = False
    found = axes.fit_axis(xyz[keep], target[keep], angle[keep])
    assert from_axis(found.point, origin, direction) < 1e-12


@pytest.mark.parametrize(
    ("angles", "radii", "words"),
    [
        ([-30, 30], RADII, "group axis3: found 2 different joint angles, at least 3"),
        ([10], RADII, "group axis3: found 1 different joint angle, at least 3"),
        ([-360, 0, 360, 90], RADII, "group axis3: found 2 different joint angles"),
        ([-4, 0, 4, 8], RADII, r"group axis3: an arc of 12\.0 degrees .*at least 20 degrees"),
        ([-40, 0, 40], np.zeros(3), "group axis3: no target moves .* lie on the axis"),
    ],
)
def test_what_does_not_give_an_axis_is_refused(angles, radii, words):
    xyz, target, angle, *_ = drawn(np.radians(angles), radii=radii)
    with pytest.raises(IdentificationError, match=words):
        axes.fit_axis(xyz, target, angle, "axis3")


def test_an_axis_that_noise_leaves_open_is_refused():
    xyz, target, angle, *_ = drawn(np.radians(np.linspace(0, 25, 6)), 3, 3e-4, [0.6], [0.0], [0.0])
    with pytest.raises(IdentificationError, match=r"axis2: on an arc of 25\.0 degrees .* mm only: about \d+ degrees"):
        axes.fit_axis(xyz, target, angle, "axis2")


def test_points_that_are_no_circles_are_refused():
    _, target, angle, *_ = drawn(np.radians(np.arange(0, 360, 40)))
    xyz = np.random.default_rng(1).uniform(-1, 1, (len(target), 3))
    with pytest.raises(IdentificationError, match="group axis4: "):
        axes.fit_axis(xyz, target, angle, "axis4")


def test_points_that_turn_otherwise_than_the_joint_are_refused():
    xyz, target, angle, *_ = drawn(SPREAD_30)
    with pytest.raises(IdentificationError, match="turn otherwise than the joint"):
        axes.fit_axis(xyz, target, 3 * angle, "axis1")
