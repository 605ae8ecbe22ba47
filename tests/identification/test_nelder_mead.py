"""The thesis' own search."""

import numpy as np
import pytest

from irbcal.identification import fit, initial_guess, least_squares, minimax
from irbcal.identification import least_squares as history_module
from irbcal.identification.least_squares import History
from irbcal.io import urdf
from irbcal.measurement import cleaning, table
from irbcal.pipeline import held_out


def test_it_improves_and_stays_above_the_proved_bound(case):
    problem, others = case
    start = least_squares.solve(problem, initial_guess.first_state(problem))
    history = History(problem, others)
    found = minimax.nelder_mead(problem, start, iterations=200, record=history.record)
    best = minimax.solve(problem, start)
    assert found.iterations == 200
    assert found.evaluations >= 200
    assert found.value == pytest.approx(minimax.largest_distance(problem.residuals(found.state)), rel=1e-12)
    assert best.value < found.value < found.history[0]
    assert len(found.history) == 21
    assert np.all(np.diff(found.history) <= 0)
    frame = history.to_frame()
    assert list(frame["iteration"]) == list(range(0, 201, 10))
    assert np.allclose(frame["objective_mm"], 1e3 * np.array(found.history), rtol=1e-9, atol=1e-12)
    assert np.all(np.diff(frame["seconds"]) > 0)


def test_sizes_are_in_the_order_of_the_unknowns(case):
    problem, _ = case
    sizes = minimax.plausible_sizes(problem)
    assert sizes.shape == (problem.unknowns,)
    assert np.abs(sizes[[0, 3, 6]] - [np.radians(0.5), 5e-3, 5e-3]).max() < 1e-15
    assert sizes[-1] == problem.parameters[-1].scale


def test_another_objective(case):
    problem, _ = case
    first = initial_guess.first_state(problem)
    start = least_squares.solve(problem, first)
    found = minimax.nelder_mead(problem, start, first, iterations=50, objective=history_module.rms)
    assert found.value < found.history[0]
    assert found.value == pytest.approx(history_module.rms(history_module.distances(problem, found.state)), rel=1e-12)


def test_two_thousand_iterations_on_a_real_robot_do_worse_than_minimax(shared_data):
    points = cleaning.clean(table.read(shared_data / "irb120_laser_tracker" / "measurements.csv")).points
    problem, _ = fit.make_problem(urdf.read("irb120").arm, points.select(~held_out(points, 296, "last")), "34")
    start = least_squares.solve(problem, initial_guess.first_state(problem))
    found = minimax.nelder_mead(problem, start)
    best = minimax.solve(problem, start)
    assert found.iterations == 2000
    assert len(found.history) == 201
    assert best.value * 1.02 < found.value < 0.7 * found.history[0]
