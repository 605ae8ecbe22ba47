"""A zero that moved is found with its size; without a change there is none."""

from dataclasses import replace
from datetime import date

import numpy as np
import pytest
from fleet_support import measured

import irbcal
from irbcal.fleet import records
from irbcal.fleet.change import change
from irbcal.fleet.store import Estimate

JUMP = np.radians(0.04)


@pytest.fixture(scope="module")
def three(tmp_path_factory):
    """The same robot twice as it was, and once with joint 3's zero moved; other poses each time."""
    folder, out = tmp_path_factory.mktemp("change"), []
    for k, moved in enumerate((0.0, 0.0, JUMP)):
        measured(folder, f"{k}.csv", 4, 40 + k, poses=50, moved=moved)
        irbcal.calibrate(folder / f"{k}.csv", "irb1600", "34").save(folder / str(k))
        out.append(records.stored(folder / str(k), "R", "SN", f"2026-0{k + 1}-01"))
    return out


def test_nothing_changed(three):
    found = change(three[0], three[1])
    assert not found.real
    assert found.parameters == ()
    assert found.directions > 15
    assert 0.2 < found.chi2 / found.directions < 2.0
    assert "no change beyond the uncertainty" in found.in_words()[0]


def test_a_zero_that_moved_is_named_with_its_size(three):
    found = change(three[1], three[2])
    assert found.real
    first = found.parameters[0]
    assert first.name == "delta_theta3"
    assert first.value == pytest.approx(JUMP, abs=4 * first.std)
    assert first.std < 0.005 * np.pi / 180
    assert "Joint 3's zero moved by 0.0" in found.in_words()[1]
    assert "between 2026-02-01 and 2026-03-01: a crash, an exchanged motor or a lost zero?" in found.in_words()[1]


def estimate(values, C):
    k = len(values)
    names = tuple(f"delta_d{j}" for j in range(1, k + 1))
    return Estimate(names, ("m",) * k, np.array(values), np.full(k, np.inf), np.ones(k), np.asarray(C, dtype=float))


def test_chi_square_by_hand(three):
    """Two parameters with variances 1 and 4: 3^2 / (1 + 1) + 4^2 / (4 + 4)."""
    one = replace(three[0], level=estimate([0.0, 0.0], np.diag([1.0, 4.0])))
    two = replace(three[1], level=estimate([3.0, 4.0], np.diag([1.0, 4.0])))
    assert change(one, two).chi2 == pytest.approx(6.5)


def test_what_one_of_them_holds_has_no_say(three):
    one = replace(three[0], level=estimate([0.0, 0.0], np.diag([1.0, 0.0])))
    two = replace(three[1], level=estimate([0.0, 100.0], np.diag([1.0, 1.0])))
    found = change(one, two)
    assert (found.directions, found.chi2) == (1, 0.0)


def test_without_points_there_is_nothing_to_compare(three):
    found = change(replace(three[0], level=None), three[1])
    assert found.in_words() == [
        f"{date(2026, 1, 1)} to {date(2026, 2, 1)}: cannot be compared (no points saved, or nothing seen in common)."
    ]
