"""The report: one page that says what calibration.json says, and that no name in it can turn into code."""

import re
import shutil
import subprocess
from collections import Counter

import numpy as np
import pytest
from lxml import html
from support import TARGETS, arm, measured, random_robot, write_measurements

import irbcal
from irbcal import workflow
from irbcal.export import report
from irbcal.export.schema import (
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

NASTY = "</title><script>alert(1)</script>$\\frac$<img src=x onerror=alert(2)>\"'&amp;{{ 7*7 }}]]>漢字"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    nominal = arm()
    rng = np.random.default_rng(1)
    truth = random_robot(nominal, "34", rng)
    points = measured(truth, nominal.random_joints(60, 1), 3e-5, rng)
    path = write_measurements(tmp_path_factory.mktemp("data") / "m.csv", points)
    out = tmp_path_factory.mktemp("saved") / "calibration"
    irbcal.save(workflow.calibrate(path, "irb1600", "34", holdout=0.3), out)
    return out


@pytest.fixture(scope="module")
def calibration(folder):
    return irbcal.load(folder)


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
    table = {name: [column[k] for k in keep] for name, column in calibration.points.model_dump().items()}
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
        {"script", "img", "iframe", "link", "a"}
    )
    ids = Counter(document.xpath("//@id"))
    assert max(ids.values()) == 1
    for element in document.iter():
        for name, value in element.attrib.items():
            assert not name.startswith("on"), (name, value)
            if name in ("src", "href"):
                assert value.startswith("data:image/png;base64,") or value[1:] in ids
            for aim in re.findall(r"url\(([^)]*)\)", value):
                assert aim[1:] in ids
    assert "url(http" not in page
    assert "@import" not in page


def test_figures_are_those_of_the_calibration(calibration):
    page = report.render(calibration)
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


def rows_under(page, caption):
    """Cells of the table with this caption."""
    (table,) = html.document_fromstring(page).xpath(f"//table[caption='{caption}']")
    return [[" ".join(cell.text_content().split()) for cell in row] for row in table.xpath(".//tr")]


def test_tables_hold_the_exact_figures(calibration):
    nominal, calibrated = some_errors(0.8253414, ("smr1", "smr2")), some_errors(0.43848, ("smr1", "smr2"), ())
    calibration = calibration.model_copy(
        update={"heldout": calibrated, "heldout_nominal": nominal, "poses_heldout": 296}
    )
    page = report.render(calibration)
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
    assert expected in report.verdict(changed)
    page = report.render(changed)
    assert expected in text_of(page)
    (summary,) = html.document_fromstring(page).xpath("//div[@class='headline']//tbody")
    assert len(summary) == (1 if model == "nominal" else 2)


def test_without_heldout_poses_it_says_that_nothing_is_proven(calibration):
    page = report.render(without_heldout(calibration))
    assert_harmless(page)
    seen = text_of(page)
    assert "Nothing is proven: no poses were held out" in seen
    assert "never saw" not in seen
    assert "Held-out" not in seen
    assert len(html.document_fromstring(page).xpath("//svg")) == 4


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
    page = report.render(calibration.model_copy(update=update))
    assert_harmless(page)
    assert rows_under(page, "Position error, 3 poses (mm)")[-1][:3] == ["calibrated by rms", "888", "0.400"]
    turned_rows = rows_under(page, "Orientation error of the target frames (deg)")
    assert turned_rows[-1] == ["calibrated", "888", "0.0123", "0.0020", "0.1000"]
    assert "largest distance of the fitted points" in text_of(page)
    assert "certified: not below 1.235 mm" in text_of(page)
    assert "Chosen by cross-validation. " in text_of(page)
    assert "340.3500.0500.010yes" in text_of(page)


def test_simulated_data_are_announced_first(calibration):
    page = report.render(calibration.model_copy(update={"simulated": True}))
    assert html.document_fromstring(page).xpath("//main/*")[0].text_content().startswith("Simulated data")


@pytest.mark.parametrize("heldout", [True, False])
def test_names_are_harmless(calibration, heldout):
    changed = everywhere(calibration, NASTY)
    page = report.render(changed if heldout else without_heldout(with_points(changed, 3, 2)))
    assert_harmless(page)
    seen = text_of(page)
    assert f"Calibration of {NASTY}" in seen
    assert repr(NASTY) in seen  # in the example to copy, as Python writes it


@pytest.mark.parametrize(("poses", "targets", "groups"), [(1, 1, ()), (40, 9, ("3 kg", "6 kg")), (1000, 3, ("a",))])
def test_any_number_of_points(calibration, poses, targets, groups):
    page = report.render(with_points(calibration, poses, targets, groups))
    assert_harmless(page)
    assert len(page.encode()) < 1_500_000
    assert len(html.document_fromstring(page).xpath("//svg")) == 6
    assert ("Held-out poses by group" in page) == bool(groups)
    assert ("Held-out poses by target" in page) == (targets > 1)


def test_perfect_predictions_can_be_drawn(calibration):
    changed = with_points(calibration, 5, 2)
    zeros = dict.fromkeys(("nominal_mm", "calibrated_mm"), [0.0] * 20)
    assert_harmless(report.render(changed.model_copy(update={"points": changed.points.model_copy(update=zeros)})))


def test_left_out_points_are_counted_by_reason_and_listed(calibration):
    excluded = [Exclusion(pose=str(k), target=t, reason="lost: no position") for k in range(3000) for t in TARGETS]
    excluded += [Exclusion(pose="9", target="smr1", reason=f"gross error: {k} mm") for k in range(2)]
    page = report.render(calibration.model_copy(update={"excluded": excluded, "poses_excluded": 3000}))
    (counts, listed) = html.document_fromstring(page).xpath("//section[@id='left-out']//table")
    assert [[cell.text_content() for cell in row] for row in counts.xpath("tbody/tr")] == [
        ["lost", "9000"],
        ["gross error", "2"],
    ]
    assert listed.xpath("ancestor::details")
    assert listed.xpath("tbody/tr")[1].text_content() == "1smr1, smr2, smr3lost: no position"
    assert len(listed.xpath("tbody/tr")) == report.MOST_LISTED
    assert "1002 further lines in calibration.json" in text_of(page)
    assert "every measured point was used" in text_of(report.render(calibration.model_copy(update={"excluded": []})))


def test_the_same_calibration_gives_the_same_page(calibration):
    assert report.render(calibration) == report.render(calibration)


def test_matplotlib_settings_neither_matter_nor_change(calibration):
    import matplotlib

    page = report.render(calibration)
    with matplotlib.rc_context({"svg.fonttype": "path", "font.size": 40, "axes.facecolor": "red"}):
        assert report.render(calibration) == page
        assert matplotlib.rcParams["font.size"] == 40


@pytest.mark.parametrize(
    ("value", "digits", "expected"), [(-1e-9, 3, "0.000"), (2.0005001, 3, "2.001"), (-90.00962, 4, "-90.0096")]
)
def test_numbers(value, digits, expected):
    assert report.fixed(value, digits) == expected


def test_the_examples_on_the_page_run(folder, calibration):
    document = html.document_fromstring(report.render(calibration))
    examples = [text for text in (code.text_content() for code in document.xpath("//pre/code")) if "import" in text]
    q = np.array([[0.1, -0.2, 0.3, 0.4, -0.5, 0.6]])
    names = {"q": q}
    assert len(examples) == 2
    for example in examples:
        exec(example.replace("DIR", str(folder)), names)
    robot = calibration.robot_calibrated()
    assert np.abs(names["xyz"] - robot.points(q, "smr1")).max() < 1e-12
    assert np.abs(names["T_base_tip"].homogeneous - robot.poses(q)[0]).max() < 1e-9


def test_a_browser_shows_it_without_complaint(calibration, tmp_path):
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("no chromium on PATH")

    def visit(name, page):
        path = tmp_path / name
        path.write_text(page, encoding="utf-8")
        command = [chromium, "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path / 'profile'}"]
        command += ["--enable-logging=stderr", "--dump-dom", path.as_uri()]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120)
        return done.stdout, [line for line in done.stderr.splitlines() if "CONSOLE" in line]

    page = report.render(everywhere(calibration, NASTY))
    dom, complaints = visit("report.html", page)
    assert dom.count("<svg") == 4
    assert complaints == []
    _, complaints = visit("control.html", page.replace("</body>", "<script>alert(1)</script></body>"))
    assert complaints, "a script that the page's policy refuses went unnoticed"
