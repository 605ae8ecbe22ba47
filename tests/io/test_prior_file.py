"""The file of a prior comes back as it was, and nothing else is taken for one."""

import json

import pytest

from irbcal.errors import CalibrationError, OptionError
from irbcal.identification.type_prior import TypePrior, TypeTerm
from irbcal.io import prior_file

PRIOR = TypePrior(
    type="irb1600_6_145",
    nominal_urdf_sha256="ab" * 32,
    simulated=True,
    robots=("R1", "R2"),
    terms=(
        TypeTerm(name="delta_theta2", unit="rad", mean=1e-4, std=2e-4, natural=1e-3),
        TypeTerm(name="rz2 cos 1", unit="rad", mean=-2e-5, std=1e-5, natural=2e-4),
    ),
)


def test_it_comes_back(tmp_path):
    file = tmp_path / "prior.json"
    file.write_bytes(prior_file.content(PRIOR))
    assert prior_file.of_robot(file, PRIOR.type, PRIOR.nominal_urdf_sha256, simulated=True) == PRIOR
    assert prior_file.of_robot(None, "x", "y", simulated=True) is None


@pytest.mark.parametrize(
    "change",
    [
        *({"version": 2}, {"terms": [{}]}, {"irbcal": "robot of a fleet"}, {"terms": 3}, {"more": 1}),
        *({"type": "a\x1b[2J"}, None, 0.0, 1e300),
    ],
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
        ((PRIOR.type, PRIOR.nominal_urdf_sha256, False), "prior: it is from SIMULATED robots"),
    ],
)
def test_it_is_for_its_own_type_only(robot, sentence):
    with pytest.raises(OptionError, match=sentence):
        prior_file.of_robot(PRIOR, *robot)
