"""The charts of a report show what was measured, and what an average of error models carries."""

import csv
import io
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from evidence_cases import Truth
from lxml import html
from report_cases import assert_harmless, drawings, text_of
from support import arm, measured, random_robot, write_measurements
from typer.main import get_command
from typer.testing import CliRunner

import irbcal
from irbcal.cli import main
from irbcal.cli.main import app
from irbcal.errors import OptionError
from irbcal.identification.fit_sections import FamilyShown
from irbcal.measurement.points import distances
from irbcal.modeling.terms.gear import gear_terms
from irbcal.modeling.terms.situation import Motion
from irbcal.page_style import CALIBRATED, NOMINAL
from irbcal.reports import report_charts, report_page


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
    assert "backlash of joint 1 (" in section.text_content()
    rows = [[cell.text_content() for cell in row] for row in section.xpath(".//tbody/tr")]
    found = {row[0]: row for row in rows if row[1] == "backlash"}
    assert list(found) == list("123456")
    value, half = map(float, found["1"][2].split(" ± "))
    assert abs(value - play) < half < 0.005
    assert [row[:2] for row in rows if row[6] == "needed"] == [["1", "backlash"]]
    assert float(found["1"][4]) > 0.999
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
                for colour in (NOMINAL, CALIBRATED):
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

    few = caption(14).residuals_by_joint().caption
    assert re.search(r"\. At joints? [1-6, ]+, 1\d poses are too few for means of both directions$", few)
    assert "too few" not in caption(400).residuals_by_joint().caption


def test_the_course_is_shown_where_unused_poses_got_worse():
    falling = {"iteration": [0, 1, 2], "objective_mm": [1.0, 0.5, 0.4], "check_mean_mm": [1.0, 0.6, 0.5]}
    assert not report_charts.tells(falling)
    assert not report_charts.tells({"iteration": [0, 1, 2], "objective_mm": [1.0, 0.5, 0.4]})
    assert report_charts.tells(falling | {"check_mean_mm": [1.0, 0.5, 0.6]})


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """Gravity, backlash and one gear, measured in an order; model auto."""
    truth = Truth(["gravity", "direction"], extra=[(term, 2e-4) for term in gear_terms(3, 202)])
    motion = Motion.in_order(truth.nominal.random_joints(140, 1))
    points = replace(truth.measured(motion, 1e-5), previous=None)
    path = write_measurements(tmp_path_factory.mktemp("data") / "m.csv", points)
    out = tmp_path_factory.mktemp("saved") / "calibration"
    irbcal.save(irbcal.calibrate(path, "irb120"), out)
    return out


@pytest.fixture(scope="module")
def averaged(saved):
    return irbcal.load(saved).record


@pytest.fixture(scope="module")
def averaged_page(saved):
    return (saved / "report.html").read_text(encoding="utf-8")


def cells(page, caption):
    (table,) = html.document_fromstring(page).xpath(f"//table[contains(caption, '{caption}')]")
    return {row[0].text_content().strip(): [cell.text_content() for cell in row[1:]] for row in table.xpath("tbody/tr")}


def test_it_is_drawn_from_the_file_alone(saved, averaged, averaged_page):
    assert_harmless(averaged_page)
    assert str(saved.parent) not in averaged_page
    assert len(averaged_page) < 1e6
    assert CliRunner().invoke(main.app, ["report", str(saved)]).exit_code == 0
    assert (saved / "report.html").read_text(encoding="utf-8") == averaged_page
    section = averaged.evidence
    assert len(section.model_dump_json()) < 40_000


def test_bars_tell_the_held_out_errors_stage_by_stage(averaged, averaged_page):
    (drawing,) = drawings(averaged_page, "What each family of terms explains")
    texts = drawing.xpath(".//text/text()")
    stages = averaged.evidence.explained
    for stage in stages:
        assert any(f"{stage.added}: {stage.mean_mm:.3f} mm" in text for text in texts), stage
    assert f"this calibration: {averaged.heldout.all.mean_mm:.3f} mm" in texts
    widths = [float(box.get("width")) for box in drawing.xpath(".//*[local-name()='rect']")]
    values = [*(stage.mean_mm for stage in stages), averaged.heldout.all.mean_mm]
    scale = widths[0] / values[0]
    assert widths == pytest.approx([scale * value for value in values], abs=0.11)
    assert stages[0].mean_mm > 2 * stages[1].mean_mm


def test_without_held_out_poses_poses_are_left_out_one_at_a_time(averaged):
    bare = averaged.evidence.model_copy(
        update={"explained": [s.model_copy(update={"mean_mm": None}) for s in averaged.evidence.explained]}
    )
    from irbcal.reports import report_charts

    figure = report_charts.explained(averaged.model_copy(update={"evidence": bare}))
    assert "left out of the fit one at a time" in figure.caption
    assert "tick" not in figure.caption


def test_intervals_are_compared_with_what_was_expected(averaged, averaged_page):
    """Counted here with plain predictions of the loaded robot."""
    points, _ = averaged.used_points(heldout=True)
    robot = averaged.robot_calibrated()
    inside = []
    for k, name in enumerate(points.target_names):
        mine = points.target == k
        rows = points.pose[mine]
        seen = robot.predict(points.q[rows], points.previous[rows], name)
        inside.append(np.abs(points.xyz[mine] - seen.position) < seen.interval)
    share = 100 * np.concatenate(inside).mean()
    row = cells(averaged_page, "Do predicted intervals hold?")["all held-out poses"]
    assert row[:3] == [str(3 * len(points)), "95", f"{share:.1f}"]


@pytest.mark.parametrize(("nats", "shown"), [(-0.4, False), (40.0, True)])
def test_intervals_of_the_warm_robot_are_named_where_the_data_show_a_drift(averaged, nats, shown):
    warm_up = FamilyShown(family="warm_up", determined=1.0, evidence=nats, moves_mm=0.1)
    drifting = averaged.evidence.model_copy(update={"families": (warm_up,), "warm_up_tau": 20.0})
    page = report_page.render(averaged.model_copy(update={"evidence": drifting}))
    assert ("Intervals are those of the warm robot" in page) == shown


def test_families_expected_and_found(averaged, averaged_page):
    rows = cells(averaged_page, "What was expected of each family of terms")
    assert {"geometry", "gravity", "direction", "gear"} <= set(rows)
    terms, seen, natural, _, found, std, nats, _, shown = rows["gear"]
    assert (terms, natural, shown) == ("2", "0.002865 deg", "yes")
    assert float(found) == pytest.approx(4.0, rel=0.1)
    assert float(std) < 0.2 * float(found)
    assert float(seen) == pytest.approx(2.0, abs=0.1)
    assert float(nats) > 5.0
    assert rows["gain"][-1] == "no"
    # root mean squares over groups of several sizes
    section = averaged.evidence
    for row in report_page.families(section):
        mine = [group for group in section.groups if group.family == row["family"]]
        every = np.repeat([group.estimate for group in mine], [group.terms for group in mine])
        assert row["found"] == pytest.approx(float(np.sqrt(np.mean(every**2))), rel=1e-12)
        assert row["terms"] == len(every)
    assert "Effective number of parameters: these poses determine" in text_of(averaged_page)


def test_a_found_gear_is_named_on_its_spectrum(averaged, averaged_page):
    scans = drawings(averaged_page, "Gear scan of joint")
    assert len(scans) == 6
    named = [" ".join(scan.xpath(".//text/text()")) for scan in scans]
    assert "202 (ratio 101)" in named[3]
    assert not any("ratio" in text for k, text in enumerate(named) if k != 3)
    (title,) = scans[3].xpath(".//title/text()")
    assert re.match(r"joint 4: 202 cycles per turn, 0\.0\d+ degrees: twice 101", title)


def test_corrections_are_those_of_the_joint_map(averaged, averaged_page):
    """Titles of the curves against the joint map itself, reached from both sides."""
    robot = averaged.robot_calibrated()
    points, _ = averaged.used_points(heldout=False)
    drawn = drawings(averaged_page, "Correction of joint")
    assert len(drawn) == 6
    found = 0
    for drawing in drawn:
        j = int(drawing.get("aria-label").split()[-1]) - 1
        for title in drawing.xpath(".//title/text()"):
            side, value, angle = re.fullmatch(r"reached from (\w+): ([+-][\d.]+) deg at (-?[\d.]+) deg", title).groups()
            q = np.median(points.q, axis=0)[None].copy()
            q[0, j] = np.radians(float(angle))
            before = q.copy()
            before[0, j] -= np.radians(20.0) * (1 if side == "below" else -1)
            expected = np.degrees(robot.joint_map.effective(q, before) - q)[0, j]
            gear = 0.025 if j == 3 else 0.0  # the mean of a range, in which the gear turns once and more
            assert float(value) == pytest.approx(expected, abs=0.003 + gear)
            found += 1
    assert found == 6 * 2 * 12
    assert "reached from below" in text_of(averaged_page)


def test_each_figure_can_be_had_alone(saved, calibration):
    plots = irbcal.load(saved).plot
    for picture in (plots.explained(), plots.gear_spectrum(), plots.corrections()):
        assert picture.caption
    bare = irbcal.load(saved).plot
    object.__setattr__(bare, "_record", calibration)
    for draw in (bare.explained, bare.gear_spectrum):
        with pytest.raises(OptionError, match="only model auto"):
            draw()


def test_data_of_the_figures(averaged):
    evidence = report_page.gather(averaged)
    files = report_page.data_files(averaged, evidence)

    def rows(name):
        return list(csv.DictReader(io.StringIO(files[name].decode())))

    assert [row["added"] for row in rows("explained.csv")] == [s.added for s in averaged.evidence.explained]
    assert rows("gears.csv")[0]["cycles_per_turn"] == "202"
    assert len(rows("gear_scan.csv")) == 6 * len(averaged.evidence.spectrum.chi2[0])
    assert rows("groups.csv")[0]["natural"] == "0.0572958 deg, 0.5 mm"
    assert rows("coverage.csv")[0]["part"] == "all"


def test_a_level_shows_the_joints_that_its_map_changes(calibration, page):
    drawn = {drawing.get("aria-label")[-1] for drawing in drawings(page, "Correction of joint")}
    assert drawn == {"2", "3", "6"}
    assert "Where the error goes" not in page
    points, _ = calibration.used_points(heldout=False)
    assert distances(calibration.robot_calibrated(), points).mean() < 1e-4


def by_hand(calibration, heldout, name):
    """Mean distance of each pose's points, mm, by name of the pose, point by point."""
    points, _ = calibration.used_points(heldout)
    robot = calibration.robot_calibrated() if name == "calibrated" else calibration.robot_nominal()
    out = {}
    for k, (target, place) in enumerate(zip(points.names(), points.xyz, strict=True)):
        pose = points.pose[k]
        off = np.linalg.norm(place - robot.points(points.q[pose][None], target)[0])
        out.setdefault(str(points.pose_ids[pose]), []).append(1e3 * off)
    return {pose: np.mean(values) for pose, values in out.items()}


def marks(svg, model):
    """Title, x and y of the circles of one model."""
    found = svg.xpath(f".//g[contains(@style, 'var(--{model})')]/circle")
    return [(c.findtext("title"), float(c.get("cx")), float(c.get("cy"))) for c in found]


@pytest.mark.parametrize(("heldout", "name"), [(True, "nominal"), (True, "calibrated"), (False, "calibrated")])
def test_errors_by_pose_are_drawn_where_they_belong(calibration, page, heldout, name):
    (svg,) = drawings(page, f"Position error of each {'held-out' if heldout else 'fitted'} pose")
    expected = by_hand(calibration, heldout, name)
    found = marks(svg, name)
    assert len(found) == len(expected)
    said = [re.fullmatch(rf"pose (\d+): {name} (\d+\.\d{{3}}) mm", title).groups() for title, _, _ in found]
    assert {pose: float(error) for pose, error in said} == {pose: round(e, 3) for pose, e in expected.items()}
    error = np.array([expected[pose] for pose, _ in said])
    x, y = np.array([place for _, *place in found]).T
    slope, offset = np.polyfit(error, y, 1)
    assert slope < 0
    assert np.abs(offset + slope * error - y).max() < 0.06  # rounded to a tenth
    assert np.ptp(np.diff(x)) < 0.21


def test_histogram_counts_every_point(calibration, page):
    (svg,) = drawings(page, "Histogram of the position errors of the held-out points")
    counts = [
        re.findall(r"(nominal|calibrated) (\d+)", title) for title in svg.xpath(".//g[@class='hover']//title/text()")
    ]
    for name in ("nominal", "calibrated"):
        total = sum(int(count) for row in counts for model, count in row if model == name)
        assert total == calibration.heldout.all.n


def test_arrows_point_from_predicted_to_measured(calibration, evidence):
    """Vectors along the base link's axes: the measured place lies there from the predicted one."""
    (heldout, _) = evidence.sets
    robot = calibration.robot_nominal()
    vector, points = heldout.models["nominal"].vector, heldout.points
    for k in range(0, len(points), 17):
        predicted = robot.points(points.joints()[k : k + 1], points.names()[k])[0]
        at_world = robot.T_world_base[:3, :3] @ vector[k]
        assert np.abs(predicted + at_world - points.xyz[k]).max() < 1e-12
    assert np.abs(np.linalg.norm(vector, axis=1) - heldout.models["nominal"].distance).max() < 1e-8
