"""Figures of what an average of error models carries: families, gears and corrections of the joints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.io.schema import EvidenceSection, ExplainedStage, Gear, GearSpectrum, Record
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms.gear import in_words
from irbcal.plotting.charts import Chart, Drawing, LegendEntry, Panel, Sign, Text, fixed, up_to
from irbcal.reports.evidence import Evidence
from irbcal.units import DEG, MM

ROW = 40.0
"""Height of a bar with its words."""
FINE, BINS = 4001, 110
"""Places at which a correction is computed, and ranges of the joint of which the extremes are drawn."""
FAR = 0.15
"""How far beyond the range of the fit a correction is drawn, as a share of that range."""
TYPICAL = 20 * DEG, 0.1
"""Last move that corrections are drawn for: of a joint that turns, of one that slides."""
MOST_DOTS = 400
SMALLEST = 1e-9
"""Correction below which a joint has none, radians or metres."""


# --- what each family explains ----------------------------------------------------------------------------


def by_leaving_out(section: EvidenceSection) -> bool:
    """Whether left-out poses of the fit tell more than held-out ones: there are none of these, or readings lag."""
    return section.readings_lag or any(stage.mean_mm is None for stage in section.explained)


def explained(record: Record) -> Chart:
    """A bar for each stage, one family after the other, and one for the calibration."""
    section = record.evidence
    assert section is not None
    left_out = by_leaving_out(section)
    rows = [(stage, stage.leave_one_out_mm if left_out else stage.mean_mm or 0.0) for stage in section.explained]
    if left_out:
        average, kind = section.leave_one_out_mm[""], "rms error of poses left out of the fit one at a time"
    else:
        average = record.heldout.all.mean_mm if record.heldout is not None else 0.0
        kind = "mean error of the held-out poses"
    timed = [stage.timed_mean_mm for stage, _ in rows if stage.timed_mean_mm is not None and not left_out]
    caption = (
        f"What each family of terms explains: {kind}, in fits of their own with one family after the other (of a "
        "family's coefficients, so many were seen). Of this calibration, which is an average of several choices, the "
        "dark bar"
    )
    if timed:
        caption += (
            ". A tick shows the error with the warmth that the arm had at each pose; the robot that is used is the "
            "warm one, which poses of a cold arm miss"
        )
    top = up_to(1.02 * max(average or 0.0, *(value for _, value in rows)))
    drawing = Drawing(caption, 46.0 + ROW * (len(rows) + 1))
    panel = Panel(drawing, (0, top), (0, len(rows) + 1), f"{'rms' if left_out else 'mean'} error (mm)", "", plain=True)
    before = 0.0
    for k, (stage, value) in enumerate(rows):
        words = _stage_words(stage, value, stage.seen - before, k)
        before = stage.seen if stage.carried else before
        y = len(rows) - k
        _bar(panel, drawing, y, value, words, "calibrated" if stage.carried else "soft", 0.55)
        if stage.timed_mean_mm is not None and not left_out:
            x = stage.timed_mean_mm
            panel.line([x, x], [y + 0.03, y + 0.5], "accent", 3.0)
    if average is not None:
        _bar(panel, drawing, 0, average, f"this calibration: {fixed(average, 3)} mm", "calibrated", 1.0)
    legend: list[LegendEntry] = [("calibrated", "o", "in this calibration")]
    if not all(stage.carried for stage, _ in rows):
        legend.append(("soft", "o", "only tried"))
    if timed:
        legend.append(("accent", "-", "with the warmth of each pose"))
    return Chart("explained", caption, [drawing], legend, columns=1)


def _stage_words(stage: ExplainedStage, value: float, seen: float, k: int) -> str:
    more = "" if k == 0 else "+ "
    return f"{more}{stage.added}: {fixed(value, 3)} mm ({max(seen, 0.0):.0f} seen)"


def _bar(panel: Panel, drawing: Drawing, y: float, value: float, words: str, colour: str, opacity: float) -> None:
    place = panel.at(0, y + 0.75)[0]
    drawing.add(Text(place[0] + 4, place[1], words, bold=opacity == 1.0))
    panel.boxes([0], [y + 0.08], [value], [y + 0.45], colour, titles=[words], opacity=opacity)


# --- gears ------------------------------------------------------------------------------------------------


def gear_spectrum(spectrum: GearSpectrum, gears: Sequence[Gear]) -> Chart:
    """A panel for each joint: how strong a wave of so many cycles per turn would be, and what was found."""
    values = np.array(spectrum.chi2)
    cycles = spectrum.first + spectrum.step * np.arange(values.shape[1]) + 0.5 * (spectrum.step - 1)
    top = up_to(1.12 * max(float(values.max()), 1.2 * spectrum.limit, *(gear.chi2 for gear in gears or ())))
    drawings = []
    for joint, row in zip(spectrum.joints, values, strict=True):
        drawing = Drawing(f"Gear scan of joint {joint}", 190.0, 300.0)
        panel = Panel(drawing, (0.0, cycles[-1] + 3), (0.0, top), f"joint {joint}, cycles per turn", "chi2")
        panel.level(spectrum.limit, "soft", dash="4 3")
        panel.line(cycles, row, "ink", 1.0)
        mine = sorted((gear for gear in gears if gear.joint == joint), key=lambda gear: gear.cycles_per_turn)
        for gear in mine:
            words = in_words(gear.joint, gear.cycles_per_turn, gear.amplitude_deg)
            panel.dots([gear.cycles_per_turn], [gear.chi2], "accent", 7.0, titles=[f"{words} (chi2 {gear.chi2:.0f})"])
        _named(drawing, panel, mine, cycles[-1], spectrum.limit)
        drawings.append(drawing)
    found = f"{len(gears)} found" if gears else "none was found"
    caption = (
        "Gear scan: by how much a wave of so many cycles per turn would explain what the terms so far leave (chi2; the "
        f"strongest of every {spectrum.step} frequencies), before any was taken. Above the dashed line it is not "
        f"chance: {found}{', marked as strong as when it was taken' if gears else ''}. A harmonic drive makes twice "
        "its ratio"
    )
    legend: list[LegendEntry] = [("ink", "-", "scan"), ("soft", "--", "limit of chance")]
    return Chart("gear_spectrum", caption, drawings, [*legend, ("accent", "o", "found")] if gears else legend, 3)


def _named(drawing: Drawing, panel: Panel, gears: Sequence[Gear], end: float, limit: float) -> None:
    """Numbers of found waves beside their marks, each below the one before where they would meet."""
    taken: list[FloatArray] = []
    for gear in gears:
        at = panel.at(gear.cycles_per_turn, gear.chi2)[0]
        right = gear.cycles_per_turn < 0.6 * end
        ratio = in_words(gear.joint, gear.cycles_per_turn, gear.amplitude_deg).rpartition("ratio ")[2]
        text = f"{gear.cycles_per_turn}" + (f" (ratio {ratio})" if ratio.isdigit() else "")
        level = panel.at(0, limit)[0, 1]
        if abs(at[1] - level) < 8:
            at = at + np.array([0.0, level - 9 - at[1]])
        while any(abs(at[0] - other[0]) < 90 and abs(at[1] - other[1]) < 13 for other in taken):
            at = at + np.array([0.0, 13.0])
        taken.append(at)
        drawing.add(Text(at[0] + (7 if right else -7), at[1], text, "start" if right else "end", size=11.0))


# --- corrections of the joints ----------------------------------------------------------------------------

SIDES: tuple[tuple[float, str, Sign, str], ...] = (
    (1.0, "below", "^", "reached from below"),
    (-1.0, "above", "v", "reached from above"),
)


def corrections(record: Record, evidence: Evidence) -> Chart | None:
    """A panel for each joint: effective minus commanded, over the joint's range and from both sides."""
    robot = record.robot_calibrated()
    fitted = next((poses for poses in evidence.sets if poses.name == "fitted"), None)
    if fitted is None or fitted.points is None or robot.joint_map.is_identity:
        return None
    points = fitted.points
    has_history = bool(getattr(robot.joint_map, "has_history", False))
    at_poses = robot.joint_map.effective(points.q, points.previous, **points.load()) - points.q
    drawings = [
        _correction(robot, j, points.q, at_poses, fitted.direction, has_history)
        for j in range(points.q.shape[1])
        if np.abs(at_poses[:, j]).max() > SMALLEST
    ]
    if not drawings:
        return None
    caption = (
        "Effective minus commanded angle: what the joint map adds to each joint that it changes. Dots: at the "
        "fitted poses, where gravity differs; curves: over "
        "the joint's range with the other joints in their middle, as bands where gears make waves too short to draw. "
        "Grey: the range of the fit; beyond it the map is extrapolated and must not be trusted"
    )
    if not has_history:
        return Chart("corrections", caption, drawings, [("calibrated", "-", "correction")], 3)
    caption += f". The two sides: after a move of {TYPICAL[0] / DEG:.0f}° of this joint alone"
    if record.robot.joint_types.count("prismatic"):
        caption += f" ({TYPICAL[1] / MM:.0f} mm of one that slides)"
    return Chart("corrections", caption, drawings, [(c, "-", words) for _, c, _, words in SIDES], 3)


def _correction(
    robot: Robot, j: int, q: FloatArray, at_poses: FloatArray, direction: FloatArray | None, has_history: bool
) -> Drawing:
    slides = bool(robot.arm.table.prismatic[j])
    unit, size, step = ("mm", MM, TYPICAL[1]) if slides else ("deg", DEG, TYPICAL[0])
    low, high = float(q[:, j].min()), float(q[:, j].max())
    reach = FAR * max(high - low, step)
    ends = max(low - reach, float(robot.arm.lower[j])), min(high + reach, float(robot.arm.upper[j]))
    ends = min(ends[0], low), max(ends[1], high)
    there = np.tile(np.median(q, axis=0), (FINE, 1))
    there[:, j] = np.linspace(*ends, FINE)
    curves = []
    for sign, colour, _, words in SIDES if has_history else ((0.0, "calibrated", "o", "correction"),):
        before = there.copy()
        before[:, j] -= sign * step
        values = robot.joint_map.effective(there, before if sign else None)[:, j] - there[:, j]
        curves.append((colour, words, _binned(there[:, j], values)))
    every = (
        np.concatenate([at_poses[:, j], *(np.concatenate([low, high]) for _, _, (_, low, high, _) in curves)]) / size
    )
    margin = 0.08 * max(float(np.ptp(every)), 1e-6)
    drawing = Drawing(f"Correction of joint {j + 1}", 200.0, 300.0)
    panel = Panel(
        drawing,
        (ends[0] / size, ends[1] / size),
        (every.min() - margin, every.max() + margin),
        f"joint {j + 1} ({unit})",
        f"correction ({unit})",
    )
    panel.boxes([low / size], [panel.y[0]], [high / size], [panel.y[1]], "line", opacity=0.35)
    if panel.y[0] < 0.0 < panel.y[1]:
        panel.level(0.0)
    sides = direction[:, j] if direction is not None and has_history else None
    _pose_dots(panel, q[:, j] / size, at_poses[:, j] / size, sides)
    for colour, words, (x, bottom, top, mean) in curves:
        half = 0.5 * (x[1] - x[0])
        panel.boxes((x - half) / size, bottom / size, (x + half) / size, top / size, colour, opacity=0.3)
        panel.line(x / size, mean / size, colour, 1.5)
        some = np.linspace(0, len(x) - 1, 12).astype(int)
        texts = [f"{words}: {mean[k] / size:+.4f} {unit} at {x[k] / size:.1f} {unit}" for k in some]
        panel.dots(x[some] / size, mean[some] / size, colour, 2.5, titles=texts)
    return drawing


def _pose_dots(panel: Panel, q: FloatArray, values: FloatArray, direction: FloatArray | None) -> None:
    some = np.arange(len(q)) if len(q) <= MOST_DOTS else np.random.default_rng(0).permutation(len(q))[:MOST_DOTS]
    q, values = q[some], values[some]
    if direction is None:
        panel.dots(q, values, "soft", 2.4, opacity=0.6)
        return
    for sign, colour in ((0.0, "soft"), (1.0, "below"), (-1.0, "above")):
        mine = direction[some] == sign
        if mine.any():
            panel.dots(q[mine], values[mine], colour, 2.4, opacity=0.5)


def _binned(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Middle of each range of x, smallest, largest and mean y there."""
    edges = np.linspace(0, len(x), BINS + 1).astype(int)
    low, high = np.minimum.reduceat(y, edges[:-1]), np.maximum.reduceat(y, edges[:-1])
    mean = np.add.reduceat(y, edges[:-1]) / np.diff(edges)
    return np.add.reduceat(x, edges[:-1]) / np.diff(edges), low, high, mean
