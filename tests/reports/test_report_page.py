"""The report: one page that says what calibration.json says, and that no name in it can turn into code."""

import csv
import io
import json
import re
from collections import Counter
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from lxml import etree, html
from support import TARGETS, arm, measured, outcome_of, random_robot, write_measurements
from typer.testing import CliRunner

import irbcal
from irbcal.cli import main
from irbcal.errors import CalibrationError
from irbcal.figures import charts, colours
from irbcal.files import document
from irbcal.files.schema import (
    Candidate,
    Choice,
    Correlation,
    Errors,
    Exclusion,
    Parameter,
    PointTable,
    RotationStatistics,
    Statistics,
)
from irbcal.reports import report_data, report_page

NASTY = "</title><script>alert(1)</script>$\\frac$<img src=x onerror=alert(2)>\"'&amp;{{ 7*7 }}]]>漢字"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A calibration of 60 simulated poses."""
    nominal = arm()
    rng = np.random.default_rng(1)
    truth = random_robot(nominal, "34", rng)
    points = measured(truth, nominal.random_joints(60, 1), 3e-5, rng)
    path = write_measurements(tmp_path_factory.mktemp("data") / "m.csv", points)
    out = tmp_path_factory.mktemp("saved") / "calibration"
    irbcal.save(outcome_of(path, "irb1600", "34", holdout=0.3), out)
    return out


@pytest.fixture(scope="module")
def calibration(folder):
    return irbcal.load(folder).record


@pytest.fixture(scope="module")
def page(calibration):
    return report_page.render(calibration)


@pytest.fixture(scope="module")
def evidence(calibration):
    return report_page.gather(calibration)


def some_errors(mean, targets=("smr1",), groups=(), orientation=None):
    def statistics(mean):
        return Statistics(
            n=888, mean_mm=mean, sigma_mm=0.3212719, max_mm=2.5, mean_plus_3sigma_mm=mean + 1, rms_mm=mean + 0.1
        )

    return Errors(
        all=statistics(mean),
        orientation=orientation,
        per_target={name: statistics(mean + 0.01 * k) for k, name in enumerate(targets)},
        per_group={name: statistics(mean + 0.02 * k) for k, name in enumerate(groups)},
    )


def with_points(calibration, poses, targets, groups=()):
    """As many held-out and fitted points as wanted."""
    n = poses * targets
    names = [f"t{k}" for k in range(targets)]
    columns = {
        "pose": [str(k // targets) for k in range(n)],
        "group": [groups[k // targets % len(groups)] if groups else "" for k in range(n)],
        "target": names * poses,
        "nominal_mm": np.random.default_rng(1).gamma(4.0, 0.2, n).tolist(),
        "calibrated_mm": np.random.default_rng(2).gamma(3.0, 0.1, n).tolist(),
    }
    table = PointTable(**{key: value * 2 for key, value in columns.items()}, heldout=[False] * n + [True] * n)
    before, after = some_errors(0.8, names, groups), some_errors(0.3, names, groups)
    return calibration.model_copy(
        update={
            "points": table,
            "fit": after,
            "heldout": after,
            "fit_nominal": before,
            "heldout_nominal": before,
            "poses_fit": poses,
            "poses_heldout": poses,
        }
    )


def without_heldout(calibration):
    keep = [k for k, heldout in enumerate(calibration.points.heldout) if not heldout]
    columns = calibration.points.model_dump().items()
    table = {name: [column[k] for k in keep if column] for name, column in columns}
    update = {"heldout": None, "heldout_nominal": None, "poses_heldout": 0, "points": PointTable(**table)}
    return calibration.model_copy(update=update)


def everywhere(calibration, name):
    """The name in every place that a file or a person fills."""
    robot = calibration.robot.model_copy(
        update={"name": name, "urdf": name, "base_link": name, "tip_link": name, "joint_names": [name] * 6}
    )
    placed = calibration.placement.model_copy(
        update={"targets": {name: [1.0, 2.0, 3.0]}, "target_quaternions": {name: [1.0, 0.0, 0.0, 0.0]}}
    )
    candidate = Candidate(level=name, mean_mm=0.3, gain_mm=None, gain_std_mm=None, chosen=True, refused=name)
    pair = Correlation(first=name, second=name, coefficient=0.99)
    turned = RotationStatistics(n=1, mean_deg=0.0123456, sigma_deg=0.0, max_deg=0.0123456)
    parameter = Parameter(name=name, value=1.0, unit=name, std=1.0, low=-1.0, high=3.0, state="tied", reason=name)
    errors = some_errors(0.3, (name, "b"), (name,), turned)
    return calibration.model_copy(
        update={
            "robot": robot,
            "placement": placed,
            "placement_nominal": placed,
            "references_mm": {name: [1.0, 2.0, 3.0]},
            "tool_shape_mm": {},
            "covariance": [[0.0]],
            "largest_link_shift_mm": 1.0,
            "created": name,
            "model": name,
            "held": [name],
            "notes": [name],
            "excluded": [Exclusion(pose=name, target=name, reason=name)],
            "parameters": [parameter],
            "method": name,
            "choice": Choice(level=name, table=[candidate], explanation=name),
            "observability": calibration.observability.model_copy(
                update={"correlations": [pair], "indices": {name: 1.0}}
            ),
            "data": [calibration.data[0].model_copy(update={"file": name})],
            "software": {name: name},
            "points": PointTable(
                pose=[name], group=[name], target=[name], heldout=[True], nominal_mm=[0.2], calibrated_mm=[0.1]
            ),
            **dict.fromkeys(("fit", "fit_nominal", "heldout", "heldout_nominal", "heldout_least_squares"), errors),
        }
    )


def text_of(page):
    return " ".join(html.document_fromstring(page).text_content().split())


def assert_harmless(page):
    """Nothing runs, nothing is loaded, ids are unique and every inner link has its aim."""
    document = html.document_fromstring(page)
    assert "<script" not in page.lower()
    assert not re.search(r"https?:", page)
    assert {e.tag for e in document.iter() if isinstance(e.tag, str)}.isdisjoint(
        {"script", "img", "iframe", "link", "image", "use", "style.src"}
    )
    ids = Counter(document.xpath("//@id"))
    assert max(ids.values()) == 1
    for element in document.iter():
        for name, value in element.attrib.items():
            assert not name.startswith("on"), (name, value)
            assert name != "src"
            if name == "href":
                assert element.tag == "a"
                assert value[0] == "#"
                assert value[1:] in ids
    assert "url(" not in page
    assert "@import" not in page


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
    for sentence in calibration.held:
        assert sentence in seen
    assert calibration.data[0].sha256 in seen
    assert f"{calibration.rank} independent combinations of {calibration.parameter_count} parameters" in seen
    assert html.document_fromstring(page).get("lang") == "en"
    assert page.startswith("<!DOCTYPE html>")
    assert not [text for text in html.document_fromstring(page).itertext() if re.search(r"\d\.\d{7}", text)]
    assert "Simulated" not in seen
    assert "Nothing is proven" not in seen


def drawings(page, words=""):
    """The drawings of a page whose label has these words, legends aside."""
    return [svg for svg in html.document_fromstring(page).xpath("//svg[@role='img']") if words in svg.get("aria-label")]


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
    assert "On 296 poses the fit never saw, the mean position error falls from 0.825 mm to 0.438 mm" in text_of(page)


@pytest.mark.parametrize(
    ("before", "after", "model", "expected"),
    [
        (0.8253, 0.4385, "34", "On 3 poses the fit never saw, the mean position error falls from 0.825 mm to 0.439 mm"),
        (0.4, 0.5, "26", "error rises from 0.400 mm to 0.500 mm (largest 2.500 to 2.500 mm)."),
        (0.40001, 0.39999, "26", "the mean position error stays at 0.400 mm (largest"),
        (0.4, 0.4, "nominal", "of the nominal robot with base and targets identified is 0.400 mm (largest 2.500 mm)."),
    ],
)
def test_verdict(calibration, before, after, model, expected):
    update = {"heldout": some_errors(after), "heldout_nominal": some_errors(before), "model": model, "poses_heldout": 3}
    changed = calibration.model_copy(update=update)
    assert expected in report_page.verdict(changed)
    page = report_page.render(changed)
    assert expected in text_of(page)
    (summary,) = html.document_fromstring(page).xpath("//div[@class='headline']//tbody")
    assert len(summary) == (1 if model == "nominal" else 2)


def test_without_heldout_poses_it_says_that_nothing_is_proven(calibration):
    page = report_page.render(without_heldout(calibration))
    assert_harmless(page)
    seen = text_of(page)
    assert "Nothing is proven: no poses were held out" in seen
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
        "choice": Choice(
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
    assert len(drawings(page)) == 9
    assert "saved without the measured places" in text_of(page)
    assert ("Held-out poses by group" in page) == bool(groups)
    assert ("Held-out poses by target" in page) == (targets > 1)


def test_perfect_predictions_can_be_drawn(calibration):
    changed = with_points(calibration, 5, 2)
    zeros = dict.fromkeys(("nominal_mm", "calibrated_mm"), [0.0] * 20)
    assert_harmless(report_page.render(changed.model_copy(update={"points": changed.points.model_copy(update=zeros)})))


def test_left_out_points_are_counted_by_reason_and_listed(calibration):
    excluded = [Exclusion(pose=str(k), target=t, reason="lost: no position") for k in range(3000) for t in TARGETS]
    excluded += [Exclusion(pose="9", target="smr1", reason=f"gross error: {k} mm") for k in range(2)]
    page = report_page.render(calibration.model_copy(update={"excluded": excluded, "poses_excluded": 3000}))
    (counts, listed) = html.document_fromstring(page).xpath("//section[@id='left-out']//table")
    assert [[cell.text_content() for cell in row] for row in counts.xpath("tbody/tr")] == [
        ["lost", "9000"],
        ["gross error", "2"],
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
    assert report_page.fixed(value, digits) == expected


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


def test_the_file_holds_the_points_as_measured(folder, calibration, tmp_path):
    """Places, joints and directions, against the measurement file read by pandas."""
    nominal = arm()
    rng = np.random.default_rng(4)
    q = np.round(nominal.random_joints(40, 5), 3)
    q[7] = q[6]
    q[12, 2] = q[11, 2]
    path = write_measurements(tmp_path / "m.csv", measured(random_robot(nominal, "26", rng), q, 3e-5, rng))
    out = tmp_path / "out"
    irbcal.save(outcome_of(path, "irb1600", "26", holdout=0.5), out)
    saved = irbcal.load(out).record
    rows = pd.read_csv(path).assign(order=lambda t: t["pose"].rank(method="dense").astype(int) - 1)
    joints = rows.groupby("order")[[f"q{k}_deg" for k in range(1, 7)]].first().to_numpy()
    sign = np.sign(np.diff(joints, axis=0, prepend=joints[:1]))
    for k in range(1, len(sign)):
        sign[k] = np.where(sign[k] == 0, sign[k - 1], sign[k])
    seen = 0
    for heldout in (False, True):
        points, came_from = saved.used_points(heldout)
        order = points.pose_ids.astype(int)
        assert np.abs(np.degrees(points.q) - joints[order]).max() < 1e-8
        assert np.array_equal(came_from, sign[order])
        known = rows.set_index(["pose", "target"])[["x_mm", "y_mm", "z_mm"]]
        expected = known.loc[list(zip(order[points.pose], points.names(), strict=True))].to_numpy()
        assert np.abs(1e3 * points.xyz - expected).max() < 1e-6
        robot = saved.robot_calibrated()
        predicted = np.array(
            [robot.points(j[None], n)[0] for j, n in zip(points.joints(), points.names(), strict=True)]
        )
        mine = [k for k, value in enumerate(saved.points.heldout) if value == heldout]
        distance = np.array(saved.points.calibrated_mm)[mine]
        assert np.abs(1e3 * np.linalg.norm(points.xyz - predicted, axis=1) - distance).max() < 1e-5
        seen += len(points)
    assert seen == len(rows)


def test_measured_orientations_and_uncertainties_come_back(calibration):
    """Quaternions written by hand; points without one stay without."""
    n = len(calibration.points.pose)
    turned = {"qw": 0.5, "qx": 0.5, "qy": 0.5, "qz": 0.5}  # maps x to y, y to z, z to x
    columns = {name: [value, None] * (n // 2) + [None] * (n % 2) for name, value in turned.items()}
    columns["u95_mm"] = [None, 0.05] * (n // 2) + [None] * (n % 2)
    changed = calibration.model_copy(update={"points": calibration.points.model_copy(update=columns)})
    points, _ = changed.used_points(False)
    assert np.abs(points.rotation[0] - [[0, 0, 1], [1, 0, 0], [0, 1, 0]]).max() < 1e-12
    assert points.oriented().tolist() == [k % 2 == 0 for k in range(len(points))]
    assert points.u95[1] == pytest.approx(5e-5)
    assert np.isnan(points.u95[0])


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


def test_normal_quantiles_of_normal_errors_lie_on_a_line():
    from irbcal.figures.pose_errors import normal_quantiles

    value = np.random.default_rng(1).normal(3.0, 0.5, 5000)
    quantile, shown = normal_quantiles(value)
    assert len(shown) < 250
    assert shown[-1] == value.max()
    assert np.polyfit(quantile, shown, 1) == pytest.approx([0.5, 3.0], abs=0.02)


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


def test_backlash_is_found_and_stated_with_its_interval(tmp_path):
    """Joint 1 stops short by half of 0.05 degrees; the other joints have no backlash."""
    play, nominal = 0.05, arm()
    rng = np.random.default_rng(7)
    q = nominal.random_joints(90, 8)
    side = np.zeros_like(q)
    side[1:, 0] = np.sign(np.diff(q[:, 0]))
    robot = random_robot(nominal, "nominal", rng)
    points = replace(measured(robot, q - 0.5 * np.radians(play) * side, 2e-5, rng), q=q)
    saved = outcome_of(write_measurements(tmp_path / "m.csv", points), "irb1600", "nominal", holdout=0.5)
    irbcal.save(saved, tmp_path / "out")
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert_harmless(page)
    (section,) = html.document_fromstring(page).xpath("//section[@id='joints']")
    assert "It is seen in joint 1. No model" in " ".join(section.text_content().split())
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


def test_backlash_of_a_real_robot(shared_data, tmp_path):
    """The IRB 120: its residuals depend on the direction of joint 1, and a mean by hand says so, too."""
    file = shared_data / "irb120_laser_tracker" / "measurements.csv"
    outcome = outcome_of(file, "irb120", "34", holdout=296, split="last")
    calibration, _ = document.build(outcome)
    page = report_page.render(calibration)
    assert_harmless(page)
    assert len(page.encode()) < 1_000_000
    (section,) = html.document_fromstring(page).xpath("//section[@id='joints']")
    low, high = map(float, section.xpath(".//tbody/tr[1]/td[2]/text()")[0].split(" to "))
    assert low < high < -0.04
    # by hand: the turn about the base's z axis that each pose asks for, averaged by direction; as nothing is refitted,
    # what the geometry took of it is missing
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
    assert high + 0.03 > turn[far & (side < 0)].mean() - turn[far & (side > 0)].mean() > low
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


def test_pictures_show_both_models_on_white(calibration, evidence):
    from matplotlib.image import imread

    for figures in report_page.draw(calibration, evidence).values():
        for figure in figures:
            if figure.name in ("before_and_after", "residual_vectors"):
                pixels = (255 * imread(io.BytesIO(charts.file(figure, "png")))[..., :3]).round().astype(int)
                assert pixels[0, 0].tolist() == [255, 255, 255]
                for colour in (colours.NOMINAL, colours.CALIBRATED):
                    wanted = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
                    assert (np.abs(pixels - wanted).max(axis=-1) < 30).sum() > 100, (figure.name, colour)


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
    rows = list(csv.DictReader(io.StringIO(report_data.data_files(changed, evidence)["poses.csv"].decode())))
    assert rows[0]["pose"] == NASTY
    assert rows[0]["simulated"] == "1"


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
