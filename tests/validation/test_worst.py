"""The worst poses are those of a plain sort."""

import numpy as np
import pytest

import irbcal
from irbcal.io import robots
from irbcal.plotting.pose_errors import worst_poses


def test_worst_poses_are_those_of_the_table_of_points(record):
    found = irbcal.evaluate(record, robots.demo_file("demo_verification.csv"))
    worst = worst_poses(found.errors, found.origin.joints)
    table = found.to_frame()
    expected = table.groupby("pose")["calibrated_mm"].max().sort_values(ascending=False).head(10)
    assert [row.pose for row in worst] == list(expected.index)
    assert [row.error_mm for row in worst] == pytest.approx(list(expected), abs=1e-12)
    for row in worst:
        assert np.linalg.norm(row.vector_mm) == pytest.approx(row.error_mm, abs=1e-9)
        point = table[(table["pose"] == row.pose) & (table["target"] == row.target)].iloc[0]
        assert point["nominal_mm"] == pytest.approx(row.nominal_mm, abs=1e-12)
        assert len(row.joints) == 6
    assert worst_poses(found.errors, None, 3)[2].joints == ()
