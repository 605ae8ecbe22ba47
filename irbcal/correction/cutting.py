"""Straight and circular moves of a program cut so that the true tool keeps to the wanted path (Nubiola 2011, annex VI).

The ends of a move are fake targets already; between them the controller moves its tool along its own line, and the true
tool leaves the wanted one, because the error changes on the way. Points are put in between until it does not leave it
by more than a tolerance. Near its ends a move that flies by is the controller's own curve: no point is put there.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np

from irbcal.arrays import FloatArray, lock
from irbcal.correction.fake_targets import correct_meant
from irbcal.correction.joints_along import Reversal, joints_along, reversals
from irbcal.correction.path import Circle, Line, ToolPath, distance_to_path
from irbcal.correction.program import Program
from irbcal.errors import RobotError
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
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
class PathMove:
    """A straight or circular move of a program.

    Attributes
    ----------
    line : int
    name : str
        Instruction and target.
    start, via, to : int or None
        Numbers of the targets; ``via`` of circular moves only, ``start`` None where the program does not tell.
    T_tip_tcp : ndarray, shape (4, 4)
        The tool of the move.
    zones : tuple of float
        How far from its ends the controller may leave the path, metres.
    why : str
        Why no points can be put into it; empty where they can.
    """

    line: int
    name: str
    start: int | None
    via: int | None
    to: int | None
    T_tip_tcp: FloatArray
    zones: tuple[float, float] = (0.0, 0.0)
    why: str = ""

    def __post_init__(self) -> None:
        lock(self)


class Ends(NamedTuple):
    """What is known of a corrected target: wanted tip pose, joints to command, and the fake tip pose."""

    T_wanted: FloatArray
    q_wanted: FloatArray
    q: FloatArray
    T_fake: FloatArray


@dataclass(frozen=True, eq=False)
class CutPath:
    """A move with the points that were put into it.

    Attributes
    ----------
    move : PathMove
    length : float
        Of the wanted path, metres; NaN where it is not known.
    T_fake : ndarray, shape (n, 4, 4)
        Fake tip poses to put in: ends of pieces; of circular moves, in turn, the point on the arc and its end, and last
        the point on the last arc.
    q : ndarray, shape (n, 6)
        Joints there, radians.
    deviation, uncut : float
        Largest distance of the true tool centre point from the wanted path with these points and without, metres.
    turns : tuple of Reversal
        Where joints turn back.
    why : str
        Why the tolerance is not kept; empty where it is.
    """

    move: PathMove
    length: float = np.nan
    T_fake: FloatArray = field(default_factory=lambda: np.zeros((0, 4, 4)))
    q: FloatArray = field(default_factory=lambda: np.zeros((0, 6)))
    deviation: float = np.nan
    uncut: float = np.nan
    turns: tuple[Reversal, ...] = ()
    why: str = ""

    def __post_init__(self) -> None:
        lock(self)

    @property
    def pieces(self) -> int:
        """Number of moves that it becomes."""
        return 1 + (len(self.q) // 2 if self.move.via is not None else len(self.q))


@runtime_checkable
class Cuttable(Program, Protocol):
    """A program into whose moves points can be put."""

    def path_moves(self) -> Sequence[PathMove]:
        """Its straight and circular moves in the order of the text."""
        ...

    def with_cuts(self, cuts: Sequence[CutPath]) -> Program:
        """The program that writes points into its moves; one for each of `path_moves`."""
        ...


class _Path:
    """A wanted path, and how the true tool keeps to it."""

    def __init__(
        self,
        move: PathMove,
        path: ToolPath,
        ends: Mapping[int, Ends],
        robot: Robot,
        nominal: Arm,
        controller: Arm | None,
    ) -> None:
        assert move.start is not None
        assert move.to is not None
        self.move, self.path, self.robot, self.nominal, self.controller = move, path, robot, nominal, controller
        self.start, self.end = ends[move.start], ends[move.to]
        self.via = None if move.via is None else ends[move.via]
        self.T_tcp_tip = frames.inverse(move.T_tip_tcp)

    def points(self, pieces: int) -> FloatArray:
        """Places (fractions) of the ends of pieces inside the path, none where the controller flies by."""
        s = np.arange(1, pieces) / pieces
        first, last = (2 * zone / self.path.length for zone in self.move.zones)
        return s[(s >= first) & (s <= 1 - last)]

    def corrected(self, s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Fake tip poses and joints at places (n,) on the path."""
        T = self.path.poses(s) @ self.T_tcp_tip
        q = joints_along(T, self.nominal, self.start.q_wanted, self.controller)
        beyond = np.argwhere((q < self.nominal.lower) | (q > self.nominal.upper))
        if len(beyond):
            raise RobotError(f"it goes beyond the limits of joint {beyond[0, 1] + 1}, {s[beyond[0, 0]]:.0%} of the way")
        fake = correct_meant(self.robot, self.nominal, T, q, self.controller)
        if not fake.ok.all():
            k = int(np.flatnonzero(~fake.ok)[0])
            raise RobotError(f"a point {s[k]:.0%} of the way cannot be corrected: {fake.reason[k]}")
        return np.asarray(fake.T_fake), np.asarray(fake.q)

    def cut(self, pieces: int) -> tuple[FloatArray, FloatArray, float]:
        """Fake tip poses and joints of all points to put in, and how far the true tool leaves the path then."""
        inner = self.points(pieces)
        ends = np.concatenate([[0.0], inner, [1.0]])
        arc = isinstance(self.path, Circle)
        whole = arc and not len(inner)
        s = inner if not arc else np.insert(0.5 * (ends[1:] + ends[:-1]), np.arange(1, len(ends) - 1), inner)
        T, q = (np.zeros((0, 4, 4)), np.zeros((0, 6))) if whole or not len(s) else self.corrected(s)
        tcp = [pose @ self.move.T_tip_tcp for pose in (self.start.T_fake, *T, self.end.T_fake)]
        moves: list[ToolPath] = []
        if whole:
            assert self.via is not None
            moves.append(Circle.through(tcp[0], (self.via.T_fake @ self.move.T_tip_tcp)[:3, 3], tcp[1]))
        elif arc:
            moves = [Circle.through(tcp[k], tcp[k + 1][:3, 3], tcp[k + 2]) for k in range(0, len(tcp) - 2, 2)]
        else:
            moves = [Line(a, b) for a, b in pairwise(tcp)]
        return T, q, self.deviation(moves)

    def deviation(self, moves: Sequence[ToolPath]) -> float:
        """Largest distance of the true tool from the path, places where the controller flies by aside."""
        inside = np.linspace(0.0, 1.0, INSIDE + 1)
        taken = np.concatenate([move.poses(inside) for move in moves])
        q = joints_along(taken @ self.T_tcp_tip, self.nominal, self.start.q, self.controller)
        reached = (self.robot.forward(q) @ self.move.T_tip_tcp)[:, :3, 3]
        off = distance_to_path(self.path, reached)
        lengths = np.array([move.length for move in moves])
        begins = np.cumsum(lengths) - lengths
        along = (begins[:, None] + inside * lengths[:, None]).ravel()
        counts = (along >= self.move.zones[0]) & (along <= lengths.sum() - self.move.zones[1])
        return float(off[counts].max(initial=0.0))

    def turns(self) -> tuple[tuple[Reversal, ...], str]:
        """Where joints turn back, and whether the path ends with other joints than those of its end."""
        s = np.linspace(0.0, 1.0, 201)
        q = joints_along(self.path.poses(s) @ self.T_tcp_tip, self.nominal, self.start.q_wanted, self.controller)
        off = np.abs(q[-1] - self.end.q_wanted)
        joint = int(np.argmax(off))
        why = ""
        if off[joint] > SAME_JOINTS:
            why = f"its end has a configuration that the path does not lead to (joint {joint + 1})"
        return tuple(reversals(q, s)), why


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
        what = "where it starts" if move.start is None else "where it ends"
        return CutPath(move, why=f"the program does not tell {what}")
    if not {move.start, move.to, *([] if move.via is None else [move.via])} <= set(ends):
        return CutPath(move, why="not all of its points are corrected")
    try:
        wanted = [ends[k].T_wanted @ move.T_tip_tcp for k in (move.start, move.to)]
        path: ToolPath = Line(*wanted)
        if move.via is not None:
            path = Circle.through(wanted[0], (ends[move.via].T_wanted @ move.T_tip_tcp)[:3, 3], wanted[1])
        if path.length < NO_LENGTH:
            return CutPath(move, path.length, deviation=0.0, uncut=0.0)
        return _fewest(_Path(move, path, ends, robot, nominal, controller), tolerance)
    except RobotError as error:
        return CutPath(move, why=str(error))


def _fewest(path: _Path, tolerance: float) -> CutPath:
    """The fewest pieces that keep the tolerance: doubled until some do, then halved in between."""
    length, move = path.path.length, path.move
    most = int(length / SHORTEST)
    if isinstance(path.path, Circle):
        if abs(path.path.angle) > LARGEST_ARC:
            return CutPath(move, length, why="it turns by more than 240 degrees")
        most = min(most, int(abs(path.path.angle) / SMALLEST_ARC))
    turns, elsewhere = path.turns()
    T, q, uncut = path.cut(1)
    if uncut <= tolerance:
        return CutPath(move, length, T, q, uncut, uncut, turns)
    if move.why or elsewhere:
        why = f"it leaves the path by {uncut / MM:.3f} mm, and {move.why or elsewhere}"
        return CutPath(move, length, deviation=uncut, uncut=uncut, turns=turns, why=why)
    fails, pieces = 1, 2
    while pieces <= most and path.cut(pieces)[2] > tolerance:
        fails, pieces = pieces, 2 * pieces
    if pieces > most:
        _, _, deviation = path.cut(max(most, 1))
        near = " outside the zones of its ends" if max(move.zones) > 0 else ""
        why = f"pieces of {SHORTEST / MM:g} mm still leave the path by {deviation / MM:.3f} mm{near}"
        return CutPath(move, length, deviation=uncut, uncut=uncut, turns=turns, why=why)
    while pieces - fails > 1:
        middle = (pieces + fails) // 2
        fails, pieces = (fails, middle) if path.cut(middle)[2] <= tolerance else (middle, pieces)
    T, q, deviation = path.cut(pieces)
    return CutPath(move, length, T, q, deviation, uncut, turns)
