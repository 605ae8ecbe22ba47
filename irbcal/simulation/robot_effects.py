"""Effects of the virtual robot: what it does beyond the 34-parameter model, its way, weight and warmth apart.

Those are in `irbcal.simulation.history_effects`, `irbcal.simulation.weight_effects`,
`irbcal.simulation.turning_effects` and
`irbcal.simulation.warmth_effects`.

Each effect is a small class with a name, parameters whose names carry their units (mm and degrees: they go into the
truth's file as they are) and a reference to Nubiola 2011. Sizes of the shipped setting come from the thesis where it
has them; where it has none they are chosen so that its other statements hold, and the docstring says which.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from irbcal.arrays import BoolArray, FloatArray
from irbcal.modeling.dhm import DHMTable
from irbcal.simulation.effect import Effect, Motion, fitted
from irbcal.units import DEG


@dataclass(frozen=True)
class Tilt(Effect):
    """Axes that should be parallel are not (Nubiola 2011, section 3.1.3).

    Levels 26 and 34 have no parameter for it: theirs (``alpha``) tilts about the common normal only, Hayati's ``beta``
    across it. The size is that of the other angles between axes.

    Parameters
    ----------
    beta_deg : tuple of float
        Tilt of each axis about the y axis of its frame, degrees; joints 1 to n.
    """

    name: ClassVar[str] = "tilt"
    summary: ClassVar[str] = "axes that should be parallel are tilted across their common normal (section 3.1.3)"
    beta_deg: tuple[float, ...] = (0.0, 0.0, 0.014, 0.0, 0.0, 0.0)

    def table(self, table: DHMTable) -> DHMTable:
        """The table with the tilts."""
        return replace(table, beta=table.beta + np.array(self.beta_deg) * DEG)

    def for_arm(self, prismatic: BoolArray, size: float) -> Effect:
        """See `Effect.for_arm`."""
        return replace(self, beta_deg=fitted(self.beta_deg, prismatic, 0.0))


@dataclass(frozen=True)
class Repeatability(Effect):
    """Every move ends a little elsewhere (Nubiola 2011, annex I).

    Nubiola 2011, Table A I-2 has 0.009 to 0.015 mm on average for poses reached from one side.

    Parameters
    ----------
    sigma_deg : tuple of float
        Standard deviation of joints 1 to n, degrees (millimetres for prismatic joints).
    """

    name: ClassVar[str] = "repeatability"
    summary: ClassVar[str] = "every move ends a little elsewhere (annex I)"
    sigma_deg: tuple[float, ...] = (0.00035, 0.00035, 0.00035, 0.0007, 0.0007, 0.0007)

    def joints(self, motion: Motion, rng: np.random.Generator) -> FloatArray:
        """See `Effect.joints`."""
        return rng.standard_normal(motion.q.shape) * np.array(self.sigma_deg) * motion.units

    def for_arm(self, prismatic: BoolArray, size: float) -> Effect:
        """See `Effect.for_arm`."""
        return replace(self, sigma_deg=fitted(self.sigma_deg, prismatic, 0.005))
