"""Calibration folders in a store: rows, lists and exports."""

import json
import re
from datetime import date

import numpy as np
import pandas as pd
import pytest
from fleet_support import manifest, measured
from lxml import html
from typer.testing import CliRunner

import irbcal
from irbcal.cli import main
from irbcal.errors import CalibrationError, OptionError
from irbcal.fleet import adding, store_page
from irbcal.fleet.store import opened
from irbcal.identification.fit import identify


def test_robots_beyond_the_tolerance_come_first_then_those_that_grew():
    def history(name, *errors):
        days = tuple(date(2026, month + 1, 1) for month in range(len(errors)))
        return store_page.ErrorHistory(name, "arm", tuple(range(len(errors))), days, np.array(errors))

    robots = [history("mended", 0.5, 0.1), history("worn", 0.1, 0.4), history("grew", 0.1, 0.2), history("lost", 0.1)]
    order = [robot.robot for robot in store_page.worst_first(robots, {}, 0.3)]
    assert order == ["worn", "grew", "lost", "mended"]


def test_a_calibration_is_taken_as_it_is(calibrated, stored):
    record, one = irbcal.load(calibrated.out / "R1").record, stored[1]
    assert one.robot == {"id": "R1", "serial": "SN-1", "type": "irb1600_6_145"}
    assert str(one.measured) == "2026-03-02"
    assert one.calibration["heldout_mean_mm"] == record.heldout.all.mean_mm
    assert one.calibration["simulated"]
    listed = {row.name: row for row in record.parameters}
    for name, value, unit in zip(one.fit.names, one.fit.values, one.fit.units, strict=True):
        assert value == pytest.approx(listed[name].value * {"rad": np.pi / 180, "m": 1e-3}[unit])
    assert one.files == tuple((item.file, item.sha256) for item in record.data)
    assert "base_x" in {row["name"] for row in one.nuisance}


def test_the_level_is_fitted_to_the_saved_points(calibrated, stored):
    record = irbcal.load(calibrated.out / "R0").record
    points, _ = record.used_points(False)
    fit = identify(record.arm(calibrated=False), points, "34")
    level = stored[0].level
    by_name = {row.name: row for row in fit.parameters()}
    for name in ("delta_theta3", "delta_a2"):
        unit = np.pi / 180 if "theta" in name else 1e-3
        k = level.column_of[name]
        assert level.values[k] == pytest.approx(by_name[name].value * unit, rel=1e-6)
        # the three points of a pose count once
        assert level.covariance[k, k] ** 0.5 == pytest.approx(by_name[name].std * unit * 3**0.5, rel=0.02)


def test_id_serial_and_date_can_be_told(calibrated):
    one = adding.stored(calibrated.out / "R0", "other", "SN", "2025-12-24")
    assert one.robot["id"] == "other"
    assert str(one.measured) == "2025-12-24"
    with pytest.raises(CalibrationError, match="'Christmas'"):
        adding.stored(calibrated.out / "R0", measured="Christmas")


def run(*arguments):
    done = CliRunner(env={"COLUMNS": "200"}).invoke(main.app, ["fleet", *map(str, arguments)], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.stdout


@pytest.fixture(scope="module")
def store(calibrated, tmp_path_factory):
    """Two calibrations of each robot; of the last one joint 3's zero moved between them."""
    folder = tmp_path_factory.mktemp("later")
    for k in range(3):
        measured(folder, f"r{k}.csv", 10 + k, 70 + k, moved=np.radians(0.2) if k == 2 else 0.0)
    rows = [(f"R{k}", f"SN-{k}", f"r{k}.csv", "irb1600", "2026-07-01", "model=offsets seed=3") for k in range(3)]
    later = irbcal.fleet_calibrate(manifest(folder, rows), folder / "out", jobs=1)
    path = folder / "fleet.db"
    assert "6 calibrations added" in run("add", calibrated.out, later.out, "--store", path)
    assert "0 calibrations added to" in run("add", later.out / "R0", "--store", path)
    return path


def test_the_list_tells_what_changed(store, tmp_path):
    text = run("list", "--store", store, "--report", tmp_path / "page.html")
    assert text.startswith("SIMULATED: 6 calibrations of 3 robots of 1 type; 1 changed since the calibration before")
    assert "R2: 2026-03-02 to 2026-07-01: CHANGED" in text
    page = (tmp_path / "page.html").read_text()
    assert "<strong>Simulated.</strong>" in page
    assert "2026-03-02 to 2026-07-01: CHANGED" in page
    listed = json.loads(run("list", "--store", store, "--json"))["robots"]
    assert [(row["id"], row["times"], row["measured"]) for row in listed] == [
        (f"R{k}", 2, "2026-07-01") for k in range(3)
    ]


def figures(page):
    return [(figure.text_content(), figure) for figure in html.fromstring(page.read_bytes()).iter("figure")]


def test_the_page_draws_errors_and_what_moved_the_most_drifted_robot_first(store, tmp_path, monkeypatch):
    page = tmp_path / "page.html"
    irbcal.fleet_list(store, report=page, tolerance=1.0)
    assert [text.split()[0] for text, _ in figures(page)].index("R2") == 0
    words, figure = figures(page)[0]
    (moved,) = re.findall(r"2026-07-01: ([+-][\d.]+) ± ([\d.]+) degrees", words)  # 0.2 degrees were SIMULATED
    assert "joint 3's zero" in words
    assert abs(float(moved[0])) == pytest.approx(0.2, abs=2 * float(moved[1]) + 0.01)
    errors = [json.loads(run("list", "--store", store, "--json"))["robots"][2]["heldout_mean_mm"]]
    assert f"2026-07-01: {errors[0]:.3f} mm" in words
    assert not any("joint" in text for text, _ in figures(page)[1:])
    document = html.fromstring(page.read_bytes())
    targets = {link.get("href") for link in document.iter("a")}
    assert all(document.get_element_by_id(target[1:]) is not None for target in targets if target.startswith("#"))
    assert (
        "Joint 3's zero moved by"
        in document.get_element_by_id(figure.xpath(".//a/@href")[0][1:]).getnext().text_content()
    )
    (command,) = [text for text in document.xpath("//pre/code/text()") if "R2" in text]
    monkeypatch.chdir(page.parent)
    assert CliRunner().invoke(main.app, command.split()[1:], catch_exceptions=False).exit_code == 0

    irbcal.fleet_list(store, report=page, tolerance=0.001)  # all are beyond it: the most changed is still the first
    assert figures(page)[0][0].startswith("R2")
    with pytest.raises(OptionError, match="tolerance: expected a page to draw it on"):
        irbcal.fleet_list(store, tolerance=0.001)


def test_of_many_robots_the_page_draws_the_type_and_the_worst(store, tmp_path, monkeypatch):
    monkeypatch.setattr(store_page, "MOST_ROBOTS", 1)
    page = tmp_path / "page.html"
    irbcal.fleet_list(store, report=page)
    (of_type, _), (worst, _) = figures(page)
    assert "3 robots, 1 changed" in of_type
    assert worst.startswith("R2")
    irbcal.fleet_export(tmp_path / "c.csv", store, what="calibrations")
    table = pd.read_csv(tmp_path / "c.csv")
    middle = table[table.measured == "2026-07-01"].heldout_mean_mm.median()
    assert "2026-07-01, 3 calibrations: " in of_type
    assert f", {middle:.3f}, " in of_type.partition("2026-07-01, 3 calibrations: ")[2][:30]


def test_drift_names_the_zero_that_moved(store):
    text = run("drift", "R2", "--store", store)
    assert text.startswith(
        "SIMULATED: R2 (serial SN-2, irb1600_6_145): 1 of 1 pair of successive calibrations shows a change"
    )
    assert "Joint 3" in text
    found = json.loads(run("drift", "R2", "--store", store, "--json"))["changes"][0]["parameters"][0]
    assert found["name"] == "delta_theta3"
    assert found["value"] == pytest.approx(np.radians(0.2), abs=4 * found["std"])
    assert "no change" in run("drift", "R0", "--store", store)
    every = run("drift", "--store", store)
    assert every.startswith(
        "SIMULATED: 3 robots: 1 of 3 pairs of successive calibrations shows a change\nR2: 2026-03-02 to 2026-07-01: CHANGED"
    )
    assert "R2: Joint 3" in every
    rows = json.loads(run("drift", "--store", store, "--json"))["changes"]
    assert [(row["robot"], row["changed"]) for row in rows] == [("R0", False), ("R1", False), ("R2", True)]
    with pytest.raises(CalibrationError, match="there is no robot R7, expected one of R0, R1, R2"):
        irbcal.fleet_drift("R7", store)


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_tables_are_exported(store, tmp_path, ending):
    if ending == "parquet":
        pytest.importorskip("pyarrow", reason="irbcal[parquet] is not installed")
    out = tmp_path / f"t.{ending}"
    rows = irbcal.fleet_export(out, store, what="parameters")
    frame = (pd.read_csv if ending == "csv" else pd.read_parquet)(out)
    assert len(frame) == rows
    assert set(frame["robot"]) == {"R0", "R1", "R2"}
    assert {"name", "value", "std", "unit", "measured"} <= set(frame.columns)
    assert irbcal.fleet_export(out, store, what="parameters") == rows
    assert irbcal.fleet_export(tmp_path / f"c.{ending}", store, what="calibrations") == 6


def test_wrong_calls_are_refused(store, calibrated, tmp_path):
    with pytest.raises(OptionError, match=r"expected a name that ends in .csv or .parquet, found 't.txt'"):
        irbcal.fleet_export(tmp_path / "t.txt", store)
    with pytest.raises(OptionError, match="what: expected robots, calibrations, parameters or files"):
        irbcal.fleet_export(tmp_path / "t.csv", store, what="all")
    with pytest.raises(OptionError, match="serial: it is of a single calibration, found 3"):
        irbcal.fleet_add(calibrated.out, tmp_path / "s.db", serial="X")
    with pytest.raises(CalibrationError, match="the store has no calibrations of type none"):
        irbcal.fleet_list(store, type="none")


def test_no_store_is_made_for_what_is_no_calibration(tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(CalibrationError, match="calibration"):
        irbcal.fleet_add(tmp_path / "empty", tmp_path / "new.db")
    assert not (tmp_path / "new.db").exists()


def test_an_empty_store_is_not_written_as_a_table(tmp_path):
    with opened(tmp_path / "fleet.db", create=True):
        pass
    for ending in ("csv", "parquet"):
        with pytest.raises(CalibrationError, match="no parameters: there is nothing to write"):
            irbcal.fleet_export(tmp_path / f"p.{ending}", tmp_path / "fleet.db")
    assert [path.name for path in tmp_path.iterdir()] == ["fleet.db"]
