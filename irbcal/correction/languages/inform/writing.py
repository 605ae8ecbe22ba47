"""How Yaskawa writes targets, and its RCONF."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.correction import orientations
from irbcal.correction.fake_targets import Corrected
from irbcal.correction.listing import Edit
from irbcal.correction.maker import Maker, Posture
from irbcal.correction.maker_program import MakerProgram
from irbcal.correction.program import Goals
from irbcal.correction.text_program import Target
from irbcal.units import DEG, MM

YASKAWA = Maker(
    name="INFORM",
    orientation=orientations.YASKAWA,
    length=MM,
    angle=DEG,
    joint=DEG,
    decimals=(3, 4, 0),
    axes=("+z", "+y", "-y", "-x", "-y", "-x"),
    matrix=np.eye(6),
    world=True,
    wrist_axis=4,
    pulses=True,
)
"""At zero joints the wrist is in front, the elbow above and the wrist flipped."""

HALF = math.pi


def posture_of(rconf: Sequence[int]) -> tuple[Posture, str]:
    """What RCONF means, and why it means nothing that is confirmed."""
    if len(rconf) < 6 or any(value not in (0, 1) for value in rconf[:6]):
        return Posture(), "its RCONF is not understood"
    flip, elbow, back, *turns = rconf[:6]
    if back:
        return Posture(), "its RCONF says behind axis 1: how the elbow is counted there is not confirmed"
    if any(turns):
        return Posture(), "its RCONF says that a joint is beyond 180 degrees: to which side is not confirmed"
    low, high = [-np.inf] * 6, [np.inf] * 6
    for joint in (0, 3, 5):
        low[joint], high[joint] = -HALF, HALF
    return Posture(False, bool(elbow), 1 if flip else -1, tuple(low), tuple(high)), ""


@dataclass(frozen=True, eq=False, repr=False)
class JobProgram(MakerProgram):
    """A job as read.

    Attributes
    ----------
    pulses : tuple of float
        Pulses per degree of the six joints; empty where they are not given.
    """

    pulses: tuple[float, ...]

    def mark(self, fingerprint: str) -> Edit:
        """Two comments, because they take 32 characters each."""
        newline = self.listing.newline()
        return self.mark_at, self.mark_at, f"'irbcal fake targets{newline}'{fingerprint}{newline}"

    def joint_units(self, target: Target) -> FloatArray:
        """Radians of one pulse of each joint."""
        return DEG / np.array(self.pulses)

    def posture(self, back: bool, bent: bool, negative: bool, joints: FloatArray) -> Posture:
        """RCONF of joints, turns among them."""
        low, high = [-np.inf] * 6, [np.inf] * 6
        for joint in (0, 3, 5):
            if abs(joints[joint]) < HALF:
                low[joint], high[joint] = -HALF, HALF
        return Posture(back, bent, -1 if negative else 1, tuple(low), tuple(high))

    def refused(self, goals: Goals, fake: Corrected) -> list[str]:
        """Corrections that would need another RCONF, turns among them: several points share one."""
        out = [""] * len(goals.names)
        rows = np.flatnonzero(fake.ok) if goals.kind == "pose" else np.zeros(0, dtype=int)
        for row, new in zip(rows.tolist(), self.postures(fake.q[rows]), strict=True):
            if new != self.targets[int(goals.numbers[row])].configuration:
                out[row] = "its correction would need another RCONF, which other points share"
        return out
