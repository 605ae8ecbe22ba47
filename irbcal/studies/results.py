"""The rows of a study by what they say, and tables of them with the thesis's figures beside."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

from irbcal import summary
from irbcal.studies.settings import AREAS, AXES, FULL, NOMINAL, PAYLOADS, SMALL, Repetition, Settings
from irbcal.summary import Speaks, Told

if TYPE_CHECKING:
    import pandas as pd

AREA_NAMES = {"iso_cube": "ISO cube", "all_range": "all range"}
STATISTICS = ("mean", "sigma", "max", "mean_plus_3sigma")
SYMBOLS = ("μ", "σ", "max", "μ+3σ")
KIND_NAMES = {"expected": "expected", "verified": "found", "verified_all": "found"}
MODEL_NAMES = {"nominal": "nominal", "11": "11 parameters", "axes": "kinematic", "34": "34 parameters"}
COMPARED = {"nominal": NOMINAL, "11": SMALL, "axes": AXES[18], "34": FULL}
"""The models of Nubiola 2011, Table 7.8 and Table 7.9."""


@dataclass(frozen=True)
class Cell:
    """A number of a study and the thesis's beside it; None where there is none."""

    value: float
    thesis: float | None = None
    digits: int = 3

    @property
    def number(self) -> str:
        """The study's number as text."""
        return f"{self.value:.{self.digits}f}"

    @property
    def beside(self) -> str:
        """The thesis's number as text; empty where there is none."""
        return "" if self.thesis is None else f"{self.thesis:.{self.digits}f}"

    def __str__(self) -> str:
        return f"{self.number} ({self.beside})" if self.beside else self.number


Value: TypeAlias = "str | int | Cell"
"""What stands in a table."""


@dataclass(frozen=True, repr=False)
class Table(Speaks):
    """A table ready to print.

    Attributes
    ----------
    key : str
        ``7.1`` and so on; a word for tables that the thesis has not.
    title : str
    columns : tuple of str
        Headings.
    rows : tuple of tuple
        Text, whole numbers and `Cell`.
    notes : tuple of str
    """

    key: str
    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Value, ...], ...]
    notes: tuple[str, ...] = ()

    @property
    def heading(self) -> str:
        """Number and title."""
        return f"Table {self.key}. {self.title}" if self.key[0].isdigit() else self.title

    def told(self) -> Sequence[Told]:
        """The table with the thesis's figures in brackets, and its notes."""
        title = f"SIMULATED (in brackets: the thesis, a real robot). {self.heading}"
        rows = tuple(tuple(value if isinstance(value, int) else str(value) for value in row) for row in self.rows)
        return [summary.Table(title, self.columns, rows), *self.notes]

    def headline(self) -> str:
        """Its heading and size."""
        return f"SIMULATED. {self.heading}: {len(self.rows)} rows"

    def to_frame(self) -> pd.DataFrame:
        """The rows; beside each column of numbers, the thesis's as ``… (thesis)`` where there are any."""
        import pandas as pd

        out: dict[str, list[Any]] = {}
        for k, name in enumerate(self.columns):
            values = [row[k] for row in self.rows]
            out[name] = [value.value if isinstance(value, Cell) else value for value in values]
            beside = [value.thesis if isinstance(value, Cell) else None for value in values]
            if any(value is not None for value in beside):
                out[f"{name} (thesis)"] = beside
        return pd.DataFrame(out)

    def to_dict(self) -> dict[str, Any]:
        """As JSON has it."""
        rows = [
            [{"value": v.value, "thesis": v.thesis} if isinstance(v, Cell) else v for v in row] for row in self.rows
        ]
        return {"title": self.title, "columns": list(self.columns), "rows": rows, "notes": list(self.notes)}


class Results:
    """The rows of a study by what they say.

    Parameters
    ----------
    frame : DataFrame
        As ``results.csv``.
    settings : Settings
    """

    def __init__(self, frame: pd.DataFrame, settings: Settings) -> None:
        self.frame, self.settings = frame, settings
        keys = ["repetition", "kind", "area", "payload_kg", "targets", "quantity"]
        first = frame.drop_duplicates(keys)  # the method of the settings comes first
        self.rows: dict[tuple[Any, ...], dict[str, Any]] = first.set_index(keys).to_dict("index")
        second = frame[frame.duplicated(keys)].drop_duplicates(keys)
        self.least_squares: dict[tuple[Any, ...], dict[str, Any]] = second.set_index(keys).to_dict("index")

    def has(self, *repetitions: Repetition) -> bool:
        """Whether these repetitions are done."""
        done = set(self.frame["repetition"])
        return all(r.name in done for r in repetitions)

    def row(
        self,
        repetition: Repetition,
        kind: str,
        area: str,
        load: int = PAYLOADS[0],
        targets: str | None = None,
        quantity: str = "point",
        least_squares: bool = False,
    ) -> dict[str, Any]:
        """One row as a dict."""
        if targets is None:
            targets = "1-3" if kind in ("poses", "iso9283") else "1-8"
        rows = self.least_squares if least_squares else self.rows
        return rows[repetition.name, kind, area, load, targets, quantity]

    def cells(
        self, thesis: Sequence[float] | None, *query: Any, names: Sequence[str] = STATISTICS, **options: Any
    ) -> list[Cell]:
        """Statistics of a row beside the thesis's; query and options as `row`."""
        found = self.row(*query, **options)
        known: Sequence[float | None] = thesis or (None,) * len(names)
        return [Cell(found[name], beside) for name, beside in zip(names, known, strict=True)]

    def worst(self, repetition: Repetition, least_squares: bool = False) -> tuple[float, ...]:
        """Largest expected error in the ISO cube and in the whole range, 3 kg."""
        return tuple(self.row(repetition, "expected", area, least_squares=least_squares)["max"] for area in AREAS)
