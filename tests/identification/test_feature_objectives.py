"""Rows at features by largest distance, p-norm and robust losses: the solvers of a tracker's points serve them, too."""

import feature_cases as cases
import numpy as np
import pandas as pd
import pytest
from support import central_differences, measured, random_robot

import irbcal
from irbcal.errors import OptionError
from irbcal.identification import fit, initial_guess, least_squares, minimax, robust
from irbcal.identification.choices import Goal
from irbcal.identification.feature_fit import LEAST_SQUARES, held_out, identify_features
from irbcal.identification.feature_objectives import FeatureVectors, minimise
from irbcal.identification.feature_problem import FeatureProblem, start
from irbcal.measurement import features
from irbcal.modeling.parameters import level_parameters, term_of

LEVEL = level_parameters("26")


@pytest.fixture(scope="module")
def tracked():
    """SIMULATED points of a tracker, as points and as rows at features."""
    nominal, rng = cases.arm(), np.random.default_rng(0)
    points = measured(random_robot(nominal, "26", rng, 0.3), nominal.random_joints(20, 0), 5e-5, rng)
    table = pd.DataFrame(np.degrees(points.q[points.pose]), columns=[f"q{k}_deg" for k in range(1, 7)])
    table[["x_mm", "y_mm", "z_mm"]] = points.xyz * 1e3
    table["target"] = np.array(points.target_names)[points.target]
    return points, features.read(table.assign(kind="point", pose=points.pose), None, nominal)


@pytest.mark.parametrize(
    ("goal", "tolerance"), [(Goal("max"), 1e-3), (Goal("pnorm", 8.0), 1e-4), (Goal(loss="huber"), 1e-4)]
)
def test_a_tracker_s_points_give_the_same_minimum_as_rows(tracked, goal, tolerance):
    """The oracle is the fast path for a tracker's points, from its own start."""
    points, rows = tracked
    problem, _ = fit.make_problem(cases.arm(), points, "26")
    first = least_squares.solve(problem, initial_guess.first_state(problem))
    expected = (
        minimax.solve(problem, first).value
        if goal.objective == "max"
        else robust.solve_p_norm(problem, first, 8.0).value
        if goal.objective == "pnorm"
        else robust.solve_loss(problem, first, "huber").value
    )
    evidence_fit = identify_features(cases.arm(), rows, LEVEL, bare=True)
    assert minimise(evidence_fit.problem, evidence_fit.state, goal).value == pytest.approx(expected, rel=tolerance)


@pytest.mark.parametrize("kind", ["sphere", "pose", "radius", "line", "image"])
def test_derivatives_of_the_vectors(kind):
    # residuals of images are taken as small: their scale, the distance of the board, counts as constant
    truth = cases.arm() if kind == "image" else cases.true_arm(cases.arm(), 3)
    rows = cases.seen(kind, truth, 6, 1)
    problem = FeatureProblem(cases.arm(), rows, [term_of(item, cases.arm()) for item in LEVEL[:4]])
    state = start(problem)
    vectors = FeatureVectors(problem, state)
    r = vectors.residuals(state)
    assert r.shape == (vectors.rows, 3)
    assert np.count_nonzero(r) <= vectors.equations
    numeric = central_differences(
        lambda step: -vectors.residuals(vectors.moved(state, step)).ravel(), np.zeros(problem.nuisance + 4), 1e-4
    )
    analytic = vectors.jacobian(state)
    assert np.abs(analytic - numeric).max() < 1e-6 * np.abs(analytic).max()


@pytest.mark.parametrize("loss", ["huber", "soft_l1"])
def test_slipped_rows_hardly_move_a_robust_fit(loss):
    """SIMULATED sockets: 8 of 120 rows slipped by some 6 mm; the oracle is the fit without slips."""
    table, known = cases.rows("point", cases.true_arm(cases.arm(), 7, lengths=False), 40, 2, 2e-5)
    rng = np.random.default_rng(1)
    slipped = table.copy()
    joints = [f"q{k}_deg" for k in range(1, 7)]
    slipped.loc[rng.choice(len(table), 8, replace=False), joints] += 0.4 * rng.standard_normal((8, 6))
    level = [p for p in LEVEL if not p.name.startswith(("delta_a", "delta_d"))]
    q = cases.arm().random_joints(50, 1) * 0.5

    def shift(goal):
        clean, fitted = (
            identify_features(cases.arm(), features.read(rows, known, cases.arm()), level, bare=True, goal=goal)
            for rows in (table, slipped)
        )
        return cases.apart(clean.arm, fitted.arm, q, fitted.targets["ball"]).mean()

    assert shift(Goal(loss=loss)) < 0.2 * shift(LEAST_SQUARES)


def test_a_calibration_by_the_largest_distance_proves_its_minimum(tmp_path):
    table, known = cases.rows("point", cases.true_arm(cases.arm(), 7, lengths=False), 25, 4, 5e-5)
    result = irbcal.calibrate(table, "irb1600", "26", features=known, objective="max", leave_out="none")
    result.save(tmp_path / "robot")
    objective = irbcal.load(tmp_path / "robot").record.objective
    assert objective.name == "max"
    assert 0.999 * objective.value_mm <= objective.lower_bound_mm <= objective.value_mm
    with pytest.raises(OptionError, match="goes with objective rms"):
        irbcal.calibrate(table, "irb1600", "26", features=known, objective="max", loss="huber")
    with pytest.raises(OptionError, match="method: rows at features do not take it"):
        irbcal.calibrate(table, "irb1600", "26", features=known, method="nelder-mead")


def test_places_are_left_out_of_the_same_fit():
    """The oracle is the fit to the rows of the other places, made by hand."""
    table, known = cases.rows("point", cases.true_arm(cases.arm(), 7, lengths=False), 20, 4, 5e-5)
    result = irbcal.calibrate(table, "irb1600", "26", features=known, objective="pnorm")
    proof = {place.name: place for place in result.record.features.places}
    rows = features.read(table, known, cases.arm())
    away = rows.feature == "point 1"
    rest = identify_features(cases.arm(), rows.select(~away), LEVEL, bare=True, goal=Goal("pnorm"))
    assert proof["point 1"].mean_mm == pytest.approx(held_out(rest, rows.select(away))[0].mean() * 1e3, rel=1e-6)
