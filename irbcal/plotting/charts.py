"""Charts: lists of marks in their own units, as inline SVG that a page colours, and as SVG, PNG and PDF files.

A drawing is a list of marks (lines, dots, boxes, texts; a font of 12 is body text). Nothing runs in it: what a mark is
stands in its ``<title>``, which browsers show when the pointer rests on it. Colours are roles of
`irbcal.page_style`; on a page they are variables of its style sheet. matplotlib turns the marks into pixels, for PNG,
and into PDF.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from html import escape
from itertools import pairwise
from os import PathLike
from pathlib import Path
from textwrap import wrap
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, NameArray
from irbcal.errors import OptionError
from irbcal.page_style import PAINT
from irbcal.safe_files import write_together

if TYPE_CHECKING:
    from markupsafe import Markup
    from matplotlib.axes import Axes


FONT = 12.0
"""Size of body text in a drawing."""

Paint: TypeAlias = Callable[[str], str]
"""Gives the colour of a role."""

Anchor: TypeAlias = Literal["start", "middle", "end"]
MarkerShape: TypeAlias = Literal["o", "^", "v"]
DIRECTIONS: tuple[tuple[float, str, MarkerShape, str], ...] = (
    (1.0, "below", "^", "reached from below"),
    (-1.0, "above", "v", "reached from above"),
    (0.0, "unknown", "o", "direction not known"),
)
"""Directions from which a joint was reached: sign, colour, mark and words."""
Polyline: TypeAlias = "FloatArray | Sequence[tuple[float, float]]"


def fixed(value: float | None, digits: int) -> str:
    """A number with a fixed count of decimals, without a minus sign before zero; None as a dash."""
    return "–" if value is None else format(round(value, digits) + 0.0, f".{digits}f")


def _number(value: float) -> str:
    text = f"{value:.1f}"
    return "0" if text == "-0.0" else text.removesuffix(".0")


def as_text(value: object) -> str:
    """Text for XML and HTML alike: escaped, without characters that neither may hold."""
    return escape(re.sub(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f\ud800-\udfff\ufffe\uffff]", "\ufffd", str(value)))


def _titled(element: str, attributes: str, title: str) -> str:
    return f"<{element} {attributes}><title>{as_text(title)}</title></{element}>"


@dataclass(frozen=True, eq=False)
class Lines:
    """Polylines of one look."""

    paths: Sequence[Polyline]
    colour: str
    width: float = 1.0
    dash: str = ""
    opacity: float = 1.0

    def svg(self, paint: Paint) -> str:
        """As SVG; ``paint`` gives the colour of a role."""
        d = "".join("M" + "L".join(f"{_number(x)} {_number(y)}" for x, y in path) for path in self.paths if len(path))
        dash = f' stroke-dasharray="{self.dash}"' if self.dash else ""
        faint = f' opacity="{self.opacity:g}"' if self.opacity < 1 else ""
        style = f"fill:none;stroke:{paint(self.colour)}"
        return f'<path d="{d}" style="{style}" stroke-width="{self.width:g}"{dash}{faint}/>' if d else ""

    def draw(self, axes: Axes, order: int) -> None:
        """On matplotlib axes that have the units of the drawing, above what has a lower order."""
        from matplotlib.collections import LineCollection

        lines = LineCollection(
            [np.asarray(path) for path in self.paths if len(path)],
            colors=PAINT[self.colour],
            linewidths=self.width,
            linestyles=[(0, [float(v) / self.width for v in self.dash.split()])] if self.dash else "solid",
            alpha=self.opacity,
            zorder=order,
        )
        axes.add_collection(lines)

    def moved(self, dx: float, dy: float) -> Lines:
        """The same elsewhere."""
        paths = [np.asarray(path) + np.array([dx, dy]) for path in self.paths if len(path)]
        return Lines(paths, self.colour, self.width, self.dash, self.opacity)


@dataclass(frozen=True, eq=False)
class Dots:
    """Marks of one look: circles, or triangles that point up or down; titles, if any, one for each."""

    xy: FloatArray
    colour: str
    size: float = 4.0
    opacity: float = 1.0
    shape: MarkerShape = "o"
    titles: Sequence[str] | None = None

    def svg(self, paint: Paint) -> str:
        """As SVG; ``paint`` gives the colour of a role."""
        if not len(self.xy):
            return ""
        points = [(_number(x), _number(y)) for x, y in np.asarray(self.xy).tolist()]
        colour, faint = paint(self.colour), f' opacity="{self.opacity:g}"' if self.opacity < 1 else ""
        if self.titles is None and self.shape == "o":
            d = "".join(f"M{x} {y}h0" for x, y in points)
            style = f"fill:none;stroke:{colour}"
            return f'<path d="{d}" style="{style}" stroke-width="{self.size:g}" stroke-linecap="round"{faint}/>'
        if self.shape == "o":
            marks = (f'circle|cx="{x}" cy="{y}" r="{self.size / 2:g}"' for x, y in points)
        else:
            half, up = 0.62 * self.size, -1 if self.shape == "^" else 1
            corners = f"l{half:g} {-1.7 * up * half:g}h{-2 * half:g}z"
            marks = (f'path|d="M{x} {_number(float(y) + up * half)}{corners}"' for x, y in points)
        out = []
        titles: Sequence[str | None] = self.titles or [None] * len(points)
        for mark, title in zip(marks, titles, strict=True):
            element, attributes = mark.split("|")
            out.append(f"<{element} {attributes}/>" if title is None else _titled(element, attributes, title))
        return f'<g class="marks" style="fill:{colour}"{faint}>{"".join(out)}</g>'

    def draw(self, axes: Axes, order: int) -> None:
        """On matplotlib axes that have the units of the drawing, above what has a lower order."""
        x, y = np.asarray(self.xy, dtype=float).reshape(-1, 2).T
        size = self.size**2 * (1.0 if self.shape == "o" else 1.6)
        axes.scatter(
            x, y, size, color=PAINT[self.colour], alpha=self.opacity, marker=self.shape, linewidths=0, zorder=order
        )

    def moved(self, dx: float, dy: float) -> Dots:
        """The same elsewhere."""
        return Dots(
            np.asarray(self.xy) + np.array([dx, dy]), self.colour, self.size, self.opacity, self.shape, self.titles
        )


@dataclass(frozen=True, eq=False)
class Boxes:
    """Rectangles of one look, rows x0, y0, x1, y1; of colour ``none`` they only carry titles."""

    corners: FloatArray
    colour: str
    opacity: float = 1.0
    titles: Sequence[str] | None = None

    def svg(self, paint: Paint) -> str:
        """As SVG; ``paint`` gives the colour of a role."""
        out = []
        for k, (x0, y0, x1, y1) in enumerate(np.asarray(self.corners).tolist()):
            x, y, w, h = min(x0, x1), min(y0, y1), abs(x1 - x0), abs(y1 - y0)
            attributes = f'x="{_number(x)}" y="{_number(y)}" width="{_number(w)}" height="{_number(h)}"'
            out.append(_titled("rect", attributes, self.titles[k]) if self.titles else f"<rect {attributes}/>")
        if self.colour == "none":
            return f'<g class="hover" fill="none" pointer-events="all">{"".join(out)}</g>'
        faint = f' opacity="{self.opacity:g}"' if self.opacity < 1 else ""
        style = f'style="fill:{paint(self.colour)}" shape-rendering="crispEdges"'
        return f"<g {style}{faint}>{''.join(out)}</g>"

    def draw(self, axes: Axes, order: int) -> None:
        """On matplotlib axes that have the units of the drawing, above what has a lower order."""
        from matplotlib.patches import Rectangle

        if self.colour != "none":
            for x0, y0, x1, y1 in np.asarray(self.corners).tolist():
                box = Rectangle((x0, y0), x1 - x0, y1 - y0, facecolor=PAINT[self.colour], linewidth=0, snap=True)
                box.set(alpha=self.opacity, zorder=order)
                axes.add_patch(box)

    def moved(self, dx: float, dy: float) -> Boxes:
        """The same elsewhere."""
        return Boxes(np.asarray(self.corners) + np.array([dx, dy, dx, dy]), self.colour, self.opacity, self.titles)


@dataclass(frozen=True, eq=False)
class Text:
    """One line of text; its place is the middle of its height."""

    x: float
    y: float
    text: str
    anchor: Anchor = "start"
    colour: str = "ink"
    size: float = FONT
    upright: bool = True
    bold: bool = False

    def svg(self, paint: Paint) -> str:
        """As SVG; ``paint`` gives the colour of a role."""
        turn = "" if self.upright else f' transform="rotate(-90 {_number(self.x)} {_number(self.y)})"'
        weight = ' font-weight="600"' if self.bold else ""
        return (
            f'<text x="{_number(self.x)}" y="{_number(self.y)}" dy=".35em" text-anchor="{self.anchor}" '
            f'font-size="{self.size:g}" style="fill:{paint(self.colour)}"{weight}{turn}>{as_text(self.text)}</text>'
        )

    def draw(self, axes: Axes, order: int) -> None:
        """On matplotlib axes that have the units of the drawing, above what has a lower order."""
        side = {"start": "left", "middle": "center", "end": "right"}[self.anchor]
        axes.text(
            self.x,
            self.y,
            self.text,
            ha=side if self.upright else "center",
            va="center_baseline" if self.upright else "center",
            rotation=0 if self.upright else 90,
            color=PAINT[self.colour],
            fontsize=0.93 * self.size,
            fontweight="bold" if self.bold else "normal",
            zorder=order,
        )

    def moved(self, dx: float, dy: float) -> Text:
        """The same elsewhere."""
        return Text(self.x + dx, self.y + dy, self.text, self.anchor, self.colour, self.size, self.upright, self.bold)


Mark: TypeAlias = "Lines | Dots | Boxes | Text"


FileKind: TypeAlias = Literal["png", "svg", "pdf"]
FILE_KINDS: tuple[FileKind, ...] = get_args(FileKind)
SIMULATED = "SIMULATED data. "
"""Mark of charts of simulated data."""

WIDE, TALL = 560.0, 300.0
"""Size of a drawing that stands alone."""

DOT = 4.0
"""Size of the mark of a single reading."""

DASHED, DOTTED = "5 3", "1.5 3"

LINE = 1.4
"""Width of lines of data."""

WIDTH = 420.0
FAMILY = "system-ui, 'Segoe UI', Roboto, Arial, sans-serif"
DPI = 200
GAP = 16.0

LineSign: TypeAlias = Literal["-", "--", ":", "-."]
Sign: TypeAlias = Literal["o", "^", "v"] | LineSign
DASHES: dict[LineSign, str] = {"-": "", "--": "5 3", ":": "1.5 3", "-.": "6 3 1.5 3"}
"""Lines of a legend, and their dashes."""
LegendEntry: TypeAlias = tuple[str, Sign, str]
"""What stands in a legend: colour, sign and words."""


# --- drawings and figures ---------------------------------------------------------------------------------


@dataclass
class Drawing:
    """One SVG image of a page: marks in order, the later ones above the earlier; it grows while it is drawn."""

    label: str
    height: float = 240.0
    width: float = WIDTH
    marks: list[Mark] = field(default_factory=list)

    def add(self, *items: Mark) -> None:
        """Add marks."""
        self.marks.extend(items)


@dataclass(frozen=True, eq=False, repr=False)
class Chart:
    """Drawings that belong together, with a caption and a legend outside of them; it shows itself in a notebook."""

    name: str
    """Of the file."""
    caption: str
    drawings: Sequence[Drawing]
    legend: Sequence[LegendEntry] = ()
    """(colour, mark, words); marks are ``o``, ``^``, ``v``, ``-`` and ``--``."""
    columns: int = 2
    """Of a file; a page has as many as fit."""
    mark: str = ""
    """Words before the caption of a file, such as that the data are simulated."""

    def __repr__(self) -> str:
        return f"<Chart {self.name}: {self.mark}{self.caption[:200]}>"

    def marked(self, simulated: bool) -> Chart:
        """The chart with the mark of simulated data where they are."""
        return replace(self, mark=SIMULATED if simulated else "")

    def svg(self) -> str:
        """Caption, legend and drawings as SVG."""
        return self.content("svg").decode("utf-8")

    def content(self, kind: FileKind) -> bytes:
        """A file of its own, on white, the same each time.

        Parameters
        ----------
        kind : str
            One of `FILE_KINDS`.
        """
        sheet = _composed(self)
        if kind != "svg":
            return _by_matplotlib(sheet, kind)
        size = f'width="{sheet.width:g}" height="{sheet.height:g}" font-family="{FAMILY}"'
        svg = _svg(sheet, PAINT.__getitem__, f'xmlns="http://www.w3.org/2000/svg" {size}')
        return f'<?xml version="1.0" encoding="UTF-8"?>\n<!-- irbcal -->\n{svg}\n'.encode()

    def save(self, path: str | PathLike[str]) -> Path:
        """Write the chart as PNG, SVG or PDF, as the ending of the path says: whole, or not at all.

        Raises
        ------
        OptionError
            If the ending is another one.
        CalibrationError
            If the file cannot be written.
        """
        path = check_name(path)
        kind = next(kind for kind in FILE_KINDS if path.suffix == f".{kind}")
        write_together(path.parent, {path.name: self.content(kind)})
        return path

    def _repr_svg_(self) -> str:
        return self.svg()


def check_name(path: str | PathLike[str]) -> Path:
    """Refuse endings that are no chart's, before any work is done; the path with its ending in small letters."""
    path = Path(path)
    if path.suffix.lower() not in [f".{kind}" for kind in FILE_KINDS]:
        raise OptionError(f"expected a name that ends in .png, .svg or .pdf, found {path.name!r}", file=path)
    return path.with_suffix(path.suffix.lower())


def inline(drawing: Drawing) -> Markup:
    """A drawing as part of a page."""
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
    content = "".join(mark.svg(paint) for mark in drawing.marks)
    return f'<svg viewBox="0 0 {drawing.width:g} {drawing.height:g}" {attributes}>{content}</svg>'


def _key(mark: Sign, colour: str, x: float, y: float) -> Mark:
    if mark == "o" or mark == "^" or mark == "v":
        return Dots(np.array([[x, y]]), colour, 8.0, shape=mark)
    return Lines([[(x - 8, y), (x + 8, y)]], colour, 2.0, DASHES[mark])


def _composed(chart: Chart) -> Drawing:
    """Caption, legend and drawings on one sheet."""
    columns = min(chart.columns, len(chart.drawings))
    widths = [max(d.width for d in chart.drawings[k::columns]) for k in range(columns)]
    width = max(sum(widths) + GAP * (columns - 1), WIDTH) + 2 * GAP
    sheet = Drawing(chart.caption, width=width)
    y = GAP
    for line in wrap(chart.mark + chart.caption, max(20, int((width - 2 * GAP) / (0.54 * FONT)))):
        y += 0.6 * FONT
        sheet.add(Text(GAP, y, line))
        y += 0.7 * FONT
    x = GAP
    for colour, sign, text in chart.legend:
        need = 30 + 0.56 * FONT * len(text)
        if x == GAP or x + need > width - GAP:
            x, y = GAP, y + 1.5 * FONT
        sheet.add(_key(sign, colour, x + 9, y), Text(x + 24, y, text, colour="soft"))
        x += need
    y += 1.5 * FONT
    for first in range(0, len(chart.drawings), columns):
        row = chart.drawings[first : first + columns]
        for k, drawing in enumerate(row):
            left = GAP + sum(widths[:k]) + GAP * k
            sheet.add(*(mark.moved(left, y) for mark in drawing.marks))
        y += max(drawing.height for drawing in row) + GAP
    return Drawing(sheet.label, y, width, [Boxes(np.array([[0, 0, width, y]]), "page"), *sheet.marks])


def _by_matplotlib(drawing: Drawing, kind: str) -> bytes:
    from io import BytesIO

    from matplotlib.figure import Figure

    metadata = {"png": {"Software": "irbcal"}, "pdf": {"Creator": "irbcal", "CreationDate": None}}[kind]
    with house_style():
        figure = Figure(figsize=(drawing.width / 72, drawing.height / 72))
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        for order, mark in enumerate(drawing.marks):
            mark.draw(axes, order)
        axes.set_xlim(0, drawing.width)
        axes.set_ylim(drawing.height, 0)
        stream = BytesIO()
        figure.savefig(stream, format=kind, dpi=DPI, metadata=metadata)
    return stream.getvalue()


@contextmanager
def house_style() -> Iterator[None]:
    """The settings that matplotlib comes with, whatever the user's: names from files are text, not formulas."""
    import matplotlib

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams["text.parse_math"] = False
        yield


# --- axes -------------------------------------------------------------------------------------------------


def step_of(span: float, parts_max: int) -> float:
    """The smallest of 1, 2, 5 times a power of ten that cuts a span into at most so many parts."""
    smallest = span / parts_max
    power = 10.0 ** np.floor(np.log10(smallest))
    return float(next(k for k in (1, 2, 5, 10) if k * power >= smallest * (1 - 1e-9)) * power)


def ticks(low: float, high: float, count: int = 5, whole: bool = False) -> tuple[FloatArray, list[str]]:
    """Round numbers between two ends, with their texts."""
    step = step_of(high - low, count)
    step = max(step, 1.0) if whole else step
    values = np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1) * step
    if len(values) < 3 and count < 12 and not whole:
        return ticks(low, high, count + 1)
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


def span(*values: ArrayLike, margin: float = 0.05) -> tuple[float, float]:
    """Ends of an axis around values, finite ones, with a margin as a share of their range."""
    every = np.concatenate([np.asarray(value, dtype=float).ravel() for value in values])
    every = every[np.isfinite(every)]
    if not every.size:
        return 0.0, 1.0
    low, high = float(every.min()), float(every.max())
    wide = margin * ((high - low) or max(abs(high), 1.0))
    return low - wide, high + wide


def runs(labels: Sequence[str] | NameArray) -> list[tuple[int, int, str]]:
    """Runs of equal labels: start, end, label."""
    edges = [0, *(k for k in range(1, len(labels)) if labels[k] != labels[k - 1]), len(labels)]
    return [(a, b, str(labels[a])) for a, b in pairwise(edges)]


def round_number(value: float) -> float:
    """Largest of 1, 2, 5 times a power of ten that is not above a value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(k for k in (1.0, 2.0, 5.0) if k * power <= value * (1 + 1e-12)) * power)


def up_to(value: float, count: int = 5) -> float:
    """The round number at or above a value where an axis from zero may end."""
    if not value > 0:
        return 1.0
    step = step_of(value, count) / 2
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
    x_ticks : tuple, optional
        Where words stand at x, and the words; no grid there.
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
        x_ticks: tuple[Sequence[float], Sequence[str]] | None = None,
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
        x_labels = x_ticks
        across = (
            ticks(*self.x, max(2, int((self.box[2] - self.box[0]) / 52)), whole_x) if x_labels is None else x_labels
        )
        left, head, right, foot = self.box
        x_lines = self.at(across[0], self.y[0])[:, 0]
        grid: list[Polyline] = [[(px, head), (px, foot)] for px in x_lines] if x_labels is None else []
        grid += [[(left, py), (right, py)] for py in self.at(self.x[0], y_ticks[0])[:, 1]]
        drawing.add(
            Lines([] if plain else grid, "line", 0.8), Lines([[(left, head), (left, foot), (right, foot)]], "soft", 1.0)
        )
        if x_label:
            for px, text in zip(x_lines, across[1], strict=True):
                drawing.add(Text(px, foot + 11, text, "middle", "soft", 11.0))
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
        px, py = np.asarray(x, dtype=float).ravel(), np.asarray(y, dtype=float).ravel()
        low, high = self.y
        if self.log:
            py, low, high = np.log10(py), np.log10(low), np.log10(high)
        left, head, right, foot = self.box
        across = (px - self.x[0]) / (self.x[1] - self.x[0])
        pixels = np.empty((max(len(px), len(py)) if len(px) and len(py) else 0, 2))
        pixels[:, 0] = left + across * (right - left)
        pixels[:, 1] = foot - (py - low) / (high - low) * (foot - head)
        return pixels

    def dots(self, x: ArrayLike, y: ArrayLike, colour: str, size: float = 4.0, **style: Any) -> None:
        """Marks at data."""
        self.drawing.add(Dots(self.at(x, y), colour, size, **style))

    def line(self, x: ArrayLike, y: ArrayLike, colour: str, width: float = LINE, **style: Any) -> None:
        """A line through data."""
        self.drawing.add(Lines([self.at(x, y)], colour, width, **style))

    def level(self, value: float, colour: str = "soft", **style: Any) -> None:
        """A horizontal line all across."""
        self.line(self.x, [value, value], colour, 1.0, **style)

    def upright(self, value: float, colour: str = "soft", **style: Any) -> None:
        """A vertical line from bottom to top."""
        self.line([value, value], self.y, colour, 1.0, **style)

    def bars(self, x: ArrayLike, y: ArrayLike, half: ArrayLike, colour: str) -> None:
        """Vertical bars about data, half of their lengths to each side."""
        for a, b, h in np.broadcast(x, y, half):
            self.line([a, a], [b - h, b + h], colour, 1.2)

    def boxes(
        self, left: ArrayLike, bottom: ArrayLike, right: ArrayLike, top: ArrayLike, colour: str, **style: Any
    ) -> None:
        """Rectangles between data."""
        self.drawing.add(Boxes(np.hstack([self.at(left, bottom), self.at(right, top)]), colour, **style))


def axis_top(*values: ArrayLike) -> float:
    """Where an axis from zero ends above values."""
    return up_to(1.07 * max((float(np.nanmax(v)) for v in values if np.size(v)), default=1.0))


def grouped_panel(drawing: Drawing, labels: Sequence[str] | NameArray, y: Sequence[float], x: str, label: str) -> Panel:
    """A panel with runs of equal labels at x: lines between them, the labels under their middle."""
    groups = runs(labels)
    ticks = [(a + b - 1) / 2 for a, b, _ in groups], [name for *_, name in groups]
    panel = Panel(drawing, (-1, len(labels)), y, x, label, x_ticks=ticks)
    for start, _, _ in groups[1:]:
        panel.upright(start - 0.5, "line")
    return panel
