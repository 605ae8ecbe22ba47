"""The error model as a sum of terms: one module a family, `TermMap` adds them up.

A new family is a new module here with a `irbcal.modeling.terms.term.Family` called ``FAMILY``: kinematics,
inverse and files know it then. `irbcal.identification.term_sets` says what it is compared with.
"""

from __future__ import annotations

from functools import cache
from importlib import import_module
from pkgutil import iter_modules

from irbcal.modeling.terms.term import Basis, Family


@cache
def families() -> dict[str, Family]:
    """All families by name."""
    modules = [import_module(f"{__name__}.{info.name}") for info in iter_modules(__path__)]
    registered = [module.FAMILY for module in modules if hasattr(module, "FAMILY")]
    return {family.name: family for family in registered}


@cache
def bases() -> dict[str, Basis]:
    """All bases by name."""
    return {basis.name: basis for family in families().values() for basis in family.bases}
