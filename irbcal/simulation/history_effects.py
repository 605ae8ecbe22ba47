"""What the way to a pose leaves: play, friction, swinging, and readings that are taken too early.

Sizes of the shipped setting come from the thesis where it has them, see `irbcal.simulation.robot_effects`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from irbcal.arrays import BoolArray, FloatArray
from irbcal.modeling.arm import Arm
from irbcal.simulation.effect import Amounts, Effect, Motion, fitted
from irbcal.simulation.in_terms import direction_amounts, move_amounts
from irbcal.simulation.masses import Bodies
from irbcal.units import DEG

GAMMA_2_MEDIAN = 1.6783
"""Median of the gamma distribution of shape 2 and scale 1."""
WIDTH = 0.5
"""Move, in degrees (mm of a prismatic joint), that takes up about three quarters of the play."""


@dataclass(frozen=True)
class Backlash(Effect):
    """A joint stops short on the side it came from (Nubiola 2011, section 4.2).

    0.05 degrees on joint 6 are measured there; the rest of the wrist is driven alike and gets less. Gravity loads the
    gears of joints 1 to 3, and Nubiola 2011, Table A I-3 (poses reached from all sides) leaves room for a few
    hundredths of a millimetre only.

    Parameters
    ----------
    peak_to_peak_deg : tuple of float
        Joints 1 to n, degrees (millimetres for prismatic joints): reached from above minus reached from below.
    """

    name: ClassVar[str] = "backlash"
    summary: ClassVar[str] = "a joint stops short on the side it came from (section 4.2)"
    peak_to_peak_deg: tuple[float, ...] = (0.004, 0.002, 0.003, 0.030, 0.020, 0.050)

    def joints(self, motion: Motion, rng: np.random.Generator) -> FloatArray:
        """See `Effect.joints`."""
        return -motion.direction * np.array(self.peak_to_peak_deg) / 2 * motion.units

    def for_arm(self, prismatic: BoolArray, size: float) -> Effect:
        """See `Effect.for_arm`."""
        return replace(self, peak_to_peak_deg=fitted(self.peak_to_peak_deg, prismatic, 0.02))

    def terms(self, arm: Arm, bodies: Bodies) -> Amounts:
        """Direction terms: the same for all moves of more than a degree."""
        return direction_amounts(arm, -np.array(self.peak_to_peak_deg) / 2 * arm.joint_units)


@dataclass(frozen=True)
class Direction(Effect):
    """A joint stops elsewhere when it comes from the other side, and small moves take up a part of that only.

    Beside `Backlash` (Nubiola 2011, section 4.2), which knows sides only: ``size tanh(D / 0.5 degrees)`` with ``D`` the
    joint's last move. Sizes are those that evidence shows on a measured IRB 120. Off in the shipped cells.

    Parameters
    ----------
    size_deg : tuple of float
        Joints 1 to n, degrees (millimetres for prismatic joints): what a long move from below adds.
    """

    name: ClassVar[str] = "direction"
    summary: ClassVar[str] = "as the backlash of section 4.2, less after small moves; off if not asked for"
    size_deg: tuple[float, ...] = (-0.004, -0.003, 0.004, -0.006, -0.005, -0.008)

    def joints(self, motion: Motion, rng: np.random.Generator) -> FloatArray:
        """See `Effect.joints`."""
        return np.array(self.size_deg) * motion.units * np.tanh(motion.move / motion.units / WIDTH)

    def terms(self, arm: Arm, bodies: Bodies) -> Amounts:
        """See `Effect.terms`."""
        return direction_amounts(arm, np.array(self.size_deg) * arm.joint_units)

    def for_arm(self, prismatic: BoolArray, size: float) -> Effect:
        """See `Effect.for_arm`."""
        return replace(self, size_deg=fitted(self.size_deg, prismatic, 0.02))


@dataclass(frozen=True)
class Move(Effect):
    """Where a joint stops depends on how far it came: a share of its move, and its share of the largest move.

    Not in Nubiola 2011, which waits two seconds (annex V) and finds nothing left of the way. Sizes are those that
    evidence shows on a measured IRB 120. Off in the shipped cells.

    Parameters
    ----------
    size_deg : tuple of float
        Joints 1 to n, degrees (millimetres): what is added to the joint that moved most, less to those that moved less.
    share : tuple of float
        Joints 1 to n: of the move, added.
    """

    name: ClassVar[str] = "move"
    summary: ClassVar[str] = "joints stop short in proportion to the move, whatever annex V waits; off if not asked for"
    size_deg: tuple[float, ...] = (0.004, -0.003, 0.003, 0.005, -0.004, 0.004)
    share: tuple[float, ...] = (-6e-5, 4e-5, -5e-5, 6e-5, 5e-5, -4e-5)

    def joints(self, motion: Motion, rng: np.random.Generator) -> FloatArray:
        """See `Effect.joints`."""
        largest = np.abs(motion.move).max(axis=1, keepdims=True)
        part = motion.move / np.where(largest > 0.0, largest, 1.0)
        return np.array(self.size_deg) * motion.units * part + np.array(self.share) * motion.move

    def terms(self, arm: Arm, bodies: Bodies) -> Amounts:
        """See `Effect.terms`."""
        return move_amounts(arm, np.array(self.size_deg) * arm.joint_units, np.array(self.share))

    def for_arm(self, prismatic: BoolArray, size: float) -> Effect:
        """See `Effect.for_arm`."""
        return replace(self, size_deg=fitted(self.size_deg, prismatic, 0.02), share=fitted(self.share, prismatic, 5e-5))


@dataclass(frozen=True)
class Settling(Effect):
    """The arm swings after a move and comes to rest (Nubiola 2011, annex V: after two seconds).

    Joints 1 to 3 overshoot in the direction of the move: ``amplitude exp(-t/tau) cos(2 pi f t)``, t since the stop.

    Parameters
    ----------
    amplitude_deg : float
        At the moment of the stop: about 0.2 mm at arm's length.
    tau_s : float
    frequency_Hz : float
    """

    name: ClassVar[str] = "settling"
    summary: ClassVar[str] = "the arm swings after a move; nothing is left after two seconds (annex V)"
    amplitude_deg: float = 0.012
    tau_s: float = 0.4
    frequency_Hz: float = 8.0

    def joints(self, motion: Motion, rng: np.random.Generator) -> FloatArray:
        """See `Effect.joints`."""
        t = motion.wait_s
        swing = self.amplitude_deg * DEG * np.exp(-t / self.tau_s) * np.cos(2 * np.pi * self.frequency_Hz * t)
        out = np.zeros_like(motion.q)
        arm_joints = np.flatnonzero(~motion.prismatic)[:3]
        out[:, arm_joints] = swing[:, None] * motion.direction[:, arm_joints]
        return out


@dataclass(frozen=True)
class ReadingLag(Effect):
    """The controller reads its joints before the arm stands still (Nubiola 2011, annex V, waits for that).

    All joints' readings lag behind by the same share of the last move, another one for each pose; the arm itself ends
    where it would. Sizes are those of a measured IRB 120, which is not in the thesis: on the joint that moved most the
    lag is 0.041 degrees in the median, 0.02 to 0.07 in half of the poses (a gamma distribution of shape 2), with a
    scatter that the last move does not explain. Off in the shipped cells.

    Parameters
    ----------
    median_deg : float
        Lag of the joint that moved most, degrees (millimetres of a prismatic joint); never more than the whole move.
    scatter_deg : float
        Standard deviation of each reading beside the lag, degrees (millimetres).
    """

    name: ClassVar[str] = "reading_lag"
    summary: ClassVar[str] = (
        "joint readings lag behind by a share of the last move (annex V waits); off if not asked for"
    )
    median_deg: float = 0.041
    scatter_deg: float = 0.005

    def readings(self, motion: Motion, rng: np.random.Generator) -> FloatArray:
        """See `Effect.readings`."""
        move = motion.move / motion.units
        largest = np.abs(move).max(axis=1)
        lag = rng.gamma(2.0, self.median_deg / GAMMA_2_MEDIAN, len(move))
        share = np.minimum(lag / np.where(largest > 0.0, largest, np.inf), 1.0)
        scatter = self.scatter_deg * rng.standard_normal(move.shape)
        return (scatter - share[:, None] * move) * motion.units
