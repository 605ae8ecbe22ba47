"""The charts of the calibration report: all of a page, and one by one for notebooks and files (``calibration.plot``).

Those of pose errors are in `irbcal.plotting.pose_errors`. A model has one colour in all of them. Names from the data
stand in texts and titles of marks, where they are escaped.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np

from irbcal.arrays import BoolArray, FloatArray
from irbcal.errors import OptionError
from irbcal.identification.fit_sections import GearSpectrum, GearWave, Observability, Stage
from irbcal.io.schema import Record
from irbcal.joint_analysis.joint_charts import SIDES, residuals_by_joint
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms.gear import in_words
from irbcal.plotting.charts import Chart, Drawing, LegendEntry, MarkerShape, Panel, Text, fixed, up_to
from irbcal.plotting.pose_errors import (
    PoseErrorPlots,
    before_and_after,
    course,
    distribution,
    errors_by_pose,
    turns_by_pose,
    vectors,
    workspace,
)
from irbcal.plotting.pose_sets import PoseErrors
from irbcal.reports import report_facts
from irbcal.reports.report_facts import ReportFacts
from irbcal.units import DEG, MM

ROW = 40.0
"""Height of a bar with its words."""
FINE, BINS = 4001, 110
"""Places at which a correction is computed, and ranges of the joint of which the extremes are drawn."""
DRAWN_BEYOND = 0.15
"""How far beyond the range of the fit a correction is drawn, as a share of that range."""
TYPICAL = 20 * DEG, 0.1
"""Last move that corrections are drawn for: of a joint that turns, of one that slides."""
MOST_DOTS = 400
SMALLEST = 1e-9
"""Correction below which a joint has none, radians or metres."""


# --- what each family explains ----------------------------------------------------------------------------


def explained(record: Record) -> Chart:
    """A bar for each stage, one family after the other, and one for the calibration."""
    section = record.evidence
    assert section is not None
    # left-out poses of the fit tell more where there are no held-out ones, or readings lag
    left_out = section.readings_lag or any(stage.mean_mm is None for stage in section.explained)
    rows = [(stage, stage.leave_one_out_mm if left_out else stage.mean_mm or 0.0) for stage in section.explained]
    if left_out:
        average, kind = section.leave_one_out_mm[""], "rms error of poses left out of the fit one at a time"
    else:
        average = record.heldout.all.mean_mm if record.heldout is not None else 0.0
        kind = "mean error of the held-out poses"
    timed = [stage.timed_mean_mm for stage, _ in rows if stage.timed_mean_mm is not None and not left_out]
    caption = (
        f"What each family of terms explains: {kind}, in fits of their own with one family after the other (of a "
        "family's coefficients, so many are determined). Of this calibration, which is an average of several choices, "
        "the dark bar"
    )
    if timed:
        caption += (
            ". A tick shows the error with the warmth that the arm had at each pose; the robot that is used is the "
            "warm one, which poses of a cold arm miss"
        )
    top = up_to(1.02 * max(average or 0.0, *(value for _, value in rows)))
    drawing = Drawing(caption, 46.0 + ROW * (len(rows) + 1))
    panel = Panel(drawing, (0, top), (0, len(rows) + 1), f"{'rms' if left_out else 'mean'} error (mm)", "", plain=True)
    seen_before = 0.0
    for k, (stage, value) in enumerate(rows):
        text = _stage_words(stage, value, stage.determined - seen_before, k)
        seen_before = stage.determined if stage.carried else seen_before
        y = len(rows) - k
        _bar(panel, drawing, y, value, text, "calibrated" if stage.carried else "soft", 0.55)
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


def _stage_words(stage: Stage, value: float, gain: float, k: int) -> str:
    more = "" if k == 0 else "+ "
    return f"{more}{stage.added}: {fixed(value, 3)} mm ({max(gain, 0.0):.0f} determined)"


def _bar(panel: Panel, drawing: Drawing, y: float, value: float, text: str, colour: str, opacity: float) -> None:
    at = panel.at(0, y + 0.75)[0]
    drawing.add(Text(at[0] + 4, at[1], text, bold=opacity == 1.0))
    panel.boxes([0], [y + 0.08], [value], [y + 0.45], colour, titles=[text], opacity=opacity)


# --- gears ------------------------------------------------------------------------------------------------


def gear_spectrum(spectrum: GearSpectrum, gears: Sequence[GearWave]) -> Chart:
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
        gears_of_joint = sorted((gear for gear in gears if gear.joint == joint), key=lambda gear: gear.cycles_per_turn)
        for gear in gears_of_joint:
            text = in_words(gear.joint, gear.cycles_per_turn, gear.amplitude_deg)
            panel.dots([gear.cycles_per_turn], [gear.chi2], "accent", 7.0, titles=[f"{text} (chi2 {gear.chi2:.0f})"])
        _named(drawing, panel, gears_of_joint, cycles[-1], spectrum.limit)
        drawings.append(drawing)
    count = f"{len(gears)} found" if gears else "none was found"
    caption = (
        "Gear scan: by how much a wave of so many cycles per turn would explain what the terms so far leave (chi2; the "
        f"strongest of every {spectrum.step} frequencies), before any was taken. Above the dashed line it is not "
        f"chance: {count}{', marked as strong as when it was taken' if gears else ''}. A harmonic drive makes twice "
        "its ratio"
    )
    legend: list[LegendEntry] = [("ink", "-", "scan"), ("soft", "--", "limit of chance")]
    return Chart("gear_spectrum", caption, drawings, [*legend, ("accent", "o", "found")] if gears else legend, 3)


def _named(drawing: Drawing, panel: Panel, gears: Sequence[GearWave], end: float, limit: float) -> None:
    """Numbers of found waves beside their marks, each below the one before where they would meet."""
    used: list[FloatArray] = []
    for gear in gears:
        at = panel.at(gear.cycles_per_turn, gear.chi2)[0]
        right = gear.cycles_per_turn < 0.6 * end
        ratio = in_words(gear.joint, gear.cycles_per_turn, gear.amplitude_deg).rpartition("ratio ")[2]
        text = f"{gear.cycles_per_turn}" + (f" (ratio {ratio})" if ratio.isdigit() else "")
        level = panel.at(0, limit)[0, 1]
        if abs(at[1] - level) < 8:
            at = at + np.array([0.0, level - 9 - at[1]])
        while any(abs(at[0] - neighbour[0]) < 90 and abs(at[1] - neighbour[1]) < 13 for neighbour in used):
            at = at + np.array([0.0, 13.0])
        used.append(at)
        drawing.add(Text(at[0] + (7 if right else -7), at[1], text, "start" if right else "end", size=11.0))


# --- corrections of the joints ----------------------------------------------------------------------------


def corrections(record: Record, facts: ReportFacts) -> Chart | None:
    """A panel for each joint: effective minus commanded, over the joint's range and from both sides."""
    robot = record.robot_calibrated()
    fitted = next((poses for poses in facts.sets if poses.name == "fitted"), None)
    if fitted is None or fitted.points is None or robot.joint_map.is_identity:
        return None
    points = fitted.points
    has_history = bool(getattr(robot.joint_map, "has_history", False))
    at_poses = robot.joint_map.effective(points.q, points.previous, **points.inputs) - points.q
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
    return Chart("corrections", caption, drawings, [(c, "-", label) for _, c, _, label in SIDES], 3)


def _correction(
    robot: Robot, j: int, q: FloatArray, at_poses: FloatArray, direction: FloatArray | None, has_history: bool
) -> Drawing:
    slides = bool(robot.arm.table.prismatic[j])
    unit, size, step = ("mm", MM, TYPICAL[1]) if slides else ("deg", DEG, TYPICAL[0])
    low, high = float(q[:, j].min()), float(q[:, j].max())
    reach = DRAWN_BEYOND * max(high - low, step)
    ends = max(low - reach, float(robot.arm.lower[j])), min(high + reach, float(robot.arm.upper[j]))
    ends = min(ends[0], low), max(ends[1], high)
    q_line = np.tile(np.median(q, axis=0), (FINE, 1))
    q_line[:, j] = np.linspace(*ends, FINE)
    curves = []
    for sign, colour, _, label in SIDES if has_history else ((0.0, "calibrated", "o", "correction"),):
        q_before = q_line.copy()
        q_before[:, j] -= sign * step
        values = robot.joint_map.effective(q_line, q_before if sign else None)[:, j] - q_line[:, j]
        curves.append((colour, label, _binned(q_line[:, j], values)))
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
    for colour, label, (x, bottom, top, mean) in curves:
        half = 0.5 * (x[1] - x[0])
        panel.boxes((x - half) / size, bottom / size, (x + half) / size, top / size, colour, opacity=0.3)
        panel.line(x / size, mean / size, colour, 1.5)
        rows = np.linspace(0, len(x) - 1, 12).astype(int)
        texts = [f"{label}: {mean[k] / size:+.4f} {unit} at {x[k] / size:.1f} {unit}" for k in rows]
        panel.dots(x[rows] / size, mean[rows] / size, colour, 2.5, titles=texts)
    return drawing


def _pose_dots(panel: Panel, q: FloatArray, values: FloatArray, direction: FloatArray | None) -> None:
    rows = np.arange(len(q)) if len(q) <= MOST_DOTS else np.random.default_rng(0).permutation(len(q))[:MOST_DOTS]
    q, values = q[rows], values[rows]
    if direction is None:
        panel.dots(q, values, "soft", 2.4, opacity=0.6)
        return
    for sign, colour in ((0.0, "soft"), (1.0, "below"), (-1.0, "above")):
        of_side = direction[rows] == sign
        if of_side.any():
            panel.dots(q[of_side], values[of_side], colour, 2.4, opacity=0.5)


def _binned(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Middle of each range of x, smallest, largest and mean y there."""
    edges = np.linspace(0, len(x), BINS + 1).astype(int)
    low, high = np.minimum.reduceat(y, edges[:-1]), np.maximum.reduceat(y, edges[:-1])
    mean = np.add.reduceat(y, edges[:-1]) / np.diff(edges)
    return np.add.reduceat(x, edges[:-1]) / np.diff(edges), low, high, mean


def figures(calibration: Record, facts: ReportFacts) -> dict[str, list[Chart]]:
    """All figures of a report.

    Returns
    -------
    dict of str to list of Chart
        By section of the page.
    """
    first = facts.sets[0]
    out: dict[str, list[Chart]] = {
        "verdict": [before_and_after(first)],
        "poses": [],
        "space": [],
        "families": [],
        "joints": [],
        "joint-map": [],
        "identification": [],
    }
    turned = [poses for poses in facts.sets if all(m.rotation is not None for m in poses.models.values())]
    for draw, sets in ((errors_by_pose, facts.sets), (turns_by_pose, turned), (distribution, facts.sets)):
        out["poses"] += [draw(poses) for poses in sets]
    if first.positions is not None:
        out["space"] = [workspace(first), vectors(first)]
    if facts.joints is not None:
        out["joints"] = [residuals_by_joint(facts.joints)]
    evidence_of = calibration.evidence
    if evidence_of is not None and evidence_of.explained:
        out["families"] = [explained(calibration)]
    if evidence_of is not None and evidence_of.spectrum is not None:
        out["joint-map"].append(gear_spectrum(evidence_of.spectrum, evidence_of.gears))
    carried = corrections(calibration, facts)
    if carried is not None:
        out["joint-map"].insert(0, carried)
    if calibration.observability.singular_values_mm:
        out["identification"].append(singular_values(calibration.observability))
    if tells(calibration.history):
        out["identification"].append(course(calibration.history))
    return out


# --- identification ---------------------------------------------------------------------------------------


def singular_values(observability: Observability) -> Chart:
    """Seen directions, and held ones at the edge of the drawing where they are far smaller."""
    caption = "Singular values of the scaled Jacobian: how far all points move together for a plausible error"
    values = np.array(observability.singular_values_mm)
    identified = np.arange(len(values)) < observability.determined
    floor = values[identified].min() / 10 if identified.any() else 1.0
    drawn = np.maximum(values, floor)
    drawing = Drawing(caption, 230.0)
    ends = (0.5 * drawn.min(), 2.0 * drawn.max())
    panel = Panel(drawing, (0.2, len(values) + 0.8), ends, "direction", "singular value (mm)", log=True, whole_x=True)
    number = np.arange(1, len(values) + 1)
    legend: list[LegendEntry] = []
    kinds: tuple[tuple[BoolArray, str, MarkerShape, str], ...] = (
        (identified, "ink", "o", "determined"),
        (~identified, "accent", "v", f"held (below {floor:.2g} mm drawn there)"),
    )
    for mask, colour, mark, label in kinds:
        if mask.any():
            texts = [f"direction {k}: {v:.3g} mm" for k, v in zip(number[mask], values[mask], strict=True)]
            panel.dots(number[mask], drawn[mask], colour, 5.5, shape=mark, titles=texts)
            legend.append((colour, mark, label))
    return Chart("singular_values", caption, [drawing], legend)


WORSE = 1.02
"""Ratio of an error at the end to its smallest from which the course of an identification says something."""


def tells(history: Mapping[str, Sequence[float]]) -> bool:
    """Whether poses that took no part got worse again: else the course says only that the search ended."""
    unused = [np.array(values) for name, values in history.items() if name.endswith("_mean_mm")]
    return any(len(values) > 2 and values[-1] > WORSE * values.min() for values in unused)


class Plots(PoseErrorPlots):
    """The figures of a calibration: those of pose errors show the held-out poses, `fitted` the others."""

    def __init__(self, record: Record) -> None:
        self._record, self._simulated = record, record.simulated

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self._record!r}>"

    @cached_property
    def _facts(self) -> report_facts.ReportFacts:
        return report_facts.gather(self._record)

    @cached_property
    def _poses(self) -> PoseErrors:  # type: ignore[override]
        return self._facts.sets[0]

    @property
    def fitted(self) -> PoseErrorPlots:
        """Figures of the fitted poses."""
        return PoseErrorPlots(self._facts.sets[-1], self._simulated)

    def residuals_by_joint(self) -> Chart:
        """Residual of each joint against its angle, by the direction from which it came."""
        if self._facts.joints is None:
            raise OptionError(self._facts.joints_note)
        return residuals_by_joint(self._facts.joints).marked(self._simulated)

    def singular_values(self) -> Chart:
        """What the poses can show of the error parameters; model auto has none."""
        if not self._record.observability.singular_values_mm:
            raise OptionError(f"model {self._record.model} has no singular values: explained() shows what its terms do")
        return singular_values(self._record.observability).marked(self._simulated)

    def explained(self) -> Chart:
        """What each family of terms explains, of model auto."""
        section = self._record.evidence
        if section is None or not section.explained:
            raise OptionError("only model auto, saved by this version, knows what each family of terms explains")
        return explained(self._record).marked(self._simulated)

    def gear_spectrum(self) -> Chart:
        """What the gear scan of model auto saw, and found."""
        section = self._record.evidence
        if section is None or section.spectrum is None:
            raise OptionError("no gear scan was made: only model auto makes one, where no long series of harmonics do")
        return gear_spectrum(section.spectrum, section.gears).marked(self._simulated)

    def corrections(self) -> Chart:
        """What the joint map adds to each joint, over its range and from both sides."""
        figure = corrections(self._record, self._facts)
        if figure is None:
            raise OptionError("there is no joint map, or this calibration was saved without the measured places")
        return figure.marked(self._simulated)
