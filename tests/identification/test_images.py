"""Images; derivatives and truth without noise of both kinds are in test_observations.py."""

import re

import feature_cases as cases
import numpy as np
import pandas as pd
import pytest

from irbcal.identification.feature_fit import identify_features
from irbcal.identification.feature_problem import FeatureProblem, start
from irbcal.measurement import features
from irbcal.measurement.imaging import FITTED, TARGETS
from irbcal.measurement.pinhole import boards
from irbcal.modeling import frames
from irbcal.modeling.terms.geometry import FAMILY as GEOMETRY

TRUTH = cases.true_arm(cases.arm(), 3)


@pytest.fixture(scope="module")
def fitted():
    """SIMULATED images with 0.1 px of noise, and a fit of robot and lens."""
    seen = cases.seen("image-on-tool", TRUTH, 14, 0, 5e-5, fit=" ".join(FITTED))
    return identify_features(cases.arm(), seen, choices=[()])


def whole(problem, state):
    """Every corner's miss in the unit of residuals, image by image, by plain projection."""
    for one in problem.group_residuals(state):
        uv = cases.in_image(
            cases.LENS_OF, cases.before_camera(one.group.kind.name, one.observed.p, one.observed.R, dict(one.values))
        )
        seen = one.observed.corners
        pixel = np.sqrt(seen[..., :2].var(axis=1).sum(axis=1) / seen[..., 2:4].var(axis=1).sum(axis=1))
        yield one, (seen[..., 2:4] - uv) * pixel[:, None, None]


@pytest.mark.parametrize("kind", TARGETS)
def test_reduced_residuals_tell_what_all_corners_tell(kind):
    """Gradient and curvature by the tool's point, with corners that miss by tenths of a millimetre."""
    problem = FeatureProblem(cases.arm(), cases.seen(kind, TRUTH, 5, 1), [])
    state = start(problem)
    h = 1e-6
    for one, miss in whole(problem, state):
        np.testing.assert_allclose(one.residuals.size, np.sqrt((miss**2).sum(axis=(1, 2)) / miss.shape[1]), rtol=1e-9)
        assert one.residuals.size.max() > 1e-4
        slopes = []
        for k in range(3):
            ends = []
            for sign in (1, -1):
                p = one.observed.p + sign * h * np.eye(3)[k]
                uv = cases.in_image(cases.LENS_OF, cases.before_camera(kind, p, one.observed.R, dict(one.values)))
                pixel = np.sqrt(
                    one.observed.corners[..., :2].var(axis=1).sum(axis=1)
                    / one.observed.corners[..., 2:4].var(axis=1).sum(axis=1)
                )
                ends.append((uv - one.observed.corners[..., 2:4]) * pixel[:, None, None])
            slopes.append((ends[0] - ends[1]) / (2 * h))
        J = np.stack(slopes, axis=-1) / np.sqrt(miss.shape[1])
        np.testing.assert_allclose(
            np.einsum("mki,mkj->mij", one.residuals.point, one.residuals.point),
            np.einsum("mnai,mnaj->mij", J, J),
            atol=1e-6,
        )
        np.testing.assert_allclose(
            np.einsum("mki,mk->mi", one.residuals.point, one.residuals.r),
            np.einsum("mnai,mna->mi", J, miss) / np.sqrt(miss.shape[1]),
            atol=1e-9,
        )


def test_a_lens_is_fitted_within_its_interval(fitted):
    found = fitted
    for name, true in zip(FITTED, cases.LENS_OF, strict=False):
        key = (name, "ball")
        assert abs(found.state.values[key][0] - true) < 4.0 * found.std_of(key)[0]
        assert found.std_of(key)[0] < 0.1 * found.problem.priors[key].u95
    q = cases.arm().random_joints(100, 5) * 0.7
    before, after = (
        cases.apart(TRUTH, arm, q, s.values["tool", "ball"]).mean()
        for arm, s in ((cases.arm(), found.nominal_state), (found.arm, found.state))
    )
    assert after < 0.15e-3 < 1e-3 < before


def test_a_lens_without_noise_is_exact():
    """The oracle is the arm and the lens that made the images; the file's lens errs by a per cent, its share is let go."""
    nominal = cases.arm()
    seen = cases.seen("image", TRUTH, 14, 2, fit="fx fy cx cy k1")
    problem = FeatureProblem(nominal, seen, GEOMETRY.terms(nominal))
    state = start(problem)
    for _ in range(12):
        blocks = list(problem.dense(state))
        J, y = np.concatenate([b.J for b in blocks], axis=1), np.concatenate([b.y for b in blocks])
        state = problem.moved(state, np.linalg.lstsq(J.T, y, rcond=1e-11)[0])
    assert problem.distances(state).max() < 1e-9
    q = nominal.random_joints(50, 5) * 0.8
    assert cases.apart(TRUTH, problem.arm_at(state), q, state.values["tool", "ball"]).max() < 1e-9


def test_intervals_hold_fresh_images():
    """A seeded case of scripts/feature_intervals: the noiseless images of one repetition."""
    seen = cases.seen("image-on-tool", TRUTH, 30, 5, 5e-5, 8)
    fresh = np.array([str(name).startswith("fresh") for name in seen.pose])
    fit = identify_features(cases.arm(), seen.select(~fresh), choices=[()])
    there = FeatureProblem(cases.arm(), seen.select(fresh), fit.problem.terms)
    r = np.concatenate([one.residuals.r.ravel() for one in there.group_residuals(fit.state)])
    blocks = list(there.dense(fit.state))
    J = np.concatenate([b.J for b in blocks], axis=1) * 1e-3 / there.sizes[:, None]
    std = (
        np.sqrt(np.einsum("ar,ab,br->r", J, fit.step_covariance, J))
        / there.weights[np.concatenate([b.row for b in blocks])]
    )
    assert 0.86 < np.mean(np.abs(r) < 1.96 * std) <= 1.0
    assert np.median(std) < 0.02e-3


def test_a_lens_that_is_another_is_doubted(fitted):
    found = fitted
    assert found.doubts() == []
    assert found.scale_from == "squares of 30 mm"
    table, known = cases.rows("image-on-tool", TRUTH, 14, 0, 5e-5)
    for wrong, words in (
        ({"k1": 0.12}, "px from where any place of camera and board has them"),
        ({"k1": 0.0, "k2": 0.0, "k3": 0.0}, "from where any robot like this has them"),
        ({"fx_px": 1500.0, "fit": "fx"}, "fx of ball comes out at 1(399.9|400)"),
        (
            {"square_mm": 30.3},
            "The robot comes out 1.0.% larger than nominal, and its scale rests on squares of 30.3 mm",
        ),
    ):
        seen = cases.features.read(table, known.assign(**wrong).fillna(""), cases.arm())
        told = " ".join(identify_features(cases.arm(), seen, choices=[()], bare=True).doubts())
        assert re.search(words, told), (wrong, told)


def die():
    """Corners of the markers on a die's five free sides, (5, 4, 3), and the sides' normals, metres."""
    flat = 0.02 * np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) + [0, 0, 0.03]
    turns = np.array([frames.rotation_from_vector(w) for w in 0.5 * np.pi * np.vstack([np.eye(3)[:2], -np.eye(3)[:2]])])
    turns = np.concatenate([np.eye(3)[None], turns])
    return flat @ turns.transpose(0, 2, 1), turns[:, :, 2]


def test_markers_on_a_die_are_one_board():
    """A camera in the hall sees one to three sides of a die on the tool; joints, pictures and places are exact."""
    sides, normals = die()
    own = cases.unknowns("image", np.random.default_rng(3))
    q = cases.arm().random_joints(6000, 6) * 0.9
    p, R = cases.tip(TRUTH, q)
    M = R @ own["axes"]
    y = (p[:, None, None] + np.einsum("mij,skj->mski", M, sides) - own["centre"]) @ own["attitude"]
    turned = np.einsum("mij,sj->msi", M, normals) @ own["attitude"]
    uv = cases.in_image(cases.LENS_OF, y)
    inside = ((uv > 0) & (uv < cases.SEEN_SIZE)).all(axis=(1, 2, 3)) & (y[..., 2] > 0.2).all(axis=(1, 2))
    inside &= (np.hypot(y[..., 0], y[..., 1]) < 0.9 * y[..., 2]).all(axis=(1, 2))  # the lens folds beyond
    faces = -np.einsum("msi,msi->ms", turned, y.mean(axis=2)) / np.linalg.norm(y.mean(axis=2), axis=2) > 0.2
    chosen = np.flatnonzero(inside & faces.any(axis=1))[:60]
    assert set(faces[chosen].sum(axis=1)) == {1, 2, 3}
    table = pd.DataFrame(
        {"pose": m, "feature": "camera", "u_px": u, "v_px": v}
        | dict(zip(("x_mm", "y_mm", "z_mm"), 1e3 * sides[side, corner], strict=True))
        | {f"q{k}_deg": value for k, value in enumerate(np.degrees(q[m]), 1)}
        for m in chosen
        for side in np.flatnonzero(faces[m])
        for corner, (u, v) in enumerate(uv[m, side])
    )
    lens = {name: value for name, value in cases.camera().items() if not name.startswith("square")}
    rows = features.read(
        table, pd.DataFrame([{"feature": "camera", "kind": "image", "target": "die"} | lens]), cases.arm()
    )
    true = np.tile(np.eye(4), (len(rows), 1, 1))
    true[:, :3, :3] = own["attitude"].T @ M[chosen]
    true[:, :3, 3] = (p[chosen] - own["centre"]) @ own["attitude"]
    np.testing.assert_allclose(boards(np.array(cases.LENS_OF), rows.corners), true, atol=1e-7)
    problem = FeatureProblem(cases.arm(), rows, GEOMETRY.terms(cases.arm()))
    state = start(problem)
    assert problem.distances(state).max() > 1e-3  # of the nominal robot
    for _ in range(8):
        blocks = list(problem.dense(state))
        J, r = np.concatenate([b.J for b in blocks], axis=1), np.concatenate([b.y for b in blocks])
        state = problem.moved(state, np.linalg.lstsq(J.T, r, rcond=1e-10)[0])
    assert problem.distances(state).max() < 1e-8
    assert cases.apart(TRUTH, problem.arm_at(state), q[chosen], state.values["tool", "die"]).max() < 1e-8
