"""Every pose made from joints within the limits has a solution within the limits, also at singularities and limits."""

import numpy as np
import pytest
from reachable import KINDS, at_limits, unsolved, with_errors

from irbcal import kernel
from irbcal.modeling.inverse import any_arm, calibrated_arm, closed_form


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("name", ["irb1600", "irb120", "ur10", "panda"])
def test_no_reachable_pose_stays_unsolved(name, kind):
    opened = with_errors(name, 2.4)
    q = kind(opened, 40 if name.startswith("irb") else 20, np.random.default_rng(3))
    assert len(q) >= 5
    assert not unsolved(opened, opened.robot.poses(q)).any()


def test_a_pose_is_not_given_up_after_the_first_starts():
    """Next to a singularity of the wrist all of them end 56 mm off."""
    opened = with_errors("ur3", 2.4)
    q = [[0.47842090041522056, -2.7722226360887516, 0.035773601950668935, -1.8505965448007133, 4.2525e-11, -2.11259488]]
    assert not unsolved(opened, opened.robot.poses(np.array(q))).any()


def test_joints_all_at_limits_are_found():
    opened = with_errors("panda", 2.4)
    arm = opened.nominal
    q = np.where(np.random.default_rng(0).random((60, 7)) < 0.5, arm.lower, arm.upper)
    assert not unsolved(opened, opened.robot.poses(q)).any()


@pytest.mark.parametrize(("name", "kind"), [*(("irb1600", kind) for kind in KINDS), ("panda", at_limits)])
def test_a_seed_beside_the_solution_bounds_the_search(name, kind):
    opened = with_errors(name, 2.4)
    q = kind(opened, 300, np.random.default_rng(3))
    seed = q + 1e-2 * np.random.default_rng(4).standard_normal(q.shape)
    solver = calibrated_arm if closed_form.has_closed_form(opened.nominal) else any_arm
    result = solver.solve(opened.robot, opened.nominal, opened.robot.poses(q), seed)
    assert result.inside.all()
    assert result.iterations.max() < (
        1000 if kernel.Kernel is None else 250
    )  # numpy takes all starts of a stage at once
    np.testing.assert_allclose(opened.robot.poses(result.joints), opened.robot.poses(q), rtol=0, atol=1e-9)
