"""Figures of a report."""

import io
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lxml import html
from report_cases import assert_harmless, drawings
from support import arm, measured, random_robot, write_measurements
from typer.main import get_command

import irbcal
from irbcal.cli.main import app
from irbcal.plotting import colours
from irbcal.reports import report_figures, report_page


def test_backlash_is_found_and_stated_with_its_interval(tmp_path):
    """Joint 1 stops short by half of 0.05 degrees; the other joints have no backlash."""
    play, nominal = 0.05, arm()
    rng = np.random.default_rng(7)
    q = nominal.random_joints(90, 8)
    side = np.zeros_like(q)
    side[1:, 0] = np.sign(np.diff(q[:, 0]))
    robot = random_robot(nominal, "nominal", rng)
    points = replace(measured(robot, q - 0.5 * np.radians(play) * side, 2e-5, rng), q=q)
    saved = irbcal.calibrate(write_measurements(tmp_path / "m.csv", points), "irb1600", "nominal", holdout=0.5)
    irbcal.save(saved, tmp_path / "out")
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert_harmless(page)
    (section,) = html.document_fromstring(page).xpath("//section[@id='joints']")
    assert "It is seen in joint 1. No thesis level" in " ".join(section.text_content().split())
    rows = [[cell.text_content() for cell in row] for row in section.xpath(".//tbody/tr")]
    assert [row[0] for row in rows] == list("123456")
    low, high = map(float, rows[0][2].split(" to "))
    assert low < play < high
    assert high - low < 0.01
    assert rows[0][6] == "seen, counts"
    assert {row[6] for row in rows[1:]} == {"not seen"}
    (first,) = [svg for svg in drawings(page) if svg.get("aria-label").startswith("Residual of joint 1 ")]
    below, above = (
        [float(v) for v in re.findall(rf"reached from {way}: ([+-][\d.]+) ±", " ".join(first.xpath(".//title/text()")))]
        for way in ("below", "above")
    )
    assert np.mean(above) - np.mean(below) == pytest.approx(play, abs=0.005)


def test_pictures_show_both_models_on_white(calibration, evidence):
    from matplotlib.image import imread

    for figures in report_page.draw(calibration, evidence).values():
        for figure in figures:
            if figure.name in ("before_and_after", "residual_vectors"):
                pixels = (255 * imread(io.BytesIO(figure.content("png")))[..., :3]).round().astype(int)
                assert pixels[0, 0].tolist() == [255, 255, 255]
                for colour in (colours.NOMINAL, colours.CALIBRATED):
                    wanted = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
                    assert (np.abs(pixels - wanted).max(axis=-1) < 30).sum() > 100, (figure.name, colour)


def test_the_page_names_commands_that_there_are():
    template = Path(report_page.__file__).parent / "templates" / "report.html.j2"
    named = set(re.findall(r"<code>irbcal ([a-z0-9]+)", template.read_text(encoding="utf-8")))
    assert "joints" in named
    assert named <= {name for name, command in get_command(app).commands.items() if not command.hidden}


def test_too_few_poses_for_means_are_told_of(tmp_path):
    rng, nominal = np.random.default_rng(7), arm()

    def caption(poses):
        points = measured(random_robot(nominal, "nominal", rng), nominal.random_joints(poses, 8), 2e-5, rng)
        file = write_measurements(tmp_path / "m.csv", points)
        return irbcal.calibrate(file, "irb1600", "nominal", holdout=0.5).plot

    few = caption(30).residuals_by_joint().caption
    assert re.search(r"\. At joints? [1-6, ]+, 1\d poses are too few for means of both directions$", few)
    assert "too few" not in caption(400).residuals_by_joint().caption


def test_the_course_is_shown_where_unused_poses_got_worse():
    falling = {"iteration": [0, 1, 2], "objective_mm": [1.0, 0.5, 0.4], "check_mean_mm": [1.0, 0.6, 0.5]}
    assert not report_figures.tells(falling)
    assert not report_figures.tells({"iteration": [0, 1, 2], "objective_mm": [1.0, 0.5, 0.4]})
    assert report_figures.tells(falling | {"check_mean_mm": [1.0, 0.5, 0.6]})
