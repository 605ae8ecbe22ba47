"""Proof on poses that the fit never saw: what it has seen is counted out."""

from __future__ import annotations

from dataclasses import replace

from irbcal.errors import MeasurementError
from irbcal.io.schema import Record
from irbcal.measurement import repeats
from irbcal.units import DEG
from irbcal.validation.prepared import CleanedPoints

WHOLE_FILE = "This file was used for the calibration: fitted poses among these are no proof of accuracy."
OTHER_LOAD = "at fitted joints with a load that was never fitted"


def without_fitted(cleaned: CleanedPoints, record: Record, include: bool = False) -> CleanedPoints:
    """Measurements without the poses of a calibration's fit, with a note of how many these were.

    Parameters
    ----------
    cleaned : CleanedPoints
        In the calibration's frame.
    record : Record
    include : bool
        Keep them, with a note.

    Raises
    ------
    MeasurementError
        If nothing is left.
    """
    used = record.used_points(heldout=False)
    if used is None:  # saved by a version that did not keep the points: the file as a whole is all that is known
        fitted_file = cleaned.measurements.sha256 in {file.sha256 for file in record.data}
        return replace(cleaned, notes=(*cleaned.notes, WHOLE_FILE), proven=False) if fitted_file else cleaned
    points = cleaned.points
    near = repeats.near_fitted(points, used[0], record.arm().table.prismatic)
    loaded = repeats.with_fitted_load(points, used[0])
    known, count = near & loaded, int((near & loaded).sum())
    cleaned = replace(cleaned, at_fitted=near)
    if count and include:
        note = f"{count} of these {len(known)} poses were fitted: their errors are no proof of accuracy."
        cleaned = replace(cleaned, notes=(*cleaned.notes, note), proven=False)
    elif known.all() and count:
        raise MeasurementError(
            f"all {count} poses were fitted by this calibration (their joints agree with fitted ones within "
            f"{repeats.NEAR[0] / DEG:g} degrees, up to full turns), so they prove nothing: measure others, or look at "
            "the fitted errors with --include-fitted",
            file=cleaned.measurements.source,
        )
    elif count:
        note = (
            f"{count} of these {len(near)} poses were fitted, or are within {repeats.NEAR[0] / DEG:g} degrees of "
            "fitted joints, and are counted out; --include-fitted keeps them."
        )
        cleaned = replace(cleaned.select(~known), notes=(*cleaned.notes, note), counted_out=count)
    again = int((near & ~loaded).sum())
    if again:
        note = (
            f"{again} of the {cleaned.points.poses} poses are at fitted joints with a load that was never fitted: they "
            "show what that load does, not the accuracy at other poses."
        )
        minority = again < 0.5 * cleaned.points.poses
        cleaned = replace(cleaned, notes=(*cleaned.notes, note), proven=cleaned.proven and minority)
        if not minority and not count:
            cleaned = replace(cleaned, basis=OTHER_LOAD)
    return cleaned
