"""Whether tracker or base moved while the arm was measured: a jump or a trend in the residuals over the order of poses.

Errors of the robot depend on its pose, not on the time. If all points lie elsewhere from some pose on, or ever farther
as time goes by, then the relation of tracker and base has changed. Residuals are explained by a small motion of the
base (three shifts, three turns), by two of them with a change in between, or by one that grows with time; what counts
is by how much that makes them smaller, and whether poses in a random order would do the same.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np

from irbcal.arrays import FloatArray, IntArray
from irbcal.measurement.points import PointSet
from irbcal.measurement.repeats import repeat_groups
from irbcal.modeling.robot import Robot
from irbcal.summary import Paragraph, Result
from irbcal.units import DEG, MM

FEWEST_POSES = 20
"""Poses below which nothing can be told."""
SHORTEST = 8
"""Poses before and after a change at least."""
SMALLER = 0.85
"""Ratio to which residuals must fall (root mean square) to be spoken of: groups of poses differ by less."""
SHUFFLES = 200
"""Random orders that are tried; none may explain as much."""
BLOCK_SHARE = 40
"""Blocks of neighbouring poses that are shuffled together: a program's neighbours have similar errors."""


MOST_POSES = 10_000
"""Poses that are looked at; of more, evenly chosen ones."""


@dataclass(frozen=True, eq=False, repr=False)
class Moved(Result):
    """A change of tracker and base against each other while it was measured."""

    kind: Literal["jump", "drift"]
    """``jump`` or ``drift``."""
    pose: str
    """Name of the first pose after a jump; empty for a drift."""
    shift: FloatArray
    """Shape (3,). By how much the points lie elsewhere afterwards (at the end), in their middle, in the measuring
    frame, metres.
    """
    shift_base: FloatArray
    """Shape (3,). The same in the base link."""
    turn: float
    """By how much they are turned, radians."""
    before: float
    after: float
    """Root mean square of the residuals without and with it, metres."""

    def report(self) -> list[Paragraph]:
        """One sentence."""
        size = float(np.linalg.norm(self.shift)) / MM
        along = f"most of it along {_along(self.shift)} of the measuring frame ({_along(self.shift_base)} of the base)"
        by = f"about {size:.2g} mm, {along}, and is turned by {self.turn / DEG:.2g} degrees"
        fall = f"residuals fall from {self.before / MM:.3f} to {self.after / MM:.3f} mm where that is allowed for"
        if self.kind == "jump":
            return [
                f"From pose {self.pose} on everything lies farther by {by}: was the tracker or the robot's base moved? "
                f"({fall}) Call the parts sessions (a column session, or --session-by), or measure again."
            ]
        return [
            f"Everything drifts while it is measured: from the first to the last pose it moves by {by}. Does the "
            f"tracker or the base give way? ({fall}) Measure references, or measure again in short sessions."
        ]


def _along(shift: FloatArray) -> str:
    k = int(np.argmax(np.abs(shift)))
    return f"{'-' if shift[k] < 0 else ''}{'xyz'[k]}"


def moved(points: PointSet, residuals: FloatArray, R_world_base: FloatArray, seed: int = 0) -> Moved | None:
    """Look for a jump or a drift.

    Parameters
    ----------
    points : PointSet
        Poses in the order in which they were measured, of one session.
    residuals : ndarray, shape (m, 3)
        Measured minus predicted, in the measuring frame, metres.
    R_world_base : ndarray, shape (3, 3)
        Attitude of the base in the measuring frame, for words.
    seed : int
        Of the random orders.

    Returns
    -------
    Moved or None
        None where nothing beyond chance is found.
    """
    if points.poses < FEWEST_POSES:
        return None
    if points.poses > MOST_POSES:
        sample = np.isin(np.arange(points.poses), np.linspace(0, points.poses - 1, MOST_POSES).astype(int))
        return moved(points.select(sample), residuals[sample[points.pose]], R_world_base, seed)
    starts = np.flatnonzero(np.diff(repeat_groups(points), prepend=-1))  # repeats in a row show one error of the robot
    if len(starts) < FEWEST_POSES:
        return None
    stop = np.searchsorted(starts, points.pose, side="right") - 1
    middle = points.xyz.mean(axis=0)
    H, g, yy = _sums(stop, points.xyz - middle, residuals, len(starts))
    jump, k = _jump(H, g, yy)
    drift, motion = _drift(H, g, yy)
    rss, constant = min(jump, drift), yy.sum() - _explained(H.sum(axis=0)[None], g.sum(axis=0)[None])[0]
    if not constant > 0.0 or rss > SMALLER**2 * constant or _by_chance(H, g, yy, rss / constant, seed):
        return None
    count = 3 * len(residuals)
    sizes = float(np.sqrt(3.0 * constant / count)), float(np.sqrt(3.0 * rss / count))
    # a drift is a row of small jumps: it is called so unless a jump explains clearly more
    if drift <= 1.1 * jump:
        shift = motion[:3]
        return Moved("drift", "", shift, R_world_base.T @ shift, float(np.linalg.norm(motion[3:])), *sizes)
    first, second = (np.linalg.solve(_firm(H[half].sum(axis=0)), g[half].sum(axis=0)) for half in _parts(k))
    change = second - first
    turn = float(np.linalg.norm(change[3:]))
    return Moved("jump", str(points.pose_ids[starts[k]]), change[:3], R_world_base.T @ change[:3], turn, *sizes)


def moved_notes(points: PointSet, robot: Robot, warmth: FloatArray | None = None) -> list[str]:
    """What `moved` says of each session of measured points under a robot that was fitted to them, in sentences.

    Parameters
    ----------
    points : PointSet
    robot : Robot
        Warm.
    warmth : ndarray, shape (m, 3), optional
        By how much points lay elsewhere because the arm was not yet warm, as far as that is known, metres.
    """
    out = []
    residuals = points.xyz - points.predicted(robot)
    residuals = residuals if warmth is None else residuals - warmth
    sessions = np.zeros(points.poses) if points.session is None else np.asarray(points.session)
    for session in dict.fromkeys(sessions.tolist()):
        of_session = sessions == session
        change = moved(points.select(of_session), residuals[of_session[points.pose]], robot.T_world_base[:3, :3])
        out += [] if change is None else [str(sentence) for sentence in change.report()]
    return out


def _parts(k: int) -> tuple[slice, slice]:
    return slice(0, k), slice(k, None)


def _sums(pose: IntArray, arm: FloatArray, residuals: FloatArray, n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Normal equations of a small motion of the base for each pose, (n, 6, 6), (n, 6), and squares (n,)."""
    A = np.zeros((len(arm), 3, 6))
    A[:, range(3), range(3)] = 1.0
    for axis in range(3):  # turn about this axis: axis x arm
        i, j = (axis + 1) % 3, (axis + 2) % 3
        A[:, j, 3 + axis], A[:, i, 3 + axis] = arm[:, i], -arm[:, j]
    order = np.argsort(pose, kind="stable")
    poses, first = np.unique(pose[order], return_index=True)
    H, g, yy = np.zeros((n, 6, 6)), np.zeros((n, 6)), np.zeros(n)
    A, residuals = A[order], residuals[order]
    H[poses] = np.add.reduceat(A.transpose(0, 2, 1) @ A, first)
    g[poses] = np.add.reduceat(np.einsum("mca,mc->ma", A, residuals), first)
    yy[poses] = np.add.reduceat((residuals**2).sum(axis=1), first)
    return H, g, yy


def _firm(H: FloatArray) -> FloatArray:
    """Normal equations that can be solved, also of few points: a thousandth of a millionth of their own size more."""
    return H + 1e-9 * np.trace(H, axis1=-2, axis2=-1)[..., None, None] * np.eye(H.shape[-1])


def _explained(H: FloatArray, g: FloatArray) -> FloatArray:
    return np.einsum("ka,ka->k", g, np.linalg.solve(_firm(H), g[..., None])[..., 0])


def _jump(H: FloatArray, g: FloatArray, yy: FloatArray) -> tuple[float, int]:
    """Least sum of squares with a change, and the first pose after it."""
    n = len(H)
    at = np.arange(SHORTEST, n - SHORTEST + 1)
    Hs, gs = np.cumsum(H, axis=0), np.cumsum(g, axis=0)
    gain = _explained(Hs[at - 1], gs[at - 1]) + _explained(Hs[-1] - Hs[at - 1], gs[-1] - gs[at - 1])
    best = int(np.argmax(gain))
    return float(yy.sum() - gain[best]), int(at[best])


def _drift(H: FloatArray, g: FloatArray, yy: FloatArray) -> tuple[float, FloatArray]:
    """Sum of squares with a motion that grows evenly, and that motion from the first to the last pose."""
    t = np.linspace(-0.5, 0.5, len(H))
    with_time = np.einsum("n,nab->ab", t, H)
    normal = np.block([[H.sum(axis=0), with_time], [with_time, np.einsum("n,nab->ab", t * t, H)]])
    right = np.concatenate([g.sum(axis=0), t @ g])
    motion = np.linalg.solve(_firm(normal), right)
    return float(yy.sum() - right @ motion), motion[6:]


def random_orders(n: int, seed: int) -> Iterator[IntArray]:
    """Orders of n poses by which chance is judged: blocks of neighbours, whose errors are alike, stay together."""
    rng, blocks = np.random.default_rng(seed), np.array_split(np.arange(n), min(n, BLOCK_SHARE))
    for _ in range(SHUFFLES):
        yield np.concatenate([blocks[k] for k in rng.permutation(len(blocks))])


def _by_chance(H: FloatArray, g: FloatArray, yy: FloatArray, ratio: float, seed: int) -> bool:
    """Whether poses in a random order, neighbours together, are explained as well."""
    total = yy.sum() - _explained(H.sum(axis=0)[None], g.sum(axis=0)[None])[0]
    for order in random_orders(len(H), seed):
        if min(_jump(H[order], g[order], yy[order])[0], _drift(H[order], g[order], yy[order])[0]) <= ratio * total:
            return True
    return False
