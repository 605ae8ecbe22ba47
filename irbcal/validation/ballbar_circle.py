"""The circle of a ballbar test: where the tool goes about the ball (Nubiola 2011, annex VI).

The ball may stand below the plane of the circle: the bar is then inclined, and the circle's radius is the shorter leg.
Lengths are in metres, angles in radians.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray
from irbcal.correction.paths import Circle
from irbcal.errors import RobotError
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm


@dataclass(frozen=True, eq=False)
class TiltedCircle(Circle):
    """A whole turn on which the tool leans towards the centre.

    So it did in the second and third test of annex VI (Figures A VI-6 and A VI-9).

    Parameters
    ----------
    tilt : float
        Turn of the tool about the path's tangent, radians; positive: the tip of its z axis leans inwards.
    height : float
        Of the circle's plane above the ball, along the normal, metres.
    """

    tilt: float = 0.0
    height: float = 0.0

    @property
    def ball(self) -> FloatArray:
        """Place of the ball, shape (3,), metres."""
        return self.center - self.height * self.normal

    @property
    def bar(self) -> float:
        """Length of the ballbar, metres."""
        return float(np.hypot(np.linalg.norm(self.T_start[:3, 3] - self.center), self.height))

    def poses(self, s: ArrayLike) -> FloatArray:
        """Poses at fractions ``s`` (n,) of the way, shape (n, 4, 4)."""
        from scipy.spatial.transform import Rotation

        T = super().poses(np.asarray(s, dtype=float))
        out = T[:, :3, 3] - self.center
        tangent = np.cross(self.normal, out / np.linalg.norm(out, axis=1)[:, None])
        inwards = self.tilt if self.T_start[:3, 2] @ self.normal < 0 else -self.tilt
        T[:, :3, :3] = Rotation.from_rotvec(inwards * tangent).as_matrix() @ T[:, :3, :3]
        return T


def circle(
    arm: Arm,
    q_center: ArrayLike,
    bar: float,
    T_tip_tcp: FloatArray | None = None,
    normal: ArrayLike = (0.0, 0.0, 1.0),
    start: ArrayLike = (1.0, 0.0, 0.0),
    height: float = 0.0,
    tilt: float = 0.0,
) -> TiltedCircle:
    """A circular path about the tool's place at given joints (Figure A VI-3).

    Parameters
    ----------
    arm : Arm
        Nominal.
    q_center : array_like, shape (6,)
        Joints at which the tool centre point is in the circle's centre, radians; they set orientation and
        configuration, too.
    bar : float
        Nominal length of the ballbar, metres: the radius, unless the ball stands out of the circle's plane.
    T_tip_tcp : ndarray, shape (4, 4), optional
        The tool; identity unless given.
    normal : array_like, shape (3,)
        The path turns about it, in the base link.
    start : array_like, shape (3,)
        Direction from the centre to the start; made perpendicular to the normal.
    height, tilt : float
        See `TiltedCircle`.

    Raises
    ------
    RobotError
        If the sizes, normal or start make no circle.
    """
    T = arm.forward(arm.check_joints(q_center))[0] @ (np.eye(4) if T_tip_tcp is None else T_tip_tcp)
    axis, out = np.asarray(normal, dtype=float), np.asarray(start, dtype=float)
    if not (bar > abs(height) and np.linalg.norm(axis) > 0):
        raise RobotError("a circle needs a normal, and a ballbar longer than the ball is away from the circle's plane")
    axis = axis / np.linalg.norm(axis)
    out = out - axis * (axis @ out)
    if np.linalg.norm(out) < 1e-6:
        raise RobotError("the start of a circle cannot lie along its normal: give another direction")
    T_start = T.copy()
    T_start[:3, 3] += np.sqrt(bar**2 - height**2) * out / np.linalg.norm(out)
    return TiltedCircle(T_start, T_start, T[:3, 3], axis, 2 * np.pi, tilt, height)


def tool(values: ArrayLike) -> FloatArray:
    """``T_tip_tcp``, shape (4, 4), from a position (3,) in metres or that and a unit quaternion, scalar first, (7,).

    Raises
    ------
    RobotError
        If the quaternion is no unit one.
    """
    numbers = np.asarray(values, dtype=float)
    R = np.eye(3)
    if len(numbers) == 7:
        norm = np.linalg.norm(numbers[3:])
        if abs(norm - 1) > 1e-3:
            raise RobotError(f"the tool's orientation needs a unit quaternion, found one of length {norm:g}")
        R = frames.matrix_from_quaternion(numbers[3:])
    return frames.transform(R, numbers[:3])
