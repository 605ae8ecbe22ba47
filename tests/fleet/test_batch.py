"""Every robot of a list is calibrated into its folder, and shown on a page that runs nothing."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace

import pytest

import irbcal
from irbcal.errors import CalibrationError, MeasurementError
from irbcal.fleet import batch
from irbcal.parallel import Interrupted

HEADER = "id,measurements,robot,date,options\n"


def read(folder, text):
    (folder / "m.csv").write_text(text)
    return batch.read_manifest(folder / "m.csv")


def test_a_row_is_a_robot(tmp_path):
    (tmp_path / "own.urdf").write_text("<robot/>")
    text = "id,serial,measurements,robot,date,options\nA-1,SN 7,a.csv,own.urdf,2026-03-17,"
    text += '"model=34 free=gain3,gain2 objective=pnorm power=6 as-poses=yes verify=v.csv"\n'
    (entry,) = read(tmp_path, text)
    assert (entry.id, entry.serial, entry.date) == ("A-1", "SN 7", "2026-03-17")
    assert entry.robot == str(tmp_path / "own.urdf")
    assert entry.measurements == str(tmp_path / "a.csv")
    assert entry.options == {
        "model": "34",
        "objective": "pnorm",
        "power": 6.0,
        "free": ["gain3", "gain2"],
        "as_poses": True,
        "verify": str(tmp_path / "v.csv"),
    }


def test_files_of_a_list_are_found_from_any_working_folder(tmp_path, monkeypatch):
    """Workers of a cluster have working folders of their own."""
    (tmp_path / "m.csv").write_text("id,measurements,robot\nR1,data/r1.csv,irb1600\n")
    monkeypatch.chdir(tmp_path)
    assert batch.read_manifest("m.csv")[0].measurements == str(tmp_path / "data" / "r1.csv")


def test_the_fingerprint_is_of_contents_not_of_places(tmp_path):
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "a.csv").write_text("same")
    one, two = (read(tmp_path / name, HEADER + "A,a.csv,irb1600,,model=34\n")[0] for name in ("one", "two"))
    assert one.sha256() == two.sha256()
    (tmp_path / "two" / "a.csv").write_text("other")
    assert one.sha256() != two.sha256()
    assert one.sha256() != read(tmp_path / "one", HEADER + "A,a.csv,irb1600,,model=26\n")[0].sha256()


@pytest.mark.parametrize(
    ("rows", "sentence"),
    [
        ("A,a.csv,irb1600,,\na,b.csv,irb1600,,\n", "row 3, column id: 'a' stands there more than once"),
        ("../x,a.csv,irb1600,,\n", "row 2, column id: expected letters, digits"),
        (".,a.csv,irb1600,,\n", "row 2, column id: expected letters, digits"),
        ("fleet.csv,a.csv,irb1600,,\n", "row 2, column id: expected letters, digits"),
        ("A,,irb1600,,\n", "row 2, column measurements: expected a text, found nothing"),
        ("A,a.csv,irb1600,17.3.2026,\n", "row 2, column date: expected a date such as 2026-03-17, found '17.3.2026'"),
        ("A,a.csv,irb1600,,colour=red\n", "row 2, column options: expected OPTION=VALUE with one of"),
        ("A,a.csv,irb1600,,seed=x\n", "row 2, column options: seed: "),
        ("A,a.csv,irb1600,,torques=x\n", "row 2, column options: torques: expected yes or no, found 'x'"),
        ("A,a.csv,irb1600,,model=35\n", "row 2, column options: model: expected"),
    ],
)
def test_what_is_no_robot_is_refused(tmp_path, rows, sentence):
    with pytest.raises(MeasurementError) as caught:
        read(tmp_path, HEADER + rows)
    assert str(caught.value).startswith(f"{tmp_path}/m.csv: {sentence}")


def test_strange_columns_are_refused(tmp_path):
    with pytest.raises(
        MeasurementError, match="there is a column colour: expected only id, measurements, robot, serial"
    ):
        read(tmp_path, "id,measurements,robot,colour\nA,a.csv,irb1600,red\n")


def test_a_mark_comes_back(calibrated):
    robot = calibrated.robots[0]
    assert batch.read_mark(calibrated.out / "R0") == robot


@pytest.mark.parametrize("damage", [b"", b"[]", b"{}", b'{"irbcal": 1, "colour": "red"}', b"\xff"])
def test_a_damaged_mark_is_none(tmp_path, damage):
    (tmp_path / batch.MARK).write_bytes(damage)
    assert batch.read_mark(tmp_path) is None


def test_a_robot_is_done_only_with_its_own_files(listed, calibrated, tmp_path):
    entry = batch.read_manifest(listed)[0]
    assert batch.finished(entry, calibrated.out / "R0") == calibrated.robots[0]
    assert batch.finished(replace(entry, serial="other"), calibrated.out / "R0") is None
    assert batch.finished(replace(entry, measurements="none.csv"), calibrated.out / "R0") is None
    (tmp_path / batch.MARK).write_bytes(replace(calibrated.robots[0], failed=True).mark())
    assert batch.finished(entry, tmp_path) is None


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
    assert (calibrated.calibrated, calibrated.reused, len(calibrated.failures)) == (3, 0, 1)
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
    assert (again.calibrated, again.reused) == (0, 3)
    assert again.robots[:3] == calibrated.robots[:3]
    (calibrated.out / "R1" / "fleet.json").unlink()
    again = irbcal.fleet_calibrate(listed, calibrated.out, jobs=1)
    assert (again.calibrated, again.reused) == (1, 2)
    assert contents(calibrated.out) == before


def test_a_task_that_is_repeated_leaves_a_finished_robot_alone(listed, calibrated):
    """A cluster repeats tasks of workers that it lost, also when their robots are finished and added to a store."""
    entry = batch.read_manifest(listed)[0]
    mark = calibrated.out / entry.id / batch.MARK
    before = mark.stat().st_ino, mark.stat().st_mtime_ns
    assert batch._calibrate(str(calibrated.out), entry) == calibrated.robots[0]
    assert (mark.stat().st_ino, mark.stat().st_mtime_ns) == before


def test_a_folder_of_something_else_is_refused(listed, tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(CalibrationError):
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

    with pytest.raises(Interrupted, match="3 robots"):
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
    assert found.reused >= 1
    assert found.calibrated + found.reused == 3
    assert contents(out) == contents(calibrated.out)


def test_the_page_of_a_list_shows_all_robots(calibrated):
    text = batch.page(calibrated)
    assert "<script" not in text
    assert "<strong>Simulated.</strong>" in text
    for robot in calibrated.robots[:3]:
        assert f'<a href="{robot.id}/report.html">{robot.id}</a>' in text
        assert f"{robot.mean_mm:.3f}" in text
    assert "none.csv: there is no such file" in text
    evil = replace(calibrated, robots=(replace(calibrated.robots[0], serial="<b>&"),))
    assert "&lt;b&gt;&amp;" in batch.page(evil)
    assert "Not calibrated" not in batch.page(evil)
