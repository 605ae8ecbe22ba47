"""Results that speak: a short text for the interpreter, tables for the terminal and for notebooks."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from io import StringIO
from typing import TYPE_CHECKING, TypeAlias

from irbcal.arrays import Locked
from irbcal.literals import terminal

if TYPE_CHECKING:
    import pandas as pd
    import rich.console
    import rich.table

Cell: TypeAlias = "str | float | int | None"

WIDTH = 110
"""Columns of text of a summary."""

SHORTEST_TEXT = 12
"""Columns of text below which a column of words is not broken."""

GAP = 2
"""Columns of text between two columns of a table."""

PAGE_STYLE = (
    "body{font:15px/1.5 sans-serif;max-width:70em;margin:2em auto;padding:0 1em;color:#1c2733}"
    "table{border-collapse:collapse;margin:1.5em 0;font-variant-numeric:tabular-nums}"
    "caption{font-weight:bold;padding:.3em 0}th{border-bottom:2px solid #8aa}"
    "td,th{padding:.25em .8em}td{border-bottom:1px solid #dde}"
)
"""Of pages of results."""

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
        Text as it is; numbers with ``digits`` decimals; None and NaN as a dash.
    digits : int
    bold : frozenset of int
        Rows that are headlines.
    """

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    digits: int = 3
    bold: frozenset[int] = frozenset()

    @classmethod
    def of(cls, title: str, frame: pd.DataFrame, columns: Sequence[str] | None = None, digits: int = 3) -> Table:
        """The rows of a DataFrame, under its own headings unless others are given."""
        headings = map(str, frame.columns if columns is None else columns)
        return cls(title, tuple(headings), tuple(frame.itertuples(index=False, name=None)), digits)

    def cells(self) -> list[list[str]]:
        """The rows as text."""
        return [[self._text(cell) for cell in row] for row in self.rows]

    def _text(self, cell: Cell) -> str:
        if cell is None or cell != cell:
            return "–"
        return f"{round(cell, self.digits) + 0.0:.{self.digits}f}" if isinstance(cell, float) else str(cell)

    def on_the_right(self) -> list[bool]:
        """Of each column, whether it holds numbers."""
        numbers = [any(isinstance(row[k], (int, float)) for row in self.rows) for k in range(len(self.columns))]
        return numbers

    def for_terminal(self, width: int = WIDTH) -> rich.table.Table:
        """As a table of the package rich, for so many columns of text: numbers are not broken, words only where needed.

        It fits where there is room for `narrowest`.
        """
        from rich import box
        from rich.table import Table as Terminal
        from rich.text import Text

        table = Terminal(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
        heads, cells = self.columns, self.cells()
        longest = [max(cell_len(text) for text in column) for column in zip(heads, *cells, strict=True)]
        tight = _whole(longest) > width
        for k, (name, right) in enumerate(zip(heads, self.on_the_right(), strict=True)):
            if tight and right:
                name = _broken(name, [row[k] for row in cells])
            table.add_column(
                Text(name),
                justify="right" if right else "left",
                overflow="fold",
                no_wrap=right or not tight,
                min_width=None if right else min(longest[k], SHORTEST_TEXT),
            )
        for k, row in enumerate(cells):
            table.add_row(*(Text(cell) for cell in row), style="bold" if k in self.bold else None)
        return table

    def narrowest(self) -> int:
        """Columns of text that the table needs at least: numbers are not broken, words are."""
        needed = []
        for name, right, *column in zip(self.columns, self.on_the_right(), *self.cells(), strict=True):
            if right:
                needed.append(max(cell_len(text) for text in [*_broken(name, column).split("\n"), *column]))
            else:
                needed.append(min(SHORTEST_TEXT, max(cell_len(text) for text in [name, *column])))
        return _whole(needed)

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


def cell_len(text: str) -> int:
    """Columns of text that a text takes in a terminal."""
    from rich import cells

    return cells.cell_len(text)


def _whole(columns: Sequence[int]) -> int:
    """Width of a table with columns of these widths."""
    return sum(columns) + GAP * (len(columns) - 1) + 2


def _broken(heading: str, cells: Sequence[str]) -> str:
    """A heading in lines that are not longer than what stands below it, but for single words."""
    from textwrap import wrap

    return "\n".join(wrap(heading, max(map(cell_len, [*cells, *heading.split(), "0"])), break_long_words=False))


def simulated_mark(simulated: bool) -> str:
    """How the first sentence on simulated data begins."""
    return "SIMULATED data: " if simulated else ""


Paragraph: TypeAlias = "str | Table"
"""A paragraph or a table."""


def print_table(console: rich.console.Console, table: Table) -> None:
    """Title and table; where the table needs more columns of text than there are, its lines go on."""
    width_before = console.width
    console.print(table.title, soft_wrap=True)
    console.width = max(width_before, table.narrowest())
    console.print(table.for_terminal(width_before))
    console.width = width_before


def as_text(paragraphs: Sequence[Paragraph], width: int = WIDTH) -> str:
    """Paragraphs and tables as plain text."""
    from irbcal.terminal import Terminal

    out = StringIO()
    console = Terminal(file=out, width=width, color_system=None)
    for paragraph in paragraphs:
        if isinstance(paragraph, Table):
            print_table(console, paragraph)
        else:
            console.print(paragraph, soft_wrap=True)
    return "\n".join(text_line.rstrip() for text_line in out.getvalue().splitlines()).rstrip()


class Result(Locked, ABC):
    """A result that says what it is: in the interpreter, in a notebook, and in full on request."""

    @abstractmethod
    def report(self) -> Sequence[Paragraph]:
        """What there is to say, the most important first: paragraphs and tables, as the command line prints them."""

    def summary(self) -> str:
        """The result in words and tables, plain text."""
        return as_text(self.report())

    def headline(self) -> str:
        """The result in one line."""
        return next((paragraph for paragraph in self.report() if isinstance(paragraph, str)), "")

    def __repr__(self) -> str:
        text = terminal(f"<{type(self).__name__}: {self.headline()}>")
        return text if len(text) <= LONGEST_REPR else text[: LONGEST_REPR - 2] + "…>"

    def _repr_html_(self) -> str:
        return f"<div><b>{escape(type(self).__name__)}</b>{_html(self.report())}</div>"

    def page(self, title: str, more: Sequence[Paragraph] = ()) -> str:
        """The report, and more paragraphs, as one HTML page that loads nothing and runs no script."""
        head = f'<meta charset="utf-8"><title>{escape(title)}</title><style>{PAGE_STYLE}</style>'
        content = f"<h1>{escape(title)}</h1>{_html([*self.report(), *more])}"
        return f'<!DOCTYPE html>\n<html lang="en"><head>{head}</head><body>{content}</body></html>\n'


def _html(paragraphs: Sequence[Paragraph]) -> str:
    return "".join(part.html() if isinstance(part, Table) else f"<p>{escape(part)}</p>" for part in paragraphs)
