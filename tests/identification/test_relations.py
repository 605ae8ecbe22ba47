"""What is known between two features: derivatives, and a known angle that is recovered."""

from dataclasses import replace

import feature_cases as cases
import numpy as np
import pandas as pd
import pytest
from support import assert_derivative

import irbcal
from irbcal.errors import MeasurementError
from irbcal.identification.feature_fit import held_out, identify_features
from irbcal.identification.feature_problem import FeatureProblem, settle, start
from irbcal.identification.observation_kind import DIMENSIONS, moved
from irbcal.identification.relations import RELATION_KINDS
from irbcal.measurement import features
from irbcal.modeling import frames
from irbcal.units import DEG, MM

A, B = (frames.rotation_from_vector(np.array(w)) for w in ([0.3, -0.2, 0.9], [1.1, 0.7, -0.4]))
CASES = [
    ("distance", "place", np.array([0.1, 0.2, 0.3]), "place", np.array([0.4, 0.6, 0.3]), 0.5),
    ("angle-between", "axis", A, "axis", B, np.arccos(A[:, 2] @ B[:, 2])),
    ("angle-between", "axis", -A @ np.diag([1, -1, 1]), "axis", B, np.arccos(A[:, 2] @ B[:, 2])),
    ("angle-between", "line", np.column_stack([A, [1, 2, 3]]), "axis", B, np.arccos(A[:, 2] @ B[:, 2])),
]


@pytest.mark.parametrize(("name", "first_shape", "first", "second_shape", "second", "true"), CASES)
def test_residuals_are_known_minus_predicted_with_their_derivatives(
    name, first_shape, first, second_shape, second, true
):
    kind, at = RELATION_KINDS[name], DIMENSIONS[first_shape]
    residual, by = kind.residual(first, second, true + 0.01)
    assert residual == pytest.approx(0.01, abs=1e-12)

    def predicted(step):
        ends = moved(first_shape, first, step[:at]), moved(second_shape, second, step[at:])
        return np.array([-kind.residual(*ends, true + 0.01)[0]])

    assert_derivative(predicted, np.zeros(at + DIMENSIONS[second_shape]), np.concatenate(by), 1e-8, 1e-5)


def planes(noise, **relation):
    """SIMULATED contacts with three planes, what is known of them, and the true angle of the first two, degrees."""
    truth = cases.true_arm(cases.arm(), 3)
    table, known = cases.rows("plane", truth, 40, 2, noise)
    normals = []
    for k in range(2):
        p = cases.tip(truth, np.radians(table[table.feature == f"plane {k}"].filter(regex="^q").to_numpy(float)))[0]
        normals.append(np.linalg.svd(p - p.mean(axis=0))[2][2])
    angle = np.degrees(np.arccos(abs(normals[0] @ normals[1])))
    row = {"feature": "corner", "kind": "angle-between", "first": "plane 0", "second": "plane 1"} | relation
    row.setdefault("angle_deg", angle)
    return truth, table, pd.concat([known, pd.DataFrame([row])]).astype(object).fillna(""), angle


def test_a_known_angle_is_recovered():
    """The nominal robot bends the planes; a known angle straightens them as far as it is certain."""
    _, table, known, angle = planes(0.0, u95_deg=1e-4)
    errors = []
    for given in (known[known.kind == "plane"], known):
        problem = FeatureProblem(cases.arm(), features.read(table, given, cases.arm()), [])
        values = settle(problem, start(problem)).values
        cosine = values["normal", "plane 0"][:, 2] @ values["normal", "plane 1"][:, 2]
        errors.append(np.degrees(np.arccos(abs(cosine))) - angle)
    assert abs(errors[0]) > 0.01
    assert abs(errors[1]) < 0.02 * abs(errors[0])


def test_a_known_angle_stands_in_the_record_and_is_doubted_where_it_is_wrong(tmp_path):
    """Degrees, known minus fitted; a bar between two balls tells the size of the arm."""
    truth, table, known, angle = planes(1e-5)
    balls, of_balls = cases.rows("point", truth, 20, 5, 1e-5)
    rows = pd.concat([table, balls]).assign(simulated="yes")
    p = [
        cases.tip(truth, np.radians(balls[balls.feature == f"point {k}"].filter(regex="^q").to_numpy(float)))[0]
        for k in (0, 1)
    ]
    length = np.linalg.norm(p[0].mean(axis=0) - p[1].mean(axis=0)) / MM
    bar = {"feature": "bar", "kind": "distance", "first": "point 0", "second": "point 1", "length_mm": length}
    known = pd.concat([known, of_balls, pd.DataFrame([bar])]).astype(object).fillna("")
    for wrong in (0.0, 1.0):
        known.loc[known.kind == "angle-between", "angle_deg"] = angle + wrong
        record = irbcal.calibrate(rows, "irb1600", "26", features=known, leave_out="none").record
        row = next(row for row in record.features.relations if row.kind == "angle-between")
        assert (row.unit, row.known, row.heldout) == ("deg", pytest.approx(angle + wrong), None)
        assert any(doubt.startswith("The known angle corner is ") for doubt in record.doubts) is bool(wrong)
        assert row.fitted > 0.05 if wrong else abs(row.fitted) < 0.05


def test_left_out_features_are_not_placed_by_what_is_known_between_them():
    """Else the residual would be smaller than the known value is wrong: here both robots' change by as much."""
    truth, table, known, angle = planes(1e-5)
    rows = features.read(table, known, cases.arm())
    fit = identify_features(cases.arm(), cases.seen("point", truth, 20, 5, 1e-5), choices=[()], bare=True)
    left_out, *others = (
        replace(rows, relations=(replace(rows.relations[0], value=(angle + wrong) * DEG),)) for wrong in (0.0, 0.5, 1.0)
    )
    for calibrated in (False, True):
        residual = held_out(fit, left_out, calibrated, left_out.relations)[1]["corner"]
        for other, wrong in zip(others, (0.5, 1.0), strict=True):
            changed = held_out(fit, other, calibrated, other.relations)[1]["corner"]
            assert changed - residual == pytest.approx(wrong * DEG, abs=1e-6 * DEG)


@pytest.mark.parametrize(
    ("relation", "sentence"),
    [
        ({"angle_deg": ""}, "kind angle-between needs first, second and angle_deg"),
        ({"angle_deg": 0.5}, "an angle from 1 to 179 degrees"),
        ({"u95_mm": 0.1}, "takes u95_deg, found u95_mm"),
        ({"kind": "distance", "length_mm": 40.0}, "corner: distance is known between features of the kinds point"),
    ],
)
def test_what_cannot_be_known_of_an_angle_is_refused(relation, sentence):
    _, table, known, _ = planes(0.0, **relation)
    with pytest.raises(MeasurementError, match=sentence):
        FeatureProblem(cases.arm(), features.read(table, known, cases.arm()), [])


def test_a_length_to_a_feature_whose_place_is_stated_is_not_used_and_said_to_be():
    truth = cases.true_arm(cases.arm(), 3)
    tables, features_of = zip(*(cases.rows("point", truth, 30, seed, 1e-5) for seed in (2, 5)), strict=True)
    stated, sought = tables[0], tables[1].assign(feature="sought " + tables[1].feature, pose="b " + tables[1].pose)
    known = pd.concat([features_of[0], features_of[1].assign(feature="sought " + features_of[1].feature)])
    for name in stated.feature.unique():
        q = np.radians(stated[stated.feature == name].filter(regex="^q").to_numpy(float))
        known.loc[known.feature == name, ["x_mm", "y_mm", "z_mm"]] = cases.tip(truth, q)[0].mean(axis=0) / MM
    bar = {"feature": "bar", "kind": "distance", "first": "point 0", "second": "sought point 1", "length_mm": 400.0}
    known = pd.concat([known, pd.DataFrame([bar])]).astype(object)
    rows = pd.concat([stated, sought]).assign(simulated="yes")
    known = known.where(known.notna(), "")
    record = irbcal.calibrate(rows, "irb1600", "26", features=known, leave_out="none").record
    assert not record.features.relations
    assert any(note.startswith("bar is not used") for note in record.notes)
