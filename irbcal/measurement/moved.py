"""Whether tracker or base moved while the arm was measured: a jump or a trend in the residuals over the order of poses.

Errors of the robot depend on its pose, not on the time. If all points lie elsewhere from some pose on, or ever farther
as time goes by, then the relation of tracker and base has changed. Residuals are explained by a small motion of the
base (three shifts, three turns), by two of them with a change in between, or by one that grows with time; what counts
is by how much that makes them smaller, and whether poses in a random order would do the same.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from irbcal.arrays import FloatArray, IntArray, evenly_chosen
from irbcal.measurement.change_points import SHORTEST, PoseSums, beyond_chance, pose_sums
from irbcal.measurement.points import PointSet
from irbcal.measurement.repeats import repeat_groups
from irbcal.modeling.frames import by_motion
from irbcal.modeling.robot import Robot
from irbcal.summary import Paragraph, Result
from irbcal.units import DEG, MM

FEWEST_POSES = 20
"""Poses below which nothing can be said."""
SMALLER = 0.85
"""Ratio to which residuals must fall (root mean square) to be spoken of: groups of poses differ by less."""
RIDGE = 1e-9
"""What is added to normal equations, as a share of their trace, so that those of few points can be solved, too."""
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
    rms_without: float
    rms_with: float
    """Root mean square of the residuals without and with it, metres."""

    def report(self) -> list[Paragraph]:
        """One sentence."""
        size = float(np.linalg.norm(self.shift)) / MM
        along = f"most of it along {_along(self.shift)} of the measuring frame ({_along(self.shift_base)} of the base)"
        by = f"about {size:.2g} mm, {along}, and is turned by {self.turn / DEG:.2g} degrees"
        fall = (
            f"residuals fall from {self.rms_without / MM:.3f} to {self.rms_with / MM:.3f} mm where that is allowed for"
        )
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
        sample = evenly_chosen(points.poses, MOST_POSES)
        return moved(points.select(sample), residuals[sample[points.pose]], R_world_base, seed)
    starts = np.flatnonzero(np.diff(repeat_groups(points), prepend=-1))  # repeats in a row show one error of the robot
    if len(starts) < FEWEST_POSES:
        return None
    stop = np.searchsorted(starts, points.pose, side="right") - 1
    away = points.xyz - points.xyz.mean(axis=0)
    sums = pose_sums(by_motion(away).reshape(-1, 3, 6), residuals, stop, len(starts))
    ridge = RIDGE * float(np.trace(sums.H.sum(axis=0)))
    cuts = np.arange(SHORTEST, len(starts) - SHORTEST + 1)
    jump, k = sums.best_cut(cuts, ridge)
    drift, motion = _drift(sums, ridge)
    rss, constant = min(jump, drift), sums.rss(ridge)
    if not constant > 0.0 or rss > SMALLER**2 * constant:
        return None

    def least(order: IntArray) -> float:
        ordered = sums.ordered(order)
        return min(ordered.best_cut(cuts, ridge)[0], _drift(ordered, ridge)[0])

    if not beyond_chance(len(starts), rss, least, seed):
        return None
    count = 3 * len(residuals)
    sizes = float(np.sqrt(3.0 * constant / count)), float(np.sqrt(3.0 * rss / count))
    # a drift is a row of small jumps: it is called so unless a jump explains clearly more
    jumped = drift > 1.1 * jump
    if jumped:
        H, g, firm = sums.H, sums.g, ridge * np.eye(6)
        first, second = (
            np.linalg.solve(H[part].sum(axis=0) + firm, g[part].sum(axis=0)) for part in (slice(k), slice(k, None))
        )
        motion = second - first
    turn, shift = motion[:3], motion[3:]
    pose = str(points.pose_ids[starts[k]]) if jumped else ""
    return Moved(
        "jump" if jumped else "drift", pose, shift, R_world_base.T @ shift, float(np.linalg.norm(turn)), *sizes
    )


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


def _drift(sums: PoseSums, ridge: float) -> tuple[float, FloatArray]:
    """Sum of squares with a motion that grows evenly, and that motion (turn, shift) from the first to the last pose."""
    t = np.linspace(-0.5, 0.5, len(sums.H))
    with_time = np.einsum("n,nab->ab", t, sums.H)
    normal = np.block([[sums.H.sum(axis=0), with_time], [with_time, np.einsum("n,nab->ab", t * t, sums.H)]])
    right = np.concatenate([sums.g.sum(axis=0), t @ sums.g])
    motion = np.linalg.solve(normal + ridge * np.eye(12), right)
    return float(sums.yy.sum() - right @ motion), motion[6:]
