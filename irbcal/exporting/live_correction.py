"""Live correction: wanted joints or poses in, commands out, one line of JSON each; never a jump, never a wild number.

For whoever sits on EGM, RSI, RTDE or ros2_control. The numbers are those of the exported module on plain floats
(`irbcal.exporting.plain`). Each line holds one of

- ``joints``: what would be commanded to the nominal robot, as a program has it;
- ``pose``: the tip in the base link, x, y, z and the unit quaternion w, x, y, z;
- ``model``: joints of ``calibrated.urdf``, as a planner on the calibrated model has them;

the first one also ``at``, the arm's actual joints, unless they are given before; and may hold a time ``t`` (seconds)
and an ``id`` (a whole number), which only grow and which the answer repeats. The answer holds ``joints``, the command,
which keeps the limits of speed, acceleration and jerk (`irbcal.exporting.motion`); ``held``: whether the line was
refused, in which case the arm is brought to rest, and ``why``; and else how far the command is from what was wanted.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Sequence
from math import asin, dist, sqrt
from time import monotonic, perf_counter_ns
from typing import IO, Any, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from pydantic_core import from_json, to_json

from irbcal import kernel
from irbcal.arrays import FloatArray
from irbcal.errors import OptionError
from irbcal.exporting.motion import GAP_S, LimitedMotion
from irbcal.exporting.plain import Plain
from irbcal.exporting.robot_numbers import RobotNumbers, constants
from irbcal.exporting.source import Source
from irbcal.io.opening import CalibrationLike
from irbcal.modeling.term_sums import compiled
from irbcal.option_values import checked, number
from irbcal.units import DEG, MM

JointUnits: TypeAlias = Literal["deg", "rad"]
"""Degrees and millimetres, or radians and metres."""
UNITS: tuple[JointUnits, ...] = ("deg", "rad")
INPUT_KINDS = ("joints", "pose", "model")
UNKNOWN_SPEED = {False: np.pi, True: 1.0}
"""Largest speed of a joint whose URDF tells none, radians (sliding: metres) per second."""
SLACK = 1.05
"""Targets may be this much faster than the joint's speed limit: the corrections of a move at full speed."""
START_S = 0.02
"""Seconds for which a first target may be away from the arm at the largest speed."""
RECOVERY_S = 0.25
"""Seconds for which targets that were too fast must keep the speed limits before the arm goes to them."""
LARGEST_CORRECTION = {False: 3.0 * DEG, True: 0.03}
"""Radians (sliding: metres) by which a joint is corrected at most."""
LARGEST_LEFT = (0.005, 0.5 * DEG)
"""Metres and radians by which a pose may be missed before a line is refused."""
LIMIT_MARGIN = 0.1
"""Radians (metres) beyond a limit that wanted joints may be."""
TO_SPEED_S, TO_ACCELERATION_S = 0.1, 0.05
"""Seconds from rest to the largest speed, and from none to the largest acceleration, unless given."""
RAMP_S = (0.001, 10.0)
"""Range of these."""
LONGEST_LINE = 65_536
"""Bytes; more is not read as one line."""
NUMBER_TYPES = frozenset({int, float})
LARGEST_ID = 2**53
LARGEST_T = 1e8
"""Seconds: of a larger number too few digits are behind the point."""


class Refused(Exception):
    """Why a line is not carried out."""


class Live:
    """Corrects a stream of wanted joints or poses, and keeps where the arm comes from.

    Parameters
    ----------
    source : Source
    units : {"deg", "rad"}
    at : array_like, shape (joints,), optional
        The arm's actual joints, in these units, as its controller counts them; in the first line unless given.
    to_speed, to_acceleration : float
        Seconds from rest to the largest speed, and from none to the largest acceleration.
    clock : callable
        Seconds, for lines without a time.

    Attributes
    ----------
    lines, held : int
        How many lines there were, and how many were refused.
    speed, acceleration, jerk : list of float
        Limits of the joints, radians (sliding: metres) per second, and so on.

    Raises
    ------
    OptionError
        If ``at`` are no joints of this arm.
    """

    def __init__(
        self,
        source: Source,
        units: JointUnits = "deg",
        at: ArrayLike | None = None,
        to_speed: float = TO_SPEED_S,
        to_acceleration: float = TO_ACCELERATION_S,
        clock: Callable[[], float] = monotonic,
    ) -> None:
        numbers = source.numbers
        robot, fast = source.robot, dict[str, Any]()
        self._new_motion: Any = LimitedMotion
        compiled_robot = compiled(robot.arm, robot.joint_map.sums, reach=numbers.reach, more={"stride": numbers.stride})
        if compiled_robot is not None:  # what every line needs, by the compiled kernel
            fast = {"nearest_effective": compiled_robot.nearest, "commanded_moving": compiled_robot.settled}
            fast |= {"forward_effective": compiled_robot.tip, "forward_nominal": compiled_robot.nominal_tip}
            self._new_motion = kernel.Motion
        self._robot: Any = Plain(**constants(numbers, source.vectors), **fast)
        self.speed: list[float] = known_speed(numbers).tolist()
        self.acceleration = [v / to_speed for v in self.speed]
        self.jerk = [a / to_acceleration for a in self.acceleration]
        length, angle = (MM, DEG) if units == "deg" else (1.0, 1.0)
        self._units: list[float] = np.where(numbers.slides, length, angle).tolist()
        self._length, self._angle, self._radians = length, angle, units == "rad"
        self._correction = [LARGEST_CORRECTION[slides] for slides in numbers.slides.tolist()]
        coupled = not np.array_equal(numbers.coupling, np.eye(len(numbers.coupling)))
        self._coupling = numbers.coupling if coupled else None
        self.fingerprint, self.simulated = numbers.fingerprint, numbers.simulated
        self.lines = self.stopped = 0
        n = len(self._units)
        self._clock = clock
        self._motion: Any = None
        self._stamped: bool | None = None
        self._time: float | None = None
        self._mark: int | None = None
        self._credit = START_S
        self._seen: tuple[float, list[float]] | None = None
        self._since: float | None = None
        self._resting: list[float] | None = None
        self._goal: list[float] = [0.0] * n
        self._theta: list[float] = [0.0] * n
        self._shift: list[float] = [0.0] * n
        self._moves: list[float] = [0.0] * n
        self._at: list[float] | None = None
        if at is not None:
            try:
                self._at = self._numbers("at", np.asarray(at).tolist())
            except Refused as refused:
                raise OptionError(str(refused), parameter="at") from None

    def answer(self, line: str | bytes) -> str:
        """The answer to a line, without a line end: JSON, whatever the line was."""
        self.lines += 1
        said: dict[str, Any] = {}
        try:
            content = _parsed(line)
            self._mark_and_time(content, said)
            error = self._follow(content)
        except Refused as refused:
            self.stopped += 1
            said |= {"joints": self._brake(), "held": True, "why": str(refused)}
        else:
            said |= {"joints": self._in_units_of_user(self._command), "held": False, **error}
        return to_json(said).decode()

    def _in_units_of_user(self, q: Sequence[float]) -> list[float]:
        if self._coupling is not None:
            q = np.linalg.solve(self._coupling, q).tolist()
        return [a / b for a, b in zip(q, self._units, strict=True)]

    def _mark_and_time(self, content: dict[str, Any], said: dict[str, Any]) -> None:
        """Read ``id`` and ``t``, which the answer repeats where they are numbers; let the time pass."""
        mark, t = content.get("id"), content.get("t")
        mark = mark if type(mark) is int and abs(mark) <= LARGEST_ID else None
        t = t if isinstance(t, (int, float)) and type(t) is not bool and abs(t) < LARGEST_T else None
        said |= ({} if mark is None else {"id": mark}) | ({} if t is None else {"t": t})
        if "t" in content and t is None:
            raise Refused("t: expected seconds")
        if self._stamped not in (None, t is not None):
            raise Refused(
                "t: expected in every line, as in the first" if self._stamped else "t: the first line has none"
            )
        if t is not None and self._time is not None and not t > self._time:
            raise Refused("t: not later than that of an earlier line")
        if t is not None:
            self._pass(float(t))
        if "id" in content and mark is None:
            raise Refused("id: expected a whole number")
        if mark is not None and self._mark is not None and not mark > self._mark:
            raise Refused(f"id: {mark} is not above {self._mark}, that of an earlier line")
        self._mark = self._mark if mark is None else mark

    def _pass(self, t: float) -> None:
        """It is t now."""
        if self._motion is not None and self._time is not None:
            self._credit = min(self._credit + (t - self._time), GAP_S)
        self._time = t

    def _numbers(self, kind: str, values_given: Any) -> list[float]:
        count = 7 if kind == "pose" else len(self._units)
        if not isinstance(values_given, list) or len(values_given) != count:
            raise Refused(f"{kind}: expected {count} numbers")
        if not NUMBER_TYPES.issuperset(map(type, values_given)):
            raise Refused(f"{kind}: expected {count} numbers")
        units = [self._length] * 3 + [1.0] * 4 if kind == "pose" else self._units
        try:
            values = [a * b for a, b in zip(values_given, units, strict=True)]
        except OverflowError:
            raise Refused(f"{kind}: not a finite number") from None
        if not all(abs(value) < 1e6 for value in values):  # nan is not, either
            raise Refused(f"{kind}: not a finite number")
        if kind == "pose":
            return values
        if kind != "model" and self._coupling is not None:
            values = (self._coupling @ values).tolist()
        robot = self._robot
        for i, value in enumerate(values):
            if not robot.LOWER[i] - LIMIT_MARGIN <= value <= robot.UPPER[i] + LIMIT_MARGIN:
                degrees = self._radians and not robot.SLIDES[i] and abs(value) > 2.0 * np.pi
                hint = ": these look like degrees" if degrees else ""
                raise Refused(f"{kind}: {robot.JOINT_NAMES[i]} is beyond its limits{hint}")
        return values

    def _begin(self, content: dict[str, Any], t: float) -> Any:
        """The arm stands where it is."""
        at = self._at if "at" not in content else self._numbers("at", content["at"])
        if at is None:
            raise Refused("the first line needs at, the arm's actual joints")
        robot = self._robot
        limits = zip(at, self.speed, self.acceleration, self.jerk, robot.LOWER, robot.UPPER, strict=True)
        self._goal, self._theta = at, robot.effective(at)
        self._stamped, self._time, self._seen = "t" in content, t, (t, at)
        return self._new_motion(t, [[*each] for each in limits])

    def _follow(self, content: dict[str, Any]) -> dict[str, float]:
        """Carry out what is wanted; how far the command is from it."""
        kinds = [kind for kind in INPUT_KINDS if kind in content]
        if len(kinds) != 1:
            raise Refused("expected one of joints, pose and model")
        kind = kinds[0]
        if self._motion is not None and "at" in content:
            raise Refused("at: the arm's joints are known")
        values = self._numbers(kind, content[kind])
        t = float(content["t"]) if "t" in content else self._clock()
        if self._motion is None:
            self._motion = self._begin(content, t)
        if "t" not in content:
            self._pass(t)
        robot = self._robot
        T, theta = self._effective(kind, values)
        moves = robot.lean(self._moves, [a - b for a, b in zip(theta, self._theta, strict=True)])
        start = [a + b - c for a, b, c in zip(theta, self._goal, self._theta, strict=True)]
        q = robot.commanded_moving(theta, moves, start)
        if q is None:
            raise Refused("the joint map has no command for it")
        for i, (value, lower, upper) in enumerate(zip(q, robot.LOWER, robot.UPPER, strict=True)):
            if not lower <= value <= upper:
                raise Refused(f"{robot.JOINT_NAMES[i]} would leave its limits")
        self._spend(q, t)
        if kind == "joints":
            self._shift = [a - b for a, b in zip(theta, values, strict=True)]
        self._goal, self._theta, self._moves, self._resting = q, theta, moves, None
        self._command = self._motion.follow(t, q, True)
        T_command = robot.forward_effective([a + b - c for a, b, c in zip(theta, self._command, q, strict=True)])
        distance, turn = _apart(T, T_command)
        unit = ("m", "rad") if self._radians else ("mm", "deg")
        return {f"error_{unit[0]}": distance / self._length, f"error_{unit[1]}": turn / self._angle}

    def _spend(self, q: list[float], t: float) -> None:
        """Refuse a target that is farther than the time that passed allows.

        Where targets went on without a jump, only faster than the arm can, it catches up once they are slow again.
        """

        def seconds(from_joints: Sequence[float]) -> tuple[float, int]:
            """How long the way to there takes at the largest speed, and the joint that takes so long."""
            each = [abs(a - b) / (SLACK * v) for a, b, v in zip(q, from_joints, self.speed, strict=True)]
            return max(each), each.index(max(each))

        need, slowest = seconds(self._goal)
        steady = need <= self._credit
        if steady:
            self._credit -= need
        elif self._seen is not None:
            last, where = self._seen
            passed, step = min(t - last, GAP_S), seconds(where)[0]
            self._since = t if self._since is None or step > passed else self._since
            steady = step <= passed and t - self._since >= RECOVERY_S
            self._seen = (t, q) if step <= passed + START_S else None
        if not steady:
            raise Refused(f"{self._robot.JOINT_NAMES[slowest]} would jump")
        self._seen, self._since = (t, q), None

    def _brake(self) -> list[float] | None:
        """The command of a line that is refused: on the way to where the arm comes to rest; None before it began."""
        if self._motion is None:
            return None
        if self._stamped is False:
            self._pass(self._clock())
        if self._resting is None:
            robot = self._robot
            end = zip(self._motion.rest(), robot.LOWER, robot.UPPER, strict=True)
            self._resting = [min(max(x, lower), upper) for x, lower, upper in end]
        assert self._time is not None
        self._command = self._motion.follow(self._time, self._resting, False)
        return self._in_units_of_user(self._command)

    def _effective(self, kind: str, values: list[float]) -> tuple[list[list[float]], list[float]]:
        """The wanted tip, and the joints of calibrated.urdf that come as near to it as they safely can."""
        robot = self._robot
        if kind == "model":
            return robot.forward_effective(values), values
        if len(self._units) < 6:
            raise Refused(f"{kind}: an arm with fewer than six joints takes model only")
        if kind == "joints":
            T, middle, range_ = robot.forward_nominal(values), values, self._correction
            seed = [a + b for a, b in zip(values, self._shift, strict=True)]
        else:
            T, middle, seed, range_ = _matrix(values), self._theta, self._theta, [GAP_S * v for v in self.speed]
        theta, distance, turn = robot.nearest_effective(
            T,
            seed,
            1e-10,
            [a - b for a, b in zip(middle, range_, strict=True)],
            [a + b for a, b in zip(middle, range_, strict=True)],
        )
        if not (distance < np.inf and (kind == "joints" or (distance <= LARGEST_LEFT[0] and turn <= LARGEST_LEFT[1]))):
            raise Refused(f"{kind}: no solution near the last command")
        return T, theta


def known_speed(numbers: RobotNumbers) -> FloatArray:
    """Largest speed of each joint, `UNKNOWN_SPEED` where its URDF tells none, shape (n,)."""
    usual = np.where(numbers.slides, UNKNOWN_SPEED[True], UNKNOWN_SPEED[False])
    return np.where(np.isfinite(numbers.speed), numbers.speed, usual)


def _parsed(text: str | bytes) -> dict[str, Any]:
    """The object of a line."""
    try:
        if len(text) > LONGEST_LINE:
            raise ValueError
        content = from_json(text.encode() if isinstance(text, str) else text)
    except ValueError:
        raise Refused("not a line of JSON") from None
    if not isinstance(content, dict):
        raise Refused('expected an object such as {"joints": [...]}')
    return content


def _apart(first: Sequence[Sequence[float]], second: Sequence[Sequence[float]]) -> tuple[float, float]:
    """Distance (m) and angle (rad) between two poses of three rows."""
    (xx, xy, xz, x), (yx, yy, yz, y), (zx, zy, zz, z) = first
    (ux, uy, uz, u), (vx, vy, vz, v), (wx, wy, wz, w) = second
    distance = dist((x, y, z), (u, v, w))
    chord = dist((xx, xy, xz, yx, yy, yz, zx, zy, zz), (ux, uy, uz, vx, vy, vz, wx, wy, wz))
    return distance, 2.0 * asin(min(chord / sqrt(8.0), 1.0))


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
    at: ArrayLike | None = None,
    units: JointUnits = "deg",
    to_speed: float = TO_SPEED_S,
    to_acceleration: float = TO_ACCELERATION_S,
    payload: float | None = None,
    payload_centre: ArrayLike | None = None,
    without_frame_terms: bool = False,
) -> Live:
    """Live correction of wanted joints or poses: what ``irbcal stream`` does with its lines.

    Parameters
    ----------
    calibration : str, Path, Record or a result that holds one
        Calibration folder (in Python also a loaded calibration).
    at : array_like, shape (joints,), optional
        The arm's actual joints; in the first line unless given.
    units : {"deg", "rad"}
        Of joints and poses: degrees and millimetres, or radians and metres.
    to_speed : float
        Seconds from rest to the speed limit of the URDF (where there is none: 180 degrees, sliding 1 metre, a second):
        the largest acceleration.
    to_acceleration : float
        Seconds from no acceleration to the largest one: the largest jerk.
    payload : float, optional
        See `irbcal.forward_kinematics`.
    payload_centre : array_like, shape (3,), optional
        See `irbcal.forward_kinematics`.
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
        If an option is none.
    """
    checked("units", units, UNITS)
    to_speed = number("to_speed", to_speed, *RAMP_S)
    to_acceleration = number("to_acceleration", to_acceleration, *RAMP_S)
    source = Source.from_calibration(
        calibration, payload=payload, payload_centre=payload_centre, without_frame_terms=without_frame_terms
    )
    return Live(source, units, at, to_speed, to_acceleration)


# --- the loop: a line in, a line out, and how long each took

BUCKETS = 100_000
"""Microseconds that are counted apart; longer ones count as this many."""


class Latencies:
    """How long answers took, in whole microseconds, in a memory that does not grow."""

    def __init__(self) -> None:
        self._counts = [0] * (BUCKETS + 1)
        self.longest_ns = 0

    def add(self, ns: int) -> None:
        """Count one answer."""
        self._counts[min(ns // 1000, BUCKETS)] += 1
        if ns > self.longest_ns:
            self.longest_ns = ns

    def quantile(self, share: float) -> int:
        """Microseconds that so large a share of the answers did not exceed."""
        counts = np.cumsum(self._counts)
        if not counts[-1]:
            return 0
        return int(np.searchsorted(counts, share * counts[-1])) + 1

    def in_words(self, live: Live) -> str:
        """What is reported at the end."""
        if not live.lines:
            return "no lines"
        return (
            f"{live.lines} lines, {live.stopped} held; a line took {self.quantile(0.5)} us (median), "
            f"{self.quantile(0.999)} us (99.9th percentile), {self.longest_ns // 1000} us (longest)"
        )


def run(live: Live, lines: IO[bytes], out: IO[bytes], tell: Callable[[str], None]) -> None:
    """Answer lines until there are no more, or the user stops.

    Parameters
    ----------
    live : Live
    lines, out : binary streams
        Each answer is flushed at once.
    tell : callable
        Given the latencies in words at the end.
    """
    latencies = Latencies()
    gc.collect()
    gc.freeze()  # what is there stays; a collection would cost milliseconds
    gc.disable()
    try:
        while message := lines.readline(LONGEST_LINE + 1):
            start = perf_counter_ns()
            if len(message) > LONGEST_LINE and not message.endswith(b"\n"):
                _rest(lines)
            out.write(live.answer(message).encode() + b"\n")
            out.flush()
            latencies.add(perf_counter_ns() - start)
    except KeyboardInterrupt:
        pass
    finally:
        gc.enable()
        gc.unfreeze()
        tell(latencies.in_words(live))


def _rest(lines: IO[bytes]) -> None:
    """Read on to the end of a line that is too long."""
    while (more := lines.readline(LONGEST_LINE)) and not more.endswith(b"\n"):
        pass
