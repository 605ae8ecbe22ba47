r"""The cell as a graph of frames, and how a point of one frame moves in another as edges of the graph change.

Frames are the robot's base link and flange (its tip link), the measuring frame, tools, work objects, carriages and
tables of external axes. An edge joins a parent and a child by ``T_parent_child``. It is known (one transform, or one a
row of measurements), unknown and constant, the arm, or an external axis. A point p of frame G is, in frame F, at
``T_F_G p`` with the product of the edges on the path from F to G. A small motion of an unknown edge in its child's
axes, ``T_parent_child Exp(w, v)``, moves the point and turns G by::

    dp = s R_F_child (w x p_child + v),    turn = s R_F_child w

with s = 1 where the path goes from the parent to the child, and -1 where it goes the other way.

An external axis at e moves its child by ``Exp(e S)``, S = (w, v) being its screw: w its direction where it turns, v its
direction where it slides, in the axes of its parent; parent and child are the same frame at e = 0. All six numbers are
unknown, so that a track that pitches and a table that wobbles along its axis are described, too; that an axis is nearly
the joint that it is built as is prior knowledge (`screw_prior`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np

from irbcal.arrays import FloatArray, Locked, locked
from irbcal.modeling import frames

WORLD, FLOOR, BASE, FLANGE = "world", "floor", "base", "flange"
"""The measuring frame, where the base link is at zero of the axes that carry the robot, base link and tip link."""
TRACK_TURN_U95 = 5e-4
"""Of how a sliding axis turns what it carries, rad/m."""
SCALE_U95 = {True: 1e-2, False: 1e-3}
"""Of the length of a sliding axis's screw (m/m; a conveyor's count is known worst), of a turning one's (rad/rad)."""
PITCH_U95 = 1e-4
"""Of how a turning axis moves along itself, m/rad."""


@dataclass(frozen=True, eq=False)
class Edge(Locked):
    """Two frames that are joined."""

    parent: str
    child: str
    T: FloatArray | None = None
    """Shape (4, 4) or (rows, 4, 4). ``T_parent_child``, metres, of all rows or row by row; None where it is unknown, is
    the arm, or an axis.
    """
    screw: FloatArray | None = None
    """Shape (6,). Of an external axis, nominal: turn and shift of the child by one rad (m)."""
    e: FloatArray | None = None
    """Shape (rows,). Its position, row by row, radians (metres)."""

    def at(self, value: FloatArray | None) -> FloatArray:
        """``T_parent_child``, (4, 4) or (rows, 4, 4), by the value of its unknown, or as it is known."""
        if self.e is None:
            known = value if self.T is None else self.T
            return np.eye(4) if known is None else known
        screw = self.screw if value is None else value
        assert screw is not None
        return screw_motion(screw, self.e)


ARM = Edge(BASE, FLANGE)


def screw_motion(screw: FloatArray, e: FloatArray) -> FloatArray:
    """``Exp(e S)``, shape (n, 4, 4), metres; e of shape (n,): the turn, and the shift along the way to it."""
    T = np.zeros((len(e), 4, 4))
    share, weight = _shares(screw, e)
    along = frames.rotation_from_vector((share * e)[..., None] * screw[:3])
    T[:, :3, :3] = frames.rotation_from_vector(e[:, None] * screw[:3])
    T[:, :3, 3] = e[:, None] * np.einsum("s,snij,j->ni", weight, along, screw[3:])
    T[:, 3, 3] = 1.0
    return T


def screw_derivative(screw: FloatArray, e: FloatArray) -> FloatArray:
    """Small motion of an axis's child in its own axes by the screw, shape (n, 6, 6).

    The right Jacobian of SE(3), ``e`` times the integral of ``Ad(Exp(-s e S))`` for s from 0 to 1.
    """
    share, weight = _shares(screw, e)
    T = screw_motion(screw, -(share * e).ravel()).reshape(len(share), len(e), 4, 4)
    R, t = T[..., :3, :3], T[..., :3, 3]
    Ad = np.zeros((*R.shape[:2], 6, 6))
    Ad[..., :3, :3] = Ad[..., 3:, 3:] = R
    Ad[..., 3:, :3] = frames.cross(t[..., None, :], R.swapaxes(-1, -2)).swapaxes(-1, -2)
    return np.asarray(e[:, None, None] * np.einsum("s,snij->nij", weight, Ad))


def _shares(screw: FloatArray, e: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Shares (s, 1) of the way to the largest turn, and their weights (s,), by Gauss and Legendre."""
    return _gauss(12 + int(np.abs(e).max(initial=0.0) * np.linalg.norm(screw[:3])))


@cache
def _gauss(count: int) -> tuple[FloatArray, FloatArray]:
    """So many shares and weights: numpy computes them again each time, which took most of a screw's time."""
    x, weight = np.polynomial.legendre.leggauss(count)
    return locked(0.5 * (x[:, None] + 1.0)), locked(0.5 * weight)


def screw_prior(screw: FloatArray, slides: bool) -> tuple[FloatArray, FloatArray, FloatArray]:
    """How far a screw is from a slide (turn, length) or a hinge (length, pitch) of one unit.

    Returns
    -------
    r : ndarray, shape (k,)
    J : ndarray, shape (k, 6)
        Derivative.
    u95 : ndarray, shape (k,)
        Of r, beforehand.
    """
    w, v = screw[:3], screw[3:]
    along = v if slides else w
    length = float(np.linalg.norm(along))
    of_length = np.zeros(6)
    of_length[3 * slides : 3 * slides + 3] = along / length
    if slides:
        r, J = [*w], np.eye(6)[:3]
        u95 = np.full(3, TRACK_TURN_U95)
    else:
        pitch = float(w @ v) / length**2
        r, u95 = [pitch], np.array([PITCH_U95])
        J = np.concatenate([v - 2.0 * pitch * w, w])[None] / length**2
    return np.array([*r, length - 1.0]), np.vstack([J, of_length]), np.append(u95, SCALE_U95[slides])


@dataclass(frozen=True, eq=False)
class RelativeFrame:
    """A frame G in the axes of a frame F, at n rows."""

    T: FloatArray
    """Shape (n, 4, 4). ``T_F_G``, metres."""
    frames: Mapping[str, FloatArray]
    """Values of shape (n, 4, 4). ``T_F_X`` of every frame X on the path."""
    signs: Mapping[str, float]
    """By the child of each edge on the path, 1 where the path goes from its parent to the child, else -1."""

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
        shift[:, :, :3] = frames.cross(R.transpose(0, 2, 1), lever[:, None]).transpose(0, 2, 1)
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
                neighbour = edge.child if frame == edge.parent else edge.parent
                if neighbour not in came:
                    came[neighbour] = [*came[frame], edge]
                    front.append(neighbour)
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
