"""Charts: axes, ticks, and drawings as pages and files."""

import io

import numpy as np
import pytest

from irbcal.figures import charts
from irbcal.figures.charts import Boxes, Drawing, Figure, Panel


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
    return Figure("name", "A caption", [drawing], [("nominal", "o", "nominal"), ("calibrated", "--", "calibrated")])


def test_pages_colour_the_marks():
    svg = str(charts.inline(figure().drawings[0]))
    assert 'aria-label="a &lt;drawing&gt;"' in svg
    assert "var(--nominal)" in svg
    assert "#" not in svg
    assert "<title>one</title>" in svg
    assert "stroke-dasharray" in str(charts.key("--", "calibrated"))


def test_files_carry_caption_and_legend():
    svg = charts.file(figure(), "svg", "SIMULATED data. ").decode()
    assert svg.startswith("<?xml")
    assert "SIMULATED data. A caption" in svg
    assert charts.PAINT["nominal"] in svg
    assert "var(" not in svg


def test_png_files_are_the_same_each_time_and_on_white():
    from PIL import Image

    first, second = (charts.file(figure(), "png") for _ in range(2))
    assert first == second
    with Image.open(io.BytesIO(first)) as image:
        assert image.convert("RGB").getpixel((1, 1)) == (255, 255, 255)
        colours = {colour for _, colour in image.convert("RGB").getcolors(1 << 20)}
    assert tuple(bytes.fromhex(charts.PAINT["calibrated"][1:])) in colours


def test_drawings_grow_and_keep_their_order():
    drawing = Drawing("d")
    drawing.add(Boxes(np.array([[0, 0, 1, 1]]), "page"))
    drawing.add(*figure().drawings[0].items[:2])
    assert len(drawing.items) == 3
    assert Drawing("e").items == [], "each has marks of its own"
