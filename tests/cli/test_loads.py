"""Several loads from the command line: measured, calibrated, predicted, corrected, judged (SIMULATED)."""

from io import BytesIO

import numpy as np
import pandas as pd
import pytest

import irbcal
from irbcal.errors import OptionError


def measured(load, poses, seed):
    table = irbcal.simulate("irb1600", random=poses, seed=seed, payload=load).to_frame()
    return table.assign(pose=[f"{load:g}kg-{pose}" for pose in table["pose"]])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("loads")
    pd.concat([measured(0.0, 30, 1), measured(6.0, 50, 2)]).to_csv(folder / "both.csv", index=False)
    measured(12.0, 30, 3).to_csv(folder / "third.csv", index=False)
    (folder / "q.csv").write_text("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n0,20,0,0,30,0\n50,40,-20,20,40,10\n")
    return folder


@pytest.fixture(scope="module")
def calibration(folder):
    found = irbcal.calibrate(folder / "both.csv", "irb1600", "auto")
    found.save(folder / "cal")
    return folder / "cal"


def test_each_load_has_its_tool_and_the_usual_one_is_said(calibration):
    record = irbcal.load(calibration).record
    assert set(record.placement.targets_mm) == {f"smr{k}{load}" for k in (1, 2, 3) for load in ("", "@0kg")}
    text = " ".join(record.notes)
    assert "Each load has a tool of its own" in text
    assert "predictions and corrections are for 6 kg" in text
    assert record.usual_load == record.joint_map.payload_kg == 6.0
    loads = np.array(record.poses.inputs["payload_kg"])
    assert set(loads) == {0.0, 6.0}
    points, _ = record.used_points(heldout=False)
    errors = np.array(record.points.calibrated_mm)[~np.array(record.points.heldout)]
    again = irbcal.measurement.points.distances(record.robot_calibrated(), points)
    np.testing.assert_allclose(np.sort(again), np.sort(errors) * 1e-3, rtol=0, atol=1e-8)


def test_forward_and_inverse_for_a_load(calibration, folder, program, tmp_path):
    columns = ["x_mm", "y_mm", "z_mm"]
    places = []
    for load in ("0", "6", "12"):
        text = program("fk", calibration, "--joints", folder / "q.csv", "--payload", load)
        (tmp_path / f"{load}.csv").write_text(text)
        places.append(pd.read_csv(tmp_path / f"{load}.csv")[columns].to_numpy())
    usual = program("fk", calibration, "--joints", folder / "q.csv")
    assert usual == (tmp_path / "6.csv").read_text()
    sag = np.array([places[1] - places[0], places[2] - places[1]])[..., 2]
    assert (sag < -0.05).all()
    np.testing.assert_allclose(sag[0], sag[1], rtol=0.01)
    back = program("ik", calibration, "--poses", tmp_path / "12.csv", "--payload", 12, "--near", "0,20,0,0,30,0")
    (tmp_path / "back.csv").write_text(back)
    q = pd.read_csv(folder / "q.csv")
    assert np.abs(pd.read_csv(tmp_path / "back.csv")[q.columns] - q).to_numpy().max() < 1e-5
    there = program("fk", calibration, "--joints", folder / "q.csv", "--payload", 12, "--payload-centre", "0,0,500")
    (tmp_path / "far.csv").write_text(there)
    assert (pd.read_csv(tmp_path / "far.csv")["z_mm"] < places[2][:, 2] - 0.01).all()
    for absurd in (-1.0, 5001.0, 1e308):
        with pytest.raises(OptionError, match="payload: expected a number from 0 to 5000"):
            irbcal.forward_kinematics(calibration, folder / "q.csv", payload=absurd)


def test_a_program_is_corrected_for_a_load(calibration, folder, program, tmp_path):
    q = pd.read_csv(folder / "q.csv")
    program("filter", calibration, folder / "q.csv", "--out", tmp_path / "job.csv", "--payload", 12)
    commands = np.radians(pd.read_csv(tmp_path / "job.csv", comment="#")[q.columns].to_numpy())
    record = irbcal.load(calibration).record
    wanted = record.arm(calibrated=False).forward(np.radians(q.to_numpy()))
    robot = record.robot_calibrated()
    previous = np.vstack([np.full(6, np.nan), commands[:-1]])
    reached = robot.carrying(12.0).forward(commands, previous)
    assert np.abs(reached - wanted)[:, :3, 3].max() < 1e-7
    assert np.abs(robot.forward(commands, previous) - wanted)[:, :3, 3].max() > 5e-5


def test_a_table_names_the_load_of_each_row(calibration, folder, program, tmp_path):
    """As the option does for a whole table: forward, inverse and correction."""
    q = pd.read_csv(folder / "q.csv").iloc[[0, 1, 0, 1]].assign(payload_kg=[0, 12, 12, 6])
    joints = np.radians(q.iloc[:, :6].to_numpy(dtype=float))
    alone = [
        irbcal.forward_kinematics(calibration, row[None], payload=kg)
        for row, kg in zip(joints, q["payload_kg"], strict=True)
    ]
    q.to_csv(tmp_path / "q.csv", index=False)
    found = irbcal.forward_kinematics(calibration, tmp_path / "q.csv", target="smr1", uncertainty=True, intervals=True)
    np.testing.assert_allclose(found.T_base_tip, np.concatenate([a.T_base_tip for a in alone]), rtol=0, atol=1e-12)
    robot = irbcal.load(calibration).record.robot_calibrated()
    reflector = robot.target_position("smr1")
    places = [(robot.T_world_base @ a.T_base_tip[0] @ np.append(reflector, 1.0))[:3] for a in alone]
    np.testing.assert_allclose(found.points, places, rtol=0, atol=1e-12)
    poses = irbcal.forward_kinematics(calibration, tmp_path / "q.csv").to_frame()
    poses[["x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz", "payload_kg"]].to_csv(tmp_path / "poses.csv", index=False)
    for how in ({"near": joints[0]}, {"all_branches": True}):
        back = irbcal.inverse_kinematics(calibration, tmp_path / "poses.csv", **how)
        assert set(back.row.tolist()) == {0, 1, 2, 3}
        assert (np.diff(back.row) >= 0).all()
        for k, solution in zip(back.row, back.joints, strict=True):
            there = robot.carrying(float(q["payload_kg"].iloc[k])).poses(solution[None])[0]
            assert np.abs(there - found.T_base_tip[k]).max() < 1e-8
    with pytest.raises(OptionError, match=r"path: expected one load on the way, found 3"):
        irbcal.inverse_kinematics(calibration, tmp_path / "poses.csv", path=True)
    for function in (irbcal.forward_kinematics, irbcal.inverse_kinematics):
        name = "q.csv" if function is irbcal.forward_kinematics else "poses.csv"
        with pytest.raises(OptionError, match=r"payload: the table gives it"):
            function(calibration, tmp_path / name, payload=3.0)
    corrected = irbcal.correct(calibration, tmp_path / "q.csv")
    before = np.vstack([np.full(6, np.nan), corrected.q[:-1]])
    reached = robot.forward(corrected.q, before, payload_kg=q["payload_kg"].to_numpy(dtype=float))
    wanted = irbcal.load(calibration).record.arm(calibrated=False).forward(joints)
    assert np.abs(reached - wanted)[:, :3, 3].max() < 1e-7
    q.assign(payload_kg=[0, 12, "", 6]).to_csv(tmp_path / "gap.csv", index=False)
    for refused in (irbcal.forward_kinematics, irbcal.correct):
        with pytest.raises(irbcal.IrbcalError, match=r"gap\.csv: row 4, column payload_kg: expected a mass"):
            refused(calibration, tmp_path / "gap.csv")


def test_measurements_and_results_carry_the_loads_of_their_tables(calibration, folder):
    measured_poses = irbcal.read_measurements(folder / "both.csv")
    load = measured_poses.per_pose("payload_kg")
    robot = irbcal.load(calibration).record.robot_calibrated()
    poses = irbcal.forward_kinematics(calibration, measured_poses)
    wanted = robot.forward(measured_poses.joints(), payload_kg=load)
    np.testing.assert_allclose(poses.T_base_tip, wanted, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(poses.to_frame()["payload_kg"], load)
    places = {"payload_x_mm": 10.0, "payload_y_mm": 0.0, "payload_z_mm": 90.0} | {f"tau{k}_nm": k for k in range(1, 7)}
    full = measured_poses.to_frame().assign(**places)
    first = irbcal.forward_kinematics(calibration, full.drop_duplicates("pose"))
    again = irbcal.forward_kinematics(calibration, irbcal.read_measurements(full))
    np.testing.assert_allclose(again.T_base_tip, first.T_base_tip, rtol=0, atol=1e-12)
    assert np.abs(again.T_base_tip - wanted).max() > 1e-6
    for results in (first, again):
        back = irbcal.forward_kinematics(calibration, irbcal.inverse_kinematics(calibration, results))
        assert np.abs(back.T_base_tip - again.T_base_tip)[:, :3, 3].max() < 1e-8
    for how in ({}, {"all_branches": True}):
        joints = irbcal.inverse_kinematics(calibration, poses, **how)
        joints = irbcal.kinematics.InverseJoints(
            **{name: getattr(joints, name)[joints.solved] for name in ("joints", "row", "note")},
            branch=None,
            arm=joints.arm,
            input_columns=joints.input_columns,
        )
        assert len(joints) >= 60
        there = irbcal.forward_kinematics(calibration, joints).T_base_tip
        assert np.abs(there - wanted[joints.row])[:, :3, 3].max() < 1e-8
    for function, given in (
        (irbcal.forward_kinematics, measured_poses),
        (irbcal.forward_kinematics, joints),
        (irbcal.inverse_kinematics, poses),
    ):
        with pytest.raises(OptionError, match=r"payload: the table gives it"):
            function(calibration, given, payload=3.0)


def test_a_table_of_targets_and_the_option_do_not_both_name_the_load(calibration, folder, tmp_path):
    q = pd.read_csv(folder / "q.csv")
    for name, more in (("plain.csv", {}), ("timed.csv", {"time_s": [0.0, 4.0]})):
        q.assign(payload_kg=[0, 12], **more).to_csv(tmp_path / name, index=False)
        with pytest.raises(OptionError, match=r"payload: the table gives it"):
            irbcal.correct(calibration, tmp_path / name, payload=3.0)


def test_speeds_of_a_motion_are_those_with_the_load_of_each_row(calibration, tmp_path):
    time, phase = np.arange(12) * 0.2, np.arange(6)
    angle = time[:, None] + phase
    values = {"q{}_deg": 20 * np.sin(angle), "v{}_deg_s": 20 * np.cos(angle), "a{}_deg_s2": -20 * np.sin(angle)}
    columns = {name.format(k + 1): column[:, k] for name, column in values.items() for k in phase}
    table = pd.DataFrame({"time_s": time} | columns)
    load = np.where(time < 1.0, 0.0, 12.0)
    table.to_csv(tmp_path / "motion.csv", index=False)
    table.assign(payload_kg=load).to_csv(tmp_path / "loaded.csv", index=False)

    def corrected(name, **options):
        data = irbcal.correct(calibration, tmp_path / name, **options).data
        return pd.read_csv(BytesIO(data))[list(columns)].to_numpy()

    empty, heavy = (corrected("motion.csv", payload=kg) for kg in (0.0, 12.0))
    np.testing.assert_allclose(corrected("loaded.csv"), np.where(load[:, None] == 0.0, empty, heavy), rtol=0, atol=2e-6)
    assert (np.abs(empty - heavy).max(axis=0).reshape(3, 6).max(axis=1) > 1e-3).all()


def test_evaluate_at_another_load(calibration, folder, program):
    judged = program("evaluate", calibration, folder / "third.csv", "--same-tool", "--json")
    assert judged["calibrated"]["mean_mm"] < 0.12
    assert any("for 12 kg, too" in note for note in judged["notes"])
    untold = pd.read_csv(folder / "third.csv").filter(regex="^(?!payload)")
    untold.to_csv(folder / "untold.csv", index=False)
    usual = program("evaluate", calibration, folder / "untold.csv", "--json")
    assert usual["calibrated"]["mean_mm"] > 1.5 * judged["calibrated"]["mean_mm"]
    told = program("evaluate", calibration, folder / "untold.csv", "--payload", 12, "--same-tool", "--json")
    assert told["calibrated"]["mean_mm"] < 0.12
    with pytest.raises(irbcal.IrbcalError, match="where the reflectors were with 12 kg is not known"):
        irbcal.evaluate(calibration, folder / "third.csv")
    with pytest.raises(irbcal.IrbcalError, match="the table gives it"):
        irbcal.evaluate(calibration, folder / "third.csv", payload=12.0)


def test_what_one_load_does_not_tell(folder):
    frame = pd.read_csv(folder / "both.csv")
    one = irbcal.calibrate(frame[frame["payload_kg"] == 6.0], "irb1600", "auto")
    assert any("a payload of 6 kg" in note for note in one.record.notes)
    with pytest.raises(irbcal.IrbcalError, match="with 6 kg only"):
        irbcal.forward_kinematics(one, np.zeros((1, 6)), payload=3.0)
    judged = irbcal.evaluate(one, folder / "third.csv")
    assert any("12 kg are judged by a calibration that was measured with 6 kg only" in note for note in judged.notes)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"torques": True}, "there are no torques"),
        ({"payload_centre": [0.0, 0.0, 0.1]}, "give the payload's centre"),
        ({"payload_centre": [0.0, 0.1]}, "payload_centre"),
        ({"as_poses": True}, "several loads"),
        ({"model": "34", "torques": True}, "only model auto"),
    ],
)
def test_options_that_do_not_fit_are_refused(folder, options, words):
    with pytest.raises(irbcal.IrbcalError, match=words):
        irbcal.calibrate(folder / "both.csv", "irb1600", **{"model": "auto"} | options)
