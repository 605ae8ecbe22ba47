"""``irbcal export``: what it writes, and what it never writes over."""

import shutil
from pathlib import Path

import pytest
from typer.testing import CliRunner

import irbcal
from irbcal.cli.main import app
from irbcal.errors import CalibrationError, IrbcalError, OptionError
from irbcal.exporting.export import TARGETS


@pytest.mark.parametrize("target", ["cpp", "python"])
def test_an_export_names_its_calibration_and_is_the_same_every_time(folder, tmp_path, program, target):
    told = program("export", folder, "--as", target, "--out", tmp_path / "a", "--json")
    again = irbcal.export(folder, target, tmp_path / "b")
    assert told["files"] == list(again.files)
    assert told["fingerprint"] == again.fingerprint == irbcal.load(folder).record.fingerprint
    assert told["largest_miss"] < 1e-12
    assert again.summary()
    for name in again.files:
        content = (tmp_path / "a" / name).read_text()
        assert content == (tmp_path / "b" / name).read_text()
    assert any(again.fingerprint in (tmp_path / "a" / name).read_text() for name in again.files)


def test_simulated_measurements_are_named(demo_calibration, tmp_path):
    for target in ("cpp", "python"):
        found = irbcal.export(demo_calibration, target, tmp_path)
        assert "SIMULATED" in found.report()[0]
        assert "SIMULATED" in (tmp_path / found.files[0]).read_text()


def test_what_it_refuses(folder, tmp_path, monkeypatch):
    with pytest.raises(
        CalibrationError, match=r"calibration in this folder, whose joint_origins\.yaml would be replaced"
    ):
        irbcal.export(folder, "urdf", folder)
    with pytest.raises(OptionError, match="as: expected cpp"):
        irbcal.export(folder, "fortran", tmp_path)
    with pytest.raises(CalibrationError, match="not a calibration folder"):
        irbcal.export(tmp_path, "cpp", tmp_path / "out")
    (tmp_path / "file").write_text("kept")
    with pytest.raises(IrbcalError):
        irbcal.export(folder, "cpp", tmp_path / "file")
    assert (tmp_path / "file").read_text() == "kept"
    assert not (tmp_path / "out").exists()


def test_an_export_goes_beside_a_calibration_of_which_it_replaces_nothing(folder, tmp_path):
    beside = Path(shutil.copytree(folder, tmp_path / "cal"))
    before = {path: path.read_bytes() for path in beside.iterdir()}
    done = CliRunner().invoke(app, ["export", str(beside), "--as", "python", "--out", str(beside)])
    assert done.exit_code == 0, done.output
    assert len([*beside.iterdir()]) > len(before)
    assert {path: path.read_bytes() for path in before} == before


def test_every_target_says_what_it_is():
    from importlib import import_module

    for target in TARGETS:
        module = import_module(f"irbcal.exporting.{target}")
        assert module.DESCRIPTION
        assert "{folder}" in module.NEXT_STEP or "{package!r}" in module.NEXT_STEP
