"""Tests."""

import feature_cases as cases
import numpy as np
import pandas as pd
import pytest

from irbcal.errors import IdentificationError, MeasurementError
from irbcal.identification import term_sets
from irbcal.identification.feature_problem import BASE, FeatureProblem, FeatureState, start
from irbcal.identification.relations import RELATION_KINDS
from irbcal.measurement import features
from irbcal.modeling import frames


@pytest.fixture(scope="module")
def mixed():
    """Balls of known places, planes, what is known between them and a tracker's points, with all terms."""
    truth, nominal = cases.true_arm(cases.arm(), 3), cases.arm()
    tables = [cases.rows(kind, truth, 15, seed) for seed, kind in enumerate(("sphere", "point", "plane"))]
    T, known = cases.world(), pd.concat([one for _, one in tables])
    centres = {}
    rng = np.random.default_rng(0)
    for k in range(3):
        centres[f"sphere {k}"] = T[:3, :3] @ cases.unknowns("sphere", rng)["centre"] + T[:3, 3]
        break  # others are drawn after the rows of the first
    for name, centre in centres.items():
        known.loc[known.feature == name, ["x_mm", "y_mm", "z_mm"]] = centre * 1e3
    q = nominal.random_joints(15, 9) * 0.7
    xyz = (cases.tip(truth, q)[0] @ T[:3, :3].T + T[:3, 3]) * 1e3
    tracked = pd.DataFrame(np.degrees(q), columns=[f"q{k}_deg" for k in range(1, 7)])
    tracked[["x_mm", "y_mm", "z_mm"]] = xyz
    tracked["pose"] = [f"t{k}" for k in range(15)]
    length = {"feature": "bar", "kind": "distance", "first": "point 0", "second": "point 1", "length_mm": 400}
    angle = {"feature": "corner", "kind": "angle-between", "first": "plane 0", "second": "plane 1", "angle_deg": 40}
    known = pd.concat([known, pd.DataFrame([length, angle])]).astype(object)
    rows = pd.concat([*(one for one, _ in tables), tracked])
    seen = features.read(rows.astype(object).where(rows.notna(), ""), known.where(known.notna(), ""), nominal)
    return FeatureProblem(nominal, seen, term_sets.superset(nominal, "joint-map", False, None, [])[:90])


def test_the_linear_model_is_that_of_central_differences(mixed):
    state = start(mixed)
    rng = np.random.default_rng(1)
    nuisance, width = mixed.nuisance, mixed.nuisance + len(mixed.terms)
    assert BASE in mixed.layout
    assert [relation.kind for relation in mixed.relations] == [*RELATION_KINDS]
    state = FeatureState(state.values, 0.3 * mixed.sizes[nuisance:] * rng.standard_normal(len(mixed.terms)))

    def model(one):
        blocks = list(mixed.dense(one))
        values = one.coefficients / mixed.sizes[nuisance:]
        J = np.concatenate([b.J for b in blocks], axis=1)
        return J, values @ J[nuisance:] - np.concatenate([b.y for b in blocks])

    J, _ = model(state)
    for k in [*range(0, nuisance, 3), *rng.choice(np.arange(nuisance, width), 8, replace=False)]:
        ends = []
        for h in (1e-3, -1e-3):
            step = np.zeros(width)
            step[nuisance:] = state.coefficients / mixed.sizes[nuisance:]
            step[k] += h
            ends.append(model(mixed.moved(state, step))[1])
        np.testing.assert_allclose(J[k], (ends[0] - ends[1]) / 2e-3, atol=2e-5 * max(1.0, np.abs(J[k]).max()))


def test_what_a_row_lacks_is_named():
    nominal = cases.arm()
    rows = pd.DataFrame({f"q{k}_deg": [1.0, 2.0] for k in range(1, 7)} | {"pose": ["1", "2"], "feature": "s"})
    with pytest.raises(MeasurementError, match=r"row 2.*a row of kind radius needs value_mm") as raised:
        FeatureProblem(nominal, features.read(rows.assign(kind="radius", value_mm=["3", ""]), None, nominal), [])
    assert raised.value.column == "value_mm"
    with pytest.raises(MeasurementError, match=r"unknown kind 'ball'.*point, sphere"):
        FeatureProblem(nominal, features.read(rows.assign(kind="ball"), None, nominal), [])
    with pytest.raises(MeasurementError, match=r"needs xyz \(or the name of the feature"):
        FeatureProblem(nominal, features.read(rows.assign(kind="point", feature=""), None, nominal), [])


def test_what_rows_leave_open_is_named():
    """One socket, the wrist never turned: the tool's place and the socket's move together."""
    nominal = cases.arm()
    q = np.tile(nominal.random_joints(1, 0) * 0.5, (20, 1))
    q[:, 0] = np.linspace(-0.5, 0.5, 20)
    table = pd.DataFrame(np.degrees(q), columns=[f"q{k}_deg" for k in range(1, 7)])
    table["pose"], table["feature"], table["kind"] = range(20), "s", "plane"
    problem = FeatureProblem(nominal, features.read(table, None, nominal), [])
    with pytest.raises(IdentificationError, match="these rows do not determine"):
        start(problem)


def test_known_places_tie_the_base_to_their_frame():
    """Three sockets measured on a CMM, touched by an exact robot: its base in their frame comes out."""
    nominal, T = cases.arm(), cases.world()
    table, known = cases.rows("point", nominal, 12, 4)
    free = FeatureProblem(nominal, features.read(table, known.fillna(""), nominal), [])
    found = start(free)
    assert BASE not in free.layout
    for k in range(3):
        centre = T[:3, :3] @ found.values["centre", f"point {k}"] + T[:3, 3]
        known.loc[k, ["x_mm", "y_mm", "z_mm"]] = centre * 1e3
    problem = FeatureProblem(nominal, features.read(table, known.fillna(""), nominal), [])
    state = start(problem)
    np.testing.assert_allclose(state.T_world_base, T, atol=1e-9)
    np.testing.assert_allclose(state.values["tool", "ball"], cases.TOOL, atol=1e-9)


def test_a_tracker_and_a_ball_share_the_tool():
    nominal, T = cases.arm(), cases.world()
    table, known = cases.rows("sphere", nominal, 12, 4)
    q = nominal.random_joints(10, 9) * 0.7
    tracked = pd.DataFrame(np.degrees(q), columns=[f"q{k}_deg" for k in range(1, 7)])
    tracked[["x_mm", "y_mm", "z_mm"]] = frames.apply(T, cases.tip(nominal, q)[0]) * 1e3
    rows = pd.concat([table, tracked.assign(pose=range(10))]).astype(object)
    seen = features.read(rows.where(rows.notna(), ""), known.fillna(""), nominal)
    state = start(FeatureProblem(nominal, seen, []))
    np.testing.assert_allclose(state.T_world_base, T, atol=1e-8)
    np.testing.assert_allclose(state.values["tool", "ball"], cases.TOOL, atol=1e-8)


@pytest.mark.parametrize(("kind", "wrong"), [("angle", "value_mm"), ("radius", "value_deg")])
def test_a_value_in_another_unit_than_its_kind_has_is_refused(kind, wrong):
    rows = pd.DataFrame({f"q{k}_deg": [10.0 * k, 20.0] for k in range(1, 7)} | {"pose": ["1", "2"], "feature": "A"})
    right = {"angle": "value_deg", "radius": "value_mm"}[kind]
    for row, cells in ((1, {wrong: 5.0}), (2, {right: [5.0, ""], wrong: ["", 5.0]})):
        with pytest.raises(MeasurementError, match=f"row {row}, column {wrong}: .* takes {right}, found {wrong}"):
            features.read(rows.assign(kind=kind, **cells), None, cases.arm())
    # of both the one of the kind counts
    both = features.read(rows.assign(kind=kind, **{right: 5.0, wrong: 7.0}), None, cases.arm())
    assert both.value == pytest.approx([{"angle": np.radians(5.0), "radius": 0.005}[kind]] * 2)


def test_the_stated_uncertainty_of_an_angle_counts_at_the_lever():
    rows = pd.DataFrame({f"q{k}_deg": [10.0 * k, 20.0] for k in range(1, 7)} | {"pose": ["1", "2"]})
    rows = rows.assign(feature=["A", "B"], kind=["radius", "angle"], value_mm=[5.0, ""], value_deg=["", 5.0])
    for stated, features_file in (
        (rows.assign(u95_mm=[0.1, ""], u95_deg=["", 0.02]), None),
        (rows, pd.DataFrame([["A", "radius", "0.1", ""], ["B", "angle", "", "0.02"]]).set_axis(KNOWN, axis=1)),
    ):
        problem = FeatureProblem(cases.arm(), features.read(stated, features_file, cases.arm()), [])
        # 0.02 degrees, 0.3 m away: 0.1047 mm
        assert problem.weights[0] / problem.weights[1] == pytest.approx(0.10472 / 0.1, rel=1e-4)


KNOWN = ["feature", "kind", "u95_mm", "u95_deg"]
