"""``page.html`` of a study: charts and tables as one page that loads nothing and runs no script."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from chapter7 import printed
from chapter7.settings import AREAS, COURSE, FULL, NOMINAL, PAYLOADS, SMALL, Repetition, curve, procedures
from chapter7.tables import AREA_NAMES, COMPARED, MODEL_NAMES, Cell, Results, Table, chosen, curve_values
from irbcal.page_style import SERIES
from irbcal.plotting import charts
from irbcal.plotting.charts import Chart, Drawing, LegendEntry, MarkerShape, Panel, axis_top, span
from irbcal.plotting.pose_errors import course

Series: TypeAlias = "Callable[[Repetition], Mapping[str, NDArray[Any]]]"
"""Gives the errors of a finished repetition one by one, under ``kind/area/payload/quantity``."""

Member: TypeAlias = "tuple[str, Repetition, str]"
"""Label, repetition and colour."""

MODEL_COLOURS = {"nominal": "nominal", "11": "series2", "axes": "accent", "34": "calibrated"}
ROW_COLOURS = [f"series{k}" for k in range(len(SERIES))]
AREA_COLOURS = dict(zip(AREAS, ("accent", "series2"), strict=True))
MARKERS: dict[int, MarkerShape] = dict(zip(PAYLOADS, ("o", "^"), strict=True))

HEIGHT = 270.0
QUANTITIES = (("flange", "position"), ("orientation", "orientation"))


def figures(results: Results, series: Series) -> dict[str, list[Chart]]:
    """The charts that the finished repetitions fill, by the sections of the page.

    Parameters
    ----------
    results : Results
    series : callable
        See `Series`.
    """
    settings = results.settings
    every = procedures(settings)
    overview, number = "Expected against found, and the course of a search", "Number of measurements"
    by_model, by_procedure = "Models, point by point", "Procedures, point by point"
    parts: list[tuple[str, Sequence[Repetition], Callable[[Results, Series], list[Chart]]]] = [
        (overview, every, _expected_found),
        (overview, [COURSE], _course),
        (number, curve(settings), _curves),
        (number, every, _boxes),
        (by_model, [NOMINAL, SMALL, FULL], _models_in_areas),
        (by_model, [*COMPARED.values()], _models_in_poses),
        (by_model, [FULL], _relative),
        (by_procedure, [Repetition(settings.model, n) for n in settings.procedures], _sizes),
        (by_procedure, every, _letters),
    ]
    sections: dict[str, list[Chart]] = {}
    for section, needs, draw in parts:
        if needs and results.has(*needs):
            sections.setdefault(section, []).extend(chart.marked(True) for chart in draw(results, series))
    return sections


def _expected_found(results: Results, series: Series) -> list[Chart]:
    """Mean and maximum found with fake targets against those expected (Nubiola 2011, section 7.6)."""
    caption = "Each procedure: error found with fake targets against error expected from the model; mean and maximum"
    tables: Sequence[Mapping[str, tuple[tuple[float, ...], tuple[float, ...]]]] = ()
    if results.settings.model == "34":
        tables = (printed.TABLE_7_4, printed.TABLE_7_5)
        caption += ". Hollow: the thesis's, Tables 7.4 and 7.5"
    elif results.settings.model == "11":
        tables = (printed.TABLE_7_6, printed.TABLE_7_7)
        caption += ". Hollow: the thesis's, Tables 7.6 and 7.7"
    kinds = ("expected", "verified")
    groups = [(area, load) for area in AREAS for load in PAYLOADS]
    drawings = []
    for column, name in ((0, "mean"), (2, "max")):
        pairs = {
            (area, load): np.array(
                [[results.row(r, kind, area, load)[name] for kind in kinds] for r in procedures(results.settings)]
            )
            for area, load in groups
        }
        beside = {
            (area, load): [table[kind][AREAS.index(area)][column] for kind in kinds]
            for load, table in zip(PAYLOADS, tables, strict=False)
            for area in AREAS
        }
        ends = span(*pairs.values(), *beside.values())
        drawing = Drawing(f"{caption}: {name}", HEIGHT, HEIGHT)
        panel = Panel(drawing, ends, ends, f"expected {name} (mm)", f"found {name} (mm)", equal=True)
        ends = max(panel.x[0], panel.y[0]), min(panel.x[1], panel.y[1])
        panel.line(ends, ends, "soft", 1.0)
        for (area, load), xy in pairs.items():
            panel.dots(*xy.T, AREA_COLOURS[area], 6.0, opacity=0.75, shape=MARKERS[load])
        for (area, load), (x, y) in beside.items():
            _hollow(panel, x, y, AREA_COLOURS[area], MARKERS[load])
        drawings.append(drawing)
    legend = [(AREA_COLOURS[area], MARKERS[load], f"{AREA_NAMES[area]}, {load} kg") for area, load in groups]
    return [Chart("expected-found", caption, drawings, legend)]


def _hollow(panel: Panel, x: Any, y: Any, colour: str, shape: MarkerShape = "o") -> None:
    """Numbers of the thesis: marks of the page's ground in larger ones."""
    panel.dots(x, y, colour, 9.0, shape=shape)
    panel.dots(x, y, "page", 5.0, shape=shape)


def _course(results: Results, series: Series) -> list[Chart]:
    """Nubiola 2011, Figure 7.2: the objective and the errors of points that took no part (section 7.5)."""
    history = {name.removeprefix("course/"): values.tolist() for name, values in series(COURSE).items()}
    for area, name in AREA_NAMES.items():
        for statistic in ("mean_mm", "max_mm"):
            history[f"{name}_{statistic}"] = history.pop(f"{area}_{statistic}")
    caption = (
        "After Figure 7.2: a Nelder-Mead search on 140 measurements (objective: their largest error), and 20 + 20 "
        "points that took no part "
        f"({', '.join(f'{k}: {name}' for k, name in enumerate(AREA_NAMES.values(), 1))})"
    )
    return [replace(course(history), name="figure-7-2", caption=caption)]


def _curves(results: Results, series: Series) -> list[Chart]:
    """Expected error against the number of measurements (Nubiola 2011, section 7.7.3)."""
    settings = results.settings
    methods = list(dict.fromkeys([settings.method, "least-squares"]))
    values = [curve_values(results, least_squares=method != settings.method) for method in methods]
    x = np.log10(settings.curve)
    out = []
    for k, area in enumerate(AREAS):
        caption = (
            f"Expected error against the number of measurements, {AREA_NAMES[area]}, 3 kg: lines are medians, bars go "
            "from the least to the largest of all choices"
        )
        thesis = [row[k] for row in printed.TABLE_7_13.values()] if settings.model == "34" else []
        if thesis:
            caption += ". Hollow: the thesis's maxima, Table 7.13"
        top = axis_top(*(errors[area, "max"] for errors in values), thesis)
        drawing = Drawing(caption, HEIGHT)
        sizes = (x.tolist(), [str(n) for n in settings.curve])
        ends = span(x, np.log10(printed.SIZES) if thesis else [])
        panel = Panel(drawing, ends, (0, top), "identification measurements", "expected error (mm)", x_ticks=sizes)
        legend: list[LegendEntry] = []
        for method, colour, errors in zip(methods, ROW_COLOURS, values, strict=False):
            for name, dash, sign in (("max", "", "-"), ("mean", charts.DASHED, "--")):
                low, high = errors[area, name].min(axis=1), errors[area, name].max(axis=1)
                median = np.median(errors[area, name], axis=1)
                panel.bars(x, (low + high) / 2, (high - low) / 2, colour)
                panel.line(x, median, colour, dash=dash)
                panel.dots(x, median, colour, 5.0)
                legend.append((colour, sign, f"{method}, {name}"))
        if thesis:
            _hollow(panel, np.log10((80, 120, 120, 180, 200)), thesis, "ink")
        out.append(Chart(f"curve-{area}", caption, [drawing], legend))
    return out


def _boxes(results: Results, series: Series) -> list[Chart]:
    """Expected errors of each procedure."""
    settings = results.settings
    out = []
    for area, load in zip(AREAS, PAYLOADS, strict=True):
        caption = (
            f"Expected errors of each procedure, {AREA_NAMES[area]}, {load} kg: boxes hold half of the points, "
            "whiskers 90 %; lines in boxes are medians, dots maxima"
        )
        rows = [results.row(r, "expected", area, load) for r in procedures(settings)]
        sizes = np.arange(len(settings.procedures))
        middles = sizes * (settings.each + 1) + (settings.each - 1) / 2
        x = (sizes[:, None] * (settings.each + 1) + np.arange(settings.each)).ravel()
        drawing = Drawing(caption, HEIGHT)
        panel = Panel(
            drawing,
            (-1, x[-1] + 1),
            (0, axis_top([row["max"] for row in rows])),
            "measurements of each procedure",
            "expected error (mm)",
            x_ticks=(middles.tolist(), [str(n) for n in settings.procedures]),
        )
        for k, (at, row) in enumerate(zip(x, rows, strict=True)):
            colour = ROW_COLOURS[k // settings.each % len(ROW_COLOURS)]
            panel.line([at, at], [row["p5"], row["p95"]], colour, 1.2)
            panel.boxes(at - 0.35, row["p25"], at + 0.35, row["p75"], colour, opacity=0.4)
            panel.line([at - 0.35, at + 0.35], [row["p50"], row["p50"]], colour, 2.0)
            panel.dots(at, row["max"], colour)
        out.append(Chart(f"boxes-{area}", caption, [drawing]))
    return out


def _strips(
    series: Series, number: int, what: str, members: Sequence[Member], key: str, by_column: bool = False
) -> Chart:
    """Errors one by one, the models side by side so that none hides another; a line at each mean."""
    caption = f"After Figure 7.{number}: {what}"
    rows = [series(repetition)[key] for _, repetition, _ in members]
    rows = [(values.T if by_column else values).ravel() for values in rows]
    starts = 1.15 * np.arange(len(members))
    ticks = ((starts + 0.5).tolist(), [name for name, *_ in members])
    unit = "°" if key.endswith("orientation") else "mm"
    drawing = Drawing(caption, HEIGHT)
    ends, top = (-0.1, starts[-1] + 1.1), axis_top(*rows)
    panel = Panel(drawing, ends, (0, top), "points in their order; line: mean", f"error ({unit})", x_ticks=ticks)
    for start, values, (*_, colour) in zip(starts, rows, members, strict=True):
        x = start + np.arange(len(values)) / max(len(values) - 1, 1)
        finite = np.isfinite(values)
        panel.dots(x[finite], values[finite], colour, min(5.0, max(2.0, 60 / len(values) ** 0.5)), opacity=0.6)
        panel.line([start, start + 1], [np.nanmean(values)] * 2, "ink", 1.2)
    return Chart(f"figure-7-{number}", caption, [drawing])


def _models(*names: str) -> list[Member]:
    return [(MODEL_NAMES[name], COMPARED[name], MODEL_COLOURS[name]) for name in names or COMPARED]


def _models_in_areas(results: Results, series: Series) -> list[Chart]:
    """Nubiola 2011, Figures 7.4, 7.5, 7.6 and 7.7: errors found, three models, area by payload (section 7.7.3.3)."""
    cases = [(load, area) for load in PAYLOADS for area in AREAS]
    return [
        _strips(
            series,
            number,
            f"position errors found, {AREA_NAMES[area]}, {load} kg",
            _models("nominal", "11", "34"),
            f"verified/{area}/{load}/point",
        )
        for number, (load, area) in enumerate(cases, 4)
    ]


def _models_in_poses(results: Results, series: Series) -> list[Chart]:
    """Position and orientation of four models.

    Nubiola 2011, Figures 7.8 and 7.9 (ISO 9283 poses, section 7.7.3.4), Figures 7.10 and 7.11 (1,000 poses, section
    7.7.3.5).
    """
    out = []
    for number, key, what in (
        (8, "iso9283/iso_poses", "the ISO 9283 poses, P1 to P5, thirty cycles each"),
        (10, "poses/iso_cube", "poses in the ISO cube"),
    ):
        for k, (quantity, name) in enumerate(QUANTITIES):
            says = f"{name} errors of {what}, 3 kg"
            out.append(_strips(series, number + k, says, _models(), f"{key}/3/{quantity}", by_column=number == 8))
    return out


def _relative(results: Results, series: Series) -> list[Chart]:
    """Nubiola 2011, Figures 7.13 and 7.14: relative errors in the sphere (sections 7.7.3.6 and 7.7.3.7)."""
    return [
        _strips(series, number, f"relative errors from {what}, 3 kg", _models("34"), f"{kind}/sphere/3/point")
        for number, kind, what in (
            (13, "sphere_virtual_frame", "a virtual frame"),
            (14, "sphere_three_points", "3 points"),
        )
    ]


def _sizes(results: Results, series: Series) -> list[Chart]:
    """Nubiola 2011, Figures 7.15 and 7.16: a procedure of each size, position and orientation (section 7.7.4)."""
    settings = results.settings
    members = [
        (str(n), Repetition(settings.model, n), ROW_COLOURS[k % len(ROW_COLOURS)])
        for k, n in enumerate(settings.procedures)
    ]
    return [
        _strips(
            series,
            number,
            f"{name} errors of the first procedure of each size, ISO cube, 3 kg",
            members,
            f"poses/iso_cube/3/{quantity}",
        )
        for number, (quantity, name) in enumerate(QUANTITIES, 15)
    ]


def _letters(results: Results, series: Series) -> list[Chart]:
    """The worst procedures and the best of all.

    Nubiola 2011, Figure 7.17 (section 7.7.5.1), Figures 7.18 and 7.19 (section 7.7.5.2).
    """
    members = [
        (f"{item.letter} ({item.repetition.measures})", item.repetition, ROW_COLOURS[k % len(ROW_COLOURS)])
        for k, item in enumerate(chosen(results))
    ]
    return [
        _strips(series, number, f"{what}; the worst procedures of each size and the best of all (B)", members, key)
        for number, key, what in (
            (17, "verified/all_range/6/point", "position errors, whole range, 6 kg"),
            (18, "poses/iso_cube/3/flange", "position reduced to the flange, ISO cube, 3 kg"),
            (19, "poses/iso_cube/3/orientation", "orientation errors, ISO cube, 3 kg"),
        )
    ]


def render(results: Results, tables: Sequence[Table], series: Series) -> str:
    """The page.

    Parameters
    ----------
    results : Results
    tables : sequence of Table
    series : callable
        See `Series`.
    """
    from irbcal.templates import environment

    templates = environment("chapter7", "")
    templates.filters["svg"] = charts.inline
    return templates.get_template("page.html.j2").render(
        settings=results.settings,
        procedures=len(procedures(results.settings)),
        sections=figures(results, series),
        key_mark=charts.key,
        tables=tables,
        verdict=verdict(results),
        title="Study of calibrations (simulated)",
        is_cell=lambda value: isinstance(value, Cell),
        is_number=lambda value: isinstance(value, (Cell, int)),
    )


def verdict(results: Results) -> str | None:
    """What the procedures came to, in a sentence; None while they are not done."""
    settings = results.settings
    every = procedures(settings)
    if not results.has(*every):
        return None
    found = [results.row(r, "verified", "all_range") for r in every]
    expected = [results.row(r, "expected", "all_range") for r in every]
    before = results.row(NOMINAL, "verified", "all_range")["mean"] if results.has(NOMINAL) else None
    low, high = min(row["mean"] for row in found), max(row["mean"] for row in found)
    ratio = np.median([a["mean"] / b["mean"] for a, b in zip(found, expected, strict=True)])
    start = f"{len(every)} simulated calibrations by {settings.method}: with fake targets the virtual robot"
    where = "in the whole range with 3 kg"
    nominal = f" ({before:.3f} mm without)" if before is not None else ""
    return (
        f"{start} misses by {low:.3f} to {high:.3f} mm on average {where}{nominal}; "
        f"that is {ratio:.2f} times what the models had promised (median)."
    )
