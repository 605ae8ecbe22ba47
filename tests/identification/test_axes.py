"""Six joint axes from moves of one joint at a time: simulated truth, refusals, and a real arm."""

import numpy as np
import pytest
from one_joint import one_joint_moves, own_circles, true_robot
from support import arm, measured

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
