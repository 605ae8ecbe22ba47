"""Base and tool from two axes each: points that Pinocchio computes, many trials, and refusals."""

import numpy as np
import pinocchio
import pytest
from one_joint import one_joint_moves, true_robot
from support import TARGETS, arm, assert_same_poses, measured

from irbcal.errors import IrbcalError
from irbcal.identification.axis_calibration import base_of_axes, tool_of_axes
from irbcal.io.robots import robot_file
from irbcal.measurement.points import PointSet
from irbcal.modeling import frames


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
    for _ in range(60):
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
        (lambda p: only(p, "axis1"), base_of_axes, "no moves of joint 2 in a group axis2; found axis1"),
        (lambda p: only(p, "axis6"), tool_of_axes, "no moves of joint 5 in a group axis5; found axis6"),
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
