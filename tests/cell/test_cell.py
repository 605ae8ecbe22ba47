"""The virtual cell: each part against a hand calculation, a closed form or Pinocchio, and the whole against the thesis."""

import sys
from dataclasses import replace
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path

import numpy as np
import pytest
from support import example_robot

from irbcal.cell import cell as cells
from irbcal.cell import effects, procedure, simulation
from irbcal.cell.gravity import torques_and_origins
from irbcal.cell.tool import TABLE_3_1, Tracker, behind_arm, turned_away
from irbcal.errors import MeasurementError
from irbcal.files import robots, urdf
from irbcal.identification.fit import identify
from irbcal.measurement.points import distances
from irbcal.modeling import frames
from irbcal.units import DEG, MM

THREE = ("smr1", "smr2", "smr3")
ON_A_RAIL = """<joint name="rail" type="prismatic">
    <parent link="rail_base"/><child link="base_link"/>
    <origin xyz="0 0.1 0.05" rpy="0 0.2 0.3"/><axis xyz="0 1 0"/>
    <limit lower="-0.2" upper="2.5" effort="1" velocity="1"/>
  </joint>
  <link name="rail_base"/>
</robot>"""


@pytest.fixture(scope="module")
def cell():
    """The shipped cell with three targets."""
    return simulation.open_cell("irb1600").with_targets(THREE)


@pytest.fixture(scope="module")
def q(cell):
    """300 random poses in the tracker's sight."""
    return procedure.random_poses(cell, 300, seed=4)


def robot_file(name, folder):
    """A shipped robot, one of example-robot-data, or an IRB 120 on a tilted rail."""
    files = {"panda": "panda_description/urdf/panda.urdf", "ur10": "ur_description/urdf/ur10_robot.urdf"}
    if name in files:
        return example_robot(files[name])
    if name != "rail":
        return robots.robot_file(name)
    path = folder / "rail.urdf"
    path.write_text(robots.robot_file("irb120").read_text().replace("</robot>", ON_A_RAIL))
    return path


OTHERS = {"panda": (None, "panda_link8"), "ur10": (None, None), "rail": ("rail_base", "tool0")}


# gravity


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
    bodies = simulation.bodies(found).with_payload(kilograms, centre, found.arm.T_last_tip)
    torque, origins = torques_and_origins(found.arm, bodies, joints)
    np.testing.assert_allclose(torque, expected, rtol=0, atol=1e-9 * np.abs(expected).max())
    if name != "rail":
        np.testing.assert_allclose(origins[:, 0], 0.0)


def test_three_kilograms_bend_the_stretched_arm_as_table_4_3_says(cell):
    """Nubiola 2011, Table 4.3: 0.29 mm from 3 kg, 2.13 mm in all with 1.8 kg."""
    joints = np.radians([[0.0, 90.0, -90.0, 0.0, 0.0, 0.0]])
    bare = cell.only("compliance").replace(table=cell.arm.table)
    at_rest = cell.arm.forward(joints)[0, :3, 3]
    sag = [
        np.linalg.norm(bare.with_payload(load).measure(joints).T_base_tip[0, :3, 3] - at_rest) for load in (1.8, 4.8)
    ]
    assert sag[0] == pytest.approx(2.134 * MM, rel=0.15)
    assert sag[1] - sag[0] == pytest.approx(0.292 * MM, rel=0.15)


def test_stiffness_of_the_joint_map_is_what_compliance_and_masses_give():
    """A and B by hand for one mass on each arm: A = c g (m2 r2 + m3 L1), B = c g m3 r3 (eqs. 5.9 to 5.15)."""
    cell = simulation.open_cell("irb1600")
    arm = cell.arm
    # centres in DHM frames 2 and 3 (x along the upper arm; frame 3: x up at zero joints, y against the forearm)
    place = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0] * 3, [0.0] * 3, [0.0] * 3])
    mass = np.array([0.0, 18.0, 0.0, 10.0, 0.0, 0.0])  # the second mass in the wrist's centre, 600 mm before axis 3
    cell = cell.replace(
        bodies=cells.Bodies(mass, place), compliance=(0.0, 4e-6, 4e-6, 0.0, 0.0, 0.0), table=arm.table
    ).with_payload(0.0)
    by_hand = 4e-6 * 9.81 * np.array([18.0 * 0.3 + 10.0 * 0.7, 10.0 * 0.6])
    np.testing.assert_allclose(cell.true_joint_map().stiffness, by_hand, rtol=1e-9)


# effects


def change_of_joints(cell, effect, joints, **options):
    """What an effect adds to the effective joints, degrees, read from the arm's own parameters."""
    motion = motion_of(cell, joints, **options)
    return effect.joints(motion, np.random.default_rng(0)) / DEG


def motion_of(cell, joints, wait_s=4.0, time_s=0.0):
    joints = np.radians(np.atleast_2d(joints))
    n = len(joints)
    still = np.zeros_like(joints)
    return effects.Motion(
        joints,
        cells.directions(joints, np.zeros(6)),
        np.broadcast_to(time_s, n),
        np.broadcast_to(wait_s, n),
        still,
        still,
        np.zeros(6, dtype=bool),
    )


def test_backlash_depends_on_where_each_joint_came_from(cell):
    # joint 1 rises, falls, stays, rises; joint 2 falls and stays; joint 3 never moves (counts as reached from below)
    joints = [[10, -5, 0, 0, 0, 0], [5, -5, 0, 0, 0, 0], [5, -5, 0, 0, 0, 0], [6, -5, 0, 0, 0, 0]]
    gap = effects.Backlash(peak_to_peak_deg=(0.04, 0.02, 0.06, 0.0, 0.0, 0.0))
    found = change_of_joints(cell, gap, joints)
    np.testing.assert_allclose(found[:, 0], [-0.02, 0.02, 0.02, -0.02], atol=1e-15)
    np.testing.assert_allclose(found[:, 1], [0.01] * 4, atol=1e-15)
    np.testing.assert_allclose(found[:, 2], [-0.03] * 4, atol=1e-15)


def test_backlash_of_a_pose_reached_from_both_sides(cell):
    bare = cell.only("backlash").replace(table=cell.arm.table)
    there = np.radians([[0, 0, 0, 0, 0, 30.0], [0, 0, 0, 0, 0, 60.0], [0, 0, 0, 0, 0, 30.0]])
    run = bare.measure(there)
    turn = frames.rotation_distance(run.T_base_tip[0, :3, :3], run.T_base_tip[2, :3, :3])
    assert turn == pytest.approx(0.05 * DEG, rel=1e-9)  # section 4.2


def test_settling_and_warm_up_follow_their_formulas(cell):
    swing = effects.Settling(amplitude_deg=0.012, tau_s=0.4, frequency_Hz=8.0)
    found = change_of_joints(cell, swing, [[10.0, -10.0, 0, 0, 0, 0]], wait_s=0.5)
    expected = 0.012 * np.exp(-0.5 / 0.4) * np.cos(2 * np.pi * 8.0 * 0.5)
    np.testing.assert_allclose(found[0], [expected, -expected, expected, 0, 0, 0], atol=1e-15)
    assert np.abs(change_of_joints(cell, swing, [[10.0] * 6], wait_s=2.0)).max() < 0.012 / 100  # annex V
    warm = effects.WarmUp(before_min=0.0, tau_min=40.0, growth=1e-4, joint_deg=(0.004, -0.006))
    motion = motion_of(cell, np.zeros((2, 6)), time_s=np.array([0.0, 40 * 60.0]))
    np.testing.assert_allclose(
        warm.joints(motion, None)[:, 1:3] / DEG, [[0.004, -0.006], [0.004 / np.e, -0.006 / np.e]], rtol=1e-12
    )
    T = cell.arm.forward(motion.q)
    shrunk = warm.tips(T, motion)
    np.testing.assert_allclose(shrunk[:, :3, 3], T[:, :3, 3] * (1 - 1e-4 * np.array([[1.0], [1 / np.e]])), rtol=1e-12)


def test_growth_of_all_lengths_is_a_growth_of_the_tip_position(cell, q):
    table = cell.arm.table
    longer = replace(table, a=table.a * 1.001, d=table.d * 1.001)
    T = cell.arm.with_table(longer).forward(q)
    np.testing.assert_allclose(T[:, :3, 3], 1.001 * cell.arm.forward(q)[:, :3, 3], atol=1e-12)


def test_tracker_noise_has_the_stated_sigmas_along_and_across_the_beam():
    noise = effects.Noise(range_um=2.0, range_um_per_m=0.5, across_um=3.0, across_um_per_m=2.0)
    beam = np.array([0.6, -0.64, 0.48])
    u = np.cross(beam, [0, 0, 1.0]) / np.linalg.norm(np.cross(beam, [0, 0, 1.0]))
    off = noise.points(np.tile(4.0 * beam, (40_000, 1, 1)), None, np.random.default_rng(1))[:, 0] - 4.0 * beam
    # 2 + 0.5 * 4 = 4 um along, 3 + 2 * 4 = 11 um across; 40,000 samples know a sigma to 0.35 %
    assert (off @ beam).std() == pytest.approx(4e-6, rel=0.02)
    for across in (u, np.cross(beam, u)):
        assert (off @ across).std() == pytest.approx(11e-6, rel=0.02)
    assert np.abs(off.mean(axis=0)).max() < 0.3e-6


def test_drift_moves_all_points_of_a_moment_as_one_body_and_references_take_it_out(cell):
    run = cell.only("drift").measure(np.zeros((400, 6)), wait_s=300.0)
    still = cell.only().measure(np.zeros((400, 6)), wait_s=300.0)
    moved = run.xyz - still.xyz
    assert 2e-6 < np.linalg.norm(moved, axis=2).mean() < 40e-6  # annex IV: 0.012 mm on average
    T = frames.rigid_fit(run.xyz, still.xyz)
    left = np.einsum("nij,nkj->nki", T[:, :3, :3], run.xyz) + T[:, None, :3, 3] - still.xyz
    # points of a pose are measured within 20 s: nearly at one moment
    assert np.abs(left).max() < 0.1e-6


def test_harmonics_are_sines_of_the_joint(cell):
    waves = effects.Harmonics(waves=((2, 3, 0.01, 30.0), (-1, 2, 0.02, 0.0)))
    found = change_of_joints(cell, waves, [[0, 20.0, 0, 0, 0, 45.0]])
    np.testing.assert_allclose(found[0], [0, 0.01, 0, 0, 0, 0.02], atol=1e-15)  # sin(3 * 20 + 30), sin(2 * 45)


def test_repeatability_has_the_stated_sigmas(cell):
    part = effects.Repeatability(sigma_deg=(0.001, 0.002, 0.003, 0.004, 0.005, 0.006))
    found = change_of_joints(cell, part, np.zeros((20_000, 6)))
    np.testing.assert_allclose(found.std(axis=0), part.sigma_deg, rtol=0.03)


# what the tracker sees


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


def test_random_poses_are_seen_and_hidden_ones_are_lost_points(cell, q):
    seeing = cell.only("visibility")
    assert seeing.measure(q).unseen["visibility"] < 5  # the true robot stands a millimetre beside the nominal one
    anywhere = cell.arm.random_joints(500, seed=2)
    run = seeing.measure(anywhere)
    lost = np.isnan(run.xyz).any(axis=2)
    assert run.unseen["visibility"] == lost[:, :3].sum() > 1000
    assert not lost[:, 3:].any()
    # by the definition, from the truth: angle between where the reflector looks and the tracker
    T = run.T_base_tip
    p = np.einsum("nij,kj->nki", T[:, :3, :3], cell.tool.real) + T[:, None, :3, 3]
    look = np.einsum("nij,kj->nki", T[:, :3, :3], cell.tool.direction)
    beam = cell.tracker.place - p
    angle = np.degrees(np.arccos(np.sum(beam * look, axis=2) / np.linalg.norm(beam, axis=2)))
    assert (lost[:, :3] >= (angle > 30.0)).all()
    assert (lost[:, :3] & (angle < 30.0)).sum() < 0.4 * (angle < 30.0).sum()


def test_lost_points_are_as_many_as_stated(cell, q):
    run = cell.only("lost").with_effect(effects.Lost(share=0.05)).measure(np.tile(q, (20, 1)))
    assert run.unseen["lost"] == np.isnan(run.xyz[..., 0]).sum() == pytest.approx(0.05 * 6000 * 7, rel=0.1)


def test_points_stand_where_the_tracker_has_them(cell):
    """Without effects, link errors and joint map: nominal kinematics, the real targets, the tracker's frame."""
    bare = cell.only().replace(table=cell.arm.table, compliance=(0.0,) * 6, joint_map=type(cell.joint_map)(np.zeros(6)))
    run = bare.measure(np.zeros((1, 6)))
    x, y, z = np.array([-87.370, 87.202, 110.020]) * MM
    # tool0 at zero joints: origin (815, 0, 1186.5) mm, its z along x, its x along -z of the base
    at = frames.apply(cell.tracker.T_tracker_base, [0.815 + z, y, 1.1865 - x])
    np.testing.assert_allclose(run.xyz[0, 0], at, atol=1e-12)
    np.testing.assert_allclose(
        run.xyz[0, 3], frames.apply(cell.tracker.T_tracker_base, np.array([0.75, 1.0, 0.0])), atol=1e-12
    )
    moved = Tracker(cell.tracker.T_tracker_base).moved([1.0, 2.0, 3.0])
    np.testing.assert_allclose(moved.place, [1.0, 2.0, 3.0], atol=1e-12)


def test_the_shipped_tracker_stands_where_the_thesis_had_it(cell):
    """Tables A I-1 and A III-1: target 1 at the five ISO poses as the thesis's tracker saw it."""
    joints = np.radians(
        [
            [0.0, -14.0, 14.0, 0.0, 0.0, 0.0],
            [17.690, 18.084, -46.521, -33.814, 33.095, 29.298],
            [-17.690, 18.084, -46.521, 33.814, 33.095, -29.298],
            [-41.374, -24.789, 47.145, -66.643, -46.052, 58.108],
            [41.373, -24.788, 47.145, 66.643, -46.052, -58.108],
        ]
    )
    seen = [
        [1568.937, 753.352, -234.817],
        [1184.504, 700.874, 31.782],
        [1512.934, 1135.976, 36.515],
        [1952.791, 806.731, -502.204],
        [1625.478, 372.956, -505.890],
    ]
    run = cell.without("visibility", "lost").measure(joints)
    assert np.linalg.norm(run.xyz[:, 0] / MM - seen, axis=1).max() < 3.0  # the nominal robot errs by up to 2 mm


def test_targets_are_those_of_table_3_1():
    """The table's last column is the distance of real and CAD places."""
    printed = [0.553, 0.465, 0.515, 0.568, 0.690, 0.609, 0.612, 0.661, 0.497]
    found = [np.linalg.norm(np.subtract(*pair)) for pair in TABLE_3_1.values()]
    np.testing.assert_allclose(found, printed, atol=0.002)


# switching


def test_same_seed_same_numbers_and_the_robot_does_not_depend_on_it(cell, q):
    first, second = cell.measure(q), cell.measure(q)
    np.testing.assert_array_equal(first.xyz, second.xyz)
    other = cell.replace(seed=1)
    assert (np.abs(other.measure(q).xyz - first.xyz) > 1e-6).any()
    np.testing.assert_array_equal(other.only().measure(q).xyz, cell.only().measure(q).xyz)
    assert (np.abs(cell.measure(q, run=1).xyz - first.xyz) > 1e-6).any()


@pytest.mark.parametrize("name", effects.NAMES)
def test_switching_one_effect_off_leaves_the_others_as_they_were(cell, q, name):
    """Effects are small: what one adds is the same with all others on or off, to second order."""
    unseeing = ("visibility", "lost")
    if name in unseeing:
        both, other, alone = (
            np.isnan(cell.only(*names).measure(cell.arm.random_joints(300, seed=2)).xyz[..., 0])
            for names in (unseeing, set(unseeing) - {name}, [name])
        )
        np.testing.assert_array_equal(both, other | alone)
        assert 0 < alone.sum() < both.sum()
        return
    everything = cell.without(*unseeing)
    added = everything.measure(q).xyz - everything.without(name).measure(q).xyz
    alone = cell.only(name).measure(q).xyz - cell.only().measure(q).xyz
    assert np.abs(alone).max() > (1e-10 if name == "settling" else 1e-6)
    assert np.abs(added - alone).max() < 2e-6
    if name == "noise":  # not even to second order: the same random numbers
        assert np.abs(added - alone).max() < 1e-8


def test_unknown_effects_and_targets_are_refused_with_the_names(cell):
    for call in (cell.only, cell.without):
        with pytest.raises(MeasurementError, match=r"unknown effect 'friction': effects are tilt, compliance,.* lost"):
            call("friction")
    with pytest.raises(MeasurementError, match="unknown target 'smr7': targets are smr1, smr2, smr3"):
        cell.with_targets(["smr7"])


def test_every_effect_says_what_it_is():
    assert len(set(effects.NAMES)) == len(effects.EFFECTS)
    for effect in effects.EFFECTS:
        assert effect.summary
        assert "section" in effect.summary or "annex" in effect.summary
        units = ("_deg", "_Nm", "_um", "_m", "_s", "_Hz", "_min", "_h", "_urad", "_mm", "waves", "growth", "share")
        assert all(name.endswith(units) for name in effect().parameters()), effect.name


# the whole


def test_without_effects_level_34_is_exact_and_with_noise_it_is_at_the_noise(cell):
    joints = procedure.random_poses(cell, 600, seed=8)
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


@pytest.mark.parametrize("name", list(OTHERS))
def test_other_arms_have_a_cell_too(name, tmp_path):
    base, tip = OTHERS[name]
    cell = simulation.open_cell(robot_file(name, tmp_path), base, tip, robot_seed=3).with_targets(THREE)
    joints = procedure.random_poses(cell, 150, seed=1)
    level = "34" if cell.arm.six_revolute else "placement"

    def heldout(setting, model):
        points = setting.measure(joints).points()
        fitted = np.arange(points.poses) < 110
        return distances(identify(cell.arm, points.select(fitted), model).robot, points.select(~fitted)).mean()

    assert heldout(cell.only("noise"), level) < 20e-6
    assert 30e-6 < heldout(cell, level) < 0.7 * heldout(cell, "nominal")


@pytest.fixture(scope="module")
def tables():
    """The functions of scripts/cell_tables."""
    path = Path(__file__).parents[2] / "scripts" / "cell_tables"
    loader = SourceFileLoader("cell_tables", str(path))
    written, sys.dont_write_bytecode = sys.dont_write_bytecode, True
    try:
        loader.exec_module(module := module_from_spec(spec_from_loader("cell_tables", loader)))
    finally:
        sys.dont_write_bytecode = written
    return module


def test_nominal_errors_are_those_of_table_7_1_and_34_parameters_leave_a_third(tables):
    cell = simulation.open_cell("irb1600")
    poses = procedure.campaign(cell, identification=150, verification=1600, seed=5)
    measured = procedure.measure(cell, poses)
    found = tables.errors(tables.nominal(cell, tables.by_axes(cell, measured)), measured.verification)
    np.testing.assert_allclose(found[:, 0], [1.004, 0.961], rtol=0.10)
    np.testing.assert_allclose(found[:, 2], [1.890, 2.268], rtol=0.25)  # of 1,600 points, not 8,000
    fit = tables.identified(cell, measured, "34", (76, 70), 0, method="nelder-mead")
    found = tables.errors(fit, measured.verification)
    np.testing.assert_allclose(found[:, 0], [0.272, 0.321], rtol=0.35)
    np.testing.assert_allclose(found[:, 2], [0.714, 0.858], rtol=0.35)
