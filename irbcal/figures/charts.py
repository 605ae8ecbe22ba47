"""Charts as inline SVG that the page's style sheet colours, and the same charts as PNG or SVG files.

A drawing is a list of lines, dots, boxes and texts in its own units (a font of 12 is body text). Nothing runs in it:
what a mark is stands in its ``<title>``, which browsers show when the pointer rests on it.
"""

import re
from dataclasses import dataclass, field
from html import escape
from textwrap import wrap

import numpy as np

from irbcal.figures import colours

PAINT = {
    "ink": "#1b1f24",
    "soft": "#59636e",
    "line": "#d5dade",
    "page": "#ffffff",
    "nominal": colours.NOMINAL,
    "calibrated": colours.CALIBRATED,
    "below": colours.FROM_BELOW,
    "above": colours.FROM_ABOVE,
    "accent": colours.ACCENT,
    **{f"error{k}": colour for k, colour in enumerate(colours.ERRORS)},
}
"""Colours by role; on the page they are variables of the style sheet, so that the dark one can have others."""

WIDTH = 420.0
FONT = 12.0
FAMILY = "system-ui, 'Segoe UI', Roboto, Arial, sans-serif"
DPI = 200
GAP = 16.0


def fixed(value, digits):
    """A number with a fixed count of decimals, without a minus sign before zero."""
    return format(round(value, digits) + 0.0, f".{digits}f")


def _number(value):
    return fixed(value, 1).removesuffix(".0")


def _text(value):
    """Text for XML and HTML alike: escaped, without characters that neither may hold."""
    return escape(re.sub(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f\ud800-\udfff\ufffe\uffff]", "\ufffd", str(value)))


def _titled(element, attributes, title):
    return f"<{element} {attributes}><title>{_text(title)}</title></{element}>"


# --- marks ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Lines:
    """Polylines of one look."""

    paths: list
    colour: str
    width: float = 1.0
    dash: str = ""
    opacity: float = 1.0

    def svg(self, paint):
        """As SVG; ``paint`` gives the colour of a role."""
        d = "".join("M" + "L".join(f"{_number(x)} {_number(y)}" for x, y in path) for path in self.paths if len(path))
        dash = f' stroke-dasharray="{self.dash}"' if self.dash else ""
        faint = f' opacity="{self.opacity:g}"' if self.opacity < 1 else ""
        style = f"fill:none;stroke:{paint(self.colour)}"
        return f'<path d="{d}" style="{style}" stroke-width="{self.width:g}"{dash}{faint}/>' if d else ""

    def draw(self, axes, order):
        """On matplotlib axes that have the units of the drawing, above what has a lower order."""
        from matplotlib.collections import LineCollection

        dash = (0, [float(v) / self.width for v in self.dash.split()]) if self.dash else "solid"
        style = {"colors": PAINT[self.colour], "linewidths": self.width, "linestyles": [dash], "alpha": self.opacity}
        style["zorder"] = order
        axes.add_collection(LineCollection([np.asarray(path) for path in self.paths if len(path)], **style))

    def moved(self, dx, dy):
        """The same elsewhere."""
        paths = [np.asarray(path) + np.array([dx, dy]) for path in self.paths]
        return Lines(paths, self.colour, self.width, self.dash, self.opacity)


@dataclass(frozen=True)
class Dots:
    """Marks of one look: circles, or triangles that point up or down; titles, if any, one for each."""

    xy: np.ndarray
    colour: str
    size: float = 4.0
    opacity: float = 1.0
    shape: str = "o"
    titles: list | None = None

    def svg(self, paint):
        """As SVG; ``paint`` gives the colour of a role."""
        if not len(self.xy):
            return ""
        places = [(_number(x), _number(y)) for x, y in np.asarray(self.xy).tolist()]
        colour, faint = paint(self.colour), f' opacity="{self.opacity:g}"' if self.opacity < 1 else ""
        if self.titles is None and self.shape == "o":
            d = "".join(f"M{x} {y}h0" for x, y in places)
            style = f"fill:none;stroke:{colour}"
            return f'<path d="{d}" style="{style}" stroke-width="{self.size:g}" stroke-linecap="round"{faint}/>'
        if self.shape == "o":
            marks = (f'circle|cx="{x}" cy="{y}" r="{self.size / 2:g}"' for x, y in places)
        else:
            half, up = 0.62 * self.size, -1 if self.shape == "^" else 1
            corners = f"l{half:g} {-1.7 * up * half:g}h{-2 * half:g}z"
            marks = (f'path|d="M{x} {_number(float(y) + up * half)}{corners}"' for x, y in places)
        out = []
        for mark, title in zip(marks, self.titles or [None] * len(places), strict=True):
            element, attributes = mark.split("|")
            out.append(f"<{element} {attributes}/>" if title is None else _titled(element, attributes, title))
        return f'<g class="marks" style="fill:{colour}"{faint}>{"".join(out)}</g>'

    def draw(self, axes, order):
        """On matplotlib axes that have the units of the drawing, above what has a lower order."""
        marker = {"o": "o", "^": "^", "v": "v"}[self.shape]
        x, y = np.asarray(self.xy, dtype=float).reshape(-1, 2).T
        size = self.size**2 * (1.0 if self.shape == "o" else 1.6)
        axes.scatter(
            x, y, size, color=PAINT[self.colour], alpha=self.opacity, marker=marker, linewidths=0, zorder=order
        )

    def moved(self, dx, dy):
        """The same elsewhere."""
        return Dots(
            np.asarray(self.xy) + np.array([dx, dy]), self.colour, self.size, self.opacity, self.shape, self.titles
        )


@dataclass(frozen=True)
class Boxes:
    """Rectangles of one look, rows x0, y0, x1, y1; of colour ``none`` they only carry titles."""

    corners: np.ndarray
    colour: str
    opacity: float = 1.0
    titles: list | None = None

    def svg(self, paint):
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

    def draw(self, axes, order):
        """On matplotlib axes that have the units of the drawing, above what has a lower order."""
        from matplotlib.patches import Rectangle

        if self.colour != "none":
            for x0, y0, x1, y1 in np.asarray(self.corners).tolist():
                style = {"facecolor": PAINT[self.colour], "alpha": self.opacity, "linewidth": 0, "snap": True}
                style["zorder"] = order
                axes.add_patch(Rectangle((x0, y0), x1 - x0, y1 - y0, **style))

    def moved(self, dx, dy):
        """The same elsewhere."""
        return Boxes(np.asarray(self.corners) + np.array([dx, dy, dx, dy]), self.colour, self.opacity, self.titles)


@dataclass(frozen=True)
class Text:
    """One line of text; its place is the middle of its height."""

    x: float
    y: float
    text: str
    anchor: str = "start"
    colour: str = "ink"
    size: float = FONT
    upright: bool = True
    bold: bool = False

    def svg(self, paint):
        """As SVG; ``paint`` gives the colour of a role."""
        turn = "" if self.upright else f' transform="rotate(-90 {_number(self.x)} {_number(self.y)})"'
        weight = ' font-weight="600"' if self.bold else ""
        return (
            f'<text x="{_number(self.x)}" y="{_number(self.y)}" dy=".35em" text-anchor="{self.anchor}" '
            f'font-size="{self.size:g}" style="fill:{paint(self.colour)}"{weight}{turn}>{_text(self.text)}</text>'
        )

    def draw(self, axes, order):
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

    def moved(self, dx, dy):
        """The same elsewhere."""
        return Text(self.x + dx, self.y + dy, self.text, self.anchor, self.colour, self.size, self.upright, self.bold)


# --- drawings and figures ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Drawing:
    """One SVG image of a page: marks in order, the later ones above the earlier."""

    label: str
    height: float = 240.0
    width: float = WIDTH
    items: list = field(default_factory=list)

    def add(self, *items):
        """Add marks."""
        self.items.extend(items)


@dataclass(frozen=True)
class Figure:
    """Drawings that belong together, with a caption and a legend outside of them.

    Attributes
    ----------
    name : str
        Of the file.
    caption : str
    drawings : list of Drawing
    legend : list of tuple
        (colour, mark, words); marks are ``o``, ``^``, ``v``, ``-`` and ``--``.
    columns : int
        Of a file; a page has as many as fit.
    """

    name: str
    caption: str
    drawings: list
    legend: list = ()
    columns: int = 2


def inline(drawing):
    """A drawing as part of a page.

    Parameters
    ----------
    drawing : Drawing

    Returns
    -------
    markupsafe.Markup
    """
    from markupsafe import Markup

    return Markup(_svg(drawing, _variable, f'role="img" aria-label="{_text(drawing.label)}"'))


def key(mark, colour):
    """The mark of a legend as part of a page."""
    from markupsafe import Markup

    drawing = Drawing("", 12.0, 18.0, [_key(mark, colour, 9.0, 6.0)])
    return Markup(_svg(drawing, _variable, 'class="mark" width="18" height="12" aria-hidden="true"'))


def _variable(role):
    return f"var(--{role})"


def _svg(drawing, paint, attributes):
    content = "".join(item.svg(paint) for item in drawing.items)
    return f'<svg viewBox="0 0 {drawing.width:g} {drawing.height:g}" {attributes}>{content}</svg>'


def _key(mark, colour, x, y):
    if mark in ("-", "--"):
        return Lines([[(x - 8, y), (x + 8, y)]], colour, 2.0, "4 3" if mark == "--" else "")
    return Dots(np.array([[x, y]]), colour, 8.0, shape=mark)


def file(figure, kind, mark=""):
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


def _composed(figure, mark):
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


def _png(drawing):
    from io import BytesIO

    import matplotlib
    from matplotlib.figure import Figure as Canvas

    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams["text.parse_math"] = False
        canvas = Canvas(figsize=(drawing.width / 72, drawing.height / 72))
        axes = canvas.add_axes((0, 0, 1, 1))
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


def step_of(span, most):
    """The smallest of 1, 2, 5 times a power of ten that cuts a span into at most so many parts."""
    least = span / most
    power = 10.0 ** np.floor(np.log10(least))
    return float(next(k for k in (1, 2, 5, 10) if k * power >= least * (1 - 1e-9)) * power)


def ticks(low, high, most=5, whole=False):
    """Round numbers between two ends, with their texts."""
    step = step_of(high - low, most)
    step = max(step, 1.0) if whole else step
    values = np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1) * step
    if len(values) < 3 and most < 12 and not whole:
        return ticks(low, high, most + 1)
    digits = max(0, -int(np.floor(np.log10(step) + 1e-9)))
    return values, [f"{value + 0.0:.{digits}f}" for value in np.round(values, digits + 1)]


def decades(low, high):
    """Powers of ten between two ends, with 2 and 5 times them where there are few."""
    ends = range(int(np.floor(np.log10(low))), int(np.ceil(np.log10(high))) + 1)
    factors = (1,) if high > 50 * low else (1, 2, 5)
    values = np.array([k * 10.0**e for e in ends for k in factors])
    values = values[(values >= low * (1 - 1e-9)) & (values <= high * (1 + 1e-9))]
    if len(values) > 8:
        values = values[:: -(-len(values) // 8)]
    return values, [f"{value:g}" for value in values]


def up_to(value, most=5):
    """The round number at or above a value where an axis from zero may end."""
    if not value > 0:
        return 1.0
    step = step_of(value, most) / 2
    return float(np.ceil(value / step - 1e-9) * step)


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
        drawing,
        x,
        y,
        x_label,
        y_label,
        top=0.0,
        bottom=None,
        log=False,
        whole_x=False,
        whole_y=False,
        title="",
        equal=False,
        plain=False,
    ):
        self.drawing, self.log = drawing, log
        bottom = drawing.height if bottom is None else bottom
        self.box = [44.0, top + (26.0 if title else 8.0), drawing.width - 10.0, bottom - (38.0 if x_label else 8.0)]
        self.x, self.y = tuple(map(float, x)), tuple(map(float, y))
        y_ticks = (decades(*self.y) if log else ticks(*self.y, self._most(20), whole_y)) if not plain else ((), ())
        self.box[0] = 26.0 + 6.8 * max((len(text) for text in y_ticks[1]), default=1)
        if equal:
            self._equal()
            y_ticks = ticks(*self.y, self._most(24))
        x_ticks = ticks(*self.x, max(2, int((self.box[2] - self.box[0]) / 52)), whole_x)
        left, head, right, foot = self.box
        grid = [[(px, head), (px, foot)] for px in self.at(x_ticks[0], self.y[0])[:, 0]]
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

    def _most(self, apart):
        return max(2, int((self.box[3] - self.box[1]) / apart / 1.4))

    def _equal(self):
        left, head, right, foot = self.box
        unit = max((self.x[1] - self.x[0]) / (right - left), (self.y[1] - self.y[0]) / (foot - head))
        for name, length in (("x", right - left), ("y", foot - head)):
            middle = sum(getattr(self, name)) / 2
            setattr(self, name, (middle - unit * length / 2, middle + unit * length / 2))

    def at(self, x, y):
        """Places in the drawing, shape (k, 2)."""
        x, y = np.broadcast_arrays(np.asarray(x, dtype=float).ravel(), np.asarray(y, dtype=float).ravel())
        low, high = self.y
        if self.log:
            y, low, high = np.log10(y), np.log10(low), np.log10(high)
        left, head, right, foot = self.box
        across = (x - self.x[0]) / (self.x[1] - self.x[0])
        return np.column_stack([left + across * (right - left), foot - (y - low) / (high - low) * (foot - head)])

    def dots(self, x, y, colour, size=4.0, **style):
        """Marks at data."""
        self.drawing.add(Dots(self.at(x, y), colour, size, **style))

    def line(self, x, y, colour, width=1.4, **style):
        """A line through data."""
        self.drawing.add(Lines([self.at(x, y)], colour, width, **style))

    def level(self, value, colour="soft", **style):
        """A horizontal line all across."""
        self.line(self.x, [value, value], colour, 1.0, **style)

    def boxes(self, left, bottom, right, top, colour, **style):
        """Rectangles between data."""
        self.drawing.add(Boxes(np.hstack([self.at(left, bottom), self.at(right, top)]), colour, **style))
