"""Figures of position and orientation errors of poses (after Nubiola 2011, Figures 7.2, 7.4, 7.5, 7.6 and 7.7).

A model has one colour in all of them. Names from the data stand in texts and titles of marks, where they are escaped.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from irbcal.arrays import BoolArray, FloatArray
from irbcal.distributions import normal_quantile
from irbcal.errors import OptionError
from irbcal.modeling.arm import Arm
from irbcal.modeling.commanded_joints import line_at_home
from irbcal.plotting.charts import Chart, Drawing, LegendEntry, Lines, Panel, Sign, Text, fixed, round_number, up_to
from irbcal.plotting.pose_sets import PoseErrors
from irbcal.units import DEG, MM

MOST_TITLED = 1500
"""Marks of one drawing that say what they are; of more only the largest errors do."""

MOST_ARROWS = 300
ARROW = 0.1
"""Length of a large error's arrow as a share of the drawn space."""

HEADROOM = 1.07
"""How much higher than the highest mark a panel is at least: marks do not touch its edge."""

BINS = 40
CLASSES = 5
ROUND = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0)
"""Numbers of a decade that stand between classes of errors."""

QUANTILES = 200
"""Ordered errors that a normal quantile plot shows at most, the largest `TAIL` always."""

TAIL = 20

MOST_STEPS = 100
"""Iterations of a course that have marks: of more the line alone is left."""


def normal_quantiles(distance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Ordered values against the quantiles of the normal distribution (Blom's places), thinned but for the ends.

    Parameters
    ----------
    distance : ndarray, shape (m,)

    Returns
    -------
    quantile, value : ndarray, shape (k,)
    """
    value = np.sort(distance)
    n = len(value)
    rank = np.arange(n)
    step = max(1, -(-n // QUANTILES))
    drawn = (rank % step == 0) | (rank >= n - TAIL)
    return normal_quantile((rank[drawn] + 0.625) / (n + 0.25)), value[drawn]


def _models_legend(poses: PoseErrors, mark: Sign = "o") -> list[LegendEntry]:
    return [
        (name, mark, f"{name} (mean {fixed(model.statistics.mean_mm, 3)} mm)") for name, model in poses.models.items()
    ]


def _file(poses: PoseErrors) -> str:
    return poses.name.replace("-", "")


def before_and_after(poses: PoseErrors) -> Chart:
    """Mean, its interval and the largest error of both models, one above the other."""
    largest = up_to(max(model.statistics.max_mm for model in poses.models.values()))
    caption = f"{poses.plural.capitalize()} on the {poses.name} poses: bar to the mean, line to the largest"
    bounded = any(model.intervals for model in poses.models.values())
    if bounded:
        caption += ", bracket: 95 % interval of the mean"
    drawing = Drawing(caption, 50.0 + 52.0 * len(poses.models))
    panel = Panel(drawing, (0, largest), (0, len(poses.models)), f"{poses.error_name} (mm)", "", plain=True)
    for k, (name, model) in enumerate(reversed(list(poses.models.items()))):
        s, y = model.statistics, k + 0.36
        said = f"{name}: mean {fixed(s.mean_mm, 3)} mm, largest {fixed(s.max_mm, 3)} mm"
        at = panel.at(0, k + 0.83)[0]
        drawing.add(Text(at[0] + 4, at[1], said, bold=True))
        panel.line([s.mean_mm, s.max_mm], [y, y], name, 2.0)
        panel.line([s.max_mm, s.max_mm], [y - 0.14, y + 0.14], name, 2.0)
        panel.boxes([0], [y - 0.19], [s.mean_mm], [y + 0.19], name, titles=[said])
        if model.intervals:
            low, high = model.intervals["mean_mm"]
            panel.line([low, low, high, high], [y + 0.1, y, y, y + 0.1], "ink", 1.2)
            panel.line([low, low, high, high], [y - 0.1, y, y, y - 0.1], "ink", 1.2)
    return Chart("before_and_after", caption, [drawing], columns=1)


def _titled(values: FloatArray, limit: int = MOST_TITLED) -> BoolArray:
    """Which marks say what they are: all, or where there are too many those with the largest values."""
    if len(values) <= limit:
        return np.ones(len(values), dtype=bool)
    return values >= np.sort(values)[-limit // 10]


def _dots(
    panel: Panel, x: FloatArray, y: FloatArray, colour: str, texts: Sequence[str], titled: BoolArray, **style: Any
) -> None:
    """Marks, some of them with titles."""
    if not titled.all():
        panel.dots(x[~titled], y[~titled], colour, **style)
    if titled.any():
        panel.dots(x[titled], y[titled], colour, titles=[texts[k] for k in np.flatnonzero(titled).tolist()], **style)


def _mark_size(n: int) -> float:
    return min(6.0, max(2.6, 90 / n**0.5))


def errors_by_pose(poses: PoseErrors, tolerance_mm: float | None = None) -> Chart:
    """A panel for each model, one above the other, so that neither hides the other; a tolerance as a dashed line."""
    caption = f"{poses.error_name.capitalize()} of each {poses.name} pose (mean of its points) in order of measurement"
    legend = _models_legend(poses)
    if tolerance_mm is not None:
        caption += "; dashed: the tolerance"
        legend.append(("ink", "--", f"tolerance {tolerance_mm:g} mm"))
    return Chart(f"errors_by_pose_{_file(poses)}", caption, [_by_pose(poses, caption, tolerance_mm)], legend)


def _by_pose(poses: PoseErrors, caption: str, tolerance_mm: float | None) -> Drawing:
    n = len(poses.pose_names)
    drawing = Drawing(caption, 150.0 + 100.0 * (len(poses.models) - 1))
    largest = max(model.per_pose.max() for model in poses.models.values()) / MM
    top = up_to(HEADROOM * max(largest, tolerance_mm or 0.0), 4)
    x = np.arange(1.0, n + 1)
    ends = (1 - 0.02 * n - 0.5, n + 0.02 * n + 0.5)
    for k, (name, model) in enumerate(poses.models.items()):
        last = k == len(poses.models) - 1
        height: dict[str, Any] = {"top": 106.0 * k, "bottom": drawing.height if last else 106.0 * k + 106.0}
        label = "pose, in order of measurement" if last else ""
        panel = Panel(drawing, ends, (0, top), label, poses.axis, whole_x=True, **height)
        y = model.per_pose / MM
        texts = [f"pose {pose}: {name} {error:.3f} mm" for pose, error in zip(poses.pose_names, y, strict=True)]
        _dots(panel, x, y, name, texts, _titled(y), size=_mark_size(n), opacity=0.75)
        if tolerance_mm is not None:
            panel.level(tolerance_mm, "ink", dash="5 3")
    return drawing


def turns_by_pose(poses: PoseErrors) -> Chart:
    """Orientation errors in order of measurement."""
    caption = f"Orientation error of each {poses.name} target frame in order of measurement"
    drawing = Drawing(caption, 150.0 + 100.0 * (len(poses.models) - 1))
    turned = {name: model.rotation for name, model in poses.models.items() if model.rotation is not None}
    top = up_to(HEADROOM * max(np.nanmax(rotation) for rotation in turned.values()) / DEG, 4)
    legend: list[LegendEntry] = []
    for k, (name, rotation) in enumerate(turned.items()):
        have = np.flatnonzero(np.isfinite(rotation))
        n, y = len(have), rotation[have] / DEG
        last = k == len(poses.models) - 1
        height: dict[str, Any] = {"top": 106.0 * k, "bottom": drawing.height if last else 106.0 * k + 106.0}
        label = "measured frame, in order of measurement" if last else ""
        panel = Panel(
            drawing, (0.5 - 0.02 * n, n + 0.5 + 0.02 * n), (0, top), label, "error (deg)", whole_x=True, **height
        )
        texts = [
            f"pose {poses.pose_names[int(poses.pose[m])]}, {poses.target[int(m)]}: {name} {error:.4f} degrees"
            for m, error in zip(have, y, strict=True)
        ]
        _dots(panel, np.arange(1.0, n + 1), y, name, texts, _titled(y), size=_mark_size(n), opacity=0.75)
        legend.append((name, "o", name))
    return Chart(f"orientation_{_file(poses)}", caption, [drawing], legend)


def distribution(poses: PoseErrors) -> Chart:
    """Histogram, and ordered errors against normal quantiles."""
    caption = (
        f"Distribution of the {poses.plural} of the {poses.name} {poses.each}: histogram (dashed: mean), and ordered "
        "errors against quantiles of the normal distribution (line: normal with the same mean and sigma)"
    )
    drawings = [_histogram(poses), _quantiles(poses)]
    return Chart(f"distribution_{_file(poses)}", caption, drawings, _models_legend(poses))


def _histogram(poses: PoseErrors) -> Drawing:
    largest = up_to(max(model.distance.max() for model in poses.models.values()) / MM)
    edges = np.linspace(0.0, largest, BINS + 1)
    counts = {name: np.histogram(model.distance / MM, edges)[0] for name, model in poses.models.items()}
    drawing = Drawing(f"Histogram of the {poses.plural} of the {poses.name} {poses.each}")
    top = up_to(HEADROOM * max(count.max() for count in counts.values()))
    panel = Panel(drawing, (0, largest), (0, top), f"{poses.error_name} (mm)", poses.each, whole_y=True)
    for name, count in counts.items():
        filled = count > 0
        low = np.zeros(filled.sum())
        panel.boxes(edges[:-1][filled], low, edges[1:][filled], count[filled], name, opacity=0.3)
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


def _quantiles(poses: PoseErrors) -> Drawing:
    quantiles = {name: normal_quantiles(model.distance) for name, model in poses.models.items()}
    top = up_to(HEADROOM * max(value.max() for _, value in quantiles.values()) / MM)
    reach = max(1.0, 1.08 * max(np.abs(quantile).max() for quantile, _ in quantiles.values()))
    drawing = Drawing(f"Ordered {poses.plural} of the {poses.name} {poses.each} against normal quantiles")
    panel = Panel(drawing, (-reach, reach), (0, top), "normal quantile (σ)", f"{poses.error_name} (mm)")
    for name, (quantile, value) in quantiles.items():
        s = poses.models[name].statistics
        z = np.array([-reach, reach])
        if s.sigma_mm is not None:
            if s.sigma_mm > 0:
                z = np.clip(z, -s.mean_mm / s.sigma_mm, (top - s.mean_mm) / s.sigma_mm)
            panel.line(z, s.mean_mm + s.sigma_mm * z, name, 1.0, dash="5 3")
        texts = [f"{name}: {v:.3f} mm at {q:+.2f} σ" for q, v in zip(quantile, value / MM, strict=True)]
        panel.dots(quantile, value / MM, name, 3.6, titles=texts)
    return drawing


ACROSS, TALLEST, LOWEST, FRAME = 330.0, 340.0, 150.0, 64.0
"""Space of a view in its drawing: for x, for the taller of the views, at least, and for title and labels."""
VIEWS = (("from above", 0, 1, "x (mm)", "y (mm)"), ("from the side", 0, 2, "x (mm)", "z (mm)"))


def _space(poses: PoseErrors) -> tuple[FloatArray, FloatArray]:
    """Ends of each view around the measured places, the base and the arm."""
    xyz = np.vstack([poses.mean_place() / MM, np.zeros(3), *([] if poses.arm is None else [poses.arm / MM])])
    low, high = xyz.min(axis=0), xyz.max(axis=0)
    margin = 0.06 * max((high - low).max(), 1.0)
    return low - margin, high + margin


def _view(poses: PoseErrors, label: str, model: str, view: tuple[str, int, int, str, str]) -> Panel:
    """Axes of a view around measured places."""
    return _with_arm(f"{label}, {model}, {view[0]}", f"{model}, {view[0]}", view, _space(poses), poses.arm)


def _with_arm(
    label: str,
    title: str,
    view: tuple[str, int, int, str, str],
    ends: tuple[FloatArray, FloatArray],
    arm: FloatArray | None,
) -> Panel:
    """Axes of a view between the ends of all views (mm), which have one scale, with the base's origin and the arm."""
    _, i, j, x_label, y_label = view
    low, high = ends
    wide = high[0] - low[0]
    scale = max(wide / ACROSS, (high - low)[1:].max() / TALLEST)
    height = max((high - low)[j] / scale, LOWEST)
    middle = (low + high)[j] / 2
    y = middle - scale * height / 2, middle + scale * height / 2
    drawing = Drawing(label, float(height) + FRAME)
    panel = Panel(drawing, (low[i], high[i]), y, x_label, y_label, title=title, equal=True)
    panel.line([-0.02 * wide, 0.02 * wide], [0, 0], "soft", 1.4)
    panel.line([0, 0], [-0.02 * wide, 0.02 * wide], "soft", 1.4)
    if arm is not None:
        panel.line(arm[:, i] / MM, arm[:, j] / MM, "soft", 7.0, opacity=0.25)
        panel.dots(arm[2:-1:2, i] / MM, arm[2:-1:2, j] / MM, "soft", 8.0, opacity=0.35)
    return panel


def arm_at_home(arm: Arm) -> Chart:
    """An arm at home from above and from the side: its joints, and how large it is."""
    skeleton = line_at_home(arm)
    low, high = skeleton.min(axis=0) / MM, skeleton.max(axis=0) / MM
    margin = 0.25 * (high - low).max()
    drawings = []
    for view in VIEWS:
        _, i, j, *_ = view
        panel = _with_arm(f"{arm.name}, {view[0]}", view[0], view, (low - margin, high + margin), None)
        panel.line(skeleton[:, i] / MM, skeleton[:, j] / MM, "calibrated", 10.0, opacity=0.6)
        panel.dots(skeleton[2:-1:2, i] / MM, skeleton[2:-1:2, j] / MM, "ink", 12.0)
        drawings.append(panel.drawing)
    return Chart("arm", f"{arm.name} at home", drawings, [])


def workspace(poses: PoseErrors, tolerance_mm: float | None = None) -> Chart:
    """Mean error of each pose where it was measured; its colour is a share of the tolerance, where there is one."""
    label = f"Position errors of the {poses.name} poses over the workspace"
    if tolerance_mm is None:
        edges, class_names = _classes(np.concatenate([model.per_pose for model in poses.models.values()]) / MM)
        colours = "each colour has about the same share of all errors shown"
    else:
        edges, class_names = _in_words([f"{tolerance_mm * k / (CLASSES - 1):.4g}" for k in range(1, CLASSES)])
        colours = "each colour is a quarter of the tolerance and the last is beyond it"
    xyz = poses.mean_place() / MM
    drawings = []
    for view in VIEWS:
        for name, model in poses.models.items():
            panel = _view(poses, label, name, view)
            error = model.per_pose / MM
            which = np.digitize(error, edges)
            texts = [f"pose {pose}: {name} {e:.3f} mm" for pose, e in zip(poses.pose_names, error, strict=True)]
            titled = _titled(error, MOST_TITLED // 3)
            for k in range(CLASSES):
                rows = which == k
                x, y = xyz[rows, view[1]], xyz[rows, view[2]]
                said = [texts[m] for m in np.flatnonzero(rows)]
                _dots(panel, x, y, f"error{k}", said, titled[rows], size=_mark_size(len(error)) * (0.9 + 0.12 * k))
            drawings.append(panel.drawing)
    legend: list[LegendEntry] = [(f"error{k}", "o", text) for k, text in enumerate(class_names)]
    caption = f"{label}, seen along z and along y of the base link (cross: its origin, grey: the arm at home); "
    caption += colours
    return Chart("workspace", caption, drawings, legend, len(poses.models))


def _classes(errors: FloatArray) -> tuple[FloatArray, list[str]]:
    """Inner edges of `CLASSES` classes at round numbers, with about as many errors each, and the classes in words."""
    quantiles = np.maximum(np.quantile(errors, np.arange(1, CLASSES) / CLASSES), 1e-6)
    first, last = np.floor(np.log10(quantiles[0])) - 1, np.ceil(np.log10(quantiles[-1])) + 1
    round_values = np.array([k * 10.0**power for power in np.arange(first, last + 1) for k in ROUND])
    chosen: list[int] = []
    for value in quantiles:
        nearest = int(np.argmin(np.abs(np.log(round_values / value))))
        chosen.append(max(nearest, chosen[-1] + 1) if chosen else nearest)
    return _in_words([f"{round_values[k]:.10g}" for k in chosen])


def _in_words(text: Sequence[str]) -> tuple[FloatArray, list[str]]:
    """Inner edges of classes as numbers, and the classes in words."""
    edges = np.array([float(edge) for edge in text])
    between = [f"{a} to {b} mm" for a, b in pairwise(text)]
    return edges, [f"below {text[0]} mm", *between, f"{text[-1]} mm and more"]


def vectors(poses: PoseErrors) -> Chart:
    """Error vectors, much enlarged, from the measured places."""
    n = len(poses.pose_names)
    rows = np.unique(np.linspace(0, n - 1, min(n, MOST_ARROWS)).astype(int))
    error = {name: model.mean_vector(poses.pose) / MM for name, model in poses.models.items()}
    low, high = _space(poses)
    size = max(np.quantile(np.linalg.norm(e, axis=1), 0.95) for e in error.values())
    factor = round_number(ARROW * float((high - low)[:2].max()) / max(size, 1e-9))
    label = f"Error vectors of the {poses.name} poses, {factor:g} times enlarged"
    xyz = poses.mean_place() / MM
    drawings = []
    for view in VIEWS:
        _, i, j, *_ = view
        for name, e in error.items():
            panel = _view(poses, label, name, view)
            start, arrow = xyz[rows][:, [i, j]], factor * e[rows][:, [i, j]]
            tip = panel.at(*(start + arrow).T)
            foot = panel.at(*start.T)
            paths = [path for a, b in zip(foot, tip, strict=True) for path in _arrow(a, b)]
            panel.drawing.add(Lines(paths, name, 1.1, opacity=0.85))
            texts = [
                f"pose {poses.pose_names[m]}: {name} ({e[m, 0]:+.3f}, {e[m, 1]:+.3f}, {e[m, 2]:+.3f}) mm" for m in rows
            ]
            panel.dots(start[:, 0], start[:, 1], name, 2.6, titles=texts)
            drawings.append(panel.drawing)
    caption = f"{label}: mean of measured minus predicted places of a pose's points, along the axes of the base link"
    if len(rows) < n:
        caption += f"; {len(rows)} of {n} poses, evenly chosen"
    legend: list[LegendEntry] = [(name, "-", name) for name in error]
    return Chart("residual_vectors", caption, drawings, legend, len(poses.models))


def _arrow(foot: FloatArray, tip: FloatArray) -> list[FloatArray]:
    """Shaft and head of an arrow."""
    arrow = tip - foot
    length = float(np.hypot(*arrow))
    if length < 1.0:
        return [np.array([foot, tip])]
    barb = arrow / length * min(4.0, 0.5 * length)
    side = 0.5 * np.array([-barb[1], barb[0]])
    return [np.array([foot, tip]), np.array([tip - barb + side, tip, tip - barb - side])]


def course(history: Mapping[str, Sequence[float]]) -> Chart:
    """Objective and errors of poses that took no part, by iteration (Nubiola 2011, Figure 7.2)."""
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
    for label, colour, dash, values in rows:
        values = np.maximum(values, tiny)
        panel.line(iteration, values, colour, 1.4, dash=dash)
        if len(unused) > 1 and colour == "accent":
            end = panel.at(iteration[-1], values[-1])[0]
            number = label.split()[1].rstrip(",")
            drawing.add(Text(end[0] + 9 * int(number) - 5, end[1], number, colour="accent", size=10.0))
        if len(values) < MOST_STEPS:
            texts = [f"{label}, iteration {i:g}: {v:.4g} mm" for i, v in zip(iteration, values, strict=True)]
            panel.dots(iteration, values, colour, 4.0, titles=texts)
    legend: list[LegendEntry] = [
        ("ink", "-", "objective"),
        ("accent", "-", "unused, mean"),
        ("accent", "--", "unused, largest"),
    ]
    return Chart("course", caption, [drawing], legend if unused else legend[:1])


@dataclass(frozen=True)
class WorstPose:
    """A pose with a large error, and its worst point."""

    pose: str
    group: str
    target: str
    """Names; the target is that of the worst point."""
    joints: tuple[float, ...]
    """In degrees and mm; empty where they are not known."""
    error_mm: float
    nominal_mm: float
    """Of the worst point, by the judged and by the nominal robot."""
    vector_mm: tuple[float, ...] | None
    """Three numbers: measured minus predicted along the axes of the base link."""


def worst_poses(poses: PoseErrors, joints: FloatArray | None = None, count: int = 10) -> list[WorstPose]:
    """The poses with the largest errors of single points, the worst first.

    Parameters
    ----------
    poses : PoseErrors
        Judged is the last of its models: the calibrated one where there is one.
    joints : ndarray, shape (n, joints), optional
        Of the poses, degrees and mm.
    count : int
    """
    model, nominal = list(poses.models.values())[-1], poses.models["nominal"]
    order = np.argsort(-model.distance, kind="stable")
    first = order[np.sort(np.unique(poses.pose[order], return_index=True)[1])][:count]
    return [
        WorstPose(
            poses.pose_names[pose],
            poses.groups[pose],
            poses.target[row],
            () if joints is None else tuple(joints[pose].tolist()),
            float(model.distance[row] / MM),
            float(nominal.distance[row] / MM),
            None if model.vector is None else tuple((model.vector[row] / MM).tolist()),
        )
        for row, pose in ((int(row), int(poses.pose[row])) for row in first)
    ]


class PoseErrorPlots:
    """Figures of pose errors; each shows itself in a notebook and has ``save(path)`` for PNG and SVG."""

    _poses: PoseErrors
    _simulated: bool

    def __init__(self, poses: PoseErrors, simulated: bool) -> None:
        self._poses, self._simulated = poses, simulated

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of {self._poses!r}>"

    def before_and_after(self) -> Chart:
        """Mean error, its interval where it is known, and the largest error of both models."""
        return before_and_after(self._poses).marked(self._simulated)

    def errors_by_pose(self) -> Chart:
        """Mean error of each pose in order of measurement."""
        return errors_by_pose(self._poses).marked(self._simulated)

    def distribution(self) -> Chart:
        """Histogram of the errors, and errors against normal quantiles."""
        return distribution(self._poses).marked(self._simulated)

    def workspace(self) -> Chart:
        """Mean error of each pose where it was measured."""
        return self._at_places(workspace)

    def vectors(self) -> Chart:
        """Error vectors, enlarged, where they were measured."""
        return self._at_places(vectors)

    def orientation(self) -> Chart:
        """Orientation error of each pose, where orientations were measured."""
        if any(model.rotation is None for model in self._poses.models.values()):
            raise OptionError("no orientations were measured")
        return turns_by_pose(self._poses).marked(self._simulated)

    def _at_places(self, draw: Callable[[PoseErrors], Chart]) -> Chart:
        if self._poses.positions is None:
            raise OptionError("this calibration was saved without the measured places")
        return draw(self._poses).marked(self._simulated)
