"""Adding, listing, exporting and comparing, from the shell."""

import json

import numpy as np
import pandas as pd
import pytest
from fleet_support import manifest, measured
from typer.testing import CliRunner

import irbcal
from irbcal.cli import main
from irbcal.errors import CalibrationError, OptionError


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
    assert "R2: 2026-03-02 to 2026-07-01: CHANGED" in page
    assert len(json.loads(run("list", "--store", store, "--json"))["calibrations"]) == 6


def test_drift_names_the_zero_that_moved(store):
    text = run("drift", "R2", "--store", store)
    assert text.startswith("SIMULATED: R2 (serial SN-2, irb1600_6_145): 1 of 1 step a change")
    assert "Joint 3's zero moved by 0." in text
    found = json.loads(run("drift", "R2", "--store", store, "--json"))["changes"][0]["parameters"][0]
    assert found["name"] == "delta_theta3"
    assert found["value"] == pytest.approx(np.radians(0.2), abs=4 * found["std"])
    assert "no change beyond the uncertainty" in run("drift", "R0", "--store", store)
    with pytest.raises(CalibrationError, match="R7: two calibrations are needed to see a change, found none of the 3"):
        irbcal.fleet_drift("R7", store)


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_tables_are_exported(store, tmp_path, ending):
    if ending == "parquet":
        pytest.importorskip("pyarrow", reason="irbcal[parquet] is not installed")
    out = tmp_path / f"t.{ending}"
    rows = irbcal.fleet_export(store, out, what="parameters")
    frame = (pd.read_csv if ending == "csv" else pd.read_parquet)(out)
    assert len(frame) == rows
    assert set(frame["robot"]) == {"R0", "R1", "R2"}
    assert {"name", "value", "std", "unit", "measured"} <= set(frame.columns)
    assert irbcal.fleet_export(store, out, what="calibrations") == 6


def test_wrong_calls_are_refused(store, calibrated, tmp_path):
    with pytest.raises(OptionError, match=r"expected a name that ends in .csv or .parquet, found 't.txt'"):
        irbcal.fleet_export(store, tmp_path / "t.txt")
    with pytest.raises(OptionError, match="what: expected robots, calibrations, parameters or files"):
        irbcal.fleet_export(store, tmp_path / "t.csv", what="all")
    with pytest.raises(OptionError, match="serial: it is of a single calibration, found 3"):
        irbcal.fleet_add(calibrated.out, tmp_path / "s.db", serial="X")
    with pytest.raises(CalibrationError, match="the store has no calibrations of type none"):
        irbcal.fleet_list(store, type="none")


def test_no_store_is_made_for_what_is_no_calibration(tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(CalibrationError, match="calibration"):
        irbcal.fleet_add(tmp_path / "empty", tmp_path / "new.db")
    assert not (tmp_path / "new.db").exists()
