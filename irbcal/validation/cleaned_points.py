"""Measurements made ready for validation: clean, in the calibration's frame, without the poses of its fit.

Beside that stands what speaks against errors of other measurements: another frame, swapped targets, something that has
changed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from irbcal.arrays import BoolArray, FloatArray, IntArray, Locked, NameArray
from irbcal.errors import MeasurementError
from irbcal.io.schema import Record
from irbcal.measurement import cleaning, repeats, tools
from irbcal.measurement.cleaning import Exclusion
from irbcal.measurement.moved import moved_notes
from irbcal.measurement.points import TOO_FAR, PointSet, distances
from irbcal.measurement.poses import as_poses
from irbcal.measurement.table import MeasurementSet
from irbcal.modeling.robot import Robot
from irbcal.units import DEG, MM
from irbcal.wording import counted


@dataclass(frozen=True, eq=False)
class CleanedPoints(Locked):
    """Points fit for validation."""

    points: PointSet
    """Pose names are the file's."""
    number: IntArray
    """Shape (n,). Number of each pose in the file (``pose_index``), which tells cycles apart."""
    measurements: MeasurementSet
    excluded: tuple[Exclusion, ...]
    notes: tuple[str, ...]
    proven: bool = True
    """Whether a fit never saw these poses."""
    counted_out: int = 0
    """Poses of the file that were fitted and are not among these."""
    counted_out_note: str = ""
    """The same in a sentence, which is not among the notes."""
    placing: int = 0
    """Poses of the file that placed base, tool or zeros, and are not among these."""
    at_fitted: BoolArray | None = None
    """Shape (n,). Which poses are at joints that were fitted; None where that is not known."""
    basis: str = ""
    """Why they prove nothing, in words that follow "poses", where they were not fitted themselves."""

    def labels(self, column: str) -> NameArray:
        """What a column of the file says of each pose, as text of shape (n,); empty text without the column."""
        if column not in self.measurements.cells.columns:
            return np.full(self.points.poses, "", dtype=object)
        values = self.measurements.per_pose(column)[self.number]
        return np.array([_text(value) for value in values], dtype=object)

    def extra(self) -> dict[str, NameArray]:
        """What columns that irbcal does not know say of each point, as text of shape (m,).

        It stands in the first row of the point's pose and target; for poses of a tool in the first of the pose.
        """
        names, points = self.measurements.extra_columns, self.points
        if not names:
            return {}
        table = self.measurements.table
        of_point = {"pose_index": self.number[points.pose], "target": points.names()}
        if not np.isin(points.target_names, table["target"]).all():
            del of_point["target"]
        rows = table.drop_duplicates(list(of_point))[[*of_point, *names]]
        merged = pd.DataFrame(of_point).merge(rows, how="left", on=list(of_point))
        return {name: merged[name].fillna("").astype(str).to_numpy(dtype=object) for name in names}

    def keep(self, mask: BoolArray) -> CleanedPoints:
        """The points that a mask of shape (m,) keeps, without empty poses."""
        remaining = replace(self.points.take(mask), pose_ids=np.arange(self.points.poses)).without_empty_poses()
        rows = remaining.pose_ids
        points = replace(remaining, pose_ids=self.points.pose_ids[rows])
        return replace(self, points=points, number=self.number[rows], at_fitted=_rows(self.at_fitted, rows))

    def without_copies(self) -> CleanedPoints:
        """Each row once: those that stand in the file before with the same joints and place are left out, and noted."""
        points = self.points
        rows = np.column_stack([points.joints(), points.target, points.xyz])
        first = np.ones(len(rows), dtype=bool)
        alike = _alike(rows)
        if not len(alike):
            return self
        first[alike] = False
        first[alike[np.unique(rows[alike], axis=0, return_index=True)[1]]] = True
        count = int((~first).sum())
        if not count:
            return self
        note = f"{counted(count, 'point stands', 'points stand')} in the file again, to the last digit: counted once."
        remaining = self.keep(first)
        return replace(remaining, notes=(*remaining.notes, note))

    def select(self, mask: BoolArray) -> CleanedPoints:
        """The poses that a mask of shape (n,) keeps."""
        rows = _rows(self.at_fitted, mask)
        return replace(self, points=self.points.select(mask), number=self.number[mask], at_fitted=rows)


def _alike(rows: FloatArray) -> IntArray:
    """Which rows (n, k) may stand there more than once, in order: those that share a mark of 64 bits, as copies do."""
    mark = np.zeros(len(rows), dtype=np.uint64)
    for column in rows.T:
        mark ^= (column + 0.0).view(np.uint64)  # zero has one sign
        mark *= np.uint64(0x9E3779B97F4A7C15)
        mark ^= mark >> np.uint64(32)
    order = np.argsort(mark, kind="stable")
    equal = mark[order[1:]] == mark[order[:-1]]
    either = np.append(equal, False) | np.append(False, equal)
    return np.sort(order[either[: len(order)]])


def _rows(values: BoolArray | None, rows: IntArray | BoolArray) -> BoolArray | None:
    return None if values is None else values[rows]


def _text(value: Any) -> str:
    if value is None or value != value:
        return ""
    return f"{value:g}" if isinstance(value, float) else str(value).strip()


def prepare(
    measurements: MeasurementSet,
    calibration: Record | None = None,
    any_target: bool = False,
    same_tool: bool = False,
) -> CleanedPoints:
    """Clean measurements and bring them into the frame of a calibration.

    Parameters
    ----------
    measurements : MeasurementSet
    calibration : Record, optional
    any_target : bool
        Take targets that the calibration does not know, too.
    same_tool : bool
        With loads that the calibration does not know the reflectors are where they were with its usual load.

    Raises
    ------
    MeasurementError
        If nothing is left.
    """
    notes: list[str] = []
    if calibration is not None:
        names_there, usual = calibration.placement.targets_mm, calibration.usual_load
        measurements, notes = tools.as_calibrated(measurements, names_there, usual, same_tool, any_target)
    shape: dict[str, Any] = {}
    if calibration is None:
        cleaned = cleaning.clean(measurements)
    else:
        shape = calibration.tool_shape()
        targets = list(shape or calibration.robot_calibrated().targets)
        known_targets = None if any_target else targets
        cleaned = cleaning.clean(measurements, calibration.reference_places() or None, known_targets)
    points, number = cleaned.points, cleaned.number
    if shape:
        rows = np.arange(points.poses)
        points = as_poses(replace(points, pose_ids=rows), measurements.source, shape)[0]
        rows = points.pose_ids
        points, number = replace(points, pose_ids=cleaned.points.pose_ids[rows]), number[rows]
    return CleanedPoints(points, number, measurements, cleaned.excluded, (*notes, *cleaned.notes))


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
    is_fitted, count = near & loaded, int((near & loaded).sum())
    cleaned = replace(cleaned, at_fitted=near)
    if count and include:
        note = f"{count} of these {len(is_fitted)} poses were fitted: their errors are no proof of accuracy."
        cleaned = replace(cleaned, notes=(*cleaned.notes, note), proven=False)
    elif is_fitted.all() and count:
        raise MeasurementError(
            f"all {count} poses were fitted by this calibration (their joints agree with fitted ones within "
            f"{repeats.NEAR[0] / DEG:g} degrees, up to full turns), so they prove nothing: measure others, or look at "
            "the fitted errors with --include-fitted",
            file=cleaned.measurements.source,
        )
    elif count:
        note = (
            f"{count} of these {len(near)} poses were fitted, or are within {repeats.NEAR[0] / DEG:g} degrees of "
            "fitted joints, and are left out; --include-fitted keeps them."
        )
        cleaned = replace(cleaned.select(~is_fitted), counted_out=count, counted_out_note=note)
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


CHANGED, CHANGED_BY = 2.5, 0.1
"""Factor, and mm, by which errors must exceed those of a calibration's own proof to be spoken of."""

SUSPECT_ERROR = 5 * MM
"""Error of a calibrated robot from which on a point may belong to other joints, metres."""


def doubts_of(points: PointSet, robot: Robot, record: Record) -> list[str]:
    """What speaks against errors of these points, in the order in which they were measured, in sentences."""
    text = cleaning.in_words(
        [(points.pose_ids[p], o) for p, o in cleaning.by_robot(robot, points)], points.target_names
    )
    out = text or moved_notes(points, robot)
    errors = record.heldout or record.fit
    mean = float(distances(robot, points).mean()) / MM
    if mean > CHANGED * errors.all.mean_mm and mean - errors.all.mean_mm > CHANGED_BY:
        out.append(
            f"The errors are {mean / errors.all.mean_mm:.1f} times those that the calibration was written with "
            f"({mean:.3f} against {errors.all.mean_mm:.3f} mm): something has changed since, or these poses are unlike "
            "those of the fit."
        )
    return [*out, *record.certainty.doubts()]


def lost_row(robot: Robot, points: PointSet, error: FloatArray, measured: MeasurementSet) -> list[str]:
    """The row from which on positions stand beside their neighbour's joints, in a sentence, or nothing."""
    if not (error > SUSPECT_ERROR).any():
        return []
    from irbcal.identification import data_entry_errors

    if np.count_nonzero(error > SUSPECT_ERROR) < data_entry_errors.FEWEST_ROWS:
        return []
    lost = data_entry_errors.lost_row_of_robot(robot, points)
    return [] if lost is None else [lost.sentence(measured)]


def refuse_far_points(
    robot: Robot, points: PointSet, error: FloatArray, measured: MeasurementSet, refitted: bool
) -> None:
    """Points that are nowhere near their predictions: another unit, another place, another robot, a row lost."""
    spread, source = points.spread(), measured.source
    median = np.median(error)
    if points.poses < 3 or median <= TOO_FAR * max(spread, 0.1):
        return
    swaps = cleaning.by_robot(robot, points)
    if 2 * len(swaps) > points.poses:
        text = cleaning.in_words([(points.pose_ids[p], order) for p, order in swaps], points.target_names)
        raise MeasurementError(" ".join(text), file=source)
    from irbcal.identification import data_entry_errors

    lost = data_entry_errors.lost_row_of_robot(robot, points) or data_entry_errors.find_lost_row(robot.arm, points)
    if lost is not None:
        raise MeasurementError(lost.in_words(measured), file=source)
    data_entry_error = data_entry_errors.find_data_entry_error(robot.arm, points, float(median))
    if data_entry_error is not None:
        raise MeasurementError(data_entry_error.in_words(source), file=source)
    hint = (
        ""
        if refitted
        else "; evaluate with --refit-base if the tracker or the base was moved, with --refit-tool if the reflectors "
        "were remounted"
    )
    raise MeasurementError(
        f"the calibrated robot misses these points by {median / MM:.4g} mm (median): not measured in its frame, with "
        f"its tool or on this robot{hint}",
        file=source,
    )
