"""What the store takes of a calibration: its own figures, and a level fitted to its points."""

import numpy as np
import pytest

import irbcal
from irbcal.errors import CalibrationError
from irbcal.fleet import records
from irbcal.identification.fit import identify


def test_a_calibration_is_taken_as_it_is(calibrated, stored):
    record, one = irbcal.load(calibrated.out / "R1").record, stored[1]
    assert one.robot == {"id": "R1", "serial": "SN-1", "type": "irb1600_6_145"}
    assert str(one.measured) == "2026-03-02"
    assert one.calibration["heldout_mean_mm"] == record.heldout.all.mean_mm
    assert one.calibration["simulated"]
    listed = {row.name: row for row in record.parameters}
    for name, value, unit in zip(one.fit.names, one.fit.values, one.fit.units, strict=True):
        assert value == pytest.approx(listed[name].value * {"rad": np.pi / 180, "m": 1e-3}[unit])
    assert one.files == tuple((item.file, item.sha256) for item in record.data)
    assert "base_x" in {row["name"] for row in one.other}


def test_the_level_is_fitted_to_the_saved_points(calibrated, stored):
    record = irbcal.load(calibrated.out / "R0").record
    points, _ = record.used_points(False)
    fit = identify(record.arm(calibrated=False), points, "34")
    level = stored[0].level
    by_name = {row.name: row for row in fit.parameters()}
    for name in ("delta_theta3", "delta_a2"):
        unit = np.pi / 180 if "theta" in name else 1e-3
        k = level.place[name]
        assert level.values[k] == pytest.approx(by_name[name].value * unit, rel=1e-6)
        # the three points of a pose count once
        assert level.covariance[k, k] ** 0.5 == pytest.approx(by_name[name].std * unit * 3**0.5, rel=0.02)


def test_id_serial_and_date_can_be_told(calibrated):
    one = records.stored(calibrated.out / "R0", "other", "SN", "2025-12-24")
    assert one.robot["id"] == "other"
    assert str(one.measured) == "2025-12-24"
    with pytest.raises(CalibrationError, match="expected a date such as 2026-03-17, found 'Christmas'"):
        records.stored(calibrated.out / "R0", measured="Christmas")
