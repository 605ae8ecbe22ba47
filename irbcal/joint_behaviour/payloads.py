"""What a payload adds to the errors of one joint: the same moves with two loads (Nubiola 2011, section 4.3.1)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np

from irbcal.arrays import FloatArray, lock
from irbcal.identification import axes
from irbcal.joint_behaviour.series import Series
from irbcal.measurement.last_moves import STILL
from irbcal.summary import Cell, Table
from irbcal.units import DEG, MM


@dataclass(frozen=True, eq=False)
class PayloadEffect:
    """One joint moved from one home pose with two payloads (Nubiola 2011, Table 4.3).

    Attributes
    ----------
    joint : int
        Counted from 1.
    home : ndarray, shape (joints,)
        Where the other joints stood, radians.
    target : str
        The farthest one from the axis that was seen with both.
    light_kg, heavy_kg : float
    light, heavy : float
        Largest distance of the target's points from their circle and their angle, each payload's own, metres.
    shift : float
        Largest distance between the target's places with the two payloads at one joint angle, reached from the same
        side, in the measuring frame, metres; NaN without such angles.
    """

    joint: int
    home: FloatArray
    target: str
    light_kg: float
    heavy_kg: float
    light: float
    heavy: float
    shift: float

    def __post_init__(self) -> None:
        lock(self)

    def to_dict(self) -> dict[str, Any]:
        """Plain numbers, mm and degrees."""
        return {
            "joint": self.joint,
            "home_deg": [None if k == self.joint - 1 else float(v / DEG) for k, v in enumerate(self.home)],
            "target": self.target,
            "light_kg": self.light_kg,
            "heavy_kg": self.heavy_kg,
            "light_max_mm": self.light / MM,
            "heavy_max_mm": self.heavy / MM,
            "difference_mm": (self.heavy - self.light) / MM,
            "shift_max_mm": None if np.isnan(self.shift) else self.shift / MM,
        }


def payload_effects(series: Sequence[Series]) -> tuple[PayloadEffect, ...]:
    """Pairs of series of one joint at one home pose with different payloads, compared (Nubiola 2011, Table 4.3).

    As there, each payload's errors are those from its own circle, all directions together, zero where the joint is
    zero; what the payload does at that angle, and to the circle itself, is not in them. The shift of the points has it.

    Parameters
    ----------
    series : sequence of Series

    Returns
    -------
    tuple of PayloadEffect
    """
    out = []
    for first, second in combinations([s for s in series if np.isfinite(s.payload_kg)], 2):
        if first.joint != second.joint or first.payload_kg == second.payload_kg:
            continue
        off = np.delete(first.q[0] - second.q[0], first.joint - 1)
        if np.abs(off - 2 * np.pi * np.round(off / (2 * np.pi))).max(initial=0.0) > STILL:
            continue
        light, heavy = sorted((first, second), key=lambda s: s.payload_kg)
        names = [s.points.target_names for s in (light, heavy)]
        radii = dict(zip((names[0][t] for t in light.fit.targets), light.fit.radii, strict=True))
        both = [name for name in radii if name in {names[1][t] for t in heavy.fit.targets}]
        if not both:
            continue
        target = max(both, key=lambda name: float(radii[name]))
        loads, sizes = (light.payload_kg, heavy.payload_kg), (_largest(light, target), _largest(heavy, target))
        shift = _shift(light, heavy, target)
        out.append(PayloadEffect(first.joint, light.q[0], target, loads[0], loads[1], sizes[0], sizes[1], shift))
    return tuple(out)


def _largest(s: Series, target: str) -> float:
    mine = s.points.names() == target
    return float(np.sqrt(s.radial[mine] ** 2 + s.tangential[mine] ** 2 + s.axial[mine] ** 2).max())


def _shift(light: Series, heavy: Series, target: str) -> float:
    """Largest distance between places at the same angle, reached from the same side."""
    found = []
    here, there = (np.flatnonzero(s.points.names() == target) for s in (light, heavy))
    poses, others = light.points.pose[here], heavy.points.pose[there]
    for row, pose in zip(here, poses, strict=True):
        same = np.abs(heavy.turn[others] - light.turn[pose]) < axes.SAME_ANGLE
        same &= (heavy.direction[others] == light.direction[pose]) & (light.direction[pose] != 0)
        if same.any():
            found.append(float(np.linalg.norm(heavy.points.xyz[there[same]].mean(axis=0) - light.points.xyz[row])))
    return max(found, default=float("nan"))


def payload_table(effects: Sequence[PayloadEffect], mark: str = "") -> Table:
    """The effects as Nubiola 2011, Table 4.3, has them."""
    rows: list[tuple[Cell, ...]] = []
    for e in effects:
        home = ", ".join("–" if k == e.joint - 1 else f"{v / DEG:.4g}" for k, v in enumerate(e.home))
        shift = None if np.isnan(e.shift) else e.shift / MM
        loads = f"{e.light_kg:g}, {e.heavy_kg:g}"
        rows.append((str(e.joint), home, e.target, loads, e.light / MM, e.heavy / MM, (e.heavy - e.light) / MM, shift))
    title = f"{mark}Largest errors with two payloads, from each one's circle, and largest shift of the target, mm"

    columns = ("joint", "home, deg", "target", "kg", "lighter", "heavier", "difference", "shift")
    return Table(title, columns, tuple(rows))
