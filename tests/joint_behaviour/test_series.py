"""One joint moved alone: a circle by hand, and points that are far from it."""

from dataclasses import replace

import numpy as np
from moving import moves, simulated, there_and_back

from irbcal.joint_behaviour.moves import analyse_moves
from irbcal.measurement.last_moves import last_moves
from irbcal.measurement.points import PointSet


def test_a_circle_by_hand():
    # one reflector at 0, 90, 180, 270 degrees and back; 2 um outwards and inwards in turn, 3 um up and down in turn,
    # 40 urad behind the command on the way up, ahead on the way back: none of it bends a circle through all points
    angle = np.radians([0, 90, 180, 270, 270, 180, 90, 0])
    turn = np.array([1, -1, 1, -1, -1, 1, -1, 1])
    actual = angle + 40e-6 * np.array([-1, -1, -1, -1, -1, 1, 1, 1])
    actual[4] = angle[4] - 40e-6  # measured twice at the top: still reached from below
    radius = 0.5 + 2e-6 * turn
    xyz = np.column_stack([radius * np.cos(actual), radius * np.sin(actual), 1.0 + 3e-6 * turn])
    q = moves(3, angle)
    points = PointSet(q, np.arange(8), np.zeros(8, int), xyz, ("smr",), np.arange(8), np.full(8, "axis3", object))
    (joint,) = analyse_moves(points, last_moves(q, points.groups))
    (series,) = joint.series
    assert series.direction.tolist() == [0, 1, 1, 1, 1, -1, -1, -1]
    assert np.abs(series.radial - 2e-6 * turn).max() < 1e-9
    assert np.abs(series.axial - 3e-6 * turn).max() < 1e-9
    assert np.abs(series.angle - 40e-6 * np.array([-1, -1, -1, -1, -1, 1, 1, 1])).max() < 2e-8
    assert np.abs(series.tangential - 0.5 * series.angle).max() < 1e-9
    assert series.zero == 0.0
    # the top was reached from below only, the start from above and from nobody knows where: two angles are not enough
    assert joint.backlash.note == "2 joint angles were reached from both sides, 3 are needed"
    assert joint.fourier.note == "4 joint angles are too few for order 2: 8 are needed"


def test_a_point_far_from_its_circle_is_left_out_and_named():
    q = moves(5, there_and_back(-90, 90, 15))
    points, step, _ = simulated(q, np.full(len(q), "axis5", object), noise=1e-5, rng=np.random.default_rng(3))
    xyz = points.xyz.copy()
    xyz[10] += [0.0, 0.004, 0.003]
    (joint,) = analyse_moves(replace(points, xyz=xyz), step)
    ((pose, target, off),) = joint.series[0].excluded
    assert (pose, target) == ("3", "smr2")
    assert off > 1e-3
    assert joint.series[0].fit.rms < 3e-5
