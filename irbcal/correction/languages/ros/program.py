"""A trajectory of ROS and the way back into its file."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from irbcal.arrays import FloatArray, lock
from irbcal.correction.fake_targets import Corrected
from irbcal.correction.listing import Span, number_like
from irbcal.correction.program import Goals, Left, Note, Stop
from irbcal.modeling.arm import Arm
from irbcal.modeling.trajectory import Trajectory

DECIMALS = 12
"""Written at least: a picometre at one metre."""


@dataclass(frozen=True, eq=False, repr=False)
class RosProgram:
    """A trajectory as read; see `irbcal.correction.program.Program` and `irbcal.correction.timed.Timed`.

    Attributes
    ----------
    source : str
        File name for messages.
    data : bytes
    text : str
        The file.
    arm : Arm
    trajectory : Trajectory
        In the arm's joints.
    lines : tuple of int
        Of the points.
    spans : dict of str to tuple of (int, int)
        Where the numbers of the arm's joints stand, point by point: of ``positions``, ``velocities`` and
        ``accelerations`` as far as the file has them.
    notes : tuple of Note
    fingerprint : str or None
        Of the calibration that it was already corrected with.
    commands : Trajectory or None
        Speeds and accelerations to write.
    """

    source: str
    data: bytes
    text: str
    arm: Arm
    trajectory: Trajectory
    lines: tuple[int, ...]
    spans: Mapping[str, tuple[Span, ...]]
    notes: tuple[Note, ...]
    fingerprint: str | None
    commands: Trajectory | None = None

    def __post_init__(self) -> None:
        lock(self)

    def goals(self) -> list[Goals]:
        """All points, in joints as a controller counts them: what the filter takes joints for."""
        n = len(self.trajectory)
        names = tuple(f"point {k + 1}" for k in range(n))
        return [Goals("joint", np.arange(n), names, np.array(self.lines), self.arm.to_controller(self.trajectory.q))]

    def left(self) -> tuple[Left, ...]:
        """Nothing: a motion is corrected as a whole."""
        return ()

    def stops(self) -> list[Stop]:
        """A point a stop, for who takes it as a list of poses."""
        return [Stop(line, k, k - 1 if k else None) for k, line in enumerate(self.lines)]

    def refused(self, goals: Goals, fake: Corrected) -> list[str]:
        """Everything can be written into a trajectory."""
        return [""] * len(goals.names)

    def with_motion(self, commands: Trajectory) -> RosProgram:
        """The program with speeds and accelerations to write."""
        return replace(self, commands=commands)

    def with_fake_targets(self, found: Sequence[tuple[Goals, Corrected]], fingerprint: str | None) -> dict[str, bytes]:
        """The file with the numbers of the commands and a comment at its end."""
        ((_, fake),) = found
        if not fake.ok.all():
            return {self.source: self.data}
        new: dict[str, FloatArray | None] = {"positions": self.arm.from_controller(fake.q)}
        if self.commands is not None:
            new |= {"velocities": self.commands.dq, "accelerations": self.commands.ddq}
        edits = []
        for kind, spans in self.spans.items():
            values = new.get(kind)
            if values is not None:
                edits += [(*span, float(value)) for span, value in zip(spans, values.ravel(), strict=True)]
        pieces, end = list[str](), 0
        for start, stop, value in sorted(edits):
            pieces += [self.text[end:start], number_like(self.text[start:stop], value, DECIMALS)]
            end = stop
        rest = self.text[end:]
        newline = "\r\n" if "\r\n" in self.text else "\n"
        mark = "" if fingerprint is None else f"# irbcal fake targets, calibration {fingerprint}{newline}"
        return {self.source: "".join([*pieces, rest, "" if rest.endswith("\n") else newline, mark]).encode("utf-8")}
