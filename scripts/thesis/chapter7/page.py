"""``page.html`` of a study: figures and tables as one page that loads nothing and runs no script."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from chapter7 import inline_svg, printed
from chapter7.inline_svg import INK
from chapter7.settings import (
    AREAS,
    COURSE,
    FULL,
    NOMINAL,
    PAYLOADS,
    SMALL,
    Repetition,
    Settings,
    curve,
    procedures,
)
from chapter7.tables import AREA_NAMES, COMPARED, MODEL_NAMES, Cell, Results, Table, chosen, curve_values
from irbcal import parallel
from irbcal.page_style import CALIBRATED
from irbcal.page_style import NOMINAL as ORANGE

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Canvas

Series: TypeAlias = "Mapping[Repetition, Mapping[str, NDArray[Any]]]"
"""Errors one by one of finished repetitions, under ``kind/area/payload/quantity``."""


class Draw(Protocol):
    """Draws into a figure from results and errors one by one; returns the handles of a legend, if there is one."""

    def __call__(self, figure: Canvas, results: Results, series: Series) -> Any:
        """Draw."""
        ...


GREEN, PURPLE, GREY = "#2f9463", "#9560bd", "#7d868f"
MODEL_COLOURS = {"nominal": ORANGE, "11": GREEN, "axes": PURPLE, "34": CALIBRATED}
ROW_COLOURS = (CALIBRATED, GREEN, ORANGE, PURPLE, GREY)
AREA_COLOURS = dict(zip(AREAS, (CALIBRATED, ORANGE), strict=True))
MARKERS = dict(zip(PAYLOADS, "os", strict=True))

OVERVIEW = "Expected against found, and the course of a search"
NUMBER = "Number of measurements"
MODELS, PROCEDURES = "Models, point by point", "Procedures, point by point"
"""Sections of the page."""

FIGURE_S = 0.2
"""Seconds that a figure takes, about."""

_QUANTITIES = (("flange", "position"), ("orientation", "orientation"))


@dataclass(frozen=True)
class Figure:
    """A figure of the page: its section, caption, and what draws it.

    Attributes
    ----------
    section, key, caption : str
    needs : tuple of Repetition
        That must be finished.
    draw : Draw
    """

    section: str
    key: str
    caption: str
    needs: tuple[Repetition, ...]
    draw: Draw


def figures(results: Results) -> list[Figure]:
    """All figures, in the page's order."""
    settings = results.settings
    return [
        *_overview(settings),
        *(_curves(settings) if settings.curve else ()),
        *_boxes(settings),
        *_models_in_areas(),
        *_models_in_poses(),
        *_relative(),
        *_sizes(settings),
        *(_letters(results) if results.has(*procedures(settings)) else ()),
    ]


def drawn(results: Results) -> list[Repetition]:
    """Finished repetitions whose errors one by one are drawn."""
    settings = results.settings
    wanted = [*COMPARED.values(), COURSE, *(Repetition(settings.model, n) for n in settings.procedures)]
    if results.has(*procedures(settings)):
        wanted += [item.repetition for item in chosen(results)]
    return [r for r in dict.fromkeys(wanted) if results.has(r)]


def plotted(figure: Figure, results: Results, series: Series) -> Canvas:
    """A figure drawn, for a notebook or a file of one's own."""
    from matplotlib.figure import Figure as Canvas

    with inline_svg.style():
        canvas = Canvas(figsize=(5.8, 3.6), layout="constrained")
        handles = figure.draw(canvas, results=results, series=series)
        if handles:
            canvas.legend(handles=handles, loc="outside upper right", ncols=2, frameon=False, handlelength=1.0)
    return canvas


def _overview(settings: Settings) -> list[Figure]:
    """Expected against found errors, and Nubiola 2011, Figure 7.2: the course of a search (section 7.5)."""
    names, *_ = _beside(settings) or (None,)
    caption = "Each procedure: error found with fake targets against error expected from the model; mean and maximum"
    caption += f". Hollow: the thesis's, Tables {names}" if names else ""
    course = "After Figure 7.2: a Nelder-Mead search on 140 measurements, and 20 + 20 points that took no part"
    return [
        Figure(OVERVIEW, "expected-found", caption, tuple(procedures(settings)), _expected_found),
        Figure(OVERVIEW, "figure-7-2", course, (COURSE,), _course),
    ]


def _curves(settings: Settings) -> list[Figure]:
    """Expected error against the number of measurements (Nubiola 2011, section 7.7.3)."""
    return [
        Figure(
            NUMBER,
            f"curve-{area}",
            f"Expected error against the number of measurements, {AREA_NAMES[area]}, 3 kg: maximum (above) and "
            "mean; lines: medians, bands: all choices. Hollow: the thesis's maxima, Table 7.13",
            tuple(curve(settings)),
            _curve_of(area),
        )
        for area in AREAS
    ]


def _boxes(settings: Settings) -> list[Figure]:
    """Expected errors of each procedure."""
    return [
        Figure(
            NUMBER,
            f"boxes-{area}",
            f"Expected errors of each procedure, {AREA_NAMES[area]}, {load} kg: boxes hold half of the points, "
            "whiskers 90 %, dots are maxima",
            tuple(procedures(settings)),
            _boxes_of(area, load),
        )
        for area, load in zip(AREAS, PAYLOADS, strict=True)
    ]


def _members(*names: str) -> list[Member]:
    """Models with name, repetition and colour; all four without names."""
    return [(MODEL_NAMES[n].replace(" ", "\n"), COMPARED[n], MODEL_COLOURS[n]) for n in names or COMPARED]


def _models_in_areas() -> list[Figure]:
    """Nubiola 2011, Figures 7.4, 7.5, 7.6 and 7.7: errors found, three models, area by payload (section 7.7.3.3)."""
    out = []
    for number, (load, area) in enumerate(((load, area) for load in PAYLOADS for area in AREAS), 4):
        caption = f"After Figure 7.{number}: position errors found, {AREA_NAMES[area]}, {load} kg"
        strips = _strips_of(_members("nominal", "11", "34"), f"verified/{area}/{load}/point")
        out.append(Figure(MODELS, f"figure-7-{number}", caption, (NOMINAL, SMALL, FULL), strips))
    return out


def _models_in_poses() -> list[Figure]:
    """Position and orientation of four models.

    Nubiola 2011, Figures 7.8 and 7.9 (ISO 9283 poses, section 7.7.3.4), Figures 7.10 and 7.11 (1,000 poses, section
    7.7.3.5).
    """
    out = []
    for number, kind, area, what in (
        (8, "iso9283", "iso_poses", "the ISO 9283 poses, P1 to P5, thirty cycles each"),
        (10, "poses", "iso_cube", "poses in the ISO cube"),
    ):
        for k, (quantity, name) in enumerate(_QUANTITIES):
            caption = f"After Figure 7.{number + k}: {name} errors of {what}, 3 kg"
            strips = _strips_of(_members(), f"{kind}/{area}/3/{quantity}", quantity, by_column=kind == "iso9283")
            out.append(Figure(MODELS, f"figure-7-{number + k}", caption, tuple(COMPARED.values()), strips))
    return out


def _relative() -> list[Figure]:
    """Nubiola 2011, Figures 7.13 and 7.14: relative errors in the sphere (sections 7.7.3.6 and 7.7.3.7)."""
    out = []
    for number, kind, what in (
        (13, "sphere_virtual_frame", "a virtual frame"),
        (14, "sphere_three_points", "3 points"),
    ):
        caption = f"After Figure 7.{number}: relative errors from {what}, 3 kg"
        strips = _strips_of(_members("34"), f"{kind}/sphere/3/point")
        out.append(Figure(MODELS, f"figure-7-{number}", caption, (FULL,), strips))
    return out


def _sizes(settings: Settings) -> list[Figure]:
    """Nubiola 2011, Figures 7.15 and 7.16: a procedure of each size, position and orientation (section 7.7.4)."""
    sizes = tuple(Repetition(settings.model, n) for n in settings.procedures)
    members = _coloured((f"{r.measures}", r) for r in sizes)
    out = []
    for k, (quantity, name) in enumerate(_QUANTITIES):
        caption = f"After Figure 7.{15 + k}: {name} errors of the first procedure of each size, ISO cube, 3 kg"
        strips = _strips_of(members, f"poses/iso_cube/3/{quantity}", quantity)
        out.append(Figure(PROCEDURES, f"figure-7-{15 + k}", caption, sizes, strips))
    return out


def _letters(results: Results) -> list[Figure]:
    """The worst procedures and the best of all.

    Nubiola 2011, Figure 7.17 (section 7.7.5.1), Figures 7.18 and 7.19 (section 7.7.5.2).
    """
    twenty = tuple(procedures(results.settings))
    letters = _coloured((f"{item.letter} ({item.repetition.measures})", item.repetition) for item in chosen(results))
    out = []
    for number, key, quantity, what in (
        (17, "verified/all_range/6/point", "point", "position errors, whole range, 6 kg"),
        (18, "poses/iso_cube/3/flange", "flange", "position reduced to the flange, ISO cube, 3 kg"),
        (19, "poses/iso_cube/3/orientation", "orientation", "orientation errors, ISO cube, 3 kg"),
    ):
        caption = f"After Figure 7.{number}: {what}; the worst procedures of each size and the best of all (B)"
        strips = _strips_of(letters, key, quantity)
        out.append(Figure(PROCEDURES, f"figure-7-{number}", caption, twenty, strips))
    return out


Member: TypeAlias = "tuple[str, Repetition, str]"
"""Label, repetition and colour."""


def _coloured(members: Iterable[tuple[str, Repetition]]) -> list[Member]:
    return [(name, r, ROW_COLOURS[k % len(ROW_COLOURS)]) for k, (name, r) in enumerate(members)]


Two: TypeAlias = "Mapping[str, tuple[tuple[float, ...], tuple[float, ...]]]"
"""Kind -> four numbers in the ISO cube and in the whole range."""


def _beside(settings: Settings) -> tuple[str, Two, Two] | None:
    """Names and values of the thesis's tables, 3 and 6 kg, for a model that it verified; None for others."""
    if settings.model == "34":
        return "7.4 and 7.5", printed.TABLE_7_4, printed.TABLE_7_5
    return ("7.6 and 7.7", printed.TABLE_7_6, printed.TABLE_7_7) if settings.model == "11" else None


# --- drawing ----------------------------------------------------------------------------------------------


def _expected_found(figure: Canvas, results: Results, series: Series) -> list[Any]:
    """Mean and maximum found with fake targets against those expected (Nubiola 2011, section 7.6)."""
    from matplotlib.lines import Line2D

    panels = figure.subplots(1, 2)
    _, *tables = _beside(results.settings) or (None,)
    for axes, name, column in zip(panels, ("mean", "max"), (0, 2), strict=True):
        for area, colour in AREA_COLOURS.items():
            for load, marker in MARKERS.items():
                pairs = [
                    [results.row(r, kind, area, load)[name] for kind in ("expected", "verified")]
                    for r in procedures(results.settings)
                ]
                axes.plot(*np.transpose(pairs), marker, color=colour, alpha=0.75, markersize=5, markeredgewidth=0)
            for load, table in zip(PAYLOADS, tables, strict=False):
                pair = [table[kind][AREAS.index(area)][column] for kind in ("expected", "verified")]
                axes.plot(*pair, MARKERS[load], markeredgecolor=colour, markerfacecolor="none", markersize=7)
        limits = np.array([axes.get_xlim(), axes.get_ylim()])
        ends = (limits.min(), limits.max())
        axes.plot(ends, ends, color=INK, alpha=0.4, linewidth=1)
        axes.set(xlim=ends, ylim=ends, xlabel=f"expected {name} (mm)", ylabel=f"found {name} (mm)")
        axes.set_aspect("equal")
        axes.locator_params(nbins=4)
    return [
        Line2D(
            [], [], color=AREA_COLOURS[area], marker=MARKERS[load], linestyle="", label=f"{AREA_NAMES[area]}, {load} kg"
        )
        for area in AREAS
        for load in PAYLOADS
    ]


def _curve_of(area: str) -> Draw:
    def draw(figure: Canvas, results: Results, series: Series) -> list[Any]:
        axes = figure.add_subplot()
        settings = results.settings
        methods = [(settings.method, ORANGE if settings.method == "nelder-mead" else GREEN)]
        if settings.method == "least-squares":
            methods = []
        for method, colour in (*methods, ("least-squares", CALIBRATED)):
            second = method != settings.method
            values = curve_values(results, least_squares=second)
            for name, line in (("max", "-"), ("mean", "--")):
                v = values[area, name]
                label = method if name == "max" else None
                axes.plot(
                    settings.curve, np.median(v, axis=1), line, color=colour, marker="o", markersize=4, label=label
                )
                axes.fill_between(settings.curve, v.min(axis=1), v.max(axis=1), color=colour, alpha=0.18, linewidth=0)
        if settings.model == "34":
            k = AREAS.index(area)
            sizes = (80, 120, 120, 180, 200)
            maxima = [row[k] for row in printed.TABLE_7_13.values()]
            axes.plot(sizes, maxima, "D", markeredgecolor=INK, markerfacecolor="none", markersize=6, label="thesis")
        axes.set_xscale("log")
        axes.set_xticks(settings.curve, [str(n) for n in settings.curve], rotation=45 if len(settings.curve) > 6 else 0)
        axes.minorticks_off()
        axes.set_ylim(bottom=0)
        axes.set_xlabel("identification measurements")
        axes.set_ylabel("expected error (mm)")
        return axes.get_legend_handles_labels()[0]

    return draw


def _boxes_of(area: str, load: int) -> Draw:
    def draw(figure: Canvas, results: Results, series: Series) -> None:
        axes = figure.add_subplot()
        settings = results.settings
        for k, n in enumerate(settings.procedures):
            colour = ROW_COLOURS[k % len(ROW_COLOURS)]
            for i in range(settings.each):
                row = results.row(Repetition(settings.model, n, i + 1), "expected", area, load)
                x = k * (settings.each + 1) + i
                names = ("p5", "p25", "p50", "p75", "p95")
                low, q1, middle, q3, high = (row[name] for name in names)
                axes.vlines(x, low, high, color=colour, linewidth=1.2)
                axes.bar(x, q3 - q1, 0.7, q1, facecolor=(colour, 0.35), edgecolor=colour)
                axes.hlines(middle, x - 0.35, x + 0.35, color=colour, linewidth=2)
                axes.plot(x, row["max"], "o", color=colour, markersize=4)
        middles = [k * (settings.each + 1) + (settings.each - 1) / 2 for k in range(len(settings.procedures))]
        axes.set_xticks(middles, [str(n) for n in settings.procedures])
        axes.grid(axis="x", visible=False)
        axes.set_ylim(bottom=0)
        axes.set_xlabel("measurements of each procedure")
        axes.set_ylabel("expected error (mm)")

    return draw


def _course(figure: Canvas, results: Results, series: Series) -> list[Any]:
    """Nubiola 2011, Figure 7.2: the objective and the errors of points that took no part, iteration by iteration."""
    course = series[COURSE]
    axes = figure.add_subplot()
    lines = [("objective_mm", INK, "-", "objective (largest of the 140)")]
    for area in AREAS:
        lines.append((f"{area}_max_mm", AREA_COLOURS[area], "-", f"{AREA_NAMES[area]}: max"))
        lines.append((f"{area}_mean_mm", AREA_COLOURS[area], "--", "mean"))
    for name, colour, style, label in lines:
        values = course[f"course/{name}"]
        axes.plot(course["course/iteration"], values, style, color=colour, linewidth=1.4, label=label)
        if colour != INK:
            best = int(np.argmin(values))
            axes.plot(course["course/iteration"][best], values[best], "o", color=colour, markersize=5)
    axes.set_xlabel("iteration; dots: least")
    axes.set_ylabel("error (mm)")
    axes.set_ylim(bottom=0)
    return axes.get_legend_handles_labels()[0]


def _strips_of(members: Sequence[Member], key: str, quantity: str = "point", by_column: bool = False) -> Draw:
    """Errors one by one, the models side by side so that none hides another; a line at each mean."""

    def draw(figure: Canvas, results: Results, series: Series) -> None:
        axes = figure.add_subplot()
        middles, start = [], 0.0
        for _, repetition, colour in members:
            values = series[repetition][key]
            values = (values.T if by_column else values).ravel()
            n = len(values)
            x = start + np.arange(n) / max(n - 1, 1)
            size = min(5.0, max(1.6, 60 / n**0.5))
            style = {"color": colour, "alpha": 0.6, "markersize": size, "markeredgewidth": 0}
            axes.plot(x, values, "o", rasterized=True, **style)
            axes.hlines(np.nanmean(values), start, start + 1, color=INK, linewidth=1.2)
            middles.append(start + 0.5)
            start += 1.15
        axes.set_xticks(middles, [name for name, _, _ in members])
        axes.tick_params(axis="x", length=0)
        axes.grid(axis="x", visible=False)
        axes.set_ylim(bottom=0)
        axes.set_ylabel("error (°)" if quantity == "orientation" else "error (mm)")

    return draw


def render(results: Results, tables: Sequence[Table], series: Series) -> str:
    """The page.

    Parameters
    ----------
    results : Results
    tables : sequence of Table
    series : dict of Repetition to dict of str to ndarray
        Errors one by one of `chapter7.page.drawn`.

    Returns
    -------
    str
    """
    from irbcal.templates import environment

    every = figures(results)
    possible = [k for k, item in enumerate(every) if results.has(*item.needs)]
    drawings = dict(parallel.each(_drawing, (results, series), possible, seconds=FIGURE_S))
    sections: dict[str, list[tuple[str, Any]]] = {}
    for place, k in enumerate(possible):
        sections.setdefault(every[k].section, []).append((every[k].caption, drawings[place]))
    return (
        environment("chapter7", "")
        .get_template("page.html.j2")
        .render(
            settings=results.settings,
            procedures=len(procedures(results.settings)),
            sections=sections,
            tables=tables,
            verdict=verdict(results),
            title="Study of calibrations (simulated)",
            is_cell=lambda value: isinstance(value, Cell),
            is_number=lambda value: isinstance(value, (Cell, int)),
        )
    )


def _drawing(shared: tuple[Results, Series], number: int) -> Any:
    """A figure by its number, as part of the page."""
    results, series = shared
    item = figures(results)[number]
    with inline_svg.style():
        return inline_svg.drawn(partial(item.draw, results=results, series=series), item.key, item.caption)


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
