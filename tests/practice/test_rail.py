"""The arm on a rail."""

import pandas as pd

import irbcal


def test_it_has_a_rail_and_six_joints(written):
    arm = irbcal.read_urdf(written.folder / "cell.urdf", "rail_base", "tool0").arm
    assert arm.table.prismatic.tolist() == [True] + [False] * 6
    table = pd.read_csv(written.folder / "rail.csv")
    assert table["q1_mm"].between(0, 2000).all()
    assert table["q1_mm"].nunique() > 50
