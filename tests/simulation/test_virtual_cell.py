"""The virtual cell: where points stand, seeds, masses, the tracker and the tool, and the truth that it tells."""

from dataclasses import replace

import numpy as np
import pytest
from cell_support import OTHERS, robot_file

from irbcal.errors import RobotError
from irbcal.identification.fit import identify
from irbcal.io import robots, urdf
from irbcal.measurement.points import distances
from irbcal.modeling import frames
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.thesis_map import stiffness_and_phases
from irbcal.simulation import pose_list, weights
from irbcal.simulation.instruments import TABLE_3_1, Tracker, behind_arm, turned_away
from irbcal.simulation.shipped_cells import open_cell
from irbcal.units import DEG, MM


def test_stiffness_of_the_joint_map_is_what_compliance_and_masses_give():
    """A and B by hand for one mass on each arm: A = c g (m2 r2 + m3 L1), B = c g m3 r3 (eqs. 5.9 to 5.15)."""
    cell = open_cell("irb1600")
    arm = cell.arm
    # centres in DHM frames 2 and 3 (x along the upper arm; frame 3: x up at zero joints, y against the forearm)
    place = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0] * 3, [0.0] * 3, [0.0] * 3])
    mass = np.array([0.0, 18.0, 0.0, 10.0, 0.0, 0.0])  # the second mass in the wrist's centre, 600 mm before axis 3
    cell = cell.replace(
        bodies=weights.Bodies(mass, place), compliance=(0.0, 4e-6, 4e-6, 0.0, 0.0, 0.0), table=arm.table
    ).with_payload(0.0)
    by_hand = 4e-6 * 9.81 * np.array([18.0 * 0.3 + 10.0 * 0.7, 10.0 * 0.6])
    np.testing.assert_allclose(stiffness_and_phases(cell.true_joint_map())[0], by_hand, rtol=1e-9)


def test_points_stand_where_the_tracker_has_them(cell):
    """Without effects, link errors and joint map: nominal kinematics, the real targets, the tracker's frame."""
    bare = cell.only().replace(table=cell.arm.table, compliance=(0.0,) * 6, joint_map=JointMap.identity(cell.arm))
    run = bare.measure(np.zeros((1, 6)))
    x, y, z = np.array([-87.370, 87.202, 110.020]) * MM
    # tool0 at zero joints: origin (815, 0, 1186.5) mm, its z along x, its x along -z of the base
    at = frames.apply(cell.tracker.T_tracker_base, [0.815 + z, y, 1.1865 - x])
    np.testing.assert_allclose(run.xyz[0, 0], at, atol=1e-12)
    np.testing.assert_allclose(
        run.xyz[0, 3], frames.apply(cell.tracker.T_tracker_base, np.array([0.75, 1.0, 0.0])), atol=1e-12
    )
    moved = Tracker(cell.tracker.T_tracker_base).moved([1.0, 2.0, 3.0])
    np.testing.assert_allclose(moved.position, [1.0, 2.0, 3.0], atol=1e-12)


def test_same_seed_same_numbers_and_the_robot_does_not_depend_on_it(cell, q):
    first, second = cell.measure(q), cell.measure(q)
    np.testing.assert_array_equal(first.xyz, second.xyz)
    other = cell.replace(seed=1)
    assert (np.abs(other.measure(q).xyz - first.xyz) > 1e-6).any()
    np.testing.assert_array_equal(other.only().measure(q).xyz, cell.only().measure(q).xyz)
    assert (np.abs(cell.measure(q, run=1).xyz - first.xyz) > 1e-6).any()


def test_without_effects_level_34_is_exact_and_with_noise_it_is_at_the_noise(cell):
    joints = pose_list.random_poses(cell, 600, seed=8)
    for names in ((), ("noise",)):
        points = cell.only(*names).measure(joints).points()
        fitted = np.arange(600) < 300
        fit = identify(cell.arm, points.select(fitted), "34")
        off = distances(fit.robot, points.select(~fitted))
        if not names:
            assert off.max() < 1e-7
            continue
        # mean length of a vector with the stated sigmas, by a sum over the same distances
        r = np.linalg.norm(points.select(~fitted).xyz, axis=1)
        sigma = 1e-6 * np.column_stack([1.0 + 0.3 * r, 2.0 + 1.5 * r, 2.0 + 1.5 * r])
        drawn = np.random.default_rng(0).standard_normal((200, len(r), 3)) * sigma
        expected = np.linalg.norm(drawn, axis=2).mean()
        assert off.mean() == pytest.approx(expected, rel=0.06)  # 38 parameters from 2,700 numbers add 1 %


def test_parameters_of_the_truth_make_the_true_points_again(cell):
    """Base, targets, link errors and joint map from the truth's numbers alone, without effects."""
    bare = cell.only()
    values = bare.truth()["parameters"]
    q = cell.arm.random_joints(20, seed=6)
    table = cell.arm.table
    for column, unit in (("alpha", DEG), ("a", MM), ("theta", DEG), ("d", MM)):
        errors = [values.get(f"delta_{column}{j}", 0.0) * unit for j in range(1, 7)]
        table = replace(table, **{column: getattr(table, column) + errors})
    theta = q.copy()
    A, B = (values[f"stiffness_{name}"] * DEG for name in "AB")
    theta[:, 1] += A * np.sin(q[:, 1]) + B * np.cos(q[:, 1] + q[:, 2])
    theta[:, 2] += B * np.cos(q[:, 1] + q[:, 2])
    waves = [np.cos(q[:, 5]), np.sin(q[:, 5]), np.cos(2 * q[:, 5]), np.sin(2 * q[:, 5])]
    theta[:, 5] += sum(values[f"fourier_{n}"] * DEG * w for n, w in zip(("a1", "b1", "a2", "b2"), waves, strict=True))
    T = cell.arm.with_table(table).forward(theta)
    base = frames.from_xyz_angles(
        [values[f"base_{n}"] * (DEG if "r" in n else MM) for n in ("x", "y", "z", "rx", "ry", "rz")]
    )
    for k, name in enumerate(cell.tool.names):
        local = np.array([values[f"target_{name}_{axis}"] for axis in "xyz"]) * MM
        np.testing.assert_allclose(
            bare.measure(q).xyz[:, k], frames.apply(base, T[:, :3, :3] @ local + T[:, :3, 3]), rtol=0, atol=1e-8
        )


@pytest.mark.parametrize("name", ["irb1600", "irb120", "ur10", "panda", "rail"])
def test_gravity_torques_are_those_of_pinocchio(name, tmp_path):
    import pinocchio as pin

    path = robot_file(name, tmp_path)
    found = urdf.read(path, *OTHERS.get(name, (None, None)))
    kilograms, centre = 2.5, np.array([0.02, -0.03, 0.075])
    model = pin.buildModelFromUrdf(str(path))
    tip = model.frames[model.getFrameId(found.arm.tip_link)]
    load = pin.Inertia(kilograms, centre, np.zeros((3, 3)))
    model.appendBodyToJoint(tip.parentJoint, load, tip.placement)
    data = model.createData()
    joints = found.arm.random_joints(50, seed=1)
    columns = [model.joints[model.getJointId(joint)].idx_v for joint in found.arm.joint_names]
    expected = []
    for row in joints:
        full = pin.neutral(model)
        full[[model.joints[model.getJointId(joint)].idx_q for joint in found.arm.joint_names]] = row
        expected.append(pin.computeGeneralizedGravity(model, data, full)[columns])
    bodies = weights.bodies(found).with_payload(kilograms, centre, found.arm.T_last_tip)
    torque = weights.torques(found.arm, bodies, joints)
    turning = ~found.arm.table.prismatic
    np.testing.assert_allclose(
        torque[:, turning], np.array(expected)[:, turning], rtol=0, atol=1e-9 * np.abs(expected).max()
    )
    assert not torque[:, ~turning].any()


TWO_LINKS = """<robot name="two"><link name="base_link"/>
<link name="a"><inertial><origin xyz="0.2 0 0"/><mass value="3"/></inertial></link>
<link name="b"><inertial><origin xyz="0 0 0.1"/><mass value="1"/></inertial></link>
<link name="finger"><inertial><mass value="2"/></inertial></link><link name="tool0"/>
<joint name="j1" type="revolute"><parent link="base_link"/><child link="a"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="stuck" type="fixed"><parent link="a"/><child link="b"/><origin xyz="0.6 0 0"/></joint>
<joint name="j2" type="revolute"><parent link="b"/><child link="tool0"/><origin xyz="0.4 0 0"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>
<joint name="grip" type="prismatic"><parent link="tool0"/><child link="finger"/><origin xyz="0 0.5 0"/>
<axis xyz="0 1 0"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint></robot>"""


def test_links_on_fixed_joints_and_branches_count_with_the_link_they_sit_on():
    found = weights.bodies(urdf.from_bytes(TWO_LINKS.encode(), "two", "base_link", "tool0"))
    np.testing.assert_allclose(found.mass, [4.0, 2.0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.centre[0], [(3 * 0.2 + 0.6) / 4, 0.0, 0.1 / 4], rtol=0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(found.centre[1]), 0.5, rtol=0, atol=1e-12)


def test_a_payload_moves_the_centre_of_the_last_body():
    bodies = weights.Bodies([1.0, 2.0], [[0, 0, 0], [0.3, 0, 0]])
    T = np.eye(4)
    T[:3, 3] = [0.0, 0.0, 0.1]
    loaded = bodies.with_payload(4.0, [0.0, 0.6, 0.0], T)
    np.testing.assert_allclose(loaded.mass, [1.0, 6.0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(loaded.centre[1], [0.1, 0.4, 0.4 / 6], rtol=0, atol=1e-12)
    assert bodies.with_payload(0.0, [1, 1, 1], T) is bodies
    with pytest.raises(ValueError, match="read-only"):
        loaded.mass[0] = 7.0


def test_masses_that_are_no_numbers_are_refused():
    text = robots.robot_file("irb120").read_text().replace('<mass value="3.91"/>', '<mass value="heavy"/>')
    with pytest.raises(RobotError, match="link 'link_2', mass: expected 1 numbers, found 'heavy'"):
        weights.bodies(urdf.from_bytes(text.encode(), "irb120"))


def test_points_are_the_targets_that_were_seen(cell, q):
    run = cell.without("visibility").measure(q[:50])
    points = run.points(["g"] * 50)
    seen = np.isfinite(run.xyz[:, :3]).all(axis=2)
    assert len(points.xyz) == seen.sum() < 150
    np.testing.assert_array_equal(points.xyz, run.xyz[:, :3][seen])
    assert set(points.groups) == {"g"}
    assert points.target_names == ("smr1", "smr2", "smr3")


def test_a_run_is_printed_short(cell):
    run = cell.measure(np.zeros((3, 6)))
    assert repr(run).startswith("<Run: SIMULATED, 3 poses, ")
    assert len(repr(run)) < 300


def test_targets_are_those_of_table_3_1():
    """The table's last column is the distance of real and CAD places."""
    printed = [0.553, 0.465, 0.515, 0.568, 0.690, 0.609, 0.612, 0.661, 0.497]
    found = [np.linalg.norm(np.subtract(*pair)) for pair in TABLE_3_1.values()]
    np.testing.assert_allclose(found, printed, atol=0.002)


def test_reflector_returns_no_beam_beyond_its_acceptance():
    place = np.array([3.0, 0.0, 0.0])
    angles = np.radians([0.0, 29.9, 30.1, 180.0])
    look = np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    assert turned_away(np.tile([1.0, 0, 0], (4, 1)), look, place).tolist() == [False, False, True, True]


def test_a_link_between_target_and_tracker_hides_it():
    # an upright link of 1 m, another to (0.5, 0, 1), and the tool's link, which hides nothing
    origins = np.array([[[0, 0, 0], [0, 0, 1.0], [0.5, 0, 1.0], [0.5, 0, 0.5]]])
    points = np.array([[[-1, 0, 0.5], [-1, 0.3, 0.5], [-1, 0.0, 4.0], [0.3, -1.0, 1.0], [0.6, -1.0, 0.6]]])
    place = np.array([1.0, 0.0, 0.5])
    # beams: through the upright; past it at 0.148 m; over the elbow at 0.186 m; from in front of all; from below
    assert behind_arm(points, origins, place, 0.1).tolist() == [[True, False, False, False, False]]
    # the second beam passes at 0.3 * 1 / |(2, -0.3)| = 0.1483 m
    for radius, hidden in ((0.1482, False), (0.1485, True)):
        assert behind_arm(points[:, 1:2], origins, place, radius).tolist() == [[hidden]]
