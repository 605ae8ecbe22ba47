"""The smallest largest distance: closed forms, a second solver, certificates, and a real robot."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import sparse
from simulated_fit import simulated as simulated_imported
from support import arm, measured, random_robot

from irbcal.arrays import rms
from irbcal.errors import IdentificationError
from irbcal.identification import fit, initial_guess, least_squares, minimax
from irbcal.identification import least_squares as history_module
from irbcal.identification.least_squares import History
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


def solve_cone_with_clarabel(r, Q, tolerance):
    """As `minimax.solve_cone`, by a general solver."""
    clarabel = pytest.importorskip("clarabel")

    m, n = len(r), Q.shape[1]
    unit = minimax.largest_distance(r)
    G = np.zeros((m, 4, n + 1))
    G[:, 0, n] = -1.0
    G[:, 1:, :n] = Q.reshape(m, 3, n)
    h = np.column_stack([np.zeros(m), r / unit]).ravel()
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = min(tolerance, 1e-8)
    cones = [clarabel.SecondOrderConeT(4)] * m
    objective = np.append(np.zeros(n), 1.0)
    program = (sparse.csc_matrix((n + 1, n + 1)), objective, sparse.csc_matrix(G.reshape(4 * m, n + 1)), h, cones)
    found = clarabel.DefaultSolver(*program, settings).solve()
    return unit * np.array(found.x)[:n], -np.array(found.z).reshape(m, 4)[:, 1:]


@pytest.mark.parametrize("seed", range(4))
def test_smallest_ball_through_two_opposite_points(seed):
    rng = np.random.default_rng(seed)
    middle, radius = rng.uniform(-1, 1, 3), 2e-3
    end = rng.standard_normal(3)
    end *= radius / np.linalg.norm(end)
    others = rng.uniform(-0.5, 0.5, (50, 3)) * radius
    found = minimax.solve(*solved(middle + np.vstack([end, -end, others])), tolerance=1e-7)
    assert found.value == pytest.approx(radius, rel=2e-7)
    assert found.lower_bound == pytest.approx(radius, rel=2e-7)
    assert np.linalg.norm(found.state - middle) < 1e-6
    assert list(found.support) == [0, 1]


@pytest.mark.parametrize("unit", [1e-3, 10.0], ids=["mm", "residuals that a whole unit of a move does not reach"])
def test_smallest_ball_of_a_triangle_and_of_a_tetrahedron(unit):
    triangle = unit * np.array([[0.0, 0, 0], [3, 0, 0], [0, 4, 0]])  # right angle: the long side is a diameter
    assert minimax.solve(*solved(triangle)).value == pytest.approx(2.5 * unit, rel=1e-4)
    corners = unit * np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    found = minimax.solve(*solved(np.vstack([corners, [[0.3 * unit, 0.2 * unit, 0]]])))
    assert found.value == pytest.approx(np.sqrt(3) * unit, rel=1e-4)
    assert list(found.support) == [0, 1, 2, 3]


@pytest.mark.parametrize("level", ["nominal", "16", "34", "34b"])
def test_both_cone_solvers_agree(level, monkeypatch):
    problem, start = simulated(level)
    ours = minimax.solve(problem, start, tolerance=1e-6)
    monkeypatch.setattr(minimax, "solve_cone", solve_cone_with_clarabel)
    theirs = minimax.solve(problem, start, tolerance=1e-6)
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
    assert (~information.determined).sum() >= 3
    found = minimax.solve(problem, start)
    change = (found.state.errors - start.state.errors) / information.scale
    assert np.abs(information.directions[:, ~information.determined].T @ change).max() < 1e-12
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


def model(seed=3):
    """Residuals and orthonormal derivatives of a least-squares fit."""
    problem, start, _ = simulated_imported("16", seed=seed)
    Q, _ = np.linalg.qr(problem.jacobian(start.state) @ start.information.basis())
    return problem.residuals(start.state), Q


def test_any_multipliers_give_a_true_bound():
    problem, start, _ = simulated_imported("16", seed=3)
    A = problem.jacobian(start.state) @ start.information.basis()
    Q, _ = np.linalg.qr(A)
    r = problem.residuals(start.state)
    z, w = minimax.solve_cone(r, Q, 1e-7)
    least = minimax.largest_distance(r - (Q @ z).reshape(-1, 3))
    assert minimax.certificate(r, Q, w)[1] == pytest.approx(least, rel=1e-6)
    rng = np.random.default_rng(4)
    for guess in [None, r, *(w + s * rng.standard_normal(w.shape) for s in (1e-4, 1e-3, 1e-2, 1.0))]:
        assert 0 <= minimax.certificate(r, Q, guess)[1] <= least


def test_clarabel_finds_the_same_minimum():
    r, Q = model()
    least = []
    for solver in (minimax.solve_cone, solve_cone_with_clarabel):
        z, w = solver(r, Q, 1e-7)
        least.append(minimax.largest_distance(r - (Q @ z).reshape(-1, 3)))
        assert minimax.certificate(r, Q, w)[1] == pytest.approx(least[-1], rel=1e-6)
    assert least[0] == pytest.approx(least[1], rel=1e-6)


def test_step_of_the_interior_point_method_solves_its_equations():
    """Against the whole linear system of primal, dual and complementarity, built entry by entry."""
    r, Q = model(4)
    m, n = len(r), Q.shape[1]
    rng = np.random.default_rng(5)

    def inside():
        x = rng.standard_normal((4, m))
        x[0] = np.linalg.norm(x[1:], axis=0) + rng.uniform(0.1, 1.0, m)
        return x

    s, z = inside(), inside()
    A = np.ascontiguousarray(Q.reshape(m, 3, n).transpose(2, 1, 0))
    v, beta = minimax._scaling(s, z)
    scaled = minimax._scaled
    assert np.abs(scaled(v, beta, z) - scaled(v, 1 / beta, s, -1.0)).max() < 1e-9 * np.abs(s).max()
    inverse = np.linalg.inv(minimax._normal_matrix(v, beta, A))
    q = rng.standard_normal((4, m))
    flat_A = A.reshape(n, 3 * m)
    dx, ds, dz = minimax._newton(v, beta, flat_A, inverse, np.zeros(n + 1), q)
    # s + G x is constant along the step, and the step of z leaves the equality constraints
    Gdx = np.concatenate([np.full((1, m), -dx[n]), (dx[:n] @ flat_A).reshape(3, m)])
    assert np.abs(scaled(v, beta, ds) + Gdx).max() < 1e-8 * np.abs(Gdx).max()
    back = scaled(v, 1 / beta, dz, -1.0)
    assert abs(back[0].sum()) < 1e-8 * np.abs(back[0]).sum()
    assert np.abs(flat_A @ back[1:].ravel()).max() < 1e-8 * np.abs(back).max()
    assert np.abs(ds + dz - q).max() < 1e-12


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
    found = minimax.nelder_mead(problem, start, first, iterations=50, objective=rms)
    assert found.value < found.history[0]
    assert found.value == pytest.approx(rms(history_module.distances(problem, found.state)), rel=1e-12)


def test_two_thousand_iterations_on_a_real_robot_do_worse_than_minimax(shared_data):
    points = cleaning.clean(table.read(shared_data / "irb120_laser_tracker" / "measurements.csv")).points
    problem, _ = fit.make_problem(urdf.read("irb120").arm, points.select(~held_out(points, 296, "last")), "34")
    start = least_squares.solve(problem, initial_guess.first_state(problem))
    found = minimax.nelder_mead(problem, start)
    best = minimax.solve(problem, start)
    assert found.iterations == 2000
    assert len(found.history) == 201
    assert best.value * 1.02 < found.value < 0.7 * found.history[0]
