"""Every pose made from joints within the limits has a solution within the limits, also at singularities and limits."""

import numpy as np
import pytest
from reachable import KINDS, unsolved, with_errors


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["irb1600", "irb120", "ur10", "panda"])
def test_no_reachable_pose_stays_unsolved(name, kind):
    opened = with_errors(name, 2.4)
    q = kind(opened, 40 if name.startswith("irb") else 20, np.random.default_rng(3))
    assert len(q) >= 5
    assert not unsolved(opened, opened.robot.poses(q)).any()
