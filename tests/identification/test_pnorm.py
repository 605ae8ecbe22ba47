"""Between least squares and the largest distance, and fits that outliers hardly move."""

from dataclasses import replace

import numpy as np
import pytest
from support import arm, central_differences, measured, random_robot

from irbcal.errors import IdentificationError
from irbcal.identification import fit, least_squares, minimax, pnorm
from irbcal.identification.history import distances, rms


def simulated(level="16", poses=25, noise=5e-5, seed=0, outliers=0):
    nominal = arm()
    rng = np.random.default_rng(seed)
    robot = random_robot(nominal, level, rng)
    points = measured(robot, nominal.random_joints(poses, seed), noise, rng)
    if outliers:
        xyz = points.xyz.copy()
        xyz[rng.choice(len(xyz), outliers, replace=False)] += 5e-3 * rng.standard_normal((outliers, 3))
        points = replace(points, xyz=xyz)
    problem, _ = fit.make_problem(nominal, points, level)
    return problem, least_squares.solve(problem, fit.first_state(problem)), robot


def test_norm_is_a_power_mean():
    d = np.array([1.0, 2.0, 2.0])
    assert pnorm.norm(d, 2) == pytest.approx(np.sqrt(3.0))
    assert pnorm.norm(d, 1000) == pytest.approx(2.0, rel=1e-3)
    assert pnorm.norm(np.zeros(3), 4) == 0.0


def test_p_of_two_is_least_squares():
    problem, start, _ = simulated()
    found = pnorm.solve(problem, start, p=2)
    assert found.value == pytest.approx(np.sqrt(start.rss / problem.rows), rel=1e-9)
    far = pnorm.solve(problem, start, p=2, start=fit.first_state(problem))
    assert far.value == pytest.approx(found.value, rel=1e-9)


def test_norms_lie_in_order_between_rms_and_largest():
    problem, start, _ = simulated("34")
    powers = (2, 3, 4, 7.5, 20, 100)
    fits = [pnorm.solve(problem, start, p) for p in powers]
    d = [distances(problem, found.state) for found in fits]
    least = minimax.solve(problem, start)
    assert np.all(np.diff([found.value for found in fits]) > 0)
    assert np.all(np.diff([rms(x) for x in d]) > 0)
    assert np.all(np.diff([x.max() for x in d]) < 0)
    assert least.lower_bound <= d[-1].max() <= 1.02 * least.value
    for k, p in enumerate(powers):  # each is the best of all at its own p
        assert np.argmin([pnorm.norm(x, p) for x in d]) == k


@pytest.mark.parametrize("p", [2, 3, 8, 32])
def test_gradient_of_the_norm_is_zero_at_the_minimum(p):
    problem, start, _ = simulated()
    found = pnorm.solve(problem, start, p)
    basis = start.information.basis()

    def value(y, state):
        return np.array([pnorm.norm(distances(problem, problem.moved(state, basis @ y)), p)])

    rest = central_differences(lambda y: value(y, found.state), np.zeros(basis.shape[1]), 1e-7)
    before = central_differences(lambda y: value(y, fit.first_state(problem)), np.zeros(basis.shape[1]), 1e-7)
    assert np.abs(rest).max() < 1e-5 * np.abs(before).max()


@pytest.mark.parametrize("loss", pnorm.LOSSES)
def test_gradient_of_the_robust_loss_is_zero_at_the_minimum(loss):
    problem, start, _ = simulated(outliers=6)
    found = pnorm.robust(problem, start, loss)
    basis = found.information.basis()

    def value(y, state):
        d = distances(problem, problem.moved(state, basis @ y))
        return np.array([np.sum(pnorm.LOSSES[loss]((d / found.scale) ** 2)[0])])

    rest = central_differences(lambda y: value(y, found.state), np.zeros(basis.shape[1]), 1e-7)
    before = central_differences(lambda y: value(y, start.state), np.zeros(basis.shape[1]), 1e-7)
    assert np.abs(rest).max() < 1e-3 * np.abs(before).max()
    assert np.all(np.diff(found.history) <= 1e-12)


@pytest.mark.parametrize("loss", pnorm.LOSSES)
def test_derivative_of_the_losses(loss):
    u = np.array([1e-3, 0.3, 0.9, 1.1, 4.0, 400.0])
    found = [(pnorm.LOSSES[loss](x + 1e-6)[0] - pnorm.LOSSES[loss](x - 1e-6)[0]) / 2e-6 for x in u]
    assert np.allclose(found, pnorm.LOSSES[loss](u)[1], rtol=1e-6)
    assert pnorm.LOSSES[loss](np.zeros(1)) == (0.0, 1.0)


@pytest.mark.parametrize("loss", pnorm.LOSSES)
def test_gross_outliers_barely_move_a_robust_fit(loss):
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

    found = pnorm.robust(dirty, start, loss)
    assert error(start.state) > 8 * error(clean_start.state)
    assert error(found.state) < 2 * error(clean_start.state)
    assert found.information.rank >= start.information.rank
    assert np.sort(found.weights)[8] < 0.2 < np.sort(found.weights)[20]


def test_a_large_scale_is_least_squares_again():
    problem, start, _ = simulated()
    for loss in pnorm.LOSSES:
        found = pnorm.robust(problem, start, loss, scale=1.0)
        assert found.value == pytest.approx(np.sqrt(start.rss / problem.rows), rel=1e-6)


@pytest.mark.parametrize("noise", [0.0, 1e-6])
def test_tiny_residuals_converge(noise):
    problem, start, _ = simulated("26", noise=noise)
    assert pnorm.solve(problem, start, p=8).value < 5e-6
    assert pnorm.robust(problem, start).value < 5e-6


def test_held_directions_stay():
    problem, start, _ = simulated("34")
    held = start.information.directions[:, ~start.information.seen]
    assert held.shape[1] >= 3
    for found in (pnorm.solve(problem, start, 12), pnorm.robust(problem, start, "huber")):
        change = (found.state.errors - start.state.errors) / start.information.scale
        assert np.abs(held.T @ change).max() < 1e-12


def test_refusals(monkeypatch):
    problem, start, _ = simulated("nominal")
    for p in (1.5, np.inf, np.nan):
        with pytest.raises(IdentificationError, match="from 2 upwards"):
            pnorm.solve(problem, start, p)
    with pytest.raises(IdentificationError, match="unknown loss 'cauchy'"):
        pnorm.robust(problem, start, "cauchy")
    with pytest.raises(IdentificationError, match="positive number of metres"):
        pnorm.robust(problem, start, scale=0.0)
    monkeypatch.setattr(pnorm, "MAX_ITERATIONS", 1)
    with pytest.raises(IdentificationError, match="did not converge"):
        pnorm.solve(problem, start, 50)
    with pytest.raises(IdentificationError, match="did not converge"):
        pnorm.robust(problem, start, scale=1e-6)
