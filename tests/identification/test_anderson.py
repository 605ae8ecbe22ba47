"""Anderson's method against closed forms."""

import numpy as np

from irbcal.identification.evidence_maximisation import Anderson


def test_a_linear_map_is_solved_in_as_many_steps_as_it_has_directions():
    rng = np.random.default_rng(3)
    directions = np.linalg.qr(rng.standard_normal((4, 4)))[0]
    A = directions @ np.diag([0.99, 0.9, -0.97, 0.5]) @ directions.T
    b = rng.standard_normal(4)
    ways, x = Anderson(longest=1e3), np.zeros(4)
    for _ in range(6):
        x = ways.after(x, A @ x + b)
    np.testing.assert_allclose(x, np.linalg.solve(np.eye(4) - A, b), rtol=1e-7)


def test_the_first_step_is_plain_and_none_is_longer_than_allowed():
    ways = Anderson(longest=0.5)
    assert ways.after(np.array([1.0]), np.array([1.4])).tolist() == [1.4]
    assert ways.after(np.array([1.4]), np.array([1.79])).tolist() == [1.9]  # the fixed point lies at 17
    ways.forget()
    assert ways.after(np.array([1.9]), np.array([2.0])).tolist() == [2.0]
