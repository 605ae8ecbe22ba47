"""The numbers of a report and the data behind its figures."""

import csv
import io

import jinja2
import pytest
from lxml import etree, html
from report_cases import NASTY, everywhere, some_errors

from irbcal.reports import report_page


def rows_under(page, caption):
    """Cells of the table with this caption."""
    (table,) = html.document_fromstring(page).xpath(f"//table[caption='{caption}']")
    return [[" ".join(cell.text_content().split()) for cell in row] for row in table.xpath(".//tr")]


def test_tables_hold_the_exact_figures(calibration):
    nominal, calibrated = some_errors(0.8253414, ("smr1", "smr2")), some_errors(0.43848, ("smr1", "smr2"), ())
    calibration = calibration.model_copy(
        update={"heldout": calibrated, "heldout_nominal": nominal, "poses_heldout": 296}
    )
    page = report_page.render(calibration)
    assert rows_under(page, "Position error, 296 poses (mm)") == [
        ["model", "n", "mean", "sigma", "max", "mean+3σ", "rms"],
        ["nominal", "888", "0.825", "0.321", "2.500", "1.825", "0.925"],
        ["calibrated", "888", "0.438", "0.321", "2.500", "1.438", "0.538"],
    ]
    assert rows_under(page, "Held-out poses by target (mm)")[3:] == [
        ["smr2", "nominal", "888", "0.835", "0.321", "2.500", "1.835", "0.935"],
        ["calibrated", "888", "0.448", "0.321", "2.500", "1.448", "0.548"],
    ]


def test_files_of_hostile_names_and_simulated_data(calibration):
    changed = everywhere(calibration.model_copy(update={"simulated": True}), NASTY)
    evidence = report_page.gather(changed)
    for content in report_page.figure_files(changed, evidence, "svg").values():
        root = etree.fromstring(content)
        assert {etree.QName(e).localname for e in root.iter()} <= {
            "svg",
            "g",
            "path",
            "circle",
            "rect",
            "text",
            "title",
        }
        assert b"SIMULATED data" in content
    rows = list(csv.DictReader(io.StringIO(report_page.data_files(changed, evidence)["poses.csv"].decode())))
    assert rows[0]["pose"] == NASTY
    assert rows[0]["simulated"] == "1"


def test_numbers_and_names():
    assert report_page.in_unit(1.23456, "mm") == "1.235"
    assert report_page.in_unit(1.23456789, "kg") == "1.23457"
    assert report_page.deviation(None, "mm") == "–"
    assert report_page.deviation(1e-5, "mm") == "< 0.001"
    assert (report_page.count(1, "pose"), report_page.count(2, "pose")) == ("1 pose", "2 poses")
    assert report_page.file_name("/home/me/robot.urdf") == "robot.urdf"
    assert report_page.file_name("C:\\data\\m.csv") == "m.csv"
    assert report_page.file_name("m.csv") == "m.csv"
    assert report_page.short("abc", 10) == "abc"
    long = report_page.short("a" * 50 + "z", 10)
    assert len(long) == 10
    assert long.endswith("z")


def test_a_template_misses_nothing():
    with pytest.raises(jinja2.UndefinedError):
        report_page.template("certificate.html.j2").render()
