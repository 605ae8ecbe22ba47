"""Chains from one branch of a tree to another: a camera on a neck and an arm, two arms, a positioner and an arm."""

import dataclasses

import numpy as np
import pytest
from support import example_robot
from viewer_urdf import link_poses

import irbcal
from irbcal.errors import CalibrationError, RobotError
from irbcal.io import urdf, urdf_check
from irbcal.modeling import frames
from irbcal.modeling.terms import bending, gravity, payload
from irbcal.planners.calibrated_model import CalibratedModel
from irbcal.planning.collisions import BEAM_GAP, BEAM_RADIUS, CollisionModel
from irbcal.viewer import shapes

TREES = [  # file, base, tip, joints on the way up
    ("tiago_description/robots/tiago.urdf", "xtion_rgb_optical_frame", "arm_tool_link", 2),
    ("talos_data/robots/talos_reduced.urdf", "rgbd_optical_frame", "gripper_right_base_link", 2),
    ("baxter_description/urdf/baxter.urdf", "left_gripper", "right_gripper", 7),
    ("pr2_description/urdf/pr2.urdf", "l_gripper_tool_frame", "torso_lift_link", 7),
]


def joint(name, kind, parent, child, xyz="0 0 0.2", rpy="0 0 0", axis="0 0 1"):
    return (
        f'<joint name="{name}" type="{kind}"><origin xyz="{xyz}" rpy="{rpy}"/><parent link="{parent}"/>'
        f'<child link="{child}"/><axis xyz="{axis}"/><limit lower="-1.5" upper="1.5" effort="1" velocity="1"/></joint>'
    )


def cell():
    """A rail with a two-axis positioner on its carriage, beside an arm of four joints; balls at its elbow and tip."""
    ball = '<collision><geometry><sphere radius="0.05"/></geometry></collision>'
    links = [f'<link name="{name}"/>' for name in ("floor", "rail", "tilt", "table", "a1", "a2", "a4")]
    joints = [
        joint("travel", "prismatic", "floor", "rail", "1 0.1 0.3", "0.1 0.2 0.3", "0 1 0"),
        joint("tilting", "revolute", "rail", "tilt", "0.1 0 0.3", "0.2 0 0.1", "1 0 0"),
        joint("turning", "revolute", "tilt", "table", "0 0.1 0.1", "0 0.3 0", "0 0 -1"),
        joint("j1", "revolute", "floor", "a1", "0 0 0.4"),
        joint("j2", "revolute", "a1", "a2", "0.1 0 0.1", "0 0 0", "0 1 0"),
        joint("j3", "revolute", "a2", "a3", "0 0 0.6", "0 0 0", "0 1 0"),
        joint("j4", "revolute", "a3", "a4", "0.5 0 0", "0 0 0", "1 0 0"),
        joint("mount", "fixed", "a4", "tip", "0.2 0 0"),
    ]
    return f'<robot name="cell">{"".join(links)}<link name="a3">{ball}</link><link name="tip">{ball}</link>{"".join(joints)}</robot>'.encode()


def corrected(arm, seed=0):
    """All six numbers of each joint changed; of the first only those about and along its axis."""
    rng = np.random.default_rng(seed)
    columns = {name: getattr(arm.table, name).copy() for name in ("alpha", "a", "theta", "d", "beta", "b")}
    for name, values in columns.items():
        first = 0 if name in ("theta", "d") else 1
        values[first:] += 1e-3 * rng.normal(size=len(values) - first)
    return arm.with_table(dataclasses.replace(arm.table, **columns))


@pytest.mark.parametrize(("name", "base", "tip", "up"), [*TREES, (None, "table", "tip", 3)])
def test_chains_over_a_tree_and_their_corrected_urdfs_are_pinocchios(name, base, tip, up):
    data = cell() if name is None else example_robot(name).read_bytes()
    read = urdf.from_bytes(data, "robot.urdf", base, tip)
    arm, q = read.arm, read.arm.random_joints(40, 1)
    assert arm.joints_up == up
    assert np.abs(urdf_check.poses(data, arm, q) - arm.forward(q)).max() < 1e-12
    better = corrected(arm)
    assert np.abs(better.forward(q) - arm.forward(q)).max() > 1e-3
    written = urdf.to_bytes(read, better)
    assert np.abs(urdf_check.poses(written, arm, q) - better.forward(q)).max() < 1e-12
    again = urdf.from_bytes(written, "written.urdf", base, tip).arm
    assert np.abs(again.forward(q) - better.forward(q)).max() < 1e-12
    links = shapes.links(read)
    tips = [link_poses(links, row)[[link.name for link in links].index(tip)] for row in q]
    assert np.abs(np.array(tips) - arm.forward(q)).max() < 1e-12


def test_what_a_urdf_cannot_hold_is_refused():
    read = urdf.from_bytes(cell(), "cell.urdf", "table", "tip")
    table = read.arm.table
    tilted = read.arm.with_table(dataclasses.replace(table, alpha=table.alpha + np.eye(7)[0] * 1e-3))
    with pytest.raises(RobotError, match="another place of joint turning in table: hold the parameters of joint 1"):
        urdf.to_bytes(read, tilted)


def test_the_measuring_frame_is_fixed_to_a_base_link_that_moves():
    read = urdf.from_bytes(cell(), "cell.urdf", "table", "tip")
    T_world_base = frames.transform(frames.matrix_from_rpy(np.array([0.3, -0.2, 1.0])), np.array([1.0, 2.0, 3.0]))
    data, q = urdf.with_links(cell(), read.arm, T_world_base), read.arm.random_joints(10, 2)
    in_world = dataclasses.replace(read.arm, base_link="world")
    assert np.abs(urdf_check.poses(data, in_world, q) - T_world_base @ read.arm.forward(q)).max() < 1e-12


def test_obstacles_and_beams_go_with_a_base_link_that_moves():
    arm = urdf.from_bytes(cell(), "cell.urdf", "table", "tip").arm
    q = arm.random_joints(400, 3)
    tips = urdf_check.poses(cell(), arm, q)[:, :3, 3]
    to_elbow = dataclasses.replace(arm, tip_link="a3")
    elbows = urdf_check.poses(cell(), to_elbow, q)[:, :3, 3]
    model = CollisionModel(cell(), arm)
    ball = np.median(tips, axis=0)
    model.add_obstacle(ball, 0.8)
    near = (np.linalg.norm([tips - ball, elbows - ball], axis=2) < 0.8 + 0.05).any(axis=0)
    assert 40 < near.sum() < 360
    assert model.touching(q).tolist() == near.tolist()
    points, tracker = elbows + np.random.default_rng(0).normal(size=(400, 3)) * 0.06, np.array([0.1, 0.2, 3.0])
    away = np.linalg.norm(tracker - points, axis=1)
    along = (tracker - points) / away[:, None]
    step = np.clip(((elbows - points) * along).sum(axis=1), BEAM_GAP, BEAM_GAP + away.max())
    blocked = np.linalg.norm(points + along * step[:, None] - elbows, axis=1) < 0.05 + BEAM_RADIUS
    assert 40 < blocked.sum() < 360
    assert model.blocked(q, points[:, None], tracker)[:, 0].tolist() == blocked.tolist()


def test_without_a_fixed_direction_gravity_has_no_terms():
    arm = urdf.from_bytes(cell(), "cell.urdf", "table", "tip").arm
    standing = urdf.from_bytes(cell(), "cell.urdf", "floor", "tip").arm
    for family in (gravity.FAMILY, bending.FAMILY, payload.FAMILY):
        assert family.terms(arm) == []
        assert family.terms(standing)
    with pytest.raises(CalibrationError, match="planners need a base that stands: table moves with turning"):
        CalibratedModel(cell(), arm)


def test_a_head_camera_and_an_arm_are_calibrated_and_exported(tmp_path):
    """From pictures of a board; SIMULATED, whose tracker in the camera's frame is the witness."""
    name, base, tip, _ = TREES[0]
    robot, links = example_robot(name), {"base_link": base, "tip_link": tip}
    seen = irbcal.simulate_device(robot, "camera", 40, seed=1, only=["noise"], **links)
    rows, features, _ = seen.save(tmp_path / "rows.csv")
    done = irbcal.calibrate(rows, robot, features=features, model="placement", **links)
    assert any("gravity has no fixed direction" in note for note in done.record.notes)
    irbcal.simulate(robot, random=24, seed=2, only=["noise"], **links).save(tmp_path / "tracked.csv")
    errors = irbcal.evaluate(done, tmp_path / "tracked.csv", refit_base=True, refit_tool=True).to_frame()
    assert errors["nominal_mm"].mean() > 0.5
    assert errors["calibrated_mm"].mean() < 0.2 * errors["nominal_mm"].mean()
