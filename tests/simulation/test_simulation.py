"""Measuring in the cell from Python: the result says what it is, and goes into a calibration as it stands."""

import pickle

import numpy as np
import pytest

import irbcal
from irbcal.errors import IrbcalError, OptionError
from irbcal.measurement import table
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
    outcome = irbcal.calibrate(measured, "irb1600", "11", holdout=20).outcome
    assert outcome.fit_points.poses == 40


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
    assert set(seen.payloads()) == {6.0}
    np.testing.assert_allclose(seen.payload_places(), [found.cell.tool.payload_centre] * 4, rtol=0, atol=1e-7)
    assert simulated.measurements().payload_places() is None
    np.testing.assert_allclose(found.cell.tracker.place, [3.0, 0.0, 1.0], rtol=0, atol=1e-12)


def test_misses_of_the_nominal_program_are_those_of_an_uncalibrated_robot(tmp_path):
    measured = simulate("irb1600", random=80, seed=1)
    irbcal.calibrate(measured.to_frame(), "irb1600", "34").save(tmp_path / "cal")
    program = measured.to_frame().drop_duplicates("pose")
    found = simulate("irb1600", program, wanted=program, calibration=tmp_path / "cal", seed=2)
    assert 0.7 * MM < found.misses.mean() < 1.6 * MM
    assert "Distances from where the program wanted the targets, mm" in found.summary()
    loaded = simulate("irb1600", program, wanted=program, calibration=irbcal.load(tmp_path / "cal"), seed=2)
    np.testing.assert_array_equal(loaded.misses, found.misses)


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
        ({"random": 3, "payload": "x"}, "payload", "a number of at least 0, found 'x'"),
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
