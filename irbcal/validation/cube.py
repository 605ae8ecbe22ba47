"""The test cube of ISO 9283:1998 and the five test poses on its inclined plane (Nubiola 2011, annex I, Table A I-1).

The standard itself was not at hand: the cube is that of public descriptions and of the thesis (section 7.2).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray
from irbcal.errors import RobotError
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.inverse import closed_form
from irbcal.summary import Paragraph, Result, Table
from irbcal.thesis_setup import IRB1600_CUBE
from irbcal.units import MM

if TYPE_CHECKING:
    import pandas as pd

POSES = ("P1", "P2", "P3", "P4", "P5")

FRACTION = float(0.1 * np.sqrt(2.0 / 3.0))
"""Distance of P2 to P5 from the corners as a share of the cube's diagonal, as the thesis has it: 8.2 %.

ISO 9283 asks for (10 +- 2) %; the thesis's 91.9 mm (Table A I-1) are 10 % of the diagonal of a face.
"""

Plane: TypeAlias = Literal["x=z", "x=-z", "y=z", "y=-z"]

PLANES: dict[Plane, tuple[tuple[int, int, int], ...]] = {
    "x=z": ((1, 1, 1), (1, -1, 1), (-1, -1, -1), (-1, 1, -1)),
    "x=-z": ((1, 1, -1), (1, -1, -1), (-1, -1, 1), (-1, 1, 1)),
    "y=z": ((1, 1, 1), (-1, 1, 1), (-1, -1, -1), (1, -1, -1)),
    "y=-z": ((1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1)),
}
"""Inclined planes of the cube, and the directions of P2 to P5 from its centre; the thesis took ``x=z``."""

CUBES: dict[str, tuple[ArrayLike, float]] = {
    "irb1600_6_145": IRB1600_CUBE,
    "irb120_3_058": ((0.374, 0.0, 0.40), 0.25),
}
"""Centre in the base link and edge of the test cube of the shipped robots, metres; IRB 1600 as in annex I."""


@dataclass(frozen=True, eq=False, repr=False)
class FivePoses(Result):
    """The five test poses and the joints that reach them.

    Attributes
    ----------
    arm : Arm
    T_base_tip : ndarray, shape (5, 4, 4)
        The tip in the base link, metres.
    q : ndarray, shape (5, joints)
        Radians (metres for prismatic joints).
    """

    arm: Arm
    T_base_tip: FloatArray
    q: FloatArray

    def to_frame(self) -> pd.DataFrame:
        """The poses as a table.

        Returns
        -------
        DataFrame
            ``pose``, the arm's joint columns (degrees, mm), ``x_mm``, ``y_mm``, ``z_mm`` and the unit quaternion ``qw``
            to ``qz`` (scalar first, ``qw`` not negative) of the tip in the base link: what `irbcal plan` and
            ``commanded`` of `irbcal.validation.iso9283_check.iso9283` take.
        """
        import pandas as pd

        T = self.arm.forward(self.q)
        wxyz = frames.quaternion_from_matrix(T[:, :3, :3])
        columns = [*self.arm.joint_columns, "x_mm", "y_mm", "z_mm", "qw", "qx", "qy", "qz"]
        numbers = np.column_stack([self.arm.to_controller(self.q) / self.arm.joint_units, T[:, :3, 3] / MM, wxyz])
        table = pd.DataFrame(numbers, columns=columns)
        table.insert(0, "pose", POSES)
        return table

    CONTENT = "robot=arm.name poses=to_frame"

    def report(self) -> Sequence[Paragraph]:
        """The poses, one a row."""
        sentence = f"The five test poses of ISO 9283 for {self.arm.name}, P1 in the centre of its cube."
        return [sentence, Table.of("Joints and tip in the base link, degrees and mm", self.to_frame())]


def cube_poses(
    center: ArrayLike, edge: float, rotation: FloatArray, plane: Plane = "x=z", fraction: float = FRACTION
) -> FloatArray:
    """P1 in the centre of a cube parallel to the base, P2 to P5 on the diagonals of an inclined plane.

    Parameters
    ----------
    center : array_like, shape (3,)
        Metres, in the base link.
    edge : float
        Metres.
    rotation : ndarray, shape (3, 3)
        Orientation of the tip, the same in all poses.
    plane : str
        One of `PLANES`.
    fraction : float
        Distance from the corners as a share of the cube's diagonal.

    Returns
    -------
    ndarray, shape (5, 4, 4)

    Raises
    ------
    RobotError
        If the plane is none or the sizes make no cube.
    """
    if plane not in PLANES:
        raise RobotError(f"the inclined planes of the cube are {', '.join(PLANES)}, not {plane!r}")
    if not (edge > 0 and 0 <= fraction < 0.5):
        raise RobotError(
            f"a test cube needs an edge above zero and points between centre and corners, found {edge:g} m"
        )
    T = np.tile(frames.transform(rotation, center), (5, 1, 1))
    T[1:, :3, 3] += np.array(PLANES[plane]) * edge * (0.5 - fraction)
    return T


def five_poses(
    arm: Arm,
    center: ArrayLike | None = None,
    edge: float | None = None,
    near: ArrayLike | None = None,
    plane: Plane = "x=z",
    fraction: float = FRACTION,
) -> FivePoses:
    """The five test poses and the joints that reach them; the tip keeps the orientation it has at ``near``.

    Parameters
    ----------
    arm : Arm
        Nominal.
    center, edge : optional
        See `cube_poses`; shipped robots have their own (`CUBES`).
    near : array_like, shape (joints,), optional
        Joints that set the tip's orientation, and which the solutions are to be near, radians; zero (or the nearest to
        it within the limits) unless given.
    plane, fraction
        See `cube_poses`.

    Raises
    ------
    RobotError
        If there is no cube for this arm or a pose is out of reach.
    """
    if (center is None or edge is None) and arm.name not in CUBES:
        raise RobotError(f"no test cube is known for {arm.name}: give its centre and its edge")
    center = CUBES[arm.name][0] if center is None else center
    edge = CUBES[arm.name][1] if edge is None else edge
    home = np.clip(np.zeros(len(arm.lower)), arm.lower, arm.upper)
    at = home if near is None else arm.check_joints(near)[0]
    T = cube_poses(center, edge, arm.forward(at[None])[0, :3, :3], plane, fraction)
    if closed_form.has_closed_form(arm):
        q, branch = closed_form.nearest(arm, closed_form.branches(arm, T), at)
        reached = branch >= 0
    else:
        from irbcal.modeling.inverse import any_arm
        from irbcal.modeling.robot import Robot

        solution = any_arm.solve(Robot(arm), arm, T, at)
        q, reached = solution.joints, solution.converged & solution.inside
    if not reached.all():
        k = int(np.flatnonzero(~reached)[0])
        x, y, z = T[k, :3, 3] / MM
        raise RobotError(
            f"{arm.name} does not reach {POSES[k]} at {x:.1f}, {y:.1f}, {z:.1f} mm within its joint limits: choose a "
            "smaller cube, another centre or another orientation"
        )
    return FivePoses(arm, T, q + 0.0)
