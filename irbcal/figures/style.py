"""The look of all figures that matplotlib draws, and figures as the bytes of a file.

Charts of the report are drawn without matplotlib (`irbcal.figures.charts`) with the same colours and line widths.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from io import BytesIO
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec

from irbcal.figures.colours import ACCENT, CALIBRATED, FROM_ABOVE, FROM_BELOW, NOMINAL, RULE, SOFT, TEXT, UNKNOWN

if TYPE_CHECKING:
    from matplotlib.figure import Figure

P = ParamSpec("P")

SIZE = (7.2, 4.4)
"""Width and height of a figure unless it says otherwise, inches."""

DPI = 150
KINDS = ("png", "svg", "pdf")
"""What a figure can be written as."""

FONT, SMALL = 10.0, 8.0
LINE, THIN = 1.4, 0.8
"""Widths of lines of data and of lines that help."""

LOOK: dict[str, Any] = {
    "font.size": FONT,
    "axes.titlesize": "medium",
    "figure.titlesize": "medium",
    "text.color": TEXT,
    "axes.labelcolor": TEXT,
    "axes.titlecolor": TEXT,
    "xtick.labelcolor": TEXT,
    "ytick.labelcolor": TEXT,
    "axes.edgecolor": SOFT,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "grid.color": RULE,
    "grid.linewidth": THIN,
    "axes.linewidth": THIN,
    "lines.linewidth": LINE,
    "lines.markersize": 4.0,
    "legend.frameon": False,
    # of strings, since a Cycler would need matplotlib when this module is imported
    "axes.prop_cycle": f"cycler('color', {[CALIBRATED, NOMINAL, FROM_BELOW, FROM_ABOVE, ACCENT, UNKNOWN]})",
    "text.parse_math": False,
    "svg.fonttype": "none",
    "svg.hashsalt": "irbcal",
}
"""Settings of matplotlib. Names from files are text, not formulas; SVG files are the same whenever they are written."""


@contextmanager
def house_style(changes: Mapping[str, Any] | None = None) -> Iterator[None]:
    """Figures made, drawn and written here look alike, whatever the user's own settings of matplotlib.

    Parameters
    ----------
    changes : dict, optional
        Settings of matplotlib that differ from `LOOK`.
    """
    import matplotlib

    settings: Any = {**LOOK, **(changes or {})}
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(settings)
        yield


def drawn(
    draw: Callable[Concatenate[Figure, P], Any],
    size: tuple[float, float] = SIZE,
    /,
    *args: P.args,
    **kwargs: P.kwargs,
) -> Figure:
    """A figure in the house's style.

    Parameters
    ----------
    draw : callable
        Takes the figure and what follows.
    size : tuple of float
        Inches.
    *args, **kwargs
        What ``draw`` takes after the figure.

    Returns
    -------
    matplotlib.figure.Figure
    """
    from matplotlib.figure import Figure

    with house_style():
        figure = Figure(figsize=size, layout="constrained")
        draw(figure, *args, **kwargs)
    return figure


def as_bytes(figure: Figure, kind: str = "png", dpi: float = DPI) -> bytes:
    """A figure as the content of a file, the same each time: no dates, no versions.

    Parameters
    ----------
    figure : matplotlib.figure.Figure
    kind : str
        One of `KINDS`.
    dpi : float
        Of PNG files, and of what is drawn as pixels in the others.

    Returns
    -------
    bytes
    """
    metadata = {"png": {"Software": None}, "svg": {"Date": None}, "pdf": {"CreationDate": None}}[kind]
    stream = BytesIO()
    with house_style():
        figure.savefig(stream, format=kind, dpi=dpi, metadata=metadata)
    return stream.getvalue()
