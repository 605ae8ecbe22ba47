"""What is said of the joints: sources are named, and what they do not agree on is said."""

from dataclasses import replace

import numpy as np
import pytest
from moving import moves, random_commands, simulated, there_and_back

from irbcal.joint_behaviour.behaviour import JointBehaviour
from irbcal.joint_behaviour.moves import analyse_moves
from irbcal.joint_behaviour.needed import Step
from irbcal.joint_behaviour.residuals import analyse_residuals
from irbcal.joint_behaviour.verdict import verdict

PLAY_6 = np.radians([0, 0, 0, 0, 0, 0.06])


@pytest.fixture(scope="module")
def by_moves():
    """Joint 6 with play, moved alone."""
    q = moves(6, there_and_back(-180, 180, 20))
    groups = np.full(len(q), "axis6", object)
    points, step, _ = simulated(q, groups, PLAY_6, noise=1e-5, rng=np.random.default_rng(0))
    return tuple(analyse_moves(points, step))


@pytest.fixture(scope="module")
def by_residuals():
    """The same joint in random poses."""
    points, step, robot = simulated(random_commands(60, 0), None, PLAY_6, noise=3e-5, rng=np.random.default_rng(0))
    return analyse_residuals(robot, points, step)


def said(by_moves, by_residuals):
    return verdict(JointBehaviour("file", True, by_moves, by_residuals))


def test_two_sources_that_agree_are_named(by_moves, by_residuals):
    words = said(by_moves, by_residuals)
    assert any(line.startswith("by one-joint moves, backlash joint 6: 0.0") for line in words)
    assert any(line.startswith("backlash joint 6: 0.0") for line in words)
    assert not any("by the one-joint moves" in line for line in words)
    assert words[-1].startswith("This robot needs, the most important first: backlash of joint 6")
    alone = said(by_moves, None)
    assert alone[0].startswith("backlash joint 6: 0.0")
    assert alone[-1] == "This robot needs: backlash of joint 6."


def test_two_sources_that_do_not_agree_say_so(by_moves, by_residuals):
    # the moves see play that the residuals do not need
    none = replace(by_residuals, needed=())
    words = said(by_moves, none)
    assert "backlash of joint 6: worth it by the one-joint moves, not needed by the residuals" in words[-2]
    assert words[-1].startswith("This robot needs no term beyond geometry")
    # and the other way round
    (joint,) = by_moves
    unseen = replace(joint, backlash=replace(joint.backlash, verdict="not seen"))
    words = said((unseen,), by_residuals)
    assert "joint 6: no backlash seen" in words[0]
    assert words[0].startswith("by one-joint moves, ")
    assert "backlash of joint 6: needed by the residuals, not worth it by the one-joint moves" in words[-2]
    # what only one of the two has tested is no disagreement
    other = replace(by_residuals, needed=(Step("stiffness", None, 0.01, 1e-4),))
    assert not any("stiffness: needed" in line for line in said((unseen,), other))


def test_without_any_test_nothing_is_known(by_moves):
    (joint,) = by_moves
    untested = {
        kind: replace(getattr(joint, kind), verdict="not tested", note="too few") for kind in ("backlash", "gain")
    }
    words = said((replace(joint, fourier=replace(joint.fourier, verdict="not tested", note="few"), **untested),), None)
    assert words[-1].startswith("What this robot needs is not known")
    assert "backlash of joint 6 not tested by one-joint moves: too few" in words
