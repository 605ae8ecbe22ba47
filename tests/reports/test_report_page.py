"""The report: one page that says what calibration.json says, and that no name in it can turn into code."""

import csv
import io
import json
import re

import jinja2
import numpy as np
import pandas as pd
import pytest
from lxml import etree, html
from report_cases import (
    NASTY,
    assert_harmless,
    drawings,
    everywhere,
    some_errors,
    text_of,
    with_points,
    without_heldout,
)
from support import TARGETS
from typer.testing import CliRunner

import irbcal
from irbcal.cli import main
from irbcal.error_statistics import RotationStatistics
from irbcal.errors import CalibrationError
from irbcal.identification.fit_sections import Candidate, LevelChoice
from irbcal.measurement.cleaning import Exclusion
from irbcal.plotting import charts
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


def test_figures_are_those_of_the_calibration(calibration, page):
    assert_harmless(page)
    seen = text_of(page)
    for errors in (calibration.heldout, calibration.heldout_nominal, calibration.fit, calibration.fit_nominal):
        for values in (errors.all, *errors.per_target.values()):
            cells = "".join(f"{v:.3f}" for k, v in values.model_dump().items() if k != "n")
            assert f"{values.n} {cells}" in seen
    (table,) = html.document_fromstring(page).xpath("//section[@id='parameters']//table[contains(caption, 'delta')]")
    rows = [[cell.text_content() for cell in row] for row in table.xpath("tbody/tr")]
    assert len(rows) == len(calibration.parameters)
    for p, (name, value, unit, std, interval, state, reason) in zip(calibration.parameters, rows, strict=True):
        assert (name, unit, state, reason) == (p.name, p.unit, p.state, p.reason)
        digits = {"mm": 3, "deg": 4, "1": 6}[unit]
        assert float(value) == round(p.value, digits)
        assert re.fullmatch(rf"-?\d+\.\d{{{digits}}}", value)
        assert not re.fullmatch(r"-0\.0*", value)
        assert (std == "–") == (interval == "–") == (p.std is None)
    for sentence in calibration.undetermined:
        assert sentence in seen
    assert calibration.data[0].sha256 in seen
    assert f"{calibration.rank} independent" in seen
    assert html.document_fromstring(page).get("lang") == "en"
    assert page.startswith("<!DOCTYPE html>")
    assert not [text for text in html.document_fromstring(page).itertext() if re.search(r"\d\.\d{7}", text)]
    assert "Simulated" not in seen
    assert "Nothing is proven" not in seen


@pytest.mark.parametrize(
    ("factor", "model", "expected"), [(0.4, "34", "Better"), (2.0, "26", "WORSE"), (1.0, "nominal", "The nominal")]
)
def test_verdict(calibration, factor, model, expected):
    """It is that of the calibration, in all its words."""
    points = calibration.points.model_copy(
        update={"calibrated_mm": [factor * value for value in calibration.points.nominal_mm]}
    )
    changed = calibration.model_copy(update={"points": points, "model": model, "doubts": []})
    assert report_page.verdict(changed)[0].startswith(expected)
    page = report_page.render(changed)
    for sentence in report_page.verdict(changed):
        assert " ".join(sentence.split()) in text_of(page)
    assert bool(html.document_fromstring(page).xpath("//p[@class='banner verdict']")) is (expected != "Better")


def test_doubts_stand_beside_the_verdict(calibration):
    page = report_page.render(calibration.model_copy(update={"doubts": ["The tracker moved."]}))
    assert "NOT TO BE TRUSTED" in text_of(page)
    assert "The tracker moved." in text_of(page)


def test_without_heldout_poses_it_says_that_nothing_is_proven(calibration):
    page = report_page.render(without_heldout(calibration))
    assert_harmless(page)
    seen = text_of(page)
    assert "that were fitted, which proves nothing" in seen
    assert "never saw" not in seen
    assert "Held-out" not in seen
    assert drawings(page, "fitted")
    assert not drawings(page, "held-out")


def test_what_other_methods_add(calibration):
    turned = RotationStatistics(n=888, mean_deg=0.0123456, sigma_deg=0.002, max_deg=0.1)
    update = {
        "heldout": some_errors(0.5, orientation=turned),
        "heldout_nominal": some_errors(0.8, orientation=turned),
        "heldout_least_squares": some_errors(0.4),
        "poses_heldout": 3,
        "objective": calibration.objective.model_copy(update={"name": "max", "lower_bound_mm": 1.23456}),
        "choice": LevelChoice(
            level="34",
            table=[Candidate(level="34", mean_mm=0.35, gain_mm=0.05, gain_std_mm=0.0104, chosen=True, refused="")],
            explanation="Chosen by cross-validation.",
        ),
    }
    page = report_page.render(calibration.model_copy(update=update))
    assert_harmless(page)
    assert rows_under(page, "Position error, 3 poses (mm)")[-1][:3] == ["calibrated by rms", "888", "0.400"]
    turned_rows = rows_under(page, "Orientation error of the target frames (deg)")
    assert turned_rows[-1] == ["calibrated", "888", "0.0123", "0.0020", "0.1000"]
    assert "largest distance of the fitted points" in text_of(page)
    assert "certified: not below 1.235 mm" in text_of(page)
    assert "Chosen by cross-validation. " in text_of(page)
    assert "340.3500.0500.010yes" in text_of(page)


def test_simulated_data_are_announced_first(calibration):
    page = report_page.render(calibration.model_copy(update={"simulated": True}))
    assert html.document_fromstring(page).xpath("//main/*")[0].text_content().startswith("Simulated data")


@pytest.mark.parametrize("heldout", [True, False])
def test_names_are_harmless(calibration, heldout):
    changed = everywhere(calibration, NASTY)
    page = report_page.render(changed if heldout else without_heldout(with_points(changed, 3, 2)))
    assert_harmless(page)
    seen = text_of(page)
    assert f"Calibration of {NASTY}" in seen
    assert repr(NASTY) in seen  # in the example to copy, as Python writes it


@pytest.mark.parametrize(("poses", "targets", "groups"), [(1, 1, ()), (40, 9, ("3 kg", "6 kg")), (1000, 3, ("a",))])
def test_any_number_of_points(calibration, poses, targets, groups):
    page = report_page.render(with_points(calibration, poses, targets, groups))
    assert_harmless(page)
    assert len(page.encode()) < 1_500_000
    assert len(drawings(page)) == 8
    assert "saved without the measured places" in text_of(page)
    assert ("Held-out poses by group" in page) == bool(groups)
    assert ("Held-out poses by target" in page) == (targets > 1)


def test_left_out_points_are_counted_by_reason_and_listed(calibration):
    excluded = [Exclusion(pose=str(k), target=t, reason="lost: no position") for k in range(3000) for t in TARGETS]
    excluded += [Exclusion(pose="9", target="smr1", reason=f"outlier: {k} mm") for k in range(2)]
    page = report_page.render(calibration.model_copy(update={"excluded": excluded, "poses_excluded": 3000}))
    (counts, listed) = html.document_fromstring(page).xpath("//section[@id='left-out']//table")
    assert [[cell.text_content() for cell in row] for row in counts.xpath("tbody/tr")] == [
        ["lost", "9000"],
        ["outlier", "2"],
    ]
    assert listed.xpath("ancestor::details")
    assert listed.xpath("tbody/tr")[1].text_content() == "1smr1, smr2, smr3lost: no position"
    assert len(listed.xpath("tbody/tr")) == report_page.MOST_LISTED
    assert "1002 further lines in calibration.json" in text_of(page)
    assert "every measured point was used" in text_of(
        report_page.render(calibration.model_copy(update={"excluded": []}))
    )


def test_matplotlib_settings_neither_matter_nor_change(calibration, evidence, monkeypatch):
    import matplotlib

    one = {"verdict": report_page.draw(calibration, evidence)["verdict"]}
    monkeypatch.setattr(report_page, "draw", lambda *_: one)
    files = report_page.figure_files(calibration, evidence)
    with matplotlib.rc_context({"svg.fonttype": "path", "font.size": 40, "axes.facecolor": "red"}):
        assert report_page.figure_files(calibration, evidence) == files
        assert matplotlib.rcParams["font.size"] == 40


@pytest.mark.parametrize(
    ("value", "digits", "expected"), [(-1e-9, 3, "0.000"), (2.0005001, 3, "2.001"), (-90.00962, 4, "-90.0096")]
)
def test_numbers(value, digits, expected):
    assert charts.fixed(value, digits) == expected


def test_the_examples_on_the_page_run(folder, calibration, page):
    document = html.document_fromstring(page)
    examples = [text for text in (code.text_content() for code in document.xpath("//pre/code")) if "import" in text]
    q = np.array([[0.1, -0.2, 0.3, 0.4, -0.5, 0.6]])
    names = {"q": q}
    assert len(examples) == 2
    for example in examples:
        exec(example.replace("DIR", str(folder)), names)
    robot = calibration.robot_calibrated()
    assert np.abs(names["xyz"] - robot.points(q, "smr1")).max() < 1e-12
    assert np.abs(names["T_base_tip"].homogeneous - robot.poses(q)[0]).max() < 1e-9


# --- what the file holds of the points, and what the figures make of it ----------------------------------


@pytest.mark.parametrize(
    ("damage", "words"),
    [
        (lambda d: d["points"]["x_mm"].pop(), "column x_mm has"),
        (lambda d: d["points"]["row"].__setitem__(0, 10**6), "not among the poses"),
        (lambda d: d["poses"]["came_from"].__setitem__(0, "x"), "came_from"),
        (lambda d: d["poses"]["joints"].pop(), "every column must have"),
    ],
)
def test_damaged_point_tables_are_refused(folder, calibration, tmp_path, damage, words):
    content = calibration.model_dump()
    damage(content)
    (tmp_path / "calibration.json").write_text(json.dumps(content))
    (tmp_path / "calibrated.urdf").write_bytes((folder / "calibrated.urdf").read_bytes())
    with pytest.raises(CalibrationError, match=words):
        irbcal.load(tmp_path)


def test_backlash_of_a_real_robot(shared_data, tmp_path):
    """The IRB 120: its residuals depend on the direction of joint 1, and a mean by hand says so, too."""
    file = shared_data / "irb120_laser_tracker" / "measurements.csv"
    calibration = irbcal.calibrate(file, "irb120", "34", holdout=296, split="last").record
    page = report_page.render(calibration)
    assert_harmless(page)
    assert len(page.encode()) < 1_000_000
    (section,) = html.document_fromstring(page).xpath("//section[@id='joints']")
    assert "arm stiffness" in section.xpath("./p/strong/text()")[0]
    assert "last move of joint 1" in section.xpath("./p/strong/text()")[0]
    # by hand: the turn about the base's z axis that each pose asks for, averaged by direction
    points, came_from = calibration.used_points(True)
    robot = calibration.robot_calibrated()
    to_base = robot.T_world_base[:3, :3].T
    place = (points.xyz - robot.T_world_base[:3, 3]) @ to_base.T
    rows = zip(points.joints(), points.names(), strict=True)
    off = (points.xyz - [robot.points(q[None], name)[0] for q, name in rows]) @ to_base.T
    across = np.column_stack([-place[:, 1], place[:, 0]])
    turn = np.degrees([(a @ e) / (a @ a) for a, e in zip(across, off[:, :2], strict=True)])
    side = came_from[points.pose, 0]
    far = np.hypot(*across.T) > 0.2
    assert turn[far & (side < 0)].mean() < -0.015 < 0.015 < turn[far & (side > 0)].mean()


# --- files on request ------------------------------------------------------------------------------------


def run(*arguments):
    return CliRunner().invoke(main.app, ["report", *map(str, arguments)], catch_exceptions=False)


def test_the_command_writes_the_same_page_again_and_its_files(folder, calibration, page, tmp_path):
    (folder / "report.html").unlink()
    done = run(folder, "--figures", tmp_path / "figures", "--format", "svg", "--data", tmp_path / "data")
    assert done.exit_code == 0
    assert (folder / "report.html").read_text(encoding="utf-8") == page
    names = {path.stem for path in (tmp_path / "figures").iterdir()}
    assert {"before_and_after", "workspace", "residual_vectors", "residuals_by_joint", "singular_values"} < names
    for path in (tmp_path / "figures").iterdir():
        root = etree.fromstring(path.read_bytes())
        assert {etree.QName(e).localname for e in root.iter()} <= {
            "svg",
            "g",
            "path",
            "circle",
            "rect",
            "text",
            "title",
        }
        assert "var(" not in path.read_text(encoding="utf-8")
    points = pd.read_csv(tmp_path / "data" / "points.csv")
    heldout = points[points["set"] == "held-out"]
    assert heldout["nominal_mm"].mean() == pytest.approx(calibration.heldout_nominal.all.mean_mm, abs=1e-5)
    assert heldout["calibrated_mm"].max() == pytest.approx(calibration.heldout.all.max_mm, abs=1e-5)
    length = np.linalg.norm(points[[f"calibrated_d{axis}_mm" for axis in "xyz"]], axis=1)
    assert np.abs(length - points["calibrated_mm"]).max() < 3e-6
    errors = pd.read_csv(tmp_path / "data" / "errors.csv").query("set == 'held-out' and model == 'calibrated'").iloc[0]
    assert errors["mean_mm_low"] < errors["mean_mm"] < errors["mean_mm_high"]
    assert len(pd.read_csv(tmp_path / "data" / "parameters.csv")) == len(calibration.parameters)
    assert len(pd.read_csv(tmp_path / "data" / "joints.csv")) > 0


def test_nothing_is_written_where_a_folder_cannot_be(folder, tmp_path):
    (tmp_path / "taken").write_text("a file")
    before = (folder / "report.html").read_bytes()
    (folder / "report.html").write_bytes(b"as it was")
    try:
        with pytest.raises(CalibrationError, match="taken"):
            run(folder, "--figures", tmp_path / "figures", "--data", tmp_path / "taken")
        assert (folder / "report.html").read_bytes() == b"as it was"
        assert not (tmp_path / "figures").exists()
    finally:
        (folder / "report.html").write_bytes(before)


def test_worst_poses_are_listed_and_lead_into_the_view(folder, calibration, evidence, page):
    rows = html.document_fromstring(page).xpath("//section[@id='poses']//table[contains(caption, 'worst')]/tbody/tr")
    assert len(rows) == 10
    largest = evidence.sets[0].models["calibrated"].distance.max() * 1e3
    assert rows[0][2].text_content() == f"{largest:.3f}"
    assert len(rows[0]) == 7 + 6
    assert not html.document_fromstring(page).xpath("//a[contains(@href, 'view.html')]")
    with_view = html.document_fromstring(report_page.render(calibration, evidence, "view.html"))
    links = with_view.xpath("//section[@id='poses']//a/@href")
    assert len(links) == 10
    assert links[0] == f"view.html#pose={rows[0][0].text_content().strip()}"
    assert report_page.view_beside(folder) is None


def test_the_page_tells_no_folders(calibration, evidence):
    data = [item.model_copy(update={"file": f"/home/someone/secret/{item.file}"}) for item in calibration.data]
    robot = calibration.robot.model_copy(update={"urdf": "/home/someone/secret/robot.urdf"})
    page = report_page.render(calibration.model_copy(update={"data": data, "robot": robot}), evidence)
    assert "secret" not in page
    assert "robot.urdf" in page


def test_fitted_and_held_out_are_marked(page):
    document = html.document_fromstring(page)
    for kind, words in (("proof", "never seen by the fit"), ("seen", "fitted: no proof")):
        badges = document.xpath(f"//span[contains(@class, 'badge {kind}')]")
        assert len(badges) >= 3
        assert {badge.text_content() for badge in badges} == {words}
