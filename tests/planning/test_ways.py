"""Ways between poses: free ones, blocked ones, and those over home."""

import numpy as np
from planning_support import Wall, setting

from irbcal.planning import choosing


def test_moves_below_the_heights_and_through_the_arm_are_blocked():
    there = setting(("limits", "height", "collision"))
    level = np.zeros((1, 6))
    turned = np.array([[0.0, 0.0, 0.0, 0.0, 0.0, 1.0]])
    assert not choosing.blocked_moves(there, level, turned)[0]
    # from one side of joint 4's forbidden range to the other
    a, b = np.array([[0.0, 0, 0, 1.9, 0, 0]]), np.array([[0.0, 0, 0, 2.1, 0, 0]])
    assert choosing.blocked_moves(there, a, b)[0]
    # from low in front to high at the back: the ends are free, the way over the side is too low
    front, back = np.radians([[0.0, 20, 0, 0, 0, 0]]), np.radians([[180.0 - 2.0, -30, 10, 0, 0, 0]])
    way = front + np.linspace(0, 1, 400)[:, None] * (back - front)
    tip, points, _ = there.tip_and_reflectors(way)
    high = there.high(tip, points)
    assert high[[0, -1]].all()
    assert choosing.blocked_moves(there, front, back)[0] == (not high.all())
    assert not high.all()


def test_ways_that_are_not_free_go_over_home_where_that_is_free():
    """Joints 1 and 2 must not both be above 0.2: from one corner to the other over home, into the middle not at all."""

    class Corner(Wall):
        def touching(self, theta):
            return (theta[:, 0] > 0.2) & (theta[:, 1] > 0.2)

    there = setting(("collision",), solids=Corner())
    start = np.array([0.9, 0, 0, 0, 0, 0])
    for second, over, blocked in (([0.0, 0.9], True, False), ([0.9, 0.9], False, True), ([0.5, 0.1], False, False)):
        q = np.array([[*second, 0, 0, 0, 0]])
        poses = choosing.Poses(q, np.ones((1, 3), dtype=bool), np.array(["g"], dtype=object), choosing.Tally())
        found = choosing.ordered(there, poses, start, np.ones(6))
        assert found[1].tolist() == [over]
        assert found[2].tolist() == [blocked]
