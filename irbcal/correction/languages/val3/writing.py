"""How Staubli writes targets, and its shoulder, elbow and wrist."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.correction import orientations
from irbcal.correction.listing import Edit
from irbcal.correction.maker import Maker, Posture
from irbcal.correction.maker_program import MakerProgram
from irbcal.units import DEG, MM

STAUBLI = Maker(
    name="VAL3",
    orientation=orientations.STAUBLI,
    length=MM,
    angle=DEG,
    joint=DEG,
    decimals=(6, 6, 6),
    axes=("+z", "+y", "+y", "+z", "+y", "+z"),
    matrix=np.eye(6),
    reference=(0.0, 0.0, 90.0, 0.0, 0.0, 0.0),
    world=True,
)
"""In the reference the elbow is positive."""


def posture_of(attributes: Mapping[str, str]) -> tuple[Posture, str]:
    """What shoulder, elbow and wrist mean, and why they mean nothing; ``same`` and ``free`` leave it open."""
    shoulder, elbow, wrist = (attributes.get(key, "") for key in ("shoulder", "elbow", "wrist"))
    if shoulder == "righty":
        return Posture(), "its shoulder is righty: how the elbow is counted behind axis 1 is not confirmed"
    known = {
        "shoulder": ("lefty", "ssame", "sfree", ""),
        "elbow": ("epositive", "enegative", "esame", "efree", ""),
        "wrist": ("wpositive", "wnegative", "wsame", "wfree", ""),
    }
    for key, value in (("shoulder", shoulder), ("elbow", elbow), ("wrist", wrist)):
        if value not in known[key]:
            return Posture(), f"its {key} {value[:20]!r} is not known"
    back = False if shoulder == "lefty" else None
    bent = {"epositive": False, "enegative": True}.get(elbow)
    return Posture(back, bent, {"wpositive": 1, "wnegative": -1}.get(wrist)), ""


@dataclass(frozen=True, eq=False, repr=False)
class Val3Program(MakerProgram):
    """A VAL3 application as read."""

    def mark(self, fingerprint: str) -> Edit:
        """A comment of the XML."""
        return self.mark_at, self.mark_at, f"<!-- irbcal: fake targets, calibration {fingerprint.replace('-', '_')} -->"

    def posture(self, back: bool, bent: bool, negative: bool, joints: FloatArray) -> Posture:
        """Shoulder, elbow and wrist of joints."""
        return Posture(back, bent, -1 if negative else 1)
