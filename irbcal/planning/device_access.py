"""Whether a device can be touched or read in a pose: from where the tool comes, and what stands between.

For balls, sockets and planes: the tool's axis (z of the tip link) meets the open side within a cone, and the last part
of the way along it is free, for an arm that touches neither itself nor what carries the features. For strings and
ballbars: the axis points to the anchor within a cone, and the arm leaves the line to it free. For cameras: the board is
whole in the image, seen within a cone about its normal, and the arm leaves the line to its middle free.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, lock
from irbcal.identification.observation_kind import vectors, with_third
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.terms import chain
from irbcal.planning.conditions import Setting, counted
from irbcal.simulation import devices
from irbcal.simulation.devices import BALL, Placed, reach_of
from irbcal.units import DEG, MM

if TYPE_CHECKING:
    from irbcal.planning.collisions import CollisionModel

STAND, BELOW = 40.0 * MM, 60.0 * MM
"""What carries a ball or socket: a ball of this radius so far behind it."""

PATCH, PLATE, GAP = 0.25, 30.0 * MM, 3.0 * MM
"""Planes are patches of this half edge in shares of the reach, so thick, and the plate behind begins so far behind."""

PARTS = 2
"""Places on the last part of the way that are looked at."""

CLOSE = (0.2 * MM, 0.2 * DEG)
"""How near the arm must come to a place and attitude on the way."""


@dataclass(frozen=True, eq=False)
class Access:
    """What poses at a device must allow.

    Parameters
    ----------
    setting : Setting
        Its solids get what carries the features as obstacles (`with_stands`).
    found : Placed
    cone : float
        Largest angle between the tool's axis and what it is turned to, radians.
    approach : float
        Last part of the way along the tool's axis that must be free, metres.
    """

    setting: Setting
    found: Placed
    cone: float
    approach: float

    def __post_init__(self) -> None:
        lock(self)

    @property
    def touched(self) -> bool:
        """Whether the tool touches the features; else a line leads to them."""
        return self.found.device.touched

    @property
    def patch(self) -> float:
        """Half the edge of a plane, metres."""
        return PATCH * reach_of(self.setting.arm)

    def words(self) -> list[str]:
        """The conditions beside those of the setting."""
        to = {"point": "the socket's or ball's open side", "plane": "the surface"}
        angle = f"tool axis within {self.cone / DEG:.0f}° of {to.get(self.found.device.kind, 'the line to the anchor')}"
        if self.found.device.sees:
            angle = f"the whole board in the image, within {self.cone / DEG:.0f}° of its normal"
        if not self.touched:
            end = "the board" if self.found.device.sees else "the anchor"
            return [angle, *([f"the line to {end} free of the arm"] if self.setting.solids else [])]
        way = f"the last {self.approach / MM:.0f} mm along the tool axis reached"
        return [angle, f"{way}, free of the arm and of what carries the features" if self.setting.solids else way]

    def keep(self, feature: str, q: FloatArray) -> tuple[BoolArray, dict[str, int]]:
        """Which poses (n, joints) at a feature can be used, and how many each condition removed."""
        good = self._turned(feature, q)
        removed = {"cone": int((~good).sum())}
        rows = np.flatnonzero(good)
        free, _, others = counted(self.setting, q[rows])
        removed |= others
        good[rows] = free
        rows = np.flatnonzero(good)
        if self.touched:
            good[rows] = self.retreated(q[rows])[1]
            removed["approach"] = len(rows) - int(good.sum())
        elif self.setting.solids is not None and len(rows):
            p = self._points(q[rows])[0]
            theta = self.setting.effective(q[rows])
            good[rows] = ~self.setting.solids.blocked(theta, p[:, None], self.found.middle[feature])[:, 0]
            removed["line"] = len(rows) - int(good.sum())
        return good, removed

    def retreated(self, q: FloatArray) -> tuple[FloatArray, BoolArray]:
        """Joints (n, joints) before the last part of the way, and whether it can be gone, (n,)."""
        arm, setting = self.setting.arm, self.setting
        lower, upper = setting.bounds
        goal = arm.forward(q)
        good = np.ones(len(q), dtype=bool)
        there = q
        for _ in range(PARTS):
            goal[:, :3, 3] -= goal[:, :3, 2] * (self.approach / PARTS)
            there, met = reached(arm, there, goal)
            good &= met & ((there >= lower) & (there <= upper)).all(axis=1)
            rows = np.flatnonzero(good)
            if setting.solids is not None and len(rows):
                good[rows] = ~setting.touching(there[rows])
        return there, good

    def _points(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The tool's point (n, 3) and its axis (n, 3) in the base link."""
        T = self.setting.arm.forward(q)
        return T[:, :3, 3] + T[:, :3, :3] @ np.array(BALL), T[:, :3, 2]

    def _turned(self, feature: str, q: FloatArray) -> BoolArray:
        p, axis = self._points(q)
        middle = self.found.middle[feature]
        if self.found.imaging is not None:
            own, T = dict(self.found.own[feature]), self.setting.arm.forward(q)
            return devices.visible(self.found.imaging, own, T, np.array(BALL), self.cone)
        if self.touched:
            wanted = np.broadcast_to(-_open(self.found, feature), p.shape)
        else:
            wanted = (middle - p) / np.linalg.norm(middle - p, axis=1)[:, None]
        good = np.einsum("ni,ni->n", axis, wanted) >= np.cos(self.cone)
        if self.found.device.kind == "plane":
            Q = with_third(_open(self.found, feature))
            good &= (np.abs((p - middle) @ Q[:, :2]) <= self.patch + 1e-6).all(axis=1)
        return np.asarray(good, dtype=bool)


def with_stands(solids: CollisionModel, found: Placed, arm: Arm) -> None:
    """Put what carries the features of a device in the arm's way; anchors are beside it and carried by nothing here."""
    if found.device.kind == "radius" and not found.bar:
        return
    for name, middle in found.middle.items():
        n = _open(found, name)
        if found.device.kind == "plane":
            edge = 2.0 * PATCH * reach_of(arm)
            solids.add_box(frames.transform(with_third(n), middle - n * (GAP + PLATE / 2)), (edge, edge, PLATE))
        else:
            solids.add_obstacle(middle - BELOW * n, STAND)


def _open(found: Placed, feature: str) -> FloatArray:
    """Unit vector to the open side of a feature."""
    return np.array(next(spot.normal for spot in found.device.spots if spot.name == feature))


def reached(arm: Arm, q: FloatArray, goal: FloatArray, steps: int = 6) -> tuple[FloatArray, BoolArray]:
    """Joints near q (n, joints) at which the tip has a place and attitude (n, 4, 4), and whether it has."""
    along = np.where(arm.table.prismatic, 5, 2)
    joint, pose = np.arange(len(along)), np.arange(len(q))
    if not len(q):
        return q, np.zeros(0, dtype=bool)
    good = np.zeros(len(q), dtype=bool)
    for step in range(steps + 1):
        path = chain.walk(arm, q)
        T = chain.poses(path)
        off = goal[:, :3, 3] - T[:, :3, 3]
        turn = vectors(goal[:, :3, :3] @ T[:, :3, :3].transpose(0, 2, 1))
        good = (np.linalg.norm(off, axis=1) < CLOSE[0]) & (np.linalg.norm(turn, axis=1) < CLOSE[1])
        if step == steps or good.all():
            break
        moves = chain.point_columns(path, T[:, :3, 3].T, pose)[joint, along].transpose(2, 1, 0)
        turns = chain.turn_columns(path, pose)[joint, along].transpose(2, 1, 0)
        J = np.concatenate([moves, turns], axis=1)
        q = q + (np.linalg.pinv(J, rcond=1e-3) @ np.concatenate([off, turn], axis=1)[..., None])[..., 0]
    return q, good
