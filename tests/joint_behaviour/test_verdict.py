"""What is said of the joints: sources are named, and what they do not agree on is said."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from moving import moves, random_commands, simulated, there_and_back

import irbcal
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


def one_by_one(home=(0.0, -10.0, 10.0, 0.0, 20.0, 0.0)):
    """A plan of there-and-back moves of each joint, degrees."""
    rows = []
    for joint, (low, high) in enumerate([(-140, 140), (-50, 88), (-140, 40), (-120, 120), (-80, 80), (-120, 120)]):
        up = np.linspace(low, high, 15)
        for value in (*up, *up[::-1]):
            q = list(home)
            q[joint] = value
            rows.append((str(len(rows) + 1), f"axis{joint + 1}", *q))
    return pd.DataFrame(rows, columns=["pose", "group", *(f"q{k}_deg" for k in range(1, 7))])


@pytest.mark.parametrize("seed", [0, 3, 9])
def test_weight_is_not_called_a_series_of_joint_3(seed):
    """SIMULATED: nothing but joints that give way under weight; moves alone cannot know more than a period a turn."""
    run = irbcal.simulate(
        "irb1600", one_by_one(), seed=seed, robot_seed=seed, only=["compliance", "repeatability", "noise"]
    )
    words = irbcal.joints(run.measurements()).to_dict()["verdict"]
    assert "bending under gravity of joint 2" in words[-1]
    assert "bending under gravity of joint 3" in words[-1]
    assert not any(f"Fourier series of order 2 of joint {k}" in words[-1] for k in (1, 2, 3))
    assert "may be bending under weight" in words[-2]
    for joint in range(1, 7):
        assert not (
            any(f"joint {joint}: no backlash" in w for w in words) and f"backlash of joint {joint}" in words[-1]
        )
