"""Effects of single joints in the residuals of a robot: simulated truth, and a real arm."""

import numpy as np
import pytest
from moving import SERIES, random_commands, refusal, simulated
from support import arm

from irbcal.joint_behaviour import behaviour
from irbcal.joint_behaviour.residuals import analyse_residuals
from irbcal.joint_behaviour.verdict import of_residuals
from irbcal.measurement import table
from irbcal.modeling.thesis_map import ThesisMap


def test_backlash_and_stiffness_are_found_within_their_intervals():
    backlash = np.radians([0.02, 0.0, 0.015, 0.0, 0.02, 0.05])
    A, B = np.radians([0.043, 0.019])
    inside, stiff = [], []
    for seed in range(6):
        points, step, robot = simulated(
            random_commands(70, seed),
            None,
            backlash,
            noise=5e-5,
            rng=np.random.default_rng(seed),
            stiffness=(A, B),
            fourier=SERIES,
        )
        found = analyse_residuals(
            robot.replace(joint_map=ThesisMap(stiffness=(A, B), fourier=SERIES).joint_map(robot.arm)), points, step
        )
        for j, term in found.of("backlash").items():
            inside.append(term.low[0] < backlash[j - 1] < term.high[0])
        term = found.of("stiffness")[None]
        stiff += [low < value < high for value, low, high in zip((A, B), term.low, term.high, strict=True)]
        assert found.of("backlash")[6].verdict == term.verdict == found.of("fourier")[6].verdict == "worth it"
        assert ("stiffness", None) in [(s.kind, s.joint) for s in found.needed]
        # an effect of the direction is not taken for one of the size of the moves
        assert not {s.kind for s in found.needed} & {"move", "gain"}
    # 36 and 12 intervals of 95 %
    assert sum(inside) >= 31
    assert sum(stiff) >= 10


def test_clean_residuals_raise_no_alarm():
    alarms = 0
    for seed in range(4):
        points, step, robot = simulated(random_commands(60, seed), noise=5e-5, rng=np.random.default_rng(seed))
        found = analyse_residuals(robot, points, step)
        alarms += sum(term.verdict == "worth it" for term in found.terms)
        assert found.needed == ()
        assert len(found.terms) == 6 + 6 + 6 + 6 + 1
        assert "needs no term beyond geometry" in of_residuals(found, None)[-1]
    assert alarms <= 1


def test_a_lag_is_told_from_play():
    lag = np.array([5e-4, 0, 0, 0, 0, 0])
    points, step, robot = simulated(random_commands(90, 2), per_move=lag, noise=5e-5, rng=np.random.default_rng(2))
    found = analyse_residuals(robot, points, step)
    # the direction alone seems to matter, and in the sense that play does not have
    assert found.of("backlash")[1].high[0] < 0
    assert found.approach["size"] < 0.5 * found.approach["direction"]
    term = found.of("move")[1]
    assert term.low[0] < lag[0] < term.high[0]
    assert [(s.kind, s.joint) for s in found.needed] == [("move", 1)]
    words = " ".join(of_residuals(found, None))
    assert "a lag does" in words
    assert "BEYOND" in words


def test_a_joint_that_the_robot_has_not_is_refused():
    points, step, robot = simulated(random_commands(20, 0))
    assert refusal(analyse_residuals, robot, points, step, 7) == "there is no joint 7: irb1600_6_145 has 6"


@pytest.fixture(scope="module")
def irb120(shared_data):
    """A real IRB 120 in random poses, and the report on its joints."""
    seen = table.read(shared_data / "irb120_laser_tracker" / "measurements.csv")
    return seen, behaviour.analyse(seen, arm("irb120"))


def test_the_direction_of_approach_shows_on_a_real_arm(irb120):
    found = irb120[1].residuals
    plays = found.of("backlash")
    low, high = np.degrees(plays[1].low[0]), np.degrees(plays[1].high[0])
    assert -0.08 < low < high < -0.05
    assert plays[1].verdict == "worth it"
    assert sum(term.high[0] < 0 for term in plays.values()) >= 3
    # each half of the poses says so by itself
    assert (np.degrees(found.halves[:3]) < -0.015).all()
    assert (found.halves_p > 0.005).all()
    # it grows with the moves of joints 1 to 3, about alike, and explains a quarter of what is left
    lag = [found.of("move")[j] for j in (1, 2, 3)]
    assert all(3e-4 < term.values[0] < 6e-4 and term.low[0] > 2e-4 for term in lag)
    assert found.approach["size"] < 0.75 * found.approach["neither"]
    assert [(s.kind, s.joint) for s in found.needed][:2] == [("stiffness", None), ("move", 1)]


def test_directions_of_other_poses_show_nothing_on_a_real_arm(irb120):
    found = irb120[1].residuals
    # the move that follows a pose cannot act on it
    step = np.r_[found.step[1:], found.step[:1]]
    wrong = analyse_residuals(found.robot, found.points, step, joint=1)
    assert wrong.of("backlash")[1].verdict == "not seen"
    assert wrong.of("move")[1].verdict == "not seen"
    assert wrong.approach["direction"] > 0.99 * wrong.approach["neither"]
    assert {s.kind for s in wrong.needed} <= {"stiffness", "gain"}
