"""From measured circles to joint offsets (Nubiola 2011, annex VI): what zeros of joints explain a trace, or its change.

One circle tells a few combinations of joints: each offset has a prior of a natural size, and what the circle does not
show keeps it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms import chain
from irbcal.units import DEG, MM
from irbcal.validation.ballbar_circle import TiltedCircle
from irbcal.validation.ballbar_trace import Trace

PRIOR = 1e-3
"""Standard deviation of a joint's offset before anything was measured, radians (1 mm/m)."""

NOISE = 0.002 * MM
"""Least standard deviation of a reading about what offsets explain, metres: a ballbar's own."""

SEEN = 0.5
"""Share of its prior deviation below which an offset counts as seen."""

CLEAR = 2.0
"""Standard deviations from zero beyond which an offset counts as there."""


@dataclass(frozen=True)
class JointOffset:
    """An offset of a joint.

    Attributes
    ----------
    joint : int
        From 1.
    value, std : float
        Radians.
    """

    joint: int
    value: float
    std: float

    @property
    def seen(self) -> bool:
        """Whether the circle tells it."""
        return self.std < SEEN * PRIOR

    @property
    def clear(self) -> bool:
        """Whether it is there, beyond chance."""
        return self.seen and abs(self.value) > CLEAR * self.std

    def in_words(self) -> str:
        """Joint, offset and deviation."""
        return f"joint {self.joint} by {self.value / DEG:+.4f} ± {self.std / DEG:.4f} deg"


@dataclass(frozen=True)
class JointZeroChange:
    """What joint offsets make of a difference of traces.

    Attributes
    ----------
    offsets : tuple of JointOffset
    before, after : float
        Root mean square of the difference about its mean, and of what the offsets leave of it, metres.
    """

    offsets: tuple[JointOffset, ...]
    before: float
    after: float

    def in_words(self) -> str:
        """Offsets that are there, or that none is."""
        clear = [item.in_words() for item in self.offsets if item.clear]
        if clear:
            found = f"offsets of joints explain it: {', '.join(clear)}"
        else:
            found = "no offset of a single joint is beyond chance"
        unseen = [str(item.joint) for item in self.offsets if not item.seen]
        tail = f" (this circle does not tell joints {', '.join(unseen)})" if unseen else ""
        return f"{self.before / MM:.4f} mm rms, of which {self.after / MM:.4f} mm remain; {found}{tail}"


def by_joints(path: TiltedCircle, robot: Robot, q: FloatArray, T_tip_tcp: FloatArray, angle: FloatArray) -> FloatArray:
    """Derivative of centred radial errors by joint offsets, shape (n, joints), metres per radian.

    Parameters
    ----------
    path : TiltedCircle
    robot : Robot
        Calibrated.
    q : ndarray, shape (m, joints)
        Joints along the path, evenly, from its start.
    T_tip_tcp : ndarray, shape (4, 4)
    angle : ndarray, shape (n,)
        Angles of the readings along the path, radians.
    """
    theta = robot.joint_map.effective(q)
    walk = chain.walk(robot.arm, theta)
    p = walk.tip[3] + np.einsum("acm,a->cm", walk.tip[:3], T_tip_tcp[:3, 3])
    pose = np.arange(len(q))
    moves = chain.point_columns(walk, p, pose)[:, 2]
    away = p.T - path.ball
    along = np.einsum("jcm,mc->mj", moves, away / np.linalg.norm(away, axis=1)[:, None])
    turn = 2 * np.pi * pose / len(q)
    there = np.column_stack([np.interp(angle % (2 * np.pi), turn, column, period=2 * np.pi) for column in along.T])
    A = np.column_stack([np.ones_like(angle), np.cos(angle), np.sin(angle)])
    return np.asarray(there - A @ np.linalg.lstsq(A, there, rcond=None)[0])


def offsets(difference: Trace, columns: FloatArray) -> JointZeroChange:
    """Joint offsets that explain a difference of traces, with their prior.

    Parameters
    ----------
    difference : Trace
    columns : ndarray, shape (n, joints)
        Of `by_joints`, at its angles.
    """
    y = difference.error - difference.error.mean()
    A = np.column_stack([np.cos(difference.angle), np.sin(difference.angle)])
    y = y - A @ np.linalg.lstsq(A, y, rcond=None)[0]
    noise = max(float(np.sqrt(np.mean(y**2))), NOISE)
    for _ in range(20):
        C = np.linalg.inv(columns.T @ columns / noise**2 + np.eye(columns.shape[1]) / PRIOR**2)
        value = C @ (columns.T @ y) / noise**2
        rest = y - columns @ value
        told = columns.shape[1] - float(np.trace(C)) / PRIOR**2
        noise = max(float(np.sqrt(rest @ rest / max(len(y) - 3 - told, 1.0))), NOISE)
    std = np.sqrt(np.diagonal(C))
    found = tuple(JointOffset(j + 1, float(v), float(s)) for j, (v, s) in enumerate(zip(value, std, strict=True)))
    return JointZeroChange(found, float(np.sqrt(np.mean(y**2))), float(np.sqrt(np.mean(rest**2))))


def minus(first: Trace, second: Trace) -> Trace:
    """The difference of two traces at the first one's angles."""
    return Trace(first.angle, first.error - second.at(first.angle), first.shift - second.shift)
