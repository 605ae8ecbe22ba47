"""Numbers and names as pages show them."""

import jinja2
import pytest

from irbcal.reports import paper


def test_numbers_and_names():
    assert paper.in_unit(1.23456, "mm") == "1.235"
    assert paper.in_unit(1.23456789, "kg") == "1.23457"
    assert paper.deviation(None, "mm") == "–"
    assert paper.deviation(1e-5, "mm") == "< 0.001"
    assert (paper.count(1, "pose"), paper.count(2, "pose")) == ("1 pose", "2 poses")
    assert paper.file_name("/home/me/robot.urdf") == "robot.urdf"
    assert paper.file_name("C:\\data\\m.csv") == "m.csv"
    assert paper.file_name("m.csv") == "m.csv"
    assert paper.short("abc", 10) == "abc"
    long = paper.short("a" * 50 + "z", 10)
    assert len(long) == 10
    assert long.endswith("z")


def test_a_template_misses_nothing():
    with pytest.raises(jinja2.UndefinedError):
        paper.template("certificate.html.j2").render()
