"""Programs that are one motion over time: fake targets for points, speeds and accelerations, and their limits.

The tip's wanted motion ``W(t)`` is what the controller's nominal model makes of the file's joints. The commands are
those with which the calibrated robot follows it: at the points by the calibrated inverse, and their speeds and
accelerations so that first and second derivatives of the tip's pose agree with those of ``W``, too. An arm with more
joints than a pose needs departs from the file's by as little as that takes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.correction.corrected_targets import CorrectionModel, TargetBatch
from irbcal.correction.languages import ros, table
from irbcal.correction.program import Program, Unchanged, WantedTargets, read_bytes
from irbcal.errors import OptionError, ProgramError
from irbcal.io.opening import RobotLike, open_robot
from irbcal.modeling.arm import Arm
from irbcal.modeling.inverse import newton
from irbcal.modeling.inverse.poses import pose_columns
from irbcal.modeling.moves_along import lean_along
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms import chain
from irbcal.modeling.terms.situation import Motion
from irbcal.modeling.trajectory import ReversalOffset, Trajectory
from irbcal.modeling.trajectory_limits import Exceeded, Limits, check
from irbcal.names import csv_bytes
from irbcal.safe_files import write_set

STRIDE = 5e-4
"""Radians (or metres) between the places of the differences: a gear's wave of 240 cycles a turn is 50 such long."""
SPEED_STEPS = 4
"""Steps to speeds and accelerations: the Jacobian leaves out what frame terms change with the joints."""
OTHERS = "another point of the motion cannot be corrected, and half a motion would jump"


@runtime_checkable
class Timed(Protocol):
    """A program that is one motion over time."""

    @property
    def trajectory(self) -> Trajectory:
        """The motion in joints of the arm, as the file has it."""
        ...

    def with_motion(self, commands: Trajectory) -> Program:
        """The program with speeds and accelerations to write beside the fake targets."""
        ...


def follow(
    model: CorrectionModel, program: Timed, batch: TargetBatch
) -> tuple[TargetBatch, Trajectory | None, list[Unchanged]]:
    """Commands along a motion whose points are corrected one by one.

    Parameters
    ----------
    model : CorrectionModel
    program : Timed
    batch : TargetBatch
        Its points, all together, with unknown last moves.

    Returns
    -------
    batch : TargetBatch
        With what the sides do that the joints come from, where the robot depends on them; nothing is corrected where a
        point cannot be.
    commands : Trajectory or None
        None without correction.
    left : list of Unchanged
        Limits that the commands pass, at the points or between them.
    """
    robot, nominal, fake = model.robot, model.nominal, batch.fake
    motion = program.trajectory
    if not fake.ok.all():
        reasons = np.where(fake.ok, OTHERS, fake.reason).astype(object)
        none = replace(fake, q=np.full(fake.q.shape, np.nan), ok=np.zeros(len(fake.ok), dtype=bool), reason=reasons)
        return replace(batch, fake=none), None, []
    lean = lean_along(robot.joint_map, motion)

    def commands_of(loaded: Robot) -> Trajectory:
        return _moving(loaded, model.computing, motion, fake.q, lean)

    if batch.load is None or not robot.joint_map.knows_loads:
        commands = commands_of(robot)
    else:
        commands = batch.load.computed_for_each(robot, commands_of, ("q", "dq", "ddq"))
    limits = Limits(nominal.lower, nominal.upper, model.speeds)
    already = {excess[:2]: excess for excess in check(motion, limits).exceeded}
    checked = check(commands, limits)
    passed = [
        _left(excess, already.get(excess[:2]), batch.programmed, motion, checked.slower) for excess in checked.exceeded
    ]
    reached = model.computing.forward(commands.q)
    return replace(batch, fake=replace(fake, q=commands.q, T_fake=reached)), commands, passed


def _left(
    excess: Exceeded, excess_before: Exceeded | None, batch: WantedTargets, motion: Trajectory, slower: float
) -> Unchanged:
    row = min(int(np.searchsorted(motion.times, excess.time, side="right")) - 1, len(batch.lines) - 1)
    sentence = excess.in_words
    if excess_before is not None:
        sentence += f", and so does the file at {excess_before.time:.4g} s"
    if excess.kind != "position":
        sentence += f"; times {np.ceil(slower * 1e4) / 1e4:.4f} times as long would hold it"
    return Unchanged(f"{batch.names[row]} and what follows", int(batch.lines[row]), sentence)


def _moving(robot: Robot, computing: Arm, motion: Trajectory, q: FloatArray, lean: ReversalOffset | None) -> Trajectory:
    """Commands for ``q`` that lean as said, with speeds and accelerations of the tip; those that the file has."""
    if lean is not None:
        q = robot.joint_map.commanded_unchecked(robot.joint_map.effective_unchecked(q) - lean.lean)
    commands = replace(motion, q=q, dq=None, ddq=None, lean=lean)
    if motion.dq is None:
        return commands
    bend = np.zeros(q.shape) if motion.ddq is None else motion.ddq
    lean = lean or ReversalOffset(*np.zeros((3, *q.shape)))
    rate = lean.second if motion.ddq is not None else np.zeros(q.shape)
    fastest = np.maximum(np.abs(motion.dq), np.sqrt(STRIDE * np.abs(bend))).max(axis=1)
    step = (STRIDE / np.maximum(fastest, STRIDE))[:, None]

    def along(p: FloatArray, v: FloatArray, a: FloatArray, k: int) -> FloatArray:
        return p + k * step * v + 0.5 * (k * step) ** 2 * a

    T_columns = {k: pose_columns(computing.forward(along(motion.q, motion.dq, bend, k))) for k in range(-2, 3)}
    calibrated = newton.CalibratedChain(robot, 1.0)
    inverse = np.linalg.pinv(calibrated.linearised(T_columns[0], q.T)[0])

    def lacks(dq: FloatArray, ddq: FloatArray) -> Callable[[int], FloatArray]:
        errors_at: dict[int, FloatArray] = {}

        def lack(k: int) -> FloatArray:
            if k not in errors_at:
                tip = _tip(robot, along(q, dq, ddq, k), along(lean.lean, lean.rate, rate, k))
                turn = newton.rotation_vector(tip, T_columns[k])
                errors_at[k] = np.concatenate([T_columns[k][3] - tip[3], turn]).T
            return errors_at[k]

        return lack

    dq, ddq = np.array(motion.dq), np.array(bend)
    for _ in range(SPEED_STEPS):
        lack = lacks(dq, ddq)
        speed = (8.0 * (lack(1) - lack(-1)) - (lack(2) - lack(-2))) / (12.0 * step)
        dq = dq + np.einsum("nij,nj->ni", inverse, speed)
    if motion.ddq is None:
        return replace(commands, dq=dq)
    for _ in range(SPEED_STEPS):
        lack = lacks(dq, ddq)
        bent = (16.0 * (lack(1) + lack(-1)) - (lack(2) + lack(-2)) - 30.0 * lack(0)) / (12.0 * step**2)
        ddq = ddq + np.einsum("nij,nj->ni", inverse, bent)
    return replace(commands, dq=dq, ddq=ddq)


def _tip(robot: Robot, q: FloatArray, lean: FloatArray) -> FloatArray:
    """Columns (4, 3, n) of the tip for commands, with what the last moves add to the effective joints."""
    xi = None if robot.frame_terms is None else robot.frame_terms.split(Motion(q))[1]
    return chain.walk(robot.arm, robot.joint_map.effective_unchecked(q) + lean, xi).tip


def read_trajectory(path: str | Path, robot: RobotLike) -> Trajectory:
    """Read a trajectory.

    Parameters
    ----------
    path : str or Path
        CSV with ``time_s``, ``q1_deg`` …, and where given ``v1_deg_s`` … and ``a1_deg_s2`` …; or a ROS
        JointTrajectory as YAML, whose joints are found by their names.
    robot : str, Path, Record, a result that holds one, or Opened
        Whose joints they are: calibration folder, URDF or name, see `irbcal.forward_kinematics`.

    Returns
    -------
    Trajectory
        Joints of the arm, radians (metres for prismatic joints).

    Raises
    ------
    ProgramError
        If the file holds none, times do not grow, joints are missing or numbers are not finite.
    """
    arm = open_robot(robot).nominal
    if Path(path).suffix.lower() in ros.ENDINGS:
        return ros.parse(arm, read_bytes(path), str(path)).trajectory
    program = table.read(path, arm)
    if not table.has_times(program):
        raise ProgramError(f"expected a column {table.TIME} beside the joints", file=path, row=1)
    return table.along_time(program, arm).trajectory


def write_trajectory(trajectory: Trajectory, path: str | Path) -> Path:
    """Write a trajectory: as YAML for ROS where the name ends so, else as CSV.

    Parameters
    ----------
    trajectory : Trajectory
    path : str or Path
        Ending with .yaml, .yml or .csv.
    """
    path = Path(path)
    if path.suffix.lower() in ros.ENDINGS:
        content = ros.to_yaml(trajectory).encode("utf-8")
    elif path.suffix.lower() == ".csv":
        content = csv_bytes(trajectory.to_frame(), float_format="%.12g")
    else:
        raise OptionError(f"path: expected a name that ends with .yaml or .csv, found {path.name}", parameter="path")
    write_set({path: content})
    return path
