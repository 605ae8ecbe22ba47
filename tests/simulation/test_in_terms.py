"""What the cell says that it does in the error model's terms is what it does: two ways to walk the chain."""

import json

import numpy as np
import pytest
from cell_support import OTHERS, robot_file

import irbcal
from irbcal.modeling import frames
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.terms.term import Term
from irbcal.simulation import in_terms, realistic
from irbcal.simulation.shipped import open_cell

EXACT = ("harmonics", "gear", "wobble", "direction", "move")
FIRST_ORDER = ("compliance", "bending", "thaw", "warm_up", "tilt")
"""The error model takes attitudes from the nominal arm: a ten-thousandth of the effect."""


def minutes(cell, q):
    """When the robot stopped, from the cell's own clock."""
    asked = np.ones((len(q), len(cell.tool.names) + len(cell.references)), dtype=bool)
    return cell._times(q, np.zeros(q.shape[1]), np.full(len(q), 4.0), asked)[0] / 60


def gap(cell, q, told=None, payload_kg=None):
    """Largest distance (m) between the cell's tips and those of the terms that it tells."""
    told = cell.terms() if told is None else told
    motion = Motion(q, np.diff(q, axis=0, prepend=np.zeros((1, q.shape[1]))), minutes(cell, q), payload_kg)
    T = in_terms.term_map(cell.arm, told).forward(in_terms.true_arm(cell.arm, told), motion)
    return np.linalg.norm(T[:, :3, 3] - cell.measure(q).T_base_tip[:, :3, 3], axis=1).max()


@pytest.mark.parametrize("name", EXACT + FIRST_ORDER)
def test_each_effect_is_the_terms_that_it_tells(cell, q, name):
    alone = cell.also(name).only(name)
    assert gap(alone, q[:60]) < (1e-12 if name in EXACT else 2e-6)
    without = np.linalg.norm(
        alone.measure(q[:60]).T_base_tip[:, :3, 3] - cell.only().measure(q[:60]).T_base_tip[:, :3, 3], axis=1
    )
    assert without.max() > 4e-6  # and it does something


@pytest.mark.parametrize("robot", ["irb120", "irb1600", "ur10", "panda"])
def test_all_effects_together_on_other_arms(robot, tmp_path):
    cell = realistic.realistic(open_cell(robot_file(robot, tmp_path), *OTHERS.get(robot, (None, None))))
    cell = cell.without("repeatability", "visibility", "lost")
    assert gap(cell, cell.arm.random_joints(80, seed=2)) < 5e-6


def test_the_payload_can_be_told_apart_and_holds_for_other_loads(cell, q):
    told = cell.only("compliance").terms(payload=True)
    for kilograms in (0.0, 3.0, 7.0):
        loaded = cell.only("compliance").with_payload(kilograms)
        assert gap(loaded, q[:40], told, np.full(40, kilograms)) < 2e-6
    assert gap(cell.only("compliance").with_payload(7.0), q[:40], told, np.full(40, 3.0)) > 1e-4


def test_backlash_is_a_direction_after_long_moves(cell):
    q = np.radians([[20.0] * 6, [-20.0] * 6, [30.0] * 6])
    assert gap(cell.only("backlash"), q) < 1e-8


def test_amounts_of_one_name_add_up():
    wave = in_terms.sine(5, 2, 1e-4, 0.3)
    more = [(Term(5, "rz", "cos", 1.0, "", "harmonics", "rad", {"cycles_per_turn": 2}), 1e-4)]
    merged = in_terms.merged([*wave, *more])
    assert merged["rz6 cos 2"][1] == pytest.approx(1e-4 * np.sin(0.3) + 1e-4)
    assert merged["rz6 sin 2"][1] == pytest.approx(1e-4 * np.cos(0.3))


def test_frame_rotations_are_the_steps_of_the_table(cell):
    table = cell.true_arm().table  # with a tilt
    found = in_terms.frame_rotations(cell.true_arm())
    for j in range(6):
        c, s = np.cos(table.beta[j]), np.sin(table.beta[j])
        expected = frames.rot_x(table.alpha[j]) @ [[c, 0, s], [0, 1, 0], [-s, 0, c]]
        np.testing.assert_allclose(found[j], expected, atol=1e-15)


def test_the_truth_file_tells_terms_by_their_names(tmp_path):
    simulated = irbcal.simulate("irb120", random=3, cell="realistic")
    _, truth = simulated.save(tmp_path / "m.csv")
    told = json.loads(truth.read_text())["terms"]
    assert told["rz2 direction 0.00872665"] == pytest.approx(
        np.radians(simulated.cell.truth()["effects"]["direction"]["size_deg"][1])
    )
    ratio = simulated.cell.truth()["effects"]["gear"]["waves"][0]
    assert f"rz{ratio[0]} cos {2 * ratio[1]} gear" in told
    assert told["rx2 constant"] != 0.0
