"""All effects of the virtual cell, by name and in the order in which they act; those that shipped cells leave off."""

from __future__ import annotations

from collections.abc import Iterable

from irbcal.errors import MeasurementError
from irbcal.simulation.effect import Effect
from irbcal.simulation.history_effects import Backlash, Direction, Move, ReadingLag, Settling
from irbcal.simulation.robot_effects import Repeatability, Tilt
from irbcal.simulation.tracker_effects import Drift, Lost, Noise, Visibility
from irbcal.simulation.turning_effects import Gear, Harmonics, Wobble
from irbcal.simulation.warmth_effects import Thaw, WarmUp
from irbcal.simulation.weight_effects import Bending, Compliance

EFFECTS: tuple[type[Effect], ...] = (
    Tilt,
    Compliance,
    Harmonics,
    Backlash,
    Repeatability,
    Settling,
    WarmUp,
    Noise,
    Drift,
    Visibility,
    Lost,
)
"""The effects of the shipped cells in the order in which they act."""

MORE: tuple[type[Effect], ...] = (ReadingLag, Bending, Gear, Wobble, Direction, Move, Thaw)
"""Effects that the shipped cells leave off: `irbcal.simulation.cell.Cell.also` switches them on."""

ALL = EFFECTS + MORE

NAMES = tuple(effect.name for effect in EFFECTS)
"""Names of the effects of the shipped cells."""


def check_names(names: Iterable[str]) -> None:
    """Refuse names of effects that do not exist.

    Raises
    ------
    MeasurementError
        The sentence lists the names.
    """
    for name in names:
        known = [effect.name for effect in ALL]
        if name not in known:
            raise MeasurementError(f"unknown effect {name!r}: effects are {', '.join(known)}", parameter="effect")
