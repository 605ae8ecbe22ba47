"""What a laser tracker measured of a robot, in the virtual cell: SIMULATED."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline

from irbcal.arrays import FloatArray
from irbcal.correction.languages import ros
from irbcal.io import robots
from irbcal.measurement.columns import POSITION
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.trajectory import Trajectory
from irbcal.practice.sample import Sample, csv
from irbcal.simulation.cell import Cell
from irbcal.simulation.pose_list import PoseList, drawn, numbered
from irbcal.simulation.shipped import open_cell
from irbcal.simulation.simulated_files import measurement_table
from irbcal.units import DEG, MM

ROBOT = "irb1600"
TARGETS = ("smr1", "smr2", "smr3")
REFERENCES = ("ref1", "ref2", "ref3")
POSES, VERIFICATION, LATER = 100, 60, 40
MOVES = np.arange(-60.0, 61.0, 10.0)
"""Angles of the moves of one joint, degrees."""
MOVED = frames.transform(frames.rotation_from_vector(np.array([0.0, 0.0, 0.4])), np.array([0.3, -0.2, 0.05]))
"""Where the tracker stood later, seen from where it stood before."""
PROGRAM = (
    (4, 8, -39, 9, -17, -62),
    (34, 24, -16, 67, -29, -34),
    (20, 16, -10, -1, -40, -29),
    (17, 10, 17, 30, -69, -20),
    (-18, 33, -30, -48, -22, 50),
    (-18, 6, 47, 60, 66, -44),
)
"""Joints of a small program, degrees; the tracker sees the tool at all of its stops."""


def practice_cell(seed: int = 0) -> Cell:
    """The virtual cell that the samples come from: three reflectors on the tool, three on the floor."""
    cell = open_cell(ROBOT, seed=seed).with_targets(TARGETS)
    return cell.replace(references={name: cell.references[name] for name in REFERENCES})


def measurements(cell: Cell, poses: PoseList) -> pd.DataFrame:
    """The rows of a measurement file."""
    return measurement_table(cell.measure(poses.q, poses.asked(cell), poses.wait_s), poses, cell.arm)


def one_joint_moves(joints: int) -> PoseList:
    """Every joint moved alone, there and back."""
    angles = np.concatenate([MOVES, MOVES[::-1]]) * DEG
    rest = np.zeros(joints)
    rest[4] = 30 * DEG
    q = np.vstack([_moved(rest, joint, angles) for joint in range(joints)])
    group = np.repeat([f"axis{joint + 1}" for joint in range(joints)], len(angles)).astype(object)
    return PoseList(q, numbered(len(q)), None, np.full(len(q), 4.0), {"group": group}, "moves of one joint")


def _moved(rest: FloatArray, joint: int, angles: FloatArray) -> FloatArray:
    q = np.tile(rest, (len(angles), 1))
    q[:, joint] = angles * (0.5 if joint in (1, 2) else 1.0)
    return q


def seen_from_elsewhere(table: pd.DataFrame) -> pd.DataFrame:
    """The same points in the frame of the moved tracker."""
    away = frames.inverse(MOVED)
    xyz = table[list(POSITION)].to_numpy(dtype=float) * MM
    moved = table.copy()
    moved[list(POSITION)] = np.round((xyz @ away[:3, :3].T + away[:3, 3]) / MM, 4)
    return moved


def files() -> Iterator[Sample]:
    """Measurements, joints, poses and a program of the IRB 1600."""
    cell = practice_cell()
    table = measurements(cell, drawn(cell, POSES, 1))
    yield from _main(cell, table)
    yield from _other_days(table)
    yield from _loads()
    yield from _lists(cell)


def _main(cell: Cell, table: pd.DataFrame) -> Iterator[Sample]:
    """What the first steps need."""
    data = robots.robot_file(ROBOT).read_bytes()
    yield Sample("my_robot.urdf", data, "the nominal robot", "irbcal view my_robot.urdf")
    line = "irbcal calibrate measured.csv --robot my_robot.urdf --out my-robot"
    yield Sample("measured.csv", csv(table), f"{POSES} poses, three reflectors, three references", line)
    other = practice_cell(1)
    proof = measurements(other, drawn(other, VERIFICATION, 2))
    yield Sample("verification.csv", csv(proof), "other poses", "irbcal evaluate my-robot verification.csv")
    moves = measurements(practice_cell(3), one_joint_moves(len(cell.arm.joint_names)))
    yield Sample("moves.csv", csv(moves), "moves of one joint, there and back", "irbcal joints moves.csv")
    drawn_places = pd.DataFrame(cell.tool.cad / MM, columns=list(POSITION))
    drawn_places.insert(0, "target", cell.tool.names)
    line = "irbcal circles moves.csv --robot irb1600 --drawn cad.csv"
    yield Sample("cad.csv", csv(drawn_places), "the tool as it was drawn", line)


def _other_days(table: pd.DataFrame) -> Iterator[Sample]:
    """Measured later: the tracker, or the reflectors, stood elsewhere."""
    later = practice_cell(2)
    new = seen_from_elsewhere(measurements(later, drawn(later, LATER, 3)))
    line = "irbcal calibrate new.csv --with my-robot --out my-robot-2"
    yield Sample("new.csv", csv(new), "more poses, from another place of the tracker", line)
    both = pd.concat([table.assign(session="Monday"), new.assign(session="Tuesday")])
    both["pose"] = both["session"].str[0] + both["pose"].astype(str)
    line = "irbcal calibrate two_days.csv --robot my_robot.urdf --out two-days"
    yield Sample("two_days.csv", csv(both), "two sessions in one file", line)
    cell = open_cell(ROBOT, seed=6).without("visibility")
    names = dict(zip(cell.tool.names[3:6], TARGETS, strict=True))
    cell = cell.with_targets(tuple(names)).replace(references=practice_cell().references)
    remounted = measurements(cell, drawn(cell, LATER, 7)).replace({"target": names})
    line = "irbcal evaluate my-robot remounted.csv --refit-tool"
    yield Sample("remounted.csv", csv(remounted), "the reflectors mounted anew", line)
    line = "irbcal evaluate my-robot all_anew.csv --refit-base --refit-tool --refit-from 10"
    yield Sample("all_anew.csv", csv(seen_from_elsewhere(remounted)), "reflectors and tracker anew", line)


def _loads() -> Iterator[Sample]:
    """Measured with several loads."""
    tables = []
    for load, (kilograms, seed) in enumerate(((1.0, 8), (5.0, 9), (3.0, 10))):
        cell = practice_cell(seed).with_payload(kilograms)
        table = measurements(cell, drawn(cell, LATER, seed))
        table["pose"] = [f"L{load}_{pose}" for pose in table["pose"]]
        tables.append(table)
    line = "irbcal calibrate two_loads.csv --robot my_robot.urdf --same-tool --out two-loads"
    yield Sample("two_loads.csv", csv(pd.concat(tables[:2])), "the same robot with 1 and with 5 kg", line)
    yield Sample("third_load.csv", csv(tables[2]), "and with 3 kg", "irbcal evaluate two-loads third_load.csv")


def _lists(cell: Cell) -> Iterator[Sample]:
    """Joints, poses, a program, a table of Denavit-Hartenberg parameters."""
    arm = cell.arm
    q = np.array(PROGRAM, dtype=float)
    joints = pd.DataFrame(q, columns=arm.joint_columns)
    yield Sample("joints.csv", csv(joints), "joints", "irbcal fk my-robot --joints joints.csv")
    yield Sample("job.csv", csv(joints), "a program of joints", "irbcal filter my-robot job.csv --out corrected.csv")
    yield from _trajectory(arm, q[:-1] * DEG)  # the last one lies behind a singularity
    T = arm.forward(q * DEG)
    quaternions = frames.quaternion_from_matrix(T[:, :3, :3])
    numbers = np.round(np.column_stack([T[:, :3, 3] / MM, quaternions]), 9)
    poses = pd.DataFrame(numbers, columns=[*POSITION, "qw", "qx", "qy", "qz"])
    yield Sample("poses.csv", csv(poses), "poses of the tip", "irbcal ik my-robot --poses poses.csv")
    line = "irbcal urdf --dh table.csv --convention modified --out arm.urdf"
    yield Sample("table.csv", DH_TABLE.encode(), "Denavit-Hartenberg parameters", line)


DH_TABLE = """joint,alpha_deg,a_mm,theta_deg,d_mm,lower_deg,upper_deg
joint_1,0,0,0,486.5,-180,180
joint_2,-90,150,-90,0,-90,150
joint_3,0,700,0,0,-238,65
joint_4,-90,110,0,600,-200,200
joint_5,90,0,0,0,-115,115
joint_6,-90,0,180,65,-400,400
"""


def _trajectory(arm: Arm, q: FloatArray) -> Iterator[Sample]:
    """The way between the joints of a program, from rest to rest."""
    through = CubicSpline(3.0 * np.arange(len(q)), q, bc_type="clamped")
    t = np.array([0.1 * k for k in range(30 * (len(q) - 1) + 1)])
    motion = Trajectory(t, through(t), names=arm.joint_names, prismatic=arm.table.prismatic)
    motion = replace(motion, dq=through(t, 1), ddq=through(t, 2))
    line = "irbcal filter my-robot trajectory.yaml --out trajectory-sent.yaml"
    yield Sample("trajectory.yaml", ros.to_yaml(motion).encode(), "a motion as a ROS JointTrajectory", line)
    line = "irbcal filter my-robot trajectory.csv --out trajectory-sent.csv"
    yield Sample("trajectory.csv", csv(motion.to_frame(), float_format="%.9f"), "the same motion as CSV", line)
