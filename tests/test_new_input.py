"""An input of the error model in a module of its own, as somebody would add one: from a file to predictions."""

import json
import textwrap
from dataclasses import replace

import new_family
import numpy as np
import pandas as pd
import pytest
from support import TARGETS, arm, random_robot

import irbcal
from irbcal.errors import CalibrationError, MeasurementError, RobotError
from irbcal.exporting.batch import Batch
from irbcal.exporting.plain import Plain
from irbcal.exporting.robot_numbers import RobotNumbers, constants, vectors_of
from irbcal.measurement import cleaning
from irbcal.measurement.input_table import InputTable
from irbcal.measurement.session_blocks import joined
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.terms import families
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term_map import TermMap
from irbcal.sessions import joined_motions

ROOM = textwrap.dedent('''
    """Room: joints turn on as the room warms."""

    from irbcal.modeling.terms.term import Family, Input, Proportional, Term
    from irbcal.units import ColumnKind

    TEMPERATURE = Input(
        "room_c",
        ("room_c",),
        ColumnKind("a temperature in degrees Celsius from -40 to 80", -40.0, 80.0),
        "temperatures",
        "It takes the temperature of the room, 20 degrees where none is given.",
        usual=20.0,
    )


    class Warmth(Proportional):
        """The temperature of the room above 20 degrees Celsius."""

        name = "room"
        inputs = (TEMPERATURE,)


    class Room(Family):
        name = "room"
        bases = (Warmth(),)

        def terms(self, arm):
            return [Term(j, "rz", "room", 1e-5, self.name, self.name, "rad/K") for j in range(len(arm.joint_names))]


    FAMILY = Room()
''')
PER_KELVIN = np.array([0.0, 2e-5, -1e-5, 1.5e-5, 0.0, 0.0])
"""rad/K of each joint."""
NOISE = 1e-5


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    """A robot that measures itself (SIMULATED), and its nominal arm."""
    with pytest.MonkeyPatch.context() as patch:
        new_family.add(tmp_path_factory.mktemp("terms"), patch, "room", ROOM)
        nominal = arm("irb1600")
        joint_map = JointMap(TermMap(nominal, tuple(families()["room"].terms(nominal)), PER_KELVIN))
        targets = {name: np.array(xyz) for name, xyz in TARGETS.items()}
        yield random_robot(nominal, "11", np.random.default_rng(3), targets=targets).replace(joint_map=joint_map)
    new_family.forget()


def measured(truth, poses, seed):
    """A measurement file's rows at temperatures from 12 to 34 degrees."""
    rng = np.random.default_rng(seed)
    q, celsius = truth.arm.random_joints(poses, seed), rng.uniform(12.0, 34.0, poses)
    tips = truth.T_world_base @ truth.forward(q, room_c=celsius)
    parts = []
    for name, xyz in truth.targets.items():
        place = tips[:, :3, :3] @ xyz + tips[:, :3, 3] + NOISE * rng.standard_normal((poses, 3))
        columns = {"pose": np.arange(poses)} | {f"q{k}_deg": angle for k, angle in enumerate(np.degrees(q.T), 1)}
        columns |= {"target": name} | dict(zip(("x_mm", "y_mm", "z_mm"), 1e3 * place.T, strict=True))
        parts.append(pd.DataFrame(columns | {"room_c": celsius, "simulated": "yes"}))
    return pd.concat(parts, ignore_index=True)


def shifts(joint_map):
    """By how much the joints turn on for each kelvin, rad."""
    pairs = zip(joint_map.terms.terms, joint_map.terms.coefficients, strict=True)
    return sum(value * np.eye(6)[term.joint] for term, value in pairs if term.basis == "room")


@pytest.fixture(scope="module")
def folder(truth, tmp_path_factory):
    folder = tmp_path_factory.mktemp("room")
    measured(truth, 60, 1).to_csv(folder / "measured.csv", index=False)
    measured(truth, 20, 2).to_csv(folder / "new.csv", index=False)
    irbcal.calibrate(folder / "measured.csv", "irb1600", "auto").save(folder / "calibration")
    return folder


def test_its_terms_are_identified_from_a_file(folder):
    record = irbcal.load(folder / "calibration").record
    rows = {row.name: row for row in record.parameters if " room" in row.name}
    for j, true in enumerate(PER_KELVIN):
        row = rows[f"rz{j + 1} room"]
        assert row.unit == "rad/K"
        assert abs(row.value - true) < 4.0 * row.std < 8e-6
    assert any("It takes the temperature of the room, 20 degrees" in note for note in record.notes)
    written = json.loads((folder / "calibration" / "calibration.json").read_text())
    assert "room_c" in written["joint_map"]["inputs"]
    assert len(written["poses"]["inputs"]["room_c"]) == len(written["poses"]["pose"])
    points, _ = record.used_points(heldout=None)
    told = pd.read_csv(folder / "measured.csv").groupby("pose")["room_c"].first()
    assert np.abs(points.inputs["room_c"] - told[points.pose_ids.astype(int)]).max() < 1e-12


def test_left_out_poses_are_judged_at_their_temperature(folder):
    told = irbcal.evaluate(folder / "calibration", folder / "new.csv").to_dict()
    untold = irbcal.evaluate(folder / "calibration", pd.read_csv(folder / "new.csv").drop(columns="room_c")).to_dict()
    assert told["calibrated"]["mean_mm"] < 0.05
    assert untold["calibrated"]["mean_mm"] > 3.0 * told["calibrated"]["mean_mm"]


def test_predictions_take_it_by_its_name(folder, truth):
    robot = irbcal.load(folder / "calibration").record.robot_calibrated()
    q = truth.arm.random_joints(30, 7)
    celsius = np.linspace(10.0, 35.0, 30)
    place = truth.forward(q, room_c=celsius)
    true = (truth.T_world_base @ place)[:, :3] @ [*TARGETS["smr1"], 1.0]
    predicted = robot.predict(q, target="smr1", room_c=celsius)
    assert (np.abs(predicted.position - true) < predicted.interval).mean() > 0.9
    assert np.abs(predicted.position - true).max() < 1e-4
    usual = robot.predict(q, target="smr1")
    assert np.array_equal(usual.position, robot.predict(q, target="smr1", room_c=20.0).position)
    gaps = np.where(celsius > 25.0, np.nan, celsius)
    moves, _ = robot.predict_moves(q, target="smr1", room_c=gaps)
    at = np.where(celsius > 25.0, 20.0, celsius)
    assert np.array_equal(moves, robot.predict_moves(q, target="smr1", room_c=at)[0])
    gaps[3] = np.nan
    joint_map, at[3] = robot.joint_map, 20.0
    by_hand = joint_map.terms.effective(Motion(q, inputs={"room_c": at}))
    assert (
        np.abs(joint_map.effective(q, room_c=gaps) - by_hand).max() < 1e-14
    )  # the compiled kernel, where there is one
    assert np.abs(joint_map.effective(q, room_c=30.0) - joint_map.effective(q) - 10.0 * shifts(joint_map)).max() < 1e-14
    back = robot.joint_map.commanded(robot.joint_map.effective(q))
    assert np.abs(back - q).max() < 1e-12
    with pytest.raises(RobotError, match=r"unknown input 'mood': there are .*room_c"):
        robot.forward(q, mood=1.0)


@pytest.mark.parametrize(
    ("cell", "words"),
    [
        ("warm", "found 'warm'"),
        ("", "found nothing"),
        ("90", "expected a temperature in degrees Celsius from -40 to 80"),
    ],
)
def test_what_is_none_is_refused(truth, cell, words):
    rows = measured(truth, 2, 1).astype({"room_c": object})
    rows.loc[1, "room_c"] = cell
    with pytest.raises(MeasurementError, match=f"row 2, column room_c: .*{words}"):
        irbcal.read_measurements(rows)


def test_repeats_are_averaged_and_sessions_joined(truth):
    rows = measured(truth, 4, 1)
    rows.loc[rows["target"] == "smr2", "room_c"] += 3.0
    assert np.allclose(irbcal.read_measurements(rows).input("room_c"), rows["room_c"][:4] + 1.0, rtol=0, atol=1e-12)
    assert np.array_equal(InputTable.read(rows).inputs(6)["room_c"], rows["room_c"])  # as rows at features have it
    points = cleaning.clean(irbcal.read_measurements(rows)).points
    both = joined([("a", points), ("b", replace(points, inputs={}))])
    assert np.array_equal(both.inputs["room_c"], [*points.inputs["room_c"], *[np.nan] * 4], equal_nan=True)
    motions = [Motion(points.q, inputs=points.inputs), Motion(points.q)]
    assert joined_motions(motions).inputs == {}  # told for some only
    assert len(joined_motions(motions[:1] * 2).inputs["room_c"]) == 8


def test_exports_compute_it_or_say_that_they_do_not_know_it(folder, truth):
    robot = irbcal.load(folder / "calibration").record.robot_calibrated()
    parts = RobotNumbers.from_robot(robot)
    numbers = constants(parts, vectors_of(robot, parts))
    q = truth.arm.random_joints(6, 9)  # as many poses as joints
    celsius = np.array([12.0, 20.0, np.nan, 33.0, 25.0, 18.0])
    T = robot.forward(q, room_c=celsius)
    assert np.abs(Batch(**numbers).forward(q, room_c=celsius) - T).max() < 1e-12
    assert np.abs(np.array(Plain(**numbers).forward(q[3].tolist(), room_c=33.0)) - T[3, :3]).max() < 1e-12
    for known in (Batch(**numbers), Plain(**numbers)):
        assert known.check() < 1e-12
        with pytest.raises(TypeError, match=r"unknown input 'mood': there are payload_kg, .*room_c"):
            known.forward(q[0].tolist(), mood=1.0)
    with pytest.raises(CalibrationError, match=r"depends on room_c, which exports in C\+\+ do not know"):
        irbcal.export(folder / "calibration", "cpp", folder / "out")
