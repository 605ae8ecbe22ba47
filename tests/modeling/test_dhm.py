"""Forward kinematics against the printed matrix of eq. 5.2 and known poses of the thesis."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support import arm, assert_derivative, assert_same_poses, random_robot

from irbcal.errors import RobotError
from irbcal.modeling import dhm, frames
from irbcal.modeling.robot import Robot


def printed_matrix(alpha, a, theta, d):
    """Nubiola 2011, eq. 5.2."""
    ca, sa, ct, st_ = np.cos(alpha), np.sin(alpha), np.cos(theta), np.sin(theta)
    return np.array(
        [
            [ct, -st_, 0, a],
            [st_ * ca, ct * ca, -sa, -d * sa],
            [st_ * sa, ct * sa, ca, d * ca],
            [0, 0, 0, 1],
        ]
    )


def product_of_printed_matrices(table, q):
    T = np.eye(4)
    for i in range(len(table.a)):
        T = T @ printed_matrix(table.alpha[i], table.a[i], table.theta[i] + q[i], table.d[i])
    return T


COLUMN = st.lists(st.floats(-2, 2), min_size=6, max_size=6)


@settings(max_examples=60)
@given(COLUMN, COLUMN, COLUMN, COLUMN, COLUMN)
def test_forward_is_the_product_of_the_printed_matrices(alpha, a, theta, d, q):
    table = dhm.DHMTable(alpha, a, theta, d)
    assert_same_poses(dhm.forward(table, [q])[0], product_of_printed_matrices(table, q), 1e-13, 1e-13)


@given(st.floats(-3, 3), st.floats(-1, 1), st.floats(-3, 3), st.floats(-1, 1))
def test_parameters_of_a_step_come_back(alpha, a, theta, d):
    T = printed_matrix(alpha, a, theta, d)
    row = dhm.from_transform(T)
    assert_same_poses(printed_matrix(*row), T, 1e-14, 1e-14)


def test_a_step_that_is_not_dhm_is_refused():
    with pytest.raises(ValueError, match="not one DHM step"):
        dhm.from_transform(frames.transform(frames.rot_y(0.1)))


def test_blocks_do_not_change_the_result(monkeypatch):
    robot = arm()
    q = robot.random_joints(1101, 0)
    whole = robot.forward(q)
    monkeypatch.setattr(dhm, "BLOCK", 100)
    assert np.array_equal(robot.forward(q), whole)
    assert robot.forward(np.zeros((0, 6))).shape == (0, 4, 4)


def test_one_pose_is_a_batch_of_one():
    robot = arm()
    (q,) = robot.random_joints(1, 0)
    expected = product_of_printed_matrices(robot.table, q)
    expected = robot.T_base_0 @ expected @ robot.T_last_tip
    for forward in (robot.forward, Robot(robot).forward, Robot(robot).poses):
        found = forward(q)
        assert found.shape == (1, 4, 4)
        assert_same_poses(found[0], expected, 1e-13, 1e-13)
    calibrated = random_robot(robot, "34", np.random.default_rng(0))
    assert np.array_equal(calibrated.forward(q, q), calibrated.forward(q[None], q[None]))
    for wrong in (q[:5], q[:, None], 0.3, q[None, None]):
        with pytest.raises(RobotError, match=r"joints need shape \(n, 6\), found"):
            robot.forward(wrong)


def test_step_of_a_row_is_the_chain_of_elementary_motions():
    table = dhm.DHMTable([0.3], [0.2], [0.4], [0.5], [0.1])
    expected = (
        frames.transform(frames.rot_x(0.3))
        @ frames.transform(None, [0.2, 0, 0])
        @ frames.transform(frames.rot_y(0.1))
        @ frames.transform(frames.rot_z(0.4 + 0.7))
        @ frames.transform(None, [0, 0, 0.5])
    )
    assert_same_poses(table.step(0, 0.7), expected, 1e-15, 1e-15)
    assert_same_poses(dhm.forward(table, [[0.7]])[0], expected, 1e-15, 1e-15)


TURN = st.sampled_from([0.0, np.pi / 2, -np.pi / 2, np.pi, 0.3])
ROW = st.tuples(
    TURN, st.sampled_from([0.0, 0.2]), TURN, st.sampled_from([0.0, 0.4]), TURN, st.booleans(), st.booleans()
)
FRAME = st.builds(lambda *v: frames.from_xyz_angles(v), *[st.sampled_from([0.0, 0.1])] * 3, TURN, TURN, TURN)


@settings(max_examples=60)
@given(st.lists(ROW, max_size=7), FRAME, st.none() | FRAME, st.sampled_from([3, 150, 1100]))
def test_quarter_turns_and_sliding_joints_end_where_their_steps_do(rows, T_base_0, T_last_tip, n):
    alpha, a, theta, d, beta, b, slides = zip(*rows, strict=True) if rows else [()] * 7
    table = dhm.DHMTable(alpha, a, theta, d, beta, 0.1 * np.array(b), slides)
    q = np.random.default_rng(n).uniform(-2.0, 2.0, (n, len(rows)))
    asked = np.tile(T_base_0, (3, 1, 1))
    for i in range(len(rows)):
        asked = asked @ np.array([table.step(i, value) for value in q[-3:, i]])
    asked = asked if T_last_tip is None else asked @ T_last_tip
    assert_same_poses(dhm.forward(table, q, T_base_0, T_last_tip)[-3:], asked, 1e-14, 1e-14)
    chain = dhm.chain_frames(table, q[-3:].T + table.offsets[:, None], T_base_0, T_last_tip)
    assert np.abs(chain.tip - asked[:, :3].transpose(2, 1, 0)).max() < 1e-14


def test_axes_of_the_chain_are_the_derivatives_of_the_tip():
    """What each number of the table moves: along or about the axes and points that `chain_frames` gives."""
    rng = np.random.default_rng(7)
    n = 5
    T_base_0 = frames.from_xyz_angles(rng.uniform(-1, 1, 6))
    T_last_tip = frames.from_xyz_angles(rng.uniform(-1, 1, 6))
    columns = rng.uniform(-1, 1, (6, n))
    slides = np.array([False, True, False, False, True])

    def tip(values):
        table = dhm.DHMTable(*values.reshape(6, n), prismatic=slides)
        return dhm.forward(table, np.zeros((1, n)), T_base_0, T_last_tip)[0, :3]

    table = dhm.DHMTable(*columns, prismatic=slides)
    chain = dhm.chain_frames(table, table.offsets[:, None], T_base_0, T_last_tip)
    axes, o = np.moveaxis(chain.tip[:, :, 0], 0, -1), chain.tip[3, :, 0]

    def turned(axis, point):
        return np.column_stack([np.cross(axis, axes[:, :3], axisb=0, axisc=0), np.cross(axis, o - point)])

    def shifted(axis):
        return np.column_stack([np.zeros((3, 3)), axis])

    derivative = np.empty((6, n, 3, 4))
    for i in range(n):
        x, o_x, z, o_z, y, o_y = (getattr(chain, name)[i, :, 0] for name in CHAIN)
        moved = (turned(x, o_x), shifted(x), turned(z, o_z), shifted(z), turned(y, o_y), shifted(y))
        for k in range(6):
            derivative[k, i] = moved[k]
    assert_derivative(tip, columns.ravel(), derivative.reshape(6 * n, 12).T, 1e-10)
    with pytest.raises(ValueError, match="read-only"):
        chain.z[0] = 0.0


CHAIN = ("x_before", "o_before", "z", "o", "y_tilt", "o_tilt")


def test_tables_are_locked_copies():
    column = np.zeros(6)
    table = dhm.DHMTable(column, column, column, column)
    column[0] = 1.0
    assert table.a[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        table.a[0] = 1.0
    with pytest.raises(ValueError, match=r"DHM column d has shape \(5,\)"):
        dhm.DHMTable(column, column, column, column[:5])


# --- facts of the thesis -------------------------------------------------------------------------------


def test_zero_pose_of_the_irb1600():
    T = arm().forward(np.zeros((1, 6)))[0]
    expected = frames.transform(np.array([[0, 0, 1.0], [0, 1, 0], [-1, 0, 0]]), [0.815, 0, 1.1865])
    assert_same_poses(T, expected, 1e-12, 1e-12)


def test_ballbar_centre_of_annex_vi():
    T = arm().forward(np.radians([[-3.984, 5.733483, 4.519, -0.017, 79.885, -273.988]]))[0]
    assert np.abs(T[:3, 3] - [0.808234, -0.056311, 1.011205]).max() < 1e-5


def test_five_poses_of_table_a_i_1():
    p2, p4 = [17.690, 18.084, -46.521, -33.814, 33.095, 29.298], [-41.374, -24.789, 47.145, -66.643, -46.052, 58.108]
    mirror = np.array([-1, 1, 1, -1, 1, -1])
    joints = np.radians([[0, -14, 14, 0, 0, 0], p2, mirror * p2, p4, mirror * p4])
    T = arm().forward(joints)
    assert np.abs(T[0, :3, 3] - [0.64565, 0, 1.1657]).max() < 2e-5
    offsets = (T[1:, :3, 3] - T[0, :3, 3]) / 0.27193
    assert np.abs(offsets - [[1, 1, 1], [1, -1, 1], [-1, -1, -1], [-1, 1, -1]]).max() < 2e-4
    assert np.abs(T[:, 0, 2] - 1).max() < 1e-4, "the tool axis points along +X in all five"
