"""Straight and circular paths of the tool: joints along them, and points put in so that the true tool keeps to them.

The ends of a move are fake targets; between them a controller with the nominal model moves its tool along its own line,
and the true tool leaves the wanted one, because the error changes on the way (Nubiola 2011, annex VI). Points are put
in between until it does not leave it by more than a tolerance. Near its ends a move that flies by is the controller's
own curve: no point is put there.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Literal, NamedTuple, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, Locked
from irbcal.correction.fake_targets import FakeTargets, correct_meant
from irbcal.correction.program import Program
from irbcal.errors import RobotError
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.inverse import closed_form, nearly_closed_form
from irbcal.modeling.robot import Robot
from irbcal.units import DEG, MM

SHORTEST = 2 * MM
"""Length of a piece; controllers cannot follow much shorter ones evenly."""

SMALLEST_ARC = 2 * DEG
LARGEST_ARC = 240 * DEG
"""Of one circular move, radians."""

SAME_JOINTS = 1e-3
"""Radians within which joints at the end of a path are those of its target."""

NO_LENGTH = 1e-6
"""Length below which a move is none, metres."""

INSIDE = 16
"""Places between the ends of a piece at which the true tool is looked at."""


@dataclass(frozen=True, eq=False)
class StraightMove(Locked):
    """Straight move between two poses; orientation turns evenly about one axis."""

    T_start: FloatArray
    T_end: FloatArray
    """Shape (4, 4). Poses in the base link, metres."""

    @property
    def length(self) -> float:
        """Length of the path of the origin, metres."""
        return float(np.linalg.norm(self.T_end[:3, 3] - self.T_start[:3, 3]))

    def poses(self, s: ArrayLike) -> FloatArray:
        """Poses at fractions ``s`` (n,) of the way, shape (n, 4, 4)."""
        fraction = np.asarray(s, dtype=float)
        T = _turned(self.T_start, self.T_end, fraction)
        T[:, :3, 3] = self.T_start[:3, 3] + fraction[:, None] * (self.T_end[:3, 3] - self.T_start[:3, 3])
        return T


@dataclass(frozen=True, eq=False)
class Circle(Locked):
    """Move along a circular arc; orientation turns evenly about one axis."""

    T_start: FloatArray
    T_end: FloatArray
    """Shape (4, 4). Poses in the base link, metres."""
    center: FloatArray
    normal: FloatArray
    """Shape (3,). Of the circle, in the base link; the move turns by ``angle`` about the normal."""
    angle: float
    """Radians."""

    @staticmethod
    def through(T_start: FloatArray, p_via: ArrayLike, T_end: FloatArray) -> Circle:
        """Arc from one pose to another through a point, as MoveC defines it.

        Raises
        ------
        RobotError
            If the three points lie on a line.
        """
        p_1, p_2, p_3 = T_start[:3, 3], np.asarray(p_via, dtype=float), T_end[:3, 3]
        a, b = p_2 - p_1, p_3 - p_1
        normal = np.cross(a, b)
        if np.linalg.norm(normal) <= 1e-9 * np.linalg.norm(a) * max(float(np.linalg.norm(b)), 1e-12):
            raise RobotError("a circular move needs three points that do not lie on a line")
        center = p_1 + np.cross(b @ b * a - a @ a * b, normal) * -1.0 / (2 * normal @ normal)
        normal = normal / np.linalg.norm(normal)
        u, v = p_1 - center, p_3 - center
        angle = np.arctan2(normal @ np.cross(u, v), u @ v) % (2 * np.pi)
        return Circle(T_start, T_end, center, normal, float(angle))

    @staticmethod
    def full(T_start: FloatArray, center: ArrayLike, normal: ArrayLike) -> Circle:
        """A whole turn from a pose about a centre, with constant orientation.

        Such are the circles of Nubiola 2011, annex VI, Figures A VI-3, A VI-6 and A VI-9.
        """
        axis = np.asarray(normal, dtype=float)
        return Circle(T_start, T_start, np.asarray(center, dtype=float), axis / np.linalg.norm(axis), 2 * np.pi)

    @property
    def length(self) -> float:
        """Length of the arc, metres."""
        return float(abs(self.angle) * np.linalg.norm(self.T_start[:3, 3] - self.center))

    def poses(self, s: ArrayLike) -> FloatArray:
        """Poses at fractions ``s`` (n,) of the way, shape (n, 4, 4)."""
        fraction = np.asarray(s, dtype=float)
        T = _turned(self.T_start, self.T_end, fraction)
        u = self.T_start[:3, 3] - self.center
        v = np.cross(self.normal, u)
        angle = fraction[:, None] * self.angle
        T[:, :3, 3] = self.center + np.cos(angle) * u + np.sin(angle) * v
        return T


def _turned(T_start: FloatArray, T_end: FloatArray, s: FloatArray) -> FloatArray:
    from scipy.spatial.transform import Rotation

    vector = Rotation.from_matrix(T_start[:3, :3].T @ T_end[:3, :3]).as_rotvec()
    T = np.zeros((len(s), 4, 4))
    T[:, 3, 3] = 1.0
    T[:, :3, :3] = T_start[:3, :3] @ Rotation.from_rotvec(s[:, None] * vector).as_matrix()
    return T


ToolPath: TypeAlias = StraightMove | Circle
"""What a linear or circular move asks for."""


def distance_to_path(path: ToolPath, points: ArrayLike) -> FloatArray:
    """Distance of points from a path, metres, shape (n,).

    Straight lines are exact; circles are taken as they are, arcs at their ends included.
    """
    at = np.atleast_2d(np.asarray(points, dtype=float))
    if isinstance(path, StraightMove):
        p, along = path.T_start[:3, 3], path.T_end[:3, 3] - path.T_start[:3, 3]
        t = np.clip((at - p) @ along / max(float(along @ along), 1e-300), 0.0, 1.0)
        return np.linalg.norm(at - p - t[:, None] * along, axis=1)
    u = path.T_start[:3, 3] - path.center
    v = np.cross(path.normal, u)
    radius = np.linalg.norm(u)
    rel = at - path.center
    turned = np.arctan2(rel @ v, rel @ u) % (2 * np.pi)
    in_plane = np.hypot(rel @ u, rel @ v) / radius
    on_arc = np.hypot(in_plane - radius, rel @ path.normal)
    ends = np.minimum(np.linalg.norm(at - path.T_start[:3, 3], axis=1), np.linalg.norm(at - path.T_end[:3, 3], axis=1))
    return np.where(turned <= path.angle, on_arc, ends)


def joint_history(
    path: ToolPath, nominal: Arm, seed: ArrayLike, s: ArrayLike, T_tip_tcp: FloatArray | None = None
) -> FloatArray:
    """Joints of the nominal robot along a path, in the branch of the seed and without jumps by whole turns.

    These are the joint histories of Nubiola 2011, Figures A VI-2, A VI-5 and A VI-8.

    Parameters
    ----------
    path : StraightMove or Circle
        Of the tool centre point, in the base link.
    nominal : Arm
    seed : ndarray, shape (6,)
        Joints at (or near) the start, radians.
    s : ndarray, shape (n,)
        Places on the path.
    T_tip_tcp : ndarray, shape (4, 4), optional
        The tool; identity unless given.

    Returns
    -------
    ndarray, shape (n, 6)
        Radians.

    Raises
    ------
    RobotError
        If the robot does not reach every place in that branch.
    """
    return joints_along(path.poses(s) @ tip_of(T_tip_tcp), nominal, seed)


def tip_of(T_tip_tcp: FloatArray | None) -> FloatArray:
    """The tip in the tool centre point, ``T_tcp_tip``; identity for no tool."""
    return np.eye(4) if T_tip_tcp is None else frames.inverse(T_tip_tcp)


def joints_along(
    T_base_tip: FloatArray, nominal: Arm, seed: ArrayLike, controller_arm: Arm | None = None
) -> FloatArray:
    """Joints of the nominal robot, or of another one that is near it, for a row of tip poses; see `joint_history`."""
    branch = closed_form.configuration(nominal, np.asarray(seed, dtype=float))
    branches = nearly_closed_form.branches(nominal, T_base_tip, controller_arm)
    q = branches.joints[:, int(branch)]
    if not np.isfinite(q).all():
        index = int(np.flatnonzero(~np.isfinite(q).all(axis=1))[0])
        raise RobotError(f"the robot does not reach point {index + 1} of {len(q)} of the path in its configuration")
    return np.unwrap(np.vstack([np.asarray(seed, dtype=float), q]), axis=0)[1:]


@dataclass(frozen=True)
class Reversal:
    """A joint that turns back on a path: where backlash is to be expected."""

    s: float
    """Place on the path, fraction of the way."""
    joint: int
    """Counted from 1."""
    angle: float
    """Of the joint there, radians."""
    kind: Literal["min", "max"]
    """``min`` or ``max``."""

    @property
    def path_angle(self) -> float:
        """Place on a circular path, radians."""
        return 2 * np.pi * self.s


def reversals(q: FloatArray, s: FloatArray, smallest: float = 1e-4) -> list[Reversal]:
    """Local minima and maxima of each joint along a path (Nubiola 2011, Tables A VI-1, A VI-2 and A VI-3).

    Places are refined by the parabola through three neighbouring samples.

    Parameters
    ----------
    q : ndarray, shape (n, 6)
        Joint history, radians, without jumps by whole turns.
    s : ndarray, shape (n,)
        Evenly spaced places on the path.
    smallest : float
        Ignore joints that move by less than this over the whole path, radians.

    Returns
    -------
    list of Reversal
        In the order of the path.
    """
    turning_points = []
    step = s[1] - s[0]
    for j in range(q.shape[1]):
        if np.ptp(q[:, j]) < smallest:
            continue
        change = np.diff(q[:, j])
        moving = np.flatnonzero(change)  # an extremum between two places may leave both the same
        for k in moving[1:][np.diff(np.sign(change[moving])) != 0]:
            a, b, c = q[k - 1 : k + 2, j]
            offset = 0.5 * (a - c) / (a - 2 * b + c)
            kind: Literal["min", "max"] = "max" if b > c else "min"
            turning_points.append(
                Reversal(float(s[k] + offset * step), j + 1, float(b - 0.25 * (a - c) * offset), kind)
            )
    return sorted(turning_points, key=lambda turning_point: (turning_point.s, turning_point.joint))


@dataclass(frozen=True, eq=False)
class PathMove(Locked):
    """A straight or circular move of a program."""

    line: int
    name: str
    """Instruction and target."""
    start: int | None
    via: int | None
    to: int | None
    """Numbers of the targets; ``via`` of circular moves only, ``start`` None where the program does not tell."""
    T_tip_tcp: FloatArray
    """Shape (4, 4). The tool of the move."""
    zones: tuple[float, float] = (0.0, 0.0)
    """How far from its ends the controller may leave the path, metres."""
    reason: str = ""
    """Why no points can be put into it; empty where they can."""


class Ends(NamedTuple):
    """What is known of a corrected target: wanted tip pose, joints to command, and the fake tip pose."""

    T_wanted: FloatArray
    q_wanted: FloatArray
    q: FloatArray
    T_fake: FloatArray


@dataclass(frozen=True, eq=False)
class CutPath(Locked):
    """A move with the points that were put into it."""

    move: PathMove
    length: float = np.nan
    """Of the wanted path, metres; NaN where it is not known."""
    T_fake: FloatArray = field(default_factory=lambda: np.zeros((0, 4, 4)))
    """Shape (n, 4, 4). Fake tip poses to put in: ends of pieces; of circular moves, in turn, the point on the arc and
    its end, and last the point on the last arc.
    """
    q: FloatArray = field(default_factory=lambda: np.zeros((0, 6)))
    """Shape (n, 6). Joints there, radians."""
    deviation: float = np.nan
    uncut: float = np.nan
    """Largest distance of the true tool centre point from the wanted path with these points and without, metres."""
    turns: tuple[Reversal, ...] = ()
    """Where joints turn back."""
    reason: str = ""
    """Why the tolerance is not kept; empty where it is."""

    @property
    def pieces(self) -> int:
        """Number of moves that it becomes."""
        return 1 + (len(self.q) // 2 if self.move.via is not None else len(self.q))


@runtime_checkable
class Cuttable(Protocol):
    """A program into whose moves points can be put."""

    def path_moves(self) -> Sequence[PathMove]:
        """Its straight and circular moves in the order of the text."""
        ...

    def with_cuts(self, cuts: Sequence[CutPath]) -> Program:
        """The program that writes points into its moves; one for each of `path_moves`."""
        ...


class _Cutter:
    """A wanted path of a tool, and how the true tool keeps to it where fake targets on it are the ends of moves."""

    def __init__(
        self,
        path: ToolPath,
        T_tip_tcp: FloatArray,
        robot: Robot,
        nominal: Arm,
        seed: FloatArray,
        controller: Arm | None = None,
        zones: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        self.path, self.T_tip_tcp, self.robot, self.nominal = path, T_tip_tcp, robot, nominal
        self.seed, self.controller, self.zones = seed, controller, zones
        self.T_tcp_tip = frames.inverse(T_tip_tcp)

    def between(self, pieces: int) -> FloatArray:
        """Places (fractions) of targets between the ends, none where the controller flies by; of arcs middles, too."""
        s = np.arange(1, pieces) / pieces
        first, last = (2 * zone / self.path.length for zone in self.zones)
        s = s[(s >= first) & (s <= 1 - last)]
        if not isinstance(self.path, Circle):
            return s
        ends = np.concatenate([[0.0], s, [1.0]])
        return np.insert(0.5 * (ends[1:] + ends[:-1]), np.arange(1, len(ends) - 1), s)

    def corrected(self, s: FloatArray) -> FakeTargets:
        """Fake targets at places (n,) on the path."""
        T = self.path.poses(s) @ self.T_tcp_tip
        q = joints_along(T, self.nominal, self.seed, self.controller)
        beyond = np.argwhere((q < self.nominal.lower) | (q > self.nominal.upper))
        if len(beyond):
            raise RobotError(f"it goes beyond the limits of joint {beyond[0, 1] + 1}, {s[beyond[0, 0]]:.0%} of the way")
        fake = correct_meant(self.robot, self.nominal, T, q, self.controller)
        if not fake.ok.all():
            k = int(np.flatnonzero(~fake.ok)[0])
            raise RobotError(f"a point {s[k]:.0%} of the way cannot be corrected: {fake.reason[k]}")
        return fake

    def deviation(self, T_fake: Sequence[FloatArray], q_start: FloatArray) -> float:
        """Largest distance of the true tool from the path between fake tip poses, places where it flies by aside."""
        tcp = [T @ self.T_tip_tcp for T in T_fake]
        if isinstance(self.path, Circle):
            triples = zip(tcp[:-2:2], tcp[1:-1:2], tcp[2::2], strict=True)
            moves: list[ToolPath] = [Circle.through(start, via[:3, 3], end) for start, via, end in triples]
        else:
            moves = [StraightMove(start, end) for start, end in pairwise(tcp)]
        inside = np.linspace(0.0, 1.0, INSIDE + 1)
        T_inside = np.concatenate([move.poses(inside) for move in moves])
        q = joints_along(T_inside @ self.T_tcp_tip, self.nominal, q_start, self.controller)
        reached = (self.robot.forward(q) @ self.T_tip_tcp)[:, :3, 3]
        off = distance_to_path(self.path, reached)
        lengths = np.array([move.length for move in moves])
        begins = np.cumsum(lengths) - lengths
        along = (begins[:, None] + inside * lengths[:, None]).ravel()
        counts = (along >= self.zones[0]) & (along <= lengths.sum() - self.zones[1])
        return float(off[counts].max(initial=0.0))


def _fewest(keeps: Callable[[int], bool], first: int, limit: int) -> int | None:
    """The fewest pieces that keep a tolerance: doubled until some do, then halved in between; None beyond ``limit``."""
    fails, pieces = first - 1, first
    while pieces <= limit and not keeps(pieces):
        fails, pieces = pieces, 2 * pieces
    if pieces > limit:
        return None
    while pieces - fails > 1:
        middle = (pieces + fails) // 2
        fails, pieces = (fails, middle) if keeps(middle) else (middle, pieces)
    return pieces


def cut_move(
    move: PathMove,
    ends: Mapping[int, Ends],
    robot: Robot,
    nominal: Arm,
    tolerance: float,
    controller: Arm | None = None,
) -> CutPath:
    """Put points into a move so that the true tool keeps to the wanted path.

    Parameters
    ----------
    move : PathMove
    ends : dict of int to Ends
        The corrected targets of the program, by their numbers.
    robot : Robot
        Calibrated.
    nominal : Arm
        With a closed-form inverse.
    tolerance : float
        Largest distance of the tool centre point from the path, metres.
    controller : Arm, optional
        What the controller computes with where that is not the nominal arm.

    Returns
    -------
    CutPath
        Without points, and with the reason, where the tolerance is not or perhaps not kept.
    """
    if move.start is None or move.to is None:
        end_words = "where it starts" if move.start is None else "where it ends"
        return CutPath(move, reason=f"the program does not tell {end_words}")
    if not {move.start, move.to, *([] if move.via is None else [move.via])} <= set(ends):
        return CutPath(move, reason="not all of its points are corrected")
    try:
        T_tcp = [ends[k].T_wanted @ move.T_tip_tcp for k in (move.start, move.to)]
        path: ToolPath = StraightMove(*T_tcp)
        if move.via is not None:
            path = Circle.through(T_tcp[0], (ends[move.via].T_wanted @ move.T_tip_tcp)[:3, 3], T_tcp[1])
        if path.length < NO_LENGTH:
            return CutPath(move, path.length, deviation=0.0, uncut=0.0)
        return _cut(move, path, ends, robot, nominal, tolerance, controller)
    except RobotError as error:
        return CutPath(move, reason=str(error))


def _cut(
    move: PathMove,
    path: ToolPath,
    ends: Mapping[int, Ends],
    robot: Robot,
    nominal: Arm,
    tolerance: float,
    controller: Arm | None,
) -> CutPath:
    assert move.start is not None
    assert move.to is not None
    start, end, length = ends[move.start], ends[move.to], path.length
    cutter = _Cutter(path, move.T_tip_tcp, robot, nominal, start.q_wanted, controller, move.zones)

    def cut(pieces: int) -> tuple[FloatArray, FloatArray, float]:
        """Fake tip poses and joints of all points to put in, and how far the true tool leaves the path then."""
        s = cutter.between(pieces)
        if move.via is not None and len(s) == 1:  # a whole arc keeps its own point
            T, q, inner = np.zeros((0, 4, 4)), np.zeros((0, 6)), [ends[move.via].T_fake]
        elif len(s):
            fake = cutter.corrected(s)
            T, q, inner = np.asarray(fake.T_fake), np.asarray(fake.q), [*fake.T_fake]
        else:
            T, q, inner = np.zeros((0, 4, 4)), np.zeros((0, 6)), []
        return T, q, cutter.deviation([start.T_fake, *inner, end.T_fake], start.q)

    most_pieces = int(length / SHORTEST)
    if isinstance(path, Circle):
        if abs(path.angle) > LARGEST_ARC:
            return CutPath(move, length, reason="it turns by more than 240 degrees")
        most_pieces = min(most_pieces, int(abs(path.angle) / SMALLEST_ARC))
    s = np.linspace(0.0, 1.0, 201)
    along = joints_along(path.poses(s) @ cutter.T_tcp_tip, nominal, start.q_wanted, controller)
    turns, off = tuple(reversals(along, s)), np.abs(along[-1] - end.q_wanted)
    elsewhere = ""
    if off.max() > SAME_JOINTS:
        elsewhere = f"its end has a configuration that the path does not lead to (joint {int(np.argmax(off)) + 1})"
    T, q, uncut = cut(1)
    if uncut <= tolerance:
        return CutPath(move, length, T, q, uncut, uncut, turns)
    if move.reason or elsewhere:
        reason = f"it leaves the path by {uncut / MM:.3f} mm, and {move.reason or elsewhere}"
        return CutPath(move, length, deviation=uncut, uncut=uncut, turns=turns, reason=reason)
    pieces = _fewest(lambda pieces: cut(pieces)[2] <= tolerance, 2, most_pieces)
    if pieces is None:
        near = " outside the zones of its ends" if max(move.zones) > 0 else ""
        deviation = cut(max(most_pieces, 1))[2]
        reason = f"pieces of {SHORTEST / MM:g} mm still leave the path by {deviation / MM:.3f} mm{near}"
        return CutPath(move, length, deviation=uncut, uncut=uncut, turns=turns, reason=reason)
    T, q, deviation = cut(pieces)
    return CutPath(move, length, T, q, deviation, uncut, turns)
