"""Errors of measured points under the nominal and the calibrated robot: of a file, or of the pieces of a long one."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from irbcal import parallel
from irbcal.arrays import BoolArray, NameArray, coded
from irbcal.error_statistics import rotation_statistics, statistics
from irbcal.errors import MeasurementError
from irbcal.io.opening import open_calibration
from irbcal.io.schema import Record
from irbcal.measurement import long_files, table
from irbcal.measurement.cleaning import Exclusion
from irbcal.measurement.points import PointSet, distances, rotation_distances
from irbcal.measurement.reading_lag import mixed_use
from irbcal.measurement.repeats import repeat_groups
from irbcal.modeling.lost_zeros import lost_joints
from irbcal.modeling.robot import Robot
from irbcal.option_values import Progress
from irbcal.validation import accuracy
from irbcal.validation.cleaned_points import (
    CleanedPoints,
    doubts_of,
    without_fitted,
)
from irbcal.validation.conformity import Requirement, requirement
from irbcal.validation.evaluation_options import EvaluationOptions
from irbcal.validation.frame_of_calibration import in_frame_of_calibration, with_payload_column
from irbcal.validation.provenance import checked_info
from irbcal.validation.refit import Refit

if TYPE_CHECKING:
    import pandas as pd

GROUPINGS = ("per_target", "per_group", "per_payload", "per_group_payload")
MODELS = ("nominal", "calibrated")
ErrorStatistics: TypeAlias = Mapping[str, Any]
"""Statistics of errors by name: n, mean_mm, sigma_mm, max_mm, mean_plus_3sigma_mm, rms_mm."""
ByModel: TypeAlias = Mapping[str, ErrorStatistics]
"""Statistics of the models ``nominal`` and ``calibrated``."""
T = TypeVar("T")
ALL_POINTS = slice(None)


@dataclass(frozen=True, eq=False)
class EvaluationRequest:
    """What `irbcal.evaluate` was asked, checked."""

    options: EvaluationOptions
    """Without the measurements, and the record in place of the calibration: workers get it."""
    record: Record
    required: Requirement | None
    info: Mapping[str, str]
    refit: Refit

    @classmethod
    def from_options(cls, options: EvaluationOptions) -> EvaluationRequest:
        """Of options as they were given."""
        record = open_calibration(options.calibration)
        o = replace(options, calibration=record, measurements="", progress=None)
        zeros = lost_joints(o.refit_zeros, record.arm(calibrated=False))
        return cls(
            o,
            record,
            requirement(o.tolerance, o.rule, o.tracker_u95, o.region_only),
            checked_info(o.info),
            Refit(o.refit_base, o.refit_tool, o.refit_from, o.seed, zeros),
        )

    @property
    def needs_all_points(self) -> bool:
        """Whether something is asked for that all points give together, so that a file is not judged in pieces."""
        o = self.options
        return bool(self.refit or o.relative or o.flange or o.verified is not None or o.sphere is not None)


@dataclass(frozen=True, eq=False)
class ErrorsOfPoints:
    """Errors of m points under both models, and what divides the points."""

    distance: Mapping[str, NDArray[Any]]
    turn: Mapping[str, NDArray[Any]]
    """Distances (m,), metres, and angles where orientations were measured, radians, by model."""
    pose: NDArray[Any]
    """Whole numbers, shape (m,)."""
    repeat_group: NDArray[Any] | None
    """Whole numbers, shape (m,), which repeats of a pose share; None where each pose has its own.
    """
    labels: Mapping[str, tuple[NDArray[Any], list[str]]]
    """Numbers, shape (m,), and the labels that they count. Of each of `GROUPINGS`: number of each point's label, and
    the labels; points with an empty one belong to no part.
    """

    @property
    def repeat_groups(self) -> NDArray[Any]:
        """Of each point, shape (m,)."""
        return self.pose if self.repeat_group is None else self.repeat_group

    def statistics(self, points: Any = ALL_POINTS) -> ByModel:
        """Statistics of the points of a mask."""
        return {name: dict(statistics(distance[points]) or {}) for name, distance in self.distance.items()}

    def percentiles(self) -> ByModel:
        """Percentiles of all points."""
        return {name: accuracy.percentiles(distance) or {} for name, distance in self.distance.items()}

    def orientation(self) -> ByModel | None:
        """Statistics of the angles; None where no orientation was measured."""
        turns = {name: rotation_statistics(turn) for name, turn in self.turn.items()}
        return None if turns["nominal"] is None else {name: dict(turn or {}) for name, turn in turns.items()}

    def intervals(self, seed: int) -> dict[str, Any]:
        """Bootstrap intervals of all points and of parts; repeats of a place are drawn together."""

        def by_model(points: Any = ALL_POINTS) -> dict[str, Any]:
            return {
                name: accuracy.intervals(distance[points], self.repeat_groups[points], seed=seed)
                for name, distance in self.distance.items()
            }

        settings = {"level": accuracy.LEVEL, "resamples": accuracy.RESAMPLES, "seed": seed}
        return {**settings, **by_model(), **self.by_label(by_model)}

    def by_label(self, compute: Callable[[BoolArray], T]) -> dict[str, dict[str, T]]:
        """``compute(mask)`` for each label of each of `GROUPINGS`, in the order of the alphabet."""
        out = {}
        for kind, (codes, names) in self.labels.items():
            ordered = sorted((name, code) for code, name in enumerate(names) if name)
            out[kind] = {name: compute(codes == code) for name, code in ordered}
        return out

    def small(self) -> ErrorsOfPoints:
        """In four bytes a number, and less for labels: a worker sends them, and there may be a hundred million."""

        def in_bytes(codes: NDArray[Any], names: list[str]) -> tuple[NDArray[Any], list[str]]:
            return codes.astype(np.min_scalar_type(len(names)))[: None if len(names) > 1 else 1], names

        return ErrorsOfPoints(
            {name: distance.astype(np.float32) for name, distance in self.distance.items()},
            {name: turn.astype(np.float32) for name, turn in self.turn.items()},
            self.pose.astype(np.int32),
            None if self.repeat_group is None else self.repeat_group.astype(np.int32),
            {kind: in_bytes(*coded) for kind, coded in self.labels.items()},
        )


@dataclass(frozen=True, eq=False)
class JudgedPoints:
    """Errors of measurements, and what is known of these: of a file, or of a piece of a long one."""

    errors: ErrorsOfPoints
    poses: int
    fitted: int | None
    """``fitted`` are at joints that were fitted; None where that is not known."""
    counted_out: int
    excluded: tuple[Exclusion, ...]
    proven: bool
    basis: str
    """See `irbcal.validation.cleaned_points.CleanedPoints`."""
    against: tuple[str, ...]
    notes: tuple[str, ...]
    u95: float
    """The largest uncertainty that is declared, metres; not a number where none is."""
    simulated: bool


@dataclass(frozen=True, eq=False)
class PreparedPoints:
    """Measurements that are ready to be judged, the robots that predict them, and what speaks against their errors."""

    record: Record
    cleaned: CleanedPoints
    robots: Mapping[str, Robot]
    against: tuple[str, ...]

    def judged(self) -> JudgedPoints:
        """Their errors."""
        cleaned, points = self.cleaned, self.cleaned.points
        group = repeat_groups(points)
        alone = len(np.unique(group)) == points.poses
        errors = ErrorsOfPoints(
            {name: distances(robot, points) for name, robot in self.robots.items()},
            {name: rotation_distances(robot, points) for name, robot in self.robots.items()},
            points.pose,
            None if alone else group[points.pose],
            {kind: coded(labels) for kind, labels in _parts(cleaned).items()},
        )
        return JudgedPoints(
            errors=errors,
            poses=points.poses,
            fitted=None if cleaned.at_fitted is None else int(cleaned.at_fitted.sum()),
            counted_out=cleaned.counted_out,
            excluded=tuple(cleaned.excluded),
            proven=cleaned.proven,
            basis=cleaned.basis,
            against=self.against,
            notes=_notes(cleaned, self.record),
            u95=np.nan if points.u95 is None or not np.isfinite(points.u95).any() else float(np.nanmax(points.u95)),
            simulated=cleaned.measurements.simulated,
        )


def prepared(request: EvaluationRequest, measurements: table.MeasurementSet) -> PreparedPoints:
    """Clean measurements without fitted poses, and what speaks against them before a sphere is cut out."""
    record = request.record
    cleaned, robots = in_frame_of_calibration(record, measurements, request.refit, request.options.same_tool)
    cleaned = without_fitted(cleaned.without_copies(), record, request.options.include_fitted)
    against = tuple(doubts_of(cleaned.points, robots["calibrated"], record))
    return PreparedPoints(record, _inside(cleaned, robots["calibrated"], request.options.sphere), robots, against)


def _inside(cleaned: CleanedPoints, robot: Robot, sphere: Sequence[float] | None) -> CleanedPoints:
    if sphere is None:
        return cleaned
    inside = accuracy.within_sphere(robot, cleaned.points, sphere[:3], sphere[3])
    if not inside.any():
        raise MeasurementError("no point was measured inside the sphere", file=cleaned.measurements.source)
    return cleaned.keep(inside)


def _notes(cleaned: CleanedPoints, record: Record) -> tuple[str, ...]:
    measured = cleaned.measurements
    certainty = record.robot_calibrated().certainty
    outside = "" if certainty is None else certainty.outside_in_words(cleaned.points.q)
    return (
        *cleaned.notes,
        *([cleaned.counted_out_note] if cleaned.counted_out_note else []),
        *mixed_use(record.programmed, measured.programmed, measured.source),
        *_other_loads(cleaned.points, record),
        *([outside] if outside else []),
    )


def _other_loads(points: PointSet, record: Record) -> list[str]:
    """That a joint map of one load is judged at others."""
    usual, loads = record.usual_load, points.inputs.get("payload_kg")
    joint_map = record.robot_calibrated().joint_map
    if usual is None or loads is None or joint_map.knows_loads:
        return []
    others = np.unique(loads[np.isfinite(loads) & (loads != usual)])
    if not len(others):
        return []
    return [
        f"Poses with {', '.join(f'{load:g}' for load in others)} kg are judged by a calibration that was measured with "
        f"{usual:g} kg only: what the joints give way under another load is in their errors."
    ]


def _parts(cleaned: CleanedPoints) -> dict[str, NameArray]:
    """Label of each point in each way of dividing the points; an empty label belongs to no part."""
    points = cleaned.points
    loads = cleaned.labels("payload_kg")
    payload = np.array([f"{load} kg" if load else "" for load in loads], dtype=object)
    combined = np.array(
        [f"{g}, {p}" if g and p else "" for g, p in zip(points.groups, payload, strict=True)], dtype=object
    )
    return {
        "per_target": points.names(),
        "per_group": points.groups[points.pose],
        "per_payload": payload[points.pose],
        "per_group_payload": combined[points.pose],
    }


# --- files of millions of rows ----------------------------------------------------------------------------


MOST_POSES = 20_000
"""Poses of a long file that figures, coverage and the region come from."""


PIECE_S = 1.0
"""Seconds that a piece of a long file takes, about."""


def joined_pieces(
    request: EvaluationRequest, file: long_files.LongFile, progress: Progress | None
) -> tuple[JudgedPoints, pd.DataFrame]:
    """What the pieces of a long file say together, and rows of poses drawn from it.

    After Ctrl-C these are the pieces that were judged before, and a note of that.
    """
    import pandas as pd

    shared = request, file.sha256, -(-MOST_POSES // len(file.pieces))
    finished: dict[int, tuple[JudgedPoints, pd.DataFrame]] = {}
    stopped: tuple[str, ...] = ()
    try:
        for index, piece in parallel.each(_judged_piece, shared, file.pieces, seconds=PIECE_S):
            finished[index] = piece
            if progress is not None:
                progress(f"{len(finished)} of {len(file.pieces)} pieces")
    except KeyboardInterrupt:
        if not finished:
            raise
        stopped = (f"Stopped after {len(finished)} of {len(file.pieces)} pieces of the file: the rest was not judged.",)
    results, rows = zip(*(finished[index] for index in sorted(finished)), strict=True)
    errors = _joined_errors([result.errors for result in results], [result.poses for result in results])
    text = f"A file of {len(results)} pieces: errors are of all {len(errors.pose):,} points, figures of poses drawn at"
    fitted = [result.fitted for result in results]
    judged = JudgedPoints(
        errors=errors,
        poses=sum(result.poses for result in results),
        fitted=None if None in fitted else sum(filter(None, fitted)),
        counted_out=sum(result.counted_out for result in results),
        excluded=tuple(exclusion for result in results for exclusion in result.excluded),
        proven=all(result.proven for result in results),
        basis=next((result.basis for result in results if result.basis), ""),
        against=(*long_files.once((text for result in results for text in result.against), len(results)), *stopped),
        notes=(
            f"{text} random.",
            *long_files.once((text for result in results for text in result.notes), len(results)),
        ),
        u95=float(np.nanmax([-np.inf, *(result.u95 for result in results)])),
        simulated=any(result.simulated for result in results),
    )
    return judged, pd.concat(rows, ignore_index=True)


def _judged_piece(
    shared: tuple[EvaluationRequest, str, int], piece: long_files.Piece
) -> tuple[JudgedPoints, pd.DataFrame]:
    """In a worker: read and judge a piece of a long file, and draw rows of some of its poses."""
    request, sha256, most = shared
    measurements = with_payload_column(long_files.read(piece, sha256), request.options.payload)
    ready = prepared(request, measurements)
    judged = ready.judged()
    drawn = np.random.default_rng([request.options.seed, piece.row]).permutation(ready.cleaned.number)[:most]
    rows = np.isin(measurements.cells["pose_index"], drawn)
    return replace(judged, errors=judged.errors.small()), measurements.to_frame()[rows]


def _joined_errors(pieces: Sequence[ErrorsOfPoints], poses: Sequence[int]) -> ErrorsOfPoints:
    """Errors of all pieces, whose poses and places are told apart."""
    begin = np.cumsum([0, *poses[:-1]], dtype=np.int32)

    def joined(name: str) -> dict[str, NDArray[Any]]:
        return {model: np.concatenate([getattr(piece, name)[model] for piece in pieces]) for model in MODELS}

    repeated = any(piece.repeat_group is not None for piece in pieces)
    return ErrorsOfPoints(
        joined("distance"),
        joined("turn"),
        np.concatenate([piece.pose + first for piece, first in zip(pieces, begin, strict=True)]),
        np.concatenate([piece.repeat_groups + first for piece, first in zip(pieces, begin, strict=True)])
        if repeated
        else None,
        {kind: _same_codes([(*piece.labels[kind], len(piece.pose)) for piece in pieces]) for kind in GROUPINGS},
    )


def _same_codes(pieces: Sequence[tuple[NDArray[Any], list[str], int]]) -> tuple[NDArray[Any], list[str]]:
    """Labels of all pieces with the same numbers; parts are codes, names and how many points there are."""
    number = {name: k for k, name in enumerate(dict.fromkeys(name for _, names, _ in pieces for name in names))}
    code = np.min_scalar_type(len(number))
    if len(number) == 1:
        return np.broadcast_to(np.zeros(1, dtype=code), sum(count for _, _, count in pieces)), list(number)
    codes = [
        np.broadcast_to(np.array([number[name] for name in names], dtype=code)[codes], count)
        for codes, names, count in pieces
    ]
    return np.concatenate(codes), list(number)
