"""Marks as SVG and on matplotlib axes."""

import numpy as np
import pytest

from irbcal.figures import marks
from irbcal.figures.marks import PAINT, Boxes, Dots, Lines, Text

ROLE = "<{}>".format


@pytest.mark.parametrize(
    ("value", "digits", "text"), [(-0.0004, 3, "0.000"), (1.25, 1, "1.2"), (2.0, 2, "2.00"), (-1.5, 0, "-2")]
)
def test_fixed_numbers(value, digits, text):
    assert marks.fixed(value, digits) == text


def test_lines():
    mark = Lines([[(0, 1), (2.04, 3)], [], np.array([[4, 5], [6.06, 7]])], "ink", 1.5, "4 3", 0.5)
    svg = mark.svg(ROLE)
    assert 'd="M0 1L2 3M4 5L6.1 7"' in svg
    assert 'stroke:<ink>" stroke-width="1.5" stroke-dasharray="4 3" opacity="0.5"' in svg
    assert Lines([], "ink").svg(ROLE) == ""
    assert 'd="M10 0L12 2' in mark.moved(10, -1).svg(ROLE)


def test_dots_with_and_without_words():
    xy = np.array([[1, 2], [3.5, 4]])
    assert 'd="M1 2h0M3.5 4h0"' in Dots(xy, "below", 5.0).svg(ROLE)
    said = Dots(xy, "below", titles=["<a>", "b"]).svg(ROLE)
    assert '<circle cx="1" cy="2" r="2"><title>&lt;a&gt;</title></circle>' in said
    up, down = (Dots(xy[:1], "below", 10.0, shape=shape).svg(ROLE) for shape in "^v")
    assert 'd="M1 -4.2l6.2 10.54h-12.4z"' in up
    assert 'd="M1 8.2l6.2 -10.54h-12.4z"' in down
    assert Dots(np.zeros((0, 2)), "below").svg(ROLE) == ""
    assert 'd="M2 4h0' in Dots(xy, "below").moved(1, 2).svg(ROLE)


def test_boxes():
    box = Boxes(np.array([[5, 1, 2, 9]]), "nominal", 0.3)
    assert '<rect x="2" y="1" width="3" height="8"/>' in box.svg(ROLE)
    assert "fill:<nominal>" in box.svg(ROLE)
    assert '<rect x="3" y="1"' in box.moved(1, 0).svg(ROLE)
    unseen = Boxes(np.array([[0, 0, 1, 1]]), "none", titles=["what"]).svg(ROLE)
    assert "pointer-events" in unseen
    assert "<title>what</title>" in unseen


def test_text_is_escaped_and_shown():
    svg = Text(1, 2, "a <b>\x00\ud800", "middle", bold=True).svg(ROLE)
    assert "a &lt;b&gt;\ufffd\ufffd</text>" in svg
    assert 'text-anchor="middle"' in svg
    assert "rotate" in Text(1, 2, "up", upright=False).svg(ROLE)
    assert 'x="3" y="2"' in Text(1, 2, "a").moved(2, 0).svg(ROLE)


def test_the_same_marks_on_axes():
    from matplotlib.figure import Figure

    axes = Figure().add_subplot()
    drawn = [
        Lines([[(0, 1), (2, 3)]], "ink", 2.0, "4 2"),
        Dots(np.array([[1, 2]]), "above", 6.0, shape="^"),
        Boxes(np.array([[0, 1, 2, 4]]), "nominal", 0.3),
        Boxes(np.array([[0, 0, 1, 1]]), "none", titles=["unseen"]),
        Text(1, 2, "words", "end"),
    ]
    for order, mark in enumerate(drawn):
        mark.draw(axes, order)
    lines, dots = axes.collections
    assert lines.get_linewidths()[0] == 2.0
    assert dots.get_sizes()[0] == pytest.approx(36 * 1.6)
    (box,) = axes.patches
    assert (box.get_x(), box.get_width(), box.get_height(), box.get_alpha()) == (0, 2, 3, 0.3)
    assert box.get_zorder() == 2
    (text,) = axes.texts
    assert (text.get_text(), text.get_ha(), text.get_color()) == ("words", "right", PAINT["ink"])
