"""Charts as inline SVG that the page's style sheet colours, and the same charts as PNG or SVG files.

A drawing is a list of marks (`irbcal.figures.marks`) in its own units (a font of 12 is body text). Nothing runs in it:
what a mark is stands in its ``<title>``, which browsers show when the pointer rests on it. Ten charts are drawn in 0.2
seconds, for which matplotlib takes 3.6: so the report has these, and other figures have `irbcal.figures.style`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from textwrap import wrap
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray
from irbcal.figures.marks import FONT, PAINT, Boxes, Dots, Lines, Mark, Paint, Polyline, Text, as_text, fixed
from irbcal.figures.style import LINE, house_style

if TYPE_CHECKING:
    from markupsafe import Markup

__all__ = [
    "PAINT",
    "Boxes",
    "Dots",
    "Drawing",
    "Figure",
    "Lines",
    "Panel",
    "Text",
    "decades",
    "file",
    "fixed",
    "inline",
    "key",
    "step_of",
    "ticks",
    "up_to",
]

WIDTH = 420.0
FAMILY = "system-ui, 'Segoe UI', Roboto, Arial, sans-serif"
DPI = 200
GAP = 16.0

Sign: TypeAlias = Literal["o", "^", "v", "-", "--"]
LegendEntry: TypeAlias = tuple[str, Sign, str]
"""Colour, sign and words."""
"""What stands in a legend."""


# --- drawings and figures ---------------------------------------------------------------------------------


@dataclass
class Drawing:
    """One SVG image of a page: marks in order, the later ones above the earlier; it grows while it is drawn."""

    label: str
    height: float = 240.0
    width: float = WIDTH
    items: list[Mark] = field(default_factory=list)

    def add(self, *items: Mark) -> None:
        """Add marks."""
        self.items.extend(items)


@dataclass(frozen=True, eq=False)
class Figure:
    """Drawings that belong together, with a caption and a legend outside of them.

    Attributes
    ----------
    name : str
        Of the file.
    caption : str
    drawings : sequence of Drawing
    legend : sequence of tuple
        (colour, mark, words); marks are ``o``, ``^``, ``v``, ``-`` and ``--``.
    columns : int
        Of a file; a page has as many as fit.
    """

    name: str
    caption: str
    drawings: Sequence[Drawing]
    legend: Sequence[tuple[str, Sign, str]] = ()
    columns: int = 2


def inline(drawing: Drawing) -> Markup:
    """A drawing as part of a page.

    Parameters
    ----------
    drawing : Drawing

    Returns
    -------
    markupsafe.Markup
    """
    from markupsafe import Markup

    return Markup(_svg(drawing, _variable, f'role="img" aria-label="{as_text(drawing.label)}"'))


def key(mark: Sign, colour: str) -> Markup:
    """The mark of a legend as part of a page."""
    from markupsafe import Markup

    drawing = Drawing("", 12.0, 18.0, [_key(mark, colour, 9.0, 6.0)])
    return Markup(_svg(drawing, _variable, 'class="mark" width="18" height="12" aria-hidden="true"'))


def _variable(role: str) -> str:
    return f"var(--{role})"


def _svg(drawing: Drawing, paint: Paint, attributes: str) -> str:
    content = "".join(item.svg(paint) for item in drawing.items)
    return f'<svg viewBox="0 0 {drawing.width:g} {drawing.height:g}" {attributes}>{content}</svg>'


def _key(mark: Sign, colour: str, x: float, y: float) -> Mark:
    if mark == "-" or mark == "--":
        return Lines([[(x - 8, y), (x + 8, y)]], colour, 2.0, "4 3" if mark == "--" else "")
    return Dots(np.array([[x, y]]), colour, 8.0, shape=mark)


def file(figure: Figure, kind: Literal["svg", "png"], mark: str = "") -> bytes:
    """A figure as a file of its own, on white.

    Parameters
    ----------
    figure : Figure
    kind : str
        ``svg`` or ``png``.
    mark : str
        Words before the caption.

    Returns
    -------
    bytes
    """
    whole = _composed(figure, mark)
    if kind == "png":
        return _png(whole)
    size = f'width="{whole.width:g}" height="{whole.height:g}" font-family="{FAMILY}"'
    svg = _svg(whole, PAINT.__getitem__, f'xmlns="http://www.w3.org/2000/svg" {size}')
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{svg}\n'.encode()


def _composed(figure: Figure, mark: str) -> Drawing:
    """Caption, legend and drawings on one sheet."""
    columns = min(figure.columns, len(figure.drawings))
    widths = [max(d.width for d in figure.drawings[k::columns]) for k in range(columns)]
    width = max(sum(widths) + GAP * (columns - 1), WIDTH) + 2 * GAP
    whole = Drawing(figure.caption, width=width)
    y = GAP
    for line in wrap(mark + figure.caption, max(20, int((width - 2 * GAP) / (0.54 * FONT)))):
        y += 0.6 * FONT
        whole.add(Text(GAP, y, line))
        y += 0.7 * FONT
    x = GAP
    for colour, sign, words in figure.legend:
        need = 30 + 0.56 * FONT * len(words)
        if x == GAP or x + need > width - GAP:
            x, y = GAP, y + 1.5 * FONT
        whole.add(_key(sign, colour, x + 9, y), Text(x + 24, y, words, colour="soft"))
        x += need
    y += 1.5 * FONT
    for first in range(0, len(figure.drawings), columns):
        row = figure.drawings[first : first + columns]
        for k, drawing in enumerate(row):
            left = GAP + sum(widths[:k]) + GAP * k
            whole.add(*(item.moved(left, y) for item in drawing.items))
        y += max(drawing.height for drawing in row) + GAP
    return Drawing(whole.label, y, width, [Boxes(np.array([[0, 0, width, y]]), "page"), *whole.items])


def _png(drawing: Drawing) -> bytes:
    from io import BytesIO

    from matplotlib.figure import Figure as Canvas

    with house_style():
        canvas = Canvas(figsize=(drawing.width / 72, drawing.height / 72))
        axes = canvas.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        axes.set_xlim(0, drawing.width)
        axes.set_ylim(drawing.height, 0)
        for order, item in enumerate(drawing.items):
            item.draw(axes, order)
        axes.set_xlim(0, drawing.width)
        axes.set_ylim(drawing.height, 0)
        stream = BytesIO()
        canvas.savefig(stream, format="png", dpi=DPI, metadata={"Software": None})
    return stream.getvalue()


# --- axes -------------------------------------------------------------------------------------------------


def step_of(span: float, most: int) -> float:
    """The smallest of 1, 2, 5 times a power of ten that cuts a span into at most so many parts."""
    least = span / most
    power = 10.0 ** np.floor(np.log10(least))
    return float(next(k for k in (1, 2, 5, 10) if k * power >= least * (1 - 1e-9)) * power)


def ticks(low: float, high: float, most: int = 5, whole: bool = False) -> tuple[FloatArray, list[str]]:
    """Round numbers between two ends, with their texts."""
    step = step_of(high - low, most)
    step = max(step, 1.0) if whole else step
    values = np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1) * step
    if len(values) < 3 and most < 12 and not whole:
        return ticks(low, high, most + 1)
    digits = max(0, -int(np.floor(np.log10(step) + 1e-9)))
    return values, [f"{value + 0.0:.{digits}f}" for value in np.round(values, digits + 1)]


def decades(low: float, high: float) -> tuple[FloatArray, list[str]]:
    """Powers of ten between two ends, with 2 and 5 times them where there are few."""
    ends = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    factors = (1,) if high > 50 * low else (1, 2, 5)
    values = np.array([k * 10.0**e for e in ends for k in factors])
    values = values[(values >= low * (1 - 1e-9)) & (values <= high * (1 + 1e-9))]
    if len(values) > 8:
        values = values[:: -(-len(values) // 8)]
    return values, [f"{value:g}" for value in values]


def up_to(value: float, most: int = 5) -> float:
    """The round number at or above a value where an axis from zero may end."""
    if not value > 0:
        return 1.0
    step = step_of(value, most) / 2
    return float(np.ceil(value / step - 1e-9) * step)


def _ends(middle: float, span: float) -> tuple[float, float]:
    return middle - span / 2, middle + span / 2


class Panel:
    """Axes inside a drawing: grid, numbers and labels are drawn at once, data on request.

    Parameters
    ----------
    drawing : Drawing
    x, y : tuple of float
        Ends of the axes.
    x_label, y_label : str
        With units.
    top, bottom : float, optional
        Where the panel, with its labels, begins and ends in the drawing.
    log : bool
        Logarithmic y.
    whole_x, whole_y : bool
        Whole numbers only.
    title : str
        Above the panel.
    equal : bool
        One unit is as long in x as in y: the ends of the axes are moved apart as needed.
    plain : bool
        No grid and no numbers at y.
    """

    def __init__(
        self,
        drawing: Drawing,
        x: Sequence[float],
        y: Sequence[float],
        x_label: str,
        y_label: str,
        top: float = 0.0,
        bottom: float | None = None,
        log: bool = False,
        whole_x: bool = False,
        whole_y: bool = False,
        title: str = "",
        equal: bool = False,
        plain: bool = False,
    ) -> None:
        self.drawing, self.log = drawing, log
        bottom = drawing.height if bottom is None else bottom
        self.box = [44.0, top + (26.0 if title else 8.0), drawing.width - 10.0, bottom - (38.0 if x_label else 8.0)]
        self.x, self.y = (float(x[0]), float(x[1])), (float(y[0]), float(y[1]))
        y_ticks: tuple[FloatArray, list[str]] = (np.zeros(0), [])
        if not plain:
            y_ticks = decades(*self.y) if log else ticks(*self.y, self._most(20), whole_y)
        self.box[0] = 26.0 + 6.8 * max((len(text) for text in y_ticks[1]), default=1)
        if equal:
            self._equal()
            y_ticks = ticks(*self.y, self._most(24))
        x_ticks = ticks(*self.x, max(2, int((self.box[2] - self.box[0]) / 52)), whole_x)
        left, head, right, foot = self.box
        grid: list[Polyline] = [[(px, head), (px, foot)] for px in self.at(x_ticks[0], self.y[0])[:, 0]]
        grid += [[(left, py), (right, py)] for py in self.at(self.x[0], y_ticks[0])[:, 1]]
        drawing.add(
            Lines([] if plain else grid, "line", 0.8), Lines([[(left, head), (left, foot), (right, foot)]], "soft", 1.0)
        )
        if x_label:
            for value, text in zip(*x_ticks, strict=True):
                drawing.add(Text(self.at(value, self.y[0])[0, 0], foot + 11, text, "middle", "soft", 11.0))
            drawing.add(Text((left + right) / 2, foot + 28, x_label, "middle"))
        for value, text in zip(*y_ticks, strict=True):
            drawing.add(Text(left - 5, self.at(self.x[0], value)[0, 1], text, "end", "soft", 11.0))
        if y_label:
            drawing.add(Text(9, (head + foot) / 2, y_label, "middle", upright=False))
        if title:
            drawing.add(Text(left, top + 11, title, bold=True))

    def _most(self, apart: float) -> int:
        return max(2, int((self.box[3] - self.box[1]) / apart / 1.4))

    def _equal(self) -> None:
        left, head, right, foot = self.box
        unit = max((self.x[1] - self.x[0]) / (right - left), (self.y[1] - self.y[0]) / (foot - head))
        self.x = _ends(sum(self.x) / 2, unit * (right - left))
        self.y = _ends(sum(self.y) / 2, unit * (foot - head))

    def at(self, x: ArrayLike, y: ArrayLike) -> FloatArray:
        """Places in the drawing, shape (k, 2)."""
        px, py = np.broadcast_arrays(np.asarray(x, dtype=float).ravel(), np.asarray(y, dtype=float).ravel())
        low, high = self.y
        if self.log:
            py, low, high = np.log10(py), np.log10(low), np.log10(high)
        left, head, right, foot = self.box
        across = (px - self.x[0]) / (self.x[1] - self.x[0])
        return np.column_stack([left + across * (right - left), foot - (py - low) / (high - low) * (foot - head)])

    def dots(self, x: ArrayLike, y: ArrayLike, colour: str, size: float = 4.0, **style: Any) -> None:
        """Marks at data."""
        self.drawing.add(Dots(self.at(x, y), colour, size, **style))

    def line(self, x: ArrayLike, y: ArrayLike, colour: str, width: float = LINE, **style: Any) -> None:
        """A line through data."""
        self.drawing.add(Lines([self.at(x, y)], colour, width, **style))

    def level(self, value: float, colour: str = "soft", **style: Any) -> None:
        """A horizontal line all across."""
        self.line(self.x, [value, value], colour, 1.0, **style)

    def boxes(
        self, left: ArrayLike, bottom: ArrayLike, right: ArrayLike, top: ArrayLike, colour: str, **style: Any
    ) -> None:
        """Rectangles between data."""
        self.drawing.add(Boxes(np.hstack([self.at(left, bottom), self.at(right, top)]), colour, **style))
