"""What warmth does to the virtual robot: it grows, and its joints' frames drift to their places.

Sizes of the shipped setting are guesses where the thesis has none, see `irbcal.simulation.robot_effects`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from irbcal.arrays import BoolArray, FloatArray
from irbcal.modeling.arm import Arm
from irbcal.simulation.effect import Amounts, Effect, Motion, fitted
from irbcal.simulation.in_terms import decays, frame_rotations
from irbcal.simulation.masses import Bodies
from irbcal.units import DEG, MM

MINUTE = 60.0


@dataclass(frozen=True)
class WarmUp(Effect):
    """The robot grows and bends while it warms up (Nubiola 2011, section 7.1: one hour before measuring).

    Against the warm robot, with ``w = exp(-(t + before)/tau)``: all lengths are shorter by ``growth w``, joints 2 and 3
    are off by ``joint_deg w``. The size is a guess: 10 K of cast iron, 0.15 mm at arm's length from a cold start.

    Parameters
    ----------
    before_min : float
        How long the robot had been moving before the run, minutes.
    tau_min : float
    growth : float
        Relative growth of all lengths from cold to warm.
    joint_deg : tuple of float
        Of joints 2 and 3, degrees.
    """

    name: ClassVar[str] = "warm_up"
    summary: ClassVar[str] = "the robot grows and bends as it warms up, one hour into it (section 7.1)"
    before_min: float = 60.0
    tau_min: float = 40.0
    growth: float = 1.0e-4
    joint_deg: tuple[float, float] = (0.004, -0.006)

    def cold(self, time_s: FloatArray) -> FloatArray:
        """Share of the warm-up that is still to come, shape (n,)."""
        return np.exp(-(time_s / MINUTE + self.before_min) / self.tau_min)

    def joints(self, motion: Motion, rng: np.random.Generator) -> FloatArray:
        """See `Effect.joints`."""
        out = np.zeros_like(motion.q)
        bending = np.flatnonzero(~motion.prismatic)[1:3]
        out[:, bending] = self.cold(motion.time_s)[:, None] * np.array(self.joint_deg)[: len(bending)] * DEG
        return out

    def tips(self, T: FloatArray, motion: Motion) -> FloatArray:
        """See `Effect.tips`."""
        T = T.copy()
        T[:, :3, 3] *= 1.0 - self.growth * self.cold(motion.time_s)[:, None]
        return T

    def terms(self, arm: Arm, bodies: Bodies) -> Amounts:
        """Growth along the frames and turns of joints 2 and 3; for tools that stand along the last axis."""
        table, T = arm.table, arm.T_base_0
        shifts = np.stack([table.a, table.b, table.d], axis=1)
        shifts[0] += frame_rotations(arm)[0].T @ T[:3, :3].T @ T[:3, 3]
        shifts[-1, 2] += arm.T_last_tip[2, 3]
        turns = np.zeros_like(shifts)
        bending = np.flatnonzero(~table.prismatic)[1:3]
        turns[bending, 2] = np.array(self.joint_deg)[: len(bending)] * DEG
        start = float(np.exp(-self.before_min / self.tau_min))
        return decays(start * turns, -start * self.growth * shifts, self.tau_min)


@dataclass(frozen=True)
class Thaw(Effect):
    """All six motions of all joints' frames drift to nothing as ``exp(-t/tau)`` from the start of the run.

    Where `WarmUp` (Nubiola 2011, section 7.1) grows all lengths alike and turns two joints, every joint has drifts of
    its own here: what the error model's warm-up can describe at most. Sizes are those that evidence shows on a measured
    IRB 120, 0.1 mrad and 0.03 mm. Off in the shipped cells.

    Parameters
    ----------
    tau_min : float
    x_deg, y_deg, z_deg, x_mm, y_mm, z_mm : tuple of float
        Turns and shifts of the frames of joints 1 to n at the start.
    """

    name: ClassVar[str] = "thaw"
    summary: ClassVar[str] = "each joint's frame drifts as the robot warms up, beyond section 7.1; off if not asked for"
    tau_min: float = 12.0
    x_deg: tuple[float, ...] = (0.002, -0.004, 0.003, 0.005, -0.004, 0.003)
    y_deg: tuple[float, ...] = (-0.003, 0.002, -0.005, 0.003, 0.004, -0.002)
    z_deg: tuple[float, ...] = (0.004, 0.006, -0.005, -0.006, 0.005, 0.006)
    x_mm: tuple[float, ...] = (0.02, 0.03, -0.02, 0.01, -0.02, 0.01)
    y_mm: tuple[float, ...] = (-0.01, 0.02, 0.01, -0.02, 0.01, 0.02)
    z_mm: tuple[float, ...] = (0.03, -0.02, 0.02, 0.03, -0.01, -0.02)

    def _start(self) -> tuple[FloatArray, FloatArray]:
        """Turns and shifts at the start, shape (joints, 3) each, radians and metres."""
        turns = np.stack([self.x_deg, self.y_deg, self.z_deg], axis=1) * DEG
        return turns, np.stack([self.x_mm, self.y_mm, self.z_mm], axis=1) * MM

    def frames(self, motion: Motion, rng: np.random.Generator) -> FloatArray:
        """See `Effect.frames`."""
        left = np.exp(-motion.time_s / MINUTE / self.tau_min)
        return np.asarray(left[:, None, None] * np.concatenate(self._start(), axis=1))

    def terms(self, arm: Arm, bodies: Bodies) -> Amounts:
        """See `Effect.terms`."""
        return decays(*self._start(), self.tau_min)

    def for_arm(self, prismatic: BoolArray, size: float) -> Effect:
        """See `Effect.for_arm`."""
        return replace(
            self,
            x_deg=fitted(self.x_deg, prismatic, 0.0),
            y_deg=fitted(self.y_deg, prismatic, 0.0),
            z_deg=fitted(self.z_deg, prismatic, 0.0),
            x_mm=fitted(self.x_mm, prismatic, 0.0),
            y_mm=fitted(self.y_mm, prismatic, 0.0),
            z_mm=fitted(self.z_mm, prismatic, 0.0),
        )
