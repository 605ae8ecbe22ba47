"""An example file and the line that tries it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from irbcal.names import without_formulas

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Sample:
    """An example file.

    Attributes
    ----------
    path : str
        In the folder of the samples, with slashes.
    content : bytes
    about : str
        What it is, in a few words.
    tried : str
        A command that reads it, as typed in that folder; empty where another file's command reads this one, too.
    """

    path: str
    content: bytes
    about: str
    tried: str = ""


def csv(table: pd.DataFrame, **options: object) -> bytes:
    """A table as CSV with line feeds; options as of pandas."""
    return without_formulas(table).to_csv(index=False, lineterminator="\n", **options).encode("utf-8")
