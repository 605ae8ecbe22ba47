"""The whole answer on a measurement file: what is said is what was found, and refusals."""

import pickle

import numpy as np
import pandas as pd
import pytest
from moving import random_commands, refusal, simulated
from support import arm, write_measurements

from irbcal.errors import IdentificationError, MeasurementError, OptionError
from irbcal.joint_behaviour import behaviour
from irbcal.measurement import table


@pytest.fixture(scope="module")
def irb120(shared_data):
    """A real IRB 120 in random poses, and the report on its joints."""
    seen = table.read(shared_data / "irb120_laser_tracker" / "measurements.csv")
    return seen, behaviour.analyse(seen, arm("irb120"))


def test_what_is_said_is_what_was_found(irb120):
    report = irb120[1]
    plain = report.to_dict()
    first = next(t for t in plain["residuals"]["terms"] if t["kind"] == "backlash" and t["joint"] == 1)
    value = first["values"]["backlash"]
    assert value["value"] == pytest.approx(np.degrees(report.residuals.of("backlash")[1].values[0]))
    half = (value["high"] - value["low"]) / 2
    assert any(f"backlash joint 1: {value['value']:.4f} ± {half:.4f} degrees" in line for line in plain["verdict"])
    assert plain["verdict"][-1].startswith("This robot needs, the most important first: arm stiffness (0.4")
    assert len(plain["excluded"]) == 33
    assert plain["excluded"][0]["pose"] == "21"


def test_a_file_without_one_joint_moves_needs_a_robot(tmp_path):
    points, _, _ = simulated(random_commands(4, 0))
    seen = table.read(write_measurements(tmp_path / "random.csv", points))
    assert refusal(behaviour.analyse, seen).endswith(
        "random.csv: there are no one-joint moves (column group: axis1, axis2, …); for other poses a robot or a "
        "calibration is needed"
    )
    with pytest.raises(IdentificationError, match=r"random\.csv: "):
        behaviour.analyse(seen, arm("irb1600"))


@pytest.fixture(scope="module")
def random_file(tmp_path_factory):
    """Random poses of a robot with play in joint 6."""
    play = np.radians([0, 0, 0, 0, 0, 0.06])
    points, _, _ = simulated(random_commands(40, 0), None, play, noise=3e-5, rng=np.random.default_rng(0))
    return write_measurements(tmp_path_factory.mktemp("joints") / "random.csv", points)


def test_the_front_door_takes_files_and_measurements(random_file, tmp_path):
    steps = []
    found = behaviour.joints(random_file, robot="irb1600", plots=tmp_path / "figures", progress=steps.append)
    assert steps == ["reading the measurements", "analysing the joints", "drawing"]
    assert ("backlash", 6) in [(s.kind, s.joint) for s in found.residuals.needed]
    assert sorted(found.plots) == sorted(str(path) for path in (tmp_path / "figures").iterdir())
    assert sorted(found.plots) == sorted(str(tmp_path / "figures" / f"{name}.png") for name in found.figures)
    seen = table.read(random_file)
    again = behaviour.analyse(seen, arm("irb1600"))
    assert again.to_dict() | {"plots": list(found.plots)} == found.to_dict()
    assert behaviour.joints(random_file, robot=arm("irb1600")).to_dict() == again.to_dict()


def test_a_result_speaks_is_pickled_and_cannot_be_changed(random_file):
    found = behaviour.joints(random_file, robot="irb1600")
    assert repr(found).startswith("<JointBehaviour: This robot needs")
    for result in (found, found.residuals, *found.residuals.terms):
        assert len(repr(result)) < 2000
    assert "Verdict" in found.summary()
    assert "<table>" in found._repr_html_()
    assert pickle.loads(pickle.dumps(found)).to_dict() == found.to_dict()
    with pytest.raises(ValueError, match="read-only"):
        found.residuals.angle[0, 0] = 0.0
    with pytest.raises(TypeError, match="cannot be changed"):
        found.residuals.approach["size"] = 0.0


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"calibration": "here", "robot": "irb120"}, "give a calibration or a robot, not both"),
        ({"joint": 0}, "joint: expected a number from 1, found 0"),
        ({"order": 13}, "order: expected 1 to 12, found 13"),
        ({"frequency": "often"}, "frequency: expected free or a number of periods per turn above zero, found 'often'"),
        ({"frequency": 0.0}, "frequency: expected free or a number of periods per turn above zero, found 0.0"),
    ],
)
def test_options_that_there_are_not_are_refused_before_anything_is_read(options, sentence):
    with pytest.raises(OptionError) as caught:
        behaviour.joints("absent.csv", **options)
    assert str(caught.value) == sentence
    assert caught.value.parameter in (*options, "robot")


def test_refusals_name_their_file(random_file):
    with pytest.raises(MeasurementError) as caught:
        behaviour.joints(random_file)
    assert caught.value.file == str(random_file)
    with pytest.raises(IdentificationError) as caught:
        behaviour.joints(random_file, robot="irb120")
    assert caught.value.file == str(random_file)


def test_too_few_angles_of_one_joint_ask_for_a_robot(tmp_path):
    points, _, _ = simulated(random_commands(2, 0)[[0, 0, 0, 1]] * [1, 0, 0, 0, 0, 0], np.full(4, "axis1", object))
    write_measurements(tmp_path / "m.csv", points)
    seen = table.read(pd.read_csv(tmp_path / "m.csv").assign(group="axis1"))
    said = refusal(behaviour.analyse, seen)
    assert "group axis1: " in said
    assert said.endswith("give a robot or a calibration (--robot or --calibration)")
