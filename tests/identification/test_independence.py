"""Whether points of a pose err by themselves: SIMULATED noise of points, and errors that move a pose as one body."""

from dataclasses import replace

import numpy as np
import pytest
from support import arm, measured

from irbcal.identification.evidence import Averaging, identify_evidence, linearise
from irbcal.identification.independence import along_and_across
from irbcal.identification.term_sets import candidates
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms.situation import Motion

NOISE = 3e-5
TARGETS = {"smr1": np.array([-0.06, 0.06, 0.09]), "smr2": np.array([0.06, 0.05, 0.10]), "smr3": [0.05, -0.06, 0.11]}


def points_of(poses, shaken, seed=0):
    """Points of a nominal robot with noise, and with turns and shifts of each pose as one body."""

    rng = np.random.default_rng(seed)
    exact = measured(Robot(arm(), targets=TARGETS), arm().random_joints(poses, seed + 1))
    xyz = exact.xyz + rng.normal(scale=NOISE, size=exact.xyz.shape)
    centre = np.array([xyz[exact.pose == k].mean(axis=0) for k in range(poses)])[exact.pose]
    turn = rng.normal(scale=3e-4 * shaken, size=(poses, 3))[exact.pose]
    xyz += rng.normal(scale=5e-5 * shaken, size=(poses, 3))[exact.pose] + np.cross(turn, xyz - centre)
    return replace(exact, xyz=xyz)


@pytest.mark.parametrize("seed", range(2))
def test_noise_counts_alone_and_errors_of_poses_do_not(seed):
    for shaken in (False, True):
        assert identify_evidence(arm(), points_of(30, shaken, seed)).independent != shaken


def test_a_reflector_alone_says_nothing():
    points = points_of(20, False)

    alone = replace(points.take(points.target == 0), target_names=points.target_names[:1])
    assert not identify_evidence(arm(), alone).independent


def test_parts_are_those_of_rigid_motions():
    """Against a least squares of each pose's residuals by shifts and turns about its points as they were measured."""
    points = points_of(25, True)
    ready = linearise(arm(), points, Motion(points.q))
    averaging = Averaging(ready.linear, ready.sums)
    term_set = candidates(averaging.superset, "joint-map", None)[0]
    columns, fit = term_set.columns(ready.linear.nuisance), averaging.fit(term_set, 1.0)
    squares, freedom = along_and_across(ready.linear, columns, fit)
    expected = np.zeros(2)
    for block in ready.linear.blocks(columns):
        e = (block.y - fit.c @ block.J).reshape(-1, 3)
        places, pose = points.xyz[block.row[::3]], block.pose[::3]
        for k in np.unique(pose):
            motions = [
                np.hstack([np.eye(3), np.column_stack([np.cross(axis, p) for axis in np.eye(3)])])
                for p in places[pose == k]
            ]
            rest = np.linalg.lstsq(np.concatenate(motions), e[pose == k].ravel(), rcond=None)
            total = float((e[pose == k] ** 2).sum())
            expected += total - float(rest[1][0]), float(rest[1][0])
    # derivatives are of the points as the geometry solution has them, a tenth of a millimetre beside those measured
    np.testing.assert_allclose(squares, expected, rtol=1e-2)
    assert freedom[1] == 3 * 25 - 3
    assert freedom[0] == pytest.approx(6 * 25 - 12 - fit.gammas.sum())
