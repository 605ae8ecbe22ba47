"""Least-squares identification against simulated truth."""

import dataclasses
import pickle
import subprocess
import sys
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from evidence_cases import irb120
from simulated_fit import predicted_covariance
from support import arm, measured, random_robot
from thesis_formula import ThesisMap, apply

from irbcal.errors import IdentificationError, OptionError, RobotError
from irbcal.identification import choices, minimax, robust
from irbcal.identification.choices import Goal
from irbcal.identification.fit import certainty_of, choose_level, identify, identify_by, leave_one_out_residuals
from irbcal.measurement.points import PointSet, distances
from irbcal.modeling import frames, parameters
from irbcal.modeling.parameters import THESIS_LEVELS, all_names, parameter, selected_parameters, term_of
from irbcal.modeling.terms import chain
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term_map import TermModel
from irbcal.option_values import checked
from irbcal.validation.accuracy import coverage


def largest_miss(robot, truth, q):
    return max(np.linalg.norm(robot.points(q, name) - truth.points(q, name), axis=1).max() for name in truth.targets)


@pytest.mark.parametrize("name", ["irb1600", "irb120"])
@pytest.mark.parametrize("level", list(THESIS_LEVELS))
def test_noise_free_data_are_explained_to_a_nanometre_on_other_poses(name, level):
    nominal = arm(name)
    truth = random_robot(nominal, level, np.random.default_rng(21))
    fit = identify(nominal, measured(truth, nominal.random_joints(60, 1)), level)
    assert largest_miss(fit.robot, truth, nominal.random_joints(500, 2)) < 1e-9


def test_known_parameters_come_out_of_noisy_data():
    nominal = arm()
    rng = np.random.default_rng(22)
    truth = random_robot(nominal, "34", rng)
    fit = identify(nominal, measured(truth, nominal.random_joints(200, 1), 2e-5, rng), "34")
    assert fit.solution.information.sigma == pytest.approx(2e-5, rel=0.05)
    rows = {row.name: row for row in fit.parameters()}
    thesis = ThesisMap.from_joint_map(truth.joint_map)
    true = {"stiffness_A": thesis.stiffness[0], "stiffness_B": thesis.stiffness[1]}
    true |= {f"fourier_{k}": v for k, v in zip(("a1", "b1", "a2", "b2"), thesis.fourier, strict=True)}
    for i in range(2, 7):
        for kind in ("alpha", "a", "theta", "d"):
            true[f"delta_{kind}{i}"] = getattr(truth.table, kind)[i - 1] - getattr(nominal.table, kind)[i - 1]
    checked = 0
    for key, value in true.items():
        row = rows[key]
        if row.state == "identified":
            factor = {"mm": 1e-3, "deg": np.pi / 180}[row.unit]
            assert abs(row.value * factor - value) < 4.5 * row.std * factor, key
            checked += 1
    # delta_theta6 and delta_d6 shift into the tool: the parameters that they are tied to absorb them
    assert checked >= 22


def test_with_one_target_on_axis_6_more_is_held_not_guessed():
    nominal = arm()
    rng = np.random.default_rng(24)
    truth = random_robot(nominal, "34", rng, targets={"tip": [0.0, 0.0, 0.1]})
    fit = identify(nominal, measured(truth, nominal.random_joints(150, 1), 2e-5, rng), "34")
    rows = {row.name: row for row in fit.parameters()}
    assert rows["fourier_a1"].state == "held", "a point on axis 6 does not see joint 6"
    assert abs(rows["fourier_a1"].value) < 0.02
    assert largest_miss(fit.robot, truth, nominal.random_joints(300, 2)) < 3e-4


def test_result_does_not_depend_on_order_or_on_the_measuring_frame():
    nominal = arm()
    rng = np.random.default_rng(25)
    truth = random_robot(nominal, "34", rng)
    points = measured(truth, nominal.random_joints(40, 1), 5e-5, rng)
    shuffled = rng.permutation(points.poses)
    order = np.concatenate([np.flatnonzero(points.pose == k) for k in shuffled])
    T = frames.from_xyz_angles([1, 2, 3, 0.4, 0.5, 0.6])
    other = PointSet(
        points.q[shuffled],
        np.repeat(np.arange(points.poses), 3),
        points.target[order],
        frames.apply(T, points.xyz[order]),
        points.target_names,
        points.pose_ids[shuffled],
        points.groups[shuffled],
    )
    one, two = identify(nominal, points, "34"), identify(nominal, other, "34")
    assert np.abs(one.solution.state.errors - two.solution.state.errors).max() < 1e-9
    assert np.abs(T @ one.robot.T_world_base - two.robot.T_world_base).max() < 1e-9


def test_targets_seen_in_only_some_poses_are_fine():
    nominal = arm()
    rng = np.random.default_rng(26)
    truth = random_robot(nominal, "34", rng)
    points = measured(truth, nominal.random_joints(80, 1))
    keep = rng.random(len(points)) < 0.4  # poses with three, two, one or no point
    fit = identify(nominal, points.take(keep).without_empty_poses(), "34")
    assert largest_miss(fit.robot, truth, nominal.random_joints(300, 2)) < 1e-9


def test_too_few_equations_are_counted():
    nominal = arm()
    truth = random_robot(nominal, "34", np.random.default_rng(27))
    points = measured(truth, nominal.random_joints(20, 1))
    with pytest.raises(IdentificationError, match="2 poses cannot determine a robot"):
        identify(nominal, points.select(np.arange(20) < 2), "34")
    with pytest.raises(IdentificationError, match=r"12 points of 4 poses give 36 equations for the 41 unknowns"):
        identify(nominal, points.select(np.arange(20) < 4), "34")


def test_unknown_level_lists_the_levels():
    with pytest.raises(OptionError, match=r"level: expected nominal, 11, 16, 26, 34, .* found '35'"):
        identify(arm(), measured(random_robot(arm(), "11", np.random.default_rng(0)), np.ones((4, 6))), "35")


def test_stiffness_of_an_arm_that_gravity_loads_otherwise_is_refused():
    nominal = arm()
    truth = random_robot(nominal, "11", np.random.default_rng(0))
    points = measured(truth, nominal.random_joints(30, 1))
    tilted = dataclasses.replace(nominal, T_base_0=frames.transform(frames.rot_x(0.3)))
    with pytest.raises(RobotError):
        identify(tilted, points, "34")


def axis_moves_and_more(rng, level="26", noise=0.0):
    """Simulated one-joint moves (7 poses each), 40 random poses to fit, 60 to verify."""
    nominal = arm()
    robot = random_robot(nominal, level, rng, size=0.1)
    q = np.zeros((42, 6))
    for i in range(6):
        q[7 * i : 7 * i + 7, i] = np.radians(np.linspace(-45, 45, 7))
    groups = [*np.repeat([f"axis{i}" for i in range(1, 7)], 7), *["all_range"] * 40, *["check"] * 60]
    points = measured(robot, np.vstack([q, nominal.random_joints(100, 1)]), noise, rng, groups)
    check = points.groups == "check"
    return nominal, points.select(~check), points.select(check)


@pytest.fixture(scope="module")
def data():
    """A robot with backlash-like noise, so that objectives differ."""
    return axis_moves_and_more(np.random.default_rng(1), noise=2e-4)


def largest(fit, points):
    return distances(fit.robot, points).max()


def test_objectives_reach_what_they_promise(data):
    nominal, points, check = data
    fits = {
        name: identify_by(nominal, points, "26", goal=Goal(name), watched={"check": check})
        for name in ("rms", "pnorm", "max")
    }
    assert largest(fits["max"], points) < largest(fits["pnorm"], points) < largest(fits["rms"], points)
    assert fits["rms"].rms < fits["pnorm"].rms < fits["max"].rms
    best = fits["max"]
    assert best.value == pytest.approx(largest(best, points), abs=1e-12)
    assert best.lower_bound <= best.value <= best.lower_bound * 1.0001
    assert best.least_squares.rms == pytest.approx(fits["rms"].rms, rel=1e-12)
    for fit in fits.values():
        course = fit.history.to_frame()
        assert list(course.columns)[3:] == ["check_mean_mm", "check_max_mm"]
        assert course["objective_mm"].iloc[-1] <= course["objective_mm"].iloc[0]
        assert course["check_max_mm"].iloc[-1] == pytest.approx(largest(fit, check) * 1e3, rel=1e-4)


def test_circles_method_is_exact_without_noise_and_lists_its_parameters():
    nominal, points, check = axis_moves_and_more(np.random.default_rng(2))
    fit = identify_by(nominal, points, "26", method="circles")
    assert fit.method == "circles"
    assert largest(fit, check) < 1e-9
    rows = {row.name: row for row in fit.parameters()}
    assert "delta_alpha4" in rows
    assert "base_x" in rows
    assert fit.problem.points.poses == 42, "only the one-joint moves were used"


def test_circles_method_says_what_it_needs(data):
    nominal, _, check = data
    with pytest.raises(IdentificationError, match=r"one-joint moves in the groups axis1 \.\.\. axis6; found check"):
        identify_by(nominal, check, "26", method="circles")


def test_nelder_mead_starts_from_the_axes_and_stays_above_the_certified_minimum(data, monkeypatch):
    monkeypatch.setattr(minimax, "nelder_mead", partial(minimax.nelder_mead, iterations=300))
    nominal, points, check = data
    search = identify_by(nominal, points, "26", method="nelder-mead", watched={"check": check})
    best = identify_by(nominal, points, "26", goal=Goal("max"))
    course = search.history.to_frame()
    assert course["iteration"].iloc[-1] == 300
    assert course["objective_mm"].iloc[-1] < course["objective_mm"].iloc[0]
    assert largest(search, points) > 1.05 * best.lower_bound


def test_robust_losses_shrug_off_outliers(data):
    nominal, points, check = data
    xyz = points.xyz.copy()
    xyz[::29] += 0.008
    bad = type(points)(**{**vars(points), "xyz": xyz})
    plain = distances(identify_by(nominal, bad, "26").robot, check).mean()
    clean = distances(identify_by(nominal, points, "26").robot, check).mean()
    for loss in ("soft_l1", "huber"):
        robust = distances(identify_by(nominal, bad, "26", goal=Goal(loss=loss)).robot, check).mean()
        assert robust - clean < 0.2 * (plain - clean)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"method": "magic"}, "method: expected least-squares, circles or nelder-mead, found 'magic'"),
        ({"level": "27"}, "level: expected nominal, 11, 16, 26, 34, 34b, offsets or placement, found '27'"),
        ({"method": "circles", "goal": Goal("pnorm")}, "method circles has its own objective"),
        ({"method": "axes"}, "method: expected least-squares, circles or nelder-mead, found 'axes'"),
        ({"method": "circles", "parameters": ()}, "method circles takes all link geometry from the axes"),
    ],
)
def test_options_that_do_not_exist_or_contradict_are_refused(data, options, expected):
    with pytest.raises(OptionError, match=expected) as caught:
        identify_by(*data[:2], **{"level": "26", **options})
    assert caught.value.parameter in options


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"objective": "mean"}, "objective: expected rms, max or pnorm, found 'mean'"),
        ({"loss": "l2"}, "loss: expected linear, soft_l1 or huber, found 'l2'"),
        ({"objective": "max", "loss": "huber"}, "loss huber goes with objective rms, not with max"),
    ],
)
def test_goals_that_do_not_exist_or_contradict_are_refused(options, expected):
    with pytest.raises(OptionError, match=expected) as caught:
        Goal(**options)
    assert caught.value.parameter in options


def test_unobservable_combinations_are_named_and_never_run_away():
    nominal = arm()
    rng = np.random.default_rng(23)
    truth = random_robot(nominal, "34", rng)
    fit = identify(nominal, measured(truth, nominal.random_joints(150, 1), 3e-4, rng), "34")
    rows = {row.name: row for row in fit.parameters()}
    assert rows["delta_d2"].state == rows["delta_d3"].state == "tied"
    assert abs(rows["delta_d2"].value) < 2
    assert abs(rows["delta_d3"].value) < 2
    for name in ("delta_theta6", "delta_d6"):
        assert rows[name].state == "held"
        assert abs(rows[name].value) < 1e-9
        assert "targets" in rows[name].reason
    for name in ("stiffness_L_G1", "stiffness_m"):
        assert rows[name].state == "held"
        assert "stiffness_A and stiffness_B" in rows[name].reason
    assert any("delta_d3" in sentence and "delta_d2" in sentence for sentence in fit.undetermined())
    assert fit.parameter_count == 43
    assert fit.rank == 38
    assert all(row.std is None for row in rows.values() if row.state != "identified")


@pytest.fixture(scope="module")
def fit():
    nominal = arm()
    rng = np.random.default_rng(31)
    truth = random_robot(nominal, "34", rng)
    return identify_by(nominal, measured(truth, nominal.random_joints(60, 1), 5e-5, rng), "34")


def test_one_unobservable_direction_leaves_all_other_error_bars_as_they_are():
    """The turn of the flange cannot be told from an unknown tool: asking for it all the same must cost nothing."""
    nominal = arm()
    rng = np.random.default_rng(32)
    points = measured(random_robot(nominal, "26", rng), nominal.random_joints(60, 1), 5e-5, rng)
    without = selected_parameters("26", hold=["delta_theta6", "delta_d6", "delta_d3"])
    rows = [{r.name: r for r in identify(nominal, points, "26", parameters=p).parameters()} for p in (without, None)]
    others = [name for name in rows[0] if name != "delta_d2"]  # which delta_d3 is tied to
    assert len(others) == 6 + 9 + 16
    for name in others:
        assert rows[0][name].std > 0, name
        assert rows[1][name].std == pytest.approx(rows[0][name].std, rel=1e-3), name
        assert rows[1][name].state == "identified"
    assert rows[1]["delta_theta6"].std is None
    assert rows[1]["delta_d6"].std is None


def test_it_tells_what_was_fitted_and_every_parameter(fit):
    told = fit.report()
    assert told[0] == fit.headline()
    assert told[0].startswith(f"{fit.robot.arm.name}, model 34: 38 independent combinations of 43 parameters")
    assert f"60 poses, base and targets included (fitted rms {1e3 * fit.rms:.3f} mm)" in told[0]
    rows = {row[0]: row for row in told[1].rows}
    for report in fit.parameters():
        assert rows[report.name] == (report.name, report.value, report.std, report.unit, report.state)
    assert [item for item in told[2:] if item.startswith("  held: ")] == [
        f"  held: {text}" for text in fit.undetermined()
    ]
    assert any("stiffness_m acts only through" in item for item in told[2:])
    assert "delta_alpha4" in fit.summary()
    assert "delta_alpha4" in fit._repr_html_()
    assert len(repr(fit)) < 2000


def test_other_objectives_say_what_they_reached(fit):
    least = identify_by(fit.problem.arm, fit.problem.points, "34", goal=Goal("max"))
    largest = 1e3 * distances(least.robot, fit.problem.points).max()
    assert f"(largest fitted error {largest:.3f} mm" in least.headline()
    assert f"certified: not below {1e3 * least.lower_bound:.3f} mm" in least.headline()


def test_a_row_a_parameter(fit):
    frame = fit.to_frame().set_index("name")
    for report in fit.parameters():
        row = frame.loc[report.name]
        assert (row["value"], row["unit"], row["state"], row["reason"]) == (
            report.value, report.unit, report.state, report.reason,
        )  # fmt: skip
        assert np.isnan(row["std"]) if report.std is None else row["std"] == report.std


@pytest.mark.parametrize("goal", [Goal(), Goal("max"), Goal("pnorm"), Goal(loss="huber")])
def test_it_can_be_pickled(fit, goal):
    found = identify_by(fit.problem.arm, fit.problem.points, "34", goal=goal)
    again = pickle.loads(pickle.dumps(found))
    assert again.summary() == found.summary()
    assert again.to_frame().equals(found.to_frame())


def test_arrays_cannot_be_changed(fit):
    with pytest.raises(ValueError, match="read-only"):
        fit.solution.state.errors[0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        fit.solution.information.determined[0] = False


REPETITIONS = 500
"""A true share of 0.95 gives 0.921 to 0.979 by chance (three standard deviations)."""


def test_intervals_of_each_parameter_hold_as_often_as_they_say():
    rng = np.random.default_rng(11)
    turned = frames.from_xyz_angles([1.5, -0.8, 0.6, 0.7, 1.0, -0.5])  # far from where angles are rotation vectors
    truth = random_robot(arm(), "nominal", rng, T_world_base=turned)
    q = arm().random_joints(12, 3)
    true = dict(
        zip(("base_x", "base_y", "base_z", "base_rx", "base_ry", "base_rz"), frames.to_xyz_angles(turned), strict=True)
    )
    true |= {
        f"target_{name}_{axis}": p
        for name, place in truth.targets.items()
        for axis, p in zip("xyz", place, strict=True)
    }
    inside = dict.fromkeys(true, 0)
    for _ in range(REPETITIONS):
        for row in identify(arm(), measured(truth, q, 1e-4, rng), "nominal").parameters():
            unit = {"mm": 1e-3, "deg": np.pi / 180}[row.unit]
            inside[row.name] += abs(row.value * unit - true[row.name]) < 1.96 * row.std * unit
    share = {name: count / REPETITIONS for name, count in inside.items()}
    assert min(share.values()) >= 0.92, share
    assert max(share.values()) <= 0.98, share


def test_the_level_is_chosen_by_what_the_data_support():
    nominal = arm()
    rng = np.random.default_rng(9)
    for level in ("nominal", "11", "34"):
        truth = random_robot(nominal, level, rng, size=0.3)
        choice = choose_level(nominal, measured(truth, nominal.random_joints(60, 1), 5e-5, rng))
        assert choice.level == level
        assert [row.level for row in choice.table] == ["nominal", "11", "16", "26", "34", "34b", "placement"]
        for row in choice.table[1:]:
            assert row.chosen == (row.gain_mm > row.gain_std_mm)
        assert choice.explanation.count(". ") == 1
    short = choose_level(nominal, measured(truth, nominal.random_joints(10, 1), 5e-5, rng))
    assert any("unknowns of level 34" in row.refused for row in short.table) or short.table[-1].mean_mm is not None


def test_the_choice_speaks_and_can_be_pickled():
    nominal = arm()
    rng = np.random.default_rng(9)
    points = measured(random_robot(nominal, "11", rng), nominal.random_joints(9, 1), 5e-5, rng)
    choice = choose_level(nominal, points, levels=("nominal", "11", "34"))
    assert choice.report()[0] == choice.explanation == choice.headline()
    assert repr(choice) == f"<LevelChoice: {choice.explanation}>"
    shown = [line.split() for line in choice.summary().splitlines()]
    for row in choice.table:
        assert [row.level, f"{row.mean_mm:.3f}"] in [words[:2] for words in shown]
    frame = choice.to_frame()
    assert list(frame["level"]) == ["nominal", "11", "34"]
    assert frame["mean_mm"][1] == choice.table[1].mean_mm
    again = pickle.loads(pickle.dumps(choice))
    assert again.table == choice.table


def test_refused_levels_say_why():
    nominal = arm()
    rng = np.random.default_rng(9)
    points = measured(random_robot(nominal, "11", rng), nominal.random_joints(5, 1), 5e-5, rng)
    choice = choose_level(nominal, points, levels=("nominal", "34"))
    assert choice.table[1].refused in choice.report()[-1]
    with pytest.raises(IdentificationError):
        choose_level(nominal, points, levels=("34", "nominal"))
    with pytest.raises(OptionError, match=r"levels: expected nominal, 11, .* found '12'"):
        choose_level(nominal, points, levels=("12",))


def test_names_are_those_of_the_code():
    assert set(choices.LEVELS) == {*parameters.THESIS_LEVELS, *parameters.GENERAL_LEVELS}
    assert ("auto", "best-level", *choices.LEVELS) == choices.MODELS
    assert ("linear", *robust.LOSSES) == choices.LOSSES
    assert choices.METHODS == ("least-squares", "circles", "nelder-mead")


def test_what_is_not_a_choice_is_refused_with_its_name():
    assert checked("loss", "huber", choices.LOSSES) == "huber"
    with pytest.raises(OptionError, match="loss: expected linear, soft_l1 or huber, found 'l2'") as caught:
        checked("loss", "l2", choices.LOSSES)
    assert caught.value.parameter == "loss"


def test_reading_them_imports_nothing_heavy():
    code = "import sys, irbcal.identification.choices; print(*(m for m in ('numpy', 'scipy', 'pandas') if m in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def with_certainty(fit):
    return fit.robot.replace(certainty=certainty_of(fit))


def cell(level="34", seed=1, poses=60, noise=3e-5, model="irb120"):
    nominal, rng = arm(model), np.random.default_rng(seed)
    robot = random_robot(nominal, level, rng)
    return nominal, robot, measured(robot, nominal.random_joints(poses, seed), noise, rng), rng


@pytest.mark.parametrize("name", all_names())
def test_terms_move_points_as_their_parameters_do(name):
    nominal = arm()
    phases, _ = nominal.stiffness_geometry()
    item, place, q = parameter(name), np.array([0.1, -0.05, 0.2]), nominal.random_joints(6, 2)
    there = []
    for step in (1e-5, -1e-5):
        table, joint_map = apply([item], [step], nominal.table, ThesisMap(phases=phases))
        T = nominal.with_table(table).forward(joint_map.effective(q))
        there.append(T[:, :3, :3] @ place + T[:, :3, 3])
    path = chain.walk(nominal, q)
    p = path.tip[3] + np.einsum("acn,a->cn", path.tip[:3], place)
    model = TermModel(nominal, [term_of(item, nominal)])
    found = model.columns(path, lambda: model.values(Motion(q)), p)
    np.testing.assert_allclose(found[0].T, (there[0] - there[1]) / 2e-5, rtol=0, atol=1e-8)


@pytest.mark.parametrize("level", ["nominal", "16", "34b", "placement"])
def test_covariance_is_that_of_the_fit(level):
    nominal, _, points, _ = cell()
    fit = identify(nominal, points, level)
    q = nominal.random_joints(15, 8)
    for name in points.target_names:
        expected = predicted_covariance(fit, q, name)
        seen = with_certainty(fit).predict(q, target=name)
        np.testing.assert_allclose(seen.covariance, expected, rtol=0, atol=2e-3 * np.abs(expected).max())


def test_known_targets_and_orientations_have_their_columns():
    nominal, robot, points, rng = cell(poses=40)
    T = (robot.T_world_base @ robot.poses(points.q))[points.pose, :3, :3].copy()
    T[rng.uniform(size=len(T)) > 0.5] = np.nan
    points = replace(points, rotation=T, u95=rng.uniform(1e-5, 4e-5, len(points)))
    fit = identify(nominal, points, "26", known_targets={"smr2": robot.targets["smr2"]})
    q = nominal.random_joints(10, 8)
    for name in points.target_names:
        expected = predicted_covariance(fit, q, name)
        seen = with_certainty(fit).predict(q, target=name)
        np.testing.assert_allclose(seen.covariance, expected, rtol=0, atol=2e-3 * np.abs(expected).max())


def test_left_out_residuals_are_those_of_fits_without_the_pose():
    nominal, _, points, _ = cell("26", poses=25)
    fit = identify(nominal, points, "26")
    single, fifths, _ = leave_one_out_residuals(fit, fit.solution.information.covariance())
    for k in (0, 7, 24):
        rest = identify(nominal, points.select(np.arange(25) != k), "26")
        expected = (points.xyz - points.predicted(rest.robot))[points.pose == k] @ rest.robot.T_world_base[:3, :3]
        np.testing.assert_allclose(single[points.pose == k], expected, rtol=0, atol=2e-6)
    block = np.arange(25) // 5 == 2
    rest = identify(nominal, points.select(~block), "26")
    mine = block[points.pose]
    expected = (points.xyz - points.predicted(rest.robot))[mine] @ rest.robot.T_world_base[:3, :3]
    np.testing.assert_allclose(fifths[mine], expected, rtol=0, atol=5e-6)


def test_repeats_are_left_out_together():
    nominal, robot, points, rng = cell("26", poses=20)
    q = np.repeat(points.q, 3, axis=0)
    fit = identify(nominal, measured(robot, q, 3e-5, rng), "26")
    rest = identify(nominal, fit.problem.points.select(np.arange(60) // 3 != 4), "26")
    mine = fit.problem.points.pose // 3 == 4
    seen = fit.problem.points
    expected = (seen.xyz - seen.predicted(rest.robot))[mine] @ rest.robot.T_world_base[:3, :3]
    found = leave_one_out_residuals(fit, fit.solution.information.covariance())[0][mine]
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-6)


def test_intervals_hold_on_simulated_robots():
    shares = []
    for seed in range(1, 7):
        nominal, robot, points, rng = cell(seed=seed, poses=50)
        test = measured(robot, nominal.random_joints(100, 50 + seed), 3e-5, rng)
        fit = identify(nominal, points, "34")
        shares.append(coverage(with_certainty(fit), test)["parts"]["all"]["inside"])
    assert 0.92 < np.mean(shares) < 0.98


def test_freed_gains_and_another_level_take_part():
    nominal, _, points, _ = cell("26")
    fit = identify(nominal, points, "26", parameters=selected_parameters("26", ["gain[23]"], [], nominal))
    known = certainty_of(fit)
    assert [term.basis for term in known.terms[-2:]] == ["q", "q"]
    np.testing.assert_array_equal(known.limits.ranges, [points.q.min(axis=0), points.q.max(axis=0)])


@pytest.mark.parametrize("level", ["nominal", "34", "34b", "placement"])
def test_intervals_hold_on_a_real_robot(shared_data, level):
    seen = irb120(shared_data)
    rows = np.arange(seen.points.poses) < 200
    fit = identify(seen.model, seen.points.select(rows), level)
    parts = coverage(with_certainty(fit), seen.points.select(~rows))["parts"]
    assert 0.92 < parts["all"]["inside"] < 0.98


def test_some_places_tell_what_all_do(monkeypatch):
    nominal, _, points, _ = cell(poses=150)
    fit = identify(nominal, points, "34")
    whole = certainty_of(fit)
    monkeypatch.setattr("irbcal.identification.fit.MOST_PLACES", 75)
    some = certainty_of(fit)
    for name, value in whole.limits.leave_one_out_mm.items():
        assert abs(some.limits.leave_one_out_mm[name] / value - 1.0) < 0.15
        assert abs(some.limits.leave_fifths_out_mm[name] / whole.limits.leave_fifths_out_mm[name] - 1.0) < 0.15
    with monkeypatch.context() as patch:
        patch.setattr("irbcal.identification.fit.MOST_PLACES", 149)
        single, _, mine = leave_one_out_residuals(fit, whole.covariance)
        every = left_out_of_all(fit, whole.covariance, patch)
        assert np.abs(single - every[np.isin(points.pose_ids, mine.pose_ids)[points.pose]]).max() < 1e-9


def left_out_of_all(fit, covariance, patch):
    patch.setattr("irbcal.identification.fit.MOST_PLACES", 10**6)
    return leave_one_out_residuals(fit, covariance)[0]
