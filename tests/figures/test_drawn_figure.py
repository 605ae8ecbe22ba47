"""Figures of matplotlib as files."""

import pytest

from irbcal.errors import CalibrationError, IrbcalError
from irbcal.figures.drawn_figure import DrawnFigure, check_name


def draw(figure, height):
    figure.add_subplot().plot([0, height])


def test_files_by_their_ending(tmp_path):
    drawn = DrawnFigure.of(draw, 3.0, size=(4.0, 2.0))
    for name, start in (("a.png", b"\x89PNG"), ("b.SVG", b"<?xml"), ("c.pdf", b"%PDF")):
        path = drawn.save(tmp_path / "new" / name)
        assert path.name == name.lower()
        assert path.read_bytes().startswith(start)
    assert drawn._repr_png_() == (tmp_path / "new" / "a.png").read_bytes()
    assert drawn.figure.get_size_inches().tolist() == [4.0, 2.0]
    assert drawn.figure.axes[0].get_lines()[0].get_ydata().tolist() == [0, 3.0]


def test_other_endings_are_refused(tmp_path):
    with pytest.raises(IrbcalError, match=r"d.docx: figures end in .png, .svg, .pdf") as refused:
        DrawnFigure.of(draw, 1.0).save(tmp_path / "d.docx")
    assert refused.value.file == str(tmp_path / "d.docx")
    assert check_name("x.Png").name == "x.png"


def test_a_folder_in_the_way(tmp_path):
    (tmp_path / "a.png").mkdir()
    with pytest.raises(CalibrationError, match="found a folder"):
        DrawnFigure.of(draw, 1.0).save(tmp_path / "a.png")
