"""The reflectors that a plan measures: from a file, from a calibration, or those of the thesis's tool."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np

from irbcal.arrays import FloatArray, lock
from irbcal.errors import MeasurementError
from irbcal.measurement.columns import InputTable, all_or_none
from irbcal.measurement.columns import read_targets as read_positions
from irbcal.modeling.arm import Arm
from irbcal.modeling.home import home_joints
from irbcal.modeling.robot import Robot
from irbcal.simulation.effects import size_of
from irbcal.simulation.tool import thesis_tool

DIRECTIONS = ("nx", "ny", "nz")


@dataclass(frozen=True, eq=False)
class Targets:
    """Reflectors on the tool.

    Parameters
    ----------
    names : tuple of str
    places : array_like, shape (k, 3)
        In the tip link, metres.
    directions : array_like, shape (k, 3), or None
        Where they look, in the tip link (made unit vectors); None where not known.
    """

    names: tuple[str, ...]
    places: FloatArray
    directions: FloatArray | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "places", np.array(self.places, dtype=float).reshape(-1, 3))
        if self.directions is not None:
            looks = np.array(self.directions, dtype=float).reshape(-1, 3)
            object.__setattr__(self, "directions", looks / np.linalg.norm(looks, axis=1, keepdims=True))
        lock(self)


TargetsLike: TypeAlias = "str | Path | int | Sequence[str] | Targets"
"""A file, a number of reflectors, names, or the reflectors themselves."""


def reflectors(robot: Robot, requested: TargetsLike | None, tracker: FloatArray) -> Targets:
    """The reflectors that a plan measures.

    Parameters
    ----------
    robot : Robot
        Of a calibration, it has reflectors of its own.
    requested : str, Path, int, sequence of str or Targets, optional
        A file of reflectors (see `read_targets`); how many of the thesis tool's nine reflectors, or which (``thesis``
        for all, or names with commas between them). Three unless given, of a calibration its own.
    tracker : ndarray, shape (3,)
        The tracker in the base link, metres.

    Raises
    ------
    MeasurementError
        If a reflector is unknown or the file is refused.
    """
    calibrated = robot.targets
    if requested is None and calibrated:
        return Targets(tuple(calibrated), np.array(list(calibrated.values())))
    if isinstance(requested, Targets):
        requested_targets = requested
    elif isinstance(requested, (str, Path)) and Path(requested).is_file():
        requested_targets = read_targets(requested)
    else:
        requested_targets = _thesis_targets(robot.arm, "3" if requested is None else requested, tracker)
    if not calibrated:
        return requested_targets
    missing = [name for name in requested_targets.names if name not in calibrated]
    if missing:
        raise MeasurementError(
            f"unknown target {missing[0]!r}: this calibration has {', '.join(calibrated)}", parameter="targets"
        )
    return Targets(
        requested_targets.names,
        np.array([calibrated[name] for name in requested_targets.names]),
        requested_targets.directions,
    )


def _thesis_targets(arm: Arm, requested: str | Path | int | Sequence[str], tracker: FloatArray) -> Targets:
    """Reflectors of the thesis's tool; those on the front look at the tracker when the arm is at home."""
    home = arm.forward(home_joints(arm)[None])[0]
    look = home[:3, :3].T @ (tracker - home[:3, 3])
    tool = thesis_tool(look, size_of(arm))
    words_given = str(requested).split(",") if isinstance(requested, (str, Path, int)) else requested
    names = tool.names if requested == "thesis" else tuple(dict.fromkeys(name.strip() for name in words_given))
    if len(names) == 1 and names[0].isdigit() and 1 <= int(names[0]) <= len(tool.names):
        names = tool.names[: int(names[0])]
    unknown = [name for name in names if name not in tool.names]
    if unknown:
        raise MeasurementError(
            f"unknown target {unknown[0]!r}: expected a file, a number from 1 to {len(tool.names)} or names of "
            f"{', '.join(tool.names)}",
            parameter="targets",
        )
    tool = tool.only(names)
    return Targets(tool.names, tool.cad, tool.direction)


def read_targets(path: str | Path) -> Targets:
    """Read a file of reflectors.

    Columns ``target``, ``x_mm``, ``y_mm``, ``z_mm`` (in the tip link) and, at will, ``nx``, ``ny``, ``nz``: where they
    look.

    Raises
    ------
    MeasurementError
        If the file cannot be read or does not keep the format.
    """
    points, rows = read_positions(path), InputTable.read(path)
    if not all_or_none(rows.names, DIRECTIONS, rows.source, f"a direction needs {', '.join(DIRECTIONS)}"):
        return Targets(tuple(points), np.array(list(points.values())))
    looks = np.column_stack([rows.numbers(name, expected="a part of a direction") for name in DIRECTIONS])
    short = np.flatnonzero(np.linalg.norm(looks, axis=1) < 1e-6)
    if len(short):
        raise rows.fault("expected a direction, found zero length", int(short[0]), DIRECTIONS)
    return Targets(tuple(points), np.array(list(points.values())), looks)
