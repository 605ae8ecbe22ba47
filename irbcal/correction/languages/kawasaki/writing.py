"""How Kawasaki writes targets, and where its base and flange are in a URDF."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.correction import orientations
from irbcal.correction.listing import Edit
from irbcal.correction.maker import Maker
from irbcal.correction.maker_program import MakerProgram
from irbcal.errors import OptionError
from irbcal.files.controller_frames import ControllerFrames
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.units import DEG, MM

KAWASAKI = Maker(
    name="AS",
    orientation=orientations.KAWASAKI,
    length=MM,
    angle=DEG,
    joint=DEG,
    decimals=(6, 6, 6),
    axes=("-z", "-x", "+x", "+z", "+x", "+z"),
    matrix=np.eye(6),
    world=True,
    asks_where=True,
)
"""No configuration stands in its programs."""

NO_WHERE = (
    "how the controller's base and flange are turned against the URDF is not known: give joints and pose of one place "
    "as WHERE shows them, with null tool and null base (--where)"
)
FIT_M, FIT_RAD = 1.0 * MM, 0.1 * DEG
"""By how much a pair of joints and pose may be off."""


def ends(arm: Arm, joints: FloatArray, pose: FloatArray) -> ControllerFrames:
    """The controller's base and flange by one pair of joints and pose.

    They are looked for among quarter turns about z at both ends, with the base at any height: of the six numbers of the
    pair one is fitted, and the others tell whether that holds.

    Parameters
    ----------
    arm : Arm
    joints : ndarray, shape (6,)
        As the controller counts them, radians.
    pose : ndarray, shape (4, 4)
        What it reports with null tool and null base, metres.

    Raises
    ------
    OptionError
        If no such turns fit the pair, or several do.
    """
    T = arm.forward(KAWASAKI.of(arm).joints(joints)[None])[0]
    good, nearest = [], (np.inf, np.inf)
    for base, flange in product(range(4), repeat=2):
        B, F = (frames.from_xyz_angles([0.0, 0.0, 0.0, 0.0, 0.0, k * np.pi / 2]) for k in (base, flange))
        found = frames.inverse(B) @ T @ F
        off = found[:3, 3] - pose[:3, 3]
        B[2, 3] = off[2]
        angle = float(frames.rotation_distance(found[None, :3, :3], pose[None, :3, :3])[0])
        away = float(np.linalg.norm(off[:2]))
        nearest = min(nearest, (away, angle))
        if away < FIT_M and angle < FIT_RAD:
            good.append(ControllerFrames(B, F, True, True))
    if not good:
        raise OptionError(
            f"where: this pose is none of {arm.name} at these joints with quarter turns about z at base and flange: "
            f"the nearest is {nearest[0] / MM:.1f} mm and {nearest[1] / DEG:.2f} degrees off (null tool, null base?)",
            parameter="where",
        )
    if len(good) > 1:
        raise OptionError(
            "where: this pair fits several turns: take one with all joints away from 0", parameter="where"
        )
    return good[0]


@dataclass(frozen=True, eq=False, repr=False)
class AsProgram(MakerProgram):
    """Programs and locations of a Kawasaki file as read."""

    def mark(self, fingerprint: str) -> Edit:
        """A comment line."""
        newline = self.listing.newline(self.listing.part(max(self.mark_at - 1, 0)))
        return self.mark_at, self.mark_at, f"; irbcal: fake targets, calibration {fingerprint}{newline}"
