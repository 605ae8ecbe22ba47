"""A part in a fixture of the virtual cell: tool and work object taught by touching, a program run, the part measured.

The controller computes with the nominal robot. It takes the tool from touches of one place, the work object from three
points of the fixture, and its program names poses of the tool in the work object. What the part is off by is where the
true tool is in the true fixture, less where it was wanted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from irbcal.arrays import FloatArray, Locked
from irbcal.correction.declarations import declared
from irbcal.correction.maker import configuration_of
from irbcal.correction.notation import numbers_from_poses
from irbcal.distributions import NORMAL_95
from irbcal.errors import RobotError
from irbcal.examples.measurements import reached
from irbcal.modeling import frames
from irbcal.modeling.commanded_joints import home_joints
from irbcal.modeling.inverse import closed_form
from irbcal.simulation.effects import size_of
from irbcal.simulation.virtual_cell import VirtualCell
from irbcal.units import DEG, MM

if TYPE_CHECKING:
    import pandas as pd

POINTS = {"origin": (0.0, 0.0), "x": (0.2, 0.0), "xy": (0.05, 0.15)}
"""Points of the fixture that are touched, as shares of the arm's size."""
GRID = np.stack(np.meshgrid([0.0, 0.1, 0.2], [0.0, 0.075, 0.15], [0.0, 0.05], indexing="ij"), axis=-1).reshape(-1, 3)
"""Places of the fixture to which the program goes, likewise."""
SIDES = 6
LARGEST_TURN = 20 * DEG
"""Of the tool from its attitude in the middle, about each axis."""
TILT = 35 * DEG
"""Of the tool in the middle from pointing down: upright it would be next to the wrist's singularity."""
TRIED = 300
"""Places of the fixture at most."""


@dataclass(frozen=True, eq=False)
class PartCell(Locked):
    """A virtual cell with a tool, a fixture, and a program in it."""

    cell: VirtualCell
    tip: FloatArray
    """Shape (3,). True tip of the tool in the tip link, metres; its axes are the tip link's."""
    T_base_object: FloatArray
    """Shape (4, 4). True fixture in the base link."""
    T_wanted: FloatArray
    """Shape (n, 4, 4). Poses of the tool in the work object to which the program goes."""
    sides: FloatArray
    """Shape (SIDES, joints). Joints near those at which the tip touches one place in the fixture, radians."""
    corners: FloatArray
    """Shape (3, joints). Likewise of the fixture's points."""

    @staticmethod
    def from_cell(cell: VirtualCell, seed: int = 0) -> PartCell:
        """The same for any six-axis arm with a closed-form inverse: a fixture in front of it, the tool pointing down.

        Raises
        ------
        RobotError
            If no place for the fixture is found.
        """
        arm, rng = cell.arm, np.random.default_rng(seed)
        size = size_of(arm)
        tip = np.array([0.01, -0.02, 0.12]) * size
        home = home_joints(arm)
        q = home + 0.5 * (arm.random_joints(20_000, seed) - home)
        T = arm.forward(q)
        place = T[:, :3, :3] @ tip + T[:, :3, 3]
        off = np.linalg.norm(place - np.array([0.45, -0.1, 0.25]) * size, axis=1) / size
        tilt = np.arccos(np.clip(-T[:, 2, 2], -1.0, 1.0))
        for k in np.argsort(off + np.abs(tilt - TILT))[:TRIED]:
            down = T[k, :3, :3]
            R = frames.rot_z(float(np.arctan2(down[1, 0], down[0, 0])))
            T_object = frames.transform(R, place[k])
            turns = rng.uniform(-LARGEST_TURN, LARGEST_TURN, (len(GRID) + SIDES + len(POINTS), 3))
            corners = np.array([[*xy, 0.0] for xy in POINTS.values()])
            xyz = size * np.vstack([GRID, np.tile(GRID.mean(axis=0), (SIDES, 1)), corners])
            T_tool = np.array(
                [
                    frames.transform(R.T @ down @ frames.rotation_from_vector(turn), at)
                    for turn, at in zip(turns, xyz, strict=True)
                ]
            )
            T_tip = T_object @ T_tool @ frames.inverse(frames.transform(None, tip))
            joints, _ = closed_form.nearest(arm, closed_form.branches(arm, T_tip), q[k])
            if np.abs(joints - q[k]).max() < np.pi / 2:  # not where some are out of reach: those are NaN
                n = len(GRID)
                return PartCell(cell, tip, T_object, T_tool[:n], joints[n : n + SIDES], joints[n + SIDES :])
        raise RobotError(f"no fixture that {arm.name} reaches was found")

    def touches(self, noise: float = 0.0, seed: int = 0, from_all_sides: bool = False) -> pd.DataFrame:
        """A table of touches, joints as the controller shows them.

        Parameters
        ----------
        noise : float
            Standard deviation of a touch in each direction, metres.
        seed : int
        from_all_sides : bool
            Come to each touch from another side, so that backlash acts by chance; else from the touch before.
        """
        import pandas as pd

        size = size_of(self.cell.arm)
        corners = np.array([[*xy, 0.0] for xy in POINTS.values()]) * size
        socket = np.tile(GRID.mean(axis=0) * size, (SIDES, 1))
        xyz = frames.apply(self.T_base_object, np.vstack([socket, corners]))
        rng, near = np.random.default_rng(seed), np.vstack([self.sides, self.corners])
        xyz = xyz + rng.normal(scale=noise, size=xyz.shape) if noise else xyz
        starts = near + rng.uniform(-LARGEST_TURN, LARGEST_TURN, near.shape) if from_all_sides else None
        q = reached(self.cell, near, self.tip, xyz, starts)
        head = {
            "frame": ["tool"] * SIDES + ["work_object"] * len(POINTS),
            "name": ["tGrip"] * SIDES + ["wPart"] * len(POINTS),
            "point": ["socket"] * SIDES + [*POINTS],
            "tool": "tGrip",
            "u95_mm": max(NORMAL_95 * noise, 0.001 * MM) / MM,
        }
        return pd.DataFrame(head | self.cell.arm.joint_table(q, 7))

    def least_squares(self, noise: float, draws: int = 300) -> float:
        """Mean error of the part, metres, that the touches leave where the robot is known exactly.

        Tool and place by least squares, the work object by its three points, the touches drawn with a noise (standard
        deviation in each direction, metres).
        """
        arm = self.cell.arm
        q = arm.from_controller(self.touches()[list(arm.joint_columns)].to_numpy() * arm.joint_units)
        T, rng, errors = self.cell.measure(q).T_base_tip, np.random.default_rng(0), []
        A = np.concatenate([np.hstack([R, -np.eye(3)]) for R in T[:SIDES, :3, :3]])
        for _ in range(draws):
            at = T[:, :3, 3] + rng.normal(scale=noise, size=(len(T), 3))
            tip = np.linalg.lstsq(A, -at[:SIDES].ravel(), rcond=None)[0][:3]
            origin, x, xy = T[SIDES:, :3, :3] @ tip + at[SIDES:]
            e_x, normal = (x - origin) / np.linalg.norm(x - origin), frames.cross(x - origin, xy - origin)
            e_z = normal / np.linalg.norm(normal)
            T_object = frames.transform(np.column_stack([e_x, frames.cross(e_z, e_x), e_z]), origin)
            T_tip = T_object @ self.T_wanted @ frames.inverse(frames.transform(None, tip))
            errors.append(self._off(T_tip).mean())
        return float(np.mean(errors))

    def program(self, tool: FloatArray, work_object: FloatArray) -> str:
        """A RAPID module with the wanted poses, for a controller that has this tool and work object, (4, 4) each."""
        arm = self.cell.arm
        T = work_object @ self.T_wanted @ frames.inverse(tool)
        q, _ = closed_form.nearest(arm, closed_form.branches(arm, T), self.corners[0])
        cfx = closed_form.configuration(arm, q)
        lines, moves = [], []
        for k, row in enumerate(numbers_from_poses(self.T_wanted)):
            xyz, turn = (
                ",".join(f"{number:.{digits}f}" for number in part) for part, digits in ((row[:3], 6), (row[3:], 10))
            )
            conf = ",".join(map(str, configuration_of(q[k], int(cfx[k]))))
            lines.append(f"  CONST robtarget p{k}:=[[{xyz}],[{turn}],[{conf}],[9E9,9E9,9E9,9E9,9E9,9E9]];")
            moves.append(f"    MoveJ p{k},v100,fine,tGrip\\WObj:=wPart;")
        frames_text = declared("abb", {"tGrip": tool}, {"wPart": work_object}).removesuffix("ENDMODULE\n")
        return "\n".join([frames_text + lines[0], *lines[1:], "  PROC main()", *moves, "  ENDPROC", "ENDMODULE", ""])

    def errors(self, q: FloatArray) -> FloatArray:
        """Distance of the true tool from where it is wanted in the true fixture at commanded joints, (n,), metres."""
        return self._off(self.cell.measure(q).T_base_tip)

    def _off(self, T_base_tip: FloatArray) -> FloatArray:
        T = frames.inverse(self.T_base_object) @ T_base_tip
        return np.linalg.norm(T[:, :3, :3] @ self.tip + T[:, :3, 3] - self.T_wanted[:, :3, 3], axis=1)
