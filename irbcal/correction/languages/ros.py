"""Trajectories of ROS as YAML: joint names, and points with positions, speeds, accelerations and times.

What ``ros2 topic echo`` prints, and the goal of an action around it (keys ``trajectory``,
``joint_trajectory``, ``goal``). Radians and metres; joints are found by their names, others than the arm's stay as
they are. Times are ``sec`` and ``nanosec``, ``secs`` and ``nsecs``, or seconds.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from irbcal.arrays import FloatArray, Locked
from irbcal.correction.language import Language
from irbcal.correction.listing import Number, Span, mark_in, number_like
from irbcal.correction.program import ControllerSetup, Corrections, Note, Program, Stop, WantedTargets, read_bytes
from irbcal.errors import OptionError, ProgramError, RobotError
from irbcal.modeling.arm import Arm
from irbcal.modeling.trajectory import Trajectory


def document(text: str, source: str) -> yaml.Node:
    """The one document of a text.

    Raises
    ------
    ProgramError
        If the text is no YAML, or holds none or several documents.
    """
    try:
        loader: Any = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
        nodes = [node for node in yaml.compose_all(text, Loader=loader) if node is not None]
        documents = [node for node in nodes if not isinstance(node, yaml.ScalarNode) or node.value.strip()]
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        problem = getattr(error, "problem", None) or "it cannot be read"
        line = None if mark is None else int(mark.line) + 1
        raise ProgramError(f"this is no YAML: {problem}", file=source, line=line) from None
    except RecursionError:
        raise ProgramError("this is no trajectory: its lists are nested too deep", file=source) from None
    if len(documents) != 1:
        raise ProgramError(f"expected one trajectory, found {len(documents)} YAML documents", file=source)
    return documents[0]


def line_of(node: yaml.Node) -> int:
    """Line of a node, from 1."""
    return int(node.start_mark.line) + 1


class NodeReader:
    """Takes nodes for what they should be; refusals name the file and the line."""

    def __init__(self, source: str) -> None:
        self.source = source

    def error(self, node: yaml.Node, message: str) -> ProgramError:
        """A refusal of a node."""
        return ProgramError(message, file=self.source, line=line_of(node))

    def mapping(self, node: yaml.Node, expected: str) -> dict[str, yaml.Node]:
        """Values by their keys."""
        if not isinstance(node, yaml.MappingNode):
            raise self.error(node, f"expected {expected} with names and values")
        values: dict[str, yaml.Node] = {}
        for key, value in node.value:
            name = key.value if isinstance(key, yaml.ScalarNode) else ""
            if name in values:
                raise self.error(key, f"{name} stands here a second time")
            values[name] = value
        return values

    def elements(self, node: yaml.Node, expected: str) -> Sequence[yaml.Node]:
        """The items of a list."""
        if not isinstance(node, yaml.SequenceNode):
            raise self.error(node, f"expected {expected} as a list")
        return list(node.value)

    def text(self, node: yaml.Node, expected: str) -> str:
        """A word."""
        if not isinstance(node, yaml.ScalarNode):
            raise self.error(node, f"expected {expected}")
        return str(node.value)

    def number(self, node: yaml.Node, expected: str) -> Number:
        """A finite number with its place in the text."""
        spelling = self.text(node, expected)
        try:
            value = float(spelling) if spelling.isascii() and "_" not in spelling else math.nan
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise self.error(node, f"expected {expected} as a finite number, found {spelling[:40]!r}")
        return Number(value, int(node.start_mark.index), int(node.end_mark.index))


DECIMALS = 12
"""Written at least: a picometre at one metre."""


@dataclass(frozen=True, eq=False, repr=False)
class RosProgram(Locked, Program):
    """A trajectory as read; see `irbcal.correction.program.Program` and `irbcal.correction.trajectories.Timed`."""

    source: str
    """File name for messages."""
    data: bytes
    text: str
    """The file."""
    arm: Arm
    trajectory: Trajectory
    """In the arm's joints."""
    lines: tuple[int, ...]
    """Of the points."""
    spans: Mapping[str, tuple[Span, ...]]
    """Where the numbers of the arm's joints stand, point by point: of ``positions``, ``velocities`` and
    ``accelerations`` as far as the file has them.
    """
    notes: tuple[Note, ...]
    fingerprint: str | None
    """Of the calibration that it was already corrected with."""
    commands: Trajectory | None = None
    """Speeds and accelerations to write."""

    def wanted_targets(self) -> list[WantedTargets]:
        """All points."""
        n = len(self.trajectory)
        names = tuple(f"point {k + 1}" for k in range(n))
        return [WantedTargets("joint", np.arange(n), names, np.array(self.lines), self.trajectory.q)]

    def stops(self) -> list[Stop]:
        """A point a stop, for who takes it as a list of poses."""
        return [Stop(line, k, k - 1 if k else None) for k, line in enumerate(self.lines)]

    def with_motion(self, commands: Trajectory) -> RosProgram:
        """The program with speeds and accelerations to write."""
        return replace(self, commands=commands)

    def with_fake_targets(self, corrections: Corrections, fingerprint: str | None) -> dict[str, bytes]:
        """The file with the numbers of the commands and a comment at its end."""
        ((_, fake),) = corrections
        if not fake.ok.all():
            return {self.source: self.data}
        new: dict[str, FloatArray | None] = {"positions": fake.q}
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
        tail = self.text[end:]
        newline = "\r\n" if "\r\n" in self.text else "\n"
        mark = "" if fingerprint is None else f"# irbcal fake targets, calibration {fingerprint}{newline}"
        return {self.source: "".join([*pieces, tail, "" if tail.endswith("\n") else newline, mark]).encode("utf-8")}


WRAPPER_KEYS = ("trajectory", "joint_trajectory", "goal")
"""Keys of what may stand around a trajectory."""
POINT_VALUES = ("positions", "velocities", "accelerations")


def looks_like(data: bytes) -> bool:
    """Whether a file looks like a trajectory."""
    return re.search(rb"^[ \t-]*joint_names[ \t]*:", data, re.MULTILINE) is not None and b"points" in data


def read_for(arm: Arm, files: Sequence[Path], setup: ControllerSetup) -> list[RosProgram]:
    """Read trajectories for an arm; see `irbcal.correction.languages.Language`."""
    for parameter, frames in (("tool", setup.tools), ("wobj", setup.work_objects)):
        if frames:
            message = f"{parameter}: a trajectory holds joints: there is no frame to give"
            raise OptionError(message, file=files[0], parameter=parameter)
    return [parse(arm, read_bytes(file), str(file)) for file in files]


def decoded(data: bytes, source: str) -> str:
    """The text of a file."""
    if b"\x00" in data:
        raise ProgramError("expected a trajectory as YAML, found binary data", file=source)
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        row = data[: error.start].count(b"\n") + 1
        raise ProgramError("expected UTF-8 text", file=source, line=row) from None


def fingerprint(data: bytes, source: str) -> str | None:
    """Fingerprint in the mark of a trajectory; empty where it names none, None without mark."""
    return mark_in([row[1:] for row in decoded(data, source).splitlines() if row.startswith("#")])


def parse(arm: Arm, data: bytes, source: str) -> RosProgram:
    """Read a trajectory.

    Raises
    ------
    ProgramError
        If it is none, or not of this arm.
    """
    text = decoded(data, source)
    read = NodeReader(source)
    node = _trajectory(read, document(text.removeprefix("\ufeff"), source))
    names = [read.text(name_node, "a joint's name") for name_node in read.elements(node["joint_names"], "joint_names")]
    for k, name in enumerate(names):
        if name in names[:k]:
            raise read.error(node["joint_names"], f"the joint {name} stands in joint_names a second time")
    missing = [name for name in arm.joint_names if name not in names]
    if missing:
        expected, names_read = ", ".join(arm.joint_names), ", ".join(names) or "none"
        raise read.error(node["joint_names"], f"expected the joints {expected}, found {names_read}")
    points = [read.mapping(point_node, "a point") for point_node in read.elements(node["points"], "points")]
    lines = [line_of(point_node) for point_node in read.elements(node["points"], "points")]
    if not points:
        raise read.error(node["points"], "the trajectory has no points")
    columns = [names.index(name) for name in arm.joint_names]
    values: dict[str, FloatArray] = {}
    numbers_of_kind: dict[str, list[list[Number]]] = {}
    for kind in POINT_VALUES:
        rows = [_row(read, point, kind, len(names), k) for k, point in enumerate(points)]
        _all_or_none(read, node["points"], kind, rows)
        if rows[0]:
            numbers_of_kind[kind] = [[row[k] for k in columns] for row in rows]
            values[kind] = np.array([[number.value for number in row] for row in numbers_of_kind[kind]])
    _once(numbers_of_kind, source)
    if "positions" not in values:
        raise read.error(node["points"], "the points have no positions")
    times = np.array([_seconds(read, point, node_line) for point, node_line in zip(points, lines, strict=True)])
    derivatives = values.get("velocities"), values.get("accelerations")
    try:
        motion = Trajectory(times, values["positions"], *derivatives, arm.joint_names, arm.table.prismatic)
    except RobotError as error:
        raise ProgramError(str(error), file=source) from None
    shift = len(text) - len(text.removeprefix("\ufeff"))
    spans = {
        kind: tuple((number.start + shift, number.end + shift) for row in rows for number in row)
        for kind, rows in numbers_of_kind.items()
    }
    notes = [Note(k, "efforts are kept as they are") for k, p in zip(lines, points, strict=True) if _has_effort(p)][:1]
    return RosProgram(source, data, text, arm, motion, tuple(lines), spans, tuple(notes), fingerprint(data, source))


def _trajectory(read: NodeReader, node: yaml.Node) -> Mapping[str, yaml.Node]:
    """The mapping with joint names and points."""
    trajectory = read.mapping(node, "a trajectory")
    for _ in range(3):
        inside = next((trajectory[key] for key in WRAPPER_KEYS if key in trajectory), None)
        if "joint_names" in trajectory or inside is None:
            break
        trajectory = read.mapping(inside, "a trajectory")
    for key in ("joint_names", "points"):
        if key not in trajectory:
            raise read.error(node, f"expected a trajectory with joint_names and points, {key} is missing")
    return trajectory


def _row(read: NodeReader, point: Mapping[str, yaml.Node], kind: str, joints: int, k: int) -> list[Number]:
    node = point.get(kind)
    if node is None:
        return []
    row = [read.number(number_node, f"one of the {kind}") for number_node in read.elements(node, kind)]
    if row and len(row) != joints:
        raise read.error(node, f"point {k + 1} has {len(row)} {kind} for {joints} joints")
    return row


def _all_or_none(read: NodeReader, node: yaml.Node, kind: str, rows: Sequence[Sequence[Number]]) -> None:
    present = [bool(row) for row in rows]
    if any(present) and not all(present):
        raise read.error(node, f"point {present.index(False) + 1} has no {kind}, others have")


def _once(numbers_of_kind: Mapping[str, Sequence[Sequence[Number]]], source: str) -> None:
    """Numbers that an alias (``*name``) repeats cannot be changed one by one."""
    starts = [number.start for rows in numbers_of_kind.values() for row in rows for number in row]
    if len(set(starts)) < len(starts):
        raise ProgramError("two points share one list of numbers (an alias): write them out", file=source)


def _seconds(read: NodeReader, point: Mapping[str, yaml.Node], row: int) -> float:
    node = point.get("time_from_start")
    if node is None:
        raise ProgramError("a point has no time_from_start", file=read.source, line=row)
    if isinstance(node, yaml.ScalarNode):
        return read.number(node, "time_from_start").value
    fields = read.mapping(node, "time_from_start")
    for seconds, nanoseconds in (("sec", "nanosec"), ("secs", "nsecs")):
        if seconds in fields:
            nano = read.number(fields[nanoseconds], nanoseconds).value if nanoseconds in fields else 0.0
            return read.number(fields[seconds], seconds).value + 1e-9 * nano
    raise read.error(node, "expected time_from_start with sec and nanosec")


def _has_effort(point: Mapping[str, yaml.Node]) -> bool:
    node = point.get("effort")
    return isinstance(node, yaml.SequenceNode) and bool(node.value)


def to_yaml(trajectory: Trajectory, frame_id: str = "") -> str:
    """A trajectory as the YAML of a message.

    Parameters
    ----------
    trajectory : Trajectory
        Times count from its own zero.
    frame_id : str
        Of the header.

    Returns
    -------
    str
        Radians and metres.
    """
    lines = ["header:", "  stamp: {sec: 0, nanosec: 0}", f"  frame_id: '{frame_id}'", "joint_names:"]
    lines += [f"- {name}" for name in trajectory.names]
    lines.append("points:")
    columns = {"positions": trajectory.q, "velocities": trajectory.dq, "accelerations": trajectory.ddq}
    for k, time in enumerate(trajectory.times):
        sign = "- "
        for kind, values in columns.items():
            row = "" if values is None else ", ".join(f"{x:.{DECIMALS}f}" for x in np.round(values[k], DECIMALS) + 0.0)
            lines.append(f"{sign}{kind}: [{row}]")
            sign = "  "
        nano = round(float(time) * 1e9)
        lines += ["  effort: []", f"  time_from_start: {{sec: {nano // 10**9}, nanosec: {nano % 10**9}}}"]
    return "\n".join(lines) + "\n"


ENDINGS = (".yaml", ".yml")


LANGUAGE = Language(
    name="ROS JointTrajectory",
    endings=ENDINGS,
    looks_like=looks_like,
    reader=read_for,
    fingerprint=fingerprint,
    shares_endings=True,
)
