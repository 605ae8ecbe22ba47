"""Columns of orientations: unit quaternions or nothing."""

import numpy as np
import pandas as pd
import pytest

from irbcal.errors import MeasurementError
from irbcal.measurement import columns, quaternion_columns


def test_quaternions_are_made_exactly_unit_or_refused():
    table = pd.DataFrame({"row": [2, 3], "qw": [1.0005, np.nan], "qx": 0.0, "qy": 0.0, "qz": 0.0})
    table.loc[1, columns.QUATERNION] = np.nan
    quaternion_columns.check(table, "s")
    assert table["qw"][0] == 1.0
    R = quaternion_columns.rotations(table)
    assert np.array_equal(R[0], np.eye(3))
    assert np.isnan(R[1]).all()
    table.loc[1, "qw"] = 1.01
    table.loc[1, ["qx", "qy", "qz"]] = 0.0
    with pytest.raises(MeasurementError) as caught:
        quaternion_columns.check(table, "s")
    assert (caught.value.row, caught.value.column) == (3, "qw, qx, qy, qz")
    assert quaternion_columns.rotations(table[["row"]]) is None
