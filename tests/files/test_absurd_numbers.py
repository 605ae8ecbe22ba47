"""Numbers in a calibration that no robot has are refused when it is read."""

import json

import pytest

import irbcal
from irbcal.errors import CalibrationError


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("robot", "dhm_calibrated", 1, "a_mm"), 60_000.0),
        (("robot", "dhm_nominal", 1, "alpha_deg"), 1e308),
        (("robot", "dhm_nominal", 1, "theta_deg"), 2e4),
        (("robot", "base_to_frame0", 0, 3), 1e308),
        (("robot", "upper", 2), 1e308),
        (("joint_origins", 0, "calibrated", "xyz_m", 0), 51.0),
        (("joint_map", "terms", 0, "coefficient_rad"), 1e308),
        (("placement", "base", "x_mm"), 1e308),
        (("placement", "targets", "smr1", 0), 1e308),
        (("certainty", "leave_one_out_mm", ""), 1e308),
        (("points", "x_mm", 0), 1e308),
        (("heldout", "all", "mean_mm"), 1e308),
    ],
)
def test_absurd_numbers_are_refused_with_their_place(folder, tmp_path, place, value):
    content = json.loads((folder / "calibration.json").read_text())
    inner = content
    for name in place[:-1]:
        inner = inner[name]
    inner[place[-1]] = value
    (tmp_path / "calibration.json").write_text(json.dumps(content))
    (tmp_path / "calibrated.urdf").write_bytes((folder / "calibrated.urdf").read_bytes())
    where = ".".join(map(str, place))
    with pytest.raises(CalibrationError, match=rf"calibration\.json: {where}: expected a number within") as refused:
        irbcal.load(tmp_path)
    assert refused.value.parameter == where
    assert len(str(refused.value).splitlines()) == 1


def test_what_the_program_writes_is_read(folder):
    assert irbcal.load(folder).model == "34"
