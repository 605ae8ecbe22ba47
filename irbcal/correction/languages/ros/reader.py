"""Trajectories of ROS as YAML: joint names, and points with positions, speeds, accelerations and times.

What ``ros2 topic echo`` prints, and the goal of an action around it (keys ``trajectory``,
``joint_trajectory``, ``goal``). Radians and metres; joints are found by their names, others than the arm's stay as
they are. Times are ``sec`` and ``nanosec``, ``secs`` and ``nsecs``, or seconds.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import yaml

from irbcal.arrays import FloatArray
from irbcal.correction.languages.ros.nodes import Reader, document, line
from irbcal.correction.languages.ros.program import RosProgram
from irbcal.correction.listing import Number, mark_in
from irbcal.correction.program import Given, Note, read_bytes
from irbcal.errors import OptionError, ProgramError, RobotError
from irbcal.modeling.arm import Arm
from irbcal.modeling.trajectory import Trajectory

AROUND = ("trajectory", "joint_trajectory", "goal")
"""Keys of what may stand around a trajectory."""
KINDS = ("positions", "velocities", "accelerations")


def looks_like(data: bytes) -> bool:
    """Whether a file looks like a trajectory."""
    return re.search(rb"^[ \t-]*joint_names[ \t]*:", data, re.MULTILINE) is not None and b"points" in data


def read_for(arm: Arm, files: Sequence[Path], given: Given) -> list[RosProgram]:
    """Read trajectories for an arm; see `irbcal.correction.languages.Language`."""
    for parameter, frames in (("tool", given.tools), ("wobj", given.work_objects)):
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
    return mark_in([one[1:] for one in decoded(data, source).splitlines() if one.startswith("#")])


def parse(arm: Arm, data: bytes, source: str) -> RosProgram:
    """Read a trajectory.

    Raises
    ------
    ProgramError
        If it is none, or not of this arm.
    """
    text = decoded(data, source)
    read = Reader(source)
    node = _trajectory(read, document(text.removeprefix("\ufeff"), source))
    names = [read.text(one, "a joint's name") for one in read.items(node["joint_names"], "joint_names")]
    for k, name in enumerate(names):
        if name in names[:k]:
            raise read.error(node["joint_names"], f"the joint {name} stands in joint_names a second time")
    missing = [name for name in arm.joint_names if name not in names]
    if missing:
        expected, found = ", ".join(arm.joint_names), ", ".join(names) or "none"
        raise read.error(node["joint_names"], f"expected the joints {expected}, found {found}")
    points = [read.mapping(one, "a point") for one in read.items(node["points"], "points")]
    lines = [line(one) for one in read.items(node["points"], "points")]
    if not points:
        raise read.error(node["points"], "the trajectory has no points")
    columns = [names.index(name) for name in arm.joint_names]
    values: dict[str, FloatArray] = {}
    places: dict[str, list[list[Number]]] = {}
    for kind in KINDS:
        rows = [_row(read, point, kind, len(names), k) for k, point in enumerate(points)]
        _all_or_none(read, node["points"], kind, rows)
        if rows[0]:
            places[kind] = [[row[k] for k in columns] for row in rows]
            values[kind] = np.array([[one.value for one in row] for row in places[kind]])
    _once(places, source)
    if "positions" not in values:
        raise read.error(node["points"], "the points have no positions")
    times = np.array([_seconds(read, point, one) for point, one in zip(points, lines, strict=True)])
    derivatives = values.get("velocities"), values.get("accelerations")
    try:
        motion = Trajectory(times, values["positions"], *derivatives, arm.joint_names, arm.table.prismatic)
    except RobotError as error:
        raise ProgramError(str(error), file=source) from None
    shift = len(text) - len(text.removeprefix("\ufeff"))
    spans = {
        kind: tuple((one.start + shift, one.end + shift) for row in rows for one in row)
        for kind, rows in places.items()
    }
    notes = [Note(k, "efforts are kept as they are") for k, p in zip(lines, points, strict=True) if _has_effort(p)][:1]
    return RosProgram(source, data, text, arm, motion, tuple(lines), spans, tuple(notes), fingerprint(data, source))


def _trajectory(read: Reader, node: yaml.Node) -> Mapping[str, yaml.Node]:
    """The mapping with joint names and points."""
    found = read.mapping(node, "a trajectory")
    for _ in range(3):
        inside = next((found[key] for key in AROUND if key in found), None)
        if "joint_names" in found or inside is None:
            break
        found = read.mapping(inside, "a trajectory")
    for key in ("joint_names", "points"):
        if key not in found:
            raise read.error(node, f"expected a trajectory with joint_names and points, {key} is missing")
    return found


def _row(read: Reader, point: Mapping[str, yaml.Node], kind: str, joints: int, k: int) -> list[Number]:
    node = point.get(kind)
    if node is None:
        return []
    row = [read.number(one, f"one of the {kind}") for one in read.items(node, kind)]
    if row and len(row) != joints:
        raise read.error(node, f"point {k + 1} has {len(row)} {kind} for {joints} joints")
    return row


def _all_or_none(read: Reader, node: yaml.Node, kind: str, rows: Sequence[Sequence[Number]]) -> None:
    some = [bool(row) for row in rows]
    if any(some) and not all(some):
        raise read.error(node, f"point {some.index(False) + 1} has no {kind}, others have")


def _once(places: Mapping[str, Sequence[Sequence[Number]]], source: str) -> None:
    """Numbers that an alias (``*name``) repeats cannot be changed one by one."""
    starts = [one.start for rows in places.values() for row in rows for one in row]
    if len(set(starts)) < len(starts):
        raise ProgramError("two points share one list of numbers (an alias): write them out", file=source)


def _seconds(read: Reader, point: Mapping[str, yaml.Node], row: int) -> float:
    node = point.get("time_from_start")
    if node is None:
        raise ProgramError("a point has no time_from_start", file=read.source, line=row)
    if isinstance(node, yaml.ScalarNode):
        return read.number(node, "time_from_start").value
    parts = read.mapping(node, "time_from_start")
    for whole, rest in (("sec", "nanosec"), ("secs", "nsecs")):
        if whole in parts:
            nano = read.number(parts[rest], rest).value if rest in parts else 0.0
            return read.number(parts[whole], whole).value + 1e-9 * nano
    raise read.error(node, "expected time_from_start with sec and nanosec")


def _has_effort(point: Mapping[str, yaml.Node]) -> bool:
    node = point.get("effort")
    return isinstance(node, yaml.SequenceNode) and bool(node.value)
