"""The linear model of all terms against the Jacobian of the problem and against central differences."""

import numpy as np
import pytest
from evidence_cases import linear_case, rows_of
from support import central_differences

from irbcal.errors import IdentificationError
from irbcal.identification import linear_model
from irbcal.identification import problem as problem_module
from irbcal.identification.linear_model import TURN_UNIT, Linearisation
from irbcal.identification.term_sets import make
from irbcal.modeling.terms import chain
from irbcal.modeling.terms.geometry import FAMILY as GEOMETRY
from irbcal.modeling.terms.term_map import TermMap


@pytest.mark.parametrize("orientations", [False, True])
@pytest.mark.parametrize("sessions", [False, True])
def test_geometry_columns_are_the_jacobian_of_the_problem(orientations, sessions):
    problem, state, motion, terms = linear_case(12 + 8 * sessions, orientations, sessions)
    linear = Linearisation(problem, state, motion, terms)
    k = problem.unknowns
    sums = linear.sums(np.arange(k))
    H, g, rss = problem.normal_equations(state)
    units = linear.sizes[:k] / 1e-3
    scale = np.sqrt(np.diag(sums.H))
    np.testing.assert_allclose(
        sums.H / np.outer(scale, scale), H * np.outer(units, units) / np.outer(scale, scale), atol=1e-9
    )
    # the target counts the geometry from the nominal arm
    c = np.r_[np.zeros(problem.nuisance), state.errors / linear.sizes[problem.nuisance : k]]
    left = sums.yy - 2 * c @ sums.g + c @ sums.H @ c
    assert left == pytest.approx(1e6 * rss, rel=1e-6)
    np.testing.assert_allclose((sums.g - sums.H @ c) / scale, g * units * 1e3 / scale, atol=1e-6)


def test_blocks_of_poses_add_up(monkeypatch):
    problem, state, motion, terms = linear_case(13)
    linear = Linearisation(problem, state, motion, terms)
    whole = linear.sums()
    monkeypatch.setattr(problem_module, "BLOCK", 4)
    parts = Linearisation(problem, state, motion, terms).sums()
    np.testing.assert_allclose(parts.H, whole.H, rtol=1e-9, atol=1e-9)
    assert parts.equations == whole.equations == 3 * problem.rows


@pytest.mark.parametrize("change", ["none", "improved", "without", "fewer terms", "fewer terms, larger blocks"])
def test_rows_that_are_kept_are_those_that_are_made_each_time(change, monkeypatch):
    case = linear_case(13)
    if change == "fewer terms, larger blocks":
        monkeypatch.setattr(problem_module, "TERMS_IN_BLOCK", 6 * len(case[3]))

    def rows(most):
        monkeypatch.setattr(linear_model, "LARGEST_KEPT", most)
        linear = Linearisation(*case)
        linear.sums()
        if change == "improved":
            linear = linear.improved(np.full(len(linear.sizes), 0.1))
        if change == "without":
            linear = linear.without(np.arange(len(case[0].points)) % 5 == 0)
        if change.startswith("fewer terms"):
            linear = linear.of_terms(np.flatnonzero([t.family == "geometry" or k % 2 for k, t in enumerate(case[3])]))
            return rows_of(linear, np.arange(len(linear.sizes)))
        return rows_of(linear, np.r_[: linear.nuisance + 40, linear.nuisance + 70 : linear.nuisance + 80])

    for kept, new in zip(vars(rows(10**6)).values(), vars(rows(0)).values(), strict=True):
        np.testing.assert_allclose(kept, new, rtol=0, atol=1e-12)


def test_an_improved_model_has_the_sums_of_its_rows():
    before = Linearisation(*linear_case(13))
    improved = before.improved(np.full(len(before.sizes), 0.1))
    again, whole = improved.sums_again(before.sums()), improved.sums()
    for name in ("H", "g", "yy", "equations"):
        np.testing.assert_allclose(getattr(again, name), getattr(whole, name), rtol=1e-10, atol=1e-9)
    assert abs(again.yy - before.sums().yy) > 1e-3


def test_projection_takes_the_last_move_out_of_each_pose():
    problem, state, motion, terms = linear_case(12)
    chosen = make(terms, ["gravity", "gain"], 0, None)
    linear = Linearisation(problem, state, motion, terms, project=True)
    columns = chosen.columns(linear.nuisance)
    free = Linearisation(problem, state, motion, terms)
    # the same as one free column a pose in the dense problem: any share of the move leaves the rows as they are
    rows, plain = rows_of(linear, columns), rows_of(free, columns)
    # along the last move of all joints
    T = [chain.poses(chain.walk(problem.arm_at(state), motion.q + share * motion.moves)) for share in (1e-5, -1e-5)]
    points, local = problem.points, state.targets[problem.points.target]
    ahead, behind = (np.einsum("mij,mj->mi", T[points.pose, :3, :3], local) + T[points.pose, :3, 3] for T in T)
    d = ((ahead - behind) / 2e-5 * problem.weights[:, None]).ravel()
    for n in range(1, 12):
        mine = plain.pose == n
        P = np.eye(mine.sum()) - np.outer(d[mine], d[mine]) / (d[mine] @ d[mine])
        np.testing.assert_allclose(rows.J[:, mine], plain.J[:, mine] @ P, atol=1e-7)
        np.testing.assert_allclose(rows.y[mine], P @ plain.y[mine], atol=1e-7)
    assert linear.sums(columns).equations == 3 * len(problem.points) - 12


@pytest.mark.parametrize("orientations", [False, True])
def test_columns_of_terms_are_central_differences_of_the_points(orientations):
    problem, state, motion, terms = linear_case(6, orientations)
    linear = Linearisation(problem, state, motion, terms)
    arm = problem.arm_at(state)
    places = [k for k, t in enumerate(terms) if t.family in ("gravity", "wobble", "direction", "warm_up", "bending")]
    chosen, sizes = tuple(terms[k] for k in places), np.array([terms[k].size for k in places])
    rows = rows_of(linear, np.array(places) + linear.nuisance)
    points = problem.points
    local = state.targets[points.target]
    positions = np.concatenate([np.arange(rows_of) < seen for rows_of, seen in _rows_of_poses(points)]).repeat(3)
    weights = np.broadcast_to(problem.weights[: len(points)].reshape(len(points), -1), (len(points), 3)).ravel()

    def xyz(c):
        T = TermMap(problem.arm, chosen, c).forward(arm, motion)[points.pose]
        return (np.einsum("mij,mj->mi", T[:, :3, :3], local) + T[:, :3, 3]).ravel()

    rng = np.random.default_rng(3)
    for _ in range(3):  # in random directions of all of them together
        step = rng.standard_normal(len(chosen))
        expected = central_differences(lambda s, step=step: xyz(s[0] * step * sizes), np.zeros(1), 1e-2)[:, 0]
        expected = weights * expected / 1e-3
        found = (step @ rows.J)[positions]
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6 * np.abs(expected).max())


def _rows_of_poses(points):
    """Number of rows, and of positions among them, of each pose."""
    turned = np.bincount(points.pose[points.oriented()], minlength=points.poses)
    seen = np.bincount(points.pose, minlength=points.poses)
    return list(zip(seen + turned, seen, strict=True))


def test_flat_columns_count_in_their_units():
    problem, state, motion, terms = linear_case(8, True)
    units = Linearisation(problem, state, motion, terms).sizes[: problem.nuisance]
    shifts, turns = 3 * len(problem.fitted_targets), 3 * len(problem.oriented_targets)
    np.testing.assert_array_equal(units, [TURN_UNIT] * 3 + [1e-3] * (3 + shifts) + [TURN_UNIT] * turns)


def test_the_geometry_solution_is_a_fixed_point_and_moved_goes_there():
    problem, state, motion, _ = linear_case(30)
    geometry = GEOMETRY.terms(problem.arm)
    linear = Linearisation(problem, state, motion, geometry)
    again = linear_model.geometry_solution(problem, motion, geometry)
    np.testing.assert_allclose(again.errors, state.errors, rtol=0, atol=1e-9)
    zero = np.zeros(len(linear.sizes))
    nominal = linear.moved(zero)
    np.testing.assert_array_equal(nominal.errors, 0.0)
    np.testing.assert_array_equal(nominal.targets, state.targets)
    zero[problem.nuisance] = 2.0
    assert linear.moved(zero).errors[0] == pytest.approx(2.0 * geometry[0].size)
    zero[3] = 1.0
    assert np.linalg.norm(linear.moved(zero).T_world_base[:3, 3] - state.T_world_base[:3, 3]) == pytest.approx(1e-3)


def test_too_few_poses_are_refused():
    problem, _, _, _ = linear_case(5)
    points = problem.points.select(np.arange(5) < 2)
    with pytest.raises(IdentificationError, match="at least 3"):
        linear_model.geometry_problem(problem.arm, points, GEOMETRY.terms(problem.arm), None)


def test_the_same_problem_for_other_points():
    problem, state, motion, terms = linear_case(10)
    keep = np.arange(10) < 4
    part = problem.of_poses(keep)
    some = Linearisation(part, state, motion.select(keep), terms).sums()
    first = Linearisation(problem, state, motion, terms)
    rows = rows_of(first)
    mine = rows.pose < 4
    np.testing.assert_allclose(some.H, rows.J[:, mine] @ rows.J[:, mine].T, rtol=1e-9, atol=1e-9)
    assert some.equations == mine.sum()


@pytest.mark.parametrize("orientations", [False, True])
def test_a_straightened_model_is_exact_where_it_was_straightened(orientations, monkeypatch):
    monkeypatch.setattr(problem_module, "BLOCK", 5)
    problem, state, motion, terms = linear_case(12, orientations)
    linear = Linearisation(problem, state, motion, terms)
    c = 0.5 * np.random.default_rng(1).standard_normal(linear.nuisance + len(terms))
    c[3:6] = 0.1
    c[: linear.nuisance] *= 1e-2  # of base and targets, whose units are large
    before, after = (rows.y - c @ rows.J for rows in (rows_of(linear), rows_of(linear.improved(c))))
    # what is measured minus what the moved robot with all terms predicts
    moved = linear.moved(c)
    rows = [k for k, term in enumerate(terms) if term.family != "geometry"]
    values = (linear.sizes * c)[linear.nuisance :][rows]
    term_map = TermMap(problem.arm, tuple(terms[k] for k in rows), values)
    T = moved.T_world_base @ term_map.forward(linear.problem.arm_at(moved), motion)
    points = problem.points
    local = moved.targets[points.target]
    predicted = np.einsum("mij,mj->mi", T[points.pose, :3, :3], local) + T[points.pose, :3, 3]
    left = (points.xyz - predicted) @ moved.T_world_base[:3, :3] / 1e-3 * problem.weights[: len(points), None]
    if not orientations:
        np.testing.assert_allclose(after, left.ravel(), atol=1e-9)
    assert np.abs(after - before).max() > 1e-3
