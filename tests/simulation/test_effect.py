"""What an effect may do: nothing unless it says so, and values of six joints for any arm."""

import numpy as np
import pytest

from irbcal.simulation.effect import Effect, fitted
from irbcal.simulation.history_effects import Backlash


def test_an_effect_changes_nothing_unless_it_says_so(cell):
    T, xyz = np.eye(4)[None], np.zeros((1, 2, 3))
    plain = Effect()
    assert plain.table(cell.table) is cell.table
    assert plain.joints(None, None) is None
    assert plain.unseen(None, None) is None
    assert plain.tips(T, None) is T
    assert plain.points(xyz, None, None) is xyz
    assert plain.parameters() == {}


@pytest.mark.parametrize(
    ("prismatic", "expected"),
    [
        ([0] * 6, (1, 2, 3, 4, 5, 6)),
        ([0] * 7, (1, 2, 3, 3, 4, 5, 6)),
        ([1, 0, 0, 0, 0, 0, 0], (9, 1, 2, 3, 4, 5, 6)),
        ([0, 0], (5, 6)),
        ([1, 1, 1], (9, 9, 9)),
    ],
)
def test_values_of_six_joints_fit_any_arm(prismatic, expected):
    """The first ones from the base, the last three from the wrist."""
    assert fitted((1, 2, 3, 4, 5, 6), np.array(prismatic, dtype=bool), 9) == expected


def test_parameters_carry_their_units_in_their_names():
    assert list(Backlash().parameters()) == ["peak_to_peak_deg"]
