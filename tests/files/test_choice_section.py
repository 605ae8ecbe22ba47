"""How the error model was chosen, as it is saved."""

import numpy as np
import pytest
from support import arm, measured, random_robot

from irbcal.files.choice_section import EvidenceChoice, EvidenceSection
from irbcal.identification.averaged import identify_averaged
from irbcal.modeling.terms.situation import Motion


def test_an_average_is_saved_with_its_comparison():
    model, rng = arm("irb120"), np.random.default_rng(1)
    points = measured(random_robot(model, "34", rng), model.random_joints(40, 1), 2e-5, rng)
    fit = identify_averaged(model, points, Motion.in_order(points.q))
    choice = EvidenceChoice.of(fit)
    assert EvidenceChoice.model_validate_json(choice.model_dump_json()) == choice
    assert sum(row.weight for row in choice.table) == pytest.approx(1.0, abs=1e-12)
    assert choice.explanation == fit.explanation()
    for row, own in zip(choice.table, fit.evidence.dictionaries, strict=True):
        assert (row.sigma_mm is None) == (own.sigma is None) == (row.weight == 0.0)
    section = EvidenceSection.of(fit.evidence)
    assert EvidenceSection.model_validate_json(section.model_dump_json()) == section
    assert section.leave_one_out_mm[""] == pytest.approx(1e3 * fit.evidence.loo[""], rel=1e-12)
    assert [group.name for group in section.groups] == [group.name for group in fit.evidence.groups]
