"""Fits that outliers hardly move."""

import numpy as np
import pytest
from simulated_fit import simulated
from support import central_differences

from irbcal.arrays import rms
from irbcal.errors import IdentificationError, OptionError
from irbcal.identification import initial_guess, minimax, robust
from irbcal.identification.least_squares import distances


@pytest.mark.parametrize("loss", robust.LOSSES)
def test_gradient_of_the_robust_loss_is_zero_at_the_minimum(loss):
    problem, start, _ = simulated(outliers=6)
    found = robust.solve_loss(problem, start, loss)
    basis = found.information.basis()

    def value(y, state):
        d = distances(problem, problem.moved(state, basis @ y))
        return np.array([np.sum(robust.LOSSES[loss]((d / found.scale) ** 2)[0])])

    rest = central_differences(lambda y: value(y, found.state), np.zeros(basis.shape[1]), 1e-7)
    before = central_differences(lambda y: value(y, start.state), np.zeros(basis.shape[1]), 1e-7)
    assert np.abs(rest).max() < 1e-3 * np.abs(before).max()
    assert np.all(np.diff(found.history) <= 1e-12)


@pytest.mark.parametrize("loss", robust.LOSSES)
def test_derivative_of_the_losses(loss):
    u = np.array([1e-3, 0.3, 0.9, 1.1, 4.0, 400.0])
    found = [(robust.LOSSES[loss](x + 1e-6)[0] - robust.LOSSES[loss](x - 1e-6)[0]) / 2e-6 for x in u]
    assert np.allclose(found, robust.LOSSES[loss](u)[1], rtol=1e-6, atol=1e-9)
    assert robust.LOSSES[loss](np.zeros(1)) == (0.0, 1.0)


@pytest.mark.parametrize("loss", robust.LOSSES)
def test_outliers_barely_move_a_robust_fit(loss):
    clean, clean_start, robot = simulated("34", poses=60)
    dirty, start, _ = simulated("34", poses=60, outliers=9)  # 9 of 180 points off by about 8 mm

    def error(state):
        """Largest distance of the predictions from the true points, metres."""
        exact = clean.points.xyz - np.concatenate(
            [robot.points(clean.points.q[i : i + 1], clean.points.target_names[j])
             for i, j in zip(clean.points.pose, clean.points.target, strict=True)]
        )  # fmt: skip
        T = state.T_world_base
        return np.linalg.norm(clean.residuals(state) @ T[:3, :3].T - exact, axis=1).max()

    found = robust.solve_loss(dirty, start, loss)
    assert error(start.state) > 8 * error(clean_start.state)
    assert error(found.state) < 2 * error(clean_start.state)
    assert found.information.rank >= start.information.rank
    assert np.sort(found.weights)[8] < 0.2 < np.sort(found.weights)[20]


def test_a_large_scale_is_least_squares_again():
    problem, start, _ = simulated()
    for loss in robust.LOSSES:
        found = robust.solve_loss(problem, start, loss, scale=1.0)
        assert found.value == pytest.approx(np.sqrt(start.rss / problem.rows), rel=1e-6)


@pytest.mark.parametrize("noise", [0.0, 1e-6])
def test_tiny_residuals_converge(noise):
    problem, start, _ = simulated("26", noise=noise)
    assert robust.solve_loss(problem, start).value < 5e-6


def test_held_directions_stay():
    problem, start, _ = simulated("34")
    held = start.information.directions[:, ~start.information.determined]
    assert held.shape[1] >= 3
    found = robust.solve_loss(problem, start, "huber")
    change = (found.state.errors - start.state.errors) / start.information.scale
    assert np.abs(held.T @ change).max() < 1e-12


def test_refusals(monkeypatch):
    problem, start, _ = simulated("nominal")
    with pytest.raises(OptionError, match="loss: expected soft_l1 or huber, found 'cauchy'"):
        robust.solve_loss(problem, start, "cauchy")
    with pytest.raises(OptionError, match="positive number of metres") as caught:
        robust.solve_loss(problem, start, scale=0.0)
    assert caught.value.parameter == "scale"
    monkeypatch.setattr(robust, "MAX_ITERATIONS", 1)
    with pytest.raises(IdentificationError, match="did not converge"):
        robust.solve_loss(problem, start, scale=1e-6)


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
def test_tiny_residuals_converge_pnorm(noise):
    problem, start, _ = simulated("26", noise=noise)
    assert robust.solve_p_norm(problem, start, p=8).value < 5e-6


def test_held_directions_stay_pnorm():
    problem, start, _ = simulated("34")
    held = start.information.directions[:, ~start.information.determined]
    assert held.shape[1] >= 3
    change = (robust.solve_p_norm(problem, start, 12).state.errors - start.state.errors) / start.information.scale
    assert np.abs(held.T @ change).max() < 1e-12


def test_refusals_pnorm(monkeypatch):
    problem, start, _ = simulated("nominal")
    for p in (1.5, np.inf, np.nan):
        with pytest.raises(OptionError, match="from 2 upwards") as caught:
            robust.solve_p_norm(problem, start, p)
        assert caught.value.parameter == "power"
    monkeypatch.setattr(robust, "MAX_ITERATIONS", 1)
    with pytest.raises(IdentificationError, match="did not converge"):
        robust.solve_p_norm(problem, start, 50)
