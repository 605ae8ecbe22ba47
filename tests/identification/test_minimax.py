"""The smallest largest distance: closed forms, a second solver, certificates, and a real robot."""

from types import SimpleNamespace

import numpy as np
import pytest
from support import arm, measured, random_robot

from irbcal.errors import IdentificationError, OptionError
from irbcal.identification import fit, initial_guess, least_squares, minimax
from irbcal.io import urdf
from irbcal.measurement import cleaning, table
from irbcal.pipeline import held_out


class Translation:
    """Points seen from a place that is looked for: the minimax place is the middle of their smallest ball."""

    def __init__(self, points):
        self.points = points

    def rss(self, state):
        return float(np.sum(self.residuals(state) ** 2))

    def residuals(self, state):
        return self.points - state

    def jacobian(self, state):
        return np.tile(np.eye(3), (len(self.points), 1))

    def moved(self, state, step):
        return state + step


def solved(points):
    start = points.mean(axis=0)
    return Translation(points), SimpleNamespace(state=start, information=SimpleNamespace(basis=lambda: np.eye(3)))


def simulated(level="34", poses=25, noise=5e-5, seed=0, size=0.3):
    nominal = arm()
    rng = np.random.default_rng(seed)
    robot = random_robot(nominal, level, rng, size)
    problem, _ = fit.make_problem(nominal, measured(robot, nominal.random_joints(poses, seed), noise, rng), level)
    return problem, least_squares.solve(problem, initial_guess.first_state(problem))


@pytest.mark.parametrize("inner", ["numpy", "clarabel"])
@pytest.mark.parametrize("seed", range(4))
def test_smallest_ball_through_two_opposite_points(inner, seed):
    if inner == "clarabel":
        pytest.importorskip("clarabel")
    rng = np.random.default_rng(seed)
    middle, radius = rng.uniform(-1, 1, 3), 2e-3
    end = rng.standard_normal(3)
    end *= radius / np.linalg.norm(end)
    others = rng.uniform(-0.5, 0.5, (50, 3)) * radius
    found = minimax.solve(*solved(middle + np.vstack([end, -end, others])), tolerance=1e-7, inner=inner)
    assert found.value == pytest.approx(radius, rel=2e-7)
    assert found.lower_bound == pytest.approx(radius, rel=2e-7)
    assert np.linalg.norm(found.state - middle) < 1e-6
    assert list(found.support) == [0, 1]


def test_smallest_ball_of_a_triangle_and_of_a_tetrahedron():
    triangle = 1e-3 * np.array([[0.0, 0, 0], [3, 0, 0], [0, 4, 0]])  # right angle: the long side is a diameter
    assert minimax.solve(*solved(triangle)).value == pytest.approx(2.5e-3, rel=1e-4)
    corners = 1e-3 * np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    found = minimax.solve(*solved(np.vstack([corners, [[3e-4, 2e-4, 0]]])))
    assert found.value == pytest.approx(np.sqrt(3) * 1e-3, rel=1e-4)
    assert list(found.support) == [0, 1, 2, 3]


@pytest.mark.parametrize("level", ["nominal", "16", "34", "34b"])
def test_both_inner_solvers_agree(level):
    pytest.importorskip("clarabel")
    problem, start = simulated(level)
    ours = minimax.solve(problem, start, tolerance=1e-6)
    theirs = minimax.solve(problem, start, tolerance=1e-6, inner="clarabel")
    assert ours.value == pytest.approx(theirs.value, rel=3e-6)
    assert max(ours.lower_bound, theirs.lower_bound) <= min(ours.value, theirs.value) * (1 + 1e-5)
    assert ours.value < minimax.largest_distance(problem.residuals(start.state))


def test_certificate_can_be_checked_by_hand():
    problem, start = simulated()
    found = minimax.solve(problem, start)
    r = problem.residuals(found.state)
    A = problem.jacobian(found.state) @ start.information.basis()
    assert found.value == np.linalg.norm(r, axis=1).max() == found.history[-1]
    assert found.gap <= 1e-4
    assert np.linalg.norm(found.multipliers, axis=1).sum() == pytest.approx(1.0, abs=1e-12)
    assert np.abs(A.T @ found.multipliers.ravel()).max() < 1e-12 * np.abs(A).max()
    assert np.sum(found.multipliers * r) == pytest.approx(found.lower_bound, abs=1e-15)
    distances = np.linalg.norm(r, axis=1)
    assert distances[found.support].min() > found.value * (1 - 1e-2)
    assert 2 <= len(found.support) < problem.rows // 2


def test_no_step_gets_below_the_bound():
    problem, start = simulated(seed=1)
    found = minimax.solve(problem, start)
    basis = start.information.basis()
    r, A = problem.residuals(found.state), problem.jacobian(found.state) @ basis
    rng = np.random.default_rng(2)
    for size in (1e-6, 1e-5, 1e-4, 1e-3):
        for y in size * rng.standard_normal((100, basis.shape[1])):
            assert minimax.largest_distance(r - (A @ y).reshape(-1, 3)) >= found.lower_bound
            if size <= 1e-4:
                assert (
                    minimax.largest_distance(problem.residuals(problem.moved(found.state, basis @ y)))
                    >= found.lower_bound
                )


def test_held_directions_stay_and_all_starts_end_alike():
    problem, start = simulated(seed=5)
    information = start.information
    assert (~information.seen).sum() >= 3
    found = minimax.solve(problem, start)
    change = (found.state.errors - start.state.errors) / information.scale
    assert np.abs(information.directions[:, ~information.seen].T @ change).max() < 1e-12
    assert np.abs(change).max() > 1e-4
    far = minimax.solve(problem, start, start=initial_guess.first_state(problem))
    assert far.value == pytest.approx(found.value, rel=1e-3)
    again = minimax.solve(problem, start, start=found.state)
    assert again.value <= found.value


def test_data_without_errors_need_no_iteration():
    problem, start = simulated(noise=0.0)
    found = minimax.solve(problem, start)
    assert found.iterations == 0
    assert found.value < 1e-9


def test_refusals(monkeypatch):
    problem, start = simulated("nominal")
    with pytest.raises(OptionError, match="inner: expected numpy or clarabel, found 'simplex'"):
        minimax.solve(problem, start, inner="simplex")
    monkeypatch.setattr(minimax, "MAX_ITERATIONS", 0)
    with pytest.raises(IdentificationError, match="are proved to be needed"):
        minimax.solve(problem, start)


@pytest.mark.parametrize(
    ("level", "least_squares_mm", "certified_mm", "heldout_mm"),
    [("34", 1.923, 0.99651, 0.635), ("34b", 1.60, 0.97502, 0.611)],
)
def test_real_robot(shared_data, level, least_squares_mm, certified_mm, heldout_mm):
    """An independent cone program certified ``certified_mm``; ``heldout_mm`` is what its fit gave on unused poses."""
    points = cleaning.clean(table.read(shared_data / "irb120_laser_tracker" / "measurements.csv")).points
    nominal = urdf.read("irb120").arm
    held = held_out(points, 296, "last")
    problem, _ = fit.make_problem(nominal, points.select(~held), level)
    unused, _ = fit.make_problem(nominal, points.select(held), level)
    start = least_squares.solve(problem, initial_guess.first_state(problem))
    found = minimax.solve(problem, start)
    assert 1e3 * found.history[0] == pytest.approx(least_squares_mm, rel=0.02)
    assert 1e3 * found.value <= certified_mm + 1e-4
    assert 1e3 * found.lower_bound > 0.98 * certified_mm
    assert found.gap <= 1e-4
    mean = [np.linalg.norm(unused.residuals(state), axis=1).mean() for state in (start.state, found.state)]
    assert 1e3 * mean[1] == pytest.approx(heldout_mm, rel=0.06)
    assert mean[1] > 1.3 * mean[0]  # the smallest largest distance of the fit is paid for elsewhere


def test_the_poses_with_the_largest_distances_tell_of_all(monkeypatch):
    nominal, rng = arm(), np.random.default_rng(4)
    points = measured(random_robot(nominal, "34", rng), nominal.random_joints(300, 4), 5e-5, rng)
    problem, _ = fit.make_problem(nominal, points, "34")
    first = least_squares.solve(problem, initial_guess.first_state(problem))
    whole = minimax.solve(problem, first)
    monkeypatch.setattr(minimax, "MOST_POSES", 200)
    monkeypatch.setattr(minimax, "ADDED", 40)
    parts = minimax.solve(problem, first)
    assert abs(parts.value / whole.value - 1.0) < 2 * minimax.TOLERANCE
    assert parts.value == pytest.approx(np.linalg.norm(problem.residuals(parts.state), axis=1).max(), abs=1e-15)
    assert parts.value - parts.lower_bound <= minimax.TOLERANCE * parts.value
    assert np.linalg.norm(parts.multipliers, axis=1).sum() == pytest.approx(1.0, abs=1e-9)
    basis = problem.jacobian(parts.state) @ first.information.basis()
    assert np.abs(basis.T @ parts.multipliers.ravel()).max() < 1e-9 * np.abs(basis).max()
