"""What limits a calibration: each kind by a calibration in which it is the largest."""

from dataclasses import replace

import numpy as np
import pytest
from report_cases import without_heldout

from irbcal.io.schema import CertaintySection
from irbcal.modeling.elsewhere import Elsewhere
from irbcal.reports import report_page
from irbcal.reports.evidence import limits


def first(record, evidence=None):
    return limits(record, evidence or report_page.gather(record))[0]


def test_doubts_come_before_all(calibration):
    found = first(calibration.model_copy(update={"doubts": ["The tracker was moved."]}))
    assert "speaks against" in found.words
    assert "calibrate again" in found.next


def test_nothing_held_out(calibration):
    assert "No pose was held out" in first(without_heldout(calibration)).words


def test_a_corner(calibration):
    corner = Elsewhere(shares=[0.9, 0.2, 0.9, 0.3, 0.3, 0.9], here_mm=0.1, there_mm=0.6, difference_mm=1.0)
    known = CertaintySection(
        leave_one_out_mm={}, leave_fifths_out_mm={}, ranges=[[0.0] * 6, [1.0] * 6], elsewhere=corner
    )
    found = first(calibration.model_copy(update={"certainty": known, "doubts": []}))
    assert "joint 2 went through 20% of its limits" in found.words
    assert "irbcal plan" in found.next


def test_few_poses_by_the_share_of_the_mean_square(calibration, evidence):
    rms = float(np.sqrt(np.mean(evidence.sets[0].models["calibrated"].distance ** 2)) * 1e3)
    fit = calibration.fit.model_copy(update={"all": calibration.fit.all.model_copy(update={"rms_mm": rms / 2})})
    few = [x for x in limits(calibration.model_copy(update={"fit": fit}), evidence) if "Few poses" in x.words]
    assert few[0].share == pytest.approx(0.75, abs=1e-9)
    assert f"{rms / 2:.3f} mm" in few[0].words


def test_a_level_that_is_too_small(calibration, evidence):
    fit = calibration.fit.model_copy(update={"all": calibration.fit.all.model_copy(update={"rms_mm": 0.3})})
    found = limits(calibration.model_copy(update={"fit": fit}), evidence)
    assert any("level 34 leaves 0.300 mm" in limit.words and "--model auto" in limit.next for limit in found)
    assert not any("level 34 leaves" in limit.words for limit in limits(calibration, evidence))


def test_a_few_poses_hold_most(calibration, evidence):
    poses = evidence.sets[-1]  # fitted: more than 20
    errors = np.full(len(poses.pose_names), 1e-5)
    errors[3] = 5e-4
    models = {name: replace(model, per_pose=errors) for name, model in poses.models.items()}
    found = limits(calibration, replace(evidence, sets=(replace(poses, models=models),)))
    assert any("A few poses: 2 of 42 hold" in limit.words for limit in found)


def test_the_page_tells_it_beside_the_verdict(calibration, evidence, page):
    assert "What limits it now" in page
    found = limits(calibration, evidence)
    if found:
        assert found[0].next[:30] in page
    else:
        assert "Nothing stands out" in page
