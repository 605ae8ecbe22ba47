"""Checks of the laser tracker itself (Nubiola 2011, annexes II, III, IV and V): which, and the door to all of them."""

from __future__ import annotations

from typing import Literal, TypeAlias, get_args

from irbcal.errors import OptionError
from irbcal.measurement.columns import InputTable, TableLike
from irbcal.options import length as metres
from irbcal.options import number
from irbcal.units import MM
from irbcal.validation.point_drift import PointDrift, drift
from irbcal.validation.point_repeatability import PointRepeatability, repeatability
from irbcal.validation.scale_bar import ScaleBar, scale_bar
from irbcal.validation.settling import REST
from irbcal.validation.settling_check import Settling, settle

Check: TypeAlias = Literal["bar", "repeat", "drift", "settle"]
CHECKS: tuple[Check, ...] = get_args(Check)

BAND = 0.02 * MM
"""Limit band of a robot coming to rest unless another is given, metres."""


def kind(source: TableLike) -> Check:
    """Which check a file is for, by its columns: one of `CHECKS`."""
    columns = InputTable.read(source)
    if "end" in columns or "distance_mm" in columns:
        return "bar"
    if "time_s" in columns:
        return "settle" if "run" in columns else "drift"
    return "repeat"


def tracker(
    readings: TableLike,
    *,
    check: Check | None = None,
    length: float | None = None,
    band: float = BAND,
    rest: float = REST,
) -> ScaleBar | PointRepeatability | PointDrift | Settling:
    """Scale-bar distances, repeatability, long-term drift with the air, or stabilisation time.

    Files are tables with ``x_mm``, ``y_mm``, ``z_mm`` in the tracker's frame and:

    ============== ==================================================================================================
    check          further columns
    ============== ==================================================================================================
    ``bar``        ``end`` (two names, measured in turn), optional ``position`` (of the bar); or ``distance_mm`` alone
    ``repeat``     optional ``position`` (name of the point that was measured again and again)
    ``drift``      ``time_s``, optional ``temperature_c``, ``pressure_mmhg`` (or ``_hpa``), ``humidity_percent``
    ``settle``     ``time_s`` and ``run``: a robot coming to rest
    ============== ==================================================================================================

    Parameters
    ----------
    readings : str, Path or DataFrame
    check : str, optional
        One of `CHECKS`; by default told by the columns.
    length : float
        Certified length of the scale bar, metres.
    band : float
        Limit band of a robot coming to rest, metres.
    rest : float
        Seconds after which the robot is at rest.

    Returns
    -------
    ScaleBar, PointRepeatability, PointDrift or Settling
        With ``summary()``, ``to_dict()``, ``to_frame()`` and ``plot()``.

    Raises
    ------
    OptionError
        If a scale bar has no certified length, or the check is unknown.
    MeasurementError
        If the file does not keep the format.
    """
    if check is not None and check not in CHECKS:
        raise OptionError.unknown("check", check, CHECKS)
    band, rest = metres("band", band), number("rest", rest, 0)
    if length is not None:
        length = metres("length", length)
    check = check or kind(readings)
    if check == "repeat":
        return repeatability(readings)
    if check == "drift":
        return drift(readings)
    if check == "settle":
        return settle(readings, band, rest)
    if length is None:
        raise OptionError("a scale bar needs its certified length", parameter="length")
    return scale_bar(readings, length)
