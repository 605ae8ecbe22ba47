"""Charts of the behaviour of each joint.

Nubiola 2011, Figures 4.3, 4.5, 4.8, 4.9, 4.10, 5.2, 5.5 and 5.6. Nothing is computed here that is not in the result
beyond what a drawing needs (bins, smooth curves). One thing has one colour and marker everywhere: reached from below,
reached from above, with the term, without it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from irbcal.errors import OptionError
from irbcal.joint_analysis.series import equivalent_error, predicted_series
from irbcal.joint_analysis.terms import fourier_columns, fourier_order
from irbcal.plotting.charts import Chart, Drawing, LegendEntry, Panel, Shape, span
from irbcal.units import DEG, MM

if TYPE_CHECKING:
    from irbcal.arrays import FloatArray
    from irbcal.joint_analysis.behaviour import JointBehaviour
    from irbcal.joint_analysis.moves import JointMoves
    from irbcal.joint_analysis.residuals import ResidualAnalysis
    from irbcal.joint_analysis.series import Series

DIRECTIONS: tuple[tuple[float, str, Shape, str], ...] = (
    (1.0, "below", "^", "reached from below"),
    (-1.0, "above", "v", "reached from above"),
    (0.0, "unknown", "o", "direction not known"),
)
BINS = 10
MOST_TARGETS = 4
DASHES = ("", "5 3", "1.5 3", "6 3 1.5 3")
THESIS_ELBOW = (30.0, 0.0, -30.0, -60.0, -90.0)
"""Angles of joint 3 in Nubiola 2011, Table 4.4, degrees."""
WIDE, SMALL = 480.0, 300.0
"""Widths of drawings one above the other and side by side."""


def draw(result: JointBehaviour) -> dict[str, bytes]:
    """All charts that a result allows, as PNG files by name."""
    return {f"{name}.png": drawing().content("png") for name, drawing in drawings(result).items()}


def drawn(result: JointBehaviour, name: str) -> Chart:
    """One chart by its name.

    Raises
    ------
    OptionError
        If these measurements do not allow a chart of that name.
    """
    every = drawings(result)
    if name not in every:
        raise OptionError.unknown("figure", name, tuple(every))
    return every[name]()


def drawings(result: JointBehaviour) -> dict[str, Callable[[], Chart]]:
    """What draws each chart that a result allows, by name."""
    out: dict[str, Callable[[], Chart]] = {}
    for joint in result.moves:
        for name, series in _named_series(joint):
            out[f"errors_{_file(name)}"] = partial(_errors, series, f"Joint {joint.joint} moved alone ({name})")
        if joint.fourier.tested:
            out[f"fourier_joint_{joint.joint}"] = partial(_fourier, joint)
    if result.moves:
        out["angular_errors"] = partial(_angular, result.moves)
    if any(joint.joint == 2 for joint in result.moves) or _stiffness(result) is not None:
        out["stiffness_joint_2"] = partial(_equivalent, result)
    residuals = result.residuals
    if residuals is not None and _shown_joints(residuals):
        out["residuals_by_direction"] = partial(_by_direction, residuals)
        if any(term.tested for term in residuals.of("move").values()):
            out["residuals_by_move"] = partial(_by_move, residuals)
        out["backlash"] = partial(_backlash, residuals)
    return {name: partial(_marked, chart, result.simulated) for name, chart in out.items()}


def _marked(draw: Callable[[], Chart], simulated: bool) -> Chart:
    return draw().marked(simulated)


def _named_series(joint: JointMoves) -> Iterator[tuple[str, Series]]:
    """Series with names of their own: the group, numbered where it has several home poses."""
    groups = [s.name for s in joint.series]
    count: dict[str, int] = {}
    for s in joint.series:
        count[s.name] = count.get(s.name, 0) + 1
        yield (f"{s.name} {count[s.name]}" if groups.count(s.name) > 1 else s.name), s


def _file(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9.-]+", "_", name)[:60]


def _directions(directions: FloatArray | Sequence[float]) -> list[LegendEntry]:
    """Entries of a legend for the directions that occur."""
    return [(c, m, label) for sign, c, m, label in DIRECTIONS if (np.asarray(directions) == sign).any()]


def _by_side(panel: Panel, x: FloatArray, y: FloatArray, direction: FloatArray, **style: Any) -> None:
    """Marks of the directions that points were reached from."""
    for sign, colour, mark, _ in DIRECTIONS:
        rows = (direction == sign) & np.isfinite(y)
        panel.dots(x[rows], y[rows], colour, **{"size": 4.5, "shape": mark, **style})


def _errors(series: Series, title: str) -> Chart:
    """Radial, tangential and axial errors against the joint's angle, a line for each target.

    Nubiola 2011, Figures 4.3, 4.8 and 4.9; the latter two, of section 4.3.1, are the stretched arm of Figure 4.6 with
    two payloads: one series for each.
    """
    points = series.points
    targets = np.unique(points.target)
    drawn_targets = targets[np.argsort([-series.radius[points.target == t][0] for t in targets])][:MOST_TARGETS]
    turn, direction = series.turn[points.pose] / DEG, series.direction[points.pose]
    sheets: list[Drawing] = []
    for name in ("radial", "tangential", "axial"):
        values = getattr(series, name) / MM
        drawing = Drawing(f"{name} errors", 190.0, WIDE)
        panel = Panel(drawing, span(turn), span(values, [0.0]), f"joint {series.joint} (deg)", f"{name} error (mm)")
        panel.level(0.0)
        for k, target in enumerate(drawn_targets):
            for sign, colour, *_ in DIRECTIONS:
                rows = np.flatnonzero((points.target == target) & (direction == sign))
                rows = rows[np.argsort(turn[rows], kind="stable")]
                panel.line(turn[rows], values[rows], colour, 0.9, dash=DASHES[k])
            of_target = points.target == target
            _by_side(panel, turn[of_target], values[of_target], direction[of_target])
        sheets.append(drawing)
    legend = _directions(series.direction)
    for k, t in enumerate(drawn_targets):
        radius = series.radius[points.target == t][0] / MM
        label = f"{points.target_names[t]} (radius {radius:.0f} mm)"
        legend.append(("ink", "-" if k == 0 else "--", label))
    return Chart(f"errors_{_file(series.name)}", title, sheets, legend, 1)


def _angular(moves: Sequence[JointMoves]) -> Chart:
    """Angular errors of all joints, with both directions (Nubiola 2011, Figures 4.3 and 4.5)."""
    sheets: list[Drawing] = []
    for joint in moves:
        turn = np.concatenate([s.turn for s in joint.series]) / DEG
        angle = np.concatenate([s.angle for s in joint.series]) / DEG
        drawing = Drawing(f"Angular errors of joint {joint.joint}", 220.0, SMALL)
        panel = Panel(drawing, span(turn), span(angle, [0.0]), f"joint {joint.joint} (deg)", "angular error (deg)")
        panel.level(0.0)
        _by_side(panel, turn, angle, np.concatenate([s.direction for s in joint.series]), opacity=0.8)
        sheets.append(drawing)
    directions = np.concatenate([s.direction for joint in moves for s in joint.series])
    return Chart("angular_errors", "Angular errors of joints moved alone", sheets, _directions(directions), 3)


def _fourier(joint: JointMoves) -> Chart:
    """Angular error with its Fourier series, and what the series leaves (Nubiola 2011, Figures 4.5 and 5.2)."""
    term, play = joint.fourier, joint.play
    order, frequency = fourier_order(term), 1.0 if term.frequency is None else term.frequency[0]
    turn = np.concatenate([s.turn for s in joint.series])
    direction = np.concatenate([s.direction for s in joint.series])
    angle = np.concatenate([s.angle for s in joint.series])
    curves, residuals = [], []
    for s in joint.series:
        residual = (
            s.angle + 0.5 * play * s.direction - fourier_columns(s.turn, order, frequency) @ np.array(term.values)
        )
        shift = residual[(s.direction != 0) | (play == 0)].mean()
        residuals.append(residual - shift)
        x = np.linspace(s.turn.min(), s.turn.max(), 400)
        curves.append((x, fourier_columns(x, order, frequency) @ np.array(term.values) + shift))
    sheets: list[Drawing] = []
    for values, label, height in (
        (angle, "angular error (deg)", 230.0),
        (np.concatenate(residuals), "residual (deg)", 170.0),
    ):
        drawing = Drawing(label, height, WIDE)
        ends = span(values / DEG, [0.0], *((y / DEG for _, y in curves) if not sheets else ()))
        panel = Panel(drawing, span(turn / DEG), ends, f"joint {joint.joint} (deg)", label)
        panel.level(0.0)
        _by_side(panel, turn / DEG, values / DEG, direction)
        for x, y in curves if not sheets else ():
            panel.line(x / DEG, y / DEG, "calibrated")
        sheets.append(drawing)
    words = f"Fourier series of order {order}, frequency {frequency:.4g} per turn"
    legend = [*_directions(direction), ("calibrated", "-", words)]
    return Chart(f"fourier_joint_{joint.joint}", f"Angular error of joint {joint.joint}", sheets, legend, 1)


def _stiffness(result: JointBehaviour) -> FloatArray | None:
    """A and B as estimated from the residuals, radians; None where they were not."""
    if result.residuals is None:
        return None
    term = result.residuals.of("stiffness").get(None)
    return np.array(term.values) if term is not None and len(term.values) == 2 else None


def _equivalent(report: JointBehaviour) -> Chart:
    """The equivalent error of joint 2: measured (Nubiola 2011, Figure 4.10) and modelled (Figures 5.5 and 5.6)."""
    series = [s for joint in report.moves if joint.joint == 2 for s in joint.series]
    found, geometry = _stiffness(report), report.stiffness_geometry
    model = None if found is None or geometry is None else (found, *geometry)
    label = "equivalent error of joint 2 (deg)"
    sheets: list[Drawing] = []
    legend: dict[str, LegendEntry] = {}
    panels: list[tuple[str, list[tuple[str, str, FloatArray, FloatArray, bool]]]] = []
    if series:
        rows = []
        for k, s in enumerate(series):
            elbow = f"joint 3 at {s.q[0, 2] / DEG:.0f} deg"
            rows.append((f"error{k % 5}", elbow, s.turn, s.angle, True))
            if report.residuals is not None and found is not None and model:
                order = np.argsort(s.turn, kind="stable")
                curve = predicted_series(s, report.residuals.robot, found)
                rows.append((f"error{k % 5}", elbow, s.turn[order], curve[order], False))
        panels.append(("measured" + (", lines: model" if model else ""), rows))
    if model:
        values, phases, guess = model
        fitted = f"A = {values[0] / DEG:.4f}, B = {values[1] / DEG:.4f} deg"
        x = np.linspace(-90, 90, 181) * DEG
        for coefficients, words in (
            (values, f"model, identified: {fitted}"),
            (guess.coefficients, "model, physical guess of eqs. 5.19 to 5.22"),
        ):
            rows = []
            for k, bent in enumerate(THESIS_ELBOW):
                curve = equivalent_error(x, bent * DEG, coefficients, phases, (guess.L_1, guess.L_2))
                rows.append((f"error{k}", f"joint 3 at {bent:.0f} deg", x, curve, False))
            panels.append((words, rows))
    ends = span([0.0], *(y / DEG for _, rows in panels for *_, y, _ in rows))
    for title, rows in panels:
        drawing = Drawing(title, 260.0, SMALL + 40)
        panel = Panel(drawing, span(*(x / DEG for _, _, x, *_ in rows)), ends, "joint 2 (deg)", label, title=title)
        panel.level(0.0)
        for colour, words, x, y, dots in rows:
            legend.setdefault(words, (colour, "o" if dots else "-", words))
            if dots:
                panel.dots(x / DEG, y / DEG, colour, 4.0)
            else:
                panel.line(x / DEG, y / DEG, colour, 1.2)
        sheets.append(drawing)
    return Chart("stiffness_joint_2", "Equivalent error of joint 2", sheets, tuple(legend.values()), 3)


def _binned(x: FloatArray, y: FloatArray, edges: FloatArray) -> FloatArray:
    """Middle, mean and half-width of the 95 % interval of ``y`` in bins of ``x`` that hold five values or more."""
    which = np.digitize(x, edges[1:-1])
    out = []
    for k in range(len(edges) - 1):
        in_bin = y[which == k]
        if len(in_bin) >= 5:
            out.append((x[which == k].mean(), in_bin.mean(), 1.96 * in_bin.std(ddof=1) / np.sqrt(len(in_bin))))
    return np.array(out).reshape(-1, 3).T


def _shown_joints(analysis: ResidualAnalysis) -> list[int]:
    """Joints with a residual at a pose that they came to from a known side, counted from 0."""
    return [
        j
        for j in range(analysis.angle.shape[1])
        if (np.isfinite(analysis.angle[:, j]) & (np.abs(analysis.step[:, j]) > 0)).any()
    ]


def _bare(joints: Sequence[int], analysis: ResidualAnalysis) -> str:
    """Words for a caption about joints that have no mean of one of the directions."""
    if not joints:
        return ""
    which = f"joint{'s' if len(joints) > 1 else ''} {', '.join(str(j + 1) for j in joints)}"
    return f". At {which}, {analysis.points.poses} poses are too few for means of both directions"


def _residual_panel(
    x: FloatArray, angle: FloatArray, sides: FloatArray, edges: Sequence[FloatArray], label: str, unit: str, title: str
) -> tuple[Panel, bool]:
    """Single poses faint, means of bins with 95 % intervals strong; and whether both directions have means."""
    have = np.isfinite(angle) & np.isfinite(x)
    masks = [have & (sides == sign) for sign, *_ in DIRECTIONS[:2]]
    means = [_binned(x[mask], angle[mask], edge) for mask, edge in zip(masks, edges, strict=True)]
    sizes = [np.abs(y) + half for _, y, half in means]
    top = 1.15 * max(np.concatenate([*sizes, np.quantile(np.abs(angle[have]), [0.8])]).max(initial=0.0), 1e-6)
    drawing = Drawing(label, 240.0, SMALL)
    panel = Panel(drawing, span(x[have]), (-top, top), f"{label} ({unit})", f"residual ({unit})", title=title)
    panel.level(0.0)
    crowded = have.sum() > 200
    for (_, colour, mark, _), some, (a, b, half) in zip(DIRECTIONS[:2], masks, means, strict=True):
        inside = some & (np.abs(angle) <= top)
        panel.dots(x[inside], angle[inside], colour, 2.0 if crowded else 3.5, opacity=0.35 if crowded else 0.6)
        panel.line(a, b, colour, 1.2)
        panel.bars(a, b, half, colour)
        panel.dots(a, b, colour, 6.0, shape=mark)
    return panel, all(len(x) for x, *_ in means)


def _by_direction(analysis: ResidualAnalysis) -> Chart:
    """Angular residual against joint angle: dots are poses, bars the means of bins with 95 % intervals."""
    slides, plays = analysis.robot.arm.table.prismatic, analysis.of("backlash")
    bare: list[int] = []
    sheets: list[Drawing] = []
    for j in _shown_joints(analysis):
        size, unit = (MM, "mm") if slides[j] else (DEG, "deg")
        q, angle = analysis.points.q[:, j] / size, analysis.angle[:, j] / size
        edges = np.unique(np.quantile(q[np.isfinite(angle)], np.linspace(0, 1, BINS + 1)))
        term, title = plays.get(j + 1), ""
        if term is not None and term.tested:
            half = (term.high[0] - term.low[0]) / 2 / size
            title = f"backlash {term.values[0] / size:.4f} ± {half:.4f} {unit}"
        sides = np.sign(analysis.step[:, j])
        panel, has_means = _residual_panel(q, angle, sides, [edges] * 2, f"joint {j + 1}", unit, title)
        sheets.append(panel.drawing)
        bare += [] if has_means else [j]
    caption = "Angular residual of each joint by its direction of approach" + _bare(bare, analysis)
    return Chart("residuals_by_direction", caption, sheets, _directions([1.0, -1.0]), 3)


def _by_move(analysis: ResidualAnalysis) -> Chart:
    """Angular residual against the last move: play makes a step at zero, a lag a slope."""
    tested = [joint for joint, term in analysis.of("move").items() if term.tested]
    slides, plays = analysis.robot.arm.table.prismatic, analysis.of("backlash")
    bare: list[int] = []
    sheets: list[Drawing] = []
    for j in (j for j in _shown_joints(analysis) if j + 1 in tested):
        size, unit = (MM, "mm") if slides[j] else (DEG, "deg")
        move, angle = analysis.step[:, j] / size, analysis.angle[:, j] / size
        have = np.isfinite(angle) & np.isfinite(move)
        shares = np.linspace(0, 1, BINS // 2 + 1)
        edges = [np.unique(np.quantile(move[have & (np.sign(move) == s)], shares)) for s, *_ in DIRECTIONS[:2]]
        panel, has_means = _residual_panel(move, angle, np.sign(move), edges, f"last move of joint {j + 1}", unit, "")
        term = plays.get(j + 1)
        if term is not None and term.tested:
            for sign, end in ((-1.0, move[have].min()), (1.0, move[have].max())):
                panel.line([0, end], [-0.5 * sign * term.values[0] / size] * 2, "nominal", dash="5 3")
        sheets.append(panel.drawing)
        bare += [] if has_means else [j]
    legend: list[LegendEntry] = [*_directions([1.0, -1.0]), ("nominal", "--", "what backlash alone would give")]
    caption = "Angular residual of each joint by the size of its last move" + _bare(bare, analysis)
    return Chart("residuals_by_move", caption, sheets, legend, 3)


def _backlash(analysis: ResidualAnalysis) -> Chart:
    """Backlash of each joint with its interval."""
    slides = analysis.robot.arm.table.prismatic
    terms = [term for term in analysis.of("backlash").values() if term.tested]
    numbers = [term.joint or 0 for term in terms]
    sizes = np.array([MM if slides[number - 1] else DEG for number in numbers])
    value, low, high = (
        np.array([getattr(term, name)[0] for term in terms]) / sizes for name in ("values", "low", "high")
    )
    label = "backlash (deg)" if not slides.any() else "backlash (deg; mm where it slides)"
    drawing = Drawing("Backlash of each joint", 260.0, WIDE)
    x_ticks = [float(number) for number in numbers], [str(number) for number in numbers]
    x = (min(numbers, default=1) - 0.6, max(numbers, default=1) + 0.6)
    panel = Panel(drawing, x, span(low, high, [0.0]), "joint", label, x_ticks=x_ticks)
    panel.level(0.0)
    place = np.array(numbers, dtype=float)
    panel.bars(place, (low + high) / 2, (high - low) / 2, "calibrated")
    panel.dots(place, value, "calibrated", 6.0)
    legend: list[LegendEntry] = [("calibrated", "o", "all poses, 95 % interval")]
    return Chart("backlash", "Backlash, 95 % intervals", [drawing], legend)
