"""What the examples share: a calibration folder, goals for a reflector on the tool, and the simulated robot itself."""

import argparse
import atexit
import hashlib
import shutil
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import irbcal
from irbcal.io import robots
from irbcal.modeling import frames
from irbcal.modeling.robot import Robot
from irbcal.planners.calibrated_model import CalibratedModel
from irbcal.units import DEG, MM

sys.path.insert(0, str(Path(__file__).parents[1] / "thesis"))
from demonstration import demonstration_cell

TARGET = "smr1"
HOME_DEG = [0, -14, 14, 0, 30, 0]
"""P1 of the ISO cube (Nubiola 2011, Table A I-1), the hand turned down."""


@dataclass(frozen=True, eq=False)
class Side:
    """A robot as its planner knows it: calibrated, or nominal with base and tool placed as well as it allows."""

    model: CalibratedModel
    robot: Robot

    def in_universe(self, T_world):
        """Poses in the measuring frame as Pinocchio's universe sees them, (n, 4, 4)."""
        return self.model.T_universe_base @ frames.inverse(self.robot.T_world_base) @ T_world


def folder_from_command_line(description):
    """The calibration folder named on the command line; by default ./irbcal-demo, else a demo made for this run."""
    parser = argparse.ArgumentParser(description=description.splitlines()[0])
    parser.add_argument("folder", nargs="?", type=Path, help="calibration folder; by default the simulated demo's")
    folder = parser.parse_args().folder
    if folder is None:
        folder = Path("irbcal-demo")
        if not folder.is_dir():
            folder = make_demo(Path(tempfile.mkdtemp(prefix="irbcal-example-")))
            atexit.register(shutil.rmtree, folder)
    return folder


def make_demo(folder):
    """Calibrate the shipped SIMULATED IRB 1600 into a folder."""
    identification, verification = (robots.demo_file(f"demo_{name}.csv") for name in ("identification", "verification"))
    irbcal.save(irbcal.calibrate(identification, "irb1600", verify=verification), folder)
    return folder


def is_demo(folder):
    """Whether the calibration was made from the shipped simulated measurements."""
    shipped_bytes = robots.demo_file("demo_identification.csv").read_bytes()
    return irbcal.load(folder).record.data[0].sha256 == hashlib.sha256(shipped_bytes).hexdigest()


def calibrated(folder):
    """The calibrated side."""
    return Side(CalibratedModel.load(folder), irbcal.load(folder).robot_calibrated())


def nominal(folder):
    """The demo's nominal URDF, with base and tool identified from the same measurements."""
    robot = irbcal.load(folder).robot_nominal()
    tool = {f"target_{name}": frames.transform(None, xyz) for name, xyz in robot.targets.items()}
    return Side(CalibratedModel(robots.robot_file("irb1600").read_bytes(), robot.arm, tip_frames=tool), robot)


def frame_to_place(side):
    """The reflector on the tool where the calibration has it, else the tip link."""
    name = f"target_{TARGET}"
    return name if side.model.model.existFrame(name) else side.model.arm.tip_link


def home(model):
    """Commands of the home position, (1, 6)."""
    return model.arm.check_joints(np.array(HOME_DEG) * DEG)


def goals(side, n, reach_deg=25.0, seed=1):
    """Poses in the measuring frame for the frame to place, around the home position, (n, 4, 4)."""
    q = home(side.model) + np.random.default_rng(seed).uniform(-reach_deg, reach_deg, (n, 6)) * DEG
    T_universe_frame = side.model.placement(q, frame_to_place(side), "universe")
    return side.robot.T_world_base @ frames.inverse(side.model.T_universe_base) @ T_universe_frame


def really_reached(motions, seed=2):
    """Where the simulated robot really puts the reflector, backlash and all, in the tracker's frame, (n, 3) metres.

    ``motions`` (n, 2, 6) are the commands before each end, from which the joints come, and those of the end.
    """
    cell = demonstration_cell().without("noise", "drift", "lost").with_targets([TARGET])
    return cell.measure(motions.reshape(-1, 6), run=seed).xyz[1::2, 0]


def compare_on_the_simulated_robot(folder, plan, T_world_goals):
    """Let the simulated robot follow the commands of a planner with and without the calibration.

    Returns
    -------
    dict of str to ndarray, shape (n,)
        Misses of the reflector in mm, ``nominal`` and ``calibrated``.
    """
    misses = {}
    for name, side in (("nominal", nominal(folder)), ("calibrated", calibrated(folder))):
        motions = plan(side.model, frame_to_place(side), side.in_universe(T_world_goals))
        misses[name] = np.linalg.norm(really_reached(motions) - T_world_goals[:, :3, 3], axis=1) / MM
        print(
            f"SIMULATED robot, planned on the {name} model: the reflector misses its goals by "
            f"{misses[name].mean():.3f} mm on average, {misses[name].max():.3f} mm at most"
        )
    return misses
