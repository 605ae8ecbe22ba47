"""What speaks against errors of other measurements: another frame, swapped targets, something that has changed."""

from __future__ import annotations

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.errors import MeasurementError
from irbcal.identification import data_entry_errors, outliers
from irbcal.io.schema import Record
from irbcal.measurement import swapped
from irbcal.measurement.moved import moved_notes
from irbcal.measurement.points import PointSet, distances
from irbcal.measurement.table import MeasurementSet
from irbcal.modeling.robot import Robot
from irbcal.units import MM

CHANGED, CHANGED_BY = 2.5, 0.1
"""Factor, and mm, by which errors must exceed those of a calibration's own proof to be spoken of."""

FAR = 5 * MM
"""Error of a calibrated robot from which on a point may belong to other joints, metres."""


def doubts_of(points: PointSet, robot: Robot, record: Record) -> list[str]:
    """What speaks against errors of these points, in the order in which they were measured, in sentences."""
    text = swapped.in_words([(points.pose_ids[p], o) for p, o in swapped.by_robot(robot, points)], points.target_names)
    out = text or moved_notes(points, robot)
    errors = record.heldout or record.fit
    mean = float(distances(robot, points).mean()) / MM
    if mean > CHANGED * errors.all.mean_mm and mean - errors.all.mean_mm > CHANGED_BY:
        out.append(
            f"The errors are {mean / errors.all.mean_mm:.1f} times those that the calibration was written with "
            f"({mean:.3f} against {errors.all.mean_mm:.3f} mm): something has changed since, or these poses are unlike "
            "those of the fit."
        )
    corner = record.certainty.warning() if record.certainty is not None else ""
    return [*out, *([corner] if corner else [])]


def lost_row(robot: Robot, points: PointSet, error: FloatArray, measured: MeasurementSet) -> list[str]:
    """The row from which on positions stand beside their neighbour's joints, in a sentence, or nothing."""
    if np.count_nonzero(error > FAR) < data_entry_errors.FEWEST_ROWS:
        return []
    lost = data_entry_errors.lost_row_of_robot(robot, points)
    return [] if lost is None else [lost.sentence(measured)]


def refuse_far_points(
    robot: Robot, points: PointSet, error: FloatArray, measured: MeasurementSet, refitted: bool
) -> None:
    """Points that are nowhere near their predictions: another unit, another place, another robot, a row lost."""
    spread, source = outliers.spread(points), measured.source
    median = np.median(error)
    if points.poses < 3 or median <= outliers.TOO_FAR * max(spread, 0.1):
        return
    swaps = swapped.by_robot(robot, points)
    if 2 * len(swaps) > points.poses:
        text = swapped.in_words([(points.pose_ids[p], order) for p, order in swaps], points.target_names)
        raise MeasurementError(" ".join(text), file=source)
    lost = data_entry_errors.lost_row_of_robot(robot, points) or data_entry_errors.find_lost_row(robot.arm, points)
    if lost is not None:
        raise MeasurementError(lost.in_words(measured), file=source)
    slip = data_entry_errors.find_entry_error(robot.arm, points, float(median))
    if slip is not None:
        raise MeasurementError(slip.in_words(source), file=source)
    hint = (
        ""
        if refitted
        else "; evaluate with --refit-base if the tracker or the base was moved, with --refit-tool if the reflectors "
        "were mounted anew"
    )
    raise MeasurementError(
        f"the calibrated robot misses these points by {median / MM:.4g} mm (median): not measured in its frame, with "
        f"its tool or on this robot{hint}",
        file=source,
    )
