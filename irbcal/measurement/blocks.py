"""Targets of their own for blocks of poses: a tool that was mounted anew, for a session or with a payload.

The mechanism is the name alone. `own_targets` calls a target ``smr1`` in a block ``monday`` ``smr1@monday``; an
identification takes it for another target, so that the block has its own place of the tool while the robot is
shared. The poses of one block keep the plain names: these are the targets that a calibrated robot is used with.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from irbcal.arrays import NameArray
from irbcal.measurement.points import PointSet

MARK = "@"
"""Between a target and the block in which it was mounted so."""


def own_targets(points: PointSet, blocks: NameArray, plain: str) -> PointSet:
    """The same points, the targets of each block by names of their own.

    Parameters
    ----------
    points : PointSet
        With the targets' plain names.
    blocks : ndarray of str, shape (n,)
        Block of each pose.
    plain : str
        The block whose targets keep their names.

    Returns
    -------
    PointSet
        Targets are sorted by name, those with plain names first.
    """
    of_point = np.asarray(blocks, dtype=object)[points.pose]
    name_and_block = zip(points.names(), of_point, strict=True)
    called = [name if block == plain else f"{name}{MARK}{block}" for name, block in name_and_block]
    names = sorted(set(called), key=lambda name: (MARK in name, name))
    number = {name: k for k, name in enumerate(names)}
    target = np.array([number[name] for name in called], dtype=int)
    return replace(points, target=target, target_names=tuple(names))


def block_of(target: str, blocks: tuple[str, ...], plain: str) -> tuple[str, str]:
    """The plain name of a target and its block.

    Parameters
    ----------
    target : str
        As `own_targets` calls it.
    blocks : tuple of str
        Their names.
    plain : str
        The block of targets with plain names.

    Returns
    -------
    name, block : str
    """
    for block in sorted(blocks, key=len, reverse=True):
        if target.endswith(f"{MARK}{block}"):
            return target.removesuffix(f"{MARK}{block}"), block
    return target, plain
