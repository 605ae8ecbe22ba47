"""The file of a prior comes back as it was, and nothing else is taken for one."""

import json

import numpy as np
import pytest

from irbcal.errors import CalibrationError, OptionError
from irbcal.identification.term_sets import TypePrior
from irbcal.io import prior_file

PRIOR = TypePrior(
    "irb1600_6_145",
    "ab" * 32,
    ("R1", "R2"),
    True,
    ("delta_theta2", "rz2 cos 1"),
    ("rad", "rad"),
    np.array([1e-4, -2e-5]),
    np.array([2e-4, 1e-5]),
    np.array([1e-3, 2e-4]),
)


def test_it_comes_back(tmp_path):
    file = tmp_path / "prior.json"
    file.write_bytes(prior_file.content(PRIOR))
    back = prior_file.of_robot(file, PRIOR.type, PRIOR.nominal_sha256, simulated=True)
    for name in ("mean", "std", "natural"):
        np.testing.assert_array_equal(getattr(back, name), getattr(PRIOR, name))
    assert (back.names, back.units, back.robots, back.simulated) == (
        PRIOR.names,
        PRIOR.units,
        PRIOR.robots,
        PRIOR.simulated,
    )
    assert prior_file.of_robot(None, "x", "y", simulated=True) is None


@pytest.mark.parametrize(
    "change", [{"version": 2}, {"terms": [{}]}, {"irbcal": "robot of a fleet"}, {"terms": 3}, None, 0.0, 1e300]
)
def test_another_content_is_refused(tmp_path, change):
    document = json.loads(prior_file.content(PRIOR))
    if isinstance(change, float):
        document["terms"][0]["std"] = change
    elif change is not None:
        document |= change
    file = tmp_path / "prior.json"
    file.write_text("[]" if change is None else json.dumps(document))
    with pytest.raises(CalibrationError, match="expected a prior of a type as irbcal fleet prior writes it"):
        prior_file.read(file)


@pytest.mark.parametrize(
    ("robot", "sentence"),
    [
        (("irb120", "", True), "prior: it is of robot irb1600_6_145, not of the nominal robot irb120 that is given"),
        ((PRIOR.type, "cd" * 32, True), "prior: it is of another file of that robot"),
        ((PRIOR.type, PRIOR.nominal_sha256, False), "prior: it is from SIMULATED robots"),
    ],
)
def test_it_is_for_its_own_type_only(robot, sentence):
    with pytest.raises(OptionError, match=sentence):
        prior_file.of_robot(PRIOR, *robot)
