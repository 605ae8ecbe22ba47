"""The three angles of a spherical wrist from the rotation of the hand (Nubiola 2011, sections 6.1.4 and 6.1.5).

All work is on arrays of one quantity for a block of poses, into room that is given.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray

ON_SINGULARITY = 1e-12
"""Sine of q5 below which q4 is not defined by the pose."""


def of_rotation(
    R: FloatArray,
    plane: FloatArray,
    c23: FloatArray,
    s23: FloatArray,
    q: tuple[Sequence[FloatArray], FloatArray, FloatArray],
    room: FloatArray,
    ahead: ArrayLike = 1.0,
) -> None:
    """Angles q4, q5, q6 with sin q5 >= 0.

    They are of the rotation of the wrist (Nubiola 2011, section 6.1.4, eq. 6.29). q5 and q4 are those of eqs. 6.30,
    6.31 and 6.33; the other branch (eq. 6.32) turns all three. q6 comes from the
    rotation with the angle q4 found undone, which is eqs. 6.36, 6.37 and 6.38 at any q5 and not at the singularity
    (section 6.1.5, eq. 6.35) alone, in place of eq. 6.34: errors of q4 next to it are made good by q6.

    Parameters
    ----------
    R : ndarray, shape (9, n)
        Columns n, o, a of the hand.
    plane : ndarray, shape (6, n)
        n, o, a along the arm's plane, horizontally, and across it.
    c23, s23 : ndarray, shape (..., n)
        Cosine and sine of q2 + q3, of each branch.
    q : tuple
        Takes the angles, radians: those of q4 one by one (as many as the first axis of ``c23``, a sequence of arrays),
        q5 and q6 (arrays like ``c23``).
    room : ndarray, shape (6, ..., n)
        To work in.
    ahead : array_like
        Cosine of the q4 that is taken where the pose leaves it open.
    """
    x, s5, turned, other = room[0], room[1], room[2:4], room[4:6]
    a_r, a_t = plane[2], plane[5]
    c5 = np.multiply(c23, a_r, out=other[0])
    np.subtract(c5, np.multiply(s23, R[8], out=x), out=c5)
    np.multiply(c23, -R[8], out=x)
    np.subtract(x, np.multiply(s23, a_r, out=s5), out=x)  # cos q4 sin q5
    np.multiply(x, x, out=s5)
    np.add(s5, a_t * a_t, out=s5)
    np.sqrt(s5, out=s5)
    y, sines = a_t, [a_t] * len(x)
    singular = s5 < ON_SINGULARITY
    if singular.any():
        x[singular] = np.broadcast_to(ahead, x.shape)[singular]
        y = np.where(singular, 0.0, a_t)
        sines = list(y)
    for values in zip(sines, x, q[0], strict=True):
        np.arctan2(*values)
    np.arctan2(s5, c5, out=q[1])
    along, across, up = (v.reshape(2, *(1,) * (c23.ndim - 1), -1) for v in (plane[:2], plane[3:5], R[2:6:3]))
    np.multiply(along, s23, out=turned)
    np.add(turned, np.multiply(up, c23, out=other), out=turned)
    np.multiply(turned, y, out=turned)
    np.add(turned, np.multiply(across, x, out=other), out=turned)
    np.arctan2(turned[0], turned[1], out=q[2])
