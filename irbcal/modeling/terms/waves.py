r"""Terms as waves: sums of cosines and sines of combinations of joints, as other languages and joint limits take them.

Series of a joint's angle, levers of gravity and payloads are all of the form ::

    f(q) = sum_m Re( w_m exp(i m . q) )

with whole numbers ``m`` of turns of each joint. For a lever that follows from ``R_z(q) = P_0 + P_+ exp(i q) +
P_- exp(-i q)`` for every joint between the axis and the link: `expanded_lever`.
"""

from __future__ import annotations

import cmath
from collections.abc import Iterable, Mapping
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray
from irbcal.modeling.arm import Arm
from irbcal.modeling.frames import rot_z

Turns: TypeAlias = tuple[float, ...]
"""Whole numbers of turns of each joint; the first that is not zero is positive."""
Expansion: TypeAlias = Mapping[Turns, complex]
"""Weights by turns."""

MOST_WAVES = 400
"""Waves that a lever may have: a wrist's have some tens."""
NOTHING = 1e-18
"""Weights below are rounding."""


def summed(expansions: Iterable[Expansion | None]) -> Expansion | None:
    """The sum of expansions; None if one is."""
    out: dict[Turns, complex] = {}
    for expansion in expansions:
        if expansion is None:
            return None
        for turns, weight in expansion.items():
            out[turns] = out.get(turns, 0.0) + weight
    return out


def canonical(weights: Mapping[Turns, complex]) -> dict[Turns, complex]:
    """A real function's expansion in turns whose first number is positive: those of both signs taken together."""
    out = {}
    for turns, weight in weights.items():
        first = next((n for n in turns if n), 0.0)
        if first >= 0.0:
            out[turns] = weight if first == 0.0 else 2.0 * weight
    return out


WaveVectors: TypeAlias = dict[Turns, tuple[complex, complex, complex]]
"""A vector as a sum of waves: its amplitude by turns; numbers of Python, which are quicker for three than an array."""


def _turned(vectors: WaveVectors, joint: int, offset: float, forward: bool) -> WaveVectors:
    """Vectors turned about z by a joint's angle and its offset, or back."""
    out: WaveVectors = {}
    i, phase = (1j if forward else -1j), cmath.exp(1j * offset)
    for turns, (x, y, z) in vectors.items():
        ahead, behind = 0.5 * (x + i * y) * phase, 0.5 * (x - i * y) / phase
        parts = ((0.0, (0j, 0j, z)), (1.0, (ahead, -i * ahead, 0j)), (-1.0, (behind, i * behind, 0j)))
        for step, turned in parts:
            if max(map(abs, turned)) > NOTHING:
                key = (*turns[:joint], turns[joint] + step, *turns[joint + 1 :])
                u, v, w = out.get(key, (0j, 0j, 0j))
                out[key] = (u + turned[0], v + turned[1], w + turned[2])
    return {turns: vector for turns, vector in out.items() if max(map(abs, vector)) > 1e-16}


def _constant(vectors: WaveVectors, R: FloatArray) -> WaveVectors:
    """Vectors in another frame, in which those of theirs is ``R`` (3, 3)."""
    (a, b, c), (d, e, f), (g, h, k) = R.tolist()
    return {
        turns: (a * x + b * y + c * z, d * x + e * y + f * z, g * x + h * y + k * z)
        for turns, (x, y, z) in vectors.items()
    }


def _frame(arm: Arm, joint: int) -> FloatArray:
    """Rotation of a joint's frame, before it turns, in the frame of the link before, shape (3, 3)."""
    table = arm.table
    ca, sa, cb, sb = (f(x[joint]) for x in (table.alpha, table.beta) for f in (np.cos, np.sin))
    R = np.array([[1, 0, 0], [0, ca, -sa], [0, sa, ca]]) @ np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]])
    return arm.T_base_0[:3, :3] @ R if joint == 0 else R


def expanded_lever(
    arm: Arm, joint: int, link: int, vector: ArrayLike, gravity: ArrayLike, most: int = MOST_WAVES
) -> Expansion | None:
    """The lever ``z_j . (R_k v x g)`` of a vector fixed to a link about a joint's axis, as waves.

    Parameters
    ----------
    arm : Arm
        Nominal arm.
    joint, link : int
        From 0; the joint carries the link.
    vector : array_like, shape (3,)
        In the link's frame.
    gravity : array_like, shape (3,)
        In the base link.
    most : int
        Waves that it may have.

    Returns
    -------
    Expansion or None
        None where there would be more waves, or many more on the way.
    """
    table, none = arm.table, (0.0,) * len(arm.joint_names)
    lever, down = (_still(none, values) for values in (vector, gravity))
    for k in range(link, joint - 1, -1):
        turns = 0.0 if table.prismatic[k] else 1.0
        lever = _turned(lever, k, table.theta[k], True) if turns else _constant(lever, rot_z(table.theta[k]))
        lever = _constant(lever, _frame(arm, k)) if k > joint else lever
        if len(lever) > 2 * most + 1:
            return None
    for k in range(joint):
        down = _constant(down, _frame(arm, k).T)
        offset = table.theta[k]
        down = _constant(down, rot_z(-offset)) if table.prismatic[k] else _turned(down, k, offset, False)
    down = _constant(down, _frame(arm, joint).T)
    out: dict[Turns, complex] = {}
    for a, w in lever.items():
        for b, g in down.items():
            turns_of = tuple(x + y for x, y in zip(a, b, strict=True))
            out[turns_of] = out.get(turns_of, 0.0) + complex(w[0] * g[1] - w[1] * g[0])
    waves = {turns: weight for turns, weight in canonical(out).items() if abs(weight) > NOTHING}
    return waves if len(waves) <= most else None


def _still(none: Turns, values: ArrayLike) -> WaveVectors:
    x, y, z = np.asarray(values, dtype=complex).tolist()
    return {none: (x, y, z)}
