"""A tool per payload: reflectors that were mounted anew for each load are other targets."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Protocol

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.errors import MeasurementError, OptionError
from irbcal.measurement.motions import usual_load
from irbcal.measurement.table import MeasurementSet


def of_load(target: str, payload_kg: float) -> str:
    """Name of a target as it was mounted for a load: ``smr1@2kg``."""
    return f"{target}@{payload_kg:g}kg"


def several_loads(measurements: MeasurementSet) -> bool:
    """Whether poses were measured with different loads."""
    loads = measurements.input("payload_kg")
    return loads is not None and len(np.unique(loads[np.isfinite(loads)])) > 1


def usual(measurements: MeasurementSet) -> float | None:
    """The load that most poses were measured with; None where none is told."""
    return usual_load(measurements.input("payload_kg"))


def with_tool_per_load(measurements: MeasurementSet, usual_kg: float | None) -> MeasurementSet:
    """The same measurements with targets of their own for each load; those of the usual load keep their names.

    Parameters
    ----------
    measurements : MeasurementSet
    usual_kg : float or None
        Nothing changes without one.
    """
    rows = _loads(measurements)
    if rows is None or usual_kg is None:
        return measurements
    return _renamed(measurements, rows, np.isfinite(rows) & (rows != usual_kg))


def as_calibrated(
    measurements: MeasurementSet,
    targets: Collection[str],
    usual_kg: float | None,
    same_tool: bool = False,
    any_target: bool = False,
) -> tuple[MeasurementSet, list[str]]:
    """Measurements with the names that a calibration gave to its targets.

    Parameters
    ----------
    measurements : MeasurementSet
    targets : collection of str
        Those of the calibration.
    usual_kg : float or None
        Its usual load.
    same_tool : bool
        The reflectors of loads that the calibration does not know are where they were with its usual load.
    any_target : bool
        Their places are found anew, so that unknown ones are welcome.

    Returns
    -------
    measurements : MeasurementSet
    notes : list of str
        What the user should know, in sentences.

    Raises
    ------
    MeasurementError
        If no reflector's place is known.
    """
    rows = _loads(measurements)
    loads_named = {name.rpartition("@")[2] for name in targets if "@" in name and name.endswith("kg")}
    if rows is None or not loads_named:
        return measurements, []
    in_calibration = np.array([f"{load:g}kg" in loads_named for load in rows])
    strange = np.isfinite(rows) & ~in_calibration
    strange &= (rows != usual_kg) if usual_kg is not None else False
    out = _renamed(measurements, rows, in_calibration if same_tool else in_calibration | strange)
    loads = ", ".join(f"{load:g}" for load in np.unique(rows[strange]))
    if not loads or any_target:
        return out, []
    if same_tool:
        return out, [f"The reflectors are taken to be where they were with {usual_kg:g} kg for {loads} kg, too."]
    if (strange | measurements.is_reference()).all():
        raise MeasurementError(
            f"where the reflectors were with {loads} kg is not known: the calibration has a tool for each of its "
            "loads; if they stayed where they were with its usual load, say so (same_tool)",
            file=measurements.source,
            column="payload_kg",
        )
    return out, [
        f"Where the reflectors were with {loads} kg is not known: the calibration has a tool for each load. These "
        "points are left out; --same-tool takes them where they were with its usual load."
    ]


class LoadOptions(Protocol):
    """Options of a calibration on the load."""

    @property
    def payload_place(self) -> Sequence[float] | None:
        """Centre of the payload in the tip link."""
        ...

    @property
    def same_tool(self) -> bool:
        """Whether reflectors stayed."""
        ...

    @property
    def torques(self) -> bool:
        """Whether torques shall be used."""
        ...

    @property
    def as_poses(self) -> bool:
        """Whether reflectors are taken as one body."""
        ...


def check(measurements: MeasurementSet, averaged: bool, options: LoadOptions) -> None:
    """Refuse options on the load that the measurements do not allow.

    Parameters
    ----------
    measurements : MeasurementSet
    averaged : bool
        Whether the model may be the average, which alone knows the load.
    options : LoadOptions

    Raises
    ------
    IrbcalError
        The sentence names the option.
    """
    for name, is_set in (("payload_place", options.payload_place is not None), ("torques", options.torques)):
        if is_set and not averaged:
            raise OptionError(f"{name}: only model auto knows the load: leave it out", parameter=name)
    if options.torques and measurements.input("torques") is None:
        raise MeasurementError(
            "there are no torques: expected the columns tau1_nm … of all joints",
            file=measurements.source,
            parameter="torques",
        )
    if options.payload_place is not None and measurements.input("payload_place") is not None:
        raise OptionError(
            "payload_place: the measurements tell the payload's place themselves: leave it out",
            parameter="payload_place",
        )
    if options.as_poses and not options.same_tool and several_loads(measurements):
        raise OptionError(
            "as_poses: the poses carry several loads, so that the reflectors may have been mounted anew and are no one "
            "rigid body: give same_tool if they stayed where they were",
            parameter="as_poses",
        )


def in_words(measurements: MeasurementSet, usual_kg: float | None, same_tool: bool) -> list[str]:
    """What the user should know of the tools, in sentences; nothing where one load was carried."""
    if usual_kg is None or not several_loads(measurements):
        return []
    if same_tool:
        return ["The reflectors are taken to be at the same places with all loads (same_tool)."]
    return [
        "Each load has a tool of its own, because reflectors are mounted anew with it: those of "
        f"{usual_kg:g} kg keep their names, others are called like {of_load('smr1', 2.0)}. If they stayed where "
        "they were: --same-tool."
    ]


def _loads(measurements: MeasurementSet) -> FloatArray | None:
    """Load of each row, NaN where not told."""
    loads = measurements.input("payload_kg")
    return None if loads is None else loads[measurements.cells["pose_index"]]


def _renamed(measurements: MeasurementSet, loads: FloatArray, rows: np.ndarray) -> MeasurementSet:
    names = measurements.cells["target"].copy()
    for row in np.flatnonzero(rows & ~measurements.is_reference()):
        names[row] = of_load(names[row], loads[row])
    return measurements.changed({"target": names})
