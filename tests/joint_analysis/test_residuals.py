"""Effects of joints in residuals: linearised, placed, tested, chosen together, by approach."""

from dataclasses import replace

import numpy as np
import pytest
from moving import SERIES, TARGETS, random_commands, refusal, simulated
from support import TARGETS as TOOL
from support import arm, measured

from irbcal.joint_analysis import behaviour, linearised, residuals
from irbcal.joint_analysis.linearised import Linearised
from irbcal.joint_analysis.residuals import analyse_residuals, needed_by_residuals, of_residuals
from irbcal.joint_analysis.terms import JointTerm
from irbcal.measurement import table
from irbcal.measurement.last_moves import last_moves
from irbcal.modeling.robot import Robot
from irbcal.modeling.thesis_map import ThesisMap


def test_what_left_out_poses_say_agrees_with_leaving_them_out():
    # 30 poses: the errors of poses left out, by the hat matrix, against as many fits by brute force
    points, step, robot = simulated(
        random_commands(30, 4), None, np.radians([0.05, 0, 0, 0, 0, 0]), noise=1e-4, rng=np.random.default_rng(4)
    )
    model = Linearised(robot, points, step)
    X = -0.5 * model.per_joint(np.sign(step))[:, :1]
    found = model.test(X)
    design = np.hstack([model.basis(), X])
    errors, estimates = np.empty_like(model.r), []
    for pose in range(30):
        out = model.flat_pose == pose
        solution = np.linalg.lstsq(design[~out], model.r[~out], rcond=None)[0]
        errors[out] = model.r[out] - design[out] @ solution
        estimates.append(solution[-1])
    assert found.after == pytest.approx(model.size(errors), rel=1e-9)
    jackknife = 29 / 30 * np.sum((np.array(estimates) - found.beta[0]) ** 2)
    assert found.C[0, 0] == pytest.approx(jackknife, rel=1e-9)


def test_columns_are_derivatives_of_the_points():
    """Against differences of a robot whose joints are turned by each term."""
    points, step, robot = simulated(random_commands(20, 5))
    robot = robot.replace(T_world_base=np.eye(4))
    points = replace(measured(robot, points.q), q=points.q)
    model = Linearised(robot, points, step)
    size = 1e-6

    def moved(effective):
        return (measured(robot, effective).xyz - measured(robot, points.q).xyz).reshape(-1) / size

    def shift(j, by):
        out = points.q.copy()
        out[:, j] += size * by
        return out

    known = np.nan_to_num(step)
    q6 = points.q[:, 5]
    cases = [
        (JointTerm("backlash", 2, ("backlash",)), [shift(1, -0.5 * np.sign(known[:, 1]))]),
        (JointTerm("move", 3, ("per_move",)), [shift(2, known[:, 2])]),
        (JointTerm("gain", 5, ("gain",)), [shift(4, points.q[:, 4])]),
        (
            JointTerm("fourier", 6, ("a1", "b1"), frequency=(3.0,)),
            [shift(5, np.cos(3 * q6)), shift(5, np.sin(3 * q6))],
        ),
    ]
    for term, effectives in cases:
        X = linearised.of_term(model, term) / model.weight[:, None]
        for k, effective in enumerate(effectives):
            assert np.abs(X[:, k] - moved(effective)).max() < 1e-5
        assert linearised.names_of(term) == term.names
    assert linearised.names_of(JointTerm("stiffness", None, ("A",))) == ("A", "B")
    assert linearised.of_term(model, JointTerm("stiffness", None)).shape[1] == 2


def test_refusals_are_one_sentence():
    points, step, robot = simulated(random_commands(20, 0))
    other = robot.replace(targets={name: 3 * np.array(place) for name, place in TARGETS.items()})
    assert "not measured on this robot with this tool" in refusal(analyse_residuals, other, points, step)
    few = points.select(np.arange(20) < 5)
    assert "5 poses are too few" in refusal(analyse_residuals, robot, few, step[:5])


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


BACKLASH_4 = np.radians(0.03)


def hidden_backlash(seed=0):
    """A joint 4 with play and an uneven gear that is larger; returns the points, their last moves and the robot."""
    q = random_commands(70, seed)
    step = np.nan_to_num(last_moves(q))
    effective = q.copy()
    series = np.radians([0.03, 0.06, 0.05, -0.05])
    effective[:, 3] += np.column_stack([f(k * q[:, 3]) for k in (1, 2) for f in (np.cos, np.sin)]) @ series
    effective[:, 3] -= 0.5 * np.sign(step[:, 3]) * BACKLASH_4
    robot = Robot(arm("irb1600"), T_world_base=np.eye(4), targets=TOOL)
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
    selection = residuals._Selection(model, dict(zip(keys, (both, own[:, :1], own[:, 1:]), strict=True)))
    selection.take()
    assert selection.chosen[0] == ("gain", 1)
    assert len(selection.chosen) == 3
    assert selection.drop_idle()
    assert selection.chosen == [("gain", 3), ("gain", 2)] or selection.chosen == [("gain", 2), ("gain", 3)]
    assert not selection.drop_idle()
    selection.take()  # what was dropped does not come back
    assert len(selection.steps()) == 2
    assert selection.steps()[1].rms < 0.5 * selection.steps()[0].rms


PLAY = np.radians([0.04, 0, 0, 0, 0, 0])


@pytest.fixture(scope="module")
def found():
    points, step, robot = simulated(random_commands(120, 0), None, PLAY, noise=3e-5, rng=np.random.default_rng(0))
    return residuals.analyse(robot, points, np.sign(np.nan_to_num(step)))


def test_the_step_between_directions_is_the_backlash(found):
    first = found.terms[0]
    assert first.low[0] < PLAY[0] < first.high[0]
    below, above = found.by_angle(0, 1.0), found.by_angle(0, -1.0)
    assert np.average(above[:, 1]) - np.average(below[:, 1]) == pytest.approx(PLAY[0], rel=0.2)
    assert (below[:, 2] < 0.2 * PLAY[0]).all()
    assert (np.diff(below[:, 0]) > 0).all()
    assert "joints: 1" in repr(found)


def test_small_bins_are_left_out(found):
    few = residuals.Approach(
        found.robot,
        found.points,
        np.where(np.arange(120)[:, None] < 4, 1.0, 0.0) * np.ones(6),
        found.terms,
        found.angle,
    )
    assert few.by_angle(0, 1.0).shape == (0, 3)
