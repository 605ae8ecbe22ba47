import feature_cases as cases
import numpy as np
import pandas as pd

from irbcal.identification.feature_problem import BASE, FeatureProblem, rigid, start
from irbcal.measurement import features
from irbcal.modeling import frames


def test_known_places_tie_the_base_to_their_frame():
    """Three sockets measured on a CMM, touched by an exact robot: its base in their frame comes out."""
    nominal, T = cases.arm(), cases.world()
    table, known = cases.rows("point", nominal, 12, 4)
    free = FeatureProblem(nominal, features.read(table, known.fillna(""), nominal), [])
    found = start(free)
    assert BASE not in free.layout
    for k in range(3):
        centre = T[:3, :3] @ found.own["centre", f"point {k}"] + T[:3, 3]
        known.loc[k, ["x_mm", "y_mm", "z_mm"]] = centre * 1e3
    problem = FeatureProblem(nominal, features.read(table, known.fillna(""), nominal), [])
    state = start(problem)
    np.testing.assert_allclose(state.T_world_base, T, atol=1e-9)
    np.testing.assert_allclose(state.own["tool", "ball"], cases.TOOL, atol=1e-9)


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
    np.testing.assert_allclose(state.own["tool", "ball"], cases.TOOL, atol=1e-8)


def test_a_rigid_motion_is_found_again():
    places = np.random.default_rng(0).standard_normal((4, 3))
    np.testing.assert_allclose(rigid(places, frames.apply(cases.world(), places)), cases.world(), atol=1e-12)
