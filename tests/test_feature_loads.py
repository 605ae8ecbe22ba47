"""Rows at features with payloads, from the table to a saved calibration."""

import feature_cases as cases
import loaded_cases as loaded
import numpy as np
import pytest

import irbcal
from irbcal.errors import OptionError
from irbcal.modeling.terms.situation import Motion
from irbcal.simulation.devices import BALL


@pytest.fixture(scope="module")
def made():
    nominal = cases.arm()
    truth = cases.true_arm(nominal, 5, scale=0.5)
    return nominal, truth, *loaded.contacts(nominal, truth)


def test_what_a_payload_bends_is_told_by_balls(made, tmp_path):
    """SIMULATED: the oracle is the true robot with either load, however both stand."""
    nominal, truth, rows, known = made
    found = irbcal.calibrate(rows, "irb1600", features=known, leave_out="none")
    assert any("payloads of 0, 8 kg" in text for text in found.record.notes)
    irbcal.save(found, tmp_path / "robot")
    robot = irbcal.load(tmp_path / "robot").robot_calibrated()
    q = nominal.random_joints(100, 3) * 0.6
    blind = irbcal.calibrate(
        rows.drop(columns=[c for c in rows if "payload" in c]), "irb1600", features=known, leave_out="none"
    ).robot_calibrated()
    terms = loaded.map_of(nominal)
    for load in loaded.LOADS:
        T = terms.forward(truth, Motion(q, inputs={"payload_kg": np.full(len(q), load)}))
        true = T[:, :3, 3] + T[:, :3, :3] @ np.array(BALL)
        mass = np.full(len(q), load)
        places = [
            T[:, :3, 3] + T[:, :3, :3] @ one.targets["ball"]
            for one, T in ((robot, robot.forward(q, payload_kg=mass)), (blind, blind.forward(q)))
        ]
        left = [np.sqrt(np.mean(cases.apart_in_place(true, place) ** 2)) for place in places]
        assert left[0] < 0.015e-3
        assert left[0] < 0.4 * left[1]  # what rows without masses leave


def test_the_place_of_the_payload_is_told_once(made):
    *_, rows, known = made
    with pytest.raises(OptionError, match="the rows tell the payload's centre"):
        irbcal.calibrate(rows, "irb1600", features=known, payload_centre=(0.0, 0.0, 0.1))
