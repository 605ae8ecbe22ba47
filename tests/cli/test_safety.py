"""What must not happen on the command line: names that act, inputs overwritten, files half-written, blocked trackers."""

import numpy as np
import pytest
from support import arm, example_robot

from irbcal.errors import CalibrationError, MeasurementError
from irbcal.files import robots, urdf_check
from irbcal.planning.collisions import CollisionModel


@pytest.fixture(scope="module")
def verification():
    """The first rows of the simulated verification."""
    return "\n".join(robots.demo_file("demo_verification.csv").read_text().splitlines()[:400]) + "\n"


def test_names_that_look_like_markup_are_shown_as_they_are(program, demo_calibration, verification, tmp_path):
    for name in ("run 3 [/dev/tty]", "[red]range", "[link=x]y"):
        lines = verification.splitlines()
        half = [line.replace("iso_cube", name) for line in lines[200:]]
        (tmp_path / "m.csv").write_text("\n".join([*lines[:200], *half]) + "\n")
        assert name in program("evaluate", demo_calibration, tmp_path / "m.csv")


@pytest.mark.parametrize(("old", "new", "column"), [("iso_cube", "a\x1b[31mred", "group"), ("smr1", "T\x01", "target")])
def test_control_characters_in_names_are_refused(program, demo_calibration, verification, tmp_path, old, new, column):
    (tmp_path / "m.csv").write_text(verification.replace(old, new))
    with pytest.raises(MeasurementError, match=rf"m\.csv: row \d+, column {column}: expected a name of printable"):
        program("evaluate", demo_calibration, tmp_path / "m.csv")


def test_what_is_read_is_never_overwritten(program, demo_calibration, tmp_path):
    job = "q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n10,-10,20,15,40,-30\n"
    (tmp_path / "job.csv").write_text(job)
    (tmp_path / "link.csv").symlink_to(tmp_path / "job.csv")
    for out in ("job.csv", "link.csv"):
        with pytest.raises(CalibrationError, match="this is the file to read from"):
            program("filter", demo_calibration, tmp_path / "job.csv", "--out", tmp_path / out)
        with pytest.raises(CalibrationError, match="this is the file to read from"):
            program("simulate", tmp_path / "job.csv", "--robot", "irb1600", "--out", tmp_path / out)
    assert (tmp_path / "job.csv").read_text() == job


def test_a_folder_is_no_file_to_write(program, demo_calibration, tmp_path):
    (tmp_path / "job.csv").write_text("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n10,-10,20,15,40,-30\n")
    (tmp_path / "out").mkdir()
    with pytest.raises(CalibrationError, match="out: expected a file to write, found a folder"):
        program("filter", demo_calibration, tmp_path / "job.csv", "--out", tmp_path / "out")


def test_readings_of_several_targets_are_no_drift(program, verification, tmp_path):
    lines = verification.splitlines()
    rows = [f"{line},{k}" for k, line in enumerate(lines[1:])]
    (tmp_path / "m.csv").write_text("\n".join([lines[0] + ",time_s", *rows]))
    with pytest.raises(MeasurementError, match="column target: expected the readings of one fixed target, found ref1"):
        program("tracker", tmp_path / "m.csv", "--check", "drift")


@pytest.mark.parametrize("name", ["irb1600", "ur10"])
def test_the_tracker_is_an_obstacle(name):
    """Where the tip goes, a ball is touched; far away it is not; nothing else changes."""
    path = robots.robot_file(name) if name == "irb1600" else example_robot("ur_description/urdf/ur10_robot.urdf")
    nominal = arm(path)
    model = CollisionModel(path.read_bytes(), nominal, package_dirs=robots.package_dirs())
    q = nominal.random_joints(40, 1)
    before = model.touching(q)
    model.add_obstacle([50.0, 0.0, 0.0], 0.25)
    assert (model.touching(q) == before).all()
    row = int(np.flatnonzero(~before)[0])
    tip = urdf_check.poses(path.read_bytes(), nominal, q[row : row + 1])[0, :3, 3]
    model.add_obstacle(tip, 0.25)
    after = model.touching(q)
    assert after[row]
    assert (after >= before).all()


def test_no_plan_runs_into_the_tracker(program, tmp_path):
    """The middle of the cube: what is left keeps its distance; inside the base it is refused."""
    with pytest.raises(MeasurementError, match="--tracker: expected a place at least 300 mm from the base link"):
        program("plan", "--robot", "irb1600", "--out", tmp_path / "p", "--tracker", "0,0,200")
