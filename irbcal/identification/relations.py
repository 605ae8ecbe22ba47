"""What is known between two features: one small class a kind.

A kind is added by a class here and its name in `RELATION_KINDS`; the reader of the features' file
(`irbcal.measurement.features.RELATIONS`) says in which column its value is.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar, TypeAlias

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.measurement.features import ANGLE_BETWEEN, DISTANCE
from irbcal.modeling import frames
from irbcal.modeling.frames import LEVER
from irbcal.units import DEG, MM

Derivatives: TypeAlias = tuple[FloatArray, FloatArray]
"""By steps of both unknowns, each of shape (d,)."""


class RelationKind(ABC):
    """What is known between two features."""

    name: ClassVar[str]
    of: ClassVar[tuple[str, ...]]
    """Unknowns of features, one of which it is of."""
    u95: ClassVar[float]
    """How well it is known unless that is said, metres or radians."""
    metric: ClassVar[bool] = False
    """Whether it tells a length of the size of the arm."""
    lever: ClassVar[float] = 1.0
    """What a unit of the value counts in the fit, metres: 1 of lengths, `LEVER` of angles."""

    @abstractmethod
    def residual(self, first: FloatArray, second: FloatArray, known: float) -> tuple[float, Derivatives]:
        """Known minus predicted value, metres or radians, and the derivatives of the predicted one."""


class Distance(RelationKind):
    """How far two places are apart."""

    name, of, u95, metric = DISTANCE, ("centre",), 0.05 * MM, True

    def residual(self, first: FloatArray, second: FloatArray, known: float) -> tuple[float, Derivatives]:
        """``known - |a - b|``."""
        d = float(np.linalg.norm(first - second))
        by = (first - second) / max(d, 1e-12)
        return known - d, (by, -by)


class AngleBetween(RelationKind):
    """The angle between two lines, two planes' normals, or one of each; neither has a sense: 60 degrees are 120."""

    name, of, u95, lever = ANGLE_BETWEEN, ("line", "normal"), 0.05 * DEG, LEVER

    def residual(self, first: FloatArray, second: FloatArray, known: float) -> tuple[float, Derivatives]:
        """``known - acos(u.w)`` or, where this is nearer, ``known - acos(-u.w)``."""
        u, w = first[:, 2], second[:, 2]
        sine = float(np.linalg.norm(frames.cross(u, w)))
        angle, sense = float(np.arctan2(sine, u @ w)), 1.0
        if abs(known - angle) > abs(known - (np.pi - angle)):
            angle, sense = np.pi - angle, -1.0
        slopes = []
        for axes, other in ((first, w), (second, u)):
            by = np.zeros(2 if axes.shape[1] == 3 else 4)  # a line has a place, too
            by[:2] = sense / max(sine, 1e-12) * np.array([axes[:, 1] @ other, -axes[:, 0] @ other])
            slopes.append(by)
        return known - angle, (slopes[0], slopes[1])


RELATION_KINDS: Mapping[str, RelationKind] = {kind.name: kind for kind in (Distance(), AngleBetween())}
"""Kinds of what is known between two features by name."""
