"""What each family explains and what the gear scan saw, as it is saved."""

import numpy as np
import pytest
from pydantic import ValidationError

from irbcal.files.explained_section import ExplainedStage, FamilyRow, GearSpectrum
from irbcal.identification.explained import Stage
from irbcal.identification.gear_scan import Spectrum
from irbcal.identification.shown import FamilyShown


def test_a_spectrum_is_thinned_but_keeps_its_peaks():
    chi2 = np.random.default_rng(1).gamma(1.0, 2.0, (6, 416))
    chi2[3, 237] = 99.96
    saved = GearSpectrum.of(Spectrum(tuple(range(6)), np.arange(5, 421), chi2, 19.649))
    assert saved == GearSpectrum.model_validate_json(saved.model_dump_json())
    assert (saved.joints, saved.first, saved.limit) == ([1, 2, 3, 4, 5, 6], 5, 19.649)
    found = np.array(saved.chi2)
    assert found.shape == (6, -(-416 // saved.step))
    assert found[3, 237 // saved.step] == 100.0
    assert found.max(axis=1) == pytest.approx(chi2.max(axis=1), abs=0.051)
    assert len(saved.model_dump_json()) < 6000
    assert GearSpectrum.of(None) is None
    with pytest.raises(ValidationError, match="a row of one length for each joint"):
        GearSpectrum(**saved.model_dump() | {"joints": [1, 2]})


def test_stages_and_families_are_saved_in_millimetres():
    stage = ExplainedStage.of(Stage("gravity", 30, 12.5, True, 1e-4, 2e-4, 3e-4, None))
    assert (stage.leave_one_out_mm, stage.mean_mm, stage.max_mm, stage.timed_mean_mm) == (0.1, 0.2, 0.3, None)
    assert stage == ExplainedStage.model_validate_json(stage.model_dump_json())
    (row,) = FamilyRow.of([FamilyShown("gravity", 12.5, 99.0, 2e-4)])
    assert row.model_dump() == {"family": "gravity", "seen": 12.5, "evidence": 99.0, "moves_mm": 0.2, "shown": True}
