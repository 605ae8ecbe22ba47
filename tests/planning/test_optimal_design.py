"""What a pose says, against central differences, plain least squares and calibrations."""

import itertools

import numpy as np
import pytest
from design_support import KINDS, PLACES, TARGETS, poses, random_aim, random_candidates, without_errors
from support import arm, central_differences, measured, random_robot
from thesis_formula import ThesisMap, apply

from irbcal.errors import MeasurementError
from irbcal.identification.fit import identify
from irbcal.modeling import frames
from irbcal.planning import optimal_design
from irbcal.planning.optimal_design import Aim, Candidates, MeanSquaredError, Model
from irbcal.units import DEG, MM


def test_rows_are_derivatives_of_the_measured_points():
    """Against central differences of forward kinematics by base, targets and error parameters of level 34."""
    nominal = arm()
    q, seen = poses(12, 3)
    model = Model(nominal, TARGETS, "34", noise=0.2 * MM)
    phases = nominal.stiffness_geometry()[0]

    def points(x):
        table, joint_map = apply(model.parameters, x[15:], nominal.table, ThesisMap(phases=phases))
        T = nominal.with_table(table).forward(joint_map.effective(q))
        local = PLACES + x[6:15].reshape(3, 3)
        p = local @ np.swapaxes(T[:, :3, :3], 1, 2) + T[:, None, :3, 3]
        p = p @ frames.rotation_from_vector(x[:3]).T + x[3:6]
        return p[seen].ravel()

    J = central_differences(points, np.zeros(len(model.scale)), 1e-4)
    rows = model.rows(q, seen)
    filled = rows[(np.arange(3) < seen.sum(axis=1)[:, None]).repeat(3, axis=1)]
    assert np.abs(filled * model.noise / model.scale - J).max() < 1e-8
    assert np.abs(rows[~(np.arange(3) < seen.sum(axis=1)[:, None]).repeat(3, axis=1)]).max() == 0.0


def test_information_of_the_poses_is_that_of_a_calibration_with_them():
    nominal = arm()
    q, _ = poses(30, 5)
    model = Model(nominal, TARGETS, "26")
    robot = random_robot(
        nominal, "nominal", np.random.default_rng(0), targets=dict(zip(TARGETS.names, PLACES, strict=True))
    )
    fit = identify(nominal, measured(robot, q), "26")  # no errors: it ends where the plan is linearised
    H, _, _ = fit.problem.normal_equations(fit.solution.state)
    rows = model.rows(q, np.ones((30, 3), dtype=bool)).reshape(-1, len(model.scale))
    planned = rows.T @ rows * model.noise**2
    scaled = H * model.scale[:, None] * model.scale
    assert np.abs(planned - scaled).max() < 1e-6 * np.abs(scaled).max()


def test_the_criterion_position_is_the_error_of_least_squares_fits():
    """Noise and unmodelled errors put into plain ridge regressions: mean squared error in the volume."""
    rng = np.random.default_rng(0)
    X, E = rng.standard_normal((30, 6)), rng.standard_normal((30, 2))
    J, F = rng.standard_normal((50, 6)), rng.standard_normal((50, 2))
    aim = Aim(MeanSquaredError(J.T @ J / 50, J.T @ F / 50, float(np.sum(F**2)) / 50))
    stacked = np.vstack([X, np.eye(6)])
    bias = [J @ np.linalg.lstsq(stacked, np.append(E[:, k], np.zeros(6)), rcond=None)[0] - F[:, k] for k in range(2)]
    covariance = np.linalg.inv(X.T @ X + np.eye(6))
    expected = np.sum(np.square(bias)) / 50 + np.mean(np.sum((J @ covariance) * J, axis=1))
    assert aim.value(X[:, None], E[:, None]) == pytest.approx(expected, rel=1e-10)


def test_poses_that_are_there_anyway_count():
    candidates, aim = random_candidates(30, seed=5), random_aim("unmodelled")
    given = Candidates(candidates.rows[:4], candidates.errors[:4])
    both = aim.value(candidates.rows[:9], candidates.errors[:9])
    assert aim.with_given(given).value(candidates.rows[4:9], candidates.errors[4:9]) == pytest.approx(both, rel=1e-12)


def test_unmodelled_errors_have_the_size_asked_for_and_move_the_reflectors():
    nominal = arm()
    q, seen = poses(400, 11)
    model = Model(nominal, TARGETS, "34", noise=1.0)
    E = model.candidates(q, seen, 0.01 * DEG).errors
    size = np.sqrt(np.sum(E**2) / seen.sum())  # root of the mean squared distance over all unmodelled errors
    # six joints that err by 0.01 degrees move a point by their distances from the axes, tilts by about as much
    levers = []
    for joint in range(6):
        moved = q.copy()
        moved[:, joint] += 1e-6
        T, U = nominal.forward(q), nominal.forward(moved)
        points = [M[:, :3, :3] @ PLACES[0] + M[:, :3, 3] for M in (T, U)]
        levers.append(np.linalg.norm(points[1] - points[0], axis=1) / 1e-6)
    by_waves = 0.01 * DEG * np.sqrt(np.mean(np.sum(np.square(levers), axis=0)))
    assert by_waves < size < 2 * by_waves


@KINDS
def test_gains_are_the_differences_of_the_criterion(kind):
    """After poses came and went, against the criterion computed anew."""
    candidates, aim = without_errors(random_candidates(25), kind), random_aim(kind)
    ratings = optimal_design.Ratings(candidates, np.arange(25), aim)
    for k, sign in ((3, 1), (7, 1), (1, 1), (7, -1), (11, 1), (3, -1), (20, 1)):
        ratings.change(k, sign)
    chosen = [1, 11, 20]
    now = aim.value(candidates.rows[chosen], candidates.errors[chosen])
    with_each = [aim.value(candidates.rows[[*chosen, k]], candidates.errors[[*chosen, k]]) for k in range(25)]
    assert ratings.gains() == pytest.approx(now - np.array(with_each), rel=1e-8, abs=1e-10)


@KINDS
def test_exchange_finds_nearly_what_exhaustive_search_finds(kind):
    for seed in range(6):
        candidates, aim = without_errors(random_candidates(14, seed=seed), kind), random_aim(kind, seed=seed)
        values = np.array(
            [
                aim.value(candidates.rows[list(rows)], candidates.errors[list(rows)])
                for rows in itertools.combinations(range(14), 5)
            ]
        )
        found = optimal_design.exchange(candidates, 5, aim)
        assert (values < found.value - 1e-12).mean() <= 0.005, "among the best half per cent of 2002 plans"
        assert len(set(found.rows)) == 5


@KINDS
def test_exchange_is_never_worse_than_its_start(kind):
    candidates, aim = without_errors(random_candidates(60, seed=3), kind), random_aim(kind)
    rng = np.random.default_rng(4)
    for _ in range(5):
        start = rng.choice(60, 12, replace=False)
        found = optimal_design.exchange(candidates, 12, aim, start)
        assert found.start_value == aim.value(candidates.rows[start], candidates.errors[start])
        assert found.value <= found.start_value
        assert found.value == pytest.approx(aim.value(candidates.rows[found.rows], candidates.errors[found.rows]))


def test_an_optimal_plan_predicts_better_than_random_ones_of_its_size():
    model = Model(arm(), TARGETS, "34")
    q, seen = poses(300, 21)
    candidates = model.candidates(q, seen)
    aim = model.aim("position", arm().random_joints(100, 22), 0)
    found = optimal_design.exchange(candidates, 25, aim)
    rng = np.random.default_rng(23)
    rivals = [rng.choice(300, 25, replace=False) for _ in range(20)]
    assert found.value < min(aim.value(candidates.rows[rows], candidates.errors[rows]) for rows in rivals)
    again = optimal_design.exchange(candidates, 25, aim)
    assert (again.rows == found.rows).all()


def test_random_plans_to_compare_with():
    """Poses of one row each that measure one unknown alike: the variance is 1 / (1 + 9 n), whatever poses they are."""
    candidates = Candidates.without_errors(np.full((200, 1, 1), 3.0))
    aim = Aim(MeanSquaredError(np.eye(1), np.zeros((1, 0))))
    chosen = optimal_design.Chosen(np.arange(20), 1 / (1 + 9 * 50), 1.0, 0)  # as if 20 poses were as good as 50
    found = optimal_design.compare(candidates, chosen, aim)
    assert found.random == pytest.approx({n: 1 / (1 + 9 * n) for n in found.random})
    assert list(found.random) == [20, 25, 30, 40, 50, 60, 80, 120]
    assert found.as_good_as == 50
    assert (
        optimal_design.compare(candidates, optimal_design.Chosen(np.arange(20), 1e-9, 1.0, 0), aim).as_good_as is None
    )


def test_refusals():
    candidates = random_candidates(5)
    for count in (0, 6):
        with pytest.raises(MeasurementError, match=f"between 1 and 5 poses of as many candidates, found {count}"):
            optimal_design.exchange(candidates, count, random_aim("unmodelled"))
    with pytest.raises(MeasurementError, match="unknown criterion 'A': choose one of position, D"):
        Model(arm(), TARGETS, "11").aim("A", arm().random_joints(1, 1))
