"""Proof on poses that the fit never saw: what it has seen is counted out."""

from __future__ import annotations

from dataclasses import replace

from irbcal.errors import MeasurementError
from irbcal.files.schema import Record
from irbcal.measurement import fitted
from irbcal.validation.prepared import Prepared

WHOLE_FILE = "This file was used for the calibration: fitted poses among these are no proof of accuracy."


def without_fitted(ready: Prepared, record: Record, include: bool = False) -> Prepared:
    """Measurements without the poses of a calibration's fit, with a note of how many these were.

    Parameters
    ----------
    ready : Prepared
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
    fit, _ = used
    seen = fitted.rows_of(ready.points, fit)
    count = int(seen.sum())
    if count and include:
        note = f"{count} of these {len(seen)} poses were fitted: their errors are no proof of accuracy."
        ready = replace(ready, notes=(*ready.notes, note), proven=False)
    elif seen.all() and count:
        raise MeasurementError(
            f"all {count} poses were fitted by this calibration, so they prove nothing: measure others, or look at the "
            "fitted errors with --include-fitted",
            file=ready.measurements.source,
        )
    elif count:
        note = f"{count} of these {len(seen)} poses were fitted and are counted out; --include-fitted keeps them."
        ready = replace(ready.select(~seen), notes=(*ready.notes, note), counted_out=count)
        seen = seen[~seen]
    at_fitted = fitted.places_of(ready.points, fit)
    ready = replace(ready, at_fitted=at_fitted)
    again = int((at_fitted & ~seen).sum())
    if again:
        note = (
            f"{again} of the {ready.points.poses} poses are at joints that were fitted, measured anew: they show "
            "whether something changed since, not the accuracy at other poses."
        )
        ready = replace(ready, notes=(*ready.notes, note), proven=ready.proven and again < 0.5 * ready.points.poses)
    return ready
