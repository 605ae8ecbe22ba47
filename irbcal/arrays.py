"""Arrays: names of their types, and the lock of the frozen dataclasses that hold them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, KeysView, Mapping
from contextlib import contextmanager
from dataclasses import fields, is_dataclass
from datetime import date
from functools import cache
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, NoReturn, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from typing_extensions import Self

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]
BoolArray: TypeAlias = NDArray[np.bool_]
NameArray: TypeAlias = NDArray[np.object_]
"""Names (str) in an array of objects."""

K = TypeVar("K")
V = TypeVar("V")
S = TypeVar("S", bound=np.generic)


@contextmanager
def row_arithmetic() -> Iterator[None]:
    """Arithmetic on rows of numbers of one type without buffers.

    numpy copies rows that are shorter than its buffer through it before it broadcasts them or strides over them, which
    takes two to four times as long as the arithmetic. The setting ends with the block, and is this thread's own.
    """
    with np.errstate():
        np.setbufsize(16)
        yield


def handed_on(array: NDArray[S]) -> NDArray[S]:
    """An array that nobody else has, read-only with all it is a part of: `lock` takes it without a copy."""
    owner: Any = array
    while isinstance(owner, np.ndarray):
        owner.setflags(write=False)
        owner = owner.base
    return array


def coded(names: Iterable[K]) -> tuple[IntArray, list[K]]:
    """Number of each name, from 0 in the order in which they are first seen, and the different names."""
    number: dict[K, int] = {}
    if isinstance(names, np.ndarray):
        names = names.tolist()
    return np.array([number.setdefault(name, len(number)) for name in names], dtype=int), list(number)


def group_means(values: FloatArray, group: IntArray, groups: int = 0) -> FloatArray:
    """Means of the rows of each group, shape (groups, ...); zero where it has none.

    Parameters
    ----------
    values : ndarray, shape (m, ...)
    group : ndarray of int, shape (m,)
        From 0.
    groups : int
        How many there are at least.
    """
    count = np.maximum(np.bincount(group, minlength=groups), 1)
    columns = values.reshape(len(values), math.prod(values.shape[1:])).T
    means = np.stack([np.bincount(group, column, len(count)) / count for column in columns], axis=-1)
    return means.reshape(len(count), *values.shape[1:])


def rms(values: FloatArray) -> float:
    """Root mean square."""
    return float(np.sqrt(np.mean(values**2)))


def evenly_chosen(n: int, count: int) -> BoolArray:
    """Mask of so many of n rows, evenly chosen, the first and the last among them."""
    chosen = np.zeros(n, dtype=bool)
    chosen[np.linspace(0, n - 1, count).astype(int)] = True
    return chosen


def smallest(values: FloatArray, share: float) -> BoolArray:
    """Which values are at most the quantile ``share`` of all: ``values <= np.quantile(values, share)``, but quicker."""
    rank = int(share * (len(values) - 1))
    return np.asarray(values <= np.partition(values, rank)[rank])


def consecutive(labels: ArrayLike) -> IntArray:
    """Numbers from 0, equal ones for equal labels, shape (m,); whole numbers in order need no sorting."""
    values = np.asarray(labels).ravel()
    if values.dtype.kind in "iu" and len(values) and (values[1:] >= values[:-1]).all():
        numbers = np.zeros(len(values), dtype=np.int64)
        np.cumsum(values[1:] != values[:-1], out=numbers[1:])
        return numbers
    return np.asarray(np.unique(values, return_inverse=True)[1].ravel(), dtype=np.int64)


class LockedDict(dict[K, V]):
    """A dict that cannot be changed; it is pickled and written as JSON like any other."""

    def _refuse(self, *_: Any, **__: Any) -> NoReturn:
        raise TypeError("this dict belongs to a result that cannot be changed: make a new one with dataclasses.replace")

    __setitem__ = __delitem__ = __ior__ = _refuse
    clear = pop = popitem = setdefault = update = _refuse

    def __reduce__(self) -> tuple[type, tuple[dict[K, V]]]:
        return LockedDict, (dict(self),)


_PLAIN = frozenset({int, float, str, bytes, bool, tuple, type(None)})


def locked(value: Any) -> Any:
    """The value with all arrays in it copied and read-only: arrays, dicts (made `LockedDict`), lists (made tuples).

    An array that nobody can write to any more is taken as it is.
    """
    if type(value) in _PLAIN:
        return value
    if isinstance(value, np.ndarray):
        if _is_locked(value):
            return value
        value = value.copy()
        value.setflags(write=False)
        return value
    if isinstance(value, LockedDict):
        return value
    if isinstance(value, Mapping):
        return LockedDict({key: locked(element) for key, element in value.items()})
    if isinstance(value, list):
        return tuple(locked(element) for element in value)
    return value


def plain(value: Any) -> Any:
    """A value as JSON has it.

    Arrays and tuples are lists, numbers of Python's types, None those that are not finite, paths and dates texts;
    tables are lists of rows, results what their ``to_dict`` gives, other models and dataclasses their fields by name.
    """
    if value is None or isinstance(value, (str, int)):
        return value
    if isinstance(value, np.ndarray):
        if value.dtype.kind != "f" or np.isfinite(value).all():
            return value.tolist()
        values = value.astype(object)
        values[~np.isfinite(value)] = None
        return values.tolist()
    if hasattr(value, "itertuples"):
        return plain(value.to_dict(orient="records"))
    for speaks in ("to_dict", "model_dump", "_asdict"):
        if hasattr(value, speaks):
            return plain(getattr(value, speaks)())
    if is_dataclass(value):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, (PurePath, date)):
        return str(value)
    if isinstance(value, Mapping):
        return {key: plain(element) for key, element in value.items()}
    if isinstance(value, (list, tuple, KeysView)):
        return [plain(element) for element in value]
    value = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _is_locked(array: NDArray[Any]) -> bool:
    owner: Any = array
    while owner is not None:
        if not isinstance(owner, np.ndarray) or owner.flags.writeable:
            return False
        owner = owner.base
    return True


class Locked:
    """Base of frozen dataclasses whose arrays, dicts and lists nobody can change: see `locked`."""

    __slots__ = ()

    def __post_init__(self) -> None:
        lock(self)

    @classmethod
    def of_new(cls, **values: Any) -> Self:
        """An instance of arrays that nobody else has and that are read-only, without the search for others."""
        instance = object.__new__(cls)
        instance.__dict__.update(values)
        return instance


def lock(instance: Any) -> None:
    """Lock all fields of a frozen dataclass: to be called at the end of its ``__post_init__``, where it has one."""
    for name in field_names(type(instance)):  # type: ignore[arg-type]
        value = getattr(instance, name)
        kind = type(value)
        if kind in _PLAIN or (kind is np.ndarray and value.base is None and not value.flags.writeable):
            continue
        if (new := locked(value)) is not value:
            object.__setattr__(instance, name, new)


@cache
def field_names(kind: type) -> tuple[str, ...]:
    """Names of the fields of a dataclass."""
    return tuple(field.name for field in fields(kind))
