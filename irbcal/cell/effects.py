"""All effects of the virtual cell, by name and in the order in which they act."""

from __future__ import annotations

from collections.abc import Iterable

from irbcal.cell.effect import Effect
from irbcal.cell.robot_effects import Backlash, Compliance, Harmonics, Repeatability, Settling, Tilt, WarmUp
from irbcal.cell.tracker_effects import Drift, Lost, Noise, Visibility
from irbcal.errors import MeasurementError

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
"""All effects in the order in which they act."""

NAMES = tuple(effect.name for effect in EFFECTS)


def check_names(names: Iterable[str]) -> None:
    """Refuse names of effects that do not exist.

    Raises
    ------
    MeasurementError
        The sentence lists the names.
    """
    for name in names:
        if name not in NAMES:
            raise MeasurementError(f"unknown effect {name!r}: effects are {', '.join(NAMES)}", parameter="effect")
