"""The end-effector: the printed distances of Table 3.1."""

import numpy as np

from irbcal.simulation.tool import TABLE_3_1


def test_targets_are_those_of_table_3_1():
    """The table's last column is the distance of real and CAD places."""
    printed = [0.553, 0.465, 0.515, 0.568, 0.690, 0.609, 0.612, 0.661, 0.497]
    found = [np.linalg.norm(np.subtract(*pair)) for pair in TABLE_3_1.values()]
    np.testing.assert_allclose(found, printed, atol=0.002)
