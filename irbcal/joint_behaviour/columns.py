"""What each term does to the points: derivatives by its coefficients, beside a linearised robot."""

from __future__ import annotations

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.joint_behaviour.linearised import Linearised
from irbcal.joint_behaviour.terms import Term, fourier_columns, fourier_names, fourier_order
from irbcal.modeling import parameters


def by_play(model: Linearised) -> FloatArray:
    """By the backlash of each joint: reached from below, half of it is missing; shape (3 rows, joints)."""
    return -0.5 * model.per_joint(np.sign(model.step))


def by_move(model: Linearised) -> FloatArray:
    """By the error of each joint per radian of its last move; shape (3 rows, joints)."""
    return model.per_joint(model.step)


def by_gain(model: Linearised, j: int) -> tuple[FloatArray, tuple[str, ...]]:
    """By the gain of a joint (Nubiola 2011, eq. 3.31), and what of the joint map it takes the place of."""
    name = f"gain{j + 1}"
    return model.maps[name][:, None], (name,)


def by_series(model: Linearised, j: int, order: int, frequency: float) -> tuple[FloatArray, tuple[str, ...]]:
    """By the coefficients of a joint's `fourier_columns`, and what of the joint map it replaces."""
    own = j == 5 and model.robot.arm.six_revolute
    X = model.turn[:, j : j + 1] * fourier_columns(model.q[:, j], order, frequency)[model.flat_pose]
    return X, tuple(f"fourier_{name}" for name in parameters.FOURIER) if own else ()


def by_stiffness(model: Linearised) -> tuple[FloatArray, tuple[str, ...]]:
    """By A and B of the bending arm (`Stiffness.coefficients`), and what of the joint map they replace."""
    names = ("stiffness_A", "stiffness_B")
    return np.stack([model.maps[name] for name in names], axis=1), names


def of_term(model: Linearised, term: Term) -> FloatArray:
    """Of a term that was tested, shape (3 rows, k)."""
    if term.kind == "stiffness" or term.joint is None:
        return by_stiffness(model)[0]
    j = term.joint - 1
    if term.kind == "backlash":
        return by_play(model)[:, j : j + 1]
    if term.kind == "move":
        return by_move(model)[:, j : j + 1]
    if term.kind == "gain":
        return by_gain(model, j)[0]
    frequency = 1.0 if term.frequency is None else term.frequency[0]
    return by_series(model, j, fourier_order(term), frequency)[0]


def names_of(term: Term) -> tuple[str, ...]:
    """Names of the coefficients that the columns of `of_term` belong to, seen or not."""
    if term.kind == "stiffness":
        return ("A", "B")
    return fourier_names(fourier_order(term)) if term.kind == "fourier" else term.names
