"""Numbers and names as pages show them."""

import jinja2
import pytest

from irbcal.reports import report_data


def test_numbers_and_names():
    assert report_data.in_unit(1.23456, "mm") == "1.235"
    assert report_data.in_unit(1.23456789, "kg") == "1.23457"
    assert report_data.deviation(None, "mm") == "–"
    assert report_data.deviation(1e-5, "mm") == "< 0.001"
    assert (report_data.count(1, "pose"), report_data.count(2, "pose")) == ("1 pose", "2 poses")
    assert report_data.file_name("/home/me/robot.urdf") == "robot.urdf"
    assert report_data.file_name("C:\\data\\m.csv") == "m.csv"
    assert report_data.file_name("m.csv") == "m.csv"
    assert report_data.short("abc", 10) == "abc"
    long = report_data.short("a" * 50 + "z", 10)
    assert len(long) == 10
    assert long.endswith("z")


def test_a_template_misses_nothing():
    with pytest.raises(jinja2.UndefinedError):
        report_data.template("certificate.html.j2").render()
