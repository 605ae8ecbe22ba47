"""Paths cut into moves, so that the true tool keeps to the wanted path (Nubiola 2011, annex VI).

A controller with the nominal model moves its tool along the nominal line between two fake targets. The true tool
then leaves the wanted line in between, because the error changes on the way; more fake targets keep it closer.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, lock
from irbcal.correction.fake_targets import Corrected, correct_joints
from irbcal.correction.joints_along import joints_along, tip_of
from irbcal.correction.path import Circle, Line, ToolPath, distance_to_path
from irbcal.errors import RobotError
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.robot import Robot
from irbcal.summary import Speaks, Told
from irbcal.units import DEG, MM

if TYPE_CHECKING:
    import pandas as pd

LARGEST_ARC = 240 * DEG
"""Of one circular move, radians."""


@dataclass(frozen=True, eq=False, repr=False)
class Subdivision(Speaks):
    """A path cut into moves whose ends are fake targets.

    Attributes
    ----------
    s : ndarray, shape (n,)
        Ends of the moves on the path, the first at 0; for circles every second one is the point that the arc
        goes through.
    corrected : Corrected
        The fake targets there.
    deviation : float
        Largest distance of the true tool centre point from the wanted path between them, metres.
    uncut : float
        The same for the path in the fewest moves there can be: one, for circles one for each 240 degrees begun.
    """

    s: FloatArray
    corrected: Corrected
    deviation: float
    uncut: float

    def __post_init__(self) -> None:
        lock(self)

    def told(self) -> list[Told]:
        """How many targets there are, how far the true path leaves the wanted one, and what cutting gained."""
        return [
            f"{len(self.s)} fake targets: the true path leaves the wanted one by at most {self.deviation / MM:.4f} mm, "
            f"in the fewest moves there can be by {self.uncut / MM:.4f} mm",
            *self.corrected.told(),
        ]

    def to_frame(self) -> pd.DataFrame:
        """A row for each target: ``s`` and the columns of `Corrected.to_frame`; radians and metres."""
        frame = self.corrected.to_frame()
        frame.insert(0, "s", self.s)
        return frame


def subdivide(
    path: ToolPath,
    robot: Robot,
    nominal: Arm,
    seed: ArrayLike,
    tolerance: float | None = None,
    length: float | None = None,
    T_tip_tcp: FloatArray | None = None,
    most: int = 1024,
) -> Subdivision:
    """Cut a path into moves so that the true path keeps to the wanted one (Nubiola 2011, annex VI).

    Between two fake targets the controller moves its tool along its own nominal line or arc; the calibrated
    robot tells where the tool truly goes.

    Parameters
    ----------
    path : Line or Circle
        Wanted path of the tool centre point, in the base link.
    robot : Robot
        Calibrated.
    nominal : Arm
        What the controller computes with.
    seed : ndarray, shape (6,)
        Joints at (or near) the start, radians.
    tolerance : float, optional
        Largest deviation allowed, metres: the fewest moves that keep it are taken.
    length : float, optional
        Largest length of a move, metres (annex VI took 30 mm).
    T_tip_tcp : ndarray, shape (4, 4), optional
        The tool; identity unless given.
    most : int
        Refuse more moves than this.

    Returns
    -------
    Subdivision

    Raises
    ------
    RobotError
        If neither or both wishes are given, if a point cannot be corrected, or if the tolerance takes too many moves.
    """
    if (tolerance is None) == (length is None):
        raise RobotError("a path is cut by a tolerance or by a length: give one of them")

    def cut(moves: int) -> tuple[FloatArray, Corrected, float]:
        return _cut(path, robot, nominal, seed, moves, T_tip_tcp)

    # a single circular move can neither return to its start nor tell, near there, which way round it goes
    fewest = int(np.ceil(abs(path.angle) / LARGEST_ARC - 1e-9)) if isinstance(path, Circle) else 1
    _, _, uncut = cut(fewest)
    if length is not None:
        moves = max(fewest, int(np.ceil(path.length / length - 1e-9)))
    elif tolerance is not None:
        moves = _fewest(lambda moves: cut(moves)[2], fewest, tolerance, most)
    s, corrected, deviation = cut(moves)
    return Subdivision(s, corrected, deviation, uncut)


def _fewest(deviation: Callable[[int], float], fewest: int, tolerance: float, most: int) -> int:
    """The fewest moves whose deviation keeps a tolerance: doubled until one does, then halved in between."""
    moves, fails = fewest, fewest - 1
    while deviation(moves) > tolerance:
        fails, moves = moves, 2 * moves
        if moves > most:
            raise RobotError(f"a deviation of {tolerance / MM:g} mm takes more than {most} moves")
    while moves - fails > 1:
        middle = (moves + fails) // 2
        fails, moves = (fails, middle) if deviation(middle) <= tolerance else (middle, moves)
    return moves


def _cut(
    path: ToolPath,
    robot: Robot,
    nominal: Arm,
    seed: ArrayLike,
    moves: int,
    T_tip_tcp: FloatArray | None,
    samples: int = 16,
) -> tuple[FloatArray, Corrected, float]:
    """Ends of the moves, fake targets there, and the deviation between them."""
    arcs = isinstance(path, Circle)
    s = np.linspace(0.0, 1.0, (2 if arcs else 1) * moves + 1)
    T_tcp_tip = tip_of(T_tip_tcp)
    wanted = path.poses(s) @ T_tcp_tip
    corrected = correct_joints(robot, nominal, joints_along(wanted, nominal, seed))
    if not corrected.ok.all():
        place = int(np.flatnonzero(~corrected.ok)[0])
        raise RobotError(f"point {place + 1} of {len(s)} of the path cannot be corrected: {corrected.reason[place]}")
    # the controller's own idea of the tool centre point between its targets
    fake = corrected.T_fake @ frames.inverse(T_tcp_tip)
    inside = np.linspace(0.0, 1.0, samples + 2)[1:-1]
    taken = []
    for k in range(moves):
        if arcs:
            move: ToolPath = Circle.through(fake[2 * k], fake[2 * k + 1, :3, 3], fake[2 * k + 2])
        else:
            move = Line(fake[k], fake[k + 1])
        taken.append(move.poses(inside))
    q = joints_along(np.concatenate(taken) @ T_tcp_tip, nominal, corrected.q[0])
    reached = robot.poses(q) @ frames.inverse(T_tcp_tip)
    return s, corrected, float(distance_to_path(path, reached[:, :3, 3]).max())
