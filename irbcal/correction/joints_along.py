"""Joints along a path, and where they turn back: there backlash disturbs the path (Nubiola 2011, annex VI)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray
from irbcal.correction.path import ToolPath
from irbcal.errors import RobotError
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.inverse import closed_form, own_model


def joint_history(
    path: ToolPath, nominal: Arm, seed: ArrayLike, s: ArrayLike, T_tip_tcp: FloatArray | None = None
) -> FloatArray:
    """Joints of the nominal robot along a path, in the branch of the seed and without jumps by whole turns.

    These are the joint histories of Nubiola 2011, Figures A VI-2, A VI-5 and A VI-8.

    Parameters
    ----------
    path : Line or Circle
        Of the tool centre point, in the base link.
    nominal : Arm
    seed : ndarray, shape (6,)
        Joints at (or near) the start, radians.
    s : ndarray, shape (n,)
        Places on the path.
    T_tip_tcp : ndarray, shape (4, 4), optional
        The tool; identity unless given.

    Returns
    -------
    ndarray, shape (n, 6)
        Radians.

    Raises
    ------
    RobotError
        If the robot does not reach every place in that branch.
    """
    return joints_along(path.poses(s) @ tip_of(T_tip_tcp), nominal, seed)


def tip_of(T_tip_tcp: FloatArray | None) -> FloatArray:
    """The tip in the tool centre point, ``T_tcp_tip``; identity for no tool."""
    return np.eye(4) if T_tip_tcp is None else frames.inverse(T_tip_tcp)


def joints_along(T_base_tip: FloatArray, nominal: Arm, seed: ArrayLike, own: Arm | None = None) -> FloatArray:
    """Joints of the nominal robot, or of another one that is near it, for a row of tip poses; see `joint_history`."""
    branch = closed_form.configuration(nominal, np.asarray(seed, dtype=float))
    branches = own_model.branches(nominal, T_base_tip, own)
    q = branches.joints[:, int(branch)]
    if not np.isfinite(q).all():
        place = int(np.flatnonzero(~np.isfinite(q).all(axis=1))[0])
        raise RobotError(f"the robot does not reach point {place + 1} of {len(q)} of the path in its configuration")
    return np.unwrap(np.vstack([np.asarray(seed, dtype=float), q]), axis=0)[1:]


@dataclass(frozen=True)
class Reversal:
    """A joint that turns back on a path: where backlash is to be expected.

    Attributes
    ----------
    s : float
        Place on the path, fraction of the way.
    joint : int
        Counted from 1.
    angle : float
        Of the joint there, radians.
    kind : str
        ``min`` or ``max``.
    """

    s: float
    joint: int
    angle: float
    kind: Literal["min", "max"]


def reversals(q: FloatArray, s: FloatArray, least: float = 1e-4) -> list[Reversal]:
    """Local minima and maxima of each joint along a path (Nubiola 2011, Tables A VI-1, A VI-2 and A VI-3).

    Places are refined by the parabola through three neighbouring samples.

    Parameters
    ----------
    q : ndarray, shape (n, 6)
        Joint history, radians, without jumps by whole turns.
    s : ndarray, shape (n,)
        Evenly spaced places on the path.
    least : float
        Ignore joints that move by less than this over the whole path, radians.

    Returns
    -------
    list of Reversal
        In the order of the path.
    """
    found = []
    step = s[1] - s[0]
    for j in range(q.shape[1]):
        if np.ptp(q[:, j]) < least:
            continue
        change = np.diff(q[:, j])
        turns = np.flatnonzero(np.sign(change[1:]) * np.sign(change[:-1]) < 0) + 1
        for k in turns:
            a, b, c = q[k - 1 : k + 2, j]
            offset = 0.5 * (a - c) / (a - 2 * b + c)
            kind: Literal["min", "max"] = "max" if b > a else "min"
            found.append(Reversal(float(s[k] + offset * step), j + 1, float(b - 0.25 * (a - c) * offset), kind))
    return sorted(found, key=lambda item: (item.s, item.joint))
