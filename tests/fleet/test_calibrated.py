"""A fleet is calibrated whatever happens: one that fails, a worker that is killed, a run that is killed."""

import json
import os
import signal
import subprocess
import sys
import time

import pytest

import irbcal
from irbcal.errors import CalibrationError
from irbcal.parallel import Interrupted

PASSING = ("created", "seconds", "history", "calibrated_urdf_sha256", "seal")


def contents(out):
    """What was identified of each robot."""
    found = {}
    for path in sorted(out.glob("*/calibration.json")):
        record = json.loads(path.read_bytes())
        found[path.parent.name] = {name: value for name, value in record.items() if name not in PASSING}
    return found


def test_each_robot_has_its_folder_and_the_one_that_failed_its_sentence(calibrated):
    assert [robot.id for robot in calibrated.robots] == ["R0", "R1", "R2", "R9"]
    assert (calibrated.made, calibrated.kept, len(calibrated.failures)) == (3, 0, 1)
    assert calibrated.failures[0].verdict.endswith("none.csv: there is no such file")
    text = calibrated.summary()
    assert text.startswith("SIMULATED: 4 robots: 3 calibrated")
    assert "Failed: R9: " in text
    assert not (calibrated.out / "R9").exists()
    for robot in calibrated.robots[:3]:
        record = irbcal.load(calibrated.out / robot.id).record
        assert robot.mean_mm == record.heldout.all.mean_mm
        assert robot.model == "offsets"
    assert len(calibrated.to_frame()) == 4
    assert calibrated.to_dict()["failed"] == 1


def test_a_second_call_does_what_is_missing_or_changed(listed, calibrated, tmp_path, monkeypatch):
    before = contents(calibrated.out)
    again = irbcal.fleet_calibrate(listed, calibrated.out, jobs=1)
    assert (again.made, again.kept) == (0, 3)
    assert again.robots[:3] == calibrated.robots[:3]
    (calibrated.out / "R1" / "fleet.json").unlink()
    again = irbcal.fleet_calibrate(listed, calibrated.out, jobs=1)
    assert (again.made, again.kept) == (1, 2)
    assert contents(calibrated.out) == before


def test_a_folder_of_something_else_is_refused(listed, tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(CalibrationError, match="expected a new or empty folder, or that of a fleet"):
        irbcal.fleet_calibrate(listed, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_a_fault_of_irbcal_stops_none_of_the_others(listed, tmp_path, monkeypatch):
    real = irbcal.calibrate

    def stumbling(measurements, *arguments, **options):
        if measurements.endswith("r1.csv"):
            raise ZeroDivisionError("division by zero")
        return real(measurements, *arguments, **options)

    monkeypatch.setattr("irbcal.calibration.calibrate", stumbling)
    found = irbcal.fleet_calibrate(listed, tmp_path / "out", jobs=1)
    assert [robot.failed for robot in found.robots] == [False, True, False, True]
    assert found.robots[1].verdict == "irbcal failed, which is its own fault: ZeroDivisionError: division by zero"


def test_an_interruption_keeps_what_is_done(listed, tmp_path):
    def interrupt(text):
        if text == "1 of 4 robots":
            signal.raise_signal(signal.SIGINT)

    with pytest.raises(Interrupted, match="with 3 robots to calibrate: the same call goes on from there"):
        irbcal.fleet_calibrate(listed, tmp_path / "out", jobs=1, progress=interrupt)
    assert (tmp_path / "out" / "R0" / "fleet.json").exists()


def workers_of(pid):
    """Processes that a program started, but joblib's tracker."""
    found = subprocess.run(["ps", "-ww", "--ppid", str(pid), "-o", "pid=,args="], capture_output=True, text=True).stdout
    return [
        int(line.split()[0]) for line in found.splitlines() if "resource_tracker" not in line and "popen_loky" in line
    ]


def test_a_killed_worker_and_a_killed_run_lose_nothing(listed, calibrated, tmp_path):
    out = tmp_path / "out"
    command = [sys.executable, "-m", "irbcal", "fleet", "calibrate", listed, "--out", out, "--jobs", "2"]
    run = subprocess.Popen(list(map(str, command)), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 120
    while not (workers := workers_of(run.pid)):
        assert run.poll() is None
        assert time.monotonic() < deadline
        time.sleep(0.02)
    os.kill(workers[0], signal.SIGKILL)
    while run.poll() is None and not list(out.glob("*/fleet.json")):
        assert time.monotonic() < deadline
        time.sleep(0.005)
    run.kill()
    run.wait()
    found = irbcal.fleet_calibrate(listed, out, jobs=1)
    assert found.kept >= 1
    assert found.made + found.kept == 3
    assert contents(out) == contents(calibrated.out)
