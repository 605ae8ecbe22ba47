"""CSV trajectories: joints over time, ``time_s`` beside ``q1_deg`` …, and where given speeds and accelerations.

Speeds are ``v1_deg_s`` … (``v1_mm_s`` of a prismatic joint), accelerations ``a1_deg_s2`` …; all or none of a kind.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.correction.fake_targets import Corrected
from irbcal.correction.languages.table.program import TableProgram, with_values
from irbcal.correction.program import Goals
from irbcal.errors import MeasurementError, ProgramError, RobotError
from irbcal.measurement.columns import check_header, numbers
from irbcal.modeling.arm import Arm
from irbcal.modeling.trajectory import ENDS, Trajectory

TIME = "time_s"


@dataclass(frozen=True, eq=False, repr=False)
class TimedTable(TableProgram):
    """A CSV trajectory as read; see `irbcal.correction.timed.Timed`.

    Attributes
    ----------
    arm : Arm
    motion : Trajectory
        In joints as the controller counts them.
    commands : Trajectory or None
        Speeds and accelerations to write, in the arm's joints.
    """

    arm: Arm
    motion: Trajectory
    commands: Trajectory | None = None

    @property
    def trajectory(self) -> Trajectory:
        """The motion in joints of the arm."""
        return _counted(self.motion, self.arm.from_controller(np.eye(len(self.columns))).T)

    def with_motion(self, commands: Trajectory) -> TimedTable:
        """The program with speeds and accelerations to write."""
        return replace(self, commands=commands)

    def with_fake_targets(self, found: Sequence[tuple[Goals, Corrected]], fingerprint: str | None) -> dict[str, bytes]:
        """The table with the joints of the commands, their speeds and accelerations, marked in a column."""
        ((_, fake),) = found
        if not fake.ok.all() or self.commands is None:
            return {self.source: self.data}
        counted = _counted(self.commands, self.arm.to_controller(np.eye(len(self.columns))).T)
        frame = counted.to_frame()
        more = {name: frame[name].to_numpy() for name in frame.columns if name[0] in "va"}
        return {self.source: with_values(self, fake.q, fingerprint, more=more)}


def _counted(trajectory: Trajectory, turned: FloatArray) -> Trajectory:
    """The trajectory in joints that count otherwise: ``q @ turned.T``."""
    q, dq, ddq = (None if v is None else v @ turned.T for v in (trajectory.q, trajectory.dq, trajectory.ddq))
    assert q is not None
    return replace(trajectory, q=q, dq=dq, ddq=ddq, lean=None)


def has_times(program: TableProgram) -> bool:
    """Whether the rows of a table are joints over time."""
    return program.kind == "joint" and TIME in program.table.columns


def along_time(program: TableProgram, arm: Arm) -> TimedTable:
    """A table of joints and times as a motion.

    Raises
    ------
    ProgramError
        If times do not grow, or columns of speeds or accelerations are not whole.
    """
    table, source = program.table, program.source
    found = dict[str, FloatArray]()
    try:
        times = numbers(table, TIME, source, "a time in seconds")
        for letter, end in ENDS[1:]:
            columns = [f"{letter}{name[1:]}{end}" for name in arm.joint_columns]
            if any(name in table.columns for name in columns):
                check_header(list(table.columns), columns, source)
                values = np.column_stack([numbers(table, name, source, "a number") for name in columns])
                found[letter] = values * arm.joint_units
    except MeasurementError as error:
        refusal = ProgramError(str(error))
        refusal.file, refusal.row, refusal.column = error.file, error.row, error.column
        raise refusal from None
    still = np.flatnonzero(np.diff(times) <= 0.0)
    if len(still):
        k = int(still[0]) + 1
        message = f"times of a trajectory grow, found {times[k]:g} s after {times[k - 1]:g} s"
        raise ProgramError(message, file=source, row=int(program.rows[k]), column=TIME)
    try:
        derivatives = found.get("v"), found.get("a")
        motion = Trajectory(times, program.values, *derivatives, arm.joint_names, arm.table.prismatic)
    except RobotError as error:
        raise ProgramError(str(error), file=source) from None
    return TimedTable(**{f.name: getattr(program, f.name) for f in fields(TableProgram)}, arm=arm, motion=motion)
