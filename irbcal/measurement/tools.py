"""A tool per payload: reflectors that were remounted for each load are other targets."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.errors import MeasurementError
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
        Their places are found again, so that unknown ones are welcome.

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


def in_words(measurements: MeasurementSet, usual_kg: float | None, same_tool: bool) -> list[str]:
    """What the user should know of the tools, in sentences; nothing where one load was carried."""
    if usual_kg is None or not several_loads(measurements):
        return []
    if same_tool:
        return ["The reflectors are taken to be at the same places with all loads (same_tool)."]
    return [
        "Each load has a tool of its own, because reflectors are remounted with it: those of "
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
