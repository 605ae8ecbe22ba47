"""A plan as data: when each reflector is measured, and where it is expected."""

import numpy as np

from irbcal.modeling import frames
from irbcal.planning.conditions import SOLID
from irbcal.planning.measuring_plan import plan
from irbcal.planning.wish import READINGS_S


def test_expected_points_and_times_are_those_of_the_poses():
    made = plan("irb1600", axis=0, cube=3, all_range=0, without=SOLID, level="nominal", references=2, wait_s=3.0)
    pose, target, xyz, time = made.expected()
    assert len(pose) == made.asked.sum()
    T = made.scene.setting.arm.forward(made.q)
    for k in range(len(pose)):
        local = made.scene.setting.targets.places[target[k]]
        there = frames.apply(made.scene.T_world_base, T[pose[k], :3, :3] @ local + T[pose[k], :3, 3])
        np.testing.assert_allclose(xyz[k], there, rtol=0, atol=1e-12)
    first = np.flatnonzero(np.diff(pose, prepend=-1))
    np.testing.assert_allclose(time[first], made.stops + 3.0, rtol=0, atol=1e-9)
    count = made.asked[-1].sum() + 2
    assert made.duration_s == made.stops[-1] + 3.0 + READINGS_S * count
