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


@pytest.fixture(scope="module")
def swapped(tmp_path_factory):
    """Two robots; the second files of them were swapped."""
    folder, out = tmp_path_factory.mktemp("swapped"), []
    for k, (robot, seed) in enumerate([("A", 4), ("B", 5), ("A", 5), ("B", 4)]):
        measured(folder, f"{k}.csv", seed, 40 + k, poses=40)
        irbcal.calibrate(folder / f"{k}.csv", "irb1600", "34").save(folder / str(k))
        out.append(records.stored(folder / str(k), robot, "SN", f"2026-0{k + 1}-01"))
    return out


def test_the_sister_that_fits_is_named(swapped):
    for before, after, sister in ((0, 2, "B"), (1, 3, "A")):
        found = change(swapped[before], swapped[after], swapped)
        assert found.real
        assert found.sisters == (sister,)
        assert found.in_words()[1:] == [f"The later one agrees with {sister}: were the files of two robots exchanged?"]
    assert change(swapped[0], swapped[3], swapped).sisters == (), "nothing changed"


def test_what_the_poses_do_not_show_explains_no_change(swapped):
    """Joint 6's zero turns with the tool: it had moved by 1e11 degrees."""
    for before, after in ((0, 2), (1, 3)):
        found = change(swapped[before], swapped[after])
        assert found.parameters
        for item in found.parameters:
            assert abs(item.value) < (np.radians(1.0) if item.unit == "rad" else 5e-3)
