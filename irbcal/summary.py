"""Results that speak: a short text for the interpreter, tables for the terminal and for notebooks."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from io import StringIO
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    import rich.table

Cell: TypeAlias = "str | float | int | None"

WIDTH = 110
"""Columns of text of a summary."""

LONGEST_REPR = 1_500
"""Characters of the text that the interpreter shows."""


@dataclass(frozen=True)
class Table:
    """A table for people.

    Attributes
    ----------
    title : str
    columns : tuple of str
        Headings; the first columns up to the first number stand on the left, the others on the right.
    rows : tuple of tuple
        Text as it is; numbers with ``digits`` decimals; None as a dash.
    digits : int
    bold : frozenset of int
        Rows that are headlines.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    digits: int = 3
    bold: frozenset[int] = frozenset()

    def cells(self) -> list[list[str]]:
        """The rows as text."""
        return [[self._text(cell) for cell in row] for row in self.rows]

    def _text(self, cell: Cell) -> str:
        if cell is None:
            return "–"
        return f"{cell:.{self.digits}f}" if isinstance(cell, float) else str(cell)

    def on_the_right(self) -> list[bool]:
        """Of each column, whether it holds numbers."""
        numbers = [any(isinstance(row[k], (int, float)) for row in self.rows) for k in range(len(self.columns))]
        return numbers

    def for_terminal(self) -> rich.table.Table:
        """As a table of the package rich."""
        from rich import box
        from rich.table import Table as Terminal
        from rich.text import Text

        table = Terminal(box=box.SIMPLE_HEAD, pad_edge=False)
        for name, right in zip(self.columns, self.on_the_right(), strict=True):
            table.add_column(Text(name), justify="right" if right else "left", overflow="fold")
        for k, row in enumerate(self.cells()):
            table.add_row(*(Text(cell) for cell in row), style="bold" if k in self.bold else None)
        return table

    def html(self) -> str:
        """As an HTML table."""
        sides = ["right" if right else "left" for right in self.on_the_right()]
        head = "".join(
            f'<th style="text-align:{side}">{escape(name)}</th>' for name, side in zip(self.columns, sides, strict=True)
        )
        body = []
        for k, row in enumerate(self.cells()):
            weight = ";font-weight:bold" if k in self.bold else ""
            cells = "".join(
                f'<td style="text-align:{side}{weight}">{escape(cell)}</td>'
                for cell, side in zip(row, sides, strict=True)
            )
            body.append(f"<tr>{cells}</tr>")
        caption = f'<caption style="text-align:left">{escape(self.title)}</caption>'
        return f"<table>{caption}<thead><tr>{head}</tr></thead><tbody>{''.join(body)}</tbody></table>"


Told: TypeAlias = "str | Table"
"""A paragraph or a table."""


def as_text(told: Sequence[Told], width: int = WIDTH) -> str:
    """Paragraphs and tables as plain text."""
    from rich.console import Console

    out = StringIO()
    console = Console(file=out, width=width, color_system=None, markup=False, highlight=False, emoji=False)
    for item in told:
        if isinstance(item, Table):
            console.print(item.title, soft_wrap=True)
            console.print(item.for_terminal())
        else:
            console.print(item, soft_wrap=True)
    return "\n".join(line.rstrip() for line in out.getvalue().splitlines()).rstrip()


class Speaks(ABC):
    """A result that says what it is: in the interpreter, in a notebook, and in full on request."""

    @abstractmethod
    def told(self) -> Sequence[Told]:
        """What there is to say, the most important first: paragraphs and tables, as the command line prints them."""

    def summary(self) -> str:
        """The result in words and tables, plain text."""
        return as_text(self.told())

    def headline(self) -> str:
        """The result in one line."""
        return next((item for item in self.told() if isinstance(item, str)), "")

    def __repr__(self) -> str:
        text = f"<{type(self).__name__}: {self.headline()}>"
        return text if len(text) <= LONGEST_REPR else text[: LONGEST_REPR - 2] + "…>"

    def _repr_html_(self) -> str:
        parts = [item.html() if isinstance(item, Table) else f"<p>{escape(item)}</p>" for item in self.told()]
        return f"<div><b>{escape(type(self).__name__)}</b>{''.join(parts)}</div>"
