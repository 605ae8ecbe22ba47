import feature_cases as cases
import numpy as np
import pandas as pd
import pytest

from irbcal.errors import IdentificationError, MeasurementError, OptionError
from irbcal.identification.feature_fit import identify_features, identify_without_outliers
from irbcal.io.urdf import read_urdf
from irbcal.measurement import features
from irbcal.validation.feature_proof import labels, prove

SOCKETS = pd.DataFrame(
    [
        {"feature": "{place}/{socket}", "kind": "point"},
        {
            "feature": "{place} 50 mm",
            "kind": "distance",
            "first": "{place}/0",
            "second": "{place}/1",
            "length_mm": "50",
        },
    ]
).fillna("")


@pytest.mark.parametrize(
    ("number", "contradicting", "mean", "rms", "length"),
    [(2, [63, 242, 243, 265], 0.245, 0.27, 0.16), (4, [], 0.2, 0.23, 0.03)],
    ids=["panda_2", "panda_4"],
)
def test_real_contacts_agree_at_places_that_were_left_out(number, contradicting, mean, rms, length, shared_data):
    """Better than an independent calculation reached: 0.282/0.322 and 0.229/0.256 mm (docs/without-a-tracker.md)."""
    folder = shared_data / "panda_two_sockets"
    arm = read_urdf(folder / "panda.urdf", None, "panda_hand_tcp", None).arm
    seen = features.read(folder / f"panda_{number}.csv", SOCKETS, arm)
    fit, left_out, doubt = identify_without_outliers(arm, seen)
    assert (sorted(left_out), doubt) == (contradicting, "")
    seen = fit.problem.rows
    proof = prove(arm, seen, "place")
    nominal, found = proof.missed * 1e3
    assert found.mean() <= mean
    assert np.sqrt(np.mean(found**2)) <= rms
    errors = np.abs(np.array(list(proof.relations.values()))) * 1e3
    assert errors[:, 1].mean() <= length
    assert nominal.mean() > 3.0  # the nominal robot
    assert errors[:, 0].mean() > 0.4


def test_whole_features_are_left_out_never_rows():
    seen = cases.seen("point", cases.arm(), 6)
    with pytest.raises(OptionError, match="rows at one feature prove nothing"):
        labels(seen, "pose")
    cells = seen.cells.assign(half=["a", "b"] * 9)
    object.__setattr__(seen, "cells", cells)
    with pytest.raises(MeasurementError, match="feature point 0 is at a and at b"):
        labels(seen, "half")
    with pytest.raises(MeasurementError, match="no column site"):
        labels(seen, "site")
    by, label = labels(seen, None)
    assert by == "features"
    assert len(set(label)) == 3


def test_one_place_proves_nothing():
    truth = cases.true_arm(cases.arm(), 7)
    seen = cases.seen("point", truth, 30)
    one = seen.select(seen.feature == "point 0")
    assert prove(cases.arm(), one) is None
    assert prove(cases.arm(), seen, "none") is None
    two = seen.select((seen.feature == "point 0") | (np.arange(len(seen)) == 31))
    with pytest.raises(IdentificationError, match="without features point 0 the rest does not do"):
        prove(cases.arm(), two)
    assert identify_features(cases.arm(), one).average.poses == 30
