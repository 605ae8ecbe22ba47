"""A run of joint moves that a language writes as a robot program: see ``write_moves`` of each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from irbcal.arrays import FloatArray, Locked
from irbcal.correction.maker import Maker
from irbcal.modeling.arm import Arm
from irbcal.modeling.commanded_joints import DECIMALS
from irbcal.names import comment
from irbcal.units import DEG


class JointMove(NamedTuple):
    """A joint move, and a rest behind it."""

    comment: str
    """Before it; none where empty."""
    wait_s: float
    """Seconds; none where zero."""
    share: float
    """Speed as a share (0 to 1) of the robot's largest joint speeds."""
    joint_speed: float
    """Of the joint that turns most, rad/s."""

    @property
    def percent(self) -> int:
        """Speed in percent, 1 to 100."""
        return min(max(round(100 * self.share), 1), 100)


@dataclass(frozen=True, eq=False)
class Moves(Locked):
    """Joint moves of an arm in their order."""

    arm: Arm
    """What the controller computes with."""
    q: FloatArray
    """Shape (n, 6). Joints of the URDF, radians."""
    moves: tuple[JointMove, ...]
    """Length n."""
    head: tuple[str, ...] = ()
    """Comments at the begin."""
    tip_speed: float = 0.5
    """m/s, for languages that take it."""
    pulses: tuple[float, ...] = ()
    """Pulses per degree of the joints, for languages that write these."""

    def degrees(self, maker: Maker | None = None) -> FloatArray:
        """Joints as the controller counts them, degrees, rounded to `DECIMALS`, shape (n, 6)."""
        q = self.arm.to_controller(self.q) if maker is None else maker.for_arm(self.arm).program_joints(self.q)
        return np.round(q / DEG, DECIMALS) + 0.0

    def texts(self, maker: Maker | None = None) -> list[list[str]]:
        """The same as written."""
        return [[f"{value:.{DECIMALS}f}" for value in row] for row in self.degrees(maker)]


def note(text: str, longest: int = 160, without: str = "") -> str:
    """A comment's text, not longer, and without characters that would end it in a language."""
    return comment("".join("," if char in without else char for char in comment(text))[:longest])
