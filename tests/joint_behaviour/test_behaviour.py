"""The whole answer on a measurement file: what is said is what was found, and refusals."""

import numpy as np
import pytest
from moving import random_commands, refusal, simulated
from support import arm, write_measurements

from irbcal.errors import IdentificationError
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
