"""What changed, and which robots stand out."""

from dataclasses import replace
from datetime import date

import numpy as np
import pytest
from fleet_support import measured

import irbcal
from irbcal.fleet import adding, comparison, queries
from irbcal.fleet.comparison import OthersOfType
from irbcal.fleet.store import Estimate, opened


def test_parameters_have_names_that_people_know():
    assert comparison.called("delta_theta3") == ("joint 3's zero", "a crash, an exchanged motor or a lost zero")
    assert comparison.called("delta_alpha2")[0] == "the tilt between joints 2 and 3"
    assert comparison.called("rz3 direction 0.00872665")[0] == "the backlash of joint 3 (rz3 direction 0.00872665)"
    assert comparison.called("something") == ("something", "wear, a crash or a repair")


def test_amounts_have_the_digits_of_their_uncertainty():
    assert comparison.amount(-0.000366519, 0.0000698, "rad") == "0.0210 ± 0.0040 degrees"
    assert comparison.amount(1.23e-4, 1.1e-5, "m") == "0.123 ± 0.011 mm"


def test_high_waves_are_told_from_low_ones():
    assert comparison.high_wave("rz4 cos 242 gear")
    assert not comparison.high_wave("rz4 cos 2")
    assert not comparison.high_wave("delta_theta7")


JUMP = np.radians(0.04)


@pytest.fixture(scope="module")
def three(tmp_path_factory):
    """The same robot twice as it was, and once with joint 3's zero moved; other poses each time."""
    folder, out = tmp_path_factory.mktemp("change"), []
    for k, moved in enumerate((0.0, 0.0, JUMP)):
        measured(folder, f"{k}.csv", 4, 40 + k, poses=50, moved=moved)
        irbcal.calibrate(folder / f"{k}.csv", "irb1600", "34").save(folder / str(k))
        out.append(adding.stored(folder / str(k), "R", "SN", f"2026-0{k + 1}-01"))
    return out


def change(first, second):
    return comparison.change(first.dated(), second.dated())


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
        out.append(adding.stored(folder / str(k), robot, "SN", f"2026-0{k + 1}-01"))
    return out


def test_the_other_robot_that_fits_is_named(swapped, place):
    with opened(place, create=True) as store:
        for one in swapped:
            store.add(one)
    changes = queries.fleet_list(place).changes
    for robot, other in (("A", "B"), ("B", "A")):
        (drift,) = queries.fleet_drift(robot, place).changes
        for step in (changes[robot], drift):
            assert step.real
            assert step.agreeing == (other,)
            assert step.in_words()[1:] == [
                f"The later one agrees with {other}: were the files of two robots exchanged?"
            ]
    levels = [one.dated() for one in swapped]
    assert OthersOfType(levels).perhaps_of(levels[3]) == [levels[0]], "the robot itself, under another name"
    assert comparison.agreeing(levels[3], levels[:3:2]) == ("A",)
    assert comparison.agreeing(levels[3], levels[2:3]) == ()


def test_many_steps_at_once_are_those_compared_by_hand(swapped):
    """By each pair alone, with the inverse of the sum of its covariances on the directions that both have seen."""
    other_names = tuple(f"{name} x" if k < 3 else name for k, name in enumerate(swapped[0].level.names))
    levels = [*swapped, replace(swapped[0], level=replace(swapped[0].level, names=other_names))]
    pairs = [(a, b) for a in levels for b in levels if a is not b]
    found = comparison.changes([(a.dated(), b.dated()) for a, b in pairs])
    for (a, b), step in zip(pairs, found, strict=True):
        names = [name for name in a.level.names if name in b.level.names]
        rows = [[one.level.names.index(name) for name in names] for one in (a, b)]
        size = a.level.natural[rows[0]]
        d = (b.level.values[rows[1]] - a.level.values[rows[0]]) / size
        A, B = (one.level.covariance[np.ix_(r, r)] / np.outer(size, size) for one, r in zip((a, b), rows, strict=True))
        variances, U = np.linalg.eigh(A + B)
        of_both = np.array([[u @ C @ u for u in U.T] for C in (A, B)])
        seen = (of_both.min(axis=0) > 1e-4 * of_both.max(axis=0)) & (variances > 1e-10 * variances.max())
        assert step.directions == seen.sum()
        assert step.chi2 == pytest.approx(sum((U.T @ d)[seen] ** 2 / variances[seen]), rel=1e-3)
        assert (step.robot, step.before, step.after) == (b.robot["id"], a.measured, b.measured)


def test_what_the_poses_do_not_show_explains_no_change(swapped):
    """Joint 6's zero turns with the tool: it had moved by 1e11 degrees."""
    for before, after in ((0, 2), (1, 3)):
        found = change(swapped[before], swapped[after])
        assert found.parameters
        for item in found.parameters:
            assert abs(item.value) < (np.radians(1.0) if item.unit == "rad" else 5e-3)


K = 3


def estimate_of_zeros(values, C, prior):
    names = tuple(f"delta_theta{j}" for j in range(1, K + 1))
    return Estimate(names, ("rad",) * K, np.asarray(values), np.asarray(prior), np.full(K, 1e-3), np.asarray(C))


@pytest.fixture
def many(stored):
    """Forty robots drawn about a mean, each seen through noise with a prior of its own."""
    rng = np.random.default_rng(5)
    mean, scatter, noise, prior = np.array([1e-3, -5e-4, 0.0]), np.array([1e-4, 2e-4, 5e-5]), 5e-5, np.full(K, 1e-3)
    out = []
    for k in range(40):
        truth = mean + scatter * rng.standard_normal(K)
        A = rng.standard_normal((K, K)) + 2 * np.eye(K)  # what the data show, correlated
        precision = A.T @ A / noise**2
        seen = truth + np.linalg.solve(A, noise * rng.standard_normal(K))
        C = np.linalg.inv(precision + np.diag(1 / prior**2))
        out.append(
            replace(
                stored[0],
                robot={**stored[0].robot, "id": f"R{k:02d}"},
                fit=estimate_of_zeros(C @ precision @ seen, C, prior),
                level=estimate_of_zeros(seen, np.linalg.inv(precision), np.full(K, np.inf)),
            )
        )
    return out


def test_a_robot_unlike_its_type_is_named(many):
    def standing_out(robots):
        return comparison.standing_out(
            [one.dated() for one in robots],
            {one.robot["id"]: one.calibration["heldout_mean_mm"] for one in robots},
        )

    robots = many
    assert standing_out(robots) == []
    values = np.array(robots[7].level.values)
    values[1] += 3e-3
    robots[7] = replace(robots[7], level=replace(robots[7].level, values=values))
    (found,) = standing_out(robots)
    assert found.robot == "R07"
    assert found.sentence.startswith("joint 2's zero is 0.17")
    assert standing_out(robots[5:9]) == []
    worse = {**robots[3].calibration, "heldout_mean_mm": 5.0}
    (found,) = standing_out([*robots[:3], replace(robots[3], calibration=worse), *robots[4:7]])
    assert found.robot == "R03"
    assert found.sentence.startswith("its held-out mean error is 5.000 mm")
