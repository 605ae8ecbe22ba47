"""Numbers in a calibration file that no robot has: refused before anything is computed from them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from irbcal.errors import CalibrationError

ARM = 50.0
"""Metres: longer links, tools and joint travels are none."""
SITE = 1000.0
"""Metres: points are not measured farther away."""
TURN_DEG, TURN_RAD = 1e4, 175.0
"""Angles beyond are no joints or tilts."""
NUMBER = 1e18
"""Any other number beyond cannot be computed with."""

OF_THE_ARM = ("robot", "joint_origins", "targets", "tool_shape_mm")
"""Parts of the file that hold lengths of arm and tool."""
GAIN = 10.0
"""Joint errors in proportion to the joint are far below it."""
MATRICES = ("base_to_frame0", "last_frame_to_tip")
FREE = ("indices",)
"""Parts that may be as large as they like."""


def refuse_absurd(document: dict[str, Any], file: Path) -> None:
    """Refuse a calibration with a number that no robot has.

    Parameters
    ----------
    document : dict
        Content of ``calibration.json``.
    file : Path
        For the message.

    Raises
    ------
    CalibrationError
        For the first such number; the sentence says where it stands.
    """
    _look(document, (), NUMBER, file)


def _look(value: Any, place: tuple[str, ...], most: float, file: Path) -> None:
    if isinstance(value, float):
        if abs(value) > most:
            where = ".".join(place)
            raise CalibrationError(
                f"{where}: expected a number within ±{most:g}, found {value:g}", file=file, parameter=where
            )
    elif isinstance(value, dict):
        for name, item in value.items():
            if name not in FREE:
                _look(item, (*place, str(name)), _most(str(name), place, most), file)
    elif isinstance(value, (list, tuple)):
        kinds = set(map(type, value))
        if kinds <= {float, type(None)}:  # long columns
            numbers = np.array([item for item in value if item is not None], dtype=float)
            if (np.abs(numbers) <= most).all():
                return
        elif not kinds & {float, list, tuple, dict}:
            return
        for k, item in enumerate(value):
            _look(item, (*place, str(k)), most, file)


def _most(name: str, place: tuple[str, ...], inherited: float) -> float:
    """Largest number under a name: by the unit in it."""
    metres = ARM if set(OF_THE_ARM) & {name, *place} else SITE
    if name in MATRICES:
        return ARM
    for ending, most in (("_mm", metres * 1000), ("_m", metres), ("_deg", TURN_DEG), ("_rad", TURN_RAD)):
        if name.endswith(ending):
            return most
    return {"targets": metres * 1000, "gain": GAIN}.get(name, inherited)
