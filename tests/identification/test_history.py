"""The record of any fit's iterations."""

import pickle

import numpy as np
import pytest
from support import arm, measured, random_robot

from irbcal.errors import IdentificationError
from irbcal.identification import fit, initial_guess, least_squares, minimax, robust
from irbcal.identification import least_squares as history_module
from irbcal.identification.least_squares import History


def test_one_recorder_serves_every_method(case):
    problem, others = case
    first = initial_guess.first_state(problem)
    start = least_squares.solve(problem, first)
    runs = {
        "minimax": lambda record: minimax.solve(problem, start, record=record),
        "p-norm": lambda record: robust.solve_p_norm(problem, start, 8, record=record),
        "least squares": lambda record: least_squares.solve(problem, first, record=record),
        "robust": lambda record: robust.solve_loss(problem, start, record=record),
    }
    for name, run in runs.items():
        history = History(problem, others)
        found = run(history.record)
        frame = history.to_frame()
        assert list(frame["iteration"]) == list(range(len(frame))), name
        assert found.iterations <= len(frame) <= found.iterations + 1, name
        # least squares does not record its last step, which is below a tenth of a micrometre
        near = 1e-3 if name == "least squares" else 1e-9
        last = history_module.distances(others["all range"], found.state) * 1e3
        assert frame["all range_mean_mm"].iloc[-1] == pytest.approx(last.mean(), rel=near), name
        assert frame["all range_max_mm"].iloc[-1] == pytest.approx(last.max(), rel=near), name
        final = 1e3 * minimax.largest_distance(problem.residuals(found.state))
        assert frame["objective_mm"].iloc[-1] == pytest.approx(final, rel=near), name


def test_objective_and_distance_between_records_can_be_chosen(case):
    problem, _ = case
    start = least_squares.solve(problem, initial_guess.first_state(problem))
    history = History(problem, objective=history_module.rms, every=2)
    robust.solve_p_norm(problem, start, 8, record=history.record)
    frame = history.to_frame()
    assert list(frame.columns) == ["iteration", "seconds", "objective_mm"]
    assert set(frame["iteration"] % 2) == {0}
    assert frame["objective_mm"][0] == pytest.approx(1e3 * np.sqrt(start.rss / problem.rows))


def test_plot_has_units_and_every_group(case, tmp_path):
    problem, others = case
    start = least_squares.solve(problem, initial_guess.first_state(problem))
    history = History(problem, others)
    minimax.nelder_mead(problem, start, iterations=30, record=history.record)
    chart = history.plot()
    assert all(drawing.label.endswith("(mm)") for drawing in chart.drawings)
    words = [words for *_, words in chart.legend]
    assert all(any(name in text for text in words) for name in others)
    assert chart.save(tmp_path / "history.png").stat().st_size > 5_000
    alone = History(problem)
    alone.record(0, start.state)
    assert len(alone.plot().drawings) == 1


def test_refusals(case):
    problem, _ = case
    nominal = arm()
    robot = random_robot(nominal, "11", np.random.default_rng(1))
    other, _ = fit.make_problem(nominal, measured(robot, nominal.random_joints(10, 0)), "11")
    with pytest.raises(IdentificationError, match="the points 'other' cannot be followed"):
        History(problem, {"other": other})
    with pytest.raises(IdentificationError, match="no iteration was recorded"):
        History(problem).plot()


def test_it_speaks_and_can_be_pickled(case):
    problem, others = case
    history = History(problem, others)
    assert history.headline() == "no iteration was recorded"
    least_squares.solve(problem, initial_guess.first_state(problem), record=history.record)
    assert "iterations in" in history.headline()
    assert "iso cube_mean_mm" in history.summary()
    again = pickle.loads(pickle.dumps(history))
    assert again.rows == history.rows
    assert len(history.plot().drawings) == 2
