"""How FANUC writes targets, and its CONFIG."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.correction import orientations
from irbcal.correction.listing import Edit, Span
from irbcal.correction.maker import Maker, Posture
from irbcal.correction.maker_program import MakerProgram
from irbcal.correction.text_program import Target
from irbcal.units import DEG, MM

_COUPLED = np.eye(6)
_COUPLED[2, 1] = 1.0  # the pendant measures joint 3 against the horizontal

FANUC = Maker(
    name="FANUC",
    orientation=orientations.FANUC,
    length=MM,
    angle=DEG,
    joint=DEG,
    decimals=(3, 3, 3),
    axes=("+z", "+y", "-y", "-x", "-y", "-x"),
    matrix=_COUPLED,
    aligned=True,
    world=True,
)
"""At zero joints the wrist is in front and the elbow up: ``U T``."""

TURNING = (0, 3, 5)
"""Joints of the three turn numbers, in their order."""

_CONFIG = re.compile(r"\s*([NF])\s*([UD])\s*([TB])\s*,\s*([-+]?\d+)\s*,\s*([-+]?\d+)\s*,\s*([-+]?\d+)\s*\Z")


def config(text: str, start: int) -> tuple[Posture | None, tuple[Span, ...], str]:
    """What a CONFIG means, where its turn numbers stand, and why it means nothing.

    Parameters
    ----------
    text : str
        What stands between the quotes.
    start : int
        Where it begins.
    """
    found = _CONFIG.match(text)
    if found is None:
        what = "is empty" if not text.strip() else f"{text.strip()[:20]!r} is of another kind of arm"
        return None, (), f"its CONFIG {what}"
    wrist, elbow, front = found.group(1, 2, 3)
    if front == "B":
        return None, (), "its CONFIG says B: how U and D are counted behind axis 1 is not confirmed"
    turns = [int(value) for value in found.group(4, 5, 6)]
    spans = tuple((start + found.start(k), start + found.end(k)) for k in (4, 5, 6))
    return posture_of(-1 if wrist == "N" else 1, elbow == "D", turns), spans, ""


def posture_of(wrist: int, down: bool, turns: list[int]) -> Posture:
    """A posture in front of axis 1."""
    low, high = [-np.inf] * 6, [np.inf] * 6
    for joint, turn in zip(TURNING, turns, strict=True):
        low[joint], high[joint] = (2 * turn - 1) * math.pi, (2 * turn + 1) * math.pi
    return Posture(False, down, wrist, tuple(low), tuple(high))


@dataclass(frozen=True, eq=False, repr=False)
class LsProgram(MakerProgram):
    """A FANUC program as read.

    Attributes
    ----------
    mark_number : int
        Number of the mark's line.
    """

    mark_number: int

    def mark(self, fingerprint: str) -> Edit:
        """Comments at the end of the instructions, so that no other line changes its number.

        Two, because older controllers take 32 characters each.
        """
        newline, number = self.listing.newline(), self.mark_number
        text = f"{number:4d}:  !irbcal fake targets ;{newline}{number + 1:4d}:  !{fingerprint} ;{newline}"
        return self.mark_at, self.mark_at, text

    def posture(self, back: bool, bent: bool, negative: bool, joints: FloatArray) -> Posture:
        """CONFIG of joints."""
        turns = [math.floor((joints[k] + math.pi) / (2 * math.pi)) for k in TURNING]
        return posture_of(-1 if negative else 1, bent, turns)._replace(back=back)

    def posture_edits(self, target: Target, posture: Posture) -> list[Edit]:
        """New turn numbers."""
        out: list[Edit] = []
        for joint, (start, end) in zip(TURNING, target.configuration_spans, strict=True):
            turn = round((posture.low[joint] / math.pi + 1) / 2)
            if turn != int(self.text[start:end]):
                out.append((start, end, str(turn)))
        return out
