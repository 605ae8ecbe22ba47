"""Upper bounds: how often they are too small, by draws from distributions whose figures are known."""

import numpy as np
import pytest
from scipy.stats import binom

from irbcal.validation.conformity import upper_bound

DRAWS = 400
SHAPES = {
    "Maxwell": lambda rng, size: np.linalg.norm(rng.standard_normal((*size, 3)), axis=-1),
    "exponential": lambda rng, size: rng.exponential(size=size),
    "Student": lambda rng, size: (
        np.linalg.norm(rng.standard_normal((*size, 3)), axis=-1) / np.sqrt(rng.chisquare(5, size) / 5)
    ),
    "by position": lambda rng, size: (
        0.1 * np.linalg.norm(rng.standard_normal((*size, 3)), axis=-1) + 0.3 + 0.7 * rng.random(size) ** 4
    ),
}
FIGURES = {
    "mean3sigma": lambda d: d.mean() + 3 * d.std(ddof=1),
    "max": np.max,
    "percentile": lambda d: np.percentile(d, 95),
}
TRUE = FIGURES | {"max": lambda d: np.percentile(d, 99)}


@pytest.mark.parametrize("n", [10, 30, 100])
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("rule", FIGURES)
def test_a_robot_beyond_the_tolerance_passes_in_at_most_one_draw_of_twenty(rule, shape, n):
    rng = np.random.default_rng(4)
    tolerance = 0.95 * TRUE[rule](SHAPES[shape](rng, (400_000,)))
    draws = SHAPES[shape](rng, (DRAWS, n))
    passed = sum(upper_bound(rule, FIGURES[rule](d), d, np.arange(n))[0] <= tolerance for d in draws)
    assert passed <= binom.ppf(0.999, DRAWS, 0.05)


@pytest.mark.parametrize(("rule", "enough"), [("percentile", 59), ("max", 299)])
def test_enough_places_need_no_model(rule, enough):
    d = np.random.default_rng(1).random(enough)
    bound, basis = upper_bound(rule, FIGURES[rule](d), d, np.arange(enough))
    assert bound == d.max()
    assert "whatever the distribution" in basis
    bound, basis = upper_bound(rule, FIGURES[rule](d[:-1]), d[:-1], np.arange(enough - 1))
    assert bound > d[:-1].max()
    assert "exponential" in basis


def test_errors_of_one_place_count_once():
    d = np.random.default_rng(2).random(20)
    for rule, figure in FIGURES.items():
        alone = upper_bound(rule, figure(d), d, np.arange(20))[0]
        again = upper_bound(rule, figure(d), np.tile(d, 5), np.tile(np.arange(20), 5))[0]
        assert again == pytest.approx(alone, rel=1e-12)
