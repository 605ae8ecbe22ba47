"""Model auto from end to end: measurements, calibration, file, and every command that uses it; real robots."""

import json

import numpy as np
import pandas as pd
import pytest
from support import arm, assert_derivative, assert_same_poses, measured, on_a_rail, random_robot, write_measurements

import irbcal
from irbcal.errors import OptionError, RobotError
from irbcal.identification.evidence_fit import EvidenceFit
from irbcal.io import integrity
from irbcal.io.term_sections import JointMapSection
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.terms import families
from irbcal.modeling.terms.term_map import TermMap
from irbcal.planners.calibrated_model import CalibratedModel

POSES = 120


def truth(name="irb120"):
    """A robot with the thesis's geometry errors and a joint map of gravity, gains, harmonics and a gear."""
    model, rng = arm(name), np.random.default_rng(7)
    robot = random_robot(model, "26", rng)
    terms = [t for family in ("gravity", "gain", "harmonics") for t in families()[family].terms(model)]
    terms = [t for t in terms if t.parameters.get("cycles_per_turn", 0) <= 2]
    values = np.array([t.size for t in terms]) * rng.standard_normal(len(terms))
    return robot.replace(joint_map=JointMap(TermMap(model, tuple(terms), values)))


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    robot, folder = truth(), tmp_path_factory.mktemp("auto")
    points = measured(robot, robot.arm.random_joints(POSES, 3), 2e-5, np.random.default_rng(1))
    write_measurements(folder / "m.csv", points)
    calibration = irbcal.calibrate(folder / "m.csv", "irb120", "auto", holdout=30)
    calibration.save(folder / "cal")
    return calibration


@pytest.fixture(scope="module")
def folder(made, tmp_path_factory):
    path = tmp_path_factory.mktemp("saved") / "cal"
    made.save(path)
    return path


def test_what_was_made_is_what_is_loaded(made, folder):
    loaded = irbcal.load(folder)
    assert isinstance(made.validated.fit, EvidenceFit)
    q, previous = made.arm().random_joints(100, 1), made.arm().random_joints(100, 2)
    one, two = made.validated.fit.robot, loaded.robot_calibrated()
    assert_same_poses(one.poses(q), two.poses(q), 1e-12, 1e-12)
    assert_same_poses(one.forward(q, previous), two.forward(q, previous), 1e-12, 1e-12)
    assert loaded.record.model_dump(exclude={"seal"}) == made.record.model_dump(exclude={"seal"})
    assert loaded.record.heldout.all.mean_mm < 0.05 * loaded.record.heldout_nominal.all.mean_mm
    content = json.loads((folder / "calibration.json").read_text())
    assert content["joint_map"]["schema"] == "irbcal-joint-map-1"
    assert content["model"] == content["choice"]["level"] == "auto"
    assert content["undetermined"] == content["observability"]["singular_values_mm"] == []
    assert content["history"] == {}
    assert {row["state"] for row in content["parameters"]} == {"identified"}
    assert content["covariance"]["size"] == len(content["parameters"])


def test_the_fingerprint_covers_the_terms(made):
    joint_map = made.validated.fit.robot.joint_map
    other = JointMap(
        TermMap(joint_map.terms.arm, joint_map.terms.terms, 1.001 * joint_map.terms.coefficients), joint_map.ranges
    )
    changed = made.record.model_copy(update={"joint_map": JointMapSection.from_joint_map(other, joint_map.terms.arm)})
    assert integrity.fingerprint(dict(made.record)) == made.record.fingerprint
    assert integrity.fingerprint(dict(changed)) != made.record.fingerprint


def test_the_geometry_is_in_the_urdf(folder):
    pin = pytest.importorskip("pinocchio")
    calibration = irbcal.load(folder)
    robot = calibration.robot_calibrated()
    model = pin.buildModelFromXML(calibration.urdf.decode())
    data = model.createData()
    for q in robot.arm.random_joints(20, 5):
        pin.framesForwardKinematics(model, data, robot.joint_map.effective(q[None])[0])
        base, tip = (data.oMf[model.getFrameId(name)] for name in (robot.arm.base_link, robot.arm.tip_link))
        assert_same_poses(base.actInv(tip).homogeneous[None], robot.poses(q[None]), 1e-9, 1e-9)


def test_forward_and_inverse_commands_undo_each_other(folder, program, tmp_path):
    nominal = arm("irb120")
    q = 0.6 * nominal.random_joints(100, 4)
    columns = [f"q{k}_deg" for k in range(1, 7)]
    pd.DataFrame(np.degrees(q), columns=columns).to_csv(tmp_path / "q.csv", index=False)
    (tmp_path / "p.csv").write_text(program("fk", folder, "--joints", tmp_path / "q.csv"))
    (tmp_path / "back.csv").write_text(program("ik", folder, "--poses", tmp_path / "p.csv"))
    back = np.radians(pd.read_csv(tmp_path / "back.csv")[columns].to_numpy())
    robot = irbcal.load(folder).robot_calibrated()
    assert_same_poses(robot.poses(back), robot.poses(q), 2e-9, 2e-8)  # printed with nine decimals
    found = irbcal.inverse_kinematics(folder, robot.poses(q))
    assert found.solved.all()
    assert_same_poses(robot.poses(found.joints), robot.poses(q), 1e-9, 1e-9)


def test_a_filtered_program_reaches_the_wanted_poses(folder, program, tmp_path):
    nominal = arm("irb120")
    q = 0.5 * nominal.random_joints(60, 6)
    q[:, 4] = np.where(np.abs(q[:, 4]) < 0.2, 0.4, q[:, 4])
    columns = [f"q{k}_deg" for k in range(1, 7)]
    pd.DataFrame(np.degrees(q), columns=columns).to_csv(tmp_path / "program.csv", index=False)
    program("filter", folder, tmp_path / "program.csv", "--out", tmp_path / "fake.csv")
    fake = np.radians(pd.read_csv(tmp_path / "fake.csv", comment="#")[columns].to_numpy())
    before = np.vstack([np.full((1, 6), np.nan), fake[:-1]])  # in the order of the program
    reached = irbcal.load(folder).robot_calibrated().forward(fake, before)
    assert_same_poses(reached, nominal.forward(q), 1e-7, 1e-7)  # joints are written with few decimals


def test_evaluate_counts_poses_outside_the_joint_ranges(folder, tmp_path):
    robot = truth()
    calibration = irbcal.load(folder)
    low, high = np.array(calibration.record.joint_map.ranges)
    q = low + (high - low) * np.random.default_rng(3).uniform(0.05, 0.95, (20, 6))
    inside = write_measurements(tmp_path / "in.csv", measured(robot, q, 2e-5, np.random.default_rng(2)))
    assert not [note for note in irbcal.evaluate(folder, inside).notes if "joint ranges" in note]
    limits = robot.arm.upper
    q[:3, 1] = np.minimum(high[1] + 0.01, limits[1])
    q[3, 4] = high[4] + 0.01
    outside = write_measurements(tmp_path / "out.csv", measured(robot, q, 2e-5, np.random.default_rng(2)))
    notes = [note for note in irbcal.evaluate(folder, outside).notes if "joint ranges" in note]
    assert len(notes) == 1
    assert notes[0].startswith("4 of 20 poses lie outside the joint ranges")
    assert "(joint_2 in 3 by up to 0.6 degrees, joint_5 in 1 by up to 0.6 degrees)" in notes[0]


def test_the_terminal_shows_what_was_averaged(program, folder, made, tmp_path):
    data = tmp_path / "m.csv"
    write_measurements(data, made.validated.fit_points)
    words = ["--robot", "irb120", "--model", "auto", "--out", tmp_path / "o", "--holdout", "10", "--verbose"]
    out = program("calibrate", data, *words)
    for words in ("Error models compared by their evidence", "weight", "Valid within the joint ranges"):
        assert words in out
    printed = made.to_dict()
    assert printed["choice"]["level"] == "auto"
    assert sum(row["weight"] for row in printed["choice"]["table"]) == pytest.approx(1.0, abs=1e-9)
    page = (folder / "report.html").read_text()
    for words in ("Groups of terms", "log evidence", "Joint ranges", "irbcal-joint-map-1"):
        assert words in page
    assert "Groups of terms" in out
    assert len(irbcal.load(folder).summary().splitlines()) <= 40


def test_uncertainty_of_a_saved_calibration_is_that_of_the_fit(made):
    q = made.arm().random_joints(30, 2)
    seen = made.validated.fit.robot.predict(q, target="smr2")
    expected = np.sqrt(np.diagonal(seen.covariance, axis1=1, axis2=2))
    assert made.record.robot_calibrated().position_std(q, "smr2") == pytest.approx(expected, rel=1e-3)
    assert (made.record.robot_calibrated().position_std(q) > 0.0).all()


def test_planners_get_the_derivatives(folder):
    pytest.importorskip("pinocchio")
    model = CalibratedModel.load(folder)
    q = 0.5 * arm("irb120").random_joints(3, 8)
    J = model.jacobian(q)
    for row, own in zip(q, J, strict=True):
        assert_derivative(lambda x: model.placement(x[None])[0, :3, 3], row, own[:3], 1e-8)
    assert np.abs(model.command_from_model(model.model_from_command(q)) - q).max() < 1e-12
    with pytest.raises(RobotError):
        model.with_payload(1.0)


def test_other_options_of_the_levels_are_refused(made, tmp_path):
    for option, value in (("objective", "max"), ("method", "nelder-mead"), ("loss", "huber"), ("free", ["gain1"])):
        with pytest.raises(OptionError, match=f"takes no {option}"):
            irbcal.calibrate(tmp_path / "m.csv", "irb120", "auto", **{option: value})


def test_it_is_the_default_but_where_it_cannot_serve(made, tmp_path):
    data = write_measurements(tmp_path / "m.csv", made.validated.fit_points)
    assert irbcal.calibrate(data, "irb120", holdout=0).record.model == "auto"
    level = irbcal.calibrate(data, "irb120", loss="huber", hold=["delta_d5"], holdout=0)
    assert level.record.model == "34"
    assert any("(auto): loss and hold belong to a level" in note for note in level.record.notes)
    few = irbcal.calibrate(data, "irb120", holdout=0.9)
    assert (few.record.model, few.record.poses_fit) == ("34", 9)
    assert any("9 poses are too few to weigh error models" in note for note in few.record.notes)


def test_arms_with_a_prismatic_joint(tmp_path):
    rail = on_a_rail(tmp_path / "rail.urdf")
    model = irbcal.read_urdf(rail, "rail_base").arm
    robot = random_robot(model, "placement", np.random.default_rng(2), size=0.1)
    points = measured(robot, model.random_joints(100, 1), 2e-5, np.random.default_rng(3))
    data = write_measurements(tmp_path / "m.csv", points, columns=model.joint_columns)
    made = irbcal.calibrate(data, rail, "auto", base_link="rail_base")
    level = irbcal.calibrate(data, rail, "placement", base_link="rail_base")
    assert made.record.heldout.all.mean_mm < 1.2 * level.record.heldout.all.mean_mm
    made.save(tmp_path / "cal")
    q = model.random_joints(20, 4)
    assert_same_poses(
        irbcal.load(tmp_path / "cal").robot_calibrated().poses(q), made.robot_calibrated().poses(q), 1e-12, 1e-12
    )
