"""The marks that charts are made of: lines, dots, boxes and texts, as SVG or on matplotlib axes.

Places are in the units of a drawing, y downwards; colours are roles of `PAINT`. Marks are made by the thousand and are
never handed out: the arrays in them are not locked.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.figures import colours

if TYPE_CHECKING:
    from matplotlib.axes import Axes

PAINT = {
    "ink": colours.TEXT,
    "soft": colours.SOFT,
    "line": colours.RULE,
    "page": colours.PAPER,
    "nominal": colours.NOMINAL,
    "calibrated": colours.CALIBRATED,
    "below": colours.FROM_BELOW,
    "above": colours.FROM_ABOVE,
    "accent": colours.ACCENT,
    **{f"error{k}": colour for k, colour in enumerate(colours.ERRORS)},
}
"""Colours by role; on the page they are variables of the style sheet, so that the dark one can have others."""

FONT = 12.0
"""Size of body text in a drawing."""

Paint: TypeAlias = Callable[[str], str]
"""Gives the colour of a role."""

Anchor: TypeAlias = Literal["start", "middle", "end"]
Shape: TypeAlias = Literal["o", "^", "v"]
Polyline: TypeAlias = "FloatArray | Sequence[tuple[float, float]]"


def fixed(value: float, digits: int) -> str:
    """A number with a fixed count of decimals, without a minus sign before zero."""
    return format(round(value, digits) + 0.0, f".{digits}f")


def _number(value: float) -> str:
    return fixed(value, 1).removesuffix(".0")


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
    shape: Shape = "o"
    titles: Sequence[str] | None = None

    def svg(self, paint: Paint) -> str:
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
        titles: Sequence[str | None] = self.titles or [None] * len(places)
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
