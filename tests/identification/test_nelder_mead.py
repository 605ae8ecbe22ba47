"""The thesis' own search, and the record of any fit's iterations."""

import numpy as np
import pytest
from support import arm, measured, random_robot

from irbcal.calibrating import split
from irbcal.errors import IdentificationError
from irbcal.files import urdf
from irbcal.identification import fit, least_squares, minimax, nelder_mead, pnorm
from irbcal.identification import history as history_module
from irbcal.identification.history import History
from irbcal.measurement import cleaning, table


@pytest.fixture(scope="module")
def case():
    """A level-34 fit, and two groups of points that it does not use."""
    nominal = arm()
    rng = np.random.default_rng(0)
    robot = random_robot(nominal, "34", rng)
    problems = [
        fit.make_problem(nominal, measured(robot, nominal.random_joints(poses, seed), 5e-5, rng), "34")[0]
        for seed, poses in enumerate((30, 20, 20))
    ]
    return problems[0], {"iso cube": problems[1], "all range": problems[2]}


def test_it_improves_and_stays_above_the_proved_bound(case):
    problem, others = case
    start = least_squares.solve(problem, fit.first_state(problem))
    history = History(problem, others)
    found = nelder_mead.solve(problem, start.state, iterations=200, record=history.record)
    best = minimax.solve(problem, start)
    assert found.iterations == 200
    assert found.evaluations >= 200
    assert found.value == pytest.approx(minimax.largest(problem.residuals(found.state)), rel=1e-12)
    assert best.value < found.value < found.history[0]
    assert len(found.history) == 21
    assert np.all(np.diff(found.history) <= 0)
    frame = history.to_frame()
    assert list(frame["iteration"]) == list(range(0, 201, 10))
    assert np.allclose(frame["objective_mm"], 1e3 * np.array(found.history), rtol=1e-9)
    assert np.all(np.diff(frame["seconds"]) > 0)


def test_sizes_are_in_the_order_of_the_unknowns(case):
    problem, _ = case
    sizes = nelder_mead.sizes(problem)
    assert sizes.shape == (problem.unknowns,)
    assert np.abs(sizes[[0, 3, 6]] - [np.radians(0.5), 5e-3, 5e-3]).max() < 1e-15
    assert sizes[-1] == problem.parameters[-1].scale


def test_another_objective(case):
    problem, _ = case
    found = nelder_mead.solve(problem, fit.first_state(problem), iterations=50, objective=history_module.rms)
    assert found.value < found.history[0]
    assert found.value == pytest.approx(history_module.rms(history_module.distances(problem, found.state)), rel=1e-12)


def test_one_recorder_serves_every_method(case):
    problem, others = case
    first = fit.first_state(problem)
    start = least_squares.solve(problem, first)
    runs = {
        "minimax": lambda record: minimax.solve(problem, start, record=record),
        "p-norm": lambda record: pnorm.solve(problem, start, 8, record=record),
        "least squares": lambda record: least_squares.solve(problem, first, record=record),
        "robust": lambda record: pnorm.robust(problem, start, record=record),
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
        final = 1e3 * minimax.largest(problem.residuals(found.state))
        assert frame["objective_mm"].iloc[-1] == pytest.approx(final, rel=near), name


def test_objective_and_distance_between_records_can_be_chosen(case):
    problem, _ = case
    start = least_squares.solve(problem, fit.first_state(problem))
    history = History(problem, objective=history_module.rms, every=2)
    pnorm.solve(problem, start, 8, record=history.record)
    frame = history.to_frame()
    assert list(frame.columns) == ["iteration", "seconds", "objective_mm"]
    assert set(frame["iteration"] % 2) == {0}
    assert frame["objective_mm"][0] == pytest.approx(1e3 * np.sqrt(start.rss / problem.rows))


def test_plot_has_units_and_every_group(case, tmp_path):
    problem, others = case
    start = least_squares.solve(problem, fit.first_state(problem))
    history = History(problem, others)
    nelder_mead.solve(problem, start.state, iterations=30, record=history.record)
    figure = history_module.plot(history)
    labels = [ax.get_ylabel() for ax in figure.axes]
    assert all(label.endswith("(mm)") for label in labels)
    assert figure.axes[-1].get_xlabel() == "iteration"
    texts = [text.get_text() for ax in figure.axes for text in ax.get_legend().get_texts()]
    assert all(any(name in text for text in texts) for name in others)
    figure.savefig(tmp_path / "history.png")
    assert (tmp_path / "history.png").stat().st_size > 5_000
    alone = History(problem)
    alone.record(0, start.state)
    assert len(history_module.plot(alone).axes) == 1


def test_refusals(case):
    problem, _ = case
    nominal = arm()
    robot = random_robot(nominal, "11", np.random.default_rng(1))
    other, _ = fit.make_problem(nominal, measured(robot, nominal.random_joints(10, 0)), "11")
    with pytest.raises(IdentificationError, match="the points 'other' cannot be followed"):
        History(problem, {"other": other})
    with pytest.raises(IdentificationError, match="no iteration was recorded"):
        history_module.plot(History(problem))


def test_two_thousand_iterations_on_a_real_robot_do_worse_than_minimax(shared_data):
    points = cleaning.clean(table.read(shared_data / "irb120_laser_tracker" / "measurements.csv")).points
    problem, _ = fit.make_problem(urdf.read("irb120").arm, points.select(~split(points, 296, "last")), "34")
    start = least_squares.solve(problem, fit.first_state(problem))
    found = nelder_mead.solve(problem, start.state)
    best = minimax.solve(problem, start)
    assert found.iterations == 2000
    assert len(found.history) == 201
    assert best.value * 1.02 < found.value < 0.7 * found.history[0]
