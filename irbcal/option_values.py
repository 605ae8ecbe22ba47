"""Options of public functions: checked in Python as on the command line, one sentence each."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeVar, overload

from irbcal.errors import OptionError

if TYPE_CHECKING:
    from irbcal.arrays import FloatArray

T = TypeVar("T", bound=str)

Progress: TypeAlias = Callable[[str], object]
"""Called with a short text at the beginning of each step."""

LARGEST_PLACE = 100.0
"""Metres; a larger place or length in a robot cell is meant in millimetres."""
MOST_POSES = 100_000
"""Poses that can be asked for at a time."""


def checked(parameter: str, value: str, choices: Sequence[T]) -> T:
    """The value of an option, if it is one of the choices.

    Raises
    ------
    OptionError
        If it is not; the sentence lists the choices.
    """
    for choice in choices:
        if choice == value:
            return choice
    raise OptionError.unknown(parameter, value, choices)


@overload
def number(
    parameter: str,
    value: Any,
    low: float | None = None,
    high: float | None = None,
    whole: Literal[False] = False,
    example: str = "",
) -> float: ...


@overload
def number(parameter: str, value: Any, low: float | None = None, high: float | None = None, *, whole: bool) -> int: ...


def number(
    parameter: str,
    value: Any,
    low: float | None = None,
    high: float | None = None,
    whole: bool = False,
    example: str = "",
) -> float:
    """The value of an option that is a number.

    Parameters
    ----------
    parameter : str
        Name of the option.
    value
        What was given.
    low, high : float, optional
        The smallest and the largest number that make sense.
    whole : bool
        Whether only whole numbers do.
    example : str
        What helps who gave it in Python, such as what a millimetre is.

    Raises
    ------
    OptionError
        If it is no such number; texts are none.
    """
    if (
        _is_number(value)
        and (low is None or value >= low)
        and (high is None or value <= high)
        and (not whole or value == int(value))
    ):
        return int(value) if whole else float(value)
    raise OutOfRange(parameter, value, low, high, whole, example)


class OutOfRange(OptionError):
    """An option that takes a number has another value."""

    def __init__(
        self, parameter: str, value: Any, low: float | None, high: float | None, whole: bool, example: str = ""
    ) -> None:
        self.value, self.low, self.high, self.whole, self.example = value, low, high, whole, example
        help_in_python = f" ({example})" if example else ""
        super().__init__(f"{parameter}: {self.sentence(lambda number: number)}{help_in_python}", parameter=parameter)

    def __reduce__(self) -> tuple[type, tuple[Any, ...]]:
        return type(self), (self.parameter, self.value, self.low, self.high, self.whole, self.example)

    def sentence(self, typed: Callable[[float], float]) -> str:
        """What was expected and what was found, numbers as they are ``typed`` by whoever gave them."""
        low, high = (None if limit is None else f"{typed(limit):.10g}" for limit in (self.low, self.high))
        kind = "a whole number" if self.whole else "a number"
        if low is not None and high is not None:
            kind += f" from {low} to {high}"
        elif low is not None:
            kind += f" of at least {low}"
        elif high is not None:
            kind += f" of at most {high}"
        return f"expected {kind}, found {excerpt(typed(self.value) if _is_number(self.value) else self.value)}"


def seed(value: Any, parameter: str = "seed") -> int:
    """A seed of random numbers: a whole number, not negative.

    Raises
    ------
    OptionError
        If it is none.
    """
    return number(parameter, value, 0, whole=True)


def length(parameter: str, value: Any, low: float | None = None) -> float:
    """The value of an option that is a length in metres.

    Raises
    ------
    OptionError
        If it is no number, is below ``low``, or beyond `LARGEST_PLACE`: then it is meant in millimetres.
    """
    metres = number(parameter, value, low)
    _refuse_millimetres(parameter, metres)
    return metres


def point_in_metres(
    parameter: str, value: Any, expected: str = "x, y, z in metres", counts: Sequence[int] = (3,)
) -> FloatArray:
    """The value of an option that is a place, metres.

    Parameters
    ----------
    parameter : str
        Name of the option.
    value : array_like
        What was given: the place, and what else ``expected`` says.
    expected : str
        The expected numbers in words.
    counts : sequence of int
        How many numbers there may be.

    Returns
    -------
    ndarray, shape (n,)

    Raises
    ------
    OptionError
        If the numbers are others, or the place is beyond `LARGEST_PLACE`: then it is meant in millimetres.
    """
    import numpy as np

    try:
        numbers: FloatArray = np.asarray(value, dtype=float)
    except (TypeError, ValueError):
        numbers = np.zeros(0)
    if numbers.shape not in [(count,) for count in counts] or not np.isfinite(numbers).all():
        raise OptionError(f"{parameter}: expected {expected}, found {excerpt(value)}", parameter=parameter)
    _refuse_millimetres(parameter, *numbers[:3])
    return numbers


def names(parameter: str, value: Any) -> tuple[str, ...]:
    """The value of an option that is a sequence of names; one text is refused, for it is a sequence of letters.

    Raises
    ------
    OptionError
        If it is no sequence of names.
    """
    if isinstance(value, str):
        pieces = [piece.strip() for piece in value.split(",")]
        raise OptionError(
            f"{parameter}: expected a sequence of names, found one text: give {excerpt(pieces)}", parameter=parameter
        )
    try:
        sequence = tuple(value)
    except TypeError:
        sequence = (None,)
    if not all(isinstance(name, str) for name in sequence):
        raise OptionError(f"{parameter}: expected a sequence of names, found {excerpt(value)}", parameter=parameter)
    return sequence


_LONGEST = 60


def _is_number(value: Any) -> bool:
    """Whether it is a finite real number, of Python or of numpy; truth values are none."""
    from numbers import Real

    return isinstance(value, Real) and type(value).__name__ not in ("bool", "bool_") and math.isfinite(value)


def excerpt(value: Any) -> str:
    """A value in a sentence: on one line, the beginning of a long one."""
    text = " ".join(repr(value).split())
    return text if len(text) <= _LONGEST else text[: _LONGEST - 1] + "…"


def _refuse_millimetres(parameter: str, *metres: float) -> None:
    largest = max(metres, key=abs)
    if abs(largest) > LARGEST_PLACE:
        raise OptionError(
            f"{parameter}: metres expected, at most {LARGEST_PLACE:g}, found {largest:g}: this looks like millimetres",
            parameter=parameter,
        )


def pulses_per_degree(pulses: Sequence[float] | None) -> tuple[float, ...]:
    """Pulses per degree of six joints from the caller; none where there are none.

    Raises
    ------
    OptionError
        If these are not six numbers of such a size.
    """
    if pulses is None:
        return ()
    try:
        values = [float(value) for value in pulses]
    except (TypeError, ValueError):
        values = []
    if len(values) != 6 or not all(1.0 < abs(value) < 1e6 for value in values):
        raise OptionError(
            f"pulses: expected six numbers of pulses per degree, found {excerpt(pulses)}", parameter="pulses"
        )
    return tuple(values)
