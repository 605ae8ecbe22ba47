"""The virtual cell as a whole: where points stand, seeds, and the limits without effects."""

import numpy as np
import pytest

from irbcal.identification.fit import identify
from irbcal.measurement.points import distances
from irbcal.modeling import frames
from irbcal.simulation import masses, procedure
from irbcal.simulation.shipped import open_cell
from irbcal.simulation.tracker import Tracker
from irbcal.units import MM


def test_stiffness_of_the_joint_map_is_what_compliance_and_masses_give():
    """A and B by hand for one mass on each arm: A = c g (m2 r2 + m3 L1), B = c g m3 r3 (eqs. 5.9 to 5.15)."""
    cell = open_cell("irb1600")
    arm = cell.arm
    # centres in DHM frames 2 and 3 (x along the upper arm; frame 3: x up at zero joints, y against the forearm)
    place = np.array([[0.0, 0.0, 0.0], [0.3, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0] * 3, [0.0] * 3, [0.0] * 3])
    mass = np.array([0.0, 18.0, 0.0, 10.0, 0.0, 0.0])  # the second mass in the wrist's centre, 600 mm before axis 3
    cell = cell.replace(
        bodies=masses.Bodies(mass, place), compliance=(0.0, 4e-6, 4e-6, 0.0, 0.0, 0.0), table=arm.table
    ).with_payload(0.0)
    by_hand = 4e-6 * 9.81 * np.array([18.0 * 0.3 + 10.0 * 0.7, 10.0 * 0.6])
    np.testing.assert_allclose(cell.true_joint_map().stiffness, by_hand, rtol=1e-9)


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


def test_same_seed_same_numbers_and_the_robot_does_not_depend_on_it(cell, q):
    first, second = cell.measure(q), cell.measure(q)
    np.testing.assert_array_equal(first.xyz, second.xyz)
    other = cell.replace(seed=1)
    assert (np.abs(other.measure(q).xyz - first.xyz) > 1e-6).any()
    np.testing.assert_array_equal(other.only().measure(q).xyz, cell.only().measure(q).xyz)
    assert (np.abs(cell.measure(q, run=1).xyz - first.xyz) > 1e-6).any()


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
