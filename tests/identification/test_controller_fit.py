"""A controller's numbers against models that are known, with joints and poses in no relation but the model's."""

import numpy as np
import pytest
from support import arm, random_robot

from irbcal.errors import IdentificationError
from irbcal.identification.controller_fit import differences, fit_controller
from irbcal.modeling import frames

NOMINAL = arm()
Q = NOMINAL.random_joints(120, 3)


def changed(**columns):
    """The arm with numbers changed: column -> (joint, by how much)."""
    import dataclasses

    table = NOMINAL.table
    for name, (joint, by) in columns.items():
        values = getattr(table, name).copy()
        values[joint - 1] += by
        table = dataclasses.replace(table, **{name: values})
    return NOMINAL.with_table(table)


def rounded(T, digits=7):
    """Poses as a controller shows them: rounded to so many digits of metres."""
    return np.round(T, digits)


def test_equal_numbers_are_equal():
    fit = fit_controller(NOMINAL, Q, rounded(NOMINAL.forward(Q)), "f")
    assert fit.names == ()
    assert not fit.nearly_all
    assert fit.fitted_errors[:, 0].max() < 2e-7


def test_few_other_numbers_are_found():
    controller = changed(d=(4, 2e-4), theta=(3, 1e-3), a=(2, -5e-4))
    fit = fit_controller(NOMINAL, Q, rounded(controller.forward(Q)), "f")
    assert dict(zip(fit.names, fit.values, strict=True)) == pytest.approx(
        {"a2": -5e-4, "theta3": 1e-3, "d4": 2e-4}, abs=3e-7
    )
    assert np.abs(fit.arm.forward(Q) - controller.forward(Q)).max() < 1e-6


def test_rows_of_another_moment_do_not_bend_it():
    rng = np.random.default_rng(5)
    T = rounded(changed(d=(4, 2e-4)).forward(Q))
    wrong = np.sort(rng.choice(len(Q), 30, replace=False))
    T[wrong] = NOMINAL.forward(Q[wrong] + rng.uniform(0.01, 0.1, (30, 6)))
    fit = fit_controller(NOMINAL, Q, T, "f")
    assert np.flatnonzero(fit.moment).tolist() == wrong.tolist()
    assert fit.names == ("d4",)
    assert fit.values == pytest.approx([2e-4], abs=1e-7)


def test_many_small_differences_are_an_option_that_is_on():
    robot = random_robot(NOMINAL, "26", np.random.default_rng(1))
    fit = fit_controller(NOMINAL, Q, robot.arm.forward(Q), "f")
    assert fit.nearly_all
    assert fit.fitted_errors[:, 0].max() < 1e-9


@pytest.mark.parametrize("few", [{}, {"d": (4, 2e-4)}])
def test_another_base_and_tool_are_frames(few):
    base = frames.transform(frames.rot_z(0.3), [0.1, 0.2, 0.3])
    tool = frames.transform(frames.rot_x(0.3), [0.0, 0.05, 0.2])
    fit = fit_controller(NOMINAL, Q, base @ changed(**few).forward(Q) @ tool, "f")
    assert fit.frames_differ
    assert fit.names == tuple(f"{kind}{joint}" for kind, (joint, _) in few.items())
    assert fit.fitted_errors[:, 0].max() < 1e-8
    assert np.abs(fit.T_base - base).max() < 1e-8
    assert np.abs(fit.T_base @ fit.arm.forward(Q) @ fit.T_tool - base @ changed(**few).forward(Q) @ tool).max() < 1e-8


def test_a_tool_that_differs_a_little_is_told_as_numbers():
    tool = frames.transform(None, [0.0, 0.0, 1e-4]) @ frames.transform(frames.rot_x(2e-4), [3e-4, 0.0, 0.0])
    fit = fit_controller(NOMINAL, Q, NOMINAL.forward(Q) @ tool, "f")
    assert fit.fitted_errors.max() < 1e-8
    assert {"tool_x", "tool_rx"} <= set(fit.names)


def test_a_slip_is_named_and_another_robot_refused():
    q = Q * [1, 1, -1, 1, 1, 1]
    with pytest.raises(IdentificationError, match="joint 3"):
        fit_controller(NOMINAL, q, NOMINAL.forward(Q), "f")
    with pytest.raises(IdentificationError, match="wrong robot file"):
        fit_controller(arm("irb120"), Q, NOMINAL.forward(Q), "f")


def test_differences_are_small_motions_of_the_tip():
    small = frames.transform(frames.rotation_from_vector([1e-4, -2e-4, 3e-4]), [1e-4, 2e-4, -3e-4])
    T = NOMINAL.forward(Q[:4])
    assert np.abs(differences(T, T @ small) - [1e-4, 2e-4, -3e-4, 3e-5, -6e-5, 9e-5]).max() < 1e-11
