"""Measured points in blocks of poses, as sums over all of them want them: which points share the frames of a pose."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray
from irbcal.measurement.points import PointSet
from irbcal.modeling.thesis_map import fourier_terms, stiffness_terms

BLOCK = 2048
"""Poses whose Jacobian is in memory at a time."""


@dataclass(frozen=True, eq=False)
class PoseBlock:
    """Some points with the frames at which they are, and where their rows stand; made once for a problem: not locked.

    Points are arranged in t rows of f. Where poses have t points each, and none an orientation, the frames of a pose
    are needed once, for the points below one another; else once for every point, and there is one row.

    Attributes
    ----------
    q : ndarray, shape (n, joints)
        Of poses, radians.
    frames : ndarray of int, shape (f,), or slice
        Rows of ``q`` at which frames are needed.
    target : ndarray of int, shape (t, f)
        Target of each point.
    xyz : ndarray, shape (3, t f)
        Measured points in their order here, metres.
    turned : ndarray of int, shape (o,)
        Points with a measured orientation, of the one row.
    rotation : ndarray, shape (o, 3, 3)
    rows : ndarray of int, shape (t f + o,)
        Of the whole problem: the points', then the orientations'.
    session : ndarray of int, shape (t f + o,)
        Of each row.
    stiffness : ndarray, shape (2, f)
        Terms of A and B at each frame; empty where no parameter needs them.
    fourier : ndarray, shape (4, f)
        Terms of joint 6; likewise.
    """

    q: FloatArray
    frames: IntArray | slice
    target: IntArray
    xyz: FloatArray
    turned: IntArray
    rotation: FloatArray
    rows: IntArray
    session: IntArray
    stiffness: FloatArray
    fourier: FloatArray


def cut(
    points: PointSet, oriented: BoolArray, session: IntArray, phases: FloatArray, kinds: Container[str]
) -> list[PoseBlock]:
    """Points in blocks of at most `BLOCK` poses, those with as many points as most others by themselves.

    Parameters
    ----------
    points : PointSet
    oriented : ndarray of bool, shape (m,)
        Which points have an orientation.
    session : ndarray of int, shape (m,)
        Of each point.
    phases : ndarray, shape (2,)
        Of the stiffness terms, radians.
    kinds : container of str
        Kinds of error parameters: those that need terms of the joint map.

    Returns
    -------
    list of PoseBlock
        Poses without points are in none.
    """
    before = np.cumsum(oriented) - 1 + len(points)
    none = np.zeros((0, 0))

    def block(q: FloatArray, frames: IntArray | slice, at: IntArray) -> PoseBlock:
        """The points ``at`` (t, f) of ``points``, at these frames of ``q``."""
        flat = at.ravel()
        turned = np.flatnonzero(oriented[flat])
        return PoseBlock(
            q=q,
            frames=frames,
            target=points.target[at],
            xyz=np.ascontiguousarray(points.xyz[flat].T),
            turned=turned,
            rotation=np.zeros((0, 3, 3)) if points.rotation is None else points.rotation[flat[turned]],
            rows=np.concatenate([flat, before[flat[turned]]]),
            session=np.concatenate([session[flat], session[flat[turned]]]),
            stiffness=np.asarray(stiffness_terms(q, phases))[:, frames] if "stiffness" in kinds else none,
            fourier=fourier_terms(q)[:, frames] if "fourier" in kinds else none,
        )

    edges = np.searchsorted(points.pose, [*range(0, points.poses, BLOCK), points.poses])
    blocks = []
    for start, first, end in zip(range(0, points.poses, BLOCK), edges[:-1], edges[1:], strict=True):
        q = points.q[start : start + BLOCK]
        pose, at = points.pose[first:end] - start, np.arange(first, end)
        counts = np.bincount(pose, minlength=len(q))
        usual = 1 + int(np.argmax(np.bincount(counts)[1:])) if len(at) else 0
        shared = counts == (0 if oriented[first:end].any() else usual)
        own = shared[pose]
        if 2 * np.count_nonzero(own) < len(at):
            own[:] = False
        if usual and own.any():
            blocks.append(block(q if shared.all() else q[shared], slice(None), at[own].reshape(-1, usual).T))
        if not own.all():
            blocks.append(block(q, pose[~own], at[~own][None]))
    return blocks
