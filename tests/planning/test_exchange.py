"""Chosen poses against exhaustive search and random plans."""

import itertools

import numpy as np
import pytest
from design_support import KINDS, TARGETS, poses, random_aim, random_candidates, without_errors
from support import arm

from irbcal.errors import MeasurementError
from irbcal.planning import optimal_design
from irbcal.planning.optimal_design import Aim, Candidates, Model


@KINDS
def test_gains_are_the_differences_of_the_criterion(kind):
    """After poses came and went, against the criterion computed anew."""
    candidates, aim = without_errors(random_candidates(25), kind), random_aim(kind)
    ratings = optimal_design._Ratings(candidates, np.arange(25), aim)
    for k, sign in ((3, 1), (7, 1), (1, 1), (7, -1), (11, 1), (3, -1), (20, 1)):
        ratings.change(k, sign)
    chosen = [1, 11, 20]
    now = aim.value(candidates.rows[chosen], candidates.errors[chosen])
    with_each = [aim.value(candidates.rows[[*chosen, k]], candidates.errors[[*chosen, k]]) for k in range(25)]
    assert ratings.gains() == pytest.approx(now - np.array(with_each), rel=1e-8, abs=1e-10)


@KINDS
def test_exchange_finds_nearly_what_exhaustive_search_finds(kind):
    for seed in range(6):
        candidates, aim = without_errors(random_candidates(14, seed=seed), kind), random_aim(kind, seed=seed)
        values = np.array(
            [
                aim.value(candidates.rows[list(rows)], candidates.errors[list(rows)])
                for rows in itertools.combinations(range(14), 5)
            ]
        )
        found = optimal_design.exchange(candidates, 5, aim)
        assert (values < found.value - 1e-12).mean() <= 0.005, "among the best half per cent of 2002 plans"
        assert len(set(found.rows)) == 5


@KINDS
def test_exchange_is_never_worse_than_its_start(kind):
    candidates, aim = without_errors(random_candidates(60, seed=3), kind), random_aim(kind)
    rng = np.random.default_rng(4)
    for _ in range(5):
        start = rng.choice(60, 12, replace=False)
        found = optimal_design.exchange(candidates, 12, aim, start)
        assert found.start_value == aim.value(candidates.rows[start], candidates.errors[start])
        assert found.value <= found.start_value
        assert found.value == pytest.approx(aim.value(candidates.rows[found.rows], candidates.errors[found.rows]))


def test_an_optimal_plan_predicts_better_than_random_ones_of_its_size():
    model = Model(arm(), TARGETS, "34")
    q, seen = poses(300, 21)
    candidates = model.candidates(q, seen)
    aim = model.aim("position", arm().random_joints(100, 22), 0)
    found = optimal_design.exchange(candidates, 25, aim)
    rng = np.random.default_rng(23)
    rivals = [rng.choice(300, 25, replace=False) for _ in range(20)]
    assert found.value < min(aim.value(candidates.rows[rows], candidates.errors[rows]) for rows in rivals)
    again = optimal_design.exchange(candidates, 25, aim)
    assert (again.rows == found.rows).all()


def test_random_plans_to_compare_with():
    """Poses of one row each that measure one unknown alike: the variance is 1 / (1 + 9 n), whatever poses they are."""
    candidates = Candidates.without_errors(np.full((200, 1, 1), 3.0))
    aim = Aim(0, np.eye(1), np.zeros((1, 0)))
    chosen = optimal_design.Chosen(np.arange(20), 1 / (1 + 9 * 50), 1.0, 0)  # as if 20 poses were as good as 50
    found = optimal_design.compare(candidates, chosen, aim)
    assert found.random == pytest.approx({n: 1 / (1 + 9 * n) for n in found.random})
    assert list(found.random) == [20, 25, 30, 40, 50, 60, 80, 120]
    assert found.as_good_as == 50
    assert (
        optimal_design.compare(candidates, optimal_design.Chosen(np.arange(20), 1e-9, 1.0, 0), aim).as_good_as is None
    )


def test_refusals():
    candidates = random_candidates(5)
    for count in (0, 6):
        with pytest.raises(MeasurementError, match=f"between 1 and 5 poses of as many candidates, found {count}"):
            optimal_design.exchange(candidates, count, random_aim("imagined"))
    with pytest.raises(MeasurementError, match="unknown criterion 'A': choose one of position, D"):
        Model(arm(), TARGETS, "11").aim("A")
