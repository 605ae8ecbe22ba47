"""Between least squares and the largest distance."""

import numpy as np
import pytest
from simulated_fit import simulated
from support import central_differences

from irbcal.errors import IdentificationError, OptionError
from irbcal.identification import initial_guess, minimax, robust
from irbcal.identification.least_squares import distances, rms


def test_norm_is_a_power_mean():
    d = np.array([1.0, 2.0, 2.0])
    assert robust.norm(d, 2) == pytest.approx(np.sqrt(3.0))
    assert robust.norm(d, 1000) == pytest.approx(2.0, rel=1e-3)
    assert robust.norm(np.zeros(3), 4) == 0.0


def test_p_of_two_is_least_squares():
    problem, start, _ = simulated()
    found = robust.solve_p_norm(problem, start, p=2)
    assert found.value == pytest.approx(np.sqrt(start.rss / problem.rows), rel=1e-9)
    far = robust.solve_p_norm(problem, start, p=2, start=initial_guess.first_state(problem))
    assert far.value == pytest.approx(found.value, rel=1e-9)


def test_norms_lie_in_order_between_rms_and_largest():
    problem, start, _ = simulated("34")
    powers = (2, 3, 4, 7.5, 20, 100)
    fits = [robust.solve_p_norm(problem, start, p) for p in powers]
    d = [distances(problem, found.state) for found in fits]
    least = minimax.solve(problem, start)
    assert np.all(np.diff([found.value for found in fits]) > 0)
    assert np.all(np.diff([rms(x) for x in d]) > 0)
    assert np.all(np.diff([x.max() for x in d]) < 0)
    assert least.lower_bound <= d[-1].max() <= 1.02 * least.value
    for k, p in enumerate(powers):  # each is the best of all at its own p
        assert np.argmin([robust.norm(x, p) for x in d]) == k


@pytest.mark.parametrize("p", [2, 3, 8, 32])
def test_gradient_of_the_norm_is_zero_at_the_minimum(p):
    problem, start, _ = simulated()
    found = robust.solve_p_norm(problem, start, p)
    basis = start.information.basis()

    def value(y, state):
        return np.array([robust.norm(distances(problem, problem.moved(state, basis @ y)), p)])

    rest = central_differences(lambda y: value(y, found.state), np.zeros(basis.shape[1]), 1e-7)
    before = central_differences(lambda y: value(y, initial_guess.first_state(problem)), np.zeros(basis.shape[1]), 1e-7)
    assert np.abs(rest).max() < 1e-5 * np.abs(before).max()


@pytest.mark.parametrize("noise", [0.0, 1e-6])
def test_tiny_residuals_converge(noise):
    problem, start, _ = simulated("26", noise=noise)
    assert robust.solve_p_norm(problem, start, p=8).value < 5e-6


def test_held_directions_stay():
    problem, start, _ = simulated("34")
    held = start.information.directions[:, ~start.information.seen]
    assert held.shape[1] >= 3
    change = (robust.solve_p_norm(problem, start, 12).state.errors - start.state.errors) / start.information.scale
    assert np.abs(held.T @ change).max() < 1e-12


def test_refusals(monkeypatch):
    problem, start, _ = simulated("nominal")
    for p in (1.5, np.inf, np.nan):
        with pytest.raises(OptionError, match="from 2 upwards") as caught:
            robust.solve_p_norm(problem, start, p)
        assert caught.value.parameter == "power"
    monkeypatch.setattr(robust, "MAX_ITERATIONS", 1)
    with pytest.raises(IdentificationError, match="did not converge"):
        robust.solve_p_norm(problem, start, 50)
