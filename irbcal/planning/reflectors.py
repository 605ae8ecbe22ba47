"""The reflectors that a plan measures: from a file, from a calibration, or those of the thesis's tool."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np

from irbcal.arrays import FloatArray, lock
from irbcal.errors import MeasurementError
from irbcal.measurement import columns, lists
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


def reflectors(robot: Robot, wanted: TargetsLike | None, place: FloatArray) -> Targets:
    """The reflectors that a plan measures.

    Parameters
    ----------
    robot : Robot
        Of a calibration, it has reflectors of its own.
    wanted : str, Path, int, sequence of str or Targets, optional
        A file of reflectors (see `read_targets`); how many of the thesis tool's nine reflectors, or which (``thesis``
        for all, or names with commas between them). Three unless given, of a calibration its own.
    place : ndarray, shape (3,)
        The tracker in the base link, metres.

    Returns
    -------
    Targets

    Raises
    ------
    MeasurementError
        If a reflector is unknown or the file is refused.
    """
    own = robot.targets
    if wanted is None and own:
        return Targets(tuple(own), np.array(list(own.values())))
    if isinstance(wanted, Targets):
        found = wanted
    elif isinstance(wanted, (str, Path)) and Path(wanted).is_file():
        found = read_targets(wanted)
    else:
        found = _thesis_targets(robot.arm, "3" if wanted is None else wanted, place)
    if not own:
        return found
    missing = [name for name in found.names if name not in own]
    if missing:
        raise MeasurementError(
            f"unknown target {missing[0]!r}: this calibration has {', '.join(own)}", parameter="targets"
        )
    return Targets(found.names, np.array([own[name] for name in found.names]), found.directions)


def _thesis_targets(arm: Arm, wanted: str | Path | int | Sequence[str], place: FloatArray) -> Targets:
    """Reflectors of the thesis's tool; those on the front look at the tracker when the arm is at home."""
    home = arm.forward(home_joints(arm)[None])[0]
    look = home[:3, :3].T @ (place - home[:3, 3])
    tool = thesis_tool(look, size_of(arm))
    parts = str(wanted).split(",") if isinstance(wanted, (str, Path, int)) else wanted
    names = tool.names if wanted == "thesis" else tuple(dict.fromkeys(part.strip() for part in parts))
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

    Returns
    -------
    Targets

    Raises
    ------
    MeasurementError
        If the file cannot be read or does not keep the format.
    """
    places = lists.read_targets(path)
    raw, source, _ = columns.read(path, ["target"])
    given = [name for name in DIRECTIONS if name in raw.columns]
    if not given:
        return Targets(tuple(places), np.array(list(places.values())))
    if len(given) < 3:
        missing = ", ".join(name for name in DIRECTIONS if name not in given)
        raise MeasurementError(f"missing column {missing}; a direction needs nx, ny, nz", file=source, row=1)
    looks = np.column_stack([columns.numbers(raw, name, source, "a part of a direction") for name in DIRECTIONS])
    short = np.linalg.norm(looks, axis=1) < 1e-6
    if short.any():
        row = int(raw.index[np.flatnonzero(short)[0]])
        raise MeasurementError("expected a direction, found zero length", file=source, row=row, column=DIRECTIONS)
    return Targets(tuple(places), np.array(list(places.values())), looks)
