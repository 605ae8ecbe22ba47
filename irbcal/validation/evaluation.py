"""Errors of a calibration and of its nominal robot on other measurements (Nubiola 2011, section 7.6)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from irbcal import parallel
from irbcal.arrays import BoolArray, FloatArray, NameArray
from irbcal.errors import MeasurementError, OptionError
from irbcal.io.opening import CalibrationLike, open_calibration
from irbcal.io.schema import Record
from irbcal.measurement import pieces, table
from irbcal.measurement.cleaning import Exclusion, left_out
from irbcal.measurement.motions import with_last_moves
from irbcal.measurement.points import PointSet, distances, rotation_distances
from irbcal.measurement.reading_lag import mixed_use
from irbcal.measurement.repeats import repeat_groups
from irbcal.measurement.table import shared_table
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
from irbcal.validation.length_scale import length_scale, scale_in_words
from irbcal.validation.origin import Origin, checked_info, origin
from irbcal.validation.refit import Refit
from irbcal.validation.verdict import (
    Conformity,
    Region,
    Rule,
    Verdict,
    check_options,
    conformity,
    counted,
    expanded_uncertainty,
    region,
)
from irbcal.validation.verdict import verdict as verdict_of_points

if TYPE_CHECKING:
    import pandas as pd


PARTS = ("per_target", "per_group", "per_payload", "per_group_payload")
MODELS = ("nominal", "calibrated")
KEYS = ("n", "mean_mm", "sigma_mm", "max_mm", "mean_plus_3sigma_mm", "rms_mm")
FOUR = ("mean_mm", "sigma_mm", "max_mm", "mean_plus_3sigma_mm")

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
        """A row a point: pose, group, target, nominal_mm, calibrated_mm; degrees where orientations were measured."""
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
        return pd.DataFrame(columns)

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
        labels = {"nominal": "nominal", "calibrated": f"model {self.model}"}
        conformity = () if self.conformity is None else self.conformity.report()
        lines: list[Paragraph] = [*conformity, *self.verdict.report(), self._error_table(labels)]
        if self.refit_base and not self.refit_tool and not any("was placed anew on" in note for note in self.notes):
            lines.append("The base was placed anew on these points for each model: these are relative errors.")
        if self.excluded:
            count = f"{len(self.excluded)} point{'' if len(self.excluded) == 1 else 's'}"
            lines += [f"Left out: {count}", *left_out(self.excluded, None if verbose else 8)]
        for name, label in labels.items() if self.orientation else ():
            assert self.orientation is not None
            lines.append(orientation_line(label, self.orientation[name]))
        for section in (
            self._intervals,
            self._coverage,
            self._flange,
            self._relative,
            self._verified,
        ):
            lines += section(labels)
        scope = () if self.conformity is None or self.origin is None else self.origin.scope
        lines += [f"Note: {text}" for text in scope]
        return [*lines, *(f"Note: {note}" for note in self.notes if note not in self.verdict.doubts)]

    def _error_table(self, labels: Mapping[str, str]) -> Table:
        entries = [("all", label, getattr(self, name)) for name, label in labels.items()]
        for part in PARTS:
            by_label = getattr(self, part)
            if len(by_label) > 1:
                entries += [
                    (label, words, errors[name]) for label, errors in by_label.items() for name, words in labels.items()
                ]
        kind = simulated_mark(self.simulated)
        return statistics_table(f"{kind}position errors of model {self.model}, mm", entries, bold={1})

    def _intervals(self, labels: Mapping[str, str]) -> list[Paragraph]:
        if self.intervals is None:
            return []
        rows: list[tuple[Cell, ...]] = []
        for name, words in labels.items():
            ends, values = self.intervals[name] or {}, {**getattr(self, name), **self.percentiles[name]}
            for label, key in (
                ("mean", "mean_mm"),
                ("sigma", "sigma_mm"),
                ("mean + 3σ", "mean_plus_3sigma_mm"),
                *((f"{p} % of the points below", f"p{p}_mm") for p in accuracy.PERCENTILES),
            ):
                end = ends.get(key)
                rows.append((label, words, values[key], "–" if end is None else f"{end[0]:.3f} … {end[1]:.3f}"))
        level, resamples = self.intervals["level"], self.intervals["resamples"]
        title = f"Bootstrap intervals ({level:.0%}, {resamples} resamples of the poses), mm"
        return [
            Table(title, ("", "model", "value", "interval"), tuple(rows)),
            f"With 95 % confidence {self.largest_covers:.1%} of all such poses stay below the largest error seen.",
        ]

    def _coverage(self, labels: Mapping[str, str]) -> list[Paragraph]:
        shares = self.coverage
        if shares is None:
            return []
        lines: list[Paragraph] = [coverage_in_words(shares)]
        if self.intervals is not None:
            rows = tuple(
                (name, *(row[key] for key in ("n", "inside", "u95_mm"))) for name, row in shares["parts"].items()
            )
            columns = ("", shares["of"], "within", "half-width (median, mm)")
            title = f"{shares['of'].capitalize()} within the predicted 95 % intervals (share)"
            lines.append(Table(title, columns, rows, 3))
        return lines

    def _flange(self, labels: Mapping[str, str]) -> list[Paragraph]:
        lines: list[Paragraph] = []
        for quantity, unit, digits in (("position", "mm", 3), ("orientation", "deg", 4)) if self.flange else ():
            assert self.flange is not None
            keys = [f"{key}_{unit}" for key in ("mean", "sigma", "max", "mean_plus_3sigma")]
            rows = tuple((label, *(self.flange[name][quantity][key] for key in keys)) for name, label in labels.items())
            n = self.flange["nominal"][quantity]["n"]
            title = f"{quantity.capitalize()} errors of the flange ({n} poses), {unit}"
            lines.append(Table(title, ("model", "mean", "sigma", "max", "mean+3σ"), rows, digits))
        return lines

    def _relative(self, labels: Mapping[str, str]) -> list[Paragraph]:
        errors = self.relative
        if errors is None:
            return []
        rows = tuple((label, *(errors[name][key] for key in FOUR)) for name, label in labels.items())
        virtual = errors["kind"] == "virtual"
        how = "from a virtual frame" if virtual else f"in the frame of {', '.join(errors['points'])}"
        lines: list[Paragraph] = [
            Table(f"Relative position errors {how}, mm", ("model", "mean", "sigma", "max", "mean+3σ"), rows)
        ]
        if virtual:
            x, y, z = errors["shift_mm"]["calibrated"]
            lines.append(
                f"Shift taken off for {labels['calibrated']}: {x:+.3f}, {y:+.3f}, {z:+.3f} mm in the base link"
            )
        return lines

    def _verified(self, labels: Mapping[str, str]) -> list[Paragraph]:
        errors = self.verified
        if errors is None:
            return []
        names = ("uncorrected", "expected", "verified")
        rows: list[tuple[Cell, ...]] = [(name, errors[name]["n"], *(errors[name][k] for k in FOUR)) for name in names]
        for group, values in errors["per_group"].items():
            rows += [
                (f"{group}: {name}", values[name]["n"], *(values[name][k] for k in FOUR))
                for name in names
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
        What the calibrated robot is judged by, metres, see `irbcal.validation.verdict`.
    rule : {"mean3sigma", "max", "percentile"}, optional
        What must be within the tolerance; mean + 3 sigma unless given; ``percentile`` is the 95th.
    tracker_u95 : float, optional
        Expanded uncertainty (95 %) of a measured position, metres, which is added to the upper bound of that figure; by
        default the largest ``u95_mm`` of the measurements, else `irbcal.validation.verdict.ASSUMED_U95`.
    region_only : bool
        Judge the tolerance for the region of these poses only, which the certificate states; else they must cover the
        calibrated ranges, see `irbcal.validation.verdict`.
    info : dict of str to str, optional
        What a certificate tells besides: ``serial_number``, ``operator`` and others of
        `irbcal.validation.origin.FIELDS`, or any name. Columns of the measurements with these names are taken, too.
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
    record = open_calibration(calibration)
    check_seed(seed)
    if sphere is not None:
        place("sphere", sphere, "x, y, z of the centre and the diameter in metres", (4,))
    if relative is not None:
        checked("relative", relative, RELATIVE)
    if frame_points is not None and relative != "three-points":
        raise OptionError("frame_points: only relative='three-points' takes them", parameter="frame_points")
    judged_by, stated = check_options(tolerance, rule, tracker_u95, region_only), checked_info(info)
    whole = refit_base or refit_tool or refit_zeros or relative or flange or verified is not None or sphere is not None
    if not whole and (file := pieces.long_file(measurements)) is not None:
        drawn = -(-MOST_POSES // len(file.pieces))
        shared = _OfAllPieces(record, file.sha256, payload, same_tool, include_fitted, drawn, seed)
        if not pieces.read(file.pieces[0]).is_reference().any():
            judged_pieces, stopped = _in_pieces(shared, file, progress)
            import pandas as pd

            rows = pd.concat([part.drawn for part in judged_pieces], ignore_index=True)
            some = replace(table.read(rows), source=file.path, sha256=file.sha256)
            sample = evaluate(
                calibration,
                some,
                intervals=intervals,
                include_fitted=include_fitted,
                seed=seed,
                payload=None if "payload_kg" in rows else payload,
                same_tool=same_tool,
                info=info,
            )

            def judge(
                figures: Mapping[str, float],
                error: NDArray[Any],
                position: NDArray[Any],
                outcome: Verdict,
                poses: int,
                u95: float,
            ) -> Conformity | None:
                if tolerance is None:
                    return None
                tracker = expanded_uncertainty(np.array([u95]), tracker_u95)
                return conformity(
                    figures,
                    error,
                    position,
                    outcome,
                    tolerance,
                    judged_by,
                    poses=poses,
                    tracker=tracker,
                    region=sample.region,
                    region_only=region_only,
                    simulated=sample.simulated,
                    seed=seed,
                )

            return _of_long_file(judged_pieces, sample, judge, intervals, seed, stopped)
    measurements = carrying(table.read(measurements), payload)
    refit = Refit(refit_base, refit_tool, refit_from, seed, lost_joints(refit_zeros, record.arm(calibrated=False)))
    cleaned, robots = in_frame_of_calibration(record, measurements, refit, same_tool)
    cleaned = without_fitted(cleaned.without_copies(), record, include_fitted)
    against = doubts_of(cleaned.points, robots["calibrated"], record)
    cleaned = _inside(cleaned, robots["calibrated"], sphere)
    measured, points = cleaned.measurements, cleaned.points
    errors = {name: distances(robot, points) for name, robot in robots.items()}
    turns = {name: rotation_statistics(rotation_distances(robot, points)) for name, robot in robots.items()}
    labels_of = _parts(cleaned)

    def by_model(mask: BoolArray) -> ByModel:
        return {name: _known(statistics(error[mask])) for name, error in errors.items()}

    of_parts = {kind: _by_label(labels, by_model) for kind, labels in labels_of.items()}
    fit = record.used_points(heldout=False)
    covered = region(robots["calibrated"], points, None if fit is None else fit[0])
    scale = scale_in_words(
        length_scale(record.arm(calibrated=False), record.arm()), points.xyz, stated.get("scale_bar", "")
    )
    overall = by_model(np.ones(len(points), dtype=bool))
    percentiles = {name: _known(accuracy.percentiles(error)) for name, error in errors.items()}
    covers, simulated = (
        accuracy.largest_covers(len(np.unique(repeat_groups(points)))),
        measured.simulated or record.simulated,
    )
    outcome = verdict_of_points(
        errors["nominal"] / MM,
        errors["calibrated"] / MM,
        cleaned.number[points.pose],
        counted(cleaned.excluded),
        cleaned.proven,
        against,
        basis=cleaned.basis,
    )
    return Evaluation(
        nominal=overall["nominal"],
        calibrated=overall["calibrated"],
        per_target=of_parts["per_target"],
        per_group=of_parts["per_group"],
        per_payload=of_parts["per_payload"],
        per_group_payload=of_parts["per_group_payload"],
        percentiles=percentiles,
        largest_covers=covers,
        orientation={name: _known(turn) for name, turn in turns.items()} if turns["nominal"] else None,
        intervals=_intervals(errors, points, labels_of, seed) if intervals else None,
        coverage=coverage(robots["calibrated"], points, moves=refit_base),
        relative=_relative(robots, points, relative, frame_points, measured.source) if relative else None,
        flange=_flange(robots, points, measured.source) if flange else None,
        verified=None if verified is None else _verified(record, robots["calibrated"], points, verified),
        excluded=tuple(cleaned.excluded),
        verdict=outcome,
        notes=(*against, *_notes(cleaned, record)),
        simulated=simulated,
        model=record.model,
        refit_base=refit_base,
        refit_tool=refit_tool,
        errors=_pose_errors(robots, points, errors),
        origin=origin(
            calibration,
            record,
            cleaned,
            stated,
            (*_scope(refit, sphere, cleaned), scale, *_open_ends(robots["calibrated"].certainty)),
        ),
        region=covered,
        conformity=None
        if tolerance is None
        else conformity(
            {**overall["calibrated"], **percentiles["calibrated"]},
            errors["calibrated"],
            repeat_groups(points)[points.pose],
            outcome,
            tolerance,
            judged_by,
            poses=points.poses,
            tracker=expanded_uncertainty(points.u95, tracker_u95),
            region=covered,
            region_only=region_only,
            simulated=simulated,
            seed=seed,
        ),
    )


MOST_POSES = 20_000
"""Poses of a long file that figures, doubts and the region come from."""


@dataclass(frozen=True, eq=False)
class _OfAllPieces:
    """What all pieces of a long file have in common; so many poses of each are ``drawn``."""

    record: Record
    sha256: str
    payload: float | None
    same_tool: bool
    include_fitted: bool
    drawn: int
    seed: int


@dataclass(frozen=True, eq=False)
class _Judged:
    """What is kept of the points of a piece of a long file: m points.

    Attributes
    ----------
    errors, turns : dict of str to ndarray
        Distances (m,), and angles where orientations were measured, by model; four bytes each.
    labels, names : dict of str to ndarray of int (m,) and list of str
        Of each of `PARTS`: which name each point has; one number where all have the same.
    pose : ndarray of int, shape (m,)
        Numbers of the poses.
    place : ndarray of int, shape (n,), or None
        Place of each pose; None where each has its own.
    cleaned : CleanedPoints
        Without its points.
    poses, fitted : int
    against, notes : tuple of str
    u95 : float
        The largest uncertainty that is stated; not a number where none is.
    drawn : DataFrame
        Rows of some poses.
    """

    errors: Mapping[str, NDArray[np.float32]]
    turns: Mapping[str, NDArray[np.float32]]
    labels: Mapping[str, NDArray[Any]]
    names: Mapping[str, list[str]]
    pose: NDArray[np.int32]
    place: NDArray[np.int32] | None
    poses: int
    fitted: int | None
    counted_out: int
    excluded: tuple[Exclusion, ...]
    proven: bool
    basis: str
    against: tuple[str, ...]
    notes: tuple[str, ...]
    u95: float
    simulated: bool
    drawn: pd.DataFrame


def _judged_piece(shared: _OfAllPieces, piece: pieces.Piece) -> _Judged:
    """In a worker: read and judge a piece of a long file."""
    import pandas as pd

    record = shared.record
    measurements = carrying(pieces.read(piece, shared.sha256), shared.payload)
    cleaned, robots = in_frame_of_calibration(record, measurements, NOTHING, shared.same_tool)
    cleaned = without_fitted(cleaned.without_copies(), record, shared.include_fitted)
    points = cleaned.points
    coded = {part: pd.factorize(labels) for part, labels in _parts(cleaned).items()}
    rng = np.random.default_rng([shared.seed, piece.row])
    drawn = rng.permutation(cleaned.number)[: shared.drawn]
    rows = shared_table(measurements)
    return _Judged(
        {name: distances(robot, points).astype(np.float32) for name, robot in robots.items()},
        {name: rotation_distances(robot, points).astype(np.float32) for name, robot in robots.items()},
        {
            part: codes.astype(np.min_scalar_type(len(names)))[: len(codes) if len(names) > 1 else 1]
            for part, (codes, names) in coded.items()
        },
        {part: [str(name) for name in names] for part, (_, names) in coded.items()},
        points.pose.astype(np.int32),
        None if np.array_equal(place := repeat_groups(points), np.arange(points.poses)) else place.astype(np.int32),
        points.poses,
        None if cleaned.at_fitted is None else int(cleaned.at_fitted.sum()),
        cleaned.counted_out,
        cleaned.excluded,
        cleaned.proven,
        cleaned.basis,
        tuple(doubts_of(points, robots["calibrated"], record)),
        _notes(cleaned, record),
        np.nan if points.u95 is None or not np.isfinite(points.u95).any() else float(np.nanmax(points.u95)),
        measurements.simulated,
        measurements.to_frame()[rows["pose_index"].isin(drawn).to_numpy()],
    )


def _in_pieces(
    shared: _OfAllPieces, file: pieces.LongFile, progress: Callable[[str], Any] | None
) -> tuple[list[_Judged], tuple[str, ...]]:
    """Judge the pieces of a long file side by side; those that were judged before Ctrl-C, and a note of that."""
    done: dict[int, _Judged] = {}
    note: tuple[str, ...] = ()
    try:
        for index, judged_piece in parallel.each(_judged_piece, shared, file.pieces, seconds=PIECE_S):
            done[index] = judged_piece
            if progress is not None:
                progress(f"{len(done)} of {len(file.pieces)} pieces")
    except KeyboardInterrupt:
        if not done:
            raise
        note = (f"Stopped after {len(done)} of {len(file.pieces)} pieces of the file: the rest was not judged.",)
    return [done[index] for index in sorted(done)], note


PIECE_S = 1.0
"""Seconds that a piece of a long file takes, about."""


def _joined(parts: Sequence[NDArray[np.int32]]) -> NDArray[np.int32]:
    """Numbers of all pieces, those of each beyond those of the one before."""
    out, begin = [], 0
    for numbers in parts:
        out.append(numbers + np.int32(begin))
        begin += int(numbers.max(initial=-1)) + 1
    return np.concatenate(out)


def _same_codes(parts: Sequence[_Judged], kind: str) -> tuple[NDArray[Any], list[str]]:
    """Labels of all pieces with the same numbers."""
    names = list(dict.fromkeys(name for part in parts for name in part.names[kind]))
    number = {name: k for k, name in enumerate(names)}
    code = np.min_scalar_type(len(names))
    if len(names) == 1:
        return np.broadcast_to(np.zeros(1, dtype=code), sum(len(part.pose) for part in parts)), names
    codes = [
        np.broadcast_to(np.array([number[n] for n in part.names[kind]], dtype=code)[part.labels[kind]], len(part.pose))
        for part in parts
    ]
    return np.concatenate(codes), names


def _of_long_file(
    parts: list[_Judged],
    sample: Evaluation,
    judge: Callable[[Mapping[str, float], NDArray[Any], NDArray[Any], Verdict, int, float], Conformity | None],
    intervals: bool,
    seed: int,
    stopped: tuple[str, ...],
) -> Evaluation:
    """The evaluation of poses drawn from a long file, with the errors of all."""
    pose = position = _joined([part.pose for part in parts])
    if any(part.place is not None for part in parts):
        places = [np.arange(part.poses, dtype=np.int32) if part.place is None else part.place for part in parts]
        position = _joined([place[part.pose] for place, part in zip(places, parts, strict=True)])
    errors = {name: np.concatenate([part.errors[name] for part in parts]) for name in MODELS}
    turns = {name: rotation_statistics(np.concatenate([part.turns[name] for part in parts])) for name in MODELS}
    coded = {kind: _same_codes(parts, kind) for kind in PARTS}
    none = np.zeros(0, dtype=np.int32)
    parts[:] = [replace(part, errors={}, turns={}, labels={}, pose=none, place=None) for part in parts]

    def by_model(mask: BoolArray) -> ByModel:
        return {name: _known(statistics(error[mask])) for name, error in errors.items()}

    def with_intervals(mask: BoolArray) -> dict[str, Any]:
        return {name: accuracy.intervals(error[mask], position[mask], seed=seed) for name, error in errors.items()}

    of_parts: dict[str, Any] = {}
    ends: dict[str, Any] = {}
    for kind in PARTS:
        codes, names = coded[kind]
        ordered = [(k, name) for k, name in sorted(enumerate(names), key=lambda pair: pair[1]) if name]
        of_parts[kind] = {name: by_model(codes == k) for k, name in ordered}
        if intervals:
            ends[kind] = {name: with_intervals(codes == k) for k, name in ordered}
    everything = np.ones(len(pose), dtype=bool)
    overall = by_model(everything)
    percentiles = {name: _known(accuracy.percentiles(error)) for name, error in errors.items()}
    excluded = tuple(exclusion for part in parts for exclusion in part.excluded)
    against = (*pieces.once((text for part in parts for text in part.against), len(parts)), *stopped)
    notes = pieces.once((text for part in parts for text in part.notes), len(parts))
    proven = all(part.proven for part in parts)
    basis = next((part.basis for part in parts if part.basis), "")
    outcome = verdict_of_points(
        errors["nominal"] / np.float32(MM),
        errors["calibrated"] / np.float32(MM),
        pose,
        counted(excluded),
        proven,
        against,
        basis=basis,
    )
    poses = sum(part.poses for part in parts)
    fitted = [part.fitted for part in parts]
    u95 = np.array([part.u95 for part in parts])
    text = f"A file of {len(parts)} pieces: errors are of all {len(pose):,} points, figures of poses drawn at random."
    assert sample.origin is not None
    origin_of_all = replace(
        sample.origin,
        poses=poses,
        fitted=None if None in fitted else sum(filter(None, fitted)),
        counted_out=sum(part.counted_out for part in parts),
    )
    figures = {**overall["calibrated"], **percentiles["calibrated"]}
    return replace(
        sample,
        nominal=overall["nominal"],
        calibrated=overall["calibrated"],
        **of_parts,
        percentiles=percentiles,
        largest_covers=accuracy.largest_covers(int(position.max(initial=-1)) + 1),
        orientation={name: _known(turn) for name, turn in turns.items()} if turns["nominal"] else None,
        intervals=None
        if sample.intervals is None
        else {**{key: sample.intervals[key] for key in ("level", "resamples", "seed")}, **with_intervals(everything)}
        | ends,
        excluded=excluded,
        verdict=outcome,
        notes=(text, *against, *notes),
        simulated=sample.simulated or any(part.simulated for part in parts),
        origin=origin_of_all,
        conformity=judge(figures, errors["calibrated"], position, outcome, poses, float(np.nanmax([*u95, -np.inf]))),
    )


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
    measured = table.read(measurements)
    measured = measured.of_arm(record.arm())
    cleaned = prepare(measured, record, any_target=refit.tool, same_tool=same_tool)
    robots = {"nominal": record.robot_nominal(), "calibrated": record.robot_calibrated()}

    def placed(points: PointSet) -> dict[str, Robot]:
        if not refit:
            return robots
        return {name: refit.placed(robot, points, measured.source) for name, robot in robots.items()}

    chosen, to_judge = (
        refit.chosen(cleaned.points, measured.source) if refit else (np.ones(cleaned.points.poses, bool),) * 2
    )
    placing = cleaned.points.select(chosen)
    robots, cleaned = placed(placing), cleaned.select(to_judge)
    points, notes = with_last_moves(robots["calibrated"], cleaned.points)
    cleaned = replace(cleaned, points=points, notes=(*cleaned.notes, *notes))
    if points.previous is None:
        placing = replace(placing, previous=None)
        robots = placed(placing)
    zeros = refit.zeros_in_words(record.robot_calibrated(), robots["calibrated"], placing)
    cleaned = replace(cleaned, notes=(*zeros, *cleaned.notes))
    if not to_judge[chosen].any():
        cleaned = replace(cleaned, notes=(*cleaned.notes, _placed_in_words(refit, placing.poses, points.poses)))
    error = distances(robots["calibrated"], cleaned.points)
    refuse_far_points(robots["calibrated"], cleaned.points, error, measured, bool(refit))
    lost = lost_row(robots["calibrated"], cleaned.points, error, measured)
    return replace(cleaned, notes=(*cleaned.notes, *lost)), robots


def _placed_in_words(refit: Refit, placing: int, judged: int) -> str:
    return (
        f"The {refit.what} {'were' if refit.base and refit.tool else 'was'} placed anew on {placing} poses of these "
        f"measurements, for each model; errors are those of the other {judged} poses."
    )


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
    notes = (*cleaned.notes, *mixed_use(record.programmed, measured.programmed, measured.source))
    return (*notes, *_other_loads(cleaned.points, record), *_outside_ranges(cleaned.points, record))


def carrying(measurements: table.MeasurementSet, payload: float | None) -> table.MeasurementSet:
    """Measurements with a load where they do not tell it."""
    if payload is None:
        return measurements
    if measurements.payloads() is not None:
        raise OptionError(
            "payload: the measurements tell it themselves (payload_kg): leave it out", parameter="payload"
        )
    load = number("payload", payload, 0.0)
    return replace(measurements, table=measurements.table.assign(payload_kg=load))


def _other_loads(points: PointSet, record: Record) -> list[str]:
    """That a joint map of one load is judged at others."""
    usual, loads = record.usual_load, points.payload_kg
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


def _outside_ranges(points: PointSet, record: Record) -> list[str]:
    """How many poses lie beyond the joint ranges of the calibration's fit, joint by joint."""
    certainty = record.robot_calibrated().certainty
    return [text] if certainty is not None and (text := certainty.outside_in_words(points.q)) else []


def _known(values: Statistics | None) -> Statistics:
    """Statistics of points that are there."""
    assert values is not None
    return values


def _pose_errors(robots: Mapping[str, Robot], points: PointSet, errors: Mapping[str, FloatArray]) -> PoseErrors:
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


def _by_label(labels: NameArray, compute: Callable[[BoolArray], T]) -> dict[str, T]:
    """``compute(mask)`` for each label but the empty one."""
    return {str(label): compute(labels == label) for label in sorted(set(labels)) if label}


def _intervals(
    errors: Mapping[str, FloatArray], points: PointSet, labelled: Mapping[str, NameArray], seed: int
) -> dict[str, Any]:
    position = repeat_groups(points)[points.pose]  # repeats of one place are drawn together

    def compute(mask: BoolArray) -> dict[str, Any]:
        return {name: accuracy.intervals(e[mask], position[mask], seed=seed) for name, e in errors.items()}

    return {
        "level": accuracy.LEVEL,
        "resamples": accuracy.RESAMPLES,
        "seed": seed,
        **compute(np.ones(len(points), dtype=bool)),
        **{kind: _by_label(labels, compute) for kind, labels in labelled.items()},
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
    measured = table.read(verified)
    measured = measured.of_arm(calibration.arm())
    points_verified = prepare(measured, calibration).points
    refuse_far_points(robot, points_verified, distances(robot, points_verified), measured, False)
    return accuracy.expected_and_verified(robot, calibration.arm(calibrated=False), points, points_verified)
