"""The certificate: what it says, what it must not say, and that it fits on two pages."""

import html
import json
import re
from dataclasses import replace
from datetime import datetime, timezone

import pandas as pd
import pytest
from typer.testing import CliRunner

import irbcal
from irbcal.cli.main import app
from irbcal.errors import OptionError
from irbcal.io import robots
from irbcal.io.calibration_folder import read
from irbcal.reports import certificate
from irbcal.summary import as_text
from irbcal.units import MM

HOSTILE = "</dd><script>window.hacked=1</script><img src=x onerror=a>"
PROOF = robots.demo_file("demo_verification.csv")


@pytest.fixture(scope="module")
def some():
    """120 poses of the simulated verification."""
    table = pd.read_csv(PROOF)
    return table[table["pose"].isin(table["pose"].unique()[::8])]


@pytest.fixture(scope="module")
def passed(demo_calibration, some):
    return irbcal.evaluate(demo_calibration, some, tolerance=1.1 * MM, info={"operator": HOSTILE, "<b>": "=1+1"})


@pytest.fixture(scope="module")
def moved(demo_calibration, some):
    """The tracker was moved in the middle, and names are long."""
    table = some[~some["target"].str.startswith("ref")]
    late = table["pose"] > table["pose"].median()
    table = table.assign(x_mm=table["x_mm"] + 1.5 * late, pose="W" * 60 + table["pose"].astype(str))
    info = {f"key{k}": "v" * 60 for k in range(10)} | {"tracker": "Leica " * 9, "operator": HOSTILE}
    return irbcal.evaluate(demo_calibration, table, tolerance=5 * MM, info=info)


def text_of(page):
    return html.unescape(re.sub(r"\s+", " ", re.sub(r"<[^>]*>", " ", page.split("</style>")[1])))


def test_it_says_what_the_evaluation_found(passed, demo_calibration):
    page = certificate.render(passed, datetime(2026, 11, 22, 1, 2, tzinfo=timezone.utc))
    text = text_of(page)
    assert "PASS" in text
    assert "NOT PROVEN" not in text
    assert passed.conformity.sentence() in text
    assert "2026-11-22 01:02 UTC" in text
    assert f"irbcal {irbcal.__version__}" in text
    assert text.count("SIMULATED") >= 2
    for name in ("nominal", "calibrated"):
        assert f"{getattr(passed, name)['mean_plus_3sigma_mm']:.3f}" in text
    for item in passed.origin.files:
        assert item.sha256 in text
    assert "Signature" in text
    assert f"{passed.origin.unseen} poses" in text
    certainty = read(demo_calibration).record.robot_calibrated().certainty
    assert f"base and flange, about {certainty.open_ends() / MM:.2f} mm open" in text
    assert re.search(r"Worst poses .*" + f"{passed.calibrated['max_mm']:.3f}", text)


def test_hostile_words_are_shown_not_run(passed):
    page = certificate.render(passed)
    assert "<script>window" not in page
    assert "&lt;script&gt;window.hacked=1" in page
    assert "<img" not in page
    assert "default-src 'none'" in page


def test_doubts_leave_no_pass(moved):
    assert moved.conformity.outcome == "not proven"
    assert moved.conformity.value_mm < moved.conformity.tolerance_mm
    text = text_of(certificate.render(moved))
    assert "NOT PROVEN" in text
    assert "No pass: " in text
    assert "PASS " not in text
    assert "was the tracker or the robot" in text


def test_without_a_tolerance_it_judges_nothing(demo_calibration, some):
    text = text_of(certificate.render(irbcal.evaluate(demo_calibration, some)))
    assert "Statement of position accuracy" in text
    assert "NO TOLERANCE" in text
    assert "PASS" not in text
    assert "FAIL" not in text


def test_files_beside_it(passed, tmp_path):
    written = irbcal.certificate(passed, tmp_path / "c.html", figures=tmp_path / "f", format="svg", data=tmp_path / "d")
    assert {name for names in written.values() for name in names} == {
        *("c.html", "errors_by_pose_measured.svg", "workspace.svg", "residual_vectors.svg"),
        *("points.csv", "poses.csv", "certificate.json"),
    }
    points = pd.read_csv(tmp_path / "d" / "points.csv")
    assert points["calibrated_mm"].mean() == pytest.approx(passed.calibrated["mean_mm"], abs=1e-9)
    assert (points["simulated"] == 1).all()
    assert len(pd.read_csv(tmp_path / "d" / "poses.csv")) == len(passed.errors.pose_names)
    whole = json.loads((tmp_path / "d" / "certificate.json").read_text())
    assert whole["conformity"]["outcome"] == "pass"
    assert "SIMULATED" in (tmp_path / "f" / "workspace.svg").read_text()


def test_wrong_calls(passed, tmp_path):
    with pytest.raises(OptionError, match=r"ends in \.html"):
        irbcal.certificate(passed, tmp_path / "c.pdf")
    with pytest.raises(OptionError, match="only figures"):
        irbcal.certificate(passed, tmp_path / "c.html", format="svg")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("tolerance", "code"), [("1.1", 0), ("0.3", 3)])
def test_the_exit_code_tells(demo_calibration, some, tmp_path, tolerance, code):
    some.to_csv(tmp_path / "v.csv", index=False)
    call = ["evaluate", demo_calibration, tmp_path / "v.csv", "--tolerance", tolerance, "--info", "serial=1600-1"]
    done = CliRunner().invoke(app, [str(word) for word in [*call, "--report", tmp_path / "c.html", "--json"]])
    assert done.exit_code == code
    found = json.loads(done.stdout)
    assert found["conformity"]["outcome"] == ("fail" if code else "pass")
    assert found["written"] == [str(tmp_path / "c.html")]
    assert "1600-1" in (tmp_path / "c.html").read_text()


@pytest.mark.parametrize(
    "options", [["--info", "serial"], ["--info", "a=1", "--info", "a=2"], ["--figures", "f"], ["--rule", "max"]]
)
def test_wrong_options_write_nothing(demo_calibration, tmp_path, monkeypatch, options):
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, ["evaluate", str(demo_calibration), str(PROOF), *options])
    assert done.exit_code != 0
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("options", [["c.pdf"], ["c.html", "--format", "svg"]])
def test_wrong_options_are_refused_before_the_evaluation(demo_calibration, tmp_path, options):
    (tmp_path / "v.csv").write_text("what the evaluation would refuse")
    done = CliRunner().invoke(app, ["evaluate", str(demo_calibration), str(tmp_path / "v.csv"), "--report", *options])
    assert re.search(r"ends in \.html|only figures", done.output), done.output


@pytest.fixture
def noted(passed):
    """With notes as long as they may be."""
    return replace(passed, notes=tuple(f"{k}: {'so many words ' * 27}" for k in range(7)))


@pytest.mark.parametrize("language", ["de", "fr", "ja"])
@pytest.mark.parametrize("which", ["moved", "noted"])
def test_it_is_two_pages_at_most(which, language, request, browser, tmp_path):
    irbcal.certificate(request.getfixturevalue(which), tmp_path / "c.html", language=language)
    page = browser.new_page(viewport={"width": 400, "height": 900})
    page.goto((tmp_path / "c.html").as_uri())
    assert page.evaluate("window.hacked") is None
    assert page.evaluate("document.documentElement.scrollWidth") <= 400
    sheets = len(re.findall(rb"/Type\s*/Page[^s]", page.pdf(prefer_css_page_size=True)))
    page.close()
    assert 1 <= sheets <= 2


def test_one_point_has_no_spread_and_passes_nothing(demo_calibration, some, tmp_path):
    pose = some[some["pose"] == some["pose"].iloc[0]]
    judged = irbcal.evaluate(demo_calibration, pose.head(1), tolerance=0.1, region_only=True)
    assert judged.calibrated["mean_plus_3sigma_mm"] is None
    assert (judged.conformity.outcome, judged.conformity.value_mm, judged.conformity.upper_mm) == (
        *("not proven", None, None),
    )
    irbcal.certificate(judged, tmp_path / "c.html", data=tmp_path)
    text = text_of((tmp_path / "c.html").read_text(encoding="utf-8"))
    mean = f"{judged.calibrated['mean_mm']:.3f}"
    assert f"calibrated 1 {mean} – – {mean} {mean}" in text
    assert judged.conformity.sentence() in text
    assert json.loads((tmp_path / "certificate.json").read_text())["calibrated"]["sigma_mm"] is None
    turned = irbcal.evaluate(demo_calibration, pose, flange=True)
    angles = turned.flange["calibrated"]["orientation"]
    assert (angles["n"], angles["sigma_deg"], angles["mean_plus_3sigma_deg"]) == (1, None, None)
    assert f"{angles['mean_deg']:.4f}" in as_text(turned.report())
