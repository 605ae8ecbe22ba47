"""matplotlib's figures of the study as inline SVG for its page: the page's own text colour, no ids shared."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from io import BytesIO
from typing import TYPE_CHECKING, Any

from irbcal.page_style import ACCENT, CALIBRATED, FROM_ABOVE, FROM_BELOW, NOMINAL, RULE, SOFT, TEXT, UNKNOWN
from irbcal.plotting.charts import FONT

if TYPE_CHECKING:
    from markupsafe import Markup
    from matplotlib.figure import Figure

LINE, THIN = 1.4, 0.8
"""Widths of lines of data and of lines that help."""

LOOK: dict[str, Any] = {
    "font.size": 10.0,
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


INK = "#010203"
"""Stands for the text's colour in figures until the page's own takes its place."""

INKED = ("text.color", "axes.labelcolor", "axes.titlecolor", "axes.edgecolor", "grid.color")
TICKS = tuple(f"{axis}tick.{what}" for axis in "xy" for what in ("color", "labelcolor"))


def style() -> AbstractContextManager[None]:
    """The house's style with the page's text colour and font size: to be entered before `drawn`."""
    changes: dict[str, Any] = dict.fromkeys((*INKED, *TICKS), INK)
    return house_style(changes | {"font.size": FONT, "grid.alpha": 0.15})


def drawn(draw: Callable[[Figure], Sequence[Any] | None], key: str, text: str) -> Markup:
    """A figure as inline SVG.

    Parameters
    ----------
    draw : callable
        Draws into a matplotlib figure and returns the handles of a legend, if there is one.
    key : str
        Unique on the page; goes before every id.
    text : str
        What the figure shows, for those who cannot see it.

    Returns
    -------
    markupsafe.Markup
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.8, 3.6), layout="constrained")
    handles = draw(figure)
    if handles:
        figure.legend(handles=handles, loc="outside upper right", ncols=2, frameon=False, handlelength=1.0)
    stream = BytesIO()
    figure.savefig(stream, format="svg", transparent=True, dpi=180, metadata={"Date": None})
    return _inline(stream.getvalue(), key, text)


def _inline(svg: bytes, key: str, text: str) -> Markup:
    """An SVG file as part of a page: ids of its own, the page's colour, no metadata, no namespaces."""
    from lxml import etree
    from markupsafe import Markup

    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, remove_comments=True)
    root = etree.fromstring(svg, parser)
    for element in list(root.iter()):
        element.tag = etree.QName(element).localname
        if element.tag in ("metadata", "style"):
            element.getparent().remove(element)
            continue
        for name, value in list(element.attrib.items()):
            local = etree.QName(name).localname
            del element.attrib[name]
            if local == "id":
                value = f"{key}-{value}"
            elif local == "href" and value.startswith("#"):
                value = f"#{key}-{value[1:]}"
            element.set(local, value.replace("url(#", f"url(#{key}-").replace(INK, "currentColor"))
    for name in ("width", "height", "version"):
        root.attrib.pop(name, None)
    root.set("role", "img")
    root.set("aria-label", text)
    etree.cleanup_namespaces(root)
    return Markup(etree.tostring(root, encoding="unicode"))
