"""What a fit says of itself."""

import pickle

import numpy as np
import pytest
from support import arm, measured, random_robot

from irbcal.errors import RobotError
from irbcal.identification.fit import identify, identify_by
from irbcal.modeling.parameters import selected_parameters


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
    assert any("delta_d3" in sentence and "delta_d2" in sentence for sentence in fit.held())
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
    told = fit.told()
    assert told[0] == fit.headline()
    assert told[0].startswith(f"{fit.robot.arm.name}, model 34: 38 independent combinations of 43 parameters")
    assert f"60 poses (fitted rms {1e3 * fit.rms:.3f} mm)" in told[0]
    rows = {row[0]: row for row in told[1].rows}
    for report in fit.parameters():
        assert rows[report.name] == (report.name, report.value, report.std, report.unit, report.state)
    assert [item for item in told[2:] if item.startswith("  held: ")] == [f"  held: {text}" for text in fit.held()]
    assert any("stiffness_m acts only through" in item for item in told[2:])
    assert "delta_alpha4" in fit.summary()
    assert "delta_alpha4" in fit._repr_html_()
    assert len(repr(fit)) < 2000


def test_other_objectives_say_what_they_reached(fit):
    least = identify_by(fit.problem.arm, fit.problem.points, "34", objective="max")
    assert "largest fitted error" in least.headline()
    assert f"certified: not below {1e3 * least.lower_bound:.3f} mm" in least.headline()


def test_a_row_a_parameter(fit):
    frame = fit.to_frame().set_index("name")
    for report in fit.parameters():
        row = frame.loc[report.name]
        assert (row["value"], row["unit"], row["state"], row["reason"]) == (
            report.value, report.unit, report.state, report.reason,
        )  # fmt: skip
        assert np.isnan(row["std"]) if report.std is None else row["std"] == report.std


@pytest.mark.parametrize("options", [{}, {"objective": "max"}, {"objective": "pnorm"}, {"loss": "huber"}])
def test_it_can_be_pickled(fit, options):
    found = identify_by(fit.problem.arm, fit.problem.points, "34", **options)
    again = pickle.loads(pickle.dumps(found))
    assert again.summary() == found.summary()
    assert again.to_frame().equals(found.to_frame())


def test_arrays_cannot_be_changed(fit):
    with pytest.raises(ValueError, match="read-only"):
        fit.solution.state.errors[0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        fit.solution.information.seen[0] = False


def test_an_unknown_target_is_refused(fit):
    with pytest.raises(RobotError, match="unknown target 'smr9': this fit has smr1, smr2, smr3"):
        fit.predicted_covariance(np.zeros((1, 6)), "smr9")
