"""Options of public functions: choices are checked in Python as on the command line, and old names still work."""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable, Sequence
from typing import ParamSpec, TypeVar

from irbcal.errors import OptionError

P = ParamSpec("P")
R = TypeVar("R")
T = TypeVar("T", bound=str)


def checked(parameter: str, found: str, choices: Sequence[T]) -> T:
    """The value of an option, if it is one of the choices.

    Raises
    ------
    OptionError
        If it is not; the sentence lists the choices.
    """
    for choice in choices:
        if choice == found:
            return choice
    raise OptionError.unknown(parameter, found, choices)


def renamed(**new_of_old: str) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Let a function take options by names that they had before, with a warning.

    Parameters
    ----------
    **new_of_old : str
        Former name of an option, and its name now.
    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        @functools.wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> R:
            for old in new_of_old.keys() & kwargs.keys():
                new = new_of_old[old]
                if new in kwargs:
                    raise OptionError(f"{old} is the former name of {new}: give one of them", parameter=old)
                warnings.warn(f"the option {old} is now called {new}", DeprecationWarning, stacklevel=2)
                kwargs[new] = kwargs.pop(old)
            return function(*args, **kwargs)

        return call

    return decorate
