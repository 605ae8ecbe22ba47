"""The error model as a sum of terms: one module a family, `TermMap` adds them up.

A new family is a new module here with a `irbcal.modeling.terms.term.Family` called ``FAMILY``: kinematics,
inverse and files know it then. `irbcal.identification.term_sets` says what it is compared with.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from typing import TypeVar

from irbcal.errors import RobotError
from irbcal.modeling.terms.term import Basis, Family, Input

T = TypeVar("T")


@cache
def families() -> dict[str, Family]:
    """All families by name."""
    modules = [import_module(f"{__name__}.{info.name}") for info in iter_modules(__path__)]
    registered = [module.FAMILY for module in modules if hasattr(module, "FAMILY")]
    return {family.name: family for family in registered}


def family_in_words(name: str) -> str:
    """What people read of a family, also of one that is not in this package."""
    family = families().get(name)
    return (family and family.title) or name.replace("_", "-")


@cache
def bases() -> dict[str, Basis]:
    """All bases by name."""
    return {basis.name: basis for family in families().values() for basis in family.bases}


@cache
def inputs() -> dict[str, Input]:
    """What terms are functions of beside the joints, by name."""
    return {quantity.name: quantity for family in families().values() for quantity in family.inputs}


def given_inputs(values: Mapping[str, T | None]) -> dict[str, T]:
    """Inputs that are given by their names, without those that are None.

    Raises
    ------
    RobotError
        If there is none of such a name.
    """
    unknown = sorted(set(values) - set(inputs()))
    if unknown:
        raise RobotError(f"unknown input {unknown[0]!r}: there are {', '.join(inputs())}", parameter=unknown[0])
    return {name: value for name, value in values.items() if value is not None}
