"""Effects of the virtual tracker: scatter, drift, and what it does not see.

Parameters carry their units in their names; see `irbcal.simulation.robot_effects` for where their sizes come from.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from irbcal.arrays import BoolArray, FloatArray
from irbcal.simulation.effect import Effect, Shot
from irbcal.simulation.tracker import behind_arm, turned_away
from irbcal.units import DEG, MM

HOUR = 3600.0


@dataclass(frozen=True)
class Noise(Effect):
    """Scatter of the tracker in range and angle.

    Standard deviations ``a + b r`` along the beam and in each direction across it, independent of one another.
    Nubiola 2011, Table A III-2 has 1 to 2 um for one reflector that stands still, chapter 4 a largest error of 22 um on
    a bar of 1 m: the setting lies between.

    Parameters
    ----------
    range_um, range_um_per_m : float
    across_um, across_um_per_m : float
    """

    name: ClassVar[str] = "noise"
    summary: ClassVar[str] = "scatter of the tracker in range and angle (annex III)"
    range_um: float = 1.0
    range_um_per_m: float = 0.3
    across_um: float = 2.0
    across_um_per_m: float = 1.5

    def points(self, xyz: FloatArray, shot: Shot, rng: np.random.Generator) -> FloatArray:
        """See `Effect.points`."""
        distance = np.linalg.norm(xyz, axis=-1, keepdims=True)
        beam = xyz / distance
        # a vector of three normal numbers, stretched along the beam
        scatter = rng.standard_normal(xyz.shape)
        along = np.sum(scatter * beam, axis=-1, keepdims=True) * beam
        sigma_along = 1e-6 * (self.range_um + self.range_um_per_m * distance)
        sigma_across = 1e-6 * (self.across_um + self.across_um_per_m * distance)
        return xyz + sigma_along * along + sigma_across * (scatter - along)


@dataclass(frozen=True)
class Drift(Effect):
    """The tracker shifts and turns slowly over hours (Nubiola 2011, annex IV: 0.012 mm on average).

    Each of three shifts and three turns is a sine of a period and phase of its own. References on the floor take it
    out.

    Parameters
    ----------
    shift_um : float
        Amplitude along each axis.
    turn_urad : float
        Amplitude about each axis.
    period_h : tuple of float
        Shortest and longest period.
    """

    name: ClassVar[str] = "drift"
    summary: ClassVar[str] = "the tracker shifts and turns slowly over hours (annex IV)"
    shift_um: float = 8.0
    turn_urad: float = 4.0
    period_h: tuple[float, float] = (3.0, 12.0)

    def points(self, xyz: FloatArray, shot: Shot, rng: np.random.Generator) -> FloatArray:
        """See `Effect.points`."""
        period = rng.uniform(*self.period_h, 6) * HOUR
        phase = rng.uniform(0.0, 2 * np.pi, 6)
        waves = 1e-6 * np.sin(2 * np.pi * shot.time_s[..., None] / period + phase)
        return xyz + self.shift_um * waves[..., :3] + np.cross(self.turn_urad * waves[..., 3:], xyz)


@dataclass(frozen=True)
class Visibility(Effect):
    """A target that looks away from the tracker, or that the arm hides, is a lost point (Nubiola 2011, section 7.1).

    References on the floor are always seen.

    Parameters
    ----------
    acceptance_deg : float
        Largest angle between a reflector's direction and the beam.
    link_radius_mm : float
        Of the arm's links between its joints, as seen by the beam.
    """

    name: ClassVar[str] = "visibility"
    summary: ClassVar[str] = "targets that look away or are hidden by the arm are lost (section 7.1)"
    acceptance_deg: float = 30.0
    link_radius_mm: float = 90.0

    def unseen(self, shot: Shot, rng: np.random.Generator) -> BoolArray:
        """See `Effect.unseen`."""
        out = np.zeros(shot.xyz.shape[:2], dtype=bool)
        k = shot.direction.shape[1]
        targets = shot.xyz[:, :k]
        out[:, :k] = turned_away(targets, shot.direction, shot.place, self.acceptance_deg * DEG)
        seen = np.flatnonzero(~out[:, :k].all(axis=1))  # only these poses can still lose something
        radius = self.link_radius_mm * MM
        out[seen, :k] |= behind_arm(targets[seen], shot.origins[seen], shot.place, radius)
        return out

    def for_arm(self, prismatic: BoolArray, size: float) -> Effect:
        """See `Effect.for_arm`."""
        return replace(self, link_radius_mm=self.link_radius_mm * size)


@dataclass(frozen=True)
class Lost(Effect):
    """The tracker does not find a reflector (Nubiola 2011, section 7.7: 0.6 to 3.6 % of the points).

    Parameters
    ----------
    share : float
        Of all points, targets and references.
    """

    name: ClassVar[str] = "lost"
    summary: ClassVar[str] = "now and then the tracker does not find a reflector (section 7.7)"
    share: float = 0.006

    def unseen(self, shot: Shot, rng: np.random.Generator) -> BoolArray:
        """See `Effect.unseen`."""
        return rng.random(shot.xyz.shape[:2]) < self.share
