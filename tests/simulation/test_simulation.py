"""Measuring in the virtual cell: results, files, and devices in place of a tracker."""

import hashlib
import json
import pickle

import numpy as np
import pytest

import irbcal
from irbcal.errors import IrbcalError, OptionError
from irbcal.measurement import table
from irbcal.simulation import simulation
from irbcal.simulation.devices import BALL, CAMERA_AXES, simulate_device
from irbcal.simulation.pose_list import random_list
from irbcal.simulation.simulation import simulate
from irbcal.units import MM


@pytest.fixture(scope="module")
def simulated():
    return simulate("irb1600", random=30, seed=5)


def test_the_table_is_the_file(simulated, tmp_path):
    out, truth = simulated.save(tmp_path / "m.csv")
    assert truth == tmp_path / "m.truth.json"
    read, given = table.read(out), table.read(simulated.to_frame())
    assert read.simulated
    np.testing.assert_allclose(given.positions(), read.positions(), rtol=0, atol=1e-12)
    np.testing.assert_allclose(given.joints(), read.joints(), rtol=0, atol=1e-12)


def test_it_can_be_calibrated_without_a_file():
    measured = simulate("irb1600", random=60, seed=1).to_frame()
    validated = irbcal.calibrate(measured, "irb1600", "11", holdout=20).validated
    assert validated.fit_points.poses == 40


def test_the_result_says_what_it_is_and_cannot_be_changed(simulated):
    assert simulated.headline().startswith("SIMULATED: 30 poses of irb1600_6_145 with 3 kg, ")
    assert len(repr(simulated)) < 2000
    assert "points without a position: visibility" in simulated.summary()
    again = pickle.loads(pickle.dumps(simulated))
    np.testing.assert_array_equal(again.run.xyz, simulated.run.xyz)
    for array in (simulated.run.xyz, simulated.poses.q):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0
    with pytest.raises(TypeError, match="cannot be changed"):
        simulated.run.unseen["noise"] = 1


def test_joints_as_an_array_and_other_settings(simulated):
    q = simulated.poses.q[:4]
    found = simulate("irb1600", q, only=(), targets=["smr9"], tracker=[3.0, 0.0, 1.0], payload=6.0, wait=1.0)
    assert found.cell.on == ()
    assert found.to_dict()["targets"] == ["smr9"]
    assert found.run.payload_kg == 6.0
    seen = found.measurements()
    assert set(seen.input("payload_kg")) == {6.0}
    np.testing.assert_allclose(seen.input("payload_centre"), [found.cell.tool.payload_centre] * 4, rtol=0, atol=1e-7)
    assert simulated.measurements().input("payload_centre") is None
    np.testing.assert_allclose(found.cell.tracker.position, [3.0, 0.0, 1.0], rtol=0, atol=1e-12)


def test_misses_of_the_nominal_program_are_those_of_an_uncalibrated_robot(tmp_path):
    measured = simulate("irb1600", random=80, seed=1)
    irbcal.calibrate(measured.to_frame(), "irb1600", "34").save(tmp_path / "cal")
    program = measured.to_frame().drop_duplicates("pose")
    found = simulate("irb1600", program, wanted=program, calibration=tmp_path / "cal", seed=2)
    assert 0.7 * MM < found.program_errors.mean() < 1.6 * MM
    assert "Distances from where the program wanted the targets, mm" in found.summary()
    loaded = simulate("irb1600", program, wanted=program, calibration=irbcal.load(tmp_path / "cal"), seed=2)
    np.testing.assert_array_equal(loaded.program_errors, found.program_errors)


@pytest.mark.parametrize(
    ("options", "parameter", "sentence"),
    [
        ({}, "plan", "give either a plan or a number of random poses"),
        ({"random": 5, "only": ["noise"], "without": ["lost"]}, "only", "only and without exclude each other"),
        ({"random": 5, "wanted": "a.csv"}, "wanted", "wanted and calibration go together"),
        ({"random": 5, "targets": 10}, "targets", "expected 1 to 9 targets or names, found 10"),
        ({"random": 5, "tracker": [1.0, 2.0]}, "tracker", "expected x, y, z of the tracker in metres"),
    ],
)
def test_wrong_options_are_refused_by_name(options, parameter, sentence):
    with pytest.raises(OptionError, match=sentence) as refusal:
        simulate("irb1600", **options)
    assert refusal.value.parameter == parameter


def test_the_robot_must_be_named():
    with pytest.raises(TypeError):
        simulate(random=5)
    with pytest.raises(IrbcalError, match="robot file 'kuka' does not exist"):
        simulate("kuka", random=5)


def test_a_simulation_is_measurements(simulated):
    seen = table.read(simulated)
    assert seen.simulated
    np.testing.assert_array_equal(seen.positions(), table.read(simulated.to_frame()).positions())


@pytest.mark.parametrize(
    ("options", "parameter", "words"),
    [
        ({"random": 0}, "random", "a whole number from 1 to 100000, found 0"),
        ({"random": -5}, "random", "found -5"),
        ({"random": 99_999_999_999}, "random", "found 99999999999"),
        ({"random": 3, "seed": -1}, "seed", "at least 0, found -1"),
        ({"random": 3, "robot_seed": -1}, "robot_seed", "at least 0, found -1"),
        ({"random": 3, "payload": "x"}, "payload", "a number from 0 to 5000, found 'x'"),
        ({"random": 3, "payload": -3}, "payload", "found -3"),
        ({"random": 3, "wait": -1}, "wait", "found -1"),
        ({"random": 3, "tracker": (1550, 1633, 1507)}, "tracker", "metres expected, .* looks like millimetres"),
        ({"random": 3, "only": "backlash"}, "only", r"one text: give \['backlash'\]"),
        ({"random": 3, "without": "backlash"}, "without", "one text"),
        ({"random": 3, "targets": [1]}, "targets", "a sequence of names"),
    ],
)
def test_options_that_make_no_sense_are_refused(options, parameter, words):
    with pytest.raises(OptionError, match=f"{parameter}: .*{words}") as refused:
        simulate("irb1600", **options)
    assert refused.value.parameter == parameter


def test_the_truth_belongs_to_its_measurement_file(cell, tmp_path):
    poses = random_list(cell, 6, seed=3)
    run = cell.measure(poses.q)
    found = simulation.files(run, poses, cell, tmp_path / "m.csv", "irb1600")
    assert list(found) == ["m.csv", "m.truth.json"]
    truth = json.loads(found["m.truth.json"])
    assert truth["simulated"] is True
    assert truth["data_sha256"] == hashlib.sha256(found["m.csv"]).hexdigest()
    np.testing.assert_allclose(np.array(truth["poses"])[:, :3] * 1e-3, run.T_base_tip[:, :3, 3], rtol=0, atol=1e-9)
    (tmp_path / "m.csv").write_bytes(found["m.csv"])
    read = table.read(tmp_path / "m.csv")
    np.testing.assert_allclose(read.positions().reshape(run.xyz.shape), run.xyz, rtol=0, atol=0.051e-6)
    np.testing.assert_allclose(read.joints(), poses.q, rtol=0, atol=1e-8)


@pytest.fixture(scope="module")
def balls():
    return simulate_device("irb1600", "balls", 24, seed=3, noise=0.0)


def test_the_real_robot_touches_the_balls(balls):
    """The oracle is the cell's own truth of where the tip stood."""
    T = balls.cell.measure(balls.q).T_base_tip
    p = T[:, :3, 3] + T[:, :3, :3] @ np.array(BALL)
    centre = np.array([own["centre"] for own in balls.placed.unknowns.values()])[balls.which]
    assert np.linalg.norm(p - centre, axis=1).max() < 0.02 * MM
    nominal = balls.cell.arm.forward(balls.q)
    away = nominal[:, :3, 3] + nominal[:, :3, :3] @ np.array(BALL) - centre
    assert np.linalg.norm(away, axis=1).mean() > 0.3 * MM


def test_files_say_that_they_are_simulated(balls, tmp_path):
    rows, known, truth = balls.save(tmp_path / "b.csv")
    assert "yes" in rows.read_text().splitlines()[1]
    assert known.name == "b.features.csv"
    assert json.loads(truth.read_text())["simulated"] is True
    seen = balls.read()
    assert seen.simulated
    assert "SIMULATED" in str(balls.summary())
    assert len(seen.relations) == 6


def test_poses_of_a_plan_can_be_measured(balls):
    again = simulate_device("irb1600", "balls", seed=3, noise=0.0, at=(balls.q[:6], balls.which[:6]))
    assert again.which.tolist() == balls.which[:6].tolist()
    assert sorted(np.round(again.q[:, 0], 2)) == pytest.approx(sorted(np.round(balls.q[:6, 0], 2)), abs=0.02)


def test_strings_show_distances_with_their_noise():
    exact, noisy = (simulate_device("irb1600", "string", 60, noise=noise) for noise in (0.0, 1e-4))
    np.testing.assert_array_equal(exact.q, noisy.q)
    assert np.std(noisy.value - exact.value) == pytest.approx(1e-4, rel=0.3)
    with pytest.raises(OptionError, match="device"):
        simulate_device("irb1600", "tape")


def test_effects_of_the_cell_can_be_left_out():
    alone = simulate_device("irb1600", "ball", 6, only=["tilt"])
    assert alone.cell.on == ("tilt",)
    heavy = simulate_device("irb1600", "ball", 6, payload=5.0)
    assert heavy.read().inputs["payload_kg"].tolist() == [5.0] * 6
    assert heavy.read().inputs["payload_centre"][0] == pytest.approx(heavy.cell.tool.payload_centre)
    assert not np.allclose(heavy.q, simulate_device("irb1600", "ball", 6, payload=0.0).q, atol=1e-7)
    assert "backlash" not in simulate_device("irb1600", "ball", 6, without=["backlash"]).cell.on
    with pytest.raises(OptionError, match="exclude each other"):
        simulate_device("irb1600", "ball", 6, only=["tilt"], without=["noise"])


def test_a_camera_sees_boards_from_where_the_real_robot_stands():
    """The oracle is a projection written out by hand, with the cell's own truth of where the tip stood."""
    exact, noisy = (simulate_device("irb1600", "camera", 9, seed=2, noise=noise) for noise in (0.0, 1e-5))
    T, own = exact.cell.measure(exact.q).T_base_tip[0], exact.placed.unknowns["board 1"]
    square = exact.placed.imaging.board.pitch
    corner = own["centre"] + own["attitude"] @ [3 * square, 2 * square, 0.0]  # number 9 of 7 a row
    x, y, z = (T[:3, :3] @ CAMERA_AXES).T @ (corner - T[:3, 3] - T[:3, :3] @ np.array(BALL))
    r2 = (x / z) ** 2 + (y / z) ** 2
    there = 1400.0 * np.array([x, y]) / z * (1 - 0.1 * r2 + 0.06 * r2**2) + [960, 600]
    np.testing.assert_allclose(exact.value[0, 9], there, atol=1e-6)
    assert float(noisy.features().u95_px[0]) == pytest.approx(1.96 * np.std(noisy.value - exact.value), rel=0.1)
    seen = noisy.read()
    assert len(seen) == 9
    assert seen.simulated
    assert set(seen.target) == {"camera"}
    assert len(noisy.to_frame()) == 9 * 35
