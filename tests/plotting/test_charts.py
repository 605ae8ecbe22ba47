"""Charts: marks, axes, ticks, colours, and drawings as pages and files."""

import io
import re

import matplotlib
import numpy as np
import pytest
from lxml import etree

from irbcal import page_style
from irbcal.errors import CalibrationError, OptionError
from irbcal.plotting import charts
from irbcal.plotting.charts import Boxes, Chart, Dots, Drawing, Lines, Panel, Text, check_name, round_number, runs, span


@pytest.mark.parametrize(
    ("span", "most", "step"), [(1.0, 5, 0.2), (10.0, 4, 5.0), (0.9, 10, 0.1), (7.0, 7, 1.0), (2.1e-3, 5, 5e-4)]
)
def test_steps_are_round(span, most, step):
    assert charts.step_of(span, most) == pytest.approx(step, rel=1e-12)


def test_ticks():
    values, words = charts.ticks(-0.4, 1.0, 5)
    assert values == pytest.approx([0.0, 0.5, 1.0])
    assert words == ["0.0", "0.5", "1.0"]
    values, words = charts.ticks(0.0, 3.0, 5, whole=True)
    assert words == ["0", "1", "2", "3"]
    assert len(charts.ticks(0.0, 1.0, 2)[0]) >= 3, "two numbers are too few to read an axis"


def test_decades():
    values, words = charts.decades(0.01, 100.0)
    assert values == pytest.approx([0.01, 0.1, 1, 10, 100])
    assert words == ["0.01", "0.1", "1", "10", "100"]
    assert charts.decades(1.0, 10.0)[1] == ["1", "2", "5", "10"]
    assert len(charts.decades(1e-20, 1.0)[0]) <= 8


@pytest.mark.parametrize(("value", "end"), [(0.93, 1.0), (1.0, 1.0), (1.21, 1.25), (0.0, 1.0), (37.0, 40.0)])
def test_axes_end_at_round_numbers(value, end):
    assert charts.up_to(value) == pytest.approx(end)
    assert charts.up_to(value) >= value


def test_places_in_a_panel():
    panel = Panel(Drawing("d"), (0, 10), (0, 4), "x (mm)", "y (mm)")
    left, head, right, foot = panel.box
    assert panel.at([0, 10, 5], [0, 4, 2]) == pytest.approx(
        np.array([[left, foot], [right, head], [(left + right) / 2, (head + foot) / 2]])
    )
    log = Panel(Drawing("d"), (0, 1), (0.01, 100), "", "", log=True)
    assert log.at(0, 1)[0, 1] == pytest.approx((log.box[1] + log.box[3]) / 2)
    equal = Panel(Drawing("d"), (0, 10), (0, 1), "x", "y", equal=True)
    (x0, y0), (x1, y1) = equal.at([0, 1], [0, 1])
    assert x1 - x0 == pytest.approx(y0 - y1)
    assert sum(equal.x) / 2 == pytest.approx(5)


def figure():
    drawing = Drawing("a <drawing>")
    panel = Panel(drawing, (0, 10), (0, 4), "x (mm)", "y (mm)", title="title")
    panel.dots([1, 2], [1, 2], "nominal", titles=["one", "two"])
    panel.line([0, 10], [0, 4], "calibrated")
    panel.level(3.0)
    panel.boxes([0], [0], [1], [1], "accent")
    return Chart("name", "A caption", [drawing], [("nominal", "o", "nominal"), ("calibrated", "--", "calibrated")])


def test_pages_colour_the_marks():
    svg = str(charts.inline(figure().drawings[0]))
    assert 'aria-label="a &lt;drawing&gt;"' in svg
    assert "var(--nominal)" in svg
    assert "#" not in svg
    assert "<title>one</title>" in svg
    assert "stroke-dasharray" in str(charts.key("--", "calibrated"))


def test_files_carry_caption_and_legend():
    svg = figure().marked(True).svg()
    assert svg.startswith("<?xml")
    assert "SIMULATED data. A caption" in svg
    assert page_style.PAINT["nominal"] in svg
    assert "var(" not in svg


def test_png_files_are_the_same_each_time_and_on_white():
    from PIL import Image

    first, second = (figure().content("png") for _ in range(2))
    assert first == second
    with Image.open(io.BytesIO(first)) as image:
        assert image.convert("RGB").getpixel((1, 1)) == (255, 255, 255)
        colours = {colour for _, colour in image.convert("RGB").getcolors(1 << 20)}
    assert tuple(bytes.fromhex(page_style.PAINT["calibrated"][1:])) in colours


def test_drawings_grow_and_keep_their_order():
    drawing = Drawing("d")
    drawing.add(Boxes(np.array([[0, 0, 1, 1]]), "page"))
    drawing.add(*figure().drawings[0].marks[:2])
    assert len(drawing.marks) == 3
    assert Drawing("e").marks == [], "each has marks of its own"


ROLE = "<{}>".format


@pytest.mark.parametrize(
    ("value", "digits", "text"), [(-0.0004, 3, "0.000"), (1.25, 1, "1.2"), (2.0, 2, "2.00"), (-1.5, 0, "-2")]
)
def test_fixed_numbers(value, digits, text):
    assert charts.fixed(value, digits) == text


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
    assert (text.get_text(), text.get_ha(), text.get_color()) == ("words", "right", page_style.PAINT["ink"])


@pytest.fixture
def chart():
    drawing = Drawing("errors", 100.0)
    drawing.add(Text(10.0, 20.0, "a < b"))
    return Chart("errors", "Errors of <poses>", [drawing]).marked(True)


def test_svg_is_well_formed_and_marked(chart):
    root = etree.fromstring(chart.svg().encode())
    text = " ".join(root.itertext())
    assert "SIMULATED data. Errors of <poses>" in text
    assert "a < b" in text
    assert "SIMULATED" not in chart.marked(False).svg()


def test_the_ending_decides(chart, tmp_path):
    for name, start in (("a.png", b"\x89PNG"), ("b.SVG", b"<?xml"), ("c.pdf", b"%PDF")):
        path = chart.save(tmp_path / "new" / name)
        assert path.name == name.lower()
        assert path.read_bytes().startswith(start)
        assert path.read_bytes() == chart.content(path.suffix[1:])
    with pytest.raises(OptionError, match=r"d.docx: expected a name that ends in \.png, \.svg or \.pdf") as refused:
        chart.save(tmp_path / "d.docx")
    assert refused.value.file == str(tmp_path / "d.docx")
    assert check_name("x.Png").name == "x.png"


def test_a_folder_is_not_overwritten(chart, tmp_path):
    (tmp_path / "p.svg").mkdir()
    with pytest.raises(CalibrationError, match="found a folder"):
        chart.save(tmp_path / "p.svg")


def test_settings_of_the_user_neither_matter_nor_change(chart):
    first = chart.content("png")
    with matplotlib.rc_context({"font.size": 30, "axes.facecolor": "red", "savefig.facecolor": "red"}):
        assert chart.content("png") == first
        assert matplotlib.rcParams["font.size"] == 30


def test_names_from_files_are_text_not_formulas():
    drawing = Drawing("d", 100.0)
    drawing.add(Text(10.0, 20.0, "$x_{1$"))
    assert Chart("d", "$y_{", [drawing]).content("png").startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("value", "expected"), [(1.0, 1.0), (0.99, 0.5), (7.0, 5.0), (2.0, 2.0), (345.0, 200.0), (0.02, 0.02)]
)
def test_round_numbers(value, expected):
    assert round_number(value) == pytest.approx(expected)


def test_runs_of_labels_and_ends_of_axes():
    assert runs(["a", "a", "b", "a"]) == [(0, 2, "a"), (2, 3, "b"), (3, 4, "a")]
    assert span([1.0, float("nan")], [3.0]) == pytest.approx((0.9, 3.1))
    assert span([float("nan")]) == (0.0, 1.0)


def test_models_directions_and_words_are_told_apart():
    names = (
        "NOMINAL",
        "CALIBRATED",
        "FROM_BELOW",
        "FROM_ABOVE",
        "UNKNOWN",
        "MEASURED",
        "ACCENT",
        "TEXT",
        "SOFT",
        "RULE",
    )
    values = [getattr(page_style, name) for name in (*names, "PAPER")]
    assert all(re.fullmatch("#[0-9a-f]{6}", value) for value in (*values, *page_style.ERRORS, *page_style.SERIES))
    assert len(set(values)) == len(values)
    assert len(set(page_style.ERRORS)) == len(page_style.ERRORS)
    assert not set(page_style.SERIES) & {page_style.NOMINAL, page_style.CALIBRATED}, "a run is no model"


def contrast(colour, ground):
    """By WCAG 2.2, from 1 to 21."""

    def luminance(text):
        parts = np.array([int(text[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
        return np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4) @ [0.2126, 0.7152, 0.0722]

    dark, light = sorted((luminance(colour), luminance(ground)))
    return (light + 0.05) / (dark + 0.05)


@pytest.mark.parametrize("colours", [page_style.LIGHT, page_style.LIGHT | page_style.DARK], ids=["light", "dark"])
def test_words_and_marks_can_be_told_from_the_ground(colours):
    for role in ("ink", "soft", "state", "proof", "bad", "action"):
        assert contrast(colours[role], colours["page"]) > 4.5, role
    for role in page_style.PAINT.keys() - {"page", "line", "error2"}:  # the middle of a scale stands between its ends
        assert contrast(colours[role], colours["page"]) > 2.9, role


def test_no_minus_stands_before_zero():
    assert charts.fixed(-0.04, 1) == "0.0"
    assert 'd="M0 0L-1.1 2"' in charts.Lines([np.array([[-0.04, 0.0], [-1.06, 2.04]])], "red").svg(str)
