"""The virtual cell teaches tool and work object and runs a program: its truth, by SciPy and without the calibration."""

import sys
from pathlib import Path

import numpy as np
import pytest
from rapid_modules import parsed
from scipy.spatial.transform import Rotation

from irbcal.examples.measurements import reached
from irbcal.modeling import frames
from irbcal.simulation.shipped_cells import open_cell

sys.path.insert(0, str(Path(__file__).parents[2] / "scripts"))
from part_in_fixture import GRID, SIDES, PartCell


@pytest.fixture(scope="module")
def part():
    return PartCell.from_cell(open_cell("irb120").without("repeatability"))


def test_the_true_tip_touches_the_true_places(part):
    touches = part.touches()
    q = np.radians(touches[[f"q{k}_deg" for k in range(1, 7)]].to_numpy())
    T = part.cell.measure(q).T_base_tip
    tips = T[:, :3, :3] @ part.tip + T[:, :3, 3]
    assert np.abs(tips[:SIDES] - tips[0]).max() < 1e-7
    origin, x, xy = (np.linalg.inv(part.T_base_object) @ np.append(tip, 1.0) for tip in tips[SIDES:])
    assert np.abs(origin[:3]).max() < 1e-7
    assert np.abs([*x[1:3], xy[2]]).max() < 1e-7
    assert min(x[0], xy[1]) > 0.05
    turns = Rotation.from_matrix(T[:SIDES, :3, :3]).inv() * Rotation.from_matrix(T[0, :3, :3])
    assert np.linalg.svd(turns.as_rotvec()[1:])[1].min() > 0.1, "not all about one axis"


def test_noise_moves_the_touches_by_as_much(part):
    seeds = [part.touches(2e-4, seed) for seed in range(3)]
    columns = [f"q{k}_deg" for k in range(1, 7)]
    tips = []
    for touches in (part.touches(), *seeds):
        T = part.cell.measure(np.radians(touches[columns].to_numpy())).T_base_tip
        tips.append(T[:, :3, :3] @ part.tip + T[:, :3, 3])
    assert np.std(np.array(tips[1:]) - tips[0]) == pytest.approx(2e-4, rel=0.25)
    assert seeds[0]["u95_mm"].to_numpy() == pytest.approx(0.392, abs=1e-3)


def test_the_program_holds_the_wanted_poses_and_frames(part):
    tool = frames.transform(None, part.tip)
    program = parsed(part.program(tool, part.T_base_object).encode())
    assert np.abs([target.value for target in program.targets] - part.T_wanted).max() < 1e-8
    assert np.abs(program.tools["tgrip"] - tool).max() < 1e-8
    assert np.abs(program.work_objects["wpart"] - part.T_base_object).max() < 1e-8
    assert len(program.targets) == len(GRID)


def test_a_part_is_right_where_the_true_robot_is_commanded(part):
    """The joints at which the true tip is on each place: no error but that of the search."""
    near = np.tile(part.corners[0], (len(GRID), 1))
    wanted = part.T_base_object @ part.T_wanted
    assert part.errors(reached(part.cell, near, part.tip, wanted[:, :3, 3])).max() < 1e-7
    assert part.least_squares(0.0, draws=1) < 1e-7
    assert part.least_squares(1e-4, 50) == pytest.approx(2 * part.least_squares(5e-5, 50), rel=1e-3)
