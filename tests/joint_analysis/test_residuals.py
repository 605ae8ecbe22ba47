"""Which terms joints need, from any poses: simulated truth many times over, and a real arm."""

from dataclasses import replace

import numpy as np
import pytest
from moving import SERIES, random_commands, refusal, simulated
from support import TARGETS, arm, measured

from irbcal.identification import linear_model
from irbcal.identification.evidence_maximisation import (
    GEOMETRY_CAP,
    VARIANCE_CAP,
    evidence_likelihood_power,
    evidence_of_each,
    maximise_evidence,
)
from irbcal.identification.linear_model import Linearisation
from irbcal.joint_analysis import behaviour
from irbcal.joint_analysis.residuals import analyse_residuals, needed_by_residuals, of_residuals
from irbcal.measurement import table
from irbcal.measurement.motions import last_moves
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms.direction import FAMILY as DIRECTION
from irbcal.modeling.terms.geometry import FAMILY as GEOMETRY
from irbcal.modeling.terms.situation import Motion


def analysed(case, *arguments, **options):
    """The analysis of simulated points from the nominal arm."""
    points, step, robot = case
    return analyse_residuals(robot.joint_map.terms.arm, points, step, *arguments, **options)


def keys(found):
    return [(term.kind, term.joint) for term in found.needed]


def test_worth_is_the_difference_of_two_fits():
    """Against a linear model that never had the term, and against the points that it moves."""
    play = np.radians([0.03, 0, 0, 0, 0, 0])
    points, step, robot = simulated(random_commands(30, 4), None, play, noise=1e-4, rng=np.random.default_rng(4))
    nominal, motion = robot.joint_map.terms.arm, Motion(points.q, np.nan_to_num(step))
    geometry, sides = GEOMETRY.terms(nominal), DIRECTION.terms(nominal)
    problem = linear_model.geometry_problem(nominal, points, geometry, None)
    state = linear_model.geometry_solution(problem, motion, geometry)

    def fitted(some):
        linear = Linearisation(problem, state, motion, [*geometry, *some])
        group = np.concatenate([np.zeros(len(geometry), dtype=int), 1 + np.arange(len(some))])
        caps = np.array([GEOMETRY_CAP, *[VARIANCE_CAP] * len(some)])
        sums = linear.sums()
        return (
            linear,
            sums,
            group,
            caps,
            maximise_evidence(sums, linear.nuisance, group, caps, evidence_likelihood_power(3.0)),
        )

    linear, sums, group, caps, found = fitted(sides)
    labels = [None] * len(geometry) + [term.joint for term in sides]
    worth = evidence_of_each(sums, found, linear.nuisance, labels, group, caps)
    assert list(worth) == list(range(6))
    shorter, *_, without = fitted(sides[1:])
    assert worth[0].evidence == pytest.approx(found.log_evidence - without.log_evidence, abs=0.05)
    J = np.concatenate([block.J for block in linear.blocks()], axis=1)
    K = np.concatenate([block.J for block in shorter.blocks()], axis=1)
    moved = np.sqrt(np.mean(np.sum((found.c @ J - without.c @ K).reshape(-1, 3) ** 2, axis=1)))
    assert 1e3 * worth[0].moves == pytest.approx(moved, rel=0.01)
    assert worth[0].evidence > 20 > 1 > worth[1].evidence


def test_refusals_are_one_sentence():
    points, step, robot = simulated(random_commands(20, 0))
    elsewhere = replace(points, xyz=np.random.default_rng(0).permutation(points.xyz))
    assert "irb1600_6_145" in refusal(analyse_residuals, robot.arm, elsewhere, step)
    few = points.select(np.arange(20) < 5)
    assert "5 poses are too few" in refusal(analyse_residuals, robot.arm, few, step[:5])
    assert refusal(analyse_residuals, robot.arm, points, step, 7) == "there is no joint 7: irb1600_6_145 has 6"


def test_backlash_and_stiffness_are_found_within_their_intervals():
    backlash = np.radians([0.02, 0.0, 0.015, 0.0, 0.02, 0.05])
    A, B = np.radians([0.043, 0.019])
    inside, stiff = [], []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        case = simulated(
            random_commands(70, seed), None, backlash, noise=5e-5, rng=rng, stiffness=(A, B), fourier=SERIES
        )
        found = analysed(case)
        inside += [term.low[0] < backlash[j - 1] < term.high[0] for j, term in found.by_joint("backlash").items()]
        term = found.by_joint("stiffness")[None]
        stiff += [low < value < high for value, low, high in zip((A, B), term.low, term.high, strict=True)]
        assert {("backlash", 1), ("backlash", 3), ("stiffness", None), ("fourier", 6)} <= set(keys(found))
        # an effect of the direction is not taken for one of the size of the moves
        assert not {kind for kind, _ in keys(found)} & {"move", "gain"}
    # 36 and 12 intervals of 95 %
    assert sum(inside) >= 31
    assert sum(stiff) >= 10


def test_clean_residuals_raise_no_alarm():
    for seed in range(4):
        found = analysed(simulated(random_commands(60, seed), noise=5e-5, rng=np.random.default_rng(seed)))
        assert found.needed == ()
        assert len(found.terms) == 6 + 6 + 6 + 6 + 1
        assert max(term.probability for term in found.terms) < 0.9


def test_a_lag_is_told_from_play():
    lag = np.array([5e-4, 0, 0, 0, 0, 0])
    found = analysed(simulated(random_commands(90, 2), per_move=lag, noise=5e-5, rng=np.random.default_rng(2)))
    term = found.by_joint("move")[1]
    assert term.low[0] < lag[0] < term.high[0]
    assert keys(found) == [("move", 1)]
    assert "a lag does" in " ".join(of_residuals(found, None))


def test_a_free_frequency_is_found_and_costs_its_search():
    case = simulated(random_commands(90, 2), noise=3e-5, rng=np.random.default_rng(2), fourier=SERIES)
    found = analysed(case, frequency=None)
    (frequency,) = found.by_joint("fourier")[6].frequency
    assert frequency == pytest.approx(1.0, abs=0.02)
    assert keys(found) == [("fourier", 6)]
    # what is not there costs the logarithm of the number of frequencies
    assert max(term.evidence for joint, term in found.by_joint("fourier").items() if joint != 6) < 0


@pytest.fixture(scope="module")
def irb120(shared_data):
    """A real IRB 120 in random poses, and the report on its joints."""
    seen = table.read(shared_data / "irb120_laser_tracker" / "measurements.csv")
    return seen, behaviour.analyse(seen, arm("irb120"))


def test_the_direction_of_approach_shows_on_a_real_arm(irb120):
    found = irb120[1].residuals
    # moves of joints 1 to 3 count, about alike, beside their directions
    lag = [found.by_joint("move")[j] for j in (1, 2, 3)]
    assert all(2e-4 < term.values[0] < 7e-4 and term.low[0] > 1e-4 and term.needed for term in lag)
    assert {("stiffness", None), ("move", 1)} <= set(keys(found))


def test_directions_of_other_poses_show_nothing_on_a_real_arm(irb120):
    found = irb120[1].residuals
    # the move that follows a pose cannot act on it
    step = np.r_[found.step[1:], found.step[:1]]
    wrong = analyse_residuals(arm("irb120"), found.points, step)
    assert not wrong.by_joint("backlash")[1].needed
    assert not wrong.by_joint("move")[1].needed


BACKLASH_4 = np.radians(0.03)


def hidden_backlash(seed=0):
    """A joint 4 with play and an uneven gear that is larger; returns the points and their last moves."""
    q = random_commands(70, seed)
    step = np.nan_to_num(last_moves(q))
    effective = q.copy()
    series = np.radians([0.03, 0.06, 0.05, -0.05])
    effective[:, 3] += np.column_stack([f(k * q[:, 3]) for k in (1, 2) for f in (np.cos, np.sin)]) @ series
    effective[:, 3] -= 0.5 * np.sign(step[:, 3]) * BACKLASH_4
    robot = Robot(arm("irb1600"), T_world_base=np.eye(4), targets=TARGETS)
    points = measured(robot, effective, 3e-5, np.random.default_rng(seed))
    return replace(points, q=q), last_moves(q)


def test_a_larger_term_hides_no_other():
    found = analyse_residuals(arm("irb1600"), *hidden_backlash())
    assert keys(found) == [("fourier", 4), ("backlash", 4)]
    term = found.by_joint("backlash")[4]
    assert term.low[0] < BACKLASH_4 < term.high[0]
    assert "backlash of joint 4" in needed_by_residuals(found)


PLAY = np.radians([0.04, 0, 0, 0, 0, 0])


@pytest.fixture(scope="module")
def found():
    return analysed(simulated(random_commands(120, 0), None, PLAY, noise=3e-5, rng=np.random.default_rng(0)))


def test_the_step_between_directions_is_the_backlash(found):
    first = found.terms[0]
    assert first.low[0] < PLAY[0] < first.high[0]
    below, above = found.by_angle(0, 1.0), found.by_angle(0, -1.0)
    assert np.average(above[:, 1]) - np.average(below[:, 1]) == pytest.approx(PLAY[0], rel=0.2)
    assert (below[:, 2] < 0.2 * PLAY[0]).all()
    assert (np.diff(below[:, 0]) > 0).all()
    assert "backlash of joint 1" in repr(found)


def test_small_bins_are_left_out(found):
    few = replace(found, step=np.where(np.arange(120)[:, None] < 4, found.step, 0.0))
    assert few.by_angle(0, 1.0).shape == (0, 3)


def test_an_arm_that_bends_otherwise_has_gravity_at_each_joint():
    panda = arm("panda")
    q = panda.random_joints(60, 0)
    robot = Robot(panda, T_world_base=np.eye(4), targets=TARGETS)
    found = analyse_residuals(panda, measured(robot, q, 3e-5, np.random.default_rng(0)), last_moves(q))
    assert found.by_joint("stiffness") == {}
    assert {2, 4} <= set(found.by_joint("gravity"))
    assert found.needed == ()
