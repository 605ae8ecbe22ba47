"""Live correction: wanted joints or poses in, commands out, one line of JSON each; never a jump, never a wild number.

For whoever sits on EGM, RSI, RTDE or ros2_control. The numbers are those of the exported module on plain floats
(`irbcal.exporting.plain`). Each line holds one of

- ``joints``: what would be commanded to the nominal robot, as a program has it;
- ``pose``: the tip in the base link, x, y, z and the unit quaternion w, x, y, z;
- ``model``: joints of ``calibrated.urdf``, as a planner on the calibrated model has them;

and may hold an ``id``, a whole number that the answer repeats. The answer holds ``joints``, the command, and ``held``:
where the wanted cannot be done safely, the last safe command is repeated, and ``why`` says what was wrong.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray
from irbcal.exporting import python
from irbcal.exporting.parts import Parts
from irbcal.exporting.plain import Plain
from irbcal.exporting.source import Source
from irbcal.files.calibration_folder import CalibrationLike
from irbcal.options import checked, number
from irbcal.units import DEG, MM

Units: TypeAlias = Literal["deg", "rad"]
"""Degrees and millimetres, or radians and metres."""
UNITS: tuple[Units, ...] = ("deg", "rad")
KINDS = ("joints", "pose", "model")
UNKNOWN_SPEED = {False: np.pi, True: 1.0}
"""Largest speed of a joint whose URDF tells none, radians (sliding: metres) per second."""
SLACK = 1.05
"""Commands may be this much faster than the joint's speed limit: the corrections of a move at full speed."""
LONGEST_LINE = 65_536
"""Bytes; more is not read as one line."""
LARGEST_ID = 2**53


class Refused(Exception):
    """Why a line is not carried out."""


class Live:
    """Corrects a stream of wanted joints or poses, and keeps where the arm comes from.

    Parameters
    ----------
    source : Source
    rate : float
        Lines per second: tells how far a joint may go in one line.
    units : {"deg", "rad"}

    Attributes
    ----------
    lines, held : int
        How many lines there were, and for how many the last command was repeated.
    """

    def __init__(self, source: Source, rate: float = 1000.0, units: Units = "deg") -> None:
        parts = source.parts
        self._robot: Any = Plain(**python.constants(parts, source.vectors))
        speed = np.where(
            np.isfinite(parts.speed), parts.speed, np.where(parts.slides, UNKNOWN_SPEED[True], UNKNOWN_SPEED[False])
        )
        self.steps: list[float] = (SLACK * speed / rate).tolist()
        length, angle = (MM, DEG) if units == "deg" else (1.0, 1.0)
        self._units: list[float] = np.where(parts.slides, length, angle).tolist()
        self._length = length
        coupled = not np.array_equal(parts.coupling, np.eye(len(parts.coupling)))
        self._coupling = parts.coupling if coupled else None
        self.fingerprint, self.simulated = parts.fingerprint, parts.simulated
        self.lines = self.held = 0
        n = len(self._units)
        self._command: list[float] | None = None
        self._theta: list[float] = [0.0] * n
        self._shift: list[float] = [0.0] * n
        self._moves: list[float] = [0.0] * n

    def answer(self, line: str | bytes) -> str:
        """The answer to a line, without a line end: JSON, whatever the line was."""
        self.lines += 1
        mark = None
        try:
            kind, wanted, mark = self._read(line)
            self._follow(kind, wanted)
        except Refused as refused:
            self.held += 1
            return self._say(getattr(refused, "mark", mark), str(refused))
        return self._say(mark, None)

    def _say(self, mark: int | None, why: str | None) -> str:
        content: dict[str, Any] = {} if mark is None else {"id": mark}
        content["joints"] = None if self._command is None else self._shown(self._command)
        content["held"] = why is not None
        if why is not None:
            content["why"] = why
        return json.dumps(content)

    def _shown(self, q: Sequence[float]) -> list[float]:
        if self._coupling is not None:
            q = np.linalg.solve(self._coupling, q).tolist()
        return [a / b for a, b in zip(q, self._units, strict=True)]

    def _read(self, line: str | bytes) -> tuple[str, list[float], int | None]:
        try:
            if len(line) > LONGEST_LINE:
                raise ValueError
            content = json.loads(line if isinstance(line, str) else line.decode())
        except (ValueError, RecursionError):
            raise Refused("not a line of JSON") from None
        if not isinstance(content, dict):
            raise Refused('expected an object such as {"joints": [...]}')
        mark = content.get("id")
        mark = mark if type(mark) is int and abs(mark) <= LARGEST_ID else None
        kinds = [kind for kind in KINDS if kind in content]
        try:
            if len(kinds) != 1:
                raise Refused("expected one of joints, pose and model")
            return kinds[0], self._numbers(kinds[0], content[kinds[0]]), mark
        except Refused as refused:
            if mark is not None:
                raise Marked(mark, str(refused)) from None
            raise

    def _numbers(self, kind: str, given: Any) -> list[float]:
        count = 7 if kind == "pose" else len(self._units)
        if not isinstance(given, list) or len(given) != count:
            raise Refused(f"{kind}: expected {count} numbers")
        if not all(type(value) in (int, float) for value in given):
            raise Refused(f"{kind}: expected {count} numbers")
        try:
            values = [float(value) for value in given]
        except OverflowError:
            raise Refused(f"{kind}: not a finite number") from None
        if kind == "pose":
            values = [value * self._length for value in values[:3]] + values[3:]
        else:
            values = [a * b for a, b in zip(values, self._units, strict=True)]
        if not all(abs(value) < 1e6 for value in values):  # nan is not, either
            raise Refused(f"{kind}: not a finite number")
        if kind == "joints" and self._coupling is not None:
            values = (self._coupling @ values).tolist()
        return values

    def _follow(self, kind: str, wanted: list[float]) -> None:
        """Carry out what is wanted, or leave everything as it was."""
        robot, last = self._robot, self._command
        theta = wanted if kind == "model" else self._effective(kind, wanted)
        step = [0.0] * len(theta) if last is None else [a - b for a, b in zip(theta, self._theta, strict=True)]
        moves = robot.lean(self._moves, step)
        start = theta if last is None else [a + b - c for a, b, c in zip(theta, last, self._theta, strict=True)]
        q = robot.commanded_moving(theta, moves, start)
        if q is None:
            raise Refused("the joint map has no command for it")
        for i, (value, lower, upper) in enumerate(zip(q, robot.LOWER, robot.UPPER, strict=True)):
            if not lower <= value <= upper:
                raise Refused(f"{robot.JOINT_NAMES[i]} would leave its limits")
        if last is not None:
            for i, (value, before, most) in enumerate(zip(q, last, self.steps, strict=True)):
                if not abs(value - before) <= most:
                    raise Refused(f"{robot.JOINT_NAMES[i]} would jump")
        if kind == "joints":
            self._shift = [a - b for a, b in zip(theta, wanted, strict=True)]
        self._command, self._theta, self._moves = q, theta, moves

    def _effective(self, kind: str, wanted: list[float]) -> list[float]:
        robot = self._robot
        if len(self._units) < 6:
            raise Refused(f"{kind}: an arm with fewer than six joints takes model only")
        if kind == "joints":
            T, seed = robot.forward_nominal(wanted), [a + b for a, b in zip(wanted, self._shift, strict=True)]
        else:
            if self._command is None:
                raise Refused("pose: the first line must tell joints or model, to know which way the arm is bent")
            T, seed = _matrix(wanted), self._theta
        theta: list[float] | None = robot.inverse_effective(T, seed, 1e-10)
        if theta is None:
            raise Refused(f"{kind}: no solution near the last command")
        return theta


def known_speed(parts: Parts) -> FloatArray:
    """Largest speed of each joint, `UNKNOWN_SPEED` where its URDF tells none, shape (n,)."""
    usual = np.where(parts.slides, UNKNOWN_SPEED[True], UNKNOWN_SPEED[False])
    return np.where(np.isfinite(parts.speed), parts.speed, usual)


class Marked(Refused):
    """A refusal of a line whose ``id`` is known."""

    def __init__(self, mark: int, why: str) -> None:
        super().__init__(why)
        self.mark = mark


def _matrix(pose: Sequence[float]) -> list[list[float]]:
    """Rotation and place of x, y, z and a quaternion."""
    px, py, pz, w, x, y, z = pose
    size = w * w + x * x + y * y + z * z
    if not abs(size - 1.0) < 1e-3:
        raise Refused("pose: expected a unit quaternion w, x, y, z")
    s = 2.0 / size
    return [
        [1.0 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w), px],
        [s * (x * y + z * w), 1.0 - s * (x * x + z * z), s * (y * z - x * w), py],
        [s * (x * z - y * w), s * (y * z + x * w), 1.0 - s * (x * x + y * y), pz],
    ]


def stream(
    calibration: CalibrationLike,
    *,
    rate: float = 1000.0,
    units: Units = "deg",
    payload: float | None = None,
    payload_place: ArrayLike | None = None,
    without_frame_terms: bool = False,
) -> Live:
    """Live correction of wanted joints or poses: what ``irbcal stream`` does with its lines.

    Parameters
    ----------
    calibration : str, Path, Record or a result that holds one
        Calibration folder, or a loaded calibration.
    rate : float
        Lines per second. In one line a joint may go as far as its speed limit in the URDF allows (where there is none:
        180 degrees, sliding 1 metre, a second), and one twentieth more.
    units : {"deg", "rad"}
        Of joints and poses in the lines: degrees and millimetres, or radians and metres.
    payload : float, optional
        Mass carried, kg; what most poses of the calibration were measured with unless given.
    payload_place : array_like, shape (3,), optional
        Its centre in the tip link, metres; that of the calibration unless given.
    without_frame_terms : bool
        Use URDF and joint map alone where the calibration has more.

    Returns
    -------
    Live
        Its method ``answer`` takes a line and gives one.

    Raises
    ------
    CalibrationError, RobotError
        As `irbcal.exporting.export.export`.
    OptionError
        If rate or units are none.
    """
    rate = number("rate", rate, 1.0, 100_000.0)
    checked("units", units, UNITS)
    source = Source.of(
        calibration, payload=payload, payload_place=payload_place, without_frame_terms=without_frame_terms
    )
    return Live(source, rate, units)
