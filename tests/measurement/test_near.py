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
def test_pairs_and_nearest(both, radius):
    rng = np.random.default_rng(5)
    x, y = rng.uniform(size=(120, 3)), rng.uniform(size=(90, 3))
    few, many = both(near.pairs, x, radius)
    assert {tuple(sorted(pair)) for pair in few} == {tuple(sorted(pair)) for pair in many}
    assert len(few) > 0 or radius < 0.1
    for p in (2.0, np.inf):
        few, many = both(near.nearest, x, y, radius, p=p)
        assert np.array_equal(few, many)
    assert np.array_equal(near.nearest(x, y[:0], radius), np.full(120, -1))


@pytest.mark.parametrize("radius", [0.02, 0.3])
def test_pairs_between_two_tables_are_those_of_all_rows(radius, monkeypatch):
    rng = np.random.default_rng(7)
    x, y = np.round(rng.uniform(size=(80, 3)), 1), rng.uniform(size=(60, 3))
    expected = np.argwhere((np.abs(x[:, None] - y) < radius).all(axis=2))
    found = near.between(x, y, radius)
    assert {tuple(pair) for pair in found} == {tuple(pair) for pair in expected}
    assert len(near.between(x, y[:0], radius)) == len(near.between(x[:0], y, radius)) == 0
    monkeypatch.setattr(near, "NEIGHBOURS", 0)
    assert near.between(x, y, 0.3) is None, "a tree is quicker"


def test_parts(both):
    rng = np.random.default_rng(6)
    for edges in (
        np.zeros((0, 2), dtype=int),
        rng.integers(0, 60, (40, 2)),
        np.column_stack([np.arange(59, 0, -1), np.arange(58, -1, -1)]),
    ):
        few, many = both(near.connected, 60, edges)
        assert len(np.unique(few)) == len(np.unique(many)) == len(np.unique(np.column_stack([few, many]), axis=0))
