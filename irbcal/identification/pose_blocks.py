"""Measured points in blocks of poses, as sums over all of them want them: which points share the frames of a pose."""

from __future__ import annotations

from collections.abc import Container
from dataclasses import dataclass

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray
from irbcal.measurement.points import PointSet
from irbcal.modeling.joint_map import fourier_terms, stiffness_terms

BLOCK = 2048
"""Poses whose Jacobian is in memory at a time."""


@dataclass(frozen=True, eq=False)
class PoseBlock:
    """Some poses with their points, and where their rows stand; made once for a problem: not locked.

    Points are arranged in t rows of f. Where every pose has as many points and none has an orientation, the frames of a
    pose are needed once, for the t points below one another; else once for every point, and there is one row.

    Attributes
    ----------
    q : ndarray, shape (n, joints)
        Of each pose, radians.
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
    """Points in blocks of `BLOCK` poses.

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
    """
    starts = range(0, points.poses, BLOCK)
    edges = np.searchsorted(points.pose, [*starts, points.poses])
    before = np.concatenate([[0], np.cumsum(oriented)])
    none = np.zeros((0, 0))
    blocks = []
    for k, start in enumerate(starts):
        rows = slice(edges[k], edges[k + 1])
        q = points.q[start : start + BLOCK]
        pose = points.pose[rows] - start
        turned = np.flatnonzero(oriented[rows])
        o = len(points) + before[edges[k]]
        order = np.arange(len(pose))[None]
        frames: IntArray | slice = pose
        each = len(pose) // len(q)
        if not len(turned) and len(pose) == each * len(q) and (pose == np.repeat(np.arange(len(q)), each)).all():
            order, frames = order.reshape(-1, each).T, slice(None)
        flat = order.ravel()
        blocks.append(
            PoseBlock(
                q=q,
                frames=frames,
                target=points.target[rows][order],
                xyz=np.ascontiguousarray(points.xyz[rows][flat].T),
                turned=turned,
                rotation=np.zeros((0, 3, 3)) if points.rotation is None else points.rotation[rows][turned],
                rows=np.concatenate([edges[k] + flat, o + np.arange(len(turned))]),
                session=np.concatenate([session[rows][flat], session[rows][turned]]),
                stiffness=np.asarray(stiffness_terms(q, phases))[:, frames] if "stiffness" in kinds else none,
                fourier=fourier_terms(q)[:, frames] if "fourier" in kinds else none,
            )
        )
    return blocks
