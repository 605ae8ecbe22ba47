"""Calls of public functions: missing and wrong arguments are refused in one sentence.

What a function can say best itself (of numbers, choices, joints, and whatever names a robot) it checks itself.
"""

from __future__ import annotations

import functools
import inspect
import os
from abc import ABC
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from difflib import get_close_matches
from itertools import chain, repeat
from pathlib import Path
from types import UnionType
from typing import Any, ParamSpec, TypeVar, Union, get_args, get_origin

from irbcal.declared_options import texts_of
from irbcal.errors import OptionError
from irbcal.option_values import excerpt

P = ParamSpec("P")
R = TypeVar("R")


class Several(ABC):  # noqa: B024
    """What holds several objects; tables, whose objects are their headings, are none."""

    @classmethod
    def __subclasshook__(cls, other: type) -> bool:
        return hasattr(other, "__iter__") and not hasattr(other, "columns")


TAKEN: dict[Any, type] = {Path: os.PathLike, Sequence: Several, Mapping: Several}
"""What may be given for some types: more than they say."""
PLAIN = (str, os.PathLike, type(None))
"""Types of Python that are checked, beside classes of irbcal."""


def refusing_wrong_calls(function: Callable[P, R]) -> Callable[P, R]:
    """A public function that refuses arguments of other types and names than its signature declares.

    A good call takes a microsecond more: names are compared only where Python refuses the call.
    """
    parameters = inspect.signature(function).parameters
    positional = [item.name for item in parameters.values() if item.kind is not item.KEYWORD_ONLY]
    rest = [item.name for item in parameters.values() if item.kind is item.VAR_POSITIONAL]
    types = _types(function)

    @functools.wraps(function)
    def call(*args: P.args, **options: P.kwargs) -> R:
        names = chain(positional, repeat(*rest)) if rest else positional
        for name, value in (*zip(names, args, strict=False), *options.items()):
            if name in types and not isinstance(value, types[name]):
                words = f"{name}: expected {_kind(function, name)}, found {excerpt(value)}"
                raise OptionError(words, parameter=name)
        try:
            return function(*args, **options)
        except TypeError:
            _refuse_names(call, args, options)
            raise

    return call


def _types(function: Callable[..., Any]) -> dict[str, tuple[type, ...]]:
    """Types of the parameters whose annotation says all: paths, texts, classes of irbcal, and several of anything."""
    out, names = {}, inspect.unwrap(function).__globals__
    for name, parameter in inspect.signature(function).parameters.items():
        with suppress(NameError, TypeError):  # of names that are imported for types alone, or stand for a text
            kind = eval(parameter.annotation, names)
            parts = get_args(kind) if get_origin(kind) in (Union, UnionType) else (kind,)
            plain = [TAKEN.get(get_origin(part) or part, get_origin(part) or part) for part in parts]
            if all(map(_is_checked, plain)):
                out[name] = (*plain, type(parameter.default))
    return out


def _is_checked(kind: Any) -> bool:
    is_class = isinstance(kind, type) and not getattr(kind, "_is_protocol", False)
    return kind in PLAIN or (is_class and kind.__module__.startswith("irbcal."))


def _kind(function: Callable[..., Any], name: str) -> str:
    """What a parameter takes, in words of the docstring."""
    kind, _ = dict(texts_of(inspect.getdoc(function) or "")).get(name, ("", ""))
    kind = (kind or str(inspect.signature(function).parameters[name].annotation)).removesuffix(", optional")
    return kind.replace(" | None", "").replace(" | ", " or ")


def _refuse_names(function: Callable[..., Any], args: Sequence[Any], options: Mapping[str, Any]) -> None:
    """Refuse a call that lacks an argument, or has one that the function does not know."""
    signature, called = inspect.signature(function), function.__name__
    for name in options:
        if name not in signature.parameters:
            near = get_close_matches(name, signature.parameters, n=1)
            hint = f"did you mean {near[0]}?" if near else f"help(irbcal.{called}) lists them"
            raise OptionError(f"{called}: there is no argument {name}: {hint}", parameter=name)
    with suppress(TypeError):  # of more arguments than there are: Python says how many
        given = signature.bind_partial(*args, **options).arguments
        for name, parameter in signature.parameters.items():
            needed = parameter.default is parameter.empty and parameter.kind is not parameter.VAR_POSITIONAL
            if needed and name not in given:
                words = f"{called}: {name} is missing ({_kind(function, name)}): help(irbcal.{called}) says what it is"
                raise OptionError(words, parameter=name)
