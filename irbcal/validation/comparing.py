"""Several calibrations side by side on the same points, pose by pose."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from irbcal.arrays import FloatArray, IntArray, NameArray, group_means
from irbcal.error_statistics import FOUR, headed
from irbcal.errors import MeasurementError, OptionError
from irbcal.io.calibration_folder import folder_of
from irbcal.io.opening import CalibrationLike, open_calibration
from irbcal.io.schema import Record
from irbcal.measurement import table
from irbcal.measurement.input_table import with_extra_columns
from irbcal.measurement.points import distances
from irbcal.measurement.repeats import repeat_groups
from irbcal.measurement.table import MeasurementsLike
from irbcal.modeling.robot import Robot
from irbcal.names import check_names
from irbcal.option_values import excerpt
from irbcal.option_values import seed as check_seed
from irbcal.plotting.charts import DASHED, DOT, TALL, WIDE, Chart, Drawing, LegendEntry, Panel, axis_top, span
from irbcal.summary import Content, Paragraph, Remark, Result, Table, TableValue, remarks, simulated_mark
from irbcal.units import MM
from irbcal.validation import accuracy
from irbcal.validation.cleaned_points import CleanedPoints, doubts_of, without_fitted
from irbcal.validation.frame_of_calibration import in_frame_of_calibration, with_payload_column
from irbcal.validation.refit import Refit
from irbcal.validation.verdict import NOT_TO_BE_TRUSTED
from irbcal.wording import counted

if TYPE_CHECKING:
    import pandas as pd

COLUMNS = headed(*FOUR, "p95")
COLOURS = ("calibrated", "nominal", "below", "above", "accent", "measured", "series2", "series3", "series4", "unknown")
"""Of calibrations in charts."""
MOST_CALIBRATIONS = 12
"""Calibrations that are compared."""


@dataclass(frozen=True)
class Pair(Content):
    """Two robots, pose by pose: two calibrations, or the nominal and the calibrated one."""

    CONTENT = "better worse difference_mm interval_mm significant"

    better: str
    worse: str
    """By the mean; that this is not chance only where ``significant``."""
    difference_mm: float
    """Mean error of the worse less that of the better."""
    interval_mm: tuple[float, ...] | None
    """Two numbers, of that difference; all pairs' intervals hold together with 95 % confidence (Bonferroni)."""

    @property
    def significant(self) -> bool:
        """Whether the difference is beyond chance."""
        return self.interval_mm is not None and self.interval_mm[0] > 0.0

    def sentence(self) -> str:
        """The two in words."""
        if self.interval_mm is None:
            return f"too few poses to distinguish {self.better} from {self.worse}"
        low, high = self.interval_mm
        if not self.significant:
            return f"not distinguishable from {self.worse} ({low:+.3f} to {high:+.3f} mm)"
        return f"better than {self.worse} by {self.difference_mm:.3f} mm ({low:.3f} to {high:.3f} mm)"

    @classmethod
    def from_errors(
        cls,
        better: str,
        worse: str,
        gain: FloatArray,
        position: IntArray,
        seed: int = 0,
        level: float = accuracy.LEVEL,
    ) -> Pair:
        """The pair by the errors of the worse less those of the better, pose by pose, shape (n,), metres.

        Poses of one position (n,), which are repeats of it, are drawn together.
        """
        place = np.unique(position, return_inverse=True)[1].ravel()
        interval = accuracy.difference(group_means(gain / MM, place), seed=seed, level=level)
        return cls(better, worse, float(gain.mean() / MM), None if interval is None else tuple(interval))


@dataclass(frozen=True, eq=False, repr=False)
class Compared(Result):
    """Several calibrations on the same points.

    Attributes
    ----------
    names, models : tuple of str
        Of the calibrations, in the order in which they were given.
    statistics : dict of str to dict
        By name: statistics and percentiles of all points, mm; ``nominal`` is the nominal robot of the first.
    poses, groups : tuple of str
        Of the judged poses.
    error_mm : ndarray, shape (n, k)
        Mean error of each pose's points under each calibration.
    distance_mm : ndarray, shape (m, k)
        Error of each point.
    pairs : tuple of Pair
        The best with each of the others first, then all others.
    counted_out : int
        Poses of the file that one of them was fitted to, and that are not judged.
    fitted_by : tuple of str
        Those that were fitted to judged poses, or of which that is not known.
    doubts, notes : tuple of str
        Sentences that begin with a name.
    simulated : bool
    extra : dict of str to ndarray of str, shape (n,)
        What columns that irbcal does not know say in the first row of each pose.
    """

    names: tuple[str, ...]
    models: tuple[str, ...]
    statistics: Mapping[str, Mapping[str, float]]
    poses: tuple[str, ...]
    groups: tuple[str, ...]
    error_mm: FloatArray
    distance_mm: FloatArray
    pairs: tuple[Pair, ...]
    counted_out: int
    fitted_by: tuple[str, ...]
    doubts: tuple[str, ...]
    notes: tuple[str, ...]
    simulated: bool
    extra: Mapping[str, NameArray] = field(default_factory=dict)

    @property
    def ranking(self) -> list[str]:
        """Names, the smallest mean error first."""
        return sorted(self.names, key=lambda name: self.statistics[name]["mean_mm"])

    @property
    def trusted(self) -> bool:
        """Whether no calibration was fitted to these poses, and nothing speaks against one."""
        return not self.fitted_by and not self.doubts

    def verdict(self) -> str:
        """Which is best, and from which others it cannot be distinguished."""
        best = self.ranking[0]
        pairs = [pair.sentence() for pair in self.pairs if best in (pair.better, pair.worse)]
        poses = f"{len(self.poses)} {'SIMULATED ' if self.simulated else ''}poses"
        text = f"On these {poses} {best} has the smallest mean error ({self.statistics[best]['mean_mm']:.3f} mm): "
        text += f"{'; '.join(pairs)}."
        if self.fitted_by:
            text = f"NO PROOF, because {', '.join(self.fitted_by)} saw some of these poses in the fit. {text}"
        elif self.doubts:
            text = f"{NOT_TO_BE_TRUSTED}, see the doubts. {text}"
        return text

    def report(self) -> Sequence[Paragraph]:
        """What ``irbcal compare`` prints."""
        verdict = Remark("Verdict", self.verdict(), self.trusted)
        out: list[Paragraph] = [verdict, *remarks("Doubt", self.doubts, good=False), self.table()]
        if self.counted_out:
            out.append(
                f"{counted(self.counted_out, 'pose')} that one or more of these calibrations fitted are left out; "
                "--include-fitted keeps them."
            )
        return [*out, *remarks("Note", self.notes)]

    def table(self) -> Table:
        """A row a calibration."""
        kind = simulated_mark(self.simulated)
        smallest = self.error_mm.min(axis=1, keepdims=True) == self.error_mm
        share = smallest.mean(axis=0)
        rows: list[tuple[TableValue, ...]] = [
            ("nominal", *(self.statistics["nominal"][key] for _, key in COLUMNS), None)
        ]
        for k, (name, model) in enumerate(zip(self.names, self.models, strict=True)):
            values = self.statistics[name]
            rows.append((f"{name} ({model})", *(values[key] for _, key in COLUMNS), f"{share[k]:.0%}"))
        title = f"{kind}position errors of {len(self.distance_mm)} points of {len(self.poses)} poses, mm"
        best = {1 + self.names.index(self.ranking[0])}
        return Table(title, ("", *(head for head, _ in COLUMNS), "best in"), tuple(rows), bold=frozenset(best))

    def latex(self) -> str:
        """The table as a LaTeX tabular; it needs no package."""
        sheet = self.table()
        heads, cells = [_tex(name) for name in sheet.columns], [[_tex(c) for c in row] for row in sheet.cells()]
        lines = [f"% irbcal: {_tex(sheet.title)}", rf"\begin{{tabular}}{{l{'r' * (len(heads) - 1)}}}", r"\hline"]
        lines += [f"{' & '.join(heads)} \\\\", r"\hline", *(f"{' & '.join(row)} \\\\" for row in cells), r"\hline"]
        return "\n".join([*lines, r"\end{tabular}", ""])

    COLUMNS = "pose=poses group=groups *errors_mm simulated"
    CONTENT = (
        "calibrations nominal per_pose pairs ranking poses=poses.__len__ points=distance_mm.__len__ counted_out "
        "fitted_by verdict trusted doubts notes simulated"
    )

    def to_frame(self) -> pd.DataFrame:
        """A row a pose; columns that the measurements carry along follow."""
        return with_extra_columns(super().to_frame().astype({"simulated": int}), self.extra)

    def errors_mm(self) -> dict[str, FloatArray]:
        """Mean error of each pose's points under each calibration, mm."""
        return {f"{name}_mm": errors for name, errors in zip(self.names, self.error_mm.T, strict=True)}

    def calibrations(self) -> list[dict[str, Any]]:
        """Name, model and statistics of each."""
        by_name = zip(self.names, self.models, strict=True)
        return [{"name": name, "model": model, **self.statistics[name]} for name, model in by_name]

    def nominal(self) -> Mapping[str, float]:
        """Statistics of the nominal robot."""
        return self.statistics["nominal"]

    def per_pose(self) -> dict[str, Any]:
        """Errors of each pose under each calibration, mm."""
        return {"pose": self.poses, **dict(zip(self.names, self.error_mm.T, strict=True))}

    def by_pose(self) -> Chart:
        """Errors of each pose, in the order of the best calibration's."""
        best = self.names.index(self.ranking[0])
        order = np.argsort(self.error_mm[:, best], kind="stable")
        x = np.arange(1.0, len(order) + 1)
        drawing = Drawing("Errors of each pose", TALL, WIDE)
        x_label = f"pose, in the order of the errors of {self.names[best]}"
        panel = Panel(drawing, span(x), (0.0, axis_top(self.error_mm)), x_label, "position error (mm)", whole_x=True)
        legend: list[LegendEntry] = []
        for k, name in enumerate(self.names):
            colour = COLOURS[k % len(COLOURS)]
            panel.dots(x, self.error_mm[order, k], colour, DOT, opacity=0.7)
            legend.append((colour, "o", f"{name} ({self.statistics[name]['mean_mm']:.3f} mm)"))
        caption = "Errors of each pose, in the order of the best calibration's"
        return Chart("by_pose", caption, [drawing], legend).marked(self.simulated)

    def shares(self) -> Chart:
        """Share of the points below each error."""
        count = len(self.distance_mm)
        drawing = Drawing("Share of the points below each error", TALL, WIDE)
        panel = Panel(
            drawing, (0.0, axis_top(self.distance_mm)), (0.0, 1.02), "position error (mm)", "share of the points"
        )
        legend: list[LegendEntry] = []
        for k, name in enumerate(self.names):
            colour, distance = COLOURS[k % len(COLOURS)], np.sort(self.distance_mm[:, k])
            panel.line(np.repeat(distance, 2), np.repeat(np.arange(count + 1), 2)[1:-1] / count, colour)
            legend.append((colour, "-", name))
        panel.level(0.95, dash=DASHED)
        caption = "Share of the points below each error; dashed: 95 %"
        return Chart("shares", caption, [drawing], legend).marked(self.simulated)

    def plots(self) -> dict[str, Chart]:
        """Both charts by their names."""
        return {"by_pose": self.by_pose(), "shares": self.shares()}


def compare(
    calibrations: Sequence[CalibrationLike] | Mapping[str, CalibrationLike],
    measurements: MeasurementsLike,
    *,
    include_fitted: bool = False,
    refit_base: bool = False,
    refit_tool: bool = False,
    refit_from: int | None = None,
    payload: float | None = None,
    same_tool: bool = False,
    seed: int = 0,
) -> Compared:
    """Compare calibrations of one robot on the same points.

    Parameters
    ----------
    calibrations : sequence, or dict of name to str, Path or a loaded calibration
        Two or more calibration folders, which give them their names (in Python also loaded calibrations, and names).
    measurements : str, Path, DataFrame or MeasurementSet
    include_fitted : bool
        Keep poses that one of them was fitted to; they are left out for all otherwise.
    refit_base, refit_tool, refit_from, payload, same_tool
        As `irbcal.evaluate`.
    seed : int
        Of the bootstrap and of the poses for ``refit_from``.

    Raises
    ------
    IrbcalError
        If an input is refused, or no point is left that all of them know and none was fitted to.
    """
    by_name = _named(calibrations)
    check_seed(seed)
    measured = with_payload_column(table.read(measurements), payload)
    refit = Refit(refit_base, refit_tool, refit_from, seed)
    records = {name: open_calibration(calibration) for name, calibration in by_name.items()}
    cleaned: list[CleanedPoints] = []
    robots: list[dict[str, Robot]] = []
    gone: set[int] = set()
    for name, record in records.items():
        points, models = in_frame_of_calibration(record, measured, refit, same_tool)
        points = points.without_copies()
        try:
            unfitted = without_fitted(points, record, include_fitted)
        except MeasurementError as refused:
            raise MeasurementError(f"calibration {name}: {refused}") from None
        gone |= set(points.number.tolist()) - set(unfitted.number.tolist())
        cleaned.append(unfitted)
        robots.append(models)
    rows = _common(cleaned, measured.source)
    first = cleaned[0]
    pose, position = first.points.pose[rows[0]], repeat_groups(first.points)
    error = np.column_stack(
        [
            distances(models["calibrated"], points.points)[k]
            for points, models, k in zip(cleaned, robots, rows, strict=True)
        ]
    )
    nominal = distances(robots[0]["nominal"], first.points)[rows[0]]
    used, row = np.unique(pose, return_inverse=True)
    per_pose = group_means(error, row)
    names = tuple(by_name)
    return Compared(
        names,
        tuple(record.model for record in records.values()),
        {"nominal": accuracy.figures(nominal)} | {name: accuracy.figures(error[:, k]) for k, name in enumerate(names)},
        tuple(str(first.points.pose_ids[k]) for k in used),
        tuple(str(first.points.groups[k]) for k in used),
        per_pose / MM,
        error / MM,
        tuple(_pairs(names, per_pose, error.mean(axis=0), position[used], seed)),
        len(gone),
        tuple(name for name, points in zip(names, cleaned, strict=True) if not points.proven),
        _doubts(records, cleaned, robots),
        _notes(names, cleaned),
        measured.simulated or any(record.simulated for record in records.values()),
        {name: first.labels(name)[used] for name in measured.extra_columns},
    )


def _doubts(
    records: Mapping[str, Record], cleaned: Sequence[CleanedPoints], robots: Sequence[Mapping[str, Robot]]
) -> tuple[str, ...]:
    return tuple(
        f"{name}: {text}"
        for (name, record), points, models in zip(records.items(), cleaned, robots, strict=True)
        for text in doubts_of(points.points, models["calibrated"], record)
    )


def _notes(names: Sequence[str], cleaned: Sequence[CleanedPoints]) -> tuple[str, ...]:
    """What is to be known of all, once, and of single ones with their names."""
    every = [set(points.notes) for points in cleaned]
    alike = set.intersection(*every)
    out = [note for note in cleaned[0].notes if note in alike]
    for name, one in zip(names, cleaned, strict=True):
        out += [f"{name}: {note}" for note in one.notes if note not in alike]
    return tuple(out)


def _named(calibrations: Sequence[CalibrationLike] | Mapping[str, CalibrationLike]) -> dict[str, CalibrationLike]:
    """Calibrations by names that differ."""
    if isinstance(calibrations, Mapping):
        out = {str(name): calibration for name, calibration in calibrations.items()}
    elif isinstance(calibrations, (str, os.PathLike)) or not isinstance(calibrations, Sequence):
        raise OptionError(f"expected two or more calibrations, found {excerpt(calibrations)}", parameter="calibrations")
    else:
        out = {}
        for k, source in enumerate(calibrations, 1):
            folder = source if isinstance(source, (str, os.PathLike)) else getattr(source, "folder", None)
            name = f"calibration {k}" if folder is None else folder_of(Path(folder)).resolve().name
            parent = "" if folder is None else folder_of(Path(folder)).resolve().parent.name
            name = f"{parent}/{name}" if name in out and parent else name
            out[f"{name} ({k})" if name in out else name] = source
    check_names(out, OptionError, parameter="calibrations")
    if not 2 <= len(out) <= MOST_CALIBRATIONS or "nominal" in out:
        raise OptionError(
            f"calibrations: expected 2 to {MOST_CALIBRATIONS}, none called nominal, found {', '.join(out) or 'none'}",
            parameter="calibrations",
        )
    return out


def _common(cleaned: Sequence[CleanedPoints], source: str) -> list[IntArray]:
    """Rows of each that are the same pose of the file and the same target, in one order."""
    keys = [
        list(zip(points.number[points.points.pose].tolist(), points.points.names(), strict=True)) for points in cleaned
    ]
    where = [{key: k for k, key in enumerate(rows)} for rows in keys]
    common = [key for key in keys[0] if all(key in rows for rows in where[1:])]
    if not common:
        raise MeasurementError(
            "no point is left that all of these calibrations know and none was fitted to: measure other poses, or look "
            "at the fitted ones with --include-fitted",
            file=source,
        )
    return [np.array([rows[key] for key in common], dtype=int) for rows in where]


def _pairs(names: Sequence[str], error: FloatArray, mean: FloatArray, position: IntArray, seed: int) -> list[Pair]:
    """All pairs with intervals that hold together; those with the best first."""
    pairs = list(combinations(np.argsort(mean, kind="stable").tolist(), 2))
    level = 1.0 - (1.0 - accuracy.LEVEL) / len(pairs)
    return [
        Pair.from_errors(names[better], names[worse], error[:, worse] - error[:, better], position, seed, level)
        for better, worse in pairs
    ]


def _tex(text: str) -> str:
    """Text for LaTeX: nothing in it is a command."""
    special = {"\\": r"\textbackslash{}", "^": r"\textasciicircum{}", "~": r"\textasciitilde{}"}
    special |= {char: rf"\{char}" for char in "&%$#_{}"} | {"σ": r"$\sigma$", "–": "--", "<": r"$<$", ">": r"$>$"}
    return "".join(special.get(char, char) for char in text)
