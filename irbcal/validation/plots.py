"""Charts of the validation: poses and cycles, tracker checks, ballbar, calibrations side by side."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from irbcal.plotting.charts import (
    Boxes,
    Chart,
    Drawing,
    LegendEntry,
    Lines,
    Panel,
    Sign,
    Text,
    round_number,
    runs,
    span,
    up_to,
)
from irbcal.units import HOUR, MM

if TYPE_CHECKING:
    from irbcal.arrays import FloatArray, NameArray
    from irbcal.correction.paths import Reversal
    from irbcal.validation.ballbar_check import BallbarCheck
    from irbcal.validation.ballbar_trace import Trace
    from irbcal.validation.comparing import Compared
    from irbcal.validation.path_check import PathCheck
    from irbcal.validation.point_drift import PointDrift
    from irbcal.validation.point_repeatability import PointRepeatability
    from irbcal.validation.pose_check import PoseCheck
    from irbcal.validation.posing_time import PosingTimes
    from irbcal.validation.scale_bar import ScaleBar
    from irbcal.validation.settling_check import Settling
    from irbcal.validation.static_compliance import StaticCompliance

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

WIDE, TALL = 560.0, 300.0
"""Size of a drawing."""

DOT = 4.0
"""Size of the mark of a single reading."""

DASHED, DOTTED = "5 3", "1.5 3"
COLOURS = ("calibrated", "nominal", "below", "above", "accent", "measured", "series2", "series3", "series4", "unknown")
"""Of calibrations side by side."""


def _top(*values: ArrayLike) -> float:
    """Where an axis from zero ends above values."""
    return up_to(1.07 * max((float(np.nanmax(v)) for v in values if np.size(v)), default=1.0))


def _grouped(drawing: Drawing, labels: Sequence[str] | NameArray, y: Sequence[float], x: str, label: str) -> Panel:
    """A panel with runs of equal labels at x: lines between them, the labels under their middle."""
    groups = runs(labels)
    ticks = [(a + b - 1) / 2 for a, b, _ in groups], [name for *_, name in groups]
    panel = Panel(drawing, (-1, len(labels)), y, x, label, x_ticks=ticks)
    for start, _, _ in groups[1:]:
        panel.upright(start - 0.5, "line")
    return panel


# --- ISO 9283 ---------------------------------------------------------------------------------------------


def pose_cycles(result: PoseCheck) -> Chart:
    """Position and orientation errors by pose, in each pose by cycle (Nubiola 2011, Figures 7.8 and 7.9)."""
    models = {name: (m, m.history) for name, m in result.models.items() if m.history}
    turned = all(history["orientation_deg"] is not None for _, history in models.values())
    kinds = [("position_mm", "position error (mm)"), ("orientation_deg", "orientation error (°)")]
    drawings: list[Drawing] = []
    legend: list[LegendEntry] = []
    about = ""
    for key, label in kinds[: 2 if turned else 1]:
        rows: dict[str, FloatArray] = {}
        for name, (model, history) in models.items():
            order = np.argsort([list(model.poses).index(p) for p in history["pose"]], kind="stable")
            labels = [history["pose"][k] for k in order]
            rows[name] = np.array(history[key], dtype=float)[order]
            about = (model.overall or {})["from"]
        drawing = Drawing(label, 0.7 * TALL, WIDE)
        panel = _grouped(drawing, labels, (0.0, _top(*rows.values())), "pose, in each by cycle", label)
        for name, values in rows.items():
            panel.dots(np.arange(len(values)), values, name, DOT)
        drawings.append(drawing)
    for name, (model, _) in models.items():
        mean = (model.overall or {})["position"]["mean_mm"]
        legend.append((name, "o", f"{name} (mean {mean:.3f} mm)"))
    caption = f"Errors by pose and cycle, from the {'command' if about == 'commanded' else 'mean'}"
    return Chart("poses", caption, drawings, legend, 1).marked(result.simulated)


def drift_sets(result: PoseCheck) -> Chart:
    """Accuracy and repeatability of each set of cycles of the drift test."""
    measured = {name: model.drift for name, model in result.models.items() if model.drift}
    rows: list[tuple[str, Sign, str, FloatArray]] = []
    for name, values in measured.items():
        x = np.arange(1.0, values["sets"] + 1) if values["time_s"] is None else np.array(values["time_s"]) / 3600
        if "AP_mm" in values:
            rows.append((name, "-", f"AP, {name}", np.array(values["AP_mm"])))
    last = list(measured.values())[-1]
    rows.append(("measured", "--", "RP", np.array(last["RP_mm"])))
    rows.append(("unknown", "--", "way of the mean", np.array(last["shift_mm"])))
    drawing = Drawing("Drift", TALL, WIDE)
    label = "time (h)" if last["time_s"] else f"set of {last['set_size']} cycles"
    panel = Panel(drawing, span(x), (0.0, _top(*(y for *_, y in rows))), label, "AP, RP, way (mm)")
    for colour, sign, _, y in rows:
        panel.line(x, y, colour, dash="" if sign == "-" else DASHED)
        panel.dots(x, y, colour, DOT)
    legend: list[LegendEntry] = [(colour, sign, label) for colour, sign, label, _ in rows]
    caption = "Accuracy and repeatability of each set of cycles of the drift test"
    return Chart("drift", caption, [drawing], legend).marked(result.simulated)


def approaches(result: Settling) -> Chart:
    """Distance from the final position over time (Figure A V-1), with the limit band and the time of settling."""
    distances = {name: np.maximum(run.distance / MM, LEAST) for name, run in result.runs.items()}
    band = result.band / MM
    every = np.concatenate([*distances.values(), [band]])
    drawing = Drawing("Distance from the final position over time", TALL, WIDE)
    ends = span(*(run.instant for run in result.runs.values()))
    label = "distance from final position (mm)"
    panel = Panel(drawing, ends, (0.8 * every.min(), 1.3 * every.max()), "time (s)", label, log=True)
    legend: list[LegendEntry] = []
    for k, (name, run) in enumerate(result.runs.items()):
        colour = f"series{k % 5}"
        panel.line(run.instant, distances[name], colour)
        settled = f"PSt {run.time:.2f} s" if np.isfinite(run.settled) else "never settled"
        legend.append((colour, "-", f"run {name}: {settled}"))
        if np.isfinite(run.settled):
            panel.upright(run.settled, colour, dash=DASHED)
    panel.level(band, "ink", dash=DOTTED)
    legend.append(("ink", "--", f"band {band:g} mm"))
    caption = "Distance from the final position over time; upright dashed line: settled"
    return Chart("stabilisation", caption, [drawing], legend).marked(result.simulated)


def along_path(result: PathCheck) -> Chart:
    """Path accuracy and repeatability on the planes along the path."""
    along, errors = result.along / MM, result.errors
    mean, spread = np.linalg.norm(errors.mean, axis=1) / MM, errors.repeatability / MM
    drawing = Drawing("Path accuracy and repeatability", TALL, WIDE)
    panel = Panel(drawing, span(along), (0.0, _top(mean, spread)), "way on the commanded path (mm)", "distance (mm)")
    panel.line(along, mean, "measured")
    panel.line(along, spread, "accent", dash=DASHED)
    legend: list[LegendEntry] = [
        ("measured", "-", f"mean path, AT = {errors.AT / MM:.3f}"),
        ("accent", "--", f"mean(l) + 3 S, RT = {errors.RT / MM:.3f}"),
    ]
    for corner in result.corners:
        panel.upright(corner.way / MM, dash="4 2")
    if result.corners:
        legend.append(("soft", "--", "corners"))
    caption = "Path accuracy and repeatability on the planes along the path"
    return Chart("path", caption, [drawing], legend).marked(result.simulated)


def posing_times(result: PosingTimes) -> Chart:
    """Posing time over the length of the move: cycles and their mean."""
    moves = sorted(result.moves.values(), key=lambda move: float(move.distance.mean()))
    drawing = Drawing("Posing time over the length of the move", TALL, WIDE)
    x_label = f"length of the move (mm); limit band {result.band / MM:g} mm"
    ends = (0.0, _top(*(move.distance / MM for move in moves)))
    panel = Panel(drawing, ends, (0.0, _top(*(move.times for move in moves))), x_label, "posing time (s)")
    for move in moves:
        panel.dots(move.distance / MM, move.times, "measured", DOT)
    panel.line([m.distance.mean() / MM for m in moves], [m.times.mean() for m in moves], "accent")
    caption = "Posing time over the length of the move"
    legend: list[LegendEntry] = [("accent", "-", "mean of the cycles")]
    return Chart("posing", caption, [drawing], legend).marked(result.simulated)


def compliance(result: StaticCompliance) -> Chart:
    """Displacement along the force over the force, with the fitted slopes."""
    along = {name: d.displacement @ d.direction / MM for name, d in result.directions.items()}
    slopes = {name: d.along / MM for name, d in result.directions.items()}
    ends = {name: np.array([0.0, d.force.max()]) for name, d in result.directions.items()}
    drawing = Drawing("Displacement over force", TALL, WIDE)
    x_label, y_label = f"force along the axes of the {result.frame} (N)", "displacement along the force (mm)"
    y = span(*along.values(), *(ends[name] * slope for name, slope in slopes.items()))
    panel = Panel(drawing, (0.0, _top(*ends.values())), y, x_label, y_label)
    legend: list[LegendEntry] = []
    for k, (name, direction) in enumerate(result.directions.items()):
        colour = f"series{k % 5}"
        panel.dots(direction.force, along[name], colour, DOT)
        panel.line(ends[name], ends[name] * slopes[name], colour)
        legend.append((colour, "-", f"{name}: {slopes[name]:.5f} mm/N"))
    return Chart("compliance", "Displacement along the force", [drawing], legend).marked(result.simulated)


# --- tracker ----------------------------------------------------------------------------------------------


def bar(result: ScaleBar) -> Chart:
    """Distance errors of the scale bar in order of measurement, by position of the bar (Figure A II-1)."""
    error = result.error / MM
    drawing = Drawing("Distance errors of the scale bar", TALL, WIDE)
    panel = _grouped(drawing, result.position, span(error, [0.0]), "position of the bar", "distance error (mm)")
    panel.level(0.0)
    panel.dots(np.arange(len(error)), error, "measured", DOT)
    for start, end, name in runs(result.position):
        mean = result.at(name).mean() / MM
        panel.line([start - 0.5, end - 0.5], [mean, mean], "accent")
    caption = "Distance errors of the scale bar, in each position in order of measurement; line: mean"
    return Chart("scale_bar", caption, [drawing])


def repeat(result: PointRepeatability) -> Chart:
    """Distance of each reading from the mean of its point (Nubiola 2011, Figure A III-1)."""
    order = np.argsort([result.positions().index(name) for name in result.position], kind="stable")
    error, labels = result.error[order] / UM, [result.position[k] for k in order]
    limits = {name: result.statistics(name)["mean_plus_3sigma_mm"] * MM / UM for name in result.positions()}
    drawing = Drawing("Distance of each reading from the mean of its point", TALL, WIDE)
    top = _top(error, list(limits.values()))
    panel = _grouped(drawing, labels, (0.0, top), "point", "distance from mean (µm)")
    panel.dots(np.arange(len(error)), error, "measured", DOT)
    for start, end, name in runs(labels):
        panel.line([start - 0.5, end - 0.5], [limits[name], limits[name]], "accent")
    caption = "Distance of each reading from the mean of its point, in order of measurement; line: mean + 3σ"
    return Chart("repeatability", caption, [drawing])


def drift(result: PointDrift) -> Chart:
    """Error and air over time, one above the other (Figures A IV-1, A IV-2, A IV-3 and A IV-4)."""
    hours = result.time / HOUR
    error = Drawing("Error over time", 0.65 * TALL, WIDE)
    top = _top(result.error / UM)
    Panel(error, span(hours), (0.0, top), "time (h)", "error (µm)").dots(hours, result.error / UM, "measured", 2.5)
    drawings = [error]
    for name, values in result.air.items():
        drawing = Drawing(UNITS[name], 0.65 * TALL, WIDE)
        Panel(drawing, span(hours), span(values), "time (h)", UNITS[name]).line(hours, values, "accent", 1.0)
        drawings.append(drawing)
    return Chart("drift", "Error and air over time", drawings, columns=1)


# --- ballbar ----------------------------------------------------------------------------------------------

SIDE, RIM = 520.0, 185.0
"""Side of the polar drawing and radius of its rim."""


def ballbar(result: BallbarCheck, magnification: float | None = None) -> Chart:
    """Polar plot of radial errors, magnified, with the joint reversals marked on the rim (Nubiola 2011, Figure A VI-1).

    Parameters
    ----------
    result : BallbarCheck
    magnification : float, optional
        How many times errors are drawn larger than the radius; by default a round number.
    """
    radius, traces = result.bar / MM, result.traces()
    largest = max(np.abs(trace.error).max() for trace in traces.values()) / MM
    if magnification is None:
        magnification = round_number(0.3 * radius / max(largest, 1e-6))
    step = round_number(0.15 * radius / magnification)
    count = min(int(np.ceil(largest / step)) + 1, int(0.9 * radius / magnification / step))
    rings = step * np.arange(-count, count + 1, dtype=float)
    inside = radius + magnification * rings[0]
    rim = radius + magnification * max(rings.max() + 0.5 * step, largest + 0.3 * step)
    drawing = Drawing("Radial errors of the ballbar", SIDE, SIDE)

    def at(angle: ArrayLike, r: ArrayLike) -> FloatArray:
        a, s = np.asarray(angle, dtype=float), RIM / rim * np.asarray(r, dtype=float)
        return np.column_stack(np.broadcast_arrays(SIDE / 2 + s * np.cos(a), SIDE / 2 - s * np.sin(a)))

    turn = np.linspace(0, 2 * np.pi, 361)
    drawing.add(Lines([at(turn, radius + magnification * ring) for ring in rings], "line", 0.8))
    drawing.add(Lines([at(turn, radius)], "soft", 1.3))
    legend: list[LegendEntry] = []
    for (name, trace), (colour, dash) in zip(traces.items(), _looks(result), strict=True):
        drawing.add(Lines([at(*_closed(trace, radius, magnification))], colour, 1.4, dash))
        legend.append((colour, "--" if dash else "-", name))
    for ring in rings[[0, -1]]:
        position = at(np.radians(22.5), radius + magnification * ring)[0]
        drawing.add(Boxes(np.concatenate([position - [15, 7], position + np.array([15, 7])])[None], "page"))
        drawing.add(Text(position[0], position[1], f"{ring:+.3g}", "middle", "soft", 10.0))
    for angle, beside, text in _spread(_marks(result.prediction.reversals)):
        paths = [at([angle, angle], [inside, rim]), at([angle, beside], [rim, 1.05 * rim])]
        drawing.add(Lines(paths, "soft", 0.8))
        position = at(beside, 1.08 * rim)[0]
        across, up = np.cos(beside), np.sin(beside)
        lines = text.split("\n")
        first = position[1] - 12.0 * (len(lines) - 1) * (0.5 if abs(up) < 0.4 else 1.0 if up > 0 else 0.0)
        for k, line in enumerate(lines):
            side: Any = "middle" if abs(across) < 0.4 else "start" if across > 0 else "end"
            drawing.add(Text(position[0], first + 12.0 * k, line, side, size=10.0))
    for tick in np.arange(0, 360, 45):
        position = at(np.radians(tick), 0.82 * inside)[0]
        drawing.add(Text(position[0], position[1], f"{tick}°", "middle", "soft", 10.0))
    for k, line in enumerate((f"bar {radius:g} mm", f"errors × {magnification:g}", f"1 ring = {step:g} mm")):
        drawing.add(Text(SIDE / 2, SIDE / 2 + 13.0 * (k - 1), line, "middle", size=10.0))
    caption = (
        "Radial errors; on the rim: joints that turn back there, at their largest (max) or smallest (min) angle; "
        "rings: error in mm"
    )
    return Chart("ballbar", caption, [drawing], legend, mark=f"{result.mark}. " if result.mark else "")


def _spread(
    marks: Sequence[tuple[float, str]], line_angle: float = 3.2, smallest: float = 10.0
) -> list[tuple[float, float, str]]:
    """Marks with places of their words beside them, moved so far apart that the words do not overlap.

    ``line_angle`` is the height of a line and ``smallest`` the width of a word on the rim, degrees.
    """
    beside = np.array([angle for angle, _ in marks])
    lines = np.array([text.count("\n") + 1 for _, text in marks])
    for _ in range(50):
        for k in range(len(marks)):
            following = (k + 1) % len(marks)
            need = np.radians(max(smallest, line_angle * (lines[k] + lines[following]) / 2 + 1.0))
            gap = (beside[following] - beside[k]) % (2 * np.pi)
            if len(marks) > 1 and gap < need:
                beside[k] -= 0.5 * (need - gap)
                beside[following] += 0.5 * (need - gap)
    return [(old, float(angle), text) for (old, text), angle in zip(marks, beside, strict=True)]


def _looks(result: BallbarCheck) -> list[tuple[str, str]]:
    """Colour and dashes of each trace."""
    looks = [("nominal", ""), *([("calibrated", "")] if result.prediction.corrected is not None else [])]
    lines = (DOTTED, DASHED, "6 3 1.5 3")
    return looks + [("measured", lines[k % len(lines)]) for k in range(len(result.measured))]


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
    for reversal in sorted(reversals, key=lambda r: r.s):
        if groups and 360 * (reversal.s - groups[-1][-1].s) < apart:
            groups[-1].append(reversal)
        else:
            groups.append([reversal])
    return [
        (float(2 * np.pi * np.mean([r.s for r in group])), "\n".join(f"J{r.joint} {r.kind}" for r in group))
        for group in groups
    ]


# --- calibrations side by side ----------------------------------------------------------------------------


def compared_by_pose(result: Compared) -> Chart:
    """Errors of each pose, in the order of the best calibration's."""
    best = result.names.index(result.ranking[0])
    order = np.argsort(result.error_mm[:, best], kind="stable")
    x = np.arange(1.0, len(order) + 1)
    drawing = Drawing("Errors of each pose", TALL, WIDE)
    x_label = f"pose, in the order of the errors of {result.names[best]}"
    panel = Panel(drawing, span(x), (0.0, _top(result.error_mm)), x_label, "position error (mm)", whole_x=True)
    legend: list[LegendEntry] = []
    for k, name in enumerate(result.names):
        colour = COLOURS[k % len(COLOURS)]
        panel.dots(x, result.error_mm[order, k], colour, DOT, opacity=0.7)
        legend.append((colour, "o", f"{name} ({result.statistics[name]['mean_mm']:.3f} mm)"))
    caption = "Errors of each pose, in the order of the best calibration's"
    return Chart("by_pose", caption, [drawing], legend).marked(result.simulated)


def compared_shares(result: Compared) -> Chart:
    """Share of the points below each error."""
    count = len(result.distance_mm)
    drawing = Drawing("Share of the points below each error", TALL, WIDE)
    panel = Panel(drawing, (0.0, _top(result.distance_mm)), (0.0, 1.02), "position error (mm)", "share of the points")
    legend: list[LegendEntry] = []
    for k, name in enumerate(result.names):
        colour, distance = COLOURS[k % len(COLOURS)], np.sort(result.distance_mm[:, k])
        panel.line(np.repeat(distance, 2), np.repeat(np.arange(count + 1), 2)[1:-1] / count, colour)
        legend.append((colour, "-", name))
    panel.level(0.95, dash=DASHED)
    caption = "Share of the points below each error; dashed: 95 %"
    return Chart("shares", caption, [drawing], legend).marked(result.simulated)


def compared_files(result: Compared) -> dict[str, bytes]:
    """Charts of calibrations side by side as PNG files by their names."""
    return {f"{c.name}.png": c.content("png") for c in (compared_by_pose(result), compared_shares(result))}
