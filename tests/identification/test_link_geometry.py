"""Lengths and angles between measured axes: simulated truth and a real arm."""

import numpy as np
import pytest
from one_joint import one_joint_moves, own_circles, true_robot
from support import arm, measured

from irbcal.identification import axes, axis_calibration
from irbcal.modeling.extraction import dhm_from_axes


def test_link_geometry_needs_no_nominal_arm():
    nominal = arm("irb1600")
    robot = true_robot(nominal, 10, tilt=0.0)
    q, groups = one_joint_moves(0.7)
    points = measured(robot, q, groups=groups)
    found = axis_calibration.link_geometry(axes.measure_axes(points)).table
    assert np.isnan([found.a[0], found.alpha[0], found.d[0], found.theta[0], found.d[5], found.theta[5]]).all()
    assert np.abs(found.a[1:] - np.abs(robot.table.a[1:])).max() < 1e-12
    assert np.abs(np.cos(found.alpha[1:]) - np.cos(robot.table.alpha[1:])).max() < 1e-12
    assert np.abs(np.abs(found.d[3:5]) - np.abs(robot.table.d[3:5])).max() < 1e-12
    assert abs(abs(found.d[2]) - abs(robot.table.d[1] + robot.table.d[2])) < 1e-12


def test_link_lengths_of_a_real_arm(fanuc):
    found = axis_calibration.link_geometry(axes.measure_axes(fanuc))
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
        other = axis_calibration.link_geometry(axes.measure_axes(fanuc.take(fanuc.target != target)))
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
    common = axis_calibration.link_geometry(measured_axes).table
    uncertain = fits[3, 0].direction_std / 3 * abs(common.d[3])  # of a3, by that one normal at the end of the forearm
    assert fits[3, 0].radii[0] < 2e-3
    assert 1e-3 < abs(plain.a[3] - common.a[3]) < 2 * uncertain
