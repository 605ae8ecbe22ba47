"""The region of proof poses: joint ranges and a box in the base link, and their share of what was calibrated.

What is proven in a corner of the workspace says little about the rest: on 12 SIMULATED robots (four arms, 60 fitted
poses) mean + 3 sigma over all calibrated ranges was up to 4.0 times that of poses in a tenth of each joint's range, 2.6
times in a quarter, 1.7 in a half and 1.5 in six tenths (the 90th percentiles are 2.9, 1.9, 1.45 and 1.3).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from irbcal.arrays import FloatArray, Locked
from irbcal.measurement.points import PointSet
from irbcal.modeling import frames
from irbcal.modeling.elsewhere import even_width
from irbcal.modeling.robot import Robot
from irbcal.units import MM

LEAST = 0.6
"""Share of each calibrated range that proof poses must cover to prove anything of the rest."""


@dataclass(frozen=True, eq=False)
class Region(Locked):
    """Where proof poses are.

    Attributes
    ----------
    joint_names, joint_units : tuple of str
        Units are ``deg`` or ``mm``.
    joints : ndarray, shape (2, joints)
        Smallest and largest joints of the poses, in these units.
    box : ndarray, shape (2, 3)
        Smallest and largest coordinates of the measured points in the base link, mm.
    joint_shares, box_shares : ndarray, shape (joints,) and (3,), or None
        Of the calibrated ranges; None where these are not known. That of a joint is the even width, see
        `irbcal.modeling.elsewhere.even_width`.
    """

    joint_names: tuple[str, ...]
    joint_units: tuple[str, ...]
    joints: FloatArray
    box: FloatArray
    joint_shares: FloatArray | None
    box_shares: FloatArray | None

    @property
    def whole(self) -> bool:
        """Whether each calibrated range is covered to `LEAST` or more."""
        if self.joint_shares is None or self.box_shares is None:
            return False
        return bool(min(self.joint_shares.min(), self.box_shares.min()) >= LEAST)

    def joints_in_words(self) -> str:
        """Range of each joint, and its share of the calibrated one."""
        return _ranges(self.joint_names, self.joints, self.joint_units, self.joint_shares)

    def box_in_words(self) -> str:
        """The box, and its share of the calibrated one along each axis."""
        return _ranges(("x", "y", "z"), self.box, ("mm",) * 3, self.box_shares)

    def narrow_in_words(self) -> str:
        """What the poses cover too little of, or that this is not known; an empty text where they cover all."""
        if self.joint_shares is None or self.box_shares is None:
            return "the calibrated ranges are not known"
        names = (*self.joint_names, *(f"{axis} in the base" for axis in "xyz"))
        shares = np.concatenate([self.joint_shares, self.box_shares])
        narrow = [f"{share:.0%} of {name}" for name, share in zip(names, shares, strict=True) if share < LEAST]
        return f"they cover {', '.join(narrow)} as calibrated, where {LEAST:.0%} of each are needed" if narrow else ""

    def to_dict(self) -> dict[str, Any]:
        """As JSON has it."""
        ranges = zip(self.joint_names, self.joint_units, self.joints.T.tolist(), strict=True)
        return {
            "joints": {name: {"unit": unit, "range": values} for name, unit, values in ranges},
            "box_mm": dict(zip("xyz", self.box.T.tolist(), strict=True)),
            "joint_shares": None if self.joint_shares is None else self.joint_shares.tolist(),
            "box_shares": None if self.box_shares is None else self.box_shares.tolist(),
            "least_share": LEAST,
            "whole": self.whole,
        }


def region(robot: Robot, points: PointSet, fit: PointSet | None) -> Region:
    """The region of proof poses.

    Parameters
    ----------
    robot : Robot
        The calibrated one: its base link carries the box.
    points : PointSet
        Of the proof, in the robot's measuring frame.
    fit : PointSet or None
        Fitted points; None where they are not known.
    """
    arm, T_base_world = robot.arm, frames.inverse(robot.T_world_base)
    box = _extent(frames.apply(T_base_world, points.xyz))
    shares: tuple[FloatArray | None, FloatArray | None] = None, None
    if fit is not None and fit.poses:
        fitted_box = _extent(frames.apply(T_base_world, fit.xyz))
        inside = np.clip(box, *fitted_box)
        shares = _share(even_width(points.q, _extent(fit.q)), _extent(fit.q)), _share(inside[1] - inside[0], fitted_box)
    units = tuple("mm" if slides else "deg" for slides in arm.table.prismatic)
    return Region(tuple(arm.joint_names), units, _extent(points.q) / arm.joint_units, box / MM, *shares)


def _extent(rows: FloatArray) -> FloatArray:
    return np.array([rows.min(axis=0), rows.max(axis=0)])


def _share(width: FloatArray, of: FloatArray) -> FloatArray:
    """Shares of ranges; all of a range that has no width."""
    extent = of[1] - of[0]
    return np.where(extent > 0.0, width / np.where(extent > 0.0, extent, 1.0), 1.0)


def _ranges(names: tuple[str, ...], ends: FloatArray, units: tuple[str, ...], shares: FloatArray | None) -> str:
    out = []
    for k, name in enumerate(names):
        share = "" if shares is None else f" ({shares[k]:.0%})"
        out.append(f"{name} {ends[0, k]:.0f} to {ends[1, k]:.0f} {units[k]}{share}")
    return ", ".join(out)
