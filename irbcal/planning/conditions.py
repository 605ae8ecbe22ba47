"""The reflectors that a plan measures, and the conditions that each of its poses must meet.

They follow Nubiola 2011, sections 7.1 and 7.2: inside the joint limits, above the obstacles, with a reflector that the
tracker sees without anybody turning it. They are checked from cheap to dear, each on those poses that the earlier ones
left, and it is counted how many each removes.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, TypeAlias

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray, lock
from irbcal.errors import MeasurementError
from irbcal.measurement.column_names import all_or_none
from irbcal.measurement.input_table import InputTable
from irbcal.measurement.input_table import read_targets as read_positions
from irbcal.modeling.arm import Arm
from irbcal.modeling.commanded_joints import METRES_PER_DEGREE, home_joints
from irbcal.modeling.robot import Robot
from irbcal.planning import route
from irbcal.simulation.effects import size_of
from irbcal.simulation.instruments import ACCEPTANCE, FRONT, thesis_tool, turned_away
from irbcal.units import DEG

DIRECTIONS = ("nx", "ny", "nz")


@dataclass(frozen=True, eq=False)
class Targets:
    """Reflectors on the tool."""

    names: tuple[str, ...]
    positions: FloatArray
    """Shape (k, 3). In the tip link, metres."""
    directions: FloatArray | None = None
    """Shape (k, 3). Where they look, in the tip link (made unit vectors); None where not known."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "positions", np.array(self.positions, dtype=float).reshape(-1, 3))
        if self.directions is not None:
            looks = np.array(self.directions, dtype=float).reshape(-1, 3)
            object.__setattr__(self, "directions", looks / np.linalg.norm(looks, axis=1, keepdims=True))
        lock(self)


TargetsLike: TypeAlias = "str | Path | int | Sequence[str] | Targets"
"""A file, a number of reflectors, names, or the reflectors themselves."""


def reflectors(robot: Robot, requested: TargetsLike | None, tracker: FloatArray) -> Targets:
    """The reflectors that a plan measures.

    Parameters
    ----------
    robot : Robot
        Of a calibration, it has reflectors of its own.
    requested : str, Path, int, sequence of str or Targets, optional
        A file of reflectors (see `read_targets`); how many of the thesis tool's nine reflectors, or which (``thesis``
        for all, or names with commas between them). Three unless given, of a calibration its own.
    tracker : ndarray, shape (3,)
        The tracker in the base link, metres.

    Raises
    ------
    MeasurementError
        If a reflector is unknown or the file is refused.
    """
    calibrated = robot.targets
    if requested is None and calibrated:
        return Targets(tuple(calibrated), np.array(list(calibrated.values())))
    if isinstance(requested, Targets):
        requested_targets = requested
    elif isinstance(requested, (str, Path)) and Path(requested).is_file():
        requested_targets = read_targets(requested)
    else:
        requested_targets = _thesis_targets(robot.arm, "3" if requested is None else requested, tracker)
    if not calibrated:
        return requested_targets
    missing = [name for name in requested_targets.names if name not in calibrated]
    if missing:
        raise MeasurementError(
            f"unknown target {missing[0]!r}: this calibration has {', '.join(calibrated)}", parameter="targets"
        )
    return Targets(
        requested_targets.names,
        np.array([calibrated[name] for name in requested_targets.names]),
        requested_targets.directions,
    )


def _thesis_targets(arm: Arm, requested: str | Path | int | Sequence[str], tracker: FloatArray) -> Targets:
    """Reflectors of the thesis's tool; those on the front look at the tracker when the arm is at home."""
    home = arm.forward(home_joints(arm)[None])[0]
    look = home[:3, :3].T @ (tracker - home[:3, 3])
    tool = thesis_tool(look, size_of(arm))
    words_given = str(requested).split(",") if isinstance(requested, (str, Path, int)) else requested
    names = tool.names if requested == "thesis" else tuple(dict.fromkeys(name.strip() for name in words_given))
    if len(names) == 1 and names[0].isdigit() and 1 <= int(names[0]) <= len(tool.names):
        names = tool.names[: int(names[0])]
    unknown = [name for name in names if name not in tool.names]
    if unknown:
        raise MeasurementError(
            f"unknown target {unknown[0]!r}: expected a file, a number from 1 to {len(tool.names)} or names of "
            f"{', '.join(tool.names)}",
            parameter="targets",
        )
    tool = tool.only(names)
    return Targets(tool.names, tool.cad, tool.direction)


def read_targets(path: str | Path) -> Targets:
    """Read a file of reflectors.

    Columns ``target``, ``x_mm``, ``y_mm``, ``z_mm`` (in the tip link) and optionally ``nx``, ``ny``, ``nz``: where they
    look.

    Raises
    ------
    MeasurementError
        If the file cannot be read or does not keep the format.
    """
    points, rows = read_positions(path), InputTable.read(path)
    if not all_or_none(rows.names, DIRECTIONS, rows.source, f"a direction needs {', '.join(DIRECTIONS)}"):
        return Targets(tuple(points), np.array(list(points.values())))
    looks = np.column_stack([rows.numbers(name, expected="a part of a direction") for name in DIRECTIONS])
    short = np.flatnonzero(np.linalg.norm(looks, axis=1) < 1e-6)
    if len(short):
        raise rows.fault("expected a direction, found zero length", int(short[0]), DIRECTIONS)
    return Targets(tuple(points), np.array(list(points.values())), looks)


CONDITIONS = {
    "limits": "joint limits with margin",
    "height": "height above the obstacles",
    "acceptance": "a reflector turned to the tracker",
    "collision": "no self-collision",
    "sight": "a line of sight that the arm leaves free",
    "path": "a straight path in the joints from home without self-collision",
}
"""Names of the conditions in the order in which they are checked."""

SOLID = {"collision", "sight", "path"}
"""Conditions that need the robot's collision geometry."""

_NEEDS_SOLIDS = "the conditions collision, sight and path need the robot's collision geometry"

WAY_STEP = 2.5
"""Steps on the way from home against those of moves between poses (`irbcal.planning.route.STEP`)."""


class Solids(Protocol):
    """What a robot's solids tell, such as `irbcal.planning.collisions.CollisionModel`."""

    def touching(self, theta: FloatArray) -> BoolArray:
        """Whether the robot touches itself at effective joints (n, joints), shape (n,)."""

    def blocked(
        self, theta: FloatArray, points: FloatArray, tracker: FloatArray, needed: BoolArray | None = None
    ) -> BoolArray:
        """Whether solids stand between the tracker and points (n, k, 3) in the base link, shape (n, k)."""


@dataclass(frozen=True, eq=False)
class Setting:
    """Robot, reflectors, tracker and what poses must keep to."""

    robot: Robot
    """Predicts where the tip is."""
    targets: Targets
    tracker_position: FloatArray
    """Shape (3,). The tracker in the base link, metres."""
    conditions: tuple[str, ...] = tuple(CONDITIONS)
    """Those that hold, of `CONDITIONS`."""
    margin: float = 2 * DEG
    """From the joint limits, radians; prismatic joints keep `METRES_PER_DEGREE` for each degree."""
    acceptance: float = ACCEPTANCE
    """Largest angle between a reflector's direction and the beam, radians."""
    heights: tuple[float, float] | None = None
    """Lowest z of tip and reflectors in the base link, in front (x from `FRONT` on) and at the back, metres."""
    solids: Solids | None = None
    """Needed for the conditions in `SOLID`."""

    def __post_init__(self) -> None:
        unknown = [name for name in self.conditions if name not in CONDITIONS]
        if unknown:
            raise MeasurementError(
                f"unknown condition {unknown[0]!r}: conditions are {', '.join(CONDITIONS)}", parameter="conditions"
            )
        on = [name for name in CONDITIONS if name in self.conditions]
        if self.targets.directions is None and "acceptance" in on:
            on.remove("acceptance")
        if self.heights is None and "height" in on:
            on.remove("height")
        if self.solids is None and SOLID & set(on):
            raise MeasurementError(_NEEDS_SOLIDS)
        object.__setattr__(self, "conditions", tuple(on))
        lock(self)

    @property
    def arm(self) -> Arm:
        """The robot's arm; its limits hold for commanded joints."""
        return self.robot.arm

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Joint limits with the margin, two arrays (joints,)."""
        margin = self.margin * np.where(self.arm.table.prismatic, METRES_PER_DEGREE / DEG, 1.0)
        return self.arm.lower + margin, self.arm.upper - margin

    def tip_and_reflectors(self, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray | None]:
        """Tip (n, 3) and reflectors (n, k, 3) in the base link, and where these look (None if not known), metres."""
        T = self.robot.poses(q)
        turn = np.swapaxes(T[:, :3, :3], 1, 2)
        points = self.targets.positions @ turn + T[:, None, :3, 3]
        looks = None if self.targets.directions is None else self.targets.directions @ turn
        return T[:, :3, 3], points, looks

    def high(self, tip: FloatArray, points: FloatArray) -> BoolArray:
        """Whether tip (n, 3) and reflectors (n, k, 3) are above the height limits, shape (n,); True without limits."""
        if self.heights is None:
            return np.ones(len(tip), dtype=bool)
        p = np.concatenate([tip[:, None], points], axis=1)
        return np.all(p[..., 2] >= np.where(p[..., 0] >= FRONT, *self.heights), axis=1)

    def effective(self, q: FloatArray) -> FloatArray:
        """Effective joints, where the robot's links really stand."""
        return self.robot.joint_map.effective(q)

    def touching(self, q: FloatArray) -> BoolArray:
        """Whether the robot touches itself at commanded joints, shape (n,)."""
        return self._solid().touching(self.effective(q))

    def blocked(self, q: FloatArray, points: FloatArray, needed: BoolArray) -> BoolArray:
        """Whether the robot stands between the tracker and its reflectors, shape (n, k)."""
        return self._solid().blocked(self.effective(q), points, self.tracker_position, needed)

    def _solid(self) -> Solids:
        if self.solids is None:
            raise MeasurementError(_NEEDS_SOLIDS)
        return self.solids


def check(setting: Setting, q: FloatArray, conditions: Collection[str] | None = None) -> tuple[BoolArray, BoolArray]:
    """Which poses meet the conditions.

    Parameters
    ----------
    setting : Setting
    q : ndarray, shape (n, joints)
    conditions : sequence of str, optional
        Of the setting's, those that hold here; all unless given.

    Returns
    -------
    keep : ndarray of bool, shape (n,)
    seen : ndarray of bool, shape (n, k)
        Reflectors that the tracker sees; none where the pose is not kept.
    """
    keep, visible, _ = counted(setting, q, conditions)
    return keep, visible


def counted(
    setting: Setting, q: FloatArray, conditions: Collection[str] | None = None
) -> tuple[BoolArray, BoolArray, dict[str, int]]:
    """As `check`; and how many poses each condition removed, of those that the ones before it had left."""
    on = [name for name in setting.conditions if conditions is None or name in conditions]
    keep = np.ones(len(q), dtype=bool)
    tip, points, looks = setting.tip_and_reflectors(q)
    visible = np.ones(points.shape[:2], dtype=bool)
    removed: dict[str, int] = {}

    def drop(name: str, good: BoolArray) -> None:
        removed[name] = int((keep & ~good).sum())
        keep[:] &= good

    if "limits" in on:
        lower, upper = setting.bounds
        drop("limits", np.all((q >= lower) & (q <= upper), axis=1))
    if "height" in on:
        drop("height", setting.high(tip, points))
    if "acceptance" in on and looks is not None:
        visible &= ~turned_away(points, looks, setting.tracker_position, setting.acceptance)
        drop("acceptance", np.any(visible, axis=1))
    if "collision" in on:
        good, rows = np.ones(len(q), dtype=bool), np.flatnonzero(keep)
        good[rows] = ~setting.touching(q[rows])
        drop("collision", good)
    if "sight" in on:
        rows = np.flatnonzero(keep)
        visible[rows] &= ~setting.blocked(q[rows], points[rows], visible[rows])
        drop("sight", ~keep | np.any(visible, axis=1))
    if "path" in on:
        good, rows = np.ones(len(q), dtype=bool), np.flatnonzero(keep)
        home = np.broadcast_to(home_joints(setting.arm), (len(rows), q.shape[1]))
        good[rows] = ~touching_on(setting, *route.between(home, q[rows], setting.arm.table.prismatic, WAY_STEP))
        drop("path", good)
    visible[~keep] = False
    return keep, visible, removed


def touching_on(setting: Setting, q: FloatArray, starts: IntArray) -> BoolArray:
    """Moves on which the robot touches itself, (m,), for joints along them that begin at the rows ``starts``."""
    if not len(q):
        return np.zeros(0, dtype=bool)
    return np.logical_or.reduceat(setting.touching(q), starts)
