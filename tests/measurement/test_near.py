"""Few are searched as many are."""

import numpy as np
import pytest

from irbcal.measurement import near


@pytest.fixture
def both(monkeypatch):
    def run(function, *arguments, **options):
        few = function(*arguments, **options)
        monkeypatch.setattr(near, "FEW", 0)
        many = function(*arguments, **options)
        monkeypatch.undo()
        return few, many

    return run


@pytest.mark.parametrize("radius", [0.02, 0.1, 0.5])
def test_pairs(both, radius):
    x = np.random.default_rng(5).uniform(size=(120, 3))
    few, many = both(near.pairs, x, radius)
    assert {tuple(sorted(pair)) for pair in few} == {tuple(sorted(pair)) for pair in many}
    assert len(few) > 0 or radius < 0.1


def test_rows_within_reach_up_to_full_periods(both):
    rng = np.random.default_rng(7)
    period = np.array([40.0, 0.0, 25.0])
    x, y = rng.uniform(-60.0, 60.0, (150, 3)), rng.uniform(-60.0, 60.0, (400, 3))
    x[:20] = y[:20] + rng.uniform(-0.9, 0.9, (20, 3)) + rng.integers(-2, 3, (20, 3)) * period
    few, many = both(near.within, x, y, period)
    assert np.array_equal(few, many)
    assert few[:20].all()
    assert not few[20:].all()


def test_parts(both):
    rng = np.random.default_rng(6)
    for edges in (
        np.zeros((0, 2), dtype=int),
        rng.integers(0, 60, (40, 2)),
        np.column_stack([np.arange(59, 0, -1), np.arange(58, -1, -1)]),
    ):
        few, many = both(near.connected, 60, edges)
        assert len(np.unique(few)) == len(np.unique(many)) == len(np.unique(np.column_stack([few, many]), axis=0))
