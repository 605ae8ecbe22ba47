r"""Readings that were taken as the motion ended, before the arm stood still.

A controller's readings may lag behind the programmed joints by a share of the last move, one number for all joints of a
pose: ``reading = command - s_n D_n``. Where the programmed joints are not known, an identification leaves ``s_n`` free
in each pose (`irbcal.identification.linearisation.Linearisation`, ``project``), and its model is right at programmed
joints. To predict at *readings*, ``s_n`` is found from the residuals of the fitted poses and regressed on what is known
of a move.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from irbcal.arrays import FloatArray, lock
from irbcal.identification.evidence_fit import EvidenceFit
from irbcal.measurement.points import PointSet
from irbcal.modeling.terms import chain
from irbcal.modeling.terms.situation import Motion
from irbcal.summary import Speaks, Told
from irbcal.units import DEG

RIDGE = 1e-3
"""Ridge of the regression, relative to features of unit root mean square."""
SHORTEST = 0.1 * DEG
"""Largest joint's move below which nothing lags, radians."""


@dataclass(frozen=True, eq=False, repr=False)
class Lag(Speaks):
    """Share of the last move by which readings lag behind the programmed joints.

    Attributes
    ----------
    weights : ndarray, shape (features,)
        Of `features`, whose root mean squares are ``scale``.
    scale : ndarray, shape (features,)
    shares : ndarray, shape (n,)
        Found in the poses of the fit.
    sigma : float
        Standard deviation of what the regression leaves of them.
    """

    weights: FloatArray
    scale: FloatArray
    shares: FloatArray
    sigma: float

    def __post_init__(self) -> None:
        lock(self)

    def told(self) -> Sequence[Told]:
        """How much readings lag, and how well that is known."""
        return (
            f"readings lag behind the programmed joints by {np.median(self.shares):.2e} of the last move in the median "
            f"of {len(self.shares)} poses; known within {self.sigma:.1e} of a move",
        )

    def share(self, fit: EvidenceFit, motion: Motion) -> FloatArray:
        """Expected share for other readings with their last moves, shape (n,)."""
        return (features(fit, motion) / self.scale) @ self.weights

    def programmed(self, fit: EvidenceFit, motion: Motion) -> FloatArray:
        """Programmed joints that belong to readings, shape (n, joints)."""
        return motion.q + self.share(fit, motion)[:, None] * motion.moves


def features(fit: EvidenceFit, motion: Motion) -> FloatArray:
    """What a share may depend on: 1, 1/m, 1/L, L/m^2, |D_j|/m^2 and D_j^2/m^3.

    m is the largest joint's move and L the tool's path: times m, the angle by which the leading joint lags, they
    say how far it went, how the other joints went beside it, and how far the tool went with it.

    Returns
    -------
    ndarray, shape (n, 4 + 2 joints)
        Zero rows for stops without a move.
    """
    size = np.abs(motion.moves)
    m = size.max(axis=1)
    there = chain.poses(chain.walk(fit.arm, motion.q))
    before = chain.poses(chain.walk(fit.arm, motion.q - motion.moves))
    place = np.append(next(iter(fit.targets.values())), 1.0)
    L = np.linalg.norm((there - before)[:, :3] @ place, axis=1)
    moved = m > SHORTEST
    m, L = np.where(moved, m, 1.0), np.where(moved, np.maximum(L, 1e-3), 1.0)
    beside = size / m[:, None]
    out = np.column_stack([m, np.ones(len(m)), m / L, L / m, beside, beside * beside]) / m[:, None]
    return np.where(moved[:, None], out, 0.0)


def shares(fit: EvidenceFit, points: PointSet, motion: Motion) -> FloatArray:
    """Share of the last move that explains each pose's points best, shape (n,).

    Parameters
    ----------
    fit : EvidenceFit
        Identified from readings with the last move projected out.
    points : PointSet
    motion : Motion
        Readings and last moves of the points' poses.
    """
    term_map = fit.term_map(warm=False)
    path = chain.walk(fit.arm, *term_map.split(motion))
    pose = points.pose
    local = np.array([fit.targets[name] for name in points.target_names])[points.target].T
    tip = path.tip[..., pose]
    p = tip[3] + np.einsum("acm,am->cm", tip[:3], local)
    R, t = fit.T_world_base[:3, :3], fit.T_world_base[:3, 3]
    e = ((points.xyz - t) @ R).T - p
    columns = chain.point_columns(path, p, pose)
    own = np.where(fit.arm.table.prismatic, 5, 2)
    d = np.einsum("jcm,jm->cm", columns[np.arange(len(own)), own], motion.moves[pose].T)
    above = np.bincount(pose, (d * e).sum(axis=0), points.poses)
    below = np.bincount(pose, (d * d).sum(axis=0), points.poses)
    return np.where(below > 0.0, above / np.where(below > 0.0, below, 1.0), 0.0)


def lag(fit: EvidenceFit, points: PointSet, motion: Motion) -> Lag:
    """Regress the shares of the poses of a fit, by ridge; parameters as `shares`."""
    found = shares(fit, points, motion)
    X = features(fit, motion)
    scale = np.sqrt(np.mean(X * X, axis=0))
    scale = np.where(scale > 0.0, scale, 1.0)
    # each share is known as well as the move is long: weigh by the largest joint's move
    w = np.abs(motion.moves).max(axis=1)
    A = X / scale * w[:, None]
    weights = np.linalg.solve(A.T @ A + RIDGE * np.trace(A.T @ A) / len(scale) * np.eye(len(scale)), A.T @ (w * found))
    left = found - (X / scale) @ weights
    return Lag(weights, scale, found, float(np.sqrt(np.average(left**2, weights=w**2))))
