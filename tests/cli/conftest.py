"""What the tests of several commands need: the program inside this process, and a calibration from simulated data."""

import json

import pytest
from typer.testing import CliRunner

import irbcal
from irbcal.cli.main import app
from irbcal.files import calibration_folder, robots


@pytest.fixture(scope="session")
def calibrated():
    """Calibrates the simulated demonstration robot into a folder, without the report that takes most of the time."""

    def make(folder, model):
        made = irbcal.calibrate(robots.demo_file("demo_identification.csv"), "irb1600", model)
        folder.mkdir()
        (folder / calibration_folder.URDF_NAME).write_bytes(made.urdf)
        (folder / calibration_folder.JSON_NAME).write_text(made.record.model_dump_json(), encoding="utf-8")
        return folder

    return make


@pytest.fixture(scope="session")
def demo_calibration(calibrated, tmp_path_factory):
    """Folder of a calibration of the simulated demonstration robot, level 34."""
    return calibrated(tmp_path_factory.mktemp("calibration") / "demo", "34")


@pytest.fixture(scope="session")
def program():
    """Runs the program: what it prints, or its JSON with ``--json``; wrong calls and refusals raise."""

    def run(*arguments):
        done = CliRunner().invoke(app, [str(argument) for argument in arguments], catch_exceptions=False)
        assert done.exit_code == 0, done.output
        return json.loads(done.stdout) if "--json" in arguments else done.stdout

    return run
