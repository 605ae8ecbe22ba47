"""What frozen dataclasses hold cannot be written to."""

import pickle
from dataclasses import dataclass

import numpy as np
import pytest

from irbcal.arrays import FloatArray, Locked, LockedDict, group_means, handed_on, lock, locked, row_arithmetic


@dataclass(frozen=True, eq=False)
class Held:
    array: np.ndarray
    named: dict
    several: list

    def __post_init__(self):
        lock(self)


def test_arrays_are_copied_and_locked_wherever_they_are():
    mine = np.zeros(3)
    held = Held(mine, {"a": mine}, [mine, 1])
    mine[:] = 7.0
    for array in (held.array, held.named["a"], held.several[0]):
        assert array.tolist() == [0.0, 0.0, 0.0]
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    assert isinstance(held.several, tuple)


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d.__setitem__("a", 1),
        lambda d: d.__delitem__("a"),
        lambda d: d.pop("a"),
        lambda d: d.update(b=1),
        lambda d: d.clear(),
        lambda d: d.setdefault("b", 1),
        lambda d: d.popitem(),
        lambda d: d.__ior__({"b": 1}),
    ],
)
def test_dicts_refuse_changes(change):
    held = LockedDict({"a": 0})
    with pytest.raises(TypeError, match="cannot be changed"):
        change(held)
    assert dict(held) == {"a": 0}


def test_locked_dicts_are_pickled():
    copy = pickle.loads(pickle.dumps(LockedDict({"a": np.arange(2)})))
    assert isinstance(copy, LockedDict)
    assert copy["a"].tolist() == [0, 1]


def test_a_view_of_a_writable_array_is_copied_and_a_locked_one_is_not():
    base = np.arange(4.0)
    view = base[:2]
    view.setflags(write=False)
    kept = locked(view)
    base[0] = 9.0
    assert kept[0] == 0.0
    once = locked(base)
    assert locked(once) is once
    part = once[:2]
    assert locked(part) is part


def test_arrays_that_nobody_else_has_are_locked_without_a_copy():
    array = np.ones((3, 333))
    assert locked(array) is not array
    given = handed_on(array)
    assert locked(given) is given is array
    with pytest.raises(ValueError, match="read-only"):
        array[...] = 2.0


def test_row_arithmetic_ends_with_its_block():
    size = np.getbufsize()
    with row_arithmetic():
        assert np.getbufsize() == 16
    assert np.getbufsize() == size


def test_results_are_locked_by_their_base():
    @dataclass(frozen=True, eq=False)
    class Shift(Locked):
        vector: FloatArray
        names: list[str]

    given = np.zeros(3)
    shift = Shift(given, ["x"])
    with pytest.raises(ValueError, match="read-only"):
        shift.vector[0] = 1.0
    given[0] = 1.0
    assert shift.vector[0] == 0.0
    assert shift.names == ("x",)


@pytest.mark.parametrize("shape", [(), (3,), (2, 3)])
def test_means_of_groups_are_those_of_their_rows(shape):
    values = np.random.default_rng(1).normal(size=(20, *shape))
    group = np.array([4, *[0, 2] * 9, 2])
    means = group_means(values, group, 7)
    assert means.shape == (7, *shape)
    for k in range(7):
        expected = values[group == k].mean(axis=0) if k in (0, 2, 4) else np.zeros(shape)
        assert np.abs(means[k] - expected).max() < 1e-12
