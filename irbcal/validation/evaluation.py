"""Errors of a calibration and of its nominal robot on other measurements (Nubiola 2011, section 7.6)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from irbcal import parallel
from irbcal.arrays import BoolArray, FloatArray, NameArray, coded
from irbcal.errors import MeasurementError, OptionError
from irbcal.io.opening import CalibrationLike, open_calibration
from irbcal.io.schema import Record
from irbcal.measurement import pieces, table
from irbcal.measurement.cleaning import Exclusion, left_out
from irbcal.measurement.columns import PAYLOAD, with_extra_columns
from irbcal.measurement.motions import with_last_moves
from irbcal.measurement.points import PointSet, distances, rotation_distances
from irbcal.measurement.reading_lag import mixed_use
from irbcal.measurement.repeats import repeat_groups
from irbcal.modeling import frames
from irbcal.modeling.certainty import Certainty
from irbcal.modeling.home import line_at_home
from irbcal.modeling.lost_zeros import lost_joints
from irbcal.modeling.robot import Robot
from irbcal.options import checked, number, place
from irbcal.options import seed as check_seed
from irbcal.parallel import on_workers
from irbcal.plotting.pose_errors import ModelErrors, PoseErrorPlots, PoseErrors
from irbcal.statistics import rotation_statistics, statistics
from irbcal.summary import Cell, Paragraph, Result, Table, simulated_mark
from irbcal.units import MM
from irbcal.validation import accuracy
from irbcal.validation.accuracy import coverage, coverage_in_words
from irbcal.validation.cleaned_points import (
    CleanedPoints,
    doubts_of,
    lost_row,
    prepare,
    refuse_far_points,
    without_fitted,
)
from irbcal.validation.conformity import Conformity, Region, Requirement, Rule, conformity, region, requirement
from irbcal.validation.length_scale import length_scale, scale_in_words
from irbcal.validation.provenance import Origin, checked_info, origin
from irbcal.validation.refit import Refit
from irbcal.validation.verdict import Verdict, counted
from irbcal.validation.verdict import verdict as verdict_of_points

if TYPE_CHECKING:
    import pandas as pd


PARTS = ("per_target", "per_group", "per_payload", "per_group_payload")
MODELS = ("nominal", "calibrated")
KEYS = ("n", "mean_mm", "sigma_mm", "max_mm", "mean_plus_3sigma_mm", "rms_mm")
FOUR = ("mean", "sigma", "max", "mean_plus_3sigma")

Statistics: TypeAlias = Mapping[str, Any]
"""STATS: n, mean_mm, sigma_mm, max_mm, mean_plus_3sigma_mm, rms_mm."""
ByModel: TypeAlias = Mapping[str, Statistics]
"""Statistics of the models ``nominal`` and ``calibrated``."""


@dataclass(frozen=True, eq=False, repr=False)
class Evaluation(Result):
    """Errors of a calibration and of its nominal robot on measurements.

    Attributes
    ----------
    nominal, calibrated : dict
        Statistics of all points, mm.
    per_target, per_group, per_payload, per_group_payload : dict
        The same of parts of the points: label, then model.
    percentiles : dict of str to dict
        By model.
    largest_covers : float
        Share of all such poses below the largest error seen, with 95 % confidence.
    orientation : dict or None
        Statistics of the angles by model, degrees; None where no orientation was measured.
    intervals, relative, flange, verified : dict or None
        Where asked for.
    coverage : dict or None
        How many measured coordinates (lengths of moves, where the base was placed anew) lie within the predicted 95 %
        intervals, see `irbcal.validation.accuracy`; None where nothing is known of the calibration's certainty.
    excluded : tuple of Exclusion
    verdict : Verdict
        Better than the nominal robot, no better or worse, and whether that may be trusted.
    notes : tuple of str
    simulated : bool
    model : str
        Level of the calibration.
    refit_base, refit_tool : bool
        What was placed anew.
    errors : PoseErrors
        Of each point and pose.
    origin : Origin or None
        Robot, people, instruments, files with their hashes, and how many poses were new.
    conformity : Conformity or None
        Whether a tolerance is kept, where one was given.
    region : Region or None
        Where the judged poses are, and their share of the calibrated ranges.
    """

    nominal: Statistics
    calibrated: Statistics
    per_target: Mapping[str, ByModel]
    per_group: Mapping[str, ByModel]
    per_payload: Mapping[str, ByModel]
    per_group_payload: Mapping[str, ByModel]
    percentiles: ByModel
    largest_covers: float
    orientation: ByModel | None
    intervals: Mapping[str, Any] | None
    relative: Mapping[str, Any] | None
    flange: Mapping[str, Any] | None
    verified: Mapping[str, Any] | None
    coverage: Mapping[str, Any] | None
    excluded: tuple[Exclusion, ...]
    verdict: Verdict
    notes: tuple[str, ...]
    simulated: bool
    model: str
    refit_base: bool
    errors: PoseErrors
    refit_tool: bool = False
    origin: Origin | None = None
    conformity: Conformity | None = None
    region: Region | None = None

    CONTENT = " ".join(
        (*MODELS, *PARTS, "percentiles largest_covers orientation intervals relative flange verified coverage excluded")
    )
    CONTENT += " notes simulated verdict origin region conformity"

    def to_frame(self) -> pd.DataFrame:
        """A row a point: pose, group, target, nominal_mm, calibrated_mm; degrees where orientations were measured.

        The calibrated robot's error vector in the base link follows (calibrated_dx_mm …), then as text what columns of
        the measurements say that irbcal does not know.
        """
        import pandas as pd

        e = self.errors
        columns: dict[str, Any] = {
            "pose": [e.pose_names[k] for k in e.pose],
            "group": [e.groups[k] for k in e.pose],
            "target": e.target,
        }
        for name, model in e.models.items():
            columns[f"{name}_mm"] = model.distance / MM
            if model.rotation is not None:
                columns[f"{name}_deg"] = np.degrees(model.rotation)
        vector = e.models["calibrated"].vector
        if vector is not None:
            columns |= {f"calibrated_d{axis}_mm": values for axis, values in zip("xyz", vector.T / MM, strict=True)}
        return with_extra_columns(pd.DataFrame(columns), e.extra)

    @property
    def plot(self) -> PoseErrorPlots:
        """Figures of the errors: ``evaluation.plot.errors_by_pose()`` and others."""
        return PoseErrorPlots(self.errors, self.simulated)

    def headline(self) -> str:
        """Mean errors before and after."""
        kind = "SIMULATED data, " if self.simulated else ""
        return (
            f"{kind}{self.calibrated['n']} points, mean position error nominal {self.nominal['mean_mm']:.3f} mm, "
            f"model {self.model} {self.calibrated['mean_mm']:.3f} mm (largest {self.calibrated['max_mm']:.3f} mm)"
        )

    def report(self, verbose: bool = False) -> Sequence[Paragraph]:
        """What ``irbcal evaluate`` prints; ``verbose``: every point that was left out."""
        conformity = () if self.conformity is None else self.conformity.report()
        lines: list[Paragraph] = [*conformity, *self.verdict.report(), self._error_table()]
        if self.refit_base and not self.refit_tool and not any("was placed anew on" in note for note in self.notes):
            lines.append("The base was placed anew on these points for each model: these are relative errors.")
        if self.excluded:
            count = f"{len(self.excluded)} point{'' if len(self.excluded) == 1 else 's'}"
            lines += [f"Left out: {count}", *left_out(self.excluded, None if verbose else 8)]
        if self.orientation is not None:
            lines += [orientation_line(label, self.orientation[name]) for name, label in self._labels.items()]
        if self.intervals is not None:
            lines += self._interval_table(self.intervals)
        if self.coverage is not None:
            lines += self._coverage_table(self.coverage)
        if self.flange is not None:
            lines += self._flange_tables(self.flange)
        if self.relative is not None:
            lines += self._relative_table(self.relative)
        if self.verified is not None:
            lines += _verified_table(self.verified)
        scope = () if self.conformity is None or self.origin is None else self.origin.scope
        notes = (*scope, *(note for note in self.notes if note not in self.verdict.doubts))
        return [*lines, *(f"Note: {text}" for text in notes)]

    @property
    def _labels(self) -> dict[str, str]:
        return {"nominal": "nominal", "calibrated": f"model {self.model}"}

    def _error_table(self) -> Table:
        labelled = [("all", {"nominal": self.nominal, "calibrated": self.calibrated})]
        for kind in PARTS:
            by_label = getattr(self, kind)
            labelled += by_label.items() if len(by_label) > 1 else ()
        entries = [
            (label, words, by_model[name]) for label, by_model in labelled for name, words in self._labels.items()
        ]
        mark = simulated_mark(self.simulated)
        return statistics_table(f"{mark}position errors of model {self.model}, mm", entries, bold={1})

    def _interval_table(self, intervals: Mapping[str, Any]) -> list[Paragraph]:
        keys = {"mean": "mean_mm", "sigma": "sigma_mm", "mean + 3σ": "mean_plus_3sigma_mm"}
        keys |= {f"{p} % of the points below": f"p{p}_mm" for p in accuracy.PERCENTILES}
        rows: list[tuple[Cell, ...]] = []
        for name, words in self._labels.items():
            ends, values = intervals[name] or {}, {**getattr(self, name), **self.percentiles[name]}
            for label, key in keys.items():
                interval = f"{ends[key][0]:.3f} … {ends[key][1]:.3f}" if key in ends else "–"
                rows.append((label, words, values[key], interval))
        title = f"Bootstrap intervals ({intervals['level']:.0%}, {intervals['resamples']} resamples of the poses), mm"
        return [
            Table(title, ("", "model", "value", "interval"), tuple(rows)),
            f"With 95 % confidence {self.largest_covers:.1%} of all such poses stay below the largest error seen.",
        ]

    def _coverage_table(self, shares: Mapping[str, Any]) -> list[Paragraph]:
        if self.intervals is None:
            return [coverage_in_words(shares)]
        rows = tuple((name, row["n"], row["inside"], row["u95_mm"]) for name, row in shares["parts"].items())
        columns = ("", shares["of"], "within", "half-width (median, mm)")
        title = f"{shares['of'].capitalize()} within the predicted 95 % intervals (share)"
        return [coverage_in_words(shares), Table(title, columns, rows, 3)]

    def _flange_tables(self, errors: Mapping[str, Any]) -> list[Paragraph]:
        lines: list[Paragraph] = []
        for quantity, unit, digits in (("position", "mm", 3), ("orientation", "deg", 4)):
            title = f"{quantity.capitalize()} errors of the flange ({errors['nominal'][quantity]['n']} poses), {unit}"
            by_model = {name: errors[name][quantity] for name in MODELS}
            lines.append(self._table_by_model(title, by_model, unit, digits))
        return lines

    def _relative_table(self, errors: Mapping[str, Any]) -> list[Paragraph]:
        if errors["kind"] != "virtual":
            title = f"Relative position errors in the frame of {', '.join(errors['points'])}, mm"
            return [self._table_by_model(title, errors)]
        x, y, z = errors["shift_mm"]["calibrated"]
        shift = f"Shift taken off for {self._labels['calibrated']}: {x:+.3f}, {y:+.3f}, {z:+.3f} mm in the base link"
        return [self._table_by_model("Relative position errors from a virtual frame, mm", errors), shift]

    def _table_by_model(self, title: str, errors: Mapping[str, Any], unit: str = "mm", digits: int = 3) -> Table:
        keys = [f"{key}_{unit}" for key in FOUR]
        rows = tuple((label, *(errors[name][key] for key in keys)) for name, label in self._labels.items())
        return Table(title, ("model", "mean", "sigma", "max", "mean+3σ"), rows, digits)


def _verified_table(errors: Mapping[str, Any]) -> list[Paragraph]:
    """Expected beside verified errors, and what speaks against the comparison."""
    by_label = {"": errors, **{f"{group}: ": values for group, values in errors["per_group"].items()}}
    rows: list[tuple[Cell, ...]] = [
        (f"{label}{name}", values[name]["n"], *(values[name][f"{key}_mm"] for key in FOUR))
        for label, values in by_label.items()
        for name in ("uncorrected", "expected", "verified")
        if values[name]
    ]
    columns = ("", "points", "mean", "sigma", "max", "mean+3σ")
    lines: list[Paragraph] = [Table("Expected against verified errors, mm", columns, tuple(rows))]
    unlike = errors["poses"]["set_aside"]
    if unlike:
        more = f" … and {len(unlike) - 8} more" if len(unlike) > 8 else ""
        lines.append(
            "Note: verified poses left out, because their commands are no fake targets of this calibration: "
            f"{', '.join(unlike[:8])}{more}"
        )
    if errors["command_mm"] > 0.1:
        lines.append(
            f"Note: the verified commands miss this calibration's own fake targets by up to "
            f"{errors['command_mm']:.3f} mm: they are not its fake targets for poses of these names (not filtered, "
            "filtered with another calibration, or poses named otherwise)"
        )
    return lines


def statistics_table(title: str, entries: Sequence[tuple[str, str, Statistics]], bold: set[int]) -> Table:
    """Statistics in mm as a table: (label, model, statistics), equal labels once."""
    rows: list[tuple[Cell, ...]] = []
    previous = None
    for label, model, values in entries:
        rows.append(("" if label == previous else label, model, *(values[key] for key in KEYS)))
        previous = label
    columns = ("", "model", "points", "mean", "sigma", "max", "mean+3σ", "rms")
    return Table(title, columns, tuple(rows), bold=frozenset(bold))


def orientation_line(model: str, values: Mapping[str, Any]) -> str:
    """One line on orientation errors."""
    return (
        f"Orientation errors, {model}: mean {values['mean_deg']:.4f}, sigma {values['sigma_deg']:.4f}, "
        f"max {values['max_deg']:.4f} degrees ({values['n']} poses)"
    )


RELATIVE = ("virtual", "three-points")

NOTHING = Refit()
"""Base and tool stay where the calibration has them."""

T = TypeVar("T")
EVERY = slice(None)


@on_workers
def evaluate(
    calibration: CalibrationLike,
    measurements: table.MeasurementsLike,
    *,
    refit_base: bool = False,
    refit_tool: bool = False,
    refit_from: int | None = None,
    refit_zeros: Sequence[int] = (),
    intervals: bool = False,
    include_fitted: bool = False,
    relative: Literal["virtual", "three-points"] | None = None,
    frame_points: Sequence[tuple[str, str]] | None = None,
    sphere: Sequence[float] | None = None,
    flange: bool = False,
    verified: table.MeasurementsLike | None = None,
    seed: int = 0,
    payload: float | None = None,
    same_tool: bool = False,
    tolerance: float | None = None,
    rule: Rule | None = None,
    tracker_u95: float | None = None,
    region_only: bool = False,
    info: Mapping[str, str] | None = None,
    jobs: int | None = None,
    progress: Callable[[str], Any] | None = None,
) -> Evaluation:
    """Errors of a calibration and of its nominal robot on other measurements.

    Files of a million rows and more (CSV or Parquet) are judged in pieces, in memory that hardly grows with them: all
    points are judged, while figures, doubts of the whole and the region come from poses drawn at random. Repeats of a
    pose are looked for within a piece. What needs all points at once is not done so: ``refit_base``, ``refit_tool``,
    ``relative``, ``flange``, ``verified``, ``sphere``, reference points, sessions.

    Parameters
    ----------
    calibration : str, Path or a loaded calibration
    measurements : str, Path, DataFrame or MeasurementSet
        Registered to the calibration's reference points where both have them.
    refit_base : bool
        Place the base anew for each model (for measurements from another tracker station without references).
    refit_tool : bool
        Place the targets anew for each model, because reflectors were mounted anew; their names may be others.
    refit_from : int, optional
        Poses from which base and tool are placed anew; they are not judged. By default half of them with
        ``refit_tool``; with ``refit_base`` alone all poses, which are judged, too.
    refit_zeros : sequence of int
        Joints, from 1, whose zeros were lost (a crash, another motor): they are found with what is placed anew, all
        else of the robot stays, and a note tells them with their intervals.
    intervals : bool
        Add bootstrap intervals, see `irbcal.validation.accuracy`, and by target how many measured coordinates lie
        within the predicted 95 % intervals, see `irbcal.modeling.robot.Robot.predict`.
    include_fitted : bool
        Keep poses that the calibration was fitted to; they are counted out otherwise.
    relative : {"virtual", "three-points"}, optional
        Add relative errors, see `irbcal.validation.accuracy`.
    frame_points : sequence of three (pose, target), optional
        The points of the frame for ``three-points``.
    sphere : sequence of four float, optional
        Centre in the base link and diameter, metres: regard only points measured inside.
    flange : bool
        Add position and orientation errors of the tip from three targets or measured orientations.
    verified : str, Path, DataFrame or MeasurementSet, optional
        Measurements of the same poses (by name) run with this calibration's fake targets.
    seed : int
        Of the bootstrap and of the poses for ``refit_from``.
    payload : float, optional
        Mass carried, kg, where the measurements do not tell it (column ``payload_kg``).
    same_tool : bool
        With a load that the calibration does not know the reflectors are where they were with its usual load.
    tolerance : float, optional
        What the calibrated robot is judged by, metres, see `irbcal.validation.conformity`.
    rule : {"mean3sigma", "max", "percentile"}, optional
        What must be within the tolerance; mean + 3 sigma unless given; ``percentile`` is the 95th.
    tracker_u95 : float, optional
        Expanded uncertainty (95 %) of a measured position, metres, which is added to the upper bound of that figure; by
        default the largest ``u95_mm`` of the measurements, else `irbcal.validation.conformity.ASSUMED_U95`.
    region_only : bool
        Judge the tolerance for the region of these poses only, which the certificate states; else they must cover the
        calibrated ranges, see `irbcal.validation.conformity`.
    info : dict of str to str, optional
        What a certificate tells besides: ``serial_number``, ``operator`` and others of
        `irbcal.validation.provenance.FIELDS`, or any name. Columns of the measurements with these names are taken, too.
    jobs : int, optional
        Threads for large problems, processes for long files; as many as there are cores unless given. The result does
        not depend on it.
    progress : callable, optional
        Called with a short text after each piece of a long file.

    Raises
    ------
    IrbcalError
        If an input is refused.
    """
    check_seed(seed)
    if sphere is not None:
        place("sphere", sphere, "x, y, z of the centre and the diameter in metres", (4,))
    if relative is not None:
        checked("relative", relative, RELATIVE)
    if frame_points is not None and relative != "three-points":
        raise OptionError("frame_points: only relative='three-points' takes them", parameter="frame_points")
    record = open_calibration(calibration)
    request = _Request(
        record=record,
        required=requirement(tolerance, rule, tracker_u95, region_only),
        info=checked_info(info),
        refit=Refit(refit_base, refit_tool, refit_from, seed, lost_joints(refit_zeros, record.arm(calibrated=False))),
        intervals=intervals,
        include_fitted=include_fitted,
        relative=relative,
        frame_points=frame_points,
        sphere=sphere,
        flange=flange,
        verified=verified,
        seed=seed,
        payload=payload,
        same_tool=same_tool,
    )
    file = None if request.needs_all_points else pieces.long_file(measurements)
    if file is not None and not pieces.read(file.pieces[0]).is_reference().any():
        return _of_long_file(calibration, request, file, progress)
    prepared = _prepared(request, carrying(table.read(measurements), payload))
    judged = prepared.judged()
    return _evaluation(calibration, request, prepared, judged, judged)


@dataclass(frozen=True, eq=False)
class _Request:
    """What `evaluate` was asked, checked."""

    record: Record
    required: Requirement | None
    info: dict[str, str]
    refit: Refit
    intervals: bool
    include_fitted: bool
    relative: Literal["virtual", "three-points"] | None
    frame_points: Sequence[tuple[str, str]] | None
    sphere: Sequence[float] | None
    flange: bool
    verified: table.MeasurementsLike | None
    seed: int
    payload: float | None
    same_tool: bool

    @property
    def needs_all_points(self) -> bool:
        """Whether something is asked for that all points give together, so that a file is not judged in pieces."""
        wanted = self.refit or self.relative or self.flange or self.verified is not None or self.sphere is not None
        return bool(wanted)


@dataclass(frozen=True, eq=False)
class _PointErrors:
    """Errors of m points under both models, and what divides the points."""

    distance: Mapping[str, NDArray[Any]]
    turn: Mapping[str, NDArray[Any]]
    """Distances (m,), metres, and angles where orientations were measured, radians, by model."""
    pose: NDArray[Any]
    """Whole numbers, shape (m,)."""
    place: NDArray[Any] | None
    """Whole numbers, shape (m,). Place of each point, which repeats of a pose share; None where each pose has its own.
    """
    labels: Mapping[str, tuple[NDArray[Any], list[str]]]
    """Numbers, shape (m,), and the labels that they count. Of each of `PARTS`: number of each point's label, and the
    labels; points with an empty one belong to no part.
    """

    @property
    def places(self) -> NDArray[Any]:
        """Place of each point."""
        return self.pose if self.place is None else self.place

    def statistics(self, points: Any = EVERY) -> ByModel:
        """Statistics of the points of a mask."""
        return {name: _known(statistics(distance[points])) for name, distance in self.distance.items()}

    def percentiles(self) -> ByModel:
        """Percentiles of all points."""
        return {name: _known(accuracy.percentiles(distance)) for name, distance in self.distance.items()}

    def orientation(self) -> ByModel | None:
        """Statistics of the angles; None where no orientation was measured."""
        turns = {name: rotation_statistics(turn) for name, turn in self.turn.items()}
        return None if turns["nominal"] is None else {name: _known(turn) for name, turn in turns.items()}

    def intervals(self, seed: int) -> dict[str, Any]:
        """Bootstrap intervals of all points and of parts; repeats of a place are drawn together."""

        def by_model(points: Any = EVERY) -> dict[str, Any]:
            return {
                name: accuracy.intervals(distance[points], self.places[points], seed=seed)
                for name, distance in self.distance.items()
            }

        settings = {"level": accuracy.LEVEL, "resamples": accuracy.RESAMPLES, "seed": seed}
        return {**settings, **by_model(), **self.by_label(by_model)}

    def by_label(self, compute: Callable[[BoolArray], T]) -> dict[str, dict[str, T]]:
        """``compute(mask)`` for each label of each of `PARTS`, in the order of the alphabet."""
        out = {}
        for kind, (codes, names) in self.labels.items():
            ordered = sorted((name, code) for code, name in enumerate(names) if name)
            out[kind] = {name: compute(codes == code) for name, code in ordered}
        return out

    def small(self) -> _PointErrors:
        """In four bytes a number, and less for labels: a worker sends them, and there may be a hundred million."""

        def in_bytes(codes: NDArray[Any], names: list[str]) -> tuple[NDArray[Any], list[str]]:
            return codes.astype(np.min_scalar_type(len(names)))[: None if len(names) > 1 else 1], names

        return _PointErrors(
            {name: distance.astype(np.float32) for name, distance in self.distance.items()},
            {name: turn.astype(np.float32) for name, turn in self.turn.items()},
            self.pose.astype(np.int32),
            None if self.place is None else self.place.astype(np.int32),
            {kind: in_bytes(*coded) for kind, coded in self.labels.items()},
        )


@dataclass(frozen=True, eq=False)
class _Judged:
    """Errors of measurements, and what is known of these: of a file, or of a piece of a long one."""

    errors: _PointErrors
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
class _Prepared:
    """Measurements that are ready to be judged, the robots that predict them, and what speaks against their errors."""

    record: Record
    cleaned: CleanedPoints
    robots: Mapping[str, Robot]
    against: tuple[str, ...]

    def judged(self) -> _Judged:
        """Their errors."""
        cleaned, points = self.cleaned, self.cleaned.points
        place = repeat_groups(points)
        alone = len(np.unique(place)) == points.poses
        errors = _PointErrors(
            {name: distances(robot, points) for name, robot in self.robots.items()},
            {name: rotation_distances(robot, points) for name, robot in self.robots.items()},
            points.pose,
            None if alone else place[points.pose],
            {kind: coded(labels) for kind, labels in _parts(cleaned).items()},
        )
        return _Judged(
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


def _prepared(request: _Request, measurements: table.MeasurementSet) -> _Prepared:
    """Clean measurements without fitted poses, and what speaks against them before a sphere is cut out."""
    record = request.record
    cleaned, robots = in_frame_of_calibration(record, measurements, request.refit, request.same_tool)
    cleaned = without_fitted(cleaned.without_copies(), record, request.include_fitted)
    against = tuple(doubts_of(cleaned.points, robots["calibrated"], record))
    return _Prepared(record, _inside(cleaned, robots["calibrated"], request.sphere), robots, against)


def _evaluation(
    calibration: CalibrationLike, request: _Request, some: _Prepared, errors_of_some: _Judged, judged: _Judged
) -> Evaluation:
    """The evaluation of what was judged; ``some`` are all of its points, or those drawn from a long file.

    Figures, coverage and the region are those of ``some``.
    """
    record, required, refit, errors = request.record, request.required, request.refit, judged.errors
    robots, points, source = some.robots, some.cleaned.points, some.cleaned.measurements.source
    calibrated = robots["calibrated"]
    fit = record.used_points(heldout=False)
    covered = region(calibrated, points, None if fit is None else fit[0])
    link_lengths = length_scale(record.arm(calibrated=False), record.arm())
    scope = (
        *_scope(refit, request.sphere, some.cleaned),
        scale_in_words(link_lengths, points.xyz, request.info.get("scale_bar", "")),
        *_open_ends(calibrated.certainty),
    )
    overall, percentiles = errors.statistics(), errors.percentiles()
    simulated = judged.simulated or some.cleaned.measurements.simulated or record.simulated
    outcome = verdict_of_points(
        errors.distance["nominal"] / MM,
        errors.distance["calibrated"] / MM,
        errors.pose,
        counted(judged.excluded),
        judged.proven,
        judged.against,
        basis=judged.basis,
    )
    kept = None
    if required is not None:
        kept = conformity(
            required,
            {**overall["calibrated"], **percentiles["calibrated"]},
            errors.distance["calibrated"],
            errors.places,
            outcome,
            poses=judged.poses,
            declared_u95=[judged.u95],
            region=covered,
            simulated=simulated,
            seed=request.seed,
        )
    of_some = origin(calibration, record, some.cleaned, request.info, scope)
    of_parts: dict[str, Any] = errors.by_label(errors.statistics)
    return Evaluation(
        **overall,
        **of_parts,
        percentiles=percentiles,
        largest_covers=accuracy.largest_covers(len(np.unique(errors.places))),
        orientation=errors.orientation(),
        intervals=errors.intervals(request.seed) if request.intervals else None,
        coverage=coverage(calibrated, points, moves=refit.base),
        relative=None
        if request.relative is None
        else _relative(robots, points, request.relative, request.frame_points, source),
        flange=_flange(robots, points, source) if request.flange else None,
        verified=None if request.verified is None else _verified(record, calibrated, points, request.verified),
        excluded=judged.excluded,
        verdict=outcome,
        notes=(*judged.against, *judged.notes),
        simulated=simulated,
        model=record.model,
        refit_base=refit.base,
        refit_tool=refit.tool,
        errors=_pose_errors(robots, some.cleaned, errors_of_some.errors.distance),
        origin=replace(of_some, poses=judged.poses, fitted=judged.fitted, counted_out=judged.counted_out),
        region=covered,
        conformity=kept,
    )


# --- files of millions of rows ----------------------------------------------------------------------------

MOST_POSES = 20_000
"""Poses of a long file that figures, coverage and the region come from."""
PIECE_S = 1.0
"""Seconds that a piece of a long file takes, about."""


def _of_long_file(
    calibration: CalibrationLike, request: _Request, file: pieces.LongFile, progress: Callable[[str], Any] | None
) -> Evaluation:
    """The evaluation of a long file, its pieces judged side by side."""
    judged, drawn = _joined_pieces(request, file, progress)
    some = _prepared(request, replace(table.read(drawn), source=file.path, sha256=file.sha256))
    return _evaluation(calibration, request, some, some.judged(), judged)


def _joined_pieces(
    request: _Request, file: pieces.LongFile, progress: Callable[[str], Any] | None
) -> tuple[_Judged, pd.DataFrame]:
    """What the pieces of a long file say together, and rows of poses drawn from it.

    After Ctrl-C these are the pieces that were judged before, and a note of that.
    """
    import pandas as pd

    shared = request, file.sha256, -(-MOST_POSES // len(file.pieces))
    done: dict[int, tuple[_Judged, pd.DataFrame]] = {}
    stopped: tuple[str, ...] = ()
    try:
        for index, piece in parallel.each(_judged_piece, shared, file.pieces, seconds=PIECE_S):
            done[index] = piece
            if progress is not None:
                progress(f"{len(done)} of {len(file.pieces)} pieces")
    except KeyboardInterrupt:
        if not done:
            raise
        stopped = (f"Stopped after {len(done)} of {len(file.pieces)} pieces of the file: the rest was not judged.",)
    parts, rows = zip(*(done[index] for index in sorted(done)), strict=True)
    errors = _joined_errors([part.errors for part in parts], [part.poses for part in parts])
    text = f"A file of {len(parts)} pieces: errors are of all {len(errors.pose):,} points, figures of poses drawn at"
    fitted = [part.fitted for part in parts]
    judged = _Judged(
        errors=errors,
        poses=sum(part.poses for part in parts),
        fitted=None if None in fitted else sum(filter(None, fitted)),
        counted_out=sum(part.counted_out for part in parts),
        excluded=tuple(exclusion for part in parts for exclusion in part.excluded),
        proven=all(part.proven for part in parts),
        basis=next((part.basis for part in parts if part.basis), ""),
        against=(*pieces.once((text for part in parts for text in part.against), len(parts)), *stopped),
        notes=(f"{text} random.", *pieces.once((text for part in parts for text in part.notes), len(parts))),
        u95=float(np.nanmax([-np.inf, *(part.u95 for part in parts)])),
        simulated=any(part.simulated for part in parts),
    )
    return judged, pd.concat(rows, ignore_index=True)


def _judged_piece(shared: tuple[_Request, str, int], piece: pieces.Piece) -> tuple[_Judged, pd.DataFrame]:
    """In a worker: read and judge a piece of a long file, and draw rows of some of its poses."""
    request, sha256, most = shared
    measurements = carrying(pieces.read(piece, sha256), request.payload)
    prepared = _prepared(request, measurements)
    judged = prepared.judged()
    drawn = np.random.default_rng([request.seed, piece.row]).permutation(prepared.cleaned.number)[:most]
    rows = np.isin(measurements.cells["pose_index"], drawn)
    return replace(judged, errors=judged.errors.small()), measurements.to_frame()[rows]


def _joined_errors(parts: Sequence[_PointErrors], poses: Sequence[int]) -> _PointErrors:
    """Errors of all pieces, whose poses and places are told apart."""
    begin = np.cumsum([0, *poses[:-1]], dtype=np.int32)

    def joined(name: str) -> dict[str, NDArray[Any]]:
        return {model: np.concatenate([getattr(part, name)[model] for part in parts]) for model in MODELS}

    repeated = any(part.place is not None for part in parts)
    return _PointErrors(
        joined("distance"),
        joined("turn"),
        np.concatenate([part.pose + first for part, first in zip(parts, begin, strict=True)]),
        np.concatenate([part.places + first for part, first in zip(parts, begin, strict=True)]) if repeated else None,
        {kind: _same_codes([(*part.labels[kind], len(part.pose)) for part in parts]) for kind in PARTS},
    )


def _same_codes(parts: Sequence[tuple[NDArray[Any], list[str], int]]) -> tuple[NDArray[Any], list[str]]:
    """Labels of all pieces with the same numbers; parts are codes, names and how many points there are."""
    number = {name: k for k, name in enumerate(dict.fromkeys(name for _, names, _ in parts for name in names))}
    code = np.min_scalar_type(len(number))
    if len(number) == 1:
        return np.broadcast_to(np.zeros(1, dtype=code), sum(count for _, _, count in parts)), list(number)
    codes = [
        np.broadcast_to(np.array([number[name] for name in names], dtype=code)[codes], count)
        for codes, names, count in parts
    ]
    return np.concatenate(codes), list(number)


# --- measurements in the frame of a calibration -----------------------------------------------------------


def in_frame_of_calibration(
    calibration: CalibrationLike, measurements: table.MeasurementsLike, refit: Refit = NOTHING, same_tool: bool = False
) -> tuple[CleanedPoints, dict[str, Robot]]:
    """Clean measurements in the frame of a calibration, and its robots.

    Parameters
    ----------
    calibration : str, Path or a loaded calibration
    measurements : str, Path, DataFrame or MeasurementSet
    refit : Refit
        What to place anew; the poses that do it are not in the result, except where they are judged, too.
    same_tool : bool
        As `evaluate`.

    Returns
    -------
    points : CleanedPoints
    robots : dict of str to Robot
        ``nominal`` and ``calibrated``.

    Raises
    ------
    IrbcalError
        If the measurements are refused, or are nowhere near what the calibrated robot predicts.
    """
    record = open_calibration(calibration)
    measured = table.read(measurements).of_arm(record.arm())
    cleaned = prepare(measured, record, any_target=refit.tool, same_tool=same_tool)
    before = {"nominal": record.robot_nominal(), "calibrated": record.robot_calibrated()}
    chosen, to_judge = refit.chosen(cleaned.points, measured.source)
    placing, cleaned = cleaned.points.select(chosen), cleaned.select(to_judge)

    def placed() -> dict[str, Robot]:
        return {name: refit.placed(robot, placing, measured.source) for name, robot in before.items()}

    robots = placed()
    points, notes = with_last_moves(robots["calibrated"], cleaned.points)
    if placing.previous is not None and points.previous is None:
        placing = replace(placing, previous=None)
        robots = placed()
    zeros = refit.zeros_in_words(before["calibrated"], robots["calibrated"], placing)
    if not to_judge[chosen].any():
        notes.append(refit.sentence(placing.poses, points.poses))
    error = distances(robots["calibrated"], points)
    refuse_far_points(robots["calibrated"], points, error, measured, bool(refit))
    lost = lost_row(robots["calibrated"], points, error, measured)
    return replace(cleaned, points=points, notes=(*zeros, *cleaned.notes, *notes, *lost)), robots


def _scope(refit: Refit, sphere: Sequence[float] | None, cleaned: CleanedPoints) -> tuple[str, ...]:
    """What an evaluation is limited to, in sentences."""
    out = []
    if refit.base and not any("placed anew on" in note for note in cleaned.notes):
        out.append("The base was placed anew on the judged poses themselves: these are relative errors.")
    if sphere is not None:
        x, y, z, diameter = (value / MM for value in sphere)
        out.append(
            f"Only points inside the sphere of {diameter:g} mm about ({x:g}, {y:g}, {z:g}) mm in the base link are "
            "judged."
        )
    return tuple(out)


def _open_ends(certainty: Certainty | None) -> tuple[str, ...]:
    """What the calibration leaves open of base and flange, which no evaluation by reflectors shows; none if known."""
    size = 0.0 if certainty is None else certainty.open_ends() / MM
    text = f"Not judged: base and flange, about {size:.2f} mm open because places of reflectors were not known."
    return (text,) if size else ()


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
        *mixed_use(record.programmed, measured.programmed, measured.source),
        *_other_loads(cleaned.points, record),
        *([outside] if outside else []),
    )


def carrying(measurements: table.MeasurementSet, payload: float | None) -> table.MeasurementSet:
    """Measurements with a load where they do not tell it."""
    if payload is None:
        return measurements
    if measurements.input("payload_kg") is not None:
        raise OptionError(
            "payload: the measurements tell it themselves (payload_kg): leave it out", parameter="payload"
        )
    load = number("payload", payload, 0.0)
    return measurements.changed({PAYLOAD: np.full(len(measurements), load)})


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


def _known(values: Statistics | None) -> Statistics:
    """Statistics of points that are there."""
    assert values is not None
    return values


def _pose_errors(robots: Mapping[str, Robot], cleaned: CleanedPoints, errors: Mapping[str, FloatArray]) -> PoseErrors:
    points = cleaned.points
    T_base_world = frames.inverse(robots["nominal"].T_world_base)
    count = np.bincount(points.pose, minlength=points.poses)
    models = {
        name: ModelErrors(
            SimpleNamespace(**_known(statistics(errors[name]))),
            errors[name],
            np.bincount(points.pose, errors[name], points.poses) / count,
            None,
            accuracy.error_vectors(robot, points) @ T_base_world[:3, :3].T,
            accuracy.turns(robot, points),
        )
        for name, robot in robots.items()
    }
    return PoseErrors(
        "measured",
        points.pose,
        tuple(str(name) for name in points.pose_ids),
        tuple(str(name) for name in points.groups),
        tuple(str(name) for name in points.names()),
        models,
        frames.apply(T_base_world, points.xyz),
        arm=line_at_home(robots["nominal"].arm),
        extra=cleaned.extra(),
    )


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


def _relative(
    robots: Mapping[str, Robot],
    points: PointSet,
    kind: str,
    frame_points: Sequence[tuple[str, str]] | None,
    source: str,
) -> dict[str, Any]:
    if kind == "virtual":
        shifted = {name: accuracy.relative_to_virtual_frame(robot, points) for name, robot in robots.items()}
        shift = {name: (shift / MM).tolist() for name, (_, shift) in shifted.items()}
        return {"kind": kind, "shift_mm": shift, **{name: statistics(d) for name, (d, _) in shifted.items()}}
    names = [(str(points.pose_ids[k]), str(t)) for k, t in zip(points.pose, points.names(), strict=True)]
    rows = None
    if frame_points is not None:
        missing = [(pose, target) for pose, target in frame_points if (pose, target) not in names]
        if missing:
            raise MeasurementError(f"pose {missing[0][0]} has no usable point of target {missing[0][1]}", file=source)
        rows = [names.index((pose, target)) for pose, target in frame_points]
    errors = {name: accuracy.relative_to_three_points(robot, points, rows) for name, robot in robots.items()}
    return {
        "kind": kind,
        "points": ["/".join(names[k]) for k in errors["nominal"][1]],
        **{name: statistics(d) for name, (d, _) in errors.items()},
    }


def _flange(robots: Mapping[str, Robot], points: PointSet, source: str) -> dict[str, Any]:
    out = {}
    for name, robot in robots.items():
        errors = accuracy.tip_errors(robot, points, source)
        turned = dict(_known(rotation_statistics(errors.rotation)))
        turned["mean_plus_3sigma_deg"] = turned["mean_deg"] + 3 * turned["sigma_deg"]
        out[name] = {"position": statistics(errors.position), "orientation": turned}
    return out


def _verified(
    calibration: Record, robot: Robot, points: PointSet, verified: table.MeasurementsLike
) -> Mapping[str, Any]:
    measured = table.read(verified).of_arm(calibration.arm())
    points_verified = prepare(measured, calibration).points
    refuse_far_points(robot, points_verified, distances(robot, points_verified), measured, False)
    return accuracy.expected_and_verified(robot, calibration.arm(calibrated=False), points, points_verified)
