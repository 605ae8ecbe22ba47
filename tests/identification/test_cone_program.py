"""The convex model of the largest distance, its bounds, and a second solver."""

import numpy as np
import pytest
from simulated_fit import simulated

from irbcal.identification import minimax


def model(seed=3):
    """Residuals and orthonormal derivatives of a least-squares fit."""
    problem, start, _ = simulated("16", seed=seed)
    Q, _ = np.linalg.qr(problem.jacobian(start.state) @ start.information.basis())
    return problem.residuals(start.state), Q


def test_any_multipliers_give_a_true_bound():
    problem, start, _ = simulated("16", seed=3)
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
    pytest.importorskip("clarabel")
    r, Q = model()
    least = []
    for solver in minimax.SOLVERS.values():
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
