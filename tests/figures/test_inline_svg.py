"""Figures of matplotlib inside a page."""

import re

from irbcal.figures import inline_svg
from irbcal.figures.marks import FONT


def draw(figure):
    axes = figure.add_subplot()
    (handle,) = axes.plot([0, 1], [1, 2], color="#123456", label="one & two")
    axes.set_xlabel("x <mm>")
    return [handle]


def drawn(key="k1"):
    with inline_svg.style():
        return str(inline_svg.drawn(draw, key, 'says "what" it shows'))


def test_text_takes_the_colour_of_the_page():
    svg = drawn()
    assert inline_svg.INK not in svg
    assert "currentColor" in svg
    assert "#123456" in svg
    assert f"{FONT:g}px" in svg
    assert "one &amp; two" in svg


def test_ids_are_the_pages_own():
    first, second = (set(re.findall(r'id="([^"]+)"', drawn(key))) for key in ("k1", "k2"))
    assert first
    assert not first & second
    svg = drawn()
    used = re.findall(r'(?:href="|url\()#([^")]+)', svg)
    assert used
    assert set(used) <= first


def test_nothing_is_loaded_and_the_words_are_for_all():
    svg = drawn()
    assert svg.startswith("<svg")
    assert "<metadata" not in svg
    assert "xmlns" not in svg
    assert "http" not in svg
    assert 'role="img"' in svg
    assert "says &quot;what&quot; it shows" in svg
    assert not re.search(r"<svg[^>]* (width|height)=", svg)


def test_figures_without_a_legend():
    with inline_svg.style():
        svg = inline_svg.drawn(lambda figure: figure.add_subplot() and None, "k", "")
    assert "legend" not in svg
