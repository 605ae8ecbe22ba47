"""From a plan to a corrected program on the virtual cell, by the commands that the README names."""

import json

import pytest
from typer.testing import CliRunner

from irbcal.cli.main import app

JOB = """q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg
10,-10,20,15,40,-30
-20,15,5,-30,35,60
35,25,-30,10,50,-80
0,-14,14,0,20,0
-45,10,10,20,-40,15
60,-20,30,-25,30,100
"""


def run(*arguments):
    """Output of a command; exit code 0."""
    done = CliRunner().invoke(app, list(arguments), catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.output


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Works in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_planned_calibration_brings_a_program_to_where_it_should_be(folder):
    run("plan", "--robot", "irb1600", "--out", "plan", "--cube", "40", "--all-range", "40", "--seed", "3")
    measured = json.loads(run("simulate", "plan/poses.csv", "--robot", "irb1600", "--out", "measured.csv", "--json"))
    assert measured["poses"] == 98
    result = json.loads(run("calibrate", "measured.csv", "--robot", "irb1600", "--out", "my-robot", "--json"))
    assert result["simulated"]
    heldout = result["heldout"]["mean_mm"]
    assert heldout < 0.3 * result["nominal_heldout"]["mean_mm"]
    (folder / "job.csv").write_text(JOB)
    run("filter", "my-robot", "job.csv", "--out", "corrected.csv")
    misses = {}
    for name in ("job", "corrected"):
        sighted = ("--without", "visibility", "--without", "lost")
        against = ("--wanted", "job.csv", "--calibration", "my-robot", "--out", f"{name}_measured.csv")
        found = json.loads(run("simulate", f"{name}.csv", "--robot", "irb1600", *sighted, *against, "--json"))
        misses[name] = found["wanted"]
    assert misses["corrected"]["mean_mm"] < 2.0 * heldout
    assert misses["corrected"]["mean_mm"] < 0.4 * misses["job"]["mean_mm"]
    # the truth lies beside the data, and the calibration did not need it
    assert (folder / "measured.truth.json").exists()
    assert "truth" not in (folder / "my-robot/calibration.json").read_text()
