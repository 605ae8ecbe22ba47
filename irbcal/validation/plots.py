"""Figures of the validation: poses and cycles, tracker checks, ballbar. Saved whole or not at all."""

from io import BytesIO
from itertools import pairwise
from pathlib import Path

import numpy as np

from irbcal.errors import IrbcalError
from irbcal.figures.colours import ACCENT, CALIBRATED, NOMINAL
from irbcal.units import MM

MEASURED = "#333333"
"""Colour of measured values; what is computed from them has `ACCENT`: neither is that of a model."""
RUNS = (MEASURED, ACCENT, "#2f8f5b", "#a0527a", "#6b7280")
COLOURS = {"nominal": NOMINAL, "calibrated": CALIBRATED, "measured": MEASURED}
"""One colour for each model, the same as in the report."""

SUFFIXES = (".png", ".svg", ".pdf")
UNITS = {
    "temperature_c": "temperature (°C)",
    "pressure_mmhg": "pressure (mmHg)",
    "pressure_hpa": "pressure (hPa)",
    "humidity_percent": "humidity (%)",
}


def save(draw, path, *data, size=(7.2, 4.4)):
    """Draw a figure into a file.

    Parameters
    ----------
    draw : callable
        One of this module's functions: takes the figure and the data.
    path : str or Path
        ``.png``, ``.svg`` or ``.pdf``.
    *data
        What ``draw`` takes after the figure.
    size : tuple of float
        Inches.

    Raises
    ------
    IrbcalError
        If the ending is none of these or the file cannot be written.
    """
    import matplotlib
    from matplotlib.figure import Figure

    from irbcal.files.atomic import write_together

    path = check_name(path)
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(
            {
                "svg.fonttype": "none",
                "svg.hashsalt": "irbcal",
                "text.parse_math": False,
                "font.size": 11,
                "axes.spines.top": False,
                "axes.spines.right": False,
                "axes.axisbelow": True,
                "axes.grid": True,
                "grid.alpha": 0.25,
            }
        )
        figure = Figure(figsize=size, layout="constrained")
        draw(figure, *data)
        stream = BytesIO()
        metadata = {"Date": None} if path.suffix == ".svg" else None
        figure.savefig(stream, format=path.suffix[1:], dpi=150, metadata=metadata)
    write_together(path.parent, {path.name: stream.getvalue()})


def check_name(path):
    """Refuse endings that are no figure's, before any work is done."""
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise IrbcalError(f"{path}: figures end in {', '.join(SUFFIXES)}")
    return path.with_suffix(path.suffix.lower())


def _legend(figure, handles, columns=3):
    figure.legend(handles=handles, loc="outside upper right", ncols=columns, frameon=False)


def _groups_on_x(axes, labels):
    """Lines between runs of equal labels, and the labels under their middle."""
    labels = list(labels)
    starts = [0] + [k for k in range(1, len(labels)) if labels[k] != labels[k - 1]] + [len(labels)]
    for start in starts[1:-1]:
        axes.axvline(start - 0.5, color="0.6", linewidth=0.8)
    middles = [(a + b - 1) / 2 for a, b in pairwise(starts)]
    axes.set_xticks(middles, [labels[int(m)] for m in middles])
    axes.tick_params(axis="x", length=0)
    axes.grid(False, axis="x")
    axes.set_xlim(-1, len(labels))


# --- ISO 9283 ---------------------------------------------------------------------------------------------


def pose_cycles(figure, result):
    """Position and orientation errors by pose, in each pose by cycle (Nubiola 2011, figures 7.8 and 7.9)."""
    from matplotlib.lines import Line2D

    models = {name: m for name, m in result["models"].items() if m["history"]}
    turned = all(m["history"]["orientation_deg"] is not None for m in models.values())
    panels = figure.subplots(2 if turned else 1, 1, sharex=True, squeeze=False)[:, 0]
    handles = []
    for name, model in models.items():
        history = model["history"]
        order = np.argsort([list(model["poses"]).index(p) for p in history["pose"]], kind="stable")
        labels = [history["pose"][k] for k in order]
        for axes, key in zip(panels, ("position_mm", "orientation_deg"), strict=False):
            axes.plot(np.array(history[key])[order], "o", color=COLOURS[name], markersize=3.2)
        mean = model["overall"]["position"]["mean_mm"]
        handles.append(
            Line2D([], [], marker="o", linestyle="", color=COLOURS[name], label=f"{name} (mean {mean:.3f} mm)")
        )
    about = next(iter(models.values()))["overall"]["from"]
    panels[0].set_ylabel("position error (mm)")
    if turned:
        panels[1].set_ylabel("orientation error (°)")
    for axes in panels:
        axes.set_ylim(bottom=0)
        _groups_on_x(axes, labels)
    panels[-1].set_xlabel(f"pose, in each by cycle; errors from the {'command' if about == 'commanded' else 'mean'}")
    _legend(figure, handles)


def drift_sets(figure, result):
    """Accuracy and repeatability of each set of cycles of the drift test."""
    axes = figure.add_subplot()
    for name, model in result["models"].items():
        found = model["drift"]
        if not found:
            continue
        x = np.arange(1, found["sets"] + 1) if found["time_s"] is None else np.array(found["time_s"]) / 3600
        if "AP_mm" in found:
            axes.plot(x, found["AP_mm"], "-o", color=COLOURS[name], markersize=4, label=f"AP, {name}")
        last = found
    axes.plot(x, last["RP_mm"], "--s", color=MEASURED, markersize=4, label="RP")
    axes.plot(x, last["shift_mm"], ":^", color=MEASURED, markersize=4, label="way of the mean")
    axes.set_ylim(bottom=0)
    axes.set_xlabel("time (h)" if last["time_s"] else f"set of {last['set_size']} cycles")
    axes.set_ylabel("AP, RP, way (mm)")
    _legend(figure, axes.get_legend_handles_labels()[0], 4)


def approaches(figure, result):
    """Distance from the final position over time (annex V), with the limit band and the time of settling."""
    axes = figure.add_subplot()
    for k, (name, run) in enumerate(result["runs"].items()):
        colour = RUNS[k % len(RUNS)]
        distance = np.maximum(run["distance_mm"], 1e-4)
        settled = "never settled" if run["settled_s"] is None else f"PSt {run['PSt_s']:.2f} s"
        axes.semilogy(run["time_s"], distance, color=colour, linewidth=1, label=f"run {name}: {settled}")
        if run["settled_s"] is not None:
            axes.axvline(run["settled_s"], color=colour, linewidth=1, linestyle=(0, (4, 2)))
    axes.axhline(
        result["band_mm"], color=MEASURED, linewidth=1.2, linestyle=":", label=f"band {result['band_mm']:g} mm"
    )
    axes.yaxis.set_major_formatter("{x:g}")
    axes.set_xlabel("time (s); dashed: settled")
    axes.set_ylabel("distance from final position (mm)")
    _legend(figure, axes.get_legend_handles_labels()[0], 2)


def along_path(figure, result):
    """Path accuracy and repeatability on the planes along the path."""
    axes = figure.add_subplot()
    axes.plot(
        result["along_mm"], result["mean_error_mm"], color=MEASURED, label=f"mean path, AT = {result['AT_mm']:.3f}"
    )
    label = f"mean(l) + 3 S, RT = {result['RT_mm']:.3f}"
    axes.plot(result["along_mm"], result["repeatability_mm"], "--", color=ACCENT, label=label)
    axes.set_ylim(bottom=0)
    axes.set_xlabel("way on the commanded path (mm)")
    axes.set_ylabel("distance (mm)")
    _legend(figure, axes.get_legend_handles_labels()[0])


# --- tracker ----------------------------------------------------------------------------------------------


def bar(figure, result):
    """Distance errors of the scale bar in order of measurement, by position of the bar (figure A II-1)."""
    axes = figure.add_subplot()
    axes.plot(result["error_mm"], "o", color=MEASURED, markersize=3)
    for start, name in _starts(result["position"]):
        mean = result["per_position"][name]["mean_mm"]
        axes.plot([start[0] - 0.5, start[1] - 0.5], [mean, mean], color=ACCENT, linewidth=1.4)
    axes.axhline(0, color="0.4", linewidth=0.8)
    _groups_on_x(axes, result["position"])
    axes.set_xlabel("position of the bar, in each in order of measurement; line: mean")
    axes.set_ylabel("distance error (mm)")


def _starts(labels):
    edges = [0] + [k for k in range(1, len(labels)) if labels[k] != labels[k - 1]] + [len(labels)]
    return [((a, b), labels[a]) for a, b in pairwise(edges)]


def repeat(figure, result):
    """Distance of each reading from the mean of its point (figure A III-1)."""
    axes = figure.add_subplot()
    order = np.argsort([list(result["per_position"]).index(p) for p in result["position"]], kind="stable")
    axes.plot(np.array(result["error_mm"])[order] * 1e3, "o", color=MEASURED, markersize=3)
    labels = [result["position"][k] for k in order]
    for (a, b), name in _starts(labels):
        limit = result["per_position"][name]["mean_plus_3sigma_mm"] * 1e3
        axes.plot([a - 0.5, b - 0.5], [limit, limit], color=ACCENT, linewidth=1.4)
    axes.set_ylim(bottom=0)
    _groups_on_x(axes, labels)
    axes.set_xlabel("point, in each in order of measurement; line: mean + 3σ")
    axes.set_ylabel("distance from mean (µm)")


def drift(figure, result):
    """Error and air over time, one above the other (figures A IV-1 to A IV-4)."""
    series = result["series"]
    air = series["air"]
    panels = figure.subplots(1 + len(air), 1, sharex=True, squeeze=False)[:, 0]
    panels[0].plot(series["hours"], np.array(series["error_mm"]) * 1e3, ".", color=MEASURED, markersize=2)
    panels[0].set_ylabel("error (µm)")
    panels[0].set_ylim(bottom=0)
    for axes, (name, values) in zip(panels[1:], air.items(), strict=True):
        axes.plot(series["hours"], np.array(values, dtype=float), color=ACCENT, linewidth=1)
        axes.set_ylabel(UNITS[name])
        axes.ticklabel_format(useOffset=False)
    panels[-1].set_xlabel("time (h)")
    figure.align_ylabels()


def settle(figure, result):
    """See `approaches`."""
    approaches(figure, result)


# --- ballbar ----------------------------------------------------------------------------------------------


def ballbar(figure, traces, reversals, bar, magnification=None):
    """Polar plot of radial errors, magnified, with the joint reversals marked on the rim (figure A VI-1).

    Parameters
    ----------
    figure : Figure
    traces : list of tuple
        (label, colour, line style, Trace).
    reversals : list of Reversal
    bar : float
        Nominal length of the ballbar, metres.
    magnification : float, optional
        How many times errors are drawn larger than the radius; by default a round number.

    Returns
    -------
    float
        The magnification.
    """
    radius = bar / MM
    largest = max(np.abs(trace.error).max() for *_, trace in traces) / MM
    if magnification is None:
        magnification = round_number(0.3 * radius / max(largest, 1e-6))
    axes = figure.add_subplot(projection="polar")
    step = round_number(0.15 * radius / magnification)
    count = min(int(np.ceil(largest / step)) + 1, int(0.9 * radius / magnification / step))
    rings = step * np.arange(-count, count + 1)
    turn = np.linspace(0, 2 * np.pi, 361)
    for ring in rings:
        style = {"color": "0.35", "linewidth": 1.3} if ring == 0 else {"color": "0.8", "linewidth": 0.8}
        axes.plot(turn, np.full_like(turn, radius + magnification * ring), zorder=1, **style)
    handles = []
    for label, colour, line, trace in traces:
        angle, r = trace.angle, radius + magnification * trace.error / MM
        gaps = np.diff(np.append(angle, angle[0] + 2 * np.pi))
        if gaps[-1] < 3 * np.median(gaps):
            angle, r = np.append(angle, angle[0] + 2 * np.pi), np.append(r, r[0])
        handles += axes.plot(angle, r, line, color=colour, linewidth=1.6, label=label, zorder=3, clip_on=False)
    rim = radius + magnification * max(rings.max() + 0.5 * step, largest + 0.3 * step)
    for angle, text in _marks(reversals):
        axes.plot([angle, angle], [radius + magnification * rings[0], rim], color="0.5", linewidth=0.9, zorder=2)
        axes.text(angle, rim + 0.13 * radius, text, ha="center", va="center", fontsize=8, color="0.2", linespacing=0.95)
    axes.set_ylim(0, rim)
    axes.set_yticks([radius + magnification * ring for ring in rings], [])
    axes.grid(False)
    ticks = np.arange(0, 360, 45)
    axes.set_xticks(np.radians(ticks), [])
    for tick in ticks:
        inner = 0.82 * (radius + magnification * rings[0])
        axes.text(np.radians(tick), inner, f"{tick}°", ha="center", va="center", fontsize=8, color="0.45")
    for ring in rings[[0, -1]]:
        axes.text(
            np.radians(22.5),
            radius + magnification * ring,
            f"{ring:+.3g}",
            fontsize=7,
            color="0.4",
            ha="center",
            va="center",
            bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.6},
            zorder=4,
        )
    axes.spines["polar"].set_visible(False)
    axes.text(
        0,
        0,
        f"bar {radius:g} mm\nerrors × {magnification:g}\n1 ring = {step:g} mm",
        ha="center",
        va="center",
        fontsize=9,
    )
    note = "on the rim: joints that turn back there, at their largest (max) or smallest (min) angle; rings: error in mm"
    figure.supxlabel(note, fontsize=8, color="0.3")
    figure.legend(handles=handles, loc="outside upper left", ncols=1, frameon=False, fontsize=9)
    return magnification


def _marks(reversals, apart=6.0):
    """Reversals that are near one another as one mark: (angle, text)."""
    groups = []
    for item in sorted(reversals, key=lambda r: r.s):
        if groups and 360 * (item.s - groups[-1][-1].s) < apart:
            groups[-1].append(item)
        else:
            groups.append([item])
    return [
        (2 * np.pi * np.mean([r.s for r in group]), "\n".join(f"J{r.joint} {r.kind}" for r in group))
        for group in groups
    ]


def round_number(value):
    """Largest of 1, 2, 5 times a power of ten that is not above a value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(k for k in (1.0, 2.0, 5.0) if k * power <= value * (1 + 1e-12)) * power)
