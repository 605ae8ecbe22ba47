"""Results that speak: a short text for the interpreter, tables for the terminal and for notebooks."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from io import StringIO
from typing import TYPE_CHECKING, Any, ClassVar, TypeAlias

import numpy as np

from irbcal.arrays import Locked, field_names, plain
from irbcal.literals import terminal
from irbcal.units import DEG, MM

if TYPE_CHECKING:
    import pandas as pd
    import rich.console
    import rich.table
    from typing_extensions import Self

TableValue: TypeAlias = "str | float | int | None"

UNITS = {"mm": MM, "deg": DEG, "percent": 0.01}
"""Units of files, as they stand in names."""

WIDTH = 110
"""Columns of text of a summary."""

SHORTEST_TEXT = 12
"""Columns of text below which a column of words is not broken."""

GAP = 2
"""Columns of text between two columns of a table."""

LONGEST_REPR = 1_500
"""Characters of the text that the interpreter shows."""


@dataclass(frozen=True, repr=False)
class Table:
    """A table for people."""

    title: str
    columns: tuple[str, ...]
    """Headings; the first columns up to the first number stand on the left, the others on the right."""
    rows: tuple[tuple[TableValue, ...], ...]
    """Text as it is; numbers with ``digits`` decimals; None and NaN as a dash."""
    digits: int = 3
    bold: frozenset[int] = frozenset()
    """Rows that are headlines."""

    @classmethod
    def from_frame(
        cls, title: str, frame: pd.DataFrame, columns: Sequence[str] | None = None, digits: int = 3
    ) -> Table:
        """The rows of a DataFrame, under its own headings unless others are given."""
        headings = map(str, frame.columns if columns is None else columns)
        return cls(title, tuple(headings), tuple(frame.itertuples(index=False, name=None)), digits)

    def cells(self) -> list[list[str]]:
        """The rows as text."""
        return [[self._text(cell) for cell in row] for row in self.rows]

    def _text(self, cell: TableValue) -> str:
        if cell is None or cell != cell:
            return "–"
        return f"{round(cell, self.digits) + 0.0:.{self.digits}f}" if isinstance(cell, float) else str(cell)

    def __str__(self) -> str:
        return as_text([self])

    def __repr__(self) -> str:
        title = f"{self.title}, " if self.title else ""
        return f"<{type(self).__name__}: {title}{len(self.rows)} rows of {', '.join(filter(None, self.columns))}>"

    def to_frame(self) -> pd.DataFrame:
        """Headings and values, unrounded."""
        import pandas as pd

        return pd.DataFrame(list(self.rows), columns=list(self.columns))

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

    def _repr_html_(self) -> str:
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


class Remark(str):
    """A paragraph that the reader should not miss: a head, such as ``Note``, a colon, and a sentence."""

    head: str
    good: bool | None
    """Whether it speaks for a result, or against it; None where it does neither."""
    __slots__ = ("good", "head")

    def __new__(cls, head: str, sentence: str, good: bool | None = None) -> Self:
        """A text of both, which says whether it is good."""
        remark = super().__new__(cls, f"{head}: {sentence}")
        remark.head, remark.good = head, good
        return remark


def remarks(head: str, sentences: Iterable[str], good: bool | None = None) -> list[Paragraph]:
    """Sentences as remarks, each with the same head."""
    return [Remark(head, sentence, good) for sentence in sentences]


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


def values(holder: Any, names: str) -> dict[str, Any]:
    """Attributes by the names that JSON and tables have for them.

    Parameters
    ----------
    holder : object
    names : str
        Words with spaces between them: ``NAME``, an attribute, or ``NAME=ATTRIBUTE`` with dots to attributes of
        attributes; methods are called; what an attribute that is None would have is None, too. A name with ``mm``,
        ``deg`` or ``percent`` in it has metres, radians or shares in that unit, unless the attribute's name says it as
        well; alone, it is the attribute of that name, or of what stands before the unit. ``NAME,NAME=ATTRIBUTE`` are
        the columns of an array. ``NAME?`` is left out where it is None, and ``*ATTRIBUTE`` stands for all names and
        values of a mapping or table, or for nothing.

    Returns
    -------
    dict
        Name -> value, in the order of the names.
    """
    out: dict[str, Any] = {}
    for word in names.split():
        name, _, path = word.partition("=")
        left_out, name = name.endswith("?"), name.removesuffix("?")
        unit = "" if name.startswith("*") else _unit(name)
        path = path or (name.partition(f"_{unit}")[0] if unit and not hasattr(holder, name) else name)
        value = holder
        for attribute in path.removeprefix("*").split("."):
            value = None if value is None else getattr(value, attribute)
            value = value() if callable(value) else value
        if name.startswith("*"):
            out |= {} if value is None else dict(value)
            continue
        if left_out and value is None:
            continue
        several = name.split(",")
        columns = {name: value} if len(several) == 1 else dict(zip(several, np.moveaxis(value, -1, 0), strict=True))
        for column, numbers in columns.items():
            factor = UNITS.get(_unit(column)) if not _unit(path) and numbers is not None else None
            out[column] = numbers if factor is None else np.asarray(numbers) / factor
    return out


def _unit(name: str) -> str:
    return next((unit for unit in UNITS if unit in re.split(r"[_.,]", name)), "")


def rows(holders: Mapping[str, Any] | Iterable[Any], names: str) -> list[dict[str, Any]]:
    """A row a holder, see `values`; of holders by name the first word is what the name is called."""
    if not isinstance(holders, Mapping):
        return [values(holder, names) for holder in holders]
    key, _, others = names.partition(" ")
    return [{key: name, **values(holder, others)} for name, holder in holders.items()]


class Content(Locked):
    """What says in `CONTENT` what JSON has of it."""

    CONTENT: ClassVar[str] = ""
    """What ``to_dict`` gives, in the words of `values`; its fields unless given."""

    def to_dict(self) -> dict[str, Any]:
        """The content as JSON has it: millimetres and degrees where names say so, None for what is not known."""
        names = self.CONTENT or " ".join(field_names(type(self)))  # type: ignore[arg-type]
        content: dict[str, Any] = plain(values(self, names))
        return content


class Result(Content, ABC):
    """A result that says what it is: in the interpreter, in a notebook, and in full on request."""

    COLUMNS: ClassVar[str] = ""
    """The columns of ``to_frame``, in the words of `values`; of a result without them it is one row of its content."""
    ROWS: ClassVar[str] = ""
    """Attribute or method that has the rows of ``to_frame``, where arrays are not its columns; see `rows`. Where a row
    has arrays, it is as many rows."""

    def to_dict(self) -> dict[str, Any]:
        """The content as JSON has it, or else its columns or rows: millimetres and degrees where names say so."""
        if self.CONTENT or not self.COLUMNS:
            return super().to_dict()
        table: dict[str, Any] = plain({self.ROWS: self._rows()} if self.ROWS else values(self, self.COLUMNS))
        return table

    def _rows(self) -> list[dict[str, Any]]:
        return rows(values(self, self.ROWS)[self.ROWS], self.COLUMNS)

    def to_frame(self) -> pd.DataFrame:
        """The result as a table: millimetres and degrees where names say so."""
        import pandas as pd

        if not self.COLUMNS:
            return pd.json_normalize(self.to_dict())
        if not self.ROWS:
            return pd.DataFrame(values(self, self.COLUMNS))
        table_rows = self._rows()
        if table_rows and any(isinstance(value, np.ndarray) for value in table_rows[0].values()):
            return pd.concat([pd.DataFrame(row) for row in table_rows], ignore_index=True)
        names = [name for word in self.COLUMNS.split() for name in word.partition("=")[0].split(",")]
        return pd.DataFrame(table_rows, columns=names)

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
        return html_page(title, [*self.report(), *more])


def html_page(title: str, paragraphs: Sequence[Paragraph]) -> str:
    """Paragraphs as one HTML page that loads nothing and runs no script."""
    from markupsafe import Markup

    from irbcal.templates import environment

    content = Markup(f"<h1>{escape(title)}</h1>{_html(paragraphs)}")
    return environment("irbcal.page_style", "").get_template("frame.html.j2").render(title=title, content=content)


def _html(paragraphs: Sequence[Paragraph]) -> str:
    return "".join(
        f'<div class="scroll">{block._repr_html_()}</div>' if isinstance(block, Table) else f"<p>{escape(block)}</p>"
        for block in paragraphs
    )
