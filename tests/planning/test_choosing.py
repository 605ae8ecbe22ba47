"""How poses are chosen and put in order: axis moves first, samples everywhere, optimal poses for what is there."""

import numpy as np
from planning_support import setting

from irbcal.planning import choosing
from irbcal.planning.choosing import Wish, axis_moves, random_poses
from irbcal.planning.conditions import SOLID
from irbcal.planning.optimal_design import Model
from irbcal.planning.scene import open_scene
from irbcal.simulation.instruments import IRB1600_CUBE

SCENE = open_scene("irb1600", without=tuple(SOLID))


def test_samples_fill_both_volumes_whether_the_tracker_sees_them_or_not():
    there = choosing.samples(SCENE, [1, 2], lambda text: None)
    tip = SCENE.setting.places(there["cube"])[0]
    assert np.abs(tip - IRB1600_CUBE[0]).max() <= IRB1600_CUBE[1] / 2
    assert len(there["cube"]) == len(there["range"]) == choosing.VOLUME_SAMPLES


def test_axis_moves_come_first_and_the_others_lose_none():
    there = setting()
    axis, others = axis_moves(there), random_poses(there, 20, "all_range", 1)
    poses, over_home, _ = choosing.in_order(SCENE, [axis], [others], np.zeros(6))
    np.testing.assert_array_equal(poses.q[:18], axis.q)
    assert sorted(map(tuple, poses.q[18:])) == sorted(map(tuple, others.q))
    assert len(over_home) == 38


def test_chosen_poses_come_from_both_kinds_of_candidates_and_beat_random_ones():
    steps = []
    there = choosing.samples(SCENE, [1, 2], steps.append)
    model = Model(SCENE.nominal, SCENE.setting.targets, "26")
    wish = Wish(optimal=8, candidates=80, axis=0, cube=0, all_range=0)
    poses, comparison, tallies = choosing.optimal(SCENE, wish, model, [], there, [3, 4], steps.append)
    assert set(poses.groups) == {"optimal_iso_cube", "optimal_all_range"}
    assert comparison.optimal < comparison.random[8]
    assert [tally.kept >= 40 for tally in tallies.values()] == [True, True]
    assert "8 poses of 80 candidates" in steps
