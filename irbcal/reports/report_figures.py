"""Figures of the calibration report, drawn from `Evidence`; those of pose errors are in `irbcal.plotting.pose_errors`.

A model has one colour in all of them. Names from the data stand in texts and titles of marks, where they are escaped.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from irbcal.arrays import BoolArray
from irbcal.io.schema import Observability, Record
from irbcal.joint_analysis.residuals import Approach
from irbcal.plotting.charts import Chart, Drawing, LegendEntry, Panel, Shape, Text
from irbcal.plotting.pose_errors import (
    before_and_after,
    distribution,
    errors_by_pose,
    turns_by_pose,
    vectors,
    workspace,
)
from irbcal.reports.evidence import Evidence
from irbcal.reports.model_figures import corrections, explained, gear_spectrum
from irbcal.units import DEG, MM


def figures(calibration: Record, evidence: Evidence) -> dict[str, list[Chart]]:
    """All figures of a report.

    Parameters
    ----------
    calibration : Record
    evidence : irbcal.reports.evidence.Evidence

    Returns
    -------
    dict of str to list of Chart
        By section of the page.
    """
    first = evidence.sets[0]
    out: dict[str, list[Chart]] = {
        "verdict": [before_and_after(first)],
        "poses": [],
        "space": [],
        "families": [],
        "joints": [],
        "joint-map": [],
        "identification": [],
    }
    turned = [poses for poses in evidence.sets if all(m.rotation is not None for m in poses.models.values())]
    for draw, sets in ((errors_by_pose, evidence.sets), (turns_by_pose, turned), (distribution, evidence.sets)):
        out["poses"] += [draw(poses) for poses in sets]
    if first.place is not None:
        out["space"] = [workspace(first), vectors(first)]
    if evidence.approach is not None:
        out["joints"] = [residuals_by_joint(evidence)]
    known = calibration.evidence
    if known is not None and known.explained:
        out["families"] = [explained(calibration)]
    if known is not None and known.spectrum is not None:
        out["joint-map"].append(gear_spectrum(known.spectrum, known.gears))
    carried = corrections(calibration, evidence)
    if carried is not None:
        out["joint-map"].insert(0, carried)
    if calibration.observability.singular_values_mm:
        out["identification"].append(singular_values(calibration.observability))
    if tells(calibration.history):
        out["identification"].append(course(calibration.history))
    return out


# --- joints -----------------------------------------------------------------------------------------------

SIDES: tuple[tuple[float, str, Shape, str], ...] = (
    (1.0, "below", "^", "reached from below"),
    (-1.0, "above", "v", "reached from above"),
)


def residuals_by_joint(evidence: Evidence) -> Chart:
    """A panel for each joint: single poses faint, means of bins with 95 % intervals strong."""
    found = evidence.approach
    assert found is not None
    slides = found.robot.arm.table.prismatic
    drawings, bare = [], []
    for j in range(found.angle.shape[1]):
        if not np.isfinite(found.angle[:, j]).any():
            continue
        unit, size = ("mm", MM) if slides[j] else ("deg", DEG)
        drawings.append(_one_joint(found, j, unit, size))
        if not all(len(found.by_angle(j, sign)) for sign, *_ in SIDES):
            bare.append(str(j + 1))
    caption = (
        f"Angular residual of each joint against its angle, by the direction it came from ({evidence.approach_name} "
        "poses): faint dots are poses (those beyond the frame at its edge), marks the means of ranges of the angle "
        "with 95 % intervals; backlash keeps the two apart by the same distance everywhere"
    )
    if bare:
        joints = f"joint{'s' if len(bare) > 1 else ''} {', '.join(bare)}"
        caption += f". At {joints}, {found.points.poses} poses are too few for means of both directions"
    return Chart("residuals_by_joint", caption, drawings, [(c, m, words) for _, c, m, words in SIDES], 3)


def _one_joint(found: Approach, j: int, unit: str, size: float) -> Drawing:
    q, angle = found.points.q[:, j] / size, found.angle[:, j] / size
    have = np.isfinite(angle)
    means = {sign: found.by_angle(j, sign) / size for sign, *_ in SIDES}
    tall = [np.abs(rows[:, 1]) + rows[:, 2] for rows in means.values()]
    top = 1.15 * max(np.concatenate([*tall, [np.quantile(np.abs(angle[have]), 0.8)]]).max(), 1e-9)
    margin = 0.04 * max(np.ptp(q[have]), 1e-6)
    drawing = Drawing(f"Residual of joint {j + 1} by angle and direction", 220.0, 300.0)
    panel = Panel(
        drawing,
        (q[have].min() - margin, q[have].max() + margin),
        (-top, top),
        f"joint {j + 1} ({unit})",
        f"residual ({unit})",
    )
    panel.level(0.0)
    few = have.sum() < 100
    for sign, colour, *_ in SIDES:
        here = have & (found.direction[:, j] == sign)
        panel.dots(q[here], np.clip(angle[here], -top, top), colour, 4.0 if few else 1.8, opacity=0.7 if few else 0.35)
    for sign, colour, mark, words in SIDES:
        x, y, half = means[sign].T
        panel.line(x, y, colour, 1.2)
        for a, b, h in zip(x, y, half, strict=True):
            panel.line([a, a], [b - h, b + h], colour, 1.2)
        texts = [f"{words}: {b:+.4f} ± {h:.4f} {unit} near {a:.1f} {unit}" for a, b, h in zip(x, y, half, strict=True)]
        panel.dots(x, y, colour, 6.0, shape=mark, titles=texts)
    return drawing


# --- identification ---------------------------------------------------------------------------------------


def singular_values(observability: Observability) -> Chart:
    """Seen directions, and held ones at the edge of the drawing where they are far smaller."""
    caption = "Singular values of the scaled Jacobian: how far all points move together for a plausible error"
    values = np.array(observability.singular_values_mm)
    seen = np.arange(len(values)) < observability.seen
    floor = values[seen].min() / 10 if seen.any() else 1.0
    shown = np.maximum(values, floor)
    drawing = Drawing(caption, 230.0)
    ends = (0.5 * shown.min(), 2.0 * shown.max())
    panel = Panel(drawing, (0.2, len(values) + 0.8), ends, "direction", "singular value (mm)", log=True, whole_x=True)
    place = np.arange(1, len(values) + 1)
    legend: list[LegendEntry] = []
    kinds: tuple[tuple[BoolArray, str, Shape, str], ...] = (
        (seen, "ink", "o", "seen"),
        (~seen, "accent", "v", f"held (below {floor:.2g} mm drawn there)"),
    )
    for mask, colour, mark, words in kinds:
        if mask.any():
            texts = [f"direction {k}: {v:.3g} mm" for k, v in zip(place[mask], values[mask], strict=True)]
            panel.dots(place[mask], shown[mask], colour, 5.5, shape=mark, titles=texts)
            legend.append((colour, mark, words))
    return Chart("singular_values", caption, [drawing], legend)


WORSE = 1.02
"""Ratio of an error at the end to its smallest from which the course of an identification says something."""


def tells(history: Mapping[str, Sequence[float]]) -> bool:
    """Whether poses that took no part got worse again: else the course says only that the search ended."""
    unused = [np.array(values) for name, values in history.items() if name.endswith("_mean_mm")]
    return any(len(values) > 2 and values[-1] > WORSE * values.min() for values in unused)


def course(history: Mapping[str, Sequence[float]]) -> Chart:
    """Objective and errors of poses that took no part, by iteration."""
    caption = "Course of the identification: objective"
    unused = [name.removesuffix("_mean_mm") for name in history if name.endswith("_mean_mm")]
    if unused:
        caption += ", and mean and largest error of poses that took no part"
    if len(unused) > 1:
        caption += f" ({', '.join(f'{k}: {name}' for k, name in enumerate(unused, 1))})"
    iteration = np.array(history["iteration"])
    rows = [("objective", "ink", "", np.array(history["objective_mm"]))]
    for k, name in enumerate(unused, 1):
        number = f" {k}" if len(unused) > 1 else ""
        rows.append((f"unused{number}, mean", "accent", "", np.array(history[f"{name}_mean_mm"])))
        rows.append((f"unused{number}, largest", "accent", "5 3", np.array(history[f"{name}_max_mm"])))
    tiny = 1e-9
    every = np.maximum(np.concatenate([values for *_, values in rows]), tiny)
    drawing = Drawing(caption, 230.0)
    ends = (iteration.min() - 0.3, iteration.max() + 0.3 + 0.03 * len(unused) * np.ptp(iteration))
    panel = Panel(
        drawing, ends, (0.8 * every.min(), 1.25 * every.max()), "iteration", "error (mm)", log=True, whole_x=True
    )
    for words, colour, dash, values in rows:
        values = np.maximum(values, tiny)
        panel.line(iteration, values, colour, 1.4, dash=dash)
        texts = [f"{words}, iteration {i:g}: {v:.4g} mm" for i, v in zip(iteration, values, strict=True)]
        if len(unused) > 1 and colour == "accent" and not dash:
            end = panel.at(iteration[-1], values[-1])[0]
            number = words.split()[1].rstrip(",")
            drawing.add(Text(end[0] + 9 * int(number) - 5, end[1], number, colour="accent", size=10.0))
        panel.dots(iteration, values, colour, 4.0, titles=texts if len(texts) < 200 else None)
    legend: list[LegendEntry] = [
        ("ink", "-", "objective"),
        ("accent", "-", "unused, mean"),
        ("accent", "--", "unused, largest"),
    ]
    return Chart("course", caption, [drawing], legend if unused else legend[:1])
