"""The examples are written together, into an empty folder only, and say what they are."""

import json

import pytest
from typer.testing import CliRunner

import irbcal
from irbcal.cli.main import app
from irbcal.errors import CalibrationError
from irbcal.measurement.imports import map_file
from irbcal.practice.samples import samples


def test_there_is_a_line_for_every_command_and_every_preset(written):
    told = " ".join(written.tried.values())
    for name in (
        "calibrate",
        "evaluate",
        "fk",
        "ik",
        "filter",
        "view",
        "joints",
        "urdf",
        "iso9283",
        "tracker",
        "ballbar",
        "controller",
    ):
        assert f"irbcal {name} " in told
    for preset in map_file.presets():
        assert f"--as {preset} " in told
    assert set(written.about) == {
        p.relative_to(written.folder).as_posix() for p in written.folder.rglob("*") if p.is_file()
    } - {"README.txt"}
    text = (written.folder / "README.txt").read_text()
    assert "SIMULATED" in text
    assert all(line in text for line in written.tried.values())


def test_a_folder_with_something_in_it_is_left_alone(tmp_path):
    mine = tmp_path / "measured.csv"
    mine.write_text("mine")
    with pytest.raises(CalibrationError, match="expected a new or empty folder"):
        samples(tmp_path)
    assert mine.read_text() == "mine"
    assert list(tmp_path.iterdir()) == [mine]


def test_the_command(tmp_path):
    done = CliRunner().invoke(app, ["samples", str(tmp_path / "here"), "--json"], catch_exceptions=False)
    found = json.loads(done.output)
    assert found["simulated"] is True
    assert (tmp_path / "here" / found["files"][0]["file"]).exists()
    assert irbcal.samples is samples
