"""What a report computes from a calibration's poses."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from report_cases import assert_harmless, with_points, without_heldout
from support import arm, measured, random_robot, write_measurements

import irbcal
from irbcal.io.schema import CertaintySection
from irbcal.modeling.workspace_coverage import WorkspaceCoverage
from irbcal.reports import report_page
from irbcal.reports.report_facts import limits


def test_perfect_predictions_can_be_drawn(calibration):
    changed = with_points(calibration, 5, 2)
    zeros = dict.fromkeys(("nominal_mm", "calibrated_mm"), [0.0] * 20)
    assert_harmless(report_page.render(changed.model_copy(update={"points": changed.points.model_copy(update=zeros)})))


def test_the_file_holds_the_points_as_measured(folder, calibration, tmp_path):
    """Places, joints and directions, against the measurement file read by pandas."""
    nominal = arm()
    rng = np.random.default_rng(4)
    q = np.round(nominal.random_joints(40, 5), 3)
    q[7] = q[6]
    q[12, 2] = q[11, 2]
    path = write_measurements(tmp_path / "m.csv", measured(random_robot(nominal, "26", rng), q, 3e-5, rng))
    out = tmp_path / "out"
    irbcal.save(irbcal.calibrate(path, "irb1600", "26", holdout=0.5), out)
    saved = irbcal.load(out).record
    rows = pd.read_csv(path).assign(order=lambda t: t["pose"].rank(method="dense").astype(int) - 1)
    joints = rows.groupby("order")[[f"q{k}_deg" for k in range(1, 7)]].first().to_numpy()
    sign = np.sign(np.diff(joints, axis=0, prepend=joints[:1]))
    for k in range(1, len(sign)):
        sign[k] = np.where(sign[k] == 0, sign[k - 1], sign[k])
    seen = 0
    for heldout in (False, True):
        points, came_from = saved.used_points(heldout)
        order = points.pose_ids.astype(int)
        assert np.abs(np.degrees(points.q) - joints[order]).max() < 1e-8
        assert np.array_equal(came_from, sign[order])
        known = rows.set_index(["pose", "target"])[["x_mm", "y_mm", "z_mm"]]
        expected = known.loc[list(zip(order[points.pose], points.names(), strict=True))].to_numpy()
        assert np.abs(1e3 * points.xyz - expected).max() < 1e-6
        robot = saved.robot_calibrated()
        predicted = np.array(
            [robot.points(j[None], n)[0] for j, n in zip(points.joints(), points.names(), strict=True)]
        )
        mine = [k for k, value in enumerate(saved.points.heldout) if value == heldout]
        distance = np.array(saved.points.calibrated_mm)[mine]
        assert np.abs(1e3 * np.linalg.norm(points.xyz - predicted, axis=1) - distance).max() < 1e-5
        seen += len(points)
    assert seen == len(rows)


def test_measured_orientations_and_uncertainties_come_back(calibration):
    """Quaternions written by hand; points without one stay without."""
    n = len(calibration.points.pose)
    turned = {"qw": 0.5, "qx": 0.5, "qy": 0.5, "qz": 0.5}  # maps x to y, y to z, z to x
    columns = {name: [value, None] * (n // 2) + [None] * (n % 2) for name, value in turned.items()}
    columns["u95_mm"] = [None, 0.05] * (n // 2) + [None] * (n % 2)
    changed = calibration.model_copy(update={"points": calibration.points.model_copy(update=columns)})
    points, _ = changed.used_points(False)
    assert np.abs(points.rotation[0] - [[0, 0, 1], [1, 0, 0], [0, 1, 0]]).max() < 1e-12
    assert points.oriented().tolist() == [k % 2 == 0 for k in range(len(points))]
    assert points.u95[1] == pytest.approx(5e-5)
    assert np.isnan(points.u95[0])


def test_many_poses_are_told_by_some_and_the_worst(calibration, monkeypatch):
    monkeypatch.setattr("irbcal.reports.report_facts.MOST_POSES", 12)
    monkeypatch.setattr("irbcal.reports.report_facts.WORST", 1)
    found = report_page.gather(calibration)
    fitted = found.sets[-1]
    assert fitted.set_size == calibration.poses_fit
    assert len(fitted.pose_names) in (12, 13)
    mine = [d for d, held in zip(calibration.points.calibrated_mm, calibration.points.heldout, strict=True) if not held]
    assert fitted.models["calibrated"].distance.max() == pytest.approx(1e-3 * max(mine), abs=1e-12)
    assert f"Statistics are of all {calibration.poses_fit} fitted poses" in report_page.render(calibration, found)


def first(record, evidence=None):
    return limits(record, evidence or report_page.gather(record))[0]


def test_doubts_come_before_all(calibration):
    found = first(calibration.model_copy(update={"doubts": ["The tracker was moved."]}))
    assert "speaks against" in found.sentence
    assert "calibrate again" in found.next


def test_nothing_held_out(calibration):
    assert "No pose was held out" in first(without_heldout(calibration)).sentence


def test_a_corner(calibration):
    corner = WorkspaceCoverage(shares=[0.9, 0.2, 0.9, 0.3, 0.3, 0.9], here_mm=0.1, there_mm=0.6, difference_mm=1.0)
    known = CertaintySection(
        leave_one_out_mm={}, leave_fifths_out_mm={}, ranges=[[0.0] * 6, [1.0] * 6], workspace_coverage=corner
    )
    found = first(calibration.model_copy(update={"certainty": known, "doubts": []}))
    assert "joint 2 went through 20% of its limits" in found.sentence
    assert "irbcal plan" in found.next


def test_few_poses_by_the_share_of_the_mean_square(calibration, evidence):
    rms = float(np.sqrt(np.mean(evidence.sets[0].models["calibrated"].distance ** 2)) * 1e3)
    fit = calibration.fit.model_copy(update={"all": calibration.fit.all.model_copy(update={"rms_mm": rms / 2})})
    few = [x for x in limits(calibration.model_copy(update={"fit": fit}), evidence) if "Few poses" in x.sentence]
    assert few[0].share == pytest.approx(0.75, abs=1e-9)
    assert f"{rms / 2:.3f} mm" in few[0].sentence


def test_a_level_that_is_too_small(calibration, evidence):
    fit = calibration.fit.model_copy(update={"all": calibration.fit.all.model_copy(update={"rms_mm": 0.3})})
    found = limits(calibration.model_copy(update={"fit": fit}), evidence)
    assert any("level 34 leaves 0.300 mm" in limit.sentence and "--model auto" in limit.next for limit in found)
    assert not any("level 34 leaves" in limit.sentence for limit in limits(calibration, evidence))


def test_a_few_poses_hold_most(calibration, evidence):
    poses = evidence.sets[-1]  # fitted: more than 20
    errors = np.full(len(poses.pose_names), 1e-5)
    errors[3] = 5e-4
    models = {name: replace(model, per_pose=errors) for name, model in poses.models.items()}
    found = limits(calibration, replace(evidence, sets=(replace(poses, models=models),)))
    assert any("A few poses: 2 of 42 hold" in limit.sentence for limit in found)


def test_the_page_tells_it_beside_the_verdict(calibration, evidence, page):
    assert "What limits it now" in page
    found = limits(calibration, evidence)
    if found:
        assert found[0].next[:30] in page
    else:
        assert "Nothing stands out" in page
