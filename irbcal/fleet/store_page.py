"""The page of a store's robots: how their errors and parameters drifted, what changed, and the table of all.

A file of its own: it draws charts, which no other question to a store needs.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import date
from itertools import groupby, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from irbcal import literals
from irbcal.arrays import FloatArray
from irbcal.distributions import normal_quantile
from irbcal.fleet.comparison import UNITS, Change, called, change, changes
from irbcal.fleet.store import Dated, Store
from irbcal.plotting.charts import DASHED, Drawing, LegendEntry, Panel, axis_top, fixed, inline, key, span
from irbcal.templates import environment
from irbcal.units import MM

if TYPE_CHECKING:
    from irbcal.fleet.overview import Overview

MOST_ROBOTS, MOST_TYPES = 48, 12
"""Robots and types that are drawn; types only where there are more robots."""
MOST_CURVES = 2
"""Parameters that are drawn of a robot."""
MOST_DATES = 24
"""Dates that a type is drawn at; of more, so many spans of time."""
MOST_CHANGES = 200
"""Robots that are listed of those that changed and have no chart, and of those that stand out."""
HEAD, ROW, WIDTH = 126.0, 108.0, 330.0
"""Height of the errors and of a parameter, and width of a robot's chart."""
USUAL = 3.0
"""Times the middle of the robots' largest errors up to which they have one scale."""
LEGEND: tuple[LegendEntry, ...] = (
    ("calibrated", "o", "held-out mean error of a calibration"),
    ("accent", "o", "parameter that changed, from its first value; bars: 95 % intervals"),
)
TOLERANCE: tuple[LegendEntry, ...] = (("ink", "--", "tolerance"),)


@dataclass(frozen=True)
class ErrorHistory:
    """Held-out mean errors of a robot's calibrations, by their dates; some may be NaN."""

    robot: str
    type: str
    numbers: tuple[int, ...]
    """Of the calibrations."""
    measured: tuple[date, ...]
    errors: FloatArray
    """Shape (n,). In mm."""

    @property
    def days(self) -> FloatArray:
        """Dates as numbers."""
        return np.array([day.toordinal() for day in self.measured], dtype=float)

    @property
    def growth(self) -> float:
        """By how much the error grew from the first calibration to the last, mm."""
        errors = self.errors[np.isfinite(self.errors)]
        return float(errors[-1] - errors[0]) if len(errors) else 0.0


def histories(database: Store, type: str | None) -> list[ErrorHistory]:
    """Robots that were calibrated more than once, by their ids."""
    out = []
    for robot, group in groupby(database.errors(type), key=lambda row: row["robot"]):
        rows = list(group)
        if len(rows) > 1:
            errors = np.array([np.nan if (e := row["heldout_mean_mm"]) is None else e for row in rows], dtype=float)
            numbers, measured = (tuple(row[name] for row in rows) for name in ("number", "measured"))
            out.append(ErrorHistory(robot, rows[0]["type"], numbers, measured, errors))
    return out


def worst_first(
    robots: Sequence[ErrorHistory], steps: Mapping[str, Change], tolerance_mm: float | None
) -> list[ErrorHistory]:
    """Robots beyond the tolerance, then those whose last calibration changed, then by the growth of the error."""

    def rank(history: ErrorHistory) -> tuple[bool, float, float]:
        step = steps.get(history.robot)
        beyond = step.chi2 / max(step.directions, 1) if step is not None and step.real else 0.0
        return tolerance_mm is not None and history.errors[-1] > tolerance_mm, beyond, history.growth

    return sorted(robots, key=rank, reverse=True)


def drawn_robot(
    history: ErrorHistory,
    levels: Sequence[Dated],
    parameters: Sequence[str],
    days: Sequence[float],
    top: float,
    tolerance: Sequence[float] = (),
) -> Drawing:
    """Errors of a robot over time, and the parameters that changed, one below the other.

    Parameters
    ----------
    history : ErrorHistory
    levels : sequence of Dated
        Its calibrations.
    parameters : sequence of str
        Names of those that are drawn.
    days : sequence of float
        Ends of the time.
    top : float
        Where the scale of errors ends, mm.
    tolerance : sequence of float
        One, in mm, or none.
    """
    drawing = Drawing(f"Drift of {history.robot}", HEAD + ROW * len(parameters) + 26.0, WIDTH)
    lowest = len(parameters)
    dates = history.days[[0, -1]].tolist(), [str(history.measured[0]), str(history.measured[-1])]
    for k, name in enumerate(["", *parameters]):
        begin = HEAD + ROW * (k - 1) if k else 0.0
        end = HEAD + ROW * k + (26.0 if k == lowest else 0.0)
        label = "measured" if k == lowest else ""
        if not k:
            panel = Panel(drawing, days, (0.0, top), label, "mm", begin, end, title="mean error", x_ticks=dates)
            for value in tolerance:
                panel.level(value, "ink", dash=DASHED)
            finite = np.isfinite(history.errors)
            x, y = history.days[finite], history.errors[finite]
            texts = [f"{fixed(value, 3)} mm" for value in y]
            colour, bars = "calibrated", np.zeros(0)
        else:
            having = [level for level in levels if name in level.packed.parameters.column_of]
            rows = [level.packed.parameters.column_of[name] for level in having]
            base, _, per = having[0].packed.parameters.units[rows[0]].partition("/")
            unit, factor = UNITS.get(base, (base, 1.0))
            unit = f"{unit}/{per}" if per else unit
            values, stds = (
                np.array([level.packed.numbers(what)[row] for level, row in zip(having, rows, strict=True)]) / factor
                for what in ("value", "std")
            )
            x, y = np.array([float(level.measured.toordinal()) for level in having]), values - values[0]
            bars = normal_quantile(0.975) * stds
            texts = [f"{a:+.2g} ± {b:.1g} {unit}" for a, b in zip(y, bars, strict=True)]
            limits = span(y - bars, y + bars, [0.0])
            title = called(name)[0]
            title = title if len(title) < 44 else name
            panel = Panel(drawing, days, limits, label, unit, begin, end, title=title, x_ticks=dates)
            panel.level(0.0, "line")
            colour = "accent"
        panel.line(x, y, colour)
        if len(bars):
            panel.bars(x, y, bars, colour)
        titles = [f"{date.fromordinal(int(day))}: {text}" for day, text in zip(x, texts, strict=True)]
        panel.dots(x, y, colour, 5.0, titles=titles)
    return drawing


def drawn_type(robots: Sequence[ErrorHistory], tolerance_mm: float | None) -> Drawing:
    """Errors of all robots of a type over time: the middle and the range of nine robots of ten."""
    days = np.concatenate([history.days for history in robots])
    errors = np.concatenate([history.errors for history in robots])
    days, errors = days[np.isfinite(errors)], errors[np.isfinite(errors)]
    when, group = np.unique(days, return_inverse=True)
    if len(when) > MOST_DATES:
        edges = np.linspace(days.min(), days.max(), MOST_DATES + 1)
        group = np.clip(np.searchsorted(edges, days, side="right") - 1, 0, MOST_DATES - 1)
    filled = np.unique(group)
    x = np.array([np.median(days[group == k]) for k in filled])
    quantiles = np.array([np.quantile(errors[group == k], (0.05, 0.5, 0.95)) for k in filled]).reshape(-1, 3)
    counts = [int((group == k).sum()) for k in filled]
    drawing = Drawing(f"Errors of {robots[0].type}", HEAD + 50.0, WIDTH)
    top = axis_top(quantiles, np.array([tolerance_mm or 0.0]))
    ends = x[[0, -1]].tolist() if len(x) else []
    ticks = ends, [str(date.fromordinal(int(day))) for day in ends]
    panel = Panel(drawing, span(x, margin=0.15), (0.0, top), "measured", "mm", title="mean error", x_ticks=ticks)
    if tolerance_mm is not None:
        panel.level(tolerance_mm, "ink", dash=DASHED)
    for day, (low, _, high) in zip(x, quantiles, strict=True):
        panel.line([day, day], [low, high], "calibrated", 3.0, opacity=0.4)
    panel.line(x, quantiles[:, 1], "calibrated")
    titles = [
        f"{date.fromordinal(int(day))}, {count} calibrations: {fixed(low, 3)}, {fixed(middle, 3)}, {fixed(high, 3)} mm"
        for day, count, (low, middle, high) in zip(x, counts, quantiles, strict=True)
    ]
    panel.dots(x, quantiles[:, 1], "calibrated", 5.0, titles=titles)
    return drawing


def _charts(
    database: Store, chosen: Sequence[ErrorHistory], tolerance_mm: float | None, store: str, folder: Path
) -> list[dict[str, Any]]:
    """Chart, changes and files of each robot that is drawn."""
    limit = [] if tolerance_mm is None else [tolerance_mm]
    largest = np.array([np.nanmax(h.errors, initial=0.0) for h in chosen])
    shared = float(largest[largest <= USUAL * np.median(largest)].max(initial=0.0))
    days = span(*(h.days for h in chosen), margin=0.15)
    out: list[dict[str, Any]] = []
    for history, largest_mm in zip(chosen, largest, strict=True):
        levels = list(database.estimates("level", history.robot))
        steps = changes(list(pairwise(levels)))
        every = [*steps, change(levels[0], levels[-1])]
        causes = sorted((cause for step in every for cause in step.parameters), key=lambda cause: -cause.chi2)
        parameters = list(dict.fromkeys(cause.name for cause in causes))[:MOST_CURVES]
        top = axis_top(np.array([max(shared, largest_mm), *limit]))
        folders = [stored.calibration["folder"] for stored in database.of_numbers(history.numbers[-2:], ())]
        sentences = [sentence for step in steps for sentence in step.in_words()]
        if len(steps) > 1 and every[-1].real and not any(step.real for step in steps):
            sentences += ["Little by little, from the first to the last:", *every[-1].in_words()]
        pages = [
            (str(day), f"{_from(folder, path)}/report.html")
            for day, path in zip(history.measured[-2:], folders, strict=True)
            if (Path(path) / "report.html").is_file()
        ]
        out.append(
            {
                "number": len(out) + 1,
                "history": history,
                "drawing": drawn_robot(history, levels, parameters, days, top, limit),
                "changed": any(step.real for step in every),
                "sentences": sentences,
                "command": literals.shell("irbcal", "fleet", "drift", history.robot, "--store", store),
                "pages": pages,
            }
        )
    return out


def _from(folder: Path, path: str) -> str:
    """A path as it is called in a folder: a page that is handed on must not tell how a disk is laid out."""
    try:
        return Path(os.path.relpath(path, folder.resolve())).as_posix()
    except ValueError:  # another drive of Windows
        return path


def render_store(
    overview: Overview, database: Store, store: str | Path, folder: Path, type: str | None, tolerance: float | None
) -> str:
    """The page of a store's robots.

    Parameters
    ----------
    overview : Overview
    database : Store
        It is asked for the dates and errors of all, and for the parameters of robots that are drawn.
    store : str or Path
        Its name.
    folder : Path
        Of the page.
    type : str or None
        The only type of robots on the page.
    tolerance : float or None
        In metres.
    """
    tolerance_mm = None if tolerance is None else tolerance / MM
    ranked = worst_first(histories(database, type), overview.changes, tolerance_mm)
    url = database.engine.url.render_as_string(hide_password=True)
    name = url if "://" in str(store) else _from(folder, str(store))
    robots = _charts(database, ranked[:MOST_ROBOTS], tolerance_mm, name, folder) if ranked else []
    by_type: dict[str, list[ErrorHistory]] = {}
    for history in ranked if len(ranked) > MOST_ROBOTS else ():
        by_type.setdefault(history.type, []).append(history)
    largest = sorted(by_type.values(), key=len, reverse=True)[:MOST_TYPES]
    changed, outstanding = overview.changed, overview.outstanding_in_words()
    charted = {history.robot for history in ranked[:MOST_ROBOTS]}
    uncharted = [(robot, sentences) for robot, sentences in changed.items() if robot not in charted]
    templates = environment("irbcal.fleet")
    templates.filters["svg"] = inline
    return templates.get_template("store.html.j2").render(
        title="Fleet",
        simulated=overview.simulated,
        headline=overview.headline(),
        robots=robots,
        single=len(overview.latest) - len(ranked),
        ranked=len(ranked),
        types=[(robots, drawn_type(robots, tolerance_mm)) for robots in largest],
        types_more=len(by_type) - len(largest),
        changed=changed,
        uncharted=uncharted[:MOST_CHANGES],
        uncharted_more=max(0, len(uncharted) - MOST_CHANGES),
        table=overview.table(),
        outstanding=outstanding[:MOST_CHANGES],
        outstanding_more=max(0, len(outstanding) - MOST_CHANGES),
        legend=[*LEGEND, *(TOLERANCE if tolerance is not None else ())],
        key_mark=key,
    )
