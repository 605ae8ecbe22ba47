import numpy as np
import pandas as pd
import pytest

from irbcal.errors import OptionError
from irbcal.identification.devices import BALL
from irbcal.planning.device_plan import device_plan


def test_poses_are_free_of_collisions_and_at_the_sockets(tmp_path):
    made = device_plan("irb1600", "sockets", 8)
    assert "collision" in made.conditions
    T = made.arm.forward(made.q)
    p = T[:, :3, 3] + T[:, :3, :3] @ np.array(BALL)
    centre = np.array([own["centre"] for own in made.found.own.values()])[made.which]
    np.testing.assert_allclose(p, centre, atol=1e-8)
    rows, known = made.save(tmp_path)
    assert list(pd.read_csv(rows)["feature"].value_counts()) == [4, 4]
    assert pd.read_csv(known)["length_mm"].dropna().tolist() == [50.0]
    assert "socket 1 near" in str(made.summary())
    with pytest.raises(OptionError, match="device"):
        device_plan("irb1600", "rope")
