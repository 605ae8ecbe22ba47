"""Results with DataFrames that nobody can change from outside."""

from dataclasses import fields
from typing import TYPE_CHECKING, Any

import pandas as pd

DEEP = int(pd.__version__.partition(".")[0]) < 3
"""Whether `shared` copies: from pandas 3 on a table gets content of its own when it is written to."""


class OwnTables:
    """Base of frozen dataclasses that keep DataFrames of their own: every access to such a field hands out a copy.

    ``dataclasses.replace``, ``pickle`` and ``copy`` work as with any other dataclass. Fields of tables have no default.
    """

    def __post_init__(self) -> None:
        tables: dict[str, Any] = {}
        for field in fields(self):  # type: ignore[arg-type]  # those who inherit are dataclasses
            if isinstance(self.__dict__[field.name], pd.DataFrame):
                tables[field.name] = self.__dict__.pop(field.name).copy()
        self.__dict__["_own"] = tables

    if not TYPE_CHECKING:  # the fields are declared by those who inherit

        def __getattr__(self, name: str) -> pd.DataFrame:
            """Tables are kept under another name, so each access to one ends here."""
            tables = self.__dict__.get("_own", {})
            if name in tables:
                return tables[name].copy()
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")


def shared(holder: OwnTables, name: str = "table") -> pd.DataFrame:
    """A table for reading only: a long one need not stand in memory twice."""
    table: pd.DataFrame = holder.__dict__["_own"][name]
    return table.copy(deep=DEEP)
