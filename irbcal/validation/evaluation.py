"""What an evaluation found: errors of a calibration and of its nominal robot, as words, tables and figures."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from irbcal.measurement.cleaning import Exclusion, left_out
from irbcal.plotting import pose_errors
from irbcal.plotting.charts import Chart
from irbcal.plotting.pose_errors import PoseErrors
from irbcal.summary import Cell, Paragraph, Result, Table, simulated_mark
from irbcal.units import MM
from irbcal.validation import accuracy
from irbcal.validation.conformity import Conformity
from irbcal.validation.coverage import coverage_in_words
from irbcal.validation.origin import Origin
from irbcal.validation.region import Region
from irbcal.validation.verdict import Verdict

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
    intervals, relative, flange, comparison, verified : dict or None
        Where asked for.
    coverage : dict or None
        How many measured coordinates lie within the predicted 95 % intervals, see `irbcal.validation.coverage`; None
        where nothing is known of the calibration's certainty, or the base was placed anew.
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
    comparison: Mapping[str, Any] | None
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

    def to_dict(self) -> dict[str, Any]:
        """What ``irbcal evaluate --json`` prints."""
        names = (*MODELS, *PARTS, "percentiles", "largest_covers", "orientation", "intervals", "relative", "flange")
        return {
            **{name: getattr(self, name) for name in (*names, "comparison", "verified", "coverage")},
            "excluded": [vars(point) for point in self.excluded],
            "notes": list(self.notes),
            "simulated": self.simulated,
            "verdict": self.verdict.to_dict(),
            "origin": None if self.origin is None else self.origin.to_dict(),
            "region": None if self.region is None else self.region.to_dict(),
            "conformity": None if self.conformity is None else self.conformity.to_dict(),
        }

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
    def plot(self) -> EvaluationPlots:
        """Figures of the errors: ``evaluation.plot.errors_by_pose()`` and others."""
        return EvaluationPlots(self)

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
        judged = () if self.conformity is None else self.conformity.report()
        lines: list[Paragraph] = [*judged, *self.verdict.report(), self._error_table(labels)]
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
            self._comparison,
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
            columns = ("", "coordinates", "within", "half-width (median, mm)")
            lines.append(Table("Coordinates within the predicted 95 % intervals (share)", columns, rows, 3))
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

    def _comparison(self, labels: Mapping[str, str]) -> list[Paragraph]:
        compared = self.comparison
        if compared is None:
            return []
        rows = (
            (labels["calibrated"], *(compared["this"][key] for key in FOUR)),
            (f"other, model {compared['other_model']}", *(compared["other"][key] for key in FOUR)),
        )
        title = f"Two calibrations on the same {compared['poses']} poses, mm"
        share = f"{compared['other_better_share']:.0%}"
        return [
            Table(title, ("", "mean", "sigma", "max", "mean+3σ"), rows),
            f"{compared['verdict']} The other has the smaller error in {share} of the poses.",
        ]

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


@dataclass(frozen=True, eq=False, repr=False)
class EvaluationPlots:
    """Figures of an evaluation; each shows itself in a notebook and has ``save(path)`` for PNG and SVG."""

    _evaluation: Evaluation

    def __repr__(self) -> str:
        return f"<Figures of {self._evaluation!r}>"

    def _of(self, draw: Callable[[PoseErrors], Chart]) -> Chart:
        return draw(self._evaluation.errors).marked(self._evaluation.simulated)

    def before_and_after(self) -> Chart:
        """Mean error and the largest error of both models."""
        return self._of(pose_errors.before_and_after)

    def errors_by_pose(self) -> Chart:
        """Mean error of each pose in order of measurement."""
        return self._of(pose_errors.errors_by_pose)

    def distribution(self) -> Chart:
        """Histogram of the errors, and errors against normal quantiles."""
        return self._of(pose_errors.distribution)

    def workspace(self) -> Chart:
        """Mean error of each pose where it was measured."""
        return self._of(pose_errors.workspace)

    def vectors(self) -> Chart:
        """Error vectors, enlarged, where they were measured."""
        return self._of(pose_errors.vectors)


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
