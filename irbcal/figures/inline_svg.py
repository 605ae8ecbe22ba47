"""Matplotlib figures as inline SVG for a page: the page's own text colour, no ids shared between figures."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from io import BytesIO
from typing import TYPE_CHECKING, Any

from irbcal.figures.marks import FONT
from irbcal.figures.style import house_style

if TYPE_CHECKING:
    from markupsafe import Markup
    from matplotlib.figure import Figure

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
