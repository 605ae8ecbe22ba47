"""The choice of terms: what hides a term, what makes one idle, and no term both needed and not worth having."""

from dataclasses import replace

import numpy as np
import pytest
from moving import SERIES, random_commands, simulated
from support import TARGETS, arm, measured

from irbcal.joint_behaviour import needed
from irbcal.joint_behaviour.linearised import Linearised
from irbcal.joint_behaviour.residuals import analyse_residuals
from irbcal.joint_behaviour.verdict import needed_by_residuals, of_residuals
from irbcal.measurement.last_moves import last_moves
from irbcal.modeling.robot import Robot

BACKLASH_4 = np.radians(0.03)


def hidden_backlash(seed=0):
    """A joint 4 with play and an uneven gear that is larger; returns the points, their last moves and the robot."""
    q = random_commands(70, seed)
    step = np.nan_to_num(last_moves(q))
    effective = q.copy()
    series = np.radians([0.03, 0.06, 0.05, -0.05])
    effective[:, 3] += np.column_stack([f(k * q[:, 3]) for k in (1, 2) for f in (np.cos, np.sin)]) @ series
    effective[:, 3] -= 0.5 * np.sign(step[:, 3]) * BACKLASH_4
    robot = Robot(arm("irb1600"), T_world_base=np.eye(4), targets=TARGETS)
    points = measured(robot, effective, 3e-5, np.random.default_rng(seed))
    return replace(points, q=q), last_moves(q), robot


@pytest.fixture(scope="module")
def hidden():
    points, step, robot = hidden_backlash()
    return analyse_residuals(robot, points, step)


def test_what_other_terms_hide_is_told_as_it_is_beside_them(hidden):
    assert {("backlash", 4), ("fourier", 4)} <= {(s.kind, s.joint) for s in hidden.needed}
    term = hidden.of("backlash")[4]
    # alone: the uneven gear is scatter to it
    assert term.verdict == "not seen"
    beside = term.beside_needed
    assert beside is term.shown
    assert beside.low[0] < BACKLASH_4 < beside.high[0]
    assert beside.high[0] - beside.low[0] < 0.3 * (term.high[0] - term.low[0])
    assert beside.verdict == "worth it"
    assert beside.rms_with < 0.98 * beside.rms_without


def test_no_term_is_both_needed_and_not_seen(hidden):
    for step in hidden.needed:
        assert hidden.of(step.kind)[step.joint].shown.verdict == "worth it"
    words = " ".join(of_residuals(hidden, None))
    assert "backlash of joint 4" in needed_by_residuals(hidden)
    assert "joint 4: no backlash" not in words
    assert "backlash joint 4: 0.0" in words
    assert "beside the other terms that this robot needs: worth it" in words


@pytest.mark.parametrize("seed", range(4))
def test_many_robots_are_told_nothing_that_contradicts_itself(seed):
    rng = np.random.default_rng(seed)
    points, step, robot = simulated(
        random_commands(60, seed),
        None,
        np.radians(0.05) * rng.uniform(0, 1, 6),
        np.r_[4e-4 * rng.uniform(0, 1, 3), 0, 0, 0],
        noise=1e-4,
        rng=rng,
        fourier=SERIES * rng.uniform(0, 1, 4),
        stiffness=np.radians([0.04, 0.02]) * rng.uniform(0, 1),
    )
    found = analyse_residuals(robot, points, step)
    assert found.needed
    for chosen in found.needed:
        assert found.of(chosen.kind)[chosen.joint].shown.verdict == "worth it"
    # what was worth it by itself has no second version
    assert all(t.beside_needed is None for t in found.terms if t.verdict == "worth it")


def test_a_term_that_others_make_idle_is_dropped():
    """Of an effect that is the sum of two, the sum's own stand-in is taken first and idle once both are there."""
    rng = np.random.default_rng(0)
    points, step, robot = simulated(random_commands(60, 1), noise=1e-5, rng=rng)
    model = Linearised(robot, points, step)
    own = rng.standard_normal((len(model.r), 2))
    model.r = model.r + 1e-4 * own @ [1.0, 1.0]
    both = own.sum(axis=1, keepdims=True) + 0.6 * rng.standard_normal((len(model.r), 1))
    keys = [("gain", 1), ("gain", 2), ("gain", 3)]
    selection = needed._Selection(model, dict(zip(keys, (both, own[:, :1], own[:, 1:]), strict=True)))
    selection.take()
    assert selection.chosen[0] == ("gain", 1)
    assert len(selection.chosen) == 3
    assert selection.drop_idle()
    assert selection.chosen == [("gain", 3), ("gain", 2)] or selection.chosen == [("gain", 2), ("gain", 3)]
    assert not selection.drop_idle()
    selection.take()  # what was dropped does not come back
    assert len(selection.steps()) == 2
    assert selection.steps()[1].rms < 0.5 * selection.steps()[0].rms
