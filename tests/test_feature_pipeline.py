import re
from io import StringIO

import feature_cases as cases
import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import irbcal
from irbcal.cli.main import app
from irbcal.errors import IdentificationError, OptionError
from irbcal.identification.feature_fit import identify_features
from irbcal.measurement import features
from irbcal.modeling import frames
from irbcal.modeling.parameters import level_parameters

KNOWN = pd.DataFrame([{"feature": f"point {k}", "kind": "point"} for k in range(3)])


@pytest.fixture(scope="module")
def contacts():
    """SIMULATED: three sockets, 0.01 mm of noise by the joints."""
    table, _ = cases.rows("point", cases.true_arm(cases.arm(), 7), 40, 2)
    joints = [f"q{k}_deg" for k in range(1, 7)]
    table[joints] += np.degrees(1e-5) * np.random.default_rng(0).standard_normal((len(table), 6))
    return table.assign(simulated="yes")


def test_a_folder_like_any_other_comes_out(contacts, tmp_path):
    contacts.to_csv(tmp_path / "contacts.csv", index=False)
    KNOWN.to_csv(tmp_path / "features.csv", index=False)
    line = [
        "calibrate",
        "contacts.csv",
        "--features",
        "features.csv",
        "--robot",
        "irb1600",
        "--out",
        "robot",
        "--verbose",
    ]
    line = [str(tmp_path / word) if word.endswith((".csv", "robot")) and "-" not in word else word for word in line]
    told = CliRunner().invoke(app, line)
    assert told.exit_code == 0, told.output
    assert "SIMULATED" in told.output
    words = " ".join(told.output.split())
    assert (
        "No length was measured that determines the size of the arm: the scale rests on nominal link lengths." in words
    )
    assert "not its accuracy in a measuring frame" in words
    found = irbcal.load(tmp_path / "robot")
    assert found.record.features.left_out == "features"
    assert any("0.3 % longer than nominal fits these rows as well" in doubt for doubt in found.record.doubts)
    assert [row.rows for row in found.record.features.places] == [40, 40, 40]
    assert found.record.heldout.all.mean_mm < 0.2 * found.record.heldout_nominal.all.mean_mm
    robot = found.robot_calibrated()
    q = cases.arm().random_joints(20, 1) * 0.5
    prediction = robot.predict(q, target="ball")
    assert np.isfinite(prediction.interval).all()
    truth = cases.true_arm(cases.arm(), 7)
    assert cases.apart(truth, robot.arm, q, robot.targets["ball"]).mean() < 1e-3
    page = (tmp_path / "robot" / "report.html").read_text()
    (worst,) = re.findall(r'<section id="poses">.*?</table>', page, re.DOTALL)
    (shown,) = pd.read_html(StringIO(worst))
    measured = contacts.set_index(contacts["pose"].astype(str)).loc[shown["pose"].astype(str)]
    joints = [f"q{k}_deg" for k in range(1, 7)]
    np.testing.assert_allclose(shown[[f"q{k} (deg)" for k in range(1, 7)]], measured[joints], rtol=0, atol=0.0051)
    assert len(shown.columns) == 4 + 6  # none of what rows at features do not have
    assert 'id="features"' in page
    assert "Distance from features, " in page
    assert "Position error, " not in page
    again = CliRunner().invoke(app, ["verify", str(tmp_path / "robot")])
    assert again.exit_code == 0, again.output


def test_outliers_among_rows_at_features_are_named_and_left_out(contacts):
    wrong = contacts.copy()
    wrong.loc[7, "q1_deg"] += 0.5
    wrong.loc[50, "feature"] = "point 2"
    calibration = irbcal.calibrate(wrong, "irb1600", features=KNOWN)
    reasons = [exclusion.reason for exclusion in calibration.record.excluded]
    assert [reason.split(" is ")[0] for reason in reasons] == ["row 8 (point 0)", "row 51 (point 2)"]
    assert calibration.record.poses_excluded == 2
    assert calibration.record.poses_fit == calibration.record.poses_heldout == 118
    assert calibration.verdict.left_out == 2 / 120
    masked = contacts.copy()
    masked.loc[[1, 2], "q1_deg"] += [30.0, 1.0]  # the second one shows when the first one is gone
    record = irbcal.calibrate(masked, "irb1600", features=KNOWN, leave_out="none").record
    assert [exclusion.pose for exclusion in record.excluded] == [str(contacts["pose"][k]) for k in (1, 2)]
    without = irbcal.calibrate(contacts.drop(index=[7, 50]), "irb1600", features=KNOWN, leave_out="none")
    assert without.record.excluded == []
    q = cases.arm().random_joints(20, 1)
    moved = cases.apart(calibration.robot_calibrated().arm, without.robot_calibrated().arm, q)
    assert moved.max() < 1e-9
    truth = cases.true_arm(cases.arm(), 7)
    bent = identify_features(cases.arm(), features.read(wrong, KNOWN, cases.arm()))
    apart = [cases.apart(truth, fit.arm, q, fit.targets["ball"]).mean() for fit in (bent, without.robot_calibrated())]
    assert apart[1] < 0.5 * apart[0]


def test_many_rows_that_contradict_the_others_are_a_doubt(contacts):
    wrong = contacts.copy()
    wrong.loc[::8, "q1_deg"] += np.linspace(0.5, 2.0, 15)
    record = irbcal.calibrate(wrong, "irb1600", features=KNOWN, leave_out="none").record
    assert record.excluded == []
    assert record.poses_fit == 120
    assert any("more than 10% of all rows" in doubt for doubt in record.doubts)


def test_planes_alone_are_refused_and_make_a_robot_worse():
    """SIMULATED: three plates that bend by 0.4 mm; a fit flattens them and bends the arm instead."""
    nominal, rng, parts = cases.arm(), np.random.default_rng(0), []
    truth = cases.true_arm(nominal, 3, scale=0.15)
    for k, (spot, up) in enumerate(
        (((0.8, 0, 0.4), (0, 0, 1)), ((1.0, 0, 0.5), (1, 0, 0)), ((0.8, 0.4, 0.5), (0, 1, 0)))
    ):
        own = {"centre": np.array(spot) - 300.0 * np.array(up), "radius": np.array([300.0])}
        q, _, _ = cases.contact(truth, "sphere", own, 25, rng, noise=2e-5)
        part = pd.DataFrame(np.degrees(q), columns=[f"q{j}_deg" for j in range(1, 7)])
        parts.append(part.assign(pose=[f"{k} {j}" for j in range(25)], feature=f"plate {k}", kind="plane"))
    table = pd.concat(parts, ignore_index=True)
    known = pd.DataFrame([{"feature": f"plate {k}", "kind": "plane"} for k in range(3)])
    with pytest.raises(IdentificationError, match="may make the robot worse"):
        irbcal.calibrate(table, "irb1600", features=known)
    found = identify_features(nominal, features.read(table, known, nominal))
    flat = [np.sqrt(np.mean(found.problem.distances(state) ** 2)) for state in (found.nominal_state, found.state)]
    q = nominal.random_joints(200, 5) * 0.8
    tools = [state.values["tool", "ball"] for state in (found.nominal_state, found.state)]
    arms = nominal, found.arm
    tracker = [cases.apart(truth, arm, q, tool).mean() for arm, tool in zip(arms, tools, strict=True)]
    assert flat[1] < 0.5 * flat[0]
    assert tracker[1] > 1.5 * tracker[0]


def test_a_tracker_and_sockets_in_one_fit():
    """The oracle is the arm that made both; the tracker's poses are left out in parts, each socket by itself."""
    nominal, truth, T = cases.arm(), cases.true_arm(cases.arm(), 7), cases.world()
    table, known = cases.rows("point", truth, 12, 2, 2e-5)
    q = nominal.random_joints(24, 4) * 0.8
    xyz = frames.apply(T, cases.tip(truth, q)[0]) * 1e3 + np.random.default_rng(0).normal(0, 0.02, (24, 3))
    tracked = pd.DataFrame(np.degrees(q), columns=[f"q{j}_deg" for j in range(1, 7)])
    tracked[["x_mm", "y_mm", "z_mm"]] = xyz
    rows = pd.concat([table, tracked.assign(pose=[f"t{k}" for k in range(24)], feature="")]).astype(object)
    found = irbcal.calibrate(rows.where(rows.notna(), ""), "irb1600", features=known.fillna(""))
    assert [row.name for row in found.record.features.places][:3] == ["point 0", "point 1", "point 2"]
    assert len(found.record.features.places) == 7
    assert found.record.features.in_frame
    assert found.record.features.scale == ""
    fresh = nominal.random_joints(50, 9) * 0.8
    away = found.robot_calibrated().points(fresh, "ball") - frames.apply(T, cases.tip(truth, fresh)[0])
    assert np.linalg.norm(away, axis=1).mean() < 0.05e-3


def test_options_of_other_ways_are_refused(contacts):
    with pytest.raises(OptionError, match="verify: rows at features do not take it"):
        irbcal.calibrate(contacts, "irb1600", features=KNOWN, verify="other.csv")
    with pytest.raises(OptionError, match="take auto or a level of error parameters, not best-level"):
        irbcal.calibrate(contacts, "irb1600", "best-level", features=KNOWN)
    with pytest.raises(OptionError, match="needs a constant of the geometry"):
        irbcal.calibrate(contacts, "irb1600", "34", features=KNOWN, hold=["delta_*"])
    with pytest.raises(OptionError, match="only rows at features have places"):
        irbcal.calibrate(contacts, "irb1600", leave_out="place")


def test_a_level_at_features_fits_its_error_parameters_and_no_others(tmp_path):
    """The oracle is an arm with errors of those parameters alone, between poses that were not touched."""
    nominal, truth = cases.arm(), cases.true_arm(cases.arm(), 7, lengths=False)
    table, known = cases.rows("point", truth, 25, 4, 1e-5)
    result = irbcal.calibrate(table, "irb1600", "26", features=known, hold=["delta_d3"], leave_out="none")
    assert result.record.model == "26"
    assert any("no tilt between the parallel axes 2 and 3" in note for note in result.record.notes)
    names = {row.name for row in result.record.parameters if not row.name.startswith(("base", "target"))}
    assert names == {p.name for p in level_parameters("26")} - {"delta_d3"}
    assert not result.robot_calibrated().joint_map.terms.terms
    result.save(tmp_path / "robot")
    assert irbcal.load(tmp_path / "robot").record.choice.level == "26"
    q = nominal.random_joints(50, 1) * 0.5
    target = result.robot_calibrated().targets["ball"]
    left = cases.apart(truth, result.robot_calibrated().arm, q, target).mean()
    assert left < 0.2 * cases.apart(truth, nominal, q, target).mean()


def test_planes_and_one_known_length_make_a_robot_better(tmp_path):
    """SIMULATED; a tracker is the witness. Planes alone are refused, two balls alone are too few."""
    parts = [
        irbcal.simulate_device("irb1600", "plane", 60, seed=1, only=["noise"]),
        irbcal.simulate_device("irb1600", "two-balls", 16, seed=2, only=["noise"]),
    ]
    rows = pd.concat(
        [
            part.to_frame().assign(pose=lambda table, k=k: f"{k} " + table.pose.astype(str))
            for k, part in enumerate(parts)
        ]
    )
    rows.to_csv(tmp_path / "rows.csv", index=False)
    pd.concat([part.features() for part in parts]).to_csv(tmp_path / "features.csv", index=False)
    done = irbcal.calibrate(tmp_path / "rows.csv", "irb1600", features=tmp_path / "features.csv")
    irbcal.simulate("irb1600", random=40, seed=5, only=["noise"]).save(tmp_path / "tracked.csv")
    errors = irbcal.evaluate(done, tmp_path / "tracked.csv", refit_base=True, refit_tool=True).to_frame()
    assert errors["calibrated_mm"].mean() < 0.3 * errors["nominal_mm"].mean()


@pytest.mark.parametrize(("noise", "doubted"), [(5e-5, True), (2e-6, False)])
def test_a_short_stroke_that_does_not_tell_the_size_of_the_arm_is_doubted(noise, doubted):
    """SIMULATED gauges with a stroke of 20 mm."""
    table, known = cases.rows("gauge", cases.true_arm(cases.arm(), 3), 20, 3, noise)
    table = table.assign(simulated="yes", u95_mm=2e3 * noise)
    record = irbcal.calibrate(table, "irb1600", features=known.fillna("")).record
    assert any("No length was measured that determines the size" in doubt for doubt in record.doubts) is doubted
    assert record.features.scale_measured is not doubted


def test_two_sockets_that_left_the_robot_worse_than_nominal_are_doubted():
    """In the virtual cell joints err beyond the geometry: ways over the range are off by 0.72 mm, with the nominal robot 0.51."""
    made = irbcal.simulate_device("irb1600", device="sockets", random=100, seed=1, robot_seed=1)
    found = irbcal.calibrate(made.to_frame(), "irb1600", features=made.features())
    assert not found.verdict.trusted
    assert any("worse than the nominal" in doubt for doubt in found.record.doubts)
    balls = irbcal.simulate_device("irb1600", device="balls", random=100, seed=1, robot_seed=1)
    assert irbcal.calibrate(balls.to_frame(), "irb1600", features=balls.features()).verdict.trusted
