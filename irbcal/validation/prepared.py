"""Measurements made ready for validation: clean, in the calibration's frame, with a way back to the file's columns."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from irbcal.arrays import BoolArray, FloatArray, IntArray, Locked, NameArray
from irbcal.io.schema import Record
from irbcal.measurement import cleaning, tools
from irbcal.measurement.cleaning import Exclusion
from irbcal.measurement.points import PointSet
from irbcal.measurement.poses import as_poses
from irbcal.measurement.table import MeasurementSet, shared_table


@dataclass(frozen=True, eq=False)
class CleanedPoints(Locked):
    """Points fit for validation.

    Attributes
    ----------
    points : PointSet
        Pose names are the file's.
    number : ndarray of int, shape (n,)
        Number of each pose in the file (``pose_index``), which tells cycles apart.
    measurements : MeasurementSet
    excluded : tuple of Exclusion
    notes : tuple of str
    proven : bool
        Whether a fit never saw these poses.
    counted_out : int
        Poses of the file that were fitted and are not among these.
    at_fitted : ndarray of bool, shape (n,), or None
        Which poses are at joints that were fitted; None where that is not known.
    basis : str
        Why they prove nothing, in words that follow "poses", where they were not fitted themselves.
    """

    points: PointSet
    number: IntArray
    measurements: MeasurementSet
    excluded: tuple[Exclusion, ...]
    notes: tuple[str, ...]
    proven: bool = True
    counted_out: int = 0
    at_fitted: BoolArray | None = None
    basis: str = ""

    def labels(self, column: str) -> NameArray:
        """What a column of the file says of each pose, as text of shape (n,); empty text without the column."""
        table = shared_table(self.measurements)
        if column not in table.columns:
            return np.full(self.points.poses, "", dtype=object)
        first = table.groupby("pose_index", sort=True)[column].first().to_numpy(dtype=object)
        return np.array([_text(value) for value in first[self.number]], dtype=object)

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
        note = (
            f"{count} point{'s stand' if count > 1 else ' stands'} in the file again, to the last digit: counted once."
        )
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
        names_there, usual = calibration.placement.targets, calibration.usual_load
        measurements, notes = tools.as_calibrated(measurements, names_there, usual, same_tool, any_target)
    names = shared_table(measurements).groupby("pose_index", sort=True)["pose"].first().to_numpy(dtype=object)
    # poses go by their number meanwhile: names repeat from cycle to cycle
    table = shared_table(measurements)
    numbered = replace(measurements, table=table.assign(pose=table["pose_index"].astype(str)))
    shape: dict[str, Any] = {}
    if calibration is None:
        cleaned = cleaning.clean(numbered)
    else:
        shape = calibration.tool_shape()
        targets = list(shape or calibration.robot_calibrated().targets)
        known_targets = None if any_target else targets
        cleaned = cleaning.clean(numbered, calibration.reference_places() or None, known_targets)
    points = as_poses(cleaned.points, measurements.source, shape)[0] if shape else cleaned.points
    number = points.pose_ids.astype(int)
    excluded = tuple(point.model_copy(update={"pose": str(names[int(point.pose)])}) for point in cleaned.excluded)
    return CleanedPoints(
        replace(points, pose_ids=names[number]), number, measurements, excluded, (*notes, *cleaned.notes)
    )
