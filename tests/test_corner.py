"""A calibration from a corner of the workspace, end to end: every step that leaves the corner says so, with numbers."""

import numpy as np
import pandas as pd
import pytest
from support import arm, measured, random_robot, write_measurements

import irbcal
from irbcal.reports.report_page import verdict

COLUMNS = [f"q{k}_deg" for k in range(1, 7)]


def joints(width, n, seed):
    model, middle = arm("irb120"), np.radians([20.0, 20, 0, 30, 40, 10])
    half = 0.5 * width * np.minimum(model.upper - model.lower, 2 * np.pi)
    return middle + half * np.random.default_rng(seed).uniform(-1.0, 1.0, (n, 6))


@pytest.fixture(scope="module")
def robot():
    return random_robot(arm("irb120"), "34", np.random.default_rng(7), size=0.1)


def written(path, robot, q):
    return write_measurements(path, measured(robot, q, 3e-5, np.random.default_rng(2)))


@pytest.fixture(scope="module")
def folder(robot, tmp_path_factory):
    path = tmp_path_factory.mktemp("corner")
    irbcal.calibrate(written(path / "m.csv", robot, joints(0.15, 50, 1)), "irb120", "34").save(path / "cal")
    return path / "cal"


def test_calibration_report_and_evaluation_warn(folder, robot, tmp_path):
    calibration = irbcal.load(folder)
    (note,) = [note for note in calibration.record.doubts if "only where measured" in note]
    assert note in verdict(calibration.record)
    assert "only where measured" in (folder / "report.html").read_text(encoding="utf-8")
    inside = irbcal.evaluate(folder, written(tmp_path / "in.csv", robot, joints(0.1, 20, 3)))
    assert note in inside.verdict.doubts
    assert not [text for text in inside.notes if "outside the joint ranges" in text or "lie outside" in text]
    beyond = irbcal.evaluate(folder, written(tmp_path / "out.csv", robot, joints(0.6, 20, 4)))
    (outside,) = [text for text in beyond.notes if "lie outside" in text]
    assert outside.startswith("20 of 20 poses lie outside the joint ranges of the calibration's fit (joint_1 in ")
    assert "degrees" in outside
    # the danger that it names: errors there are several times those inside
    assert beyond.calibrated["rms_mm"] > 1.3 * inside.calibrated["rms_mm"]
    assert beyond.coverage["parts"]["outside"]["n"] == 180


def test_programs_plans_and_predictions_warn(folder, tmp_path, program):
    record = irbcal.load(folder).record
    low, high = np.array(record.certainty.ranges)
    q = np.tile(0.5 * (low + high), (6, 1))
    q[4:, 0] = high[0] + np.radians(12.5)
    pd.DataFrame(np.degrees(q), columns=COLUMNS).to_csv(tmp_path / "job.csv", index=False)
    found = irbcal.correct(folder, tmp_path / "job.csv")
    (caution,) = found.cautions
    assert caution.startswith("2 of 6 targets lie outside")
    assert "(joint_1 in 2 by up to 12.5 degrees)" in caution
    assert caution in found.summary()
    shown = irbcal.forward_kinematics(folder, q, target="smr1", intervals=True)
    assert shown.outside.tolist() == [False] * 4 + [True] * 2
    assert "2 of 6 poses lie outside" in shown.summary()
    assert irbcal.correct(folder, _inside(tmp_path, q[:4])).cautions == ()
    plan = irbcal.plan(folder, axis=18, cube=0, all_range=4, ignore=["collision"])
    assert [note for note in plan.notes if "planned poses lie outside the joint ranges" in note]
    out = program("filter", folder, tmp_path / "job.csv", "--out", tmp_path / "fake.csv")
    assert "2 of 6 targets lie outside" in " ".join(out.split())


def _inside(folder, q):
    pd.DataFrame(np.degrees(q), columns=COLUMNS).to_csv(folder / "inside.csv", index=False)
    return folder / "inside.csv"
