import numpy as np
import pandas as pd
import pytest

from irbcal.errors import OptionError
from irbcal.planning.device_plan import DeviceModel, device_plan
from irbcal.simulation.devices import BALL


@pytest.fixture(scope="module")
def made():
    return device_plan("irb1600", "sockets", 24, candidates=150)


def test_poses_are_free_of_collisions_and_at_the_sockets(made, tmp_path):
    assert "collision" in made.conditions
    T = made.arm.forward(made.q)
    p = T[:, :3, 3] + T[:, :3, :3] @ np.array(BALL)
    centre = np.array([own["centre"] for own in made.found.own.values()])[made.which]
    np.testing.assert_allclose(p, centre, atol=1e-8)
    assert (T[:, 2, 2] <= -0.5 + 1e-9).all()  # from above, within 60 degrees
    rows, known, before = made.save(tmp_path)
    assert (pd.read_csv(rows)["feature"].value_counts() >= 6).all()
    assert len(pd.read_csv(before)) == 24
    assert pd.read_csv(known)["length_mm"].dropna().tolist() == [50.0]
    assert "socket 1 near" in str(made.summary())
    with pytest.raises(OptionError, match="device"):
        device_plan("irb1600", "rope")


def test_chosen_poses_leave_less_than_random_ones(made):
    """The prediction is that of the poses themselves, told anew from the plan's joints."""
    model = DeviceModel(made.arm, wide=True)
    again = model.at(made.found, made.q, made.which, made.found.device.noise).left()
    assert made.left == pytest.approx(again, rel=1e-6)
    assert made.left < 0.97 * made.left_by_random < made.before
    assert made.comparison.as_good_as is None or made.comparison.as_good_as > 30


def test_planes_ballbars_and_boards_have_poses_for_each_feature():
    for name in ("plane", "ballbar", "camera"):
        found = device_plan("irb1600", name, 18, candidates=60)
        assert np.bincount(found.which).tolist() == [6, 6, 6]
        assert (found.approach is None) == (name != "plane")
    assert "the line to the board free of the arm" in found.conditions
    assert found.to_frame()["image"].tolist()[:2] == ["1.png", "2.png"]
