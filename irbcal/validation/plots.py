"""Figures of the validation: poses and cycles, tracker checks, ballbar; each draws a result into a figure."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from irbcal.figures.colours import ACCENT, CALIBRATED, MEASURED, NOMINAL, RULE, SERIES, SOFT
from irbcal.figures.style import SMALL, THIN
from irbcal.units import HOUR, MM

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.projections.polar import PolarAxes

    from irbcal.arrays import FloatArray, NameArray
    from irbcal.correction.paths import Reversal
    from irbcal.validation.ballbar_check import BallbarCheck
    from irbcal.validation.ballbar_trace import Trace
    from irbcal.validation.path_check import PathCheck
    from irbcal.validation.point_drift import PointDrift
    from irbcal.validation.point_repeatability import PointRepeatability
    from irbcal.validation.pose_check import PoseCheck
    from irbcal.validation.posing_time import PosingTimes
    from irbcal.validation.scale_bar import ScaleBar
    from irbcal.validation.settling_check import Settling
    from irbcal.validation.static_compliance import StaticCompliance

COLOURS = {"nominal": NOMINAL, "calibrated": CALIBRATED, "measured": MEASURED}
"""One colour for each model, the same as in the report."""

UNITS = {
    "temperature_c": "temperature (°C)",
    "pressure_mmhg": "pressure (mmHg)",
    "pressure_hpa": "pressure (hPa)",
    "humidity_percent": "humidity (%)",
}
UM = 1e-6
"""One micrometre in metres."""

LEAST = 1e-4
"""Smallest distance that a logarithmic axis shows, mm."""

DOT = 3.0
"""Size of the mark of a single reading."""


def _legend(figure: Figure, handles: Sequence[Any], columns: int = 3) -> None:
    figure.legend(handles=handles, loc="outside upper right", ncols=columns)


def _mark(figure: Figure, simulated: bool) -> None:
    """Say above a figure that its data are simulated."""
    if simulated:
        figure.suptitle("SIMULATED data", x=0.01, ha="left", fontsize=SMALL, fontweight="bold", color=ACCENT)


def _runs(labels: Sequence[str] | NameArray) -> list[tuple[int, int, str]]:
    """Runs of equal labels: start, end, label."""
    edges = [0, *(k for k in range(1, len(labels)) if labels[k] != labels[k - 1]), len(labels)]
    return [(a, b, labels[a]) for a, b in pairwise(edges)]


def _groups_on_x(axes: Axes, labels: Sequence[str] | NameArray) -> None:
    """Lines between runs of equal labels, and the labels under their middle."""
    runs = _runs(labels)
    for start, _, _ in runs[1:]:
        axes.axvline(start - 0.5, color=RULE, linewidth=THIN)
    axes.set_xticks([(a + b - 1) / 2 for a, b, _ in runs], [label for *_, label in runs])
    axes.tick_params(axis="x", length=0)
    axes.grid(False, axis="x")
    axes.set_xlim(-1, len(labels))


# --- ISO 9283 ---------------------------------------------------------------------------------------------


def pose_cycles(figure: Figure, result: PoseCheck) -> None:
    """Position and orientation errors by pose, in each pose by cycle (Nubiola 2011, Figures 7.8 and 7.9)."""
    from matplotlib.lines import Line2D

    models = {name: (m, m.history) for name, m in result.models.items() if m.history}
    turned = all(history["orientation_deg"] is not None for _, history in models.values())
    panels = figure.subplots(2 if turned else 1, 1, sharex=True, squeeze=False)[:, 0]
    handles, about = [], ""
    for name, (model, history) in models.items():
        order = np.argsort([list(model.poses).index(p) for p in history["pose"]], kind="stable")
        labels = [history["pose"][k] for k in order]
        for axes, key in zip(panels, ("position_mm", "orientation_deg"), strict=False):
            axes.plot(np.array(history[key])[order], "o", color=COLOURS[name], markersize=DOT)
        overall = model.overall or {}
        mean, about = overall["position"]["mean_mm"], overall["from"]
        handles.append(
            Line2D([], [], marker="o", linestyle="", color=COLOURS[name], label=f"{name} (mean {mean:.3f} mm)")
        )
    panels[0].set_ylabel("position error (mm)")
    if turned:
        panels[1].set_ylabel("orientation error (°)")
    for axes in panels:
        axes.set_ylim(bottom=0)
        _groups_on_x(axes, labels)
    panels[-1].set_xlabel(f"pose, in each by cycle; errors from the {'command' if about == 'commanded' else 'mean'}")
    _legend(figure, handles)
    _mark(figure, result.simulated)


def drift_sets(figure: Figure, result: PoseCheck) -> None:
    """Accuracy and repeatability of each set of cycles of the drift test."""
    axes = figure.add_subplot()
    measured = {name: model.drift for name, model in result.models.items() if model.drift}
    for name, found in measured.items():
        x = np.arange(1, found["sets"] + 1) if found["time_s"] is None else np.array(found["time_s"]) / 3600
        if "AP_mm" in found:
            axes.plot(x, found["AP_mm"], "-o", color=COLOURS[name], label=f"AP, {name}")
    last = list(measured.values())[-1]
    axes.plot(x, last["RP_mm"], "--s", color=MEASURED, label="RP")
    axes.plot(x, last["shift_mm"], ":^", color=MEASURED, label="way of the mean")
    axes.set_ylim(bottom=0)
    axes.set_xlabel("time (h)" if last["time_s"] else f"set of {last['set_size']} cycles")
    axes.set_ylabel("AP, RP, way (mm)")
    _legend(figure, axes.get_legend_handles_labels()[0], 4)
    _mark(figure, result.simulated)


def approaches(figure: Figure, result: Settling) -> None:
    """Distance from the final position over time (Figure A V-1), with the limit band and the time of settling."""
    axes = figure.add_subplot()
    for k, (name, run) in enumerate(result.runs.items()):
        colour = SERIES[k % len(SERIES)]
        distance = np.maximum(run.distance / MM, LEAST)
        settled = f"PSt {run.time:.2f} s" if np.isfinite(run.settled) else "never settled"
        axes.semilogy(run.instant, distance, color=colour, linewidth=1, label=f"run {name}: {settled}")
        if np.isfinite(run.settled):
            axes.axvline(run.settled, color=colour, linewidth=1, linestyle=(0, (4, 2)))
    band = result.band / MM
    axes.axhline(band, color=MEASURED, linestyle=":", label=f"band {band:g} mm")
    axes.yaxis.set_major_formatter("{x:g}")
    axes.set_xlabel("time (s); dashed: settled")
    axes.set_ylabel("distance from final position (mm)")
    _legend(figure, axes.get_legend_handles_labels()[0], 2)
    _mark(figure, result.simulated)


def along_path(figure: Figure, result: PathCheck) -> None:
    """Path accuracy and repeatability on the planes along the path."""
    axes = figure.add_subplot()
    along, errors = result.along / MM, result.errors
    mean = np.linalg.norm(errors.mean, axis=1) / MM
    axes.plot(along, mean, color=MEASURED, label=f"mean path, AT = {errors.AT / MM:.3f}")
    label = f"mean(l) + 3 S, RT = {errors.RT / MM:.3f}"
    axes.plot(along, errors.repeatability / MM, "--", color=ACCENT, label=label)
    for k, corner in enumerate(result.corners):
        name = "corners" if k == 0 else None
        axes.axvline(corner.way / MM, color=SOFT, linewidth=THIN, linestyle=(0, (4, 2)), label=name)
    axes.set_ylim(bottom=0)
    axes.set_xlabel("way on the commanded path (mm)")
    axes.set_ylabel("distance (mm)")
    _legend(figure, axes.get_legend_handles_labels()[0])
    _mark(figure, result.simulated)


def posing_times(figure: Figure, result: PosingTimes) -> None:
    """Posing time over the length of the move: cycles and their mean."""
    axes = figure.add_subplot()
    moves = sorted(result.moves.values(), key=lambda move: float(move.distance.mean()))
    x = np.array([move.distance.mean() / MM for move in moves])
    for move in moves:
        axes.plot(move.distance / MM, move.times, "o", color=MEASURED, markersize=DOT)
    axes.plot(x, [move.times.mean() for move in moves], color=ACCENT, label="mean of the cycles")
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)
    axes.set_xlabel(f"length of the move (mm); limit band {result.band / MM:g} mm")
    axes.set_ylabel("posing time (s)")
    _legend(figure, axes.get_legend_handles_labels()[0])
    _mark(figure, result.simulated)


def compliance(figure: Figure, result: StaticCompliance) -> None:
    """Displacement along the force over the force, with the fitted slopes."""
    axes = figure.add_subplot()
    for k, (name, found) in enumerate(result.directions.items()):
        colour = SERIES[k % len(SERIES)]
        axes.plot(found.force, found.displacement @ found.direction / MM, "o", color=colour, markersize=DOT)
        ends = np.array([0.0, found.force.max()])
        axes.plot(ends, ends * found.along / MM, color=colour, label=f"{name}: {found.along / MM:.5f} mm/N")
    axes.set_xlim(left=0)
    axes.set_xlabel(f"force along the axes of the {result.frame} (N)")
    axes.set_ylabel("displacement along the force (mm)")
    _legend(figure, axes.get_legend_handles_labels()[0])
    _mark(figure, result.simulated)


# --- tracker ----------------------------------------------------------------------------------------------


def bar(figure: Figure, result: ScaleBar) -> None:
    """Distance errors of the scale bar in order of measurement, by position of the bar (Figure A II-1)."""
    axes = figure.add_subplot()
    axes.plot(result.error / MM, "o", color=MEASURED, markersize=DOT)
    for start, end, name in _runs(result.position):
        mean = result.at(name).mean() / MM
        axes.plot([start - 0.5, end - 0.5], [mean, mean], color=ACCENT)
    axes.axhline(0, color=SOFT, linewidth=THIN)
    _groups_on_x(axes, result.position)
    axes.set_xlabel("position of the bar, in each in order of measurement; line: mean")
    axes.set_ylabel("distance error (mm)")


def repeat(figure: Figure, result: PointRepeatability) -> None:
    """Distance of each reading from the mean of its point (Nubiola 2011, Figure A III-1)."""
    axes = figure.add_subplot()
    order = np.argsort([result.positions().index(name) for name in result.position], kind="stable")
    axes.plot(result.error[order] / UM, "o", color=MEASURED, markersize=DOT)
    labels = [result.position[k] for k in order]
    for start, end, name in _runs(labels):
        limit = result.statistics(name)["mean_plus_3sigma_mm"] * MM / UM
        axes.plot([start - 0.5, end - 0.5], [limit, limit], color=ACCENT)
    axes.set_ylim(bottom=0)
    _groups_on_x(axes, labels)
    axes.set_xlabel("point, in each in order of measurement; line: mean + 3σ")
    axes.set_ylabel("distance from mean (µm)")


def drift(figure: Figure, result: PointDrift) -> None:
    """Error and air over time, one above the other (Figures A IV-1, A IV-2, A IV-3 and A IV-4)."""
    panels, hours = figure.subplots(1 + len(result.air), 1, sharex=True, squeeze=False)[:, 0], result.time / HOUR
    panels[0].plot(hours, result.error / UM, ".", color=MEASURED, markersize=2)
    panels[0].set_ylabel("error (µm)")
    panels[0].set_ylim(bottom=0)
    for axes, (name, values) in zip(panels[1:], result.air.items(), strict=True):
        axes.plot(hours, values, color=ACCENT, linewidth=1)
        axes.set_ylabel(UNITS[name])
        axes.ticklabel_format(useOffset=False)
    panels[-1].set_xlabel("time (h)")
    figure.align_ylabels()


# --- ballbar ----------------------------------------------------------------------------------------------


def ballbar(figure: Figure, result: BallbarCheck, magnification: float | None = None) -> None:
    """Polar plot of radial errors, magnified, with the joint reversals marked on the rim (Nubiola 2011, Figure A VI-1).

    Parameters
    ----------
    figure : Figure
    result : BallbarCheck
    magnification : float, optional
        How many times errors are drawn larger than the radius; by default a round number.
    """
    radius, traces = result.bar / MM, result.traces()
    largest = max(np.abs(trace.error).max() for trace in traces.values()) / MM
    if magnification is None:
        magnification = round_number(0.3 * radius / max(largest, 1e-6))
    axes: Any = figure.add_subplot(projection="polar")
    step = round_number(0.15 * radius / magnification)
    count = min(int(np.ceil(largest / step)) + 1, int(0.9 * radius / magnification / step))
    rings = step * np.arange(-count, count + 1, dtype=float)
    _rings(axes, rings, radius, magnification)
    handles = []
    for (name, trace), (colour, line) in zip(traces.items(), _looks(result), strict=True):
        angle, r = _closed(trace, radius, magnification)
        handles += axes.plot(angle, r, line, color=colour, label=name, zorder=3, clip_on=False)
    inside = radius + magnification * rings[0]
    rim = radius + magnification * max(rings.max() + 0.5 * step, largest + 0.3 * step)
    label = rim + 0.07 * radius
    for place, beside, text in _spread(_marks(result.prediction.reversals)):
        axes.plot([place, place], [inside, rim], color=SOFT, linewidth=THIN, zorder=2)
        axes.plot([place, beside], [rim, label - 0.02 * radius], color=SOFT, linewidth=THIN, zorder=2, clip_on=False)
        _word(axes, beside, label, text, linespacing=0.95, **_outwards(beside))
    axes.set_ylim(0, rim)
    ticks = np.arange(0, 360, 45)
    axes.set_xticks(np.radians(ticks), [])
    for tick in ticks:
        _word(axes, np.radians(tick), 0.82 * inside, f"{tick}°", color=SOFT)
    _word(axes, 0, 0, f"bar {radius:g} mm\nerrors × {magnification:g}\n1 ring = {step:g} mm")
    note = "on the rim: joints that turn back there, at their largest (max) or smallest (min) angle; rings: error in mm"
    figure.supxlabel(note, fontsize=SMALL, color=SOFT)
    figure.legend(handles=handles, loc="outside upper left", ncols=1, title=result.mark or None, alignment="left")


def _outwards(angle: float) -> dict[str, str]:
    """How words stand that begin at the rim and go outwards."""
    across, up = np.cos(angle), np.sin(angle)
    return {
        "ha": "center" if abs(across) < 0.4 else "left" if across > 0 else "right",
        "va": "center" if abs(up) < 0.4 else "bottom" if up > 0 else "top",
    }


def _spread(
    marks: Sequence[tuple[float, str]], line: float = 3.2, least: float = 10.0
) -> list[tuple[float, float, str]]:
    """Marks with places of their words beside them, moved so far apart that the words do not overlap.

    ``line`` is the height of a line and ``least`` the width of a word on the rim, degrees.
    """
    beside = np.array([place for place, _ in marks])
    lines = np.array([text.count("\n") + 1 for _, text in marks])
    for _ in range(50):
        for k in range(len(marks)):
            after = (k + 1) % len(marks)
            need = np.radians(max(least, line * (lines[k] + lines[after]) / 2 + 1.0))
            gap = (beside[after] - beside[k]) % (2 * np.pi)
            if len(marks) > 1 and gap < need:
                beside[k] -= 0.5 * (need - gap)
                beside[after] += 0.5 * (need - gap)
    return [(place, float(angle), text) for (place, text), angle in zip(marks, beside, strict=True)]


def _word(axes: PolarAxes, angle: float, r: float, text: str, **style: Any) -> None:
    axes.text(angle, r, text, **{"ha": "center", "va": "center", "fontsize": SMALL, **style})


def _rings(axes: PolarAxes, rings: FloatArray, radius: float, magnification: float) -> None:
    """Circles of equal error, the nominal one strong, the outer ones with their numbers."""
    turn = np.linspace(0, 2 * np.pi, 361)
    for ring in rings:
        colour, width = (SOFT, 1.3) if ring == 0 else (RULE, THIN)
        axes.plot(turn, np.full_like(turn, radius + magnification * ring), color=colour, linewidth=width, zorder=1)
    box = {"facecolor": "white", "edgecolor": "none", "pad": 0.6}
    for ring in rings[[0, -1]]:
        r = radius + magnification * ring
        _word(axes, np.radians(22.5), r, f"{ring:+.3g}", color=SOFT, bbox=box, zorder=4)
    axes.set_yticks(radius + magnification * rings, [])
    axes.grid(False)
    axes.spines["polar"].set_visible(False)


def _looks(result: BallbarCheck) -> list[tuple[str, str]]:
    """Colour and line of each trace."""
    looks = [(NOMINAL, "-"), *([(CALIBRATED, "-")] if result.prediction.corrected is not None else [])]
    lines = (":", "--", "-.")
    return looks + [(MEASURED, lines[k % len(lines)]) for k in range(len(result.measured))]


def _closed(trace: Trace, radius: float, magnification: float) -> tuple[FloatArray, FloatArray]:
    """A trace in polar coordinates, closed where its readings go all around."""
    angle, r = trace.angle, radius + magnification * trace.error / MM
    gaps = np.diff(np.append(angle, angle[0] + 2 * np.pi))
    if gaps[-1] < 3 * np.median(gaps):
        return np.append(angle, angle[0] + 2 * np.pi), np.append(r, r[0])
    return angle, r


def _marks(reversals: Sequence[Reversal], apart: float = 6.0) -> list[tuple[float, str]]:
    """Reversals within so many degrees of one another as one mark: (angle, text)."""
    groups: list[list[Reversal]] = []
    for item in sorted(reversals, key=lambda r: r.s):
        if groups and 360 * (item.s - groups[-1][-1].s) < apart:
            groups[-1].append(item)
        else:
            groups.append([item])
    return [
        (float(2 * np.pi * np.mean([r.s for r in group])), "\n".join(f"J{r.joint} {r.kind}" for r in group))
        for group in groups
    ]


def round_number(value: float) -> float:
    """Largest of 1, 2, 5 times a power of ten that is not above a value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(k for k in (1.0, 2.0, 5.0) if k * power <= value * (1 + 1e-12)) * power)
