"""``page.html`` of a study: its figures and tables as one self-contained page that runs no script and loads nothing.

The figures are the counterparts of Nubiola 2011, Figures 7.2 and 7.4 to 7.19, and a few more. No text but this
module's own goes into them.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from irbcal.figures import inline_svg as study_svg
from irbcal.figures.colours import CALIBRATED, NOMINAL
from irbcal.figures.inline_svg import INK
from irbcal.studies import repetition as study
from irbcal.studies import tables as study_tables
from irbcal.studies import thesis as study_thesis
from irbcal.studies.repetition import AREAS, PAYLOADS, Repetition
from irbcal.studies.tables import AREA_NAMES, COMPARED, MODEL_NAMES

GREEN, PURPLE, GREY = "#2f9463", "#9560bd", "#7d868f"
MODEL_COLOURS = {"nominal": NOMINAL, "11": GREEN, "axes": PURPLE, "34": CALIBRATED}
ROW_COLOURS = (CALIBRATED, GREEN, NOMINAL, PURPLE, GREY)
AREA_COLOURS = dict(zip(AREAS, (CALIBRATED, NOMINAL), strict=True))
MARKERS = dict(zip(PAYLOADS, "os", strict=True))

OVERVIEW = "Expected against found, and the course of a search"


@dataclass(frozen=True)
class Figure:
    """A figure of the page: its section, caption, and what draws it (takes figure, results and series)."""

    section: str
    key: str
    caption: str
    needs: tuple
    draw: object


def drawn(results):
    """Finished repetitions whose errors one by one are drawn."""
    wanted = [*COMPARED.values(), study.COURSE, *(Repetition(results.settings.model, n) for n in _sizes(results))]
    if results.has(*study.procedures(results.settings)):
        wanted += [item.repetition for item in study_tables.chosen(results)]
    return [r for r in dict.fromkeys(wanted) if results.has(r)]


def _sizes(results):
    return results.settings.procedures


def render(results, tables, series):
    """The page.

    Parameters
    ----------
    results : Results
    tables : list of Table
    series : dict of Repetition to dict of str to ndarray
        Errors one by one of `drawn`.

    Returns
    -------
    str
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    sections = {}
    with study_svg.style():
        for item in figures(results):
            if results.has(*item.needs):
                drawing = study_svg.drawn(partial(item.draw, results=results, series=series), item.key, item.caption)
                sections.setdefault(item.section, []).append((item.caption, drawing))
    environment = Environment(
        loader=PackageLoader("irbcal.studies"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    return environment.get_template("study.html.j2").render(
        settings=results.settings,
        procedures=len(study.procedures(results.settings)),
        sections=sections,
        tables=tables,
        verdict=verdict(results),
        calibrated=CALIBRATED,
        is_cell=lambda value: isinstance(value, study_tables.Cell),
        is_number=lambda value: isinstance(value, (study_tables.Cell, int)),
    )


def verdict(results):
    """What the procedures came to, in a sentence; None while they are not done."""
    settings = results.settings
    every = study.procedures(settings)
    if not results.has(*every):
        return None
    found = [results.row(r, "verified", "all_range") for r in every]
    expected = [results.row(r, "expected", "all_range") for r in every]
    before = results.row(study.NOMINAL, "verified", "all_range")["mean"] if results.has(study.NOMINAL) else None
    low, high = min(row["mean"] for row in found), max(row["mean"] for row in found)
    ratio = np.median([a["mean"] / b["mean"] for a, b in zip(found, expected, strict=True)])
    start = f"{len(every)} simulated calibrations by {settings.method}: with fake targets the virtual robot"
    where = "in the whole range with 3 kg"
    nominal = f" ({before:.3f} mm without)" if before is not None else ""
    return (
        f"{start} misses by {low:.3f} to {high:.3f} mm on average {where}{nominal}; "
        f"that is {ratio:.2f} times what the models had promised (median)."
    )


def figures(results):
    """All figures, in the page's order."""
    settings = results.settings
    twenty = tuple(study.procedures(settings))
    sizes = tuple(Repetition(settings.model, n) for n in settings.procedures)
    four = tuple(COMPARED.values())
    out = [
        Figure(
            *(OVERVIEW, "expected-found"),
            "Each procedure: error found with fake targets against error expected from the model; mean and maximum"
            + (f". Hollow: the thesis's, Tables {_beside(settings)[0]}" if _beside(settings) else ""),
            *(twenty, _expected_found),
        )
    ]
    out.append(
        Figure(
            *(OVERVIEW, "figure-7-2"),
            "After Figure 7.2: a Nelder-Mead search on 140 measurements, and 20 + 20 points that took no part",
            *((study.COURSE,), _course),
        )
    )
    if settings.curve:
        out += [
            Figure(
                *("Number of measurements", f"curve-{area}"),
                f"Expected error against the number of measurements, {AREA_NAMES[area]}, 3 kg: maximum (above) and "
                "mean; lines: medians, bands: all choices. Hollow: the thesis's maxima, Table 7.13",
                *(tuple(study.curve(settings)), _curve_of(area)),
            )
            for area in AREAS
        ]
    out += [
        Figure(
            *("Number of measurements", f"boxes-{area}"),
            f"Expected errors of each procedure, {AREA_NAMES[area]}, {load} kg: boxes hold half of the points, "
            "whiskers 90 %, dots are maxima",
            *(twenty, _boxes_of(area, load)),
        )
        for area, load in zip(AREAS, PAYLOADS, strict=True)
    ]
    three = (study.NOMINAL, study.SMALL, study.FULL)
    models = [(MODEL_NAMES[name].replace(" ", "\n"), r, MODEL_COLOURS[name]) for name, r in COMPARED.items()]
    for number, (load, area) in enumerate(((load, area) for load in PAYLOADS for area in AREAS), 4):
        caption = f"After Figure 7.{number}: position errors found, {AREA_NAMES[area]}, {load} kg"
        strips = _strips_of([m for m in models if m[1] in three], f"verified/{area}/{load}/point")
        out.append(Figure("Models, point by point", f"figure-7-{number}", caption, three, strips))
    for number, kind, area, what in (
        (8, "iso9283", "iso_poses", "the ISO 9283 poses, P1 to P5, thirty cycles each"),
        (10, "poses", "all_range", "poses in the whole range"),
    ):
        for k, (quantity, name) in enumerate(_QUANTITIES):
            caption = f"After Figure 7.{number + k}: {name} errors of {what}, 3 kg"
            strips = _strips_of(models, f"{kind}/{area}/3/{quantity}", quantity, by_column=kind == "iso9283")
            out.append(Figure("Models, point by point", f"figure-7-{number + k}", caption, four, strips))
    for number, kind, what in (
        (13, "sphere_virtual_frame", "a virtual frame"),
        (14, "sphere_three_points", "3 points"),
    ):
        caption = f"After Figure 7.{number}: relative errors from {what}, 3 kg"
        strips = _strips_of(models[-1:], f"{kind}/sphere/3/point")
        out.append(Figure("Models, point by point", f"figure-7-{number}", caption, (study.FULL,), strips))
    for k, (quantity, name) in enumerate(_QUANTITIES):
        caption = f"After Figure 7.{15 + k}: {name} errors of the first procedure of each size, whole range, 3 kg"
        members = _coloured((f"{r.measures}", r) for r in sizes)
        strips = _strips_of(members, f"poses/all_range/3/{quantity}", quantity)
        out.append(Figure("Procedures, point by point", f"figure-7-{15 + k}", caption, sizes, strips))
    if not results.has(*twenty):
        return out
    letters = _coloured(
        (f"{item.letter} ({item.repetition.measures})", item.repetition) for item in study_tables.chosen(results)
    )
    for number, key, quantity, what in (
        (17, "verified/all_range/6/point", "point", "position errors, whole range, 6 kg"),
        (18, "poses/iso_cube/3/flange", "flange", "position reduced to the flange, ISO cube, 3 kg"),
        (19, "poses/iso_cube/3/orientation", "orientation", "orientation errors, ISO cube, 3 kg"),
    ):
        caption = f"After Figure 7.{number}: {what}; the worst procedures of each size and the best of all (B)"
        out.append(
            Figure(
                *("Procedures, point by point", f"figure-7-{number}", caption, twenty),
                _strips_of(letters, key, quantity),
            )
        )
    return out


def _coloured(members):
    return [(name, r, ROW_COLOURS[k % len(ROW_COLOURS)]) for k, (name, r) in enumerate(members)]


_QUANTITIES = (("flange", "position"), ("orientation", "orientation"))


def _beside(settings):
    """Names and values of the thesis's tables, 3 and 6 kg, for a model that it verified; None for others."""
    if settings.model == "34":
        return "7.4 and 7.5", study_thesis.TABLE_7_4, study_thesis.TABLE_7_5
    return ("7.6 and 7.7", study_thesis.TABLE_7_6, study_thesis.TABLE_7_7) if settings.model == "11" else None


# --- drawing ----------------------------------------------------------------------------------------------


def _expected_found(figure, results, series):
    from matplotlib.lines import Line2D

    panels = figure.subplots(1, 2)
    _, *tables = _beside(results.settings) or (None,)
    for axes, name, column in zip(panels, ("mean", "max"), (0, 2), strict=True):
        for area, colour in AREA_COLOURS.items():
            for load, marker in MARKERS.items():
                pairs = [
                    [results.row(r, kind, area, load)[name] for kind in ("expected", "verified")]
                    for r in study.procedures(results.settings)
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


def _curve_of(area):
    def draw(figure, results, series):
        axes = figure.add_subplot()
        settings = results.settings
        methods = [(settings.method, NOMINAL if settings.method == "nelder-mead" else GREEN)]
        if settings.method == "least-squares":
            methods = []
        for method, colour in (*methods, ("least-squares", CALIBRATED)):
            second = method != settings.method
            values = study_tables.curve_values(results, least_squares=second)
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
            maxima = [row[k] for row in study_thesis.TABLE_7_13.values()]
            axes.plot(sizes, maxima, "D", markeredgecolor=INK, markerfacecolor="none", markersize=6, label="thesis")
        axes.set_xscale("log")
        axes.set_xticks(settings.curve, [str(n) for n in settings.curve], rotation=45 if len(settings.curve) > 6 else 0)
        axes.minorticks_off()
        axes.set_ylim(bottom=0)
        axes.set_xlabel("identification measurements")
        axes.set_ylabel("expected error (mm)")
        return axes.get_legend_handles_labels()[0]

    return draw


def _boxes_of(area, load):
    def draw(figure, results, series):
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


def _course(figure, results, series):
    course = series[study.COURSE]
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


def _strips_of(members, key, quantity="point", by_column=False):
    """Errors one by one, the models side by side so that none hides another; a line at each mean."""

    def draw(figure, results, series):
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
