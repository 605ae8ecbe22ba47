from types import SimpleNamespace

import pytest

from irbcal.errors import OptionError
from irbcal.planning import device_plan
from irbcal.planning.device_plan import compare_devices
from irbcal.simulation.devices import DEVICES


@pytest.fixture(scope="module")
def found():
    return compare_devices("irb1600", (36,), noise=0.05e-3)


def test_devices_stand_in_the_order_of_an_independent_calculation(found):
    """Its order at 100 poses: tracker, four balls, strings, ballbar, two balls, sockets, one ball, planes."""
    left = {row.device: row.left for row in found.rows}
    assert left["tracker"] < left["balls"] < left["two-balls"] < left["sockets"] < left["ball"]
    assert left["sockets"] < left["plane"]
    assert all(value < found.before for value in left.values())
    assert all(row.left < row.left_with_joints < found.before_with_joints for row in found.rows)
    assert "Calculated, not measured" in str(found.summary())
    frame = found.to_frame()
    assert list(frame["left_with_joints_mm"]) == sorted(frame["left_with_joints_mm"])
    assert frame["device"].iloc[0] == "tracker"


def test_the_best_is_first_by_the_largest_number_of_poses_however_they_are_given(monkeypatch):
    left = {name: float(k) for k, name in enumerate(DEVICES)}
    signs = {50: 1.0, 20: -1.0}  # what is best of many is worst of few
    monkeypatch.setattr(device_plan, "DeviceModel", lambda *_: SimpleNamespace(before=1.0))
    monkeypatch.setattr(
        device_plan, "_left", lambda model, name, count, noise: (signs[count] * left.get(name, 99.0),) * 2
    )
    found = compare_devices("irb1600", (50, 20, 50))
    assert list(dict.fromkeys(row.device for row in found.rows)) == [*DEVICES, "tracker"]
    assert len(found.rows) == 2 * (len(DEVICES) + 1)


def test_numbers_of_poses_are_checked():
    with pytest.raises(OptionError, match="poses"):
        compare_devices("irb1600", (2,))
    with pytest.raises(OptionError, match="prior"):
        compare_devices("irb1600", (20,), prior=-1.0)
