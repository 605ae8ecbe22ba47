"""Commands that name one of their inputs as an output: refused, and every byte stays."""

import shutil

import pytest
from typer.testing import CliRunner

import irbcal
from irbcal.cli.main import app
from irbcal.io import robots


@pytest.fixture
def place(tmp_path, demo_calibration):
    shutil.copytree(demo_calibration, tmp_path / "cal")
    (tmp_path / "robot.urdf").write_bytes(robots.robot_file("irb1600").read_bytes())
    (tmp_path / "v.csv").write_bytes(robots.demo_file("demo_identification.csv").read_bytes())
    (tmp_path / "job.csv").write_text("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n0,0,0,0,30,0\n")
    return tmp_path


COMMANDS = [
    "filter cal job.csv --out new.csv --changes job.csv",
    "filter cal job.csv --out new.csv --changes new.csv",
    "filter cal job.csv --out cal/calibration.json",
    "view cal v.csv --html v.csv",
    "view robot.urdf --html robot.urdf",
    "view cal --html cal/calibration.json",
    "simulate job.csv --robot robot.urdf --out robot.urdf",
    "simulate job.csv --robot robot.urdf --out job.csv",
    "calibrate v.csv --robot cal/calibrated.urdf --out cal",
    "ballbar cal v.csv --plot v.csv",
    "tracker v.csv --plot v.csv",
    "iso9283 v.csv --plot v.csv",
]


def contents(folder):
    return {str(path): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.mark.parametrize("line", COMMANDS)
def test_inputs_are_never_written(place, monkeypatch, line):
    monkeypatch.chdir(place)
    before = contents(place)
    done = CliRunner().invoke(app, line.split())
    assert done.exit_code in (1, 2), done.output
    assert "to write" in str(done.exception) or "another file" in str(done.exception), done.exception
    assert contents(place) == before


def test_a_calibration_is_replaced_with_force_only(place):
    before = contents(place)
    line = ["demo", "--model", "11", "--out", str(place / "cal")]
    done = CliRunner().invoke(app, line)
    assert done.exit_code == 1
    assert "replace it with --force" in str(done.exception)
    assert contents(place) == before
    assert CliRunner().invoke(app, [*line, "--force"]).exit_code == 0
    assert irbcal.load(place / "cal").record.model == "11"
