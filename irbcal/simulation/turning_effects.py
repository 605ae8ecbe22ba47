"""What repeats with every turn of the virtual robot's joints: uneven gears, harmonic drives, bearings.

Sizes of the shipped setting come from the thesis where it has them, see `irbcal.simulation.robot_effects`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from irbcal.arrays import FloatArray, IntArray
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms.term import AXES
from irbcal.simulation.effect import Amounts, Effect, Motion
from irbcal.simulation.in_terms import sine
from irbcal.simulation.masses import Bodies
from irbcal.units import DEG, MM


@dataclass(frozen=True)
class Harmonics(Effect):
    """Gears that run unevenly: a joint's error repeats some times a turn (Nubiola 2011, sections 4.1 and 4.2).

    The joint-6 series of the second order is in the 34-parameter model and not here. Joints 4 and 5 are driven
    through the forearm like joint 6, with one and two periods a turn; the others have shorter ones. Section 4.1 shows
    that joints 2 and 6 err most at the tool: the sizes here keep those of the other joints below 0.15 mm there.

    Parameters
    ----------
    waves : tuple of (int, float, float, float)
        Joint (from 1; from the last one as -1, -2, ...), periods per turn, amplitude and phase in degrees.
    """

    name: ClassVar[str] = "harmonics"
    summary: ClassVar[str] = "uneven gears on joints 1 to 5, short waves on joint 6 (sections 4.1 and 4.2)"
    waves: tuple[tuple[int, int, float, float], ...] = (
        (1, 3, 0.0040, 35.0),
        (1, 7, 0.0030, 110.0),
        (2, 6, 0.0040, 250.0),
        (3, 5, 0.0050, 70.0),
        (-3, 1, 0.0350, 20.0),
        (-3, 2, 0.0250, 160.0),
        (-2, 2, 0.0250, 300.0),
        (-2, 5, 0.0150, 45.0),
        (-1, 4, 0.0100, 200.0),
    )

    def joints(self, motion: Motion, rng: np.random.Generator) -> FloatArray:
        """See `Effect.joints`."""
        out = np.zeros_like(motion.q)
        turning = np.flatnonzero(~motion.prismatic)
        for joint, periods, amplitude, phase in self.waves:
            if abs(joint) <= len(turning):
                j = turning[joint - 1 if joint > 0 else joint]
                out[:, j] += amplitude * DEG * np.sin(periods * motion.q[:, j] + phase * DEG)
        return out

    def terms(self, arm: Arm, bodies: Bodies) -> Amounts:
        """See `Effect.terms`."""
        turning = np.flatnonzero(~arm.table.prismatic)
        return [
            amount
            for joint, periods, size, phase in self.waves
            if abs(joint) <= len(turning)
            for amount in sine(int(turning[joint - 1 if joint > 0 else joint]), periods, size * DEG, phase * DEG)
        ]


@dataclass(frozen=True)
class Gear(Effect):
    """Harmonic drives swing a joint twice with every turn of their input.

    Not in Nubiola 2011, whose section 4.1 stops at a few periods a turn. On a measured IRB 120, waves of 100, 200, 240
    and 242 periods a turn were found (ratios of 50, 100, 120 and 121), of about 0.003 degrees. Off in shipped cells.

    Parameters
    ----------
    waves : tuple of (int, int, float, float)
        Joint (from 1; from the last one as -1, -2, ...), gear ratio, amplitude and phase in degrees.
    """

    name: ClassVar[str] = "gear"
    summary: ClassVar[str] = (
        "harmonic drives swing a joint twice with every input turn, beyond section 4.1; off if not asked for"
    )
    waves: tuple[tuple[int, int, float, float], ...] = ((-3, 121, 0.0031, 40.0), (-2, 100, 0.0028, 200.0))

    def _each(self, turning: IntArray) -> list[tuple[int, int, float, float]]:
        """Joint (from 0), periods per turn, amplitude and phase (radians) of each wave that the arm has."""
        return [
            (int(turning[joint - 1 if joint > 0 else joint]), 2 * ratio, amplitude * DEG, phase * DEG)
            for joint, ratio, amplitude, phase in self.waves
            if abs(joint) <= len(turning)
        ]

    def joints(self, motion: Motion, rng: np.random.Generator) -> FloatArray:
        """See `Effect.joints`."""
        out = np.zeros_like(motion.q)
        for j, periods, amplitude, phase in self._each(np.flatnonzero(~motion.prismatic)):
            out[:, j] += amplitude * np.sin(periods * motion.q[:, j] + phase)
        return out

    def terms(self, arm: Arm, bodies: Bodies) -> Amounts:
        """See `Effect.terms`."""
        each = self._each(np.flatnonzero(~arm.table.prismatic))
        return [amount for j, periods, size, phase in each for amount in sine(j, periods, size, phase, family="gear")]


@dataclass(frozen=True)
class Wobble(Effect):
    """A joint's axis tilts and shifts as it turns: its bearing runs out, once and twice a turn.

    Not in Nubiola 2011, whose section 3.1.1 finds each axis from circles that it takes for perfect. Sizes are those
    that evidence shows on a measured IRB 120: about 0.05 mrad and 0.02 mm. Off in the shipped cells.

    Parameters
    ----------
    waves : tuple of (int, str, int, float, float)
        Joint (from 1; from the last one as -1, -2, ...), axis of its frame before it turns (``rx``, ``ry``, ``tx``,
        ``ty``, ``tz``), periods per turn, amplitude in degrees (millimetres for shifts) and phase in degrees.
    """

    name: ClassVar[str] = "wobble"
    summary: ClassVar[str] = (
        "bearings run out: axes tilt and shift as they turn, no perfect circles as in section 3.1; off if not asked for"
    )
    waves: tuple[tuple[int, str, int, float, float], ...] = (
        (1, "rx", 1, 0.0030, 30.0),
        (1, "ty", 2, 0.0150, 80.0),
        (2, "rx", 1, 0.0020, 200.0),
        (3, "tz", 1, 0.0200, 10.0),
        (-3, "rx", 1, 0.0040, 130.0),
        (-3, "ry", 2, 0.0030, 250.0),
        (-2, "tx", 1, 0.0200, 300.0),
        (-1, "ry", 1, 0.0040, 60.0),
    )

    def _each(self, turning: IntArray) -> list[tuple[int, str, int, float, float]]:
        """Joint (from 0), axis, periods per turn, amplitude (radians or metres) and phase of each wave of the arm."""
        return [
            (
                int(turning[joint - 1 if joint > 0 else joint]),
                axis,
                periods,
                size * (DEG if axis[0] == "r" else MM),
                phase * DEG,
            )
            for joint, axis, periods, size, phase in self.waves
            if abs(joint) <= len(turning)
        ]

    def frames(self, motion: Motion, rng: np.random.Generator) -> FloatArray:
        """See `Effect.frames`."""
        out = np.zeros((*motion.q.shape, 6))
        for j, axis, periods, size, phase in self._each(np.flatnonzero(~motion.prismatic)):
            out[:, j, AXES.index(axis)] += size * np.sin(periods * motion.q[:, j] + phase)
        return out

    def terms(self, arm: Arm, bodies: Bodies) -> Amounts:
        """See `Effect.terms`."""
        return [
            amount
            for j, axis, periods, size, phase in self._each(np.flatnonzero(~arm.table.prismatic))
            for amount in sine(j, periods, size, phase, axis, "wobble")
        ]
