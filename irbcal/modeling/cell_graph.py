r"""The cell as a graph of frames, and how a point of one frame moves in another as edges of the graph change.

Frames are the robot's base link and flange (its tip link), the measuring frame, tools, work objects, carriages and
tables of external axes. An edge joins a parent and a child by ``T_parent_child``. It is known (one transform, or one a
row of measurements where an external axis moves), unknown and constant, or the arm. A point p of frame G is, in frame
F, at ``T_F_G p`` with the product of the edges on the path from F to G. A small motion of an unknown edge in its
child's axes, ``T_parent_child Exp(w, v)``, moves the point and turns G by::

    dp = s R_F_child (w x p_child + v),    turn = s R_F_child w

with s = 1 where the path goes from the parent to the child, and -1 where it goes the other way.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from irbcal.arrays import FloatArray, lock
from irbcal.modeling import frames

WORLD, BASE, FLANGE = "world", "base", "flange"
"""The measuring frame, the robot's base link and its tip link."""


@dataclass(frozen=True, eq=False)
class Edge:
    """Two frames that are joined.

    Attributes
    ----------
    parent, child : str
    T : ndarray, shape (4, 4) or (rows, 4, 4), or None
        ``T_parent_child``, metres, of all rows or row by row; None where it is unknown, or is the arm.
    """

    parent: str
    child: str
    T: FloatArray | None = None

    def __post_init__(self) -> None:
        lock(self)


ARM = Edge(BASE, FLANGE)


@dataclass(frozen=True, eq=False)
class RelativeFrame:
    """A frame G in the axes of a frame F, at n rows.

    Attributes
    ----------
    T : ndarray, shape (n, 4, 4)
        ``T_F_G``, metres.
    frames : dict of str to ndarray, shape (n, 4, 4)
        ``T_F_X`` of every frame X on the path.
    signs : dict of str to float
        By the child of each edge on the path, 1 where the path goes from its parent to the child, else -1.
    """

    T: FloatArray
    frames: Mapping[str, FloatArray]
    signs: Mapping[str, float]

    def moved_by(self, child: str, p: FloatArray) -> tuple[FloatArray, FloatArray]:
        """How points of G move, and how G turns, by a small motion of the edge of a child.

        Parameters
        ----------
        child : str
        p : ndarray, shape (n, 3)
            In F, metres.

        Returns
        -------
        shift, turn : ndarray, shape (n, 3, 6)
            By the motion's rotation vector and translation in the child's axes.
        """
        T, sign = self.frames[child], self.signs[child]
        R, lever = sign * T[:, :3, :3], p - T[:, :3, 3]
        shift, turn = np.zeros((2, len(p), 3, 6))
        shift[:, :, :3] = np.cross(R.transpose(0, 2, 1), lever[:, None]).transpose(0, 2, 1)
        shift[:, :, 3:] = turn[:, :, :3] = R
        return shift, turn


def path(edges: Sequence[Edge], start: str, end: str) -> list[Edge]:
    """The edges between two frames, in order.

    Raises
    ------
    KeyError
        If nothing joins them.
    """
    came: dict[str, list[Edge]] = {start: []}
    front = [start]
    while front and end not in came:
        frame = front.pop(0)
        for edge in edges:
            if frame in (edge.parent, edge.child):
                other = edge.child if frame == edge.parent else edge.parent
                if other not in came:
                    came[other] = [*came[frame], edge]
                    front.append(other)
    return came[end]


def view(edges: Sequence[Edge], transforms: Mapping[str, FloatArray], start: str, end: str, n: int) -> RelativeFrame:
    """A frame in the axes of another, along the path between them.

    Parameters
    ----------
    edges : sequence of Edge
    transforms : dict of str to ndarray, shape (4, 4) or (n, 4, 4)
        ``T_parent_child`` by the child, metres.
    start, end : str
        F and G.
    n : int
        Rows.

    Returns
    -------
    RelativeFrame
    """
    T = np.broadcast_to(np.eye(4), (n, 4, 4))
    of_frames, signs, frame = {start: T}, {}, start
    for edge in path(edges, start, end):
        forward = frame == edge.parent
        along = transforms[edge.child]
        T = T @ (along if forward else frames.inverse(along))
        frame = edge.child if forward else edge.parent
        of_frames[frame], signs[edge.child] = T, 1.0 if forward else -1.0
    return RelativeFrame(T, of_frames, signs)
