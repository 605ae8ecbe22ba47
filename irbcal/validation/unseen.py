"""Proof on poses that the fit never saw: what it has seen is counted out."""

from __future__ import annotations

from dataclasses import replace

from irbcal.errors import MeasurementError
from irbcal.io.schema import Record
from irbcal.measurement import fitted
from irbcal.units import DEG
from irbcal.validation.prepared import CleanedPoints

WHOLE_FILE = "This file was used for the calibration: fitted poses among these are no proof of accuracy."
OTHER_LOAD = "at fitted joints with a load that was never fitted"


def without_fitted(ready: CleanedPoints, record: Record, include: bool = False) -> CleanedPoints:
    """Measurements without the poses of a calibration's fit, with a note of how many these were.

    Parameters
    ----------
    ready : CleanedPoints
        In the calibration's frame.
    record : Record
    include : bool
        Keep them, with a note.

    Returns
    -------
    Prepared

    Raises
    ------
    MeasurementError
        If nothing is left.
    """
    used = record.used_points(heldout=False)
    if used is None:  # saved by a version that did not keep the points: the file as a whole is all that is known
        known = ready.measurements.sha256 in {item.sha256 for item in record.data}
        return replace(ready, notes=(*ready.notes, WHOLE_FILE), proven=False) if known else ready
    points = ready.points
    near = fitted.poses_of(points, used[0], record.arm().table.prismatic)
    loaded = fitted.with_fitted_load(points, used[0])
    seen, count = near & loaded, int((near & loaded).sum())
    ready = replace(ready, at_fitted=near)
    if count and include:
        note = f"{count} of these {len(seen)} poses were fitted: their errors are no proof of accuracy."
        ready = replace(ready, notes=(*ready.notes, note), proven=False)
    elif seen.all() and count:
        raise MeasurementError(
            f"all {count} poses were fitted by this calibration (their joints agree with fitted ones within "
            f"{fitted.NEAR[0] / DEG:g} degrees, up to full turns), so they prove nothing: measure others, or look at "
            "the fitted errors with --include-fitted",
            file=ready.measurements.source,
        )
    elif count:
        note = (
            f"{count} of these {len(seen)} poses were fitted, or are within {fitted.NEAR[0] / DEG:g} degrees of fitted "
            "joints, and are counted out; --include-fitted keeps them."
        )
        ready = replace(ready.select(~seen), notes=(*ready.notes, note), counted_out=count)
    again = int((near & ~loaded).sum())
    if again:
        note = (
            f"{again} of the {ready.points.poses} poses are at fitted joints with a load that was never fitted: they "
            "show what that load does, not the accuracy at other poses."
        )
        few = again < 0.5 * ready.points.poses
        ready = replace(ready, notes=(*ready.notes, note), proven=ready.proven and few)
        if not few and not count:
            ready = replace(ready, basis=OTHER_LOAD)
    return ready
