"""One look whatever the user's settings, and files that do not change from day to day."""

import matplotlib
import pytest

from irbcal.figures import style
from irbcal.figures.colours import CALIBRATED, NOMINAL, TEXT


def line(figure, label="a"):
    axes = figure.add_subplot()
    axes.plot([0, 1], [1, 2], label=label)
    axes.plot([0, 1], [2, 3])
    axes.set_title(label)


def test_settings_of_the_user_neither_matter_nor_change():
    with matplotlib.rc_context({"axes.grid": False, "font.size": 30, "axes.facecolor": "red"}):
        figure = style.drawn(line)
        axes = figure.axes[0]
        assert axes.get_facecolor() == (1, 1, 1, 1)
        assert axes.title.get_fontsize() == style.FONT
        assert axes.title.get_color() == TEXT
        assert not axes.spines["top"].get_visible()
        assert [item.get_color() for item in axes.get_lines()] == [CALIBRATED, NOMINAL]
        assert axes.get_lines()[0].get_linewidth() == style.LINE
        first = style.as_bytes(figure)
        assert matplotlib.rcParams["font.size"] == 30
    assert style.as_bytes(style.drawn(line)) == first


def test_changes_of_the_look():
    with style.house_style({"font.size": 20.0}):
        assert matplotlib.rcParams["font.size"] == 20.0
        assert matplotlib.rcParams["axes.grid"]


@pytest.mark.parametrize(("kind", "start"), [("png", b"\x89PNG"), ("svg", b"<?xml"), ("pdf", b"%PDF")])
def test_files_are_the_same_each_time(kind, start):
    first, second = (style.as_bytes(style.drawn(line), kind) for _ in range(2))
    assert first.startswith(start)
    assert first == second


def test_names_from_files_are_text_not_formulas():
    svg = style.as_bytes(style.drawn(line, style.SIZE, "$x_1$ <b>"), "svg").decode()
    assert "$x_1$ &lt;b&gt;" in svg


def test_size_and_resolution():
    import io

    from PIL import Image

    with Image.open(io.BytesIO(style.as_bytes(style.drawn(line, (4.0, 3.0)), dpi=100))) as image:
        assert image.size == (400, 300)


def test_all_kinds_have_a_way_to_be_written():
    assert style.KINDS == ("png", "svg", "pdf")
    with pytest.raises(KeyError):
        style.as_bytes(style.drawn(line), "docx")
