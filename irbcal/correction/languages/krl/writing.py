"""How KUKA writes targets, and its S and T."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.correction import orientations
from irbcal.correction.listing import Edit
from irbcal.correction.maker import Maker, Posture
from irbcal.correction.maker_program import MakerProgram
from irbcal.correction.text_program import Target
from irbcal.units import DEG, MM

KUKA = Maker(
    name="KRL",
    orientation=orientations.KUKA,
    length=MM,
    angle=DEG,
    joint=DEG,
    decimals=(6, 6, 6),
    axes=("-z", "+y", "+y", "-x", "+y", "-x"),
    matrix=np.eye(6),
    reference=(0.0, -90.0, 90.0, 0.0, 0.0, 0.0),
)
"""The reference stands upright with the forearm forward, S = 2: its elbow bit is set."""

_STATUS = 7


def integer(text: str) -> int | None:
    """Value of S or T: a whole number, or bits or hexadecimal digits in quotes; None for anything else."""
    text = text.strip()
    if re.fullmatch(r"\d{1,9}", text):
        return int(text)
    bits = re.fullmatch(r"'B([01]{1,32})'", text, re.IGNORECASE)
    if bits:
        return int(bits[1], 2)
    digits = re.fullmatch(r"'H([0-9A-F]{1,8})'", text, re.IGNORECASE)
    return int(digits[1], 16) if digits else None


def like(old: str, value: int) -> str:
    """A whole number in the form of another one."""
    if old[:2].upper() == "'B":
        return f"{old[:2]}{value:0{len(old) - 3}b}'"
    if old[:2].upper() == "'H":
        return f"{old[:2]}{value:0{len(old) - 3}X}'"
    return str(value)


def posture_of(status: int, turn: int) -> Posture:
    """What S and T mean; bits 3 and above of S say nothing of joints."""
    negative = [bool(turn >> k & 1) for k in range(6)]
    low = tuple(-np.inf if minus else 0.0 for minus in negative)
    high = tuple(0.0 if minus else np.inf for minus in negative)
    return Posture(bool(status & 1), not status & 2, -1 if negative[4] else 1, low, high)


@dataclass(frozen=True, eq=False, repr=False)
class KrlProgram(MakerProgram):
    """A KRL program as read."""

    def mark(self, fingerprint: str) -> Edit:
        """A comment line."""
        newline = self.listing.newline(self.listing.part(self.mark_at))
        return self.mark_at, self.mark_at, f"; irbcal: fake targets, calibration {fingerprint}{newline}"

    def posture(self, back: bool, bent: bool, negative: bool, joints: FloatArray) -> Posture:
        """S and T of joints."""
        turn = sum(1 << k for k in range(6) if joints[k] < 0)
        return posture_of(int(back) | (0 if bent else 2), turn)

    def posture_edits(self, target: Target, posture: Posture) -> list[Edit]:
        """New text of S and T; upper bits of S stay."""
        out: list[Edit] = []
        for k, (start, end) in enumerate(target.configuration_spans):
            old = self.text[start:end]
            value = integer(old) or 0
            if k == 0:
                wrist = 4 if (posture.wrist or 0) < 0 else 0
                new = (value & ~_STATUS) | (1 if posture.back else 0) | (0 if posture.bent else 2) | wrist
            else:
                new = (value & ~0b111111) | sum(1 << i for i in range(6) if posture.high[i] == 0.0)
            if new != value:
                out.append((start, end, like(old, new)))
        return out
