"""Every way of identifying through one call, and what the options refuse."""

import numpy as np
import pytest
from support import arm, measured, random_robot

from irbcal.errors import IdentificationError, OptionError
from irbcal.identification.fit import identify_by
from irbcal.measurement.points import distances


def axis_moves_and_more(rng, level="26", noise=0.0):
    """Simulated one-joint moves (7 poses each), 40 random poses to fit, 60 to verify."""
    nominal = arm()
    robot = random_robot(nominal, level, rng, size=0.1)
    q = np.zeros((42, 6))
    for i in range(6):
        q[7 * i : 7 * i + 7, i] = np.radians(np.linspace(-45, 45, 7))
    groups = [*np.repeat([f"axis{i}" for i in range(1, 7)], 7), *["all_range"] * 40, *["check"] * 60]
    points = measured(robot, np.vstack([q, nominal.random_joints(100, 1)]), noise, rng, groups)
    check = points.groups == "check"
    return nominal, points.select(~check), points.select(check)


@pytest.fixture(scope="module")
def data():
    """A robot with backlash-like noise, so that objectives differ."""
    return axis_moves_and_more(np.random.default_rng(1), noise=2e-4)


def largest(fit, points):
    return distances(fit.robot, points).max()


def test_objectives_reach_what_they_promise(data):
    nominal, points, check = data
    fits = {
        name: identify_by(nominal, points, "26", objective=name, watched={"check": check})
        for name in ("rms", "pnorm", "max")
    }
    assert largest(fits["max"], points) < largest(fits["pnorm"], points) < largest(fits["rms"], points)
    assert fits["rms"].rms < fits["pnorm"].rms < fits["max"].rms
    best = fits["max"]
    assert best.value == pytest.approx(largest(best, points), abs=1e-12)
    assert best.lower_bound <= best.value <= best.lower_bound * 1.0001
    assert best.least_squares.rms == pytest.approx(fits["rms"].rms, rel=1e-12)
    for fit in fits.values():
        course = fit.history.to_frame()
        assert list(course.columns)[3:] == ["check_mean_mm", "check_max_mm"]
        assert course["objective_mm"].iloc[-1] <= course["objective_mm"].iloc[0]
        assert course["check_max_mm"].iloc[-1] == pytest.approx(largest(fit, check) * 1e3, rel=1e-4)


def test_circles_method_is_exact_without_noise_and_lists_its_parameters():
    nominal, points, check = axis_moves_and_more(np.random.default_rng(2))
    fit = identify_by(nominal, points, "26", method="circles")
    assert fit.method == "circles"
    assert largest(fit, check) < 1e-9
    rows = {row.name: row for row in fit.parameters()}
    assert "delta_alpha4" in rows
    assert "base_x" in rows
    assert fit.problem.points.poses == 42, "only the one-joint moves were used"


def test_circles_method_says_what_it_needs(data):
    nominal, _, check = data
    with pytest.raises(IdentificationError, match=r"one-joint moves in the groups axis1 \.\.\. axis6; found check"):
        identify_by(nominal, check, "26", method="circles")


def test_nelder_mead_starts_from_the_axes_and_stays_above_the_certified_minimum(data):
    nominal, points, check = data
    search = identify_by(nominal, points, "26", method="nelder-mead", watched={"check": check})
    best = identify_by(nominal, points, "26", objective="max")
    course = search.history.to_frame()
    assert course["iteration"].iloc[-1] == 2000
    assert course["objective_mm"].iloc[-1] < course["objective_mm"].iloc[0]
    assert largest(search, points) > 1.05 * best.lower_bound


def test_robust_losses_shrug_off_gross_errors(data):
    nominal, points, check = data
    xyz = points.xyz.copy()
    xyz[::29] += 0.008
    bad = type(points)(**{**vars(points), "xyz": xyz})
    plain = distances(identify_by(nominal, bad, "26").robot, check).mean()
    clean = distances(identify_by(nominal, points, "26").robot, check).mean()
    for loss in ("soft_l1", "huber"):
        robust = distances(identify_by(nominal, bad, "26", loss=loss).robot, check).mean()
        assert robust - clean < 0.2 * (plain - clean)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"method": "magic"}, "method: expected least-squares, circles or nelder-mead, found 'magic'"),
        ({"objective": "mean"}, "objective: expected rms, max or pnorm, found 'mean'"),
        ({"loss": "l2"}, "loss: expected linear, soft_l1 or huber, found 'l2'"),
        ({"level": "27"}, "level: expected nominal, 11, 16, 26, 34, 34b, offsets or placement, found '27'"),
        ({"objective": "max", "loss": "huber"}, "loss huber goes with objective rms, not with max"),
        ({"method": "circles", "objective": "pnorm"}, "method circles has its own objective"),
        ({"method": "axes", "objective": "pnorm"}, "method circles has its own objective"),
        ({"method": "circles", "parameters": ()}, "method circles takes all link geometry from the axes"),
    ],
)
def test_options_that_do_not_exist_or_contradict_are_refused(data, options, expected):
    with pytest.raises(OptionError, match=expected) as caught:
        identify_by(*data[:2], **{"level": "26", **options})
    assert caught.value.parameter in options


def test_the_first_name_of_the_circles_still_works(data):
    nominal, points, _ = data
    old, new = (identify_by(nominal, points, "26", method=name) for name in ("axes", "circles"))
    assert old.method == new.method == "circles"
    assert old.rms == new.rms
