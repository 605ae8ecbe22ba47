"""How Universal Robots write targets: metres, radians and rotation vectors; no configuration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irbcal.correction import orientations
from irbcal.correction.listing import Edit
from irbcal.correction.maker import Maker
from irbcal.correction.maker_program import MakerProgram

UNIVERSAL_ROBOTS = Maker(
    name="URScript",
    orientation=orientations.UNIVERSAL_ROBOTS,
    length=1.0,
    angle=1.0,
    joint=1.0,
    decimals=(9, 9, 9),
    axes=(),
    matrix=np.eye(6),
    world=True,
)


@dataclass(frozen=True, eq=False, repr=False)
class ScriptProgram(MakerProgram):
    """A URScript program as read."""

    def mark(self, fingerprint: str) -> Edit:
        """A comment line."""
        text = f"# irbcal: fake targets, calibration {fingerprint}{self.listing.newline()}"
        return self.mark_at, self.mark_at, text
