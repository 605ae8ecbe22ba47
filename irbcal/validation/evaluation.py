"""Errors of a calibration and of its nominal robot on other measurements (Nubiola 2011, section 7.6)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from irbcal.arrays import FloatArray, group_means
from irbcal.declared_options import takes_fields_of
from irbcal.error_statistics import FOUR, headed, orientation_line, rotation_statistics, statistics, statistics_table
from irbcal.errors import MeasurementError
from irbcal.io.opening import CalibrationLike
from irbcal.io.schema import Record
from irbcal.measurement import long_files, table
from irbcal.measurement.cleaning import Exclusion, left_out
from irbcal.measurement.input_table import with_extra_columns
from irbcal.measurement.points import PointSet, distances
from irbcal.modeling import frames
from irbcal.modeling.certainty import Certainty
from irbcal.modeling.commanded_joints import line_at_home
from irbcal.modeling.robot import Robot
from irbcal.parallel import on_workers
from irbcal.plotting.pose_sets import ModelErrors, PoseErrors
from irbcal.summary import Paragraph, Remark, Result, Table, TableValue, remarks, simulated_mark, values
from irbcal.units import MM
from irbcal.validation import accuracy
from irbcal.validation.accuracy import coverage, coverage_in_words
from irbcal.validation.cleaned_points import (
    CleanedPoints,
    prepare,
    refuse_far_points,
)
from irbcal.validation.conformity import Conformity, Region, conformity, region
from irbcal.validation.evaluation_options import EvaluationOptions
from irbcal.validation.frame_of_calibration import with_payload_column
from irbcal.validation.judged_points import (
    GROUPINGS,
    MODELS,
    ByModel,
    ErrorStatistics,
    EvaluationRequest,
    JudgedPoints,
    PreparedPoints,
    joined_pieces,
    prepared,
)
from irbcal.validation.length_scale import length_scale, scale_in_words
from irbcal.validation.provenance import Origin, origin
from irbcal.validation.refit import Refit
from irbcal.validation.verdict import Verdict, rejected_count
from irbcal.validation.verdict import verdict as verdict_of_points
from irbcal.wording import first_of

if TYPE_CHECKING:
    import pandas as pd

    from irbcal.plotting.pose_errors import PoseErrorPlots


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
        How many measured coordinates (lengths of moves, where the base was fitted again) lie within the predicted 95 %
        intervals, see `irbcal.validation.accuracy`; None where nothing is known of the calibration's certainty.
    excluded : tuple of Exclusion
    verdict : Verdict
        Better than the nominal robot, no better or worse, and whether that may be trusted.
    notes : tuple of str
    simulated : bool
    model : str
        Level of the calibration.
    refit_base, refit_tool : bool
        What was fitted again.
    placing : int
        Poses that placed it and are not judged; zero where the judged ones did.
    errors : PoseErrors
        Of each point and pose.
    origin : Origin or None
        Robot, people, instruments, files with their hashes, and how many poses were new.
    conformity : Conformity or None
        Whether a tolerance is kept, where one was given.
    region : Region or None
        Where the judged poses are, and their share of the calibrated ranges.
    """

    nominal: ErrorStatistics
    calibrated: ErrorStatistics
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
    placing: int = 0
    origin: Origin | None = None
    conformity: Conformity | None = None
    region: Region | None = None

    CONTENT = " ".join(
        (
            *MODELS,
            *GROUPINGS,
            "percentiles largest_covers orientation intervals relative flange verified coverage excluded",
        )
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
            columns |= values(model, f"{name}_mm=distance {name}_deg?=rotation")
        columns |= values(e.models["calibrated"], "calibrated_dx_mm,calibrated_dy_mm,calibrated_dz_mm?=vector")
        return with_extra_columns(pd.DataFrame(columns), e.extra)

    @property
    def plot(self) -> PoseErrorPlots:
        """Figures of the errors: ``evaluation.plot.errors_by_pose()`` and others."""
        from irbcal.plotting.pose_errors import PoseErrorPlots

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
        if self.refit_base and not self.placing:
            lines.append("The base was fitted again to these points for each model: these are relative errors.")
        lines += left_out(self.excluded, None if verbose else 8)
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
        return [*lines, *remarks("Note", (*scope, *self.notes))]

    @property
    def _labels(self) -> dict[str, str]:
        return {"nominal": "nominal", "calibrated": f"model {self.model}"}

    def _error_table(self) -> Table:
        labelled = [("all", {"nominal": self.nominal, "calibrated": self.calibrated})]
        for kind in GROUPINGS:
            by_label = getattr(self, kind)
            labelled += by_label.items() if len(by_label) > 1 else ()
        entries = [
            (label, words, by_model[name]) for label, by_model in labelled for name, words in self._labels.items()
        ]
        mark = simulated_mark(self.simulated)
        return statistics_table(f"{mark}position errors of model {self.model}, mm", entries, bold={1})

    def _interval_table(self, intervals: Mapping[str, Any]) -> list[Paragraph]:
        keys = dict(headed("mean", "sigma", "mean_plus_3sigma"))
        keys |= {f"{p} % of the points below": f"p{p}_mm" for p in accuracy.PERCENTILES}
        rows: list[tuple[TableValue, ...]] = []
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
        labelled = [*shares["parts"].items(), *((f"target {name}", row) for name, row in shares["targets"].items())]
        rows = tuple((label, row["n"], row["inside"], row["u95_mm"]) for label, row in labelled)
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
        columns = headed(*FOUR, unit=unit)
        rows = tuple((label, *(errors[name][key] for _, key in columns)) for name, label in self._labels.items())
        return Table(title, ("model", *(heading for heading, _ in columns)), rows, digits)


def _verified_table(errors: Mapping[str, Any]) -> list[Paragraph]:
    """Expected beside verified errors, and what speaks against the comparison."""
    by_label = {"": errors, **{f"{group}: ": values for group, values in errors["per_group"].items()}}
    columns = headed("n", *FOUR)
    rows: list[tuple[TableValue, ...]] = [
        (f"{label}{name}", *(values[name][key] for _, key in columns))
        for label, values in by_label.items()
        for name in ("uncorrected", "expected", "verified")
        if values[name]
    ]
    headings = ("", *(heading for heading, _ in columns))
    lines: list[Paragraph] = [Table("Expected against verified errors, mm", headings, tuple(rows))]
    unlike = errors["poses"]["set_aside"]
    if unlike:
        why = "verified poses left out, because their commands are no fake targets of this calibration"
        lines.append(Remark("Note", f"{why}: {first_of(unlike, 8)}"))
    if errors["command_mm"] > 0.1:
        missed = (
            f"the verified commands miss this calibration's own fake targets by up to {errors['command_mm']:.3f} mm: "
            "they are not its fake targets for poses of these names (not filtered, filtered with another calibration, "
            "or poses named otherwise)"
        )
        lines.append(Remark("Note", missed))
    return lines


@on_workers
@takes_fields_of(EvaluationOptions)
def evaluate(options: EvaluationOptions) -> Evaluation:
    """Errors of a calibration and of its nominal robot on other measurements.

    Files of a million rows and more (CSV or Parquet) are judged in pieces, in memory that hardly grows with them: all
    points are judged, while figures, doubts of the whole and the region come from poses drawn at random. Repeats of a
    pose are looked for within a piece. What needs all points at once is not done so: ``refit_base``, ``refit_tool``,
    ``relative``, ``flange``, ``verified``, ``sphere``, reference points, sessions.

    Raises
    ------
    IrbcalError
        If an input is refused.
    """
    request = EvaluationRequest.from_options(options)
    file = None if request.needs_all_points else long_files.long_file(options.measurements)
    if file is not None and not long_files.read(file.pieces[0]).is_reference().any():
        judged_points, drawn = joined_pieces(request, file, options.progress)
        sample = prepared(request, replace(table.read(drawn), source=file.path, sha256=file.sha256))
        return _evaluation(options.calibration, request, sample, sample.judged(), judged_points)
    sample = prepared(request, with_payload_column(table.read(options.measurements), options.payload))
    judged_points = sample.judged()
    return _evaluation(options.calibration, request, sample, judged_points, judged_points)


def _evaluation(
    calibration: CalibrationLike,
    request: EvaluationRequest,
    sample: PreparedPoints,
    errors_of_sample: JudgedPoints,
    judged_points: JudgedPoints,
) -> Evaluation:
    """The evaluation of what was judged; ``sample`` are all of its points, or those drawn from a long file.

    Figures, coverage and the region are those of ``sample``.
    """
    record, options, refit, errors = request.record, request.options, request.refit, judged_points.errors
    robots, points, source = sample.robots, sample.cleaned.points, sample.cleaned.measurements.source
    calibrated = robots["calibrated"]
    fit = record.used_points(heldout=False)
    covered = region(calibrated, points, None if fit is None else fit[0])
    link_lengths = length_scale(record.arm(calibrated=False), record.arm())
    scope = (
        *_scope(refit, options.sphere, sample.cleaned),
        scale_in_words(link_lengths, points.xyz, request.info.get("scale_bar", "")),
        *_open_ends(calibrated.certainty),
    )
    overall, percentiles = errors.statistics(), errors.percentiles()
    simulated = judged_points.simulated or sample.cleaned.measurements.simulated or record.simulated
    outcome = verdict_of_points(
        errors.distance["nominal"] / MM,
        errors.distance["calibrated"] / MM,
        errors.pose,
        rejected_count(judged_points.excluded),
        judged_points.proven,
        judged_points.against,
        basis=judged_points.basis,
    )
    kept = None
    if request.required is not None:
        kept = conformity(
            request.required,
            {**overall["calibrated"], **percentiles["calibrated"]},
            errors.distance["calibrated"],
            errors.repeat_groups,
            outcome,
            poses=judged_points.poses,
            declared_u95=[judged_points.u95],
            region=covered,
            simulated=simulated,
            seed=options.seed,
        )
    of_sample = origin(calibration, record, sample.cleaned, request.info, scope)
    of_parts: dict[str, Any] = errors.by_label(errors.statistics)
    return Evaluation(
        **overall,
        **of_parts,
        percentiles=percentiles,
        largest_covers=accuracy.largest_covers(len(np.unique(errors.repeat_groups))),
        orientation=errors.orientation(),
        intervals=errors.intervals(options.seed) if options.intervals else None,
        coverage=coverage(calibrated, points, moves=refit.base),
        relative=None
        if options.relative is None
        else _relative(robots, points, options.relative, options.frame_points, source),
        flange=_flange(robots, points, source) if options.flange else None,
        verified=None if options.verified is None else _verified(record, calibrated, points, options.verified),
        excluded=judged_points.excluded,
        verdict=outcome,
        notes=judged_points.notes,
        simulated=simulated,
        model=record.model,
        refit_base=refit.base,
        refit_tool=refit.tool,
        placing=sample.cleaned.placing,
        errors=_pose_errors(robots, sample.cleaned, errors_of_sample.errors.distance),
        origin=replace(
            of_sample, poses=judged_points.poses, fitted=judged_points.fitted, counted_out=judged_points.counted_out
        ),
        region=covered,
        conformity=kept,
    )


def _scope(refit: Refit, sphere: Sequence[float] | None, cleaned: CleanedPoints) -> tuple[str, ...]:
    """What an evaluation is limited to, in sentences."""
    out = []
    if refit.base and not cleaned.placing:
        out.append("The base was fitted again to the judged poses themselves: these are relative errors.")
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


def _pose_errors(robots: Mapping[str, Robot], cleaned: CleanedPoints, errors: Mapping[str, FloatArray]) -> PoseErrors:
    points = cleaned.points
    T_base_world = frames.inverse(robots["nominal"].T_world_base)
    models = {
        name: ModelErrors(
            all_points,
            errors[name],
            group_means(errors[name], points.pose, points.poses),
            None,
            accuracy.error_vectors(robot, points) @ T_base_world[:3, :3].T,
            accuracy.turns(robot, points),
        )
        for name, robot in robots.items()
        if (all_points := statistics(errors[name])) is not None
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
        turned = dict(rotation_statistics(errors.rotation) or {})
        sigma = turned["sigma_deg"]
        turned["mean_plus_3sigma_deg"] = None if sigma is None else turned["mean_deg"] + 3 * sigma
        out[name] = {"position": statistics(errors.position), "orientation": turned}
    return out


def _verified(
    calibration: Record, robot: Robot, points: PointSet, verified: table.MeasurementsLike
) -> Mapping[str, Any]:
    measured = table.read(verified).of_arm(calibration.arm())
    points_verified = prepare(measured, calibration).points
    refuse_far_points(robot, points_verified, distances(robot, points_verified), measured, False)
    return accuracy.expected_and_verified(robot, calibration.arm(calibrated=False), points, points_verified)
