"""A figure as a file: what its ending says, whole or not at all."""

import pytest
from lxml import etree

from irbcal.errors import CalibrationError, OptionError
from irbcal.figures.charts import Drawing, Figure, Text
from irbcal.figures.picture import SIMULATED, Picture


@pytest.fixture
def picture():
    drawing = Drawing("errors", 100.0)
    drawing.add(Text(10.0, 20.0, "a < b"))
    return Picture(Figure("errors", "Errors of <poses>", [drawing]), SIMULATED)


def test_svg_is_well_formed_and_marked(picture):
    root = etree.fromstring(picture.svg().encode())
    text = " ".join(root.itertext())
    assert "SIMULATED data. Errors of <poses>" in text
    assert "a < b" in text


def test_the_ending_decides(picture, tmp_path):
    assert picture.save(tmp_path / "p.svg").read_text() == picture.svg()
    assert picture.save(tmp_path / "p.png").read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    with pytest.raises(OptionError, match=r"ends in \.svg or \.png, found 'p.pdf'"):
        picture.save(tmp_path / "p.pdf")
    assert not (tmp_path / "p.pdf").exists()


def test_a_folder_is_not_overwritten(picture, tmp_path):
    (tmp_path / "p.svg").mkdir()
    with pytest.raises(CalibrationError, match="found a folder"):
        picture.save(tmp_path / "p.svg")
