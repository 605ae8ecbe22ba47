"""Figures of the calibration report (after Nubiola 2011, Figures 7.2 and 7.4 to 7.7), drawn from `Evidence`.

A model has one colour in all of them. Names from the data stand in texts and titles of marks, where they are escaped.
"""

from itertools import pairwise

import numpy as np

from irbcal.figures.charts import Drawing, Figure, Lines, Panel, Text, fixed, up_to
from irbcal.units import DEG, MM

MOST_TITLED = 1500
"""Marks of one drawing that say what they are; of more only the largest errors do."""

MOST_ARROWS = 300
ARROW = 0.1
"""Length of a large error's arrow as a share of the drawn space."""

BINS = 40
CLASSES = 5


def figures(calibration, evidence):
    """All figures of a report.

    Parameters
    ----------
    calibration : Record
    evidence : irbcal.reports.evidence.Evidence

    Returns
    -------
    dict of str to list of Figure
        By section of the page.
    """
    first = evidence.sets[0]
    out = {"verdict": [before_and_after(first)], "poses": [], "space": [], "joints": [], "identification": []}
    turned = [poses for poses in evidence.sets if all(m.rotation is not None for m in poses.models.values())]
    for draw, sets in ((errors_by_pose, evidence.sets), (turns_by_pose, turned), (distribution, evidence.sets)):
        out["poses"] += [draw(poses) for poses in sets]
    if first.place is not None:
        out["space"] = [workspace(first), vectors(first)]
    if evidence.approach is not None:
        out["joints"] = [residuals_by_joint(evidence)]
    if calibration.observability.singular_values_mm:
        out["identification"].append(singular_values(calibration.observability))
    if len(calibration.history.get("iteration", ())) > 1:
        out["identification"].append(course(calibration.history))
    return out


def _models_legend(poses, mark="o"):
    return [
        (name, mark, f"{name} (mean {fixed(model.statistics.mean_mm, 3)} mm)") for name, model in poses.models.items()
    ]


def _file(poses):
    return poses.name.replace("-", "")


# --- verdict ----------------------------------------------------------------------------------------------


def before_and_after(poses):
    """Mean, its interval and the largest error of both models, one above the other."""
    largest = up_to(max(model.statistics.max_mm for model in poses.models.values()))
    caption = f"Position errors on the {poses.name} poses: bar to the mean, line to the largest"
    bounded = any(model.intervals for model in poses.models.values())
    if bounded:
        caption += ", bracket: 95 % interval of the mean"
    drawing = Drawing(caption, 50.0 + 52.0 * len(poses.models))
    panel = Panel(drawing, (0, largest), (0, len(poses.models)), "position error (mm)", "", plain=True)
    for k, (name, model) in enumerate(reversed(poses.models.items())):
        s, y = model.statistics, k + 0.36
        said = f"{name}: mean {fixed(s.mean_mm, 3)} mm, largest {fixed(s.max_mm, 3)} mm"
        place = panel.at(0, k + 0.83)[0]
        drawing.add(Text(place[0] + 4, place[1], said, bold=True))
        panel.line([s.mean_mm, s.max_mm], [y, y], name, 2.0)
        panel.line([s.max_mm, s.max_mm], [y - 0.14, y + 0.14], name, 2.0)
        panel.boxes([0], [y - 0.19], [s.mean_mm], [y + 0.19], name, titles=[said])
        if model.intervals:
            low, high = model.intervals["mean_mm"]
            panel.line([low, low, high, high], [y + 0.1, y, y, y + 0.1], "ink", 1.2)
            panel.line([low, low, high, high], [y - 0.1, y, y, y - 0.1], "ink", 1.2)
    return Figure("before_and_after", caption, [drawing], columns=1)


# --- errors pose by pose ----------------------------------------------------------------------------------


def _titled(values, most=MOST_TITLED):
    """Which marks say what they are: all, or where there are too many those with the largest values."""
    if len(values) <= most:
        return np.ones(len(values), dtype=bool)
    return values >= np.sort(values)[-most // 10]


def _dots(panel, x, y, colour, texts, titled, **style):
    """Marks, some of them with titles."""
    if not titled.all():
        panel.dots(x[~titled], y[~titled], colour, **style)
    if titled.any():
        panel.dots(x[titled], y[titled], colour, titles=[texts[k] for k in np.flatnonzero(titled)], **style)


def _mark_size(n):
    return min(6.0, max(2.6, 90 / n**0.5))


def errors_by_pose(poses):
    """A panel for each model, one above the other, so that neither hides the other."""
    caption = f"Position error of each {poses.name} pose (mean of its points) in order of measurement"
    return Figure(f"errors_by_pose_{_file(poses)}", caption, [_by_pose(poses, caption)], _models_legend(poses))


def _by_pose(poses, caption):
    n = len(poses.pose_names)
    drawing = Drawing(caption, 150.0 + 100.0 * (len(poses.models) - 1))
    top = up_to(max(model.per_pose.max() for model in poses.models.values()) / MM, 4)
    x = np.arange(1, n + 1)
    ends = (1 - 0.02 * n - 0.5, n + 0.02 * n + 0.5)
    for k, (name, model) in enumerate(poses.models.items()):
        last = k == len(poses.models) - 1
        place = {"top": 106.0 * k, "bottom": drawing.height if last else 106.0 * k + 106.0}
        label = "pose, in order of measurement" if last else ""
        panel = Panel(drawing, ends, (0, top), label, "error (mm)", whole_x=True, **place)
        y = model.per_pose / MM
        texts = [f"pose {pose}: {name} {error:.3f} mm" for pose, error in zip(poses.pose_names, y, strict=True)]
        _dots(panel, x, y, name, texts, _titled(y), size=_mark_size(n), opacity=0.75)
    return drawing


def turns_by_pose(poses):
    """Orientation errors in order of measurement."""
    caption = f"Orientation error of each {poses.name} target frame in order of measurement"
    drawing = Drawing(caption, 150.0 + 100.0 * (len(poses.models) - 1))
    top = up_to(max(np.nanmax(model.rotation) for model in poses.models.values()) / DEG, 4)
    legend = []
    for k, (name, model) in enumerate(poses.models.items()):
        have = np.flatnonzero(np.isfinite(model.rotation))
        n, y = len(have), model.rotation[have] / DEG
        last = k == len(poses.models) - 1
        place = {"top": 106.0 * k, "bottom": drawing.height if last else 106.0 * k + 106.0}
        label = "measured frame, in order of measurement" if last else ""
        panel = Panel(
            drawing, (0.5 - 0.02 * n, n + 0.5 + 0.02 * n), (0, top), label, "error (deg)", whole_x=True, **place
        )
        texts = [
            f"pose {poses.pose_names[poses.pose[m]]}, {poses.target[m]}: {name} {error:.4f} degrees"
            for m, error in zip(have, y, strict=True)
        ]
        _dots(panel, np.arange(1, n + 1), y, name, texts, _titled(y), size=_mark_size(n), opacity=0.75)
        legend.append((name, "o", name))
    return Figure(f"orientation_{_file(poses)}", caption, [drawing], legend)


def distribution(poses):
    """Histogram, and ordered errors against normal quantiles."""
    caption = (
        f"Distribution of the position errors of the {poses.name} points: histogram (dashed: mean), and ordered errors "
        "against quantiles of the normal distribution (line: normal with the same mean and sigma)"
    )
    drawings = [_histogram(poses), _quantiles(poses)]
    return Figure(f"distribution_{_file(poses)}", caption, drawings, _models_legend(poses))


def _histogram(poses):
    largest = up_to(max(model.distance.max() for model in poses.models.values()) / MM)
    edges = np.linspace(0.0, largest, BINS + 1)
    counts = {name: np.histogram(model.distance / MM, edges)[0] for name, model in poses.models.items()}
    drawing = Drawing(f"Histogram of the position errors of the {poses.name} points")
    top = up_to(max(count.max() for count in counts.values()))
    panel = Panel(drawing, (0, largest), (0, top), "position error (mm)", "points", whole_y=True)
    for name, count in counts.items():
        some = count > 0
        low = np.zeros(some.sum())
        panel.boxes(edges[:-1][some], low, edges[1:][some], count[some], name, opacity=0.3)
        outline = np.repeat(np.concatenate([[0], count, [0]]), 2)[1:-1]
        panel.line(np.repeat(edges, 2), outline, name, 1.2)
        mean = poses.models[name].statistics.mean_mm
        panel.line([mean, mean], [0, top], name, dash="5 3")
    texts = [
        f"{a:.3g} to {b:.3g} mm: " + ", ".join(f"{name} {count[k]}" for name, count in counts.items()) + " points"
        for k, (a, b) in enumerate(pairwise(edges))
    ]
    panel.boxes(edges[:-1], np.zeros(BINS), edges[1:], np.full(BINS, top), "none", titles=texts)
    return drawing


def _quantiles(poses):
    from irbcal.reports.evidence import normal_quantiles

    found = {name: normal_quantiles(model.distance) for name, model in poses.models.items()}
    top = up_to(max(value.max() for _, value in found.values()) / MM)
    reach = max(1.0, 1.08 * max(np.abs(quantile).max() for quantile, _ in found.values()))
    drawing = Drawing(f"Ordered position errors of the {poses.name} points against normal quantiles")
    panel = Panel(drawing, (-reach, reach), (0, top), "normal quantile (σ)", "position error (mm)")
    for name, (quantile, value) in found.items():
        s = poses.models[name].statistics
        z = np.array([-reach, reach])
        if s.sigma_mm > 0:
            z = np.clip(z, -s.mean_mm / s.sigma_mm, (top - s.mean_mm) / s.sigma_mm)
        panel.line(z, s.mean_mm + s.sigma_mm * z, name, 1.0, dash="5 3")
        texts = [f"{name}: {v:.3f} mm at {q:+.2f} σ" for q, v in zip(quantile, value / MM, strict=True)]
        panel.dots(quantile, value / MM, name, 3.6, titles=texts)
    return drawing


# --- errors in space --------------------------------------------------------------------------------------

VIEWS = (("from above", 0, 1, "x (mm)", "y (mm)"), ("from the side", 0, 2, "x (mm)", "z (mm)"))


def _space(poses):
    """Ends of each view around the measured places and the base."""
    place = np.vstack([poses.mean_place() / MM, np.zeros(3)])
    low, high = place.min(axis=0), place.max(axis=0)
    margin = 0.06 * max((high - low).max(), 1.0)
    return low - margin, high + margin


def _view(label, model, view, ends):
    what, i, j, x_label, y_label = view
    low, high = ends
    wide, tall = high[i] - low[i], high[j] - low[j]
    drawing = Drawing(f"{label}, {model}, {what}", float(np.clip(330.0 * tall / wide, 190.0, 420.0)) + 70.0)
    panel = Panel(drawing, (low[i], high[i]), (low[j], high[j]), x_label, y_label, title=f"{model}, {what}", equal=True)
    panel.line([-0.02 * wide, 0.02 * wide], [0, 0], "soft", 1.4)
    panel.line([0, 0], [-0.02 * wide, 0.02 * wide], "soft", 1.4)
    return panel


def workspace(poses):
    """Mean error of each pose where it was measured."""
    label = f"Position errors of the {poses.name} poses over the workspace"
    edges, words = _classes(np.concatenate([model.per_pose for model in poses.models.values()]) / MM)
    place, ends = poses.mean_place() / MM, _space(poses)
    drawings = []
    for view in VIEWS:
        for name, model in poses.models.items():
            panel = _view(label, name, view, ends)
            error = model.per_pose / MM
            which = np.digitize(error, edges)
            texts = [f"pose {pose}: {name} {e:.3f} mm" for pose, e in zip(poses.pose_names, error, strict=True)]
            titled = _titled(error, MOST_TITLED // 3)
            for k in range(CLASSES):
                mine = which == k
                x, y = place[mine, view[1]], place[mine, view[2]]
                said = [texts[m] for m in np.flatnonzero(mine)]
                _dots(panel, x, y, f"error{k}", said, titled[mine], size=_mark_size(len(error)) * (0.9 + 0.12 * k))
            drawings.append(panel.drawing)
    legend = [(f"error{k}", "o", text) for k, text in enumerate(words)]
    caption = (
        f"{label}, seen along z and along y of the base link (cross: its origin); each colour has the same share of "
        "all errors shown"
    )
    return Figure("workspace", caption, drawings, legend, len(poses.models))


def _classes(errors):
    """Inner edges of `CLASSES` classes with about as many errors each, to two digits, and the classes in words."""
    edges = np.quantile(errors, np.arange(1, CLASSES) / CLASSES)
    text = [f"{edge:.2g}" for edge in edges]
    edges = np.array([float(edge) for edge in text])
    between = [f"{a} to {b} mm" for a, b in pairwise(text)]
    return edges, [f"below {text[0]} mm", *between, f"{text[-1]} mm and more"]


def vectors(poses):
    """Error vectors, much enlarged, from the measured places."""
    n = len(poses.pose_names)
    shown = np.unique(np.linspace(0, n - 1, min(n, MOST_ARROWS)).astype(int))
    error = {name: model.mean_vector(poses.pose) / MM for name, model in poses.models.items()}
    low, high = ends = _space(poses)
    size = max(np.quantile(np.linalg.norm(e, axis=1), 0.95) for e in error.values())
    factor = _round(ARROW * float((high - low)[:2].max()) / max(size, 1e-9))
    label = f"Error vectors of the {poses.name} poses, {factor:g} times enlarged"
    place = poses.mean_place() / MM
    drawings = []
    for view in VIEWS:
        _, i, j, *_ = view
        for name, e in error.items():
            panel = _view(label, name, view, ends)
            start, way = place[shown][:, [i, j]], factor * e[shown][:, [i, j]]
            tip = panel.at(*(start + way).T)
            foot = panel.at(*start.T)
            paths = [path for a, b in zip(foot, tip, strict=True) for path in _arrow(a, b)]
            panel.drawing.add(Lines(paths, name, 1.1, opacity=0.85))
            texts = [
                f"pose {poses.pose_names[m]}: {name} ({e[m, 0]:+.3f}, {e[m, 1]:+.3f}, {e[m, 2]:+.3f}) mm" for m in shown
            ]
            panel.dots(*start.T, name, 2.6, titles=texts)
            drawings.append(panel.drawing)
    caption = f"{label}: mean of measured minus predicted places of a pose's points, along the axes of the base link"
    if len(shown) < n:
        caption += f"; {len(shown)} of {n} poses, evenly chosen"
    legend = [(name, "-", name) for name in error]
    return Figure("residual_vectors", caption, drawings, legend, len(poses.models))


def _arrow(foot, tip):
    """Shaft and head of an arrow."""
    way = tip - foot
    length = float(np.hypot(*way))
    if length < 1.0:
        return [np.array([foot, tip])]
    back = way / length * min(4.0, 0.5 * length)
    side = 0.5 * np.array([-back[1], back[0]])
    return [np.array([foot, tip]), np.array([tip - back + side, tip, tip - back - side])]


def _round(value):
    """Largest of 1, 2, 5 times a power of ten that is not above a value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(k for k in (1.0, 2.0, 5.0) if k * power <= value * (1 + 1e-12)) * power)


# --- joints -----------------------------------------------------------------------------------------------

SIDES = ((1.0, "below", "^", "reached from below"), (-1.0, "above", "v", "reached from above"))


def residuals_by_joint(evidence):
    """A panel for each joint: single poses faint, means of bins with 95 % intervals strong."""
    found = evidence.approach
    slides = found.robot.arm.table.prismatic
    drawings = []
    for j in range(found.angle.shape[1]):
        if not np.isfinite(found.angle[:, j]).any():
            continue
        unit, size = ("mm", MM) if slides[j] else ("deg", DEG)
        drawings.append(_one_joint(found, j, unit, size))
    caption = (
        f"Angular residual of each joint against its angle, by the direction it came from ({evidence.approach_name} "
        "poses): faint dots are poses (those beyond the frame at its edge), marks the means of ranges of the angle "
        "with 95 % intervals; backlash keeps the two apart by the same distance everywhere"
    )
    return Figure("residuals_by_joint", caption, drawings, [(c, m, words) for _, c, m, words in SIDES], 3)


def _one_joint(found, j, unit, size):
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


def singular_values(observability):
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
    legend = []
    for mask, colour, mark, words in (
        (seen, "ink", "o", "seen"),
        (~seen, "accent", "v", f"held (below {floor:.2g} mm drawn there)"),
    ):
        if mask.any():
            texts = [f"direction {k}: {v:.3g} mm" for k, v in zip(place[mask], values[mask], strict=True)]
            panel.dots(place[mask], shown[mask], colour, 5.5, shape=mark, titles=texts)
            legend.append((colour, mark, words))
    return Figure("singular_values", caption, [drawing], legend)


def course(history):
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
    legend = [("ink", "-", "objective"), ("accent", "-", "unused, mean"), ("accent", "--", "unused, largest")]
    return Figure("course", caption, [drawing], legend if unused else legend[:1])
