"""All effects together: each says what it is, and can be switched off by itself."""

import numpy as np
import pytest

from irbcal.errors import MeasurementError
from irbcal.simulation import effects


@pytest.mark.parametrize("name", effects.NAMES)
def test_switching_one_effect_off_leaves_the_others_as_they_were(cell, q, name):
    """Effects are small: what one adds is the same with all others on or off, to second order."""
    unseeing = ("visibility", "lost")
    if name in unseeing:
        both, other, alone = (
            np.isnan(cell.only(*names).measure(cell.arm.random_joints(300, seed=2)).xyz[..., 0])
            for names in (unseeing, set(unseeing) - {name}, [name])
        )
        np.testing.assert_array_equal(both, other | alone)
        assert 0 < alone.sum() < both.sum()
        return
    everything = cell.without(*unseeing)
    added = everything.measure(q).xyz - everything.without(name).measure(q).xyz
    alone = cell.only(name).measure(q).xyz - cell.only().measure(q).xyz
    assert np.abs(alone).max() > (1e-10 if name == "settling" else 1e-6)
    assert np.abs(added - alone).max() < 2e-6
    if name == "noise":  # not even to second order: the same random numbers
        assert np.abs(added - alone).max() < 1e-8


def test_unknown_effects_and_targets_are_refused_with_the_names(cell):
    for call in (cell.only, cell.without):
        with pytest.raises(MeasurementError, match=r"unknown effect 'friction': effects are tilt, compliance,.* lost"):
            call("friction")
    with pytest.raises(MeasurementError, match="unknown target 'smr7': targets are smr1, smr2, smr3"):
        cell.with_targets(["smr7"])


def test_every_effect_says_what_it_is():
    assert len(set(effects.NAMES)) == len(effects.EFFECTS)
    for effect in effects.EFFECTS:
        assert effect.summary
        assert "section" in effect.summary or "annex" in effect.summary
        units = ("_deg", "_Nm", "_um", "_m", "_s", "_Hz", "_min", "_h", "_urad", "_mm", "waves", "growth", "share")
        assert all(name.endswith(units) for name in effect().parameters()), effect.name
