"""Columns of the terms against differences of a robot whose joints are turned by each."""

from dataclasses import replace

import numpy as np
from moving import random_commands, simulated
from support import measured

from irbcal.joint_behaviour import columns
from irbcal.joint_behaviour.linearised import Linearised
from irbcal.joint_behaviour.terms import Term


def test_columns_are_derivatives_of_the_points():
    """Against differences of a robot whose joints are turned by each term."""
    points, step, robot = simulated(random_commands(20, 5))
    robot = robot.replace(T_world_base=np.eye(4))
    points = replace(measured(robot, points.q), q=points.q)
    model = Linearised(robot, points, step)
    size = 1e-6

    def moved(effective):
        return (measured(robot, effective).xyz - measured(robot, points.q).xyz).reshape(-1) / size

    def shift(j, by):
        out = points.q.copy()
        out[:, j] += size * by
        return out

    known = np.nan_to_num(step)
    q6 = points.q[:, 5]
    cases = [
        (Term("backlash", 2, ("backlash",)), [shift(1, -0.5 * np.sign(known[:, 1]))]),
        (Term("move", 3, ("per_move",)), [shift(2, known[:, 2])]),
        (Term("gain", 5, ("gain",)), [shift(4, points.q[:, 4])]),
        (
            Term("fourier", 6, ("a1", "b1"), frequency=(3.0,)),
            [shift(5, np.cos(3 * q6)), shift(5, np.sin(3 * q6))],
        ),
    ]
    for term, effectives in cases:
        X = columns.of_term(model, term) / model.weight[:, None]
        for k, effective in enumerate(effectives):
            assert np.abs(X[:, k] - moved(effective)).max() < 1e-5
        assert columns.names_of(term) == term.names
    assert columns.names_of(Term("stiffness", None, ("A",))) == ("A", "B")
    assert columns.of_term(model, Term("stiffness", None)).shape[1] == 2
