"""Charts of the behaviour of each joint: one-joint moves, and residuals of any poses.

Nubiola 2011, Figures 4.3, 4.5, 4.8, 4.9, 4.10, 5.2, 5.5 and 5.6. Nothing is computed here that is not in the result
beyond what a drawing needs (bins, smooth curves). One thing has one colour and marker everywhere: reached from below,
reached from above, with the term, without it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.joint_analysis.moves import JointMoves
from irbcal.joint_analysis.residuals import ResidualAnalysis
from irbcal.joint_analysis.series import equivalent_error, predicted_series
from irbcal.joint_analysis.terms import fourier_columns, fourier_order
from irbcal.measurement.column_names import JOINTS
from irbcal.modeling.stiffness import Stiffness
from irbcal.plotting.charts import DASHES, DIRECTIONS, Chart, Drawing, LegendEntry, Panel, span
from irbcal.units import DEG, MM, joint_unit

if TYPE_CHECKING:
    from irbcal.joint_analysis.series import Series

StiffnessGeometry: TypeAlias = "tuple[Sequence[float] | FloatArray, Stiffness]"
"""Phases and physical guess of a nominal arm, see `irbcal.modeling.arm.Arm.stiffness_geometry`."""

SIDES = DIRECTIONS[:2]
BINS = 10
LINES = tuple(DASHES)
"""Of the targets in one chart."""
THESIS_ELBOW = (30.0, 0.0, -30.0, -60.0, -90.0)
"""Angles of joint 3 in Nubiola 2011, Table 4.4, degrees."""
WIDE, SMALL = 480.0, 300.0
"""Widths of drawings one above the other and side by side."""


def drawings(
    moves: Sequence[JointMoves],
    residuals: ResidualAnalysis | None,
    stiffness_geometry: StiffnessGeometry | None,
    simulated: bool,
) -> dict[str, Callable[[], Chart]]:
    """What draws each chart that the parts of a `irbcal.joint_analysis.behaviour.JointBehaviour` allow, by name."""
    out: dict[str, Callable[[], Chart]] = {}
    for joint in moves:
        for name, series in _named_series(joint):
            out[f"errors_{_file(name)}"] = partial(_errors, series, f"Joint {joint.joint} moved alone ({name})")
        if joint.fourier.tested:
            out[f"fourier_joint_{joint.joint}"] = partial(_fourier, joint)
    if moves:
        out["angular_errors"] = partial(_angular, moves)
    if _bending_is_shown(moves, residuals, stiffness_geometry):
        out["stiffness_joint_2"] = partial(_equivalent, moves, residuals, stiffness_geometry)
    if residuals is not None and _shown_joints(residuals):
        out["residuals_by_joint"] = partial(residuals_by_joint, residuals)
        if any(term.tested for term in residuals.by_joint("move").values()):
            out["residuals_by_move"] = partial(_by_move, residuals)
        out["backlash"] = partial(_backlash, residuals)
    return {name: partial(_marked, chart, simulated) for name, chart in out.items()}


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
    drawn_targets = targets[np.argsort([-series.radius[points.target == t][0] for t in targets])][: len(LINES)]
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
                panel.line(turn[rows], values[rows], colour, 0.9, dash=DASHES[LINES[k]])
            of_target = points.target == target
            _by_side(panel, turn[of_target], values[of_target], direction[of_target])
        sheets.append(drawing)
    legend = _directions(series.direction)
    for k, t in enumerate(drawn_targets):
        radius = series.radius[points.target == t][0] / MM
        label = f"{points.target_names[t]} (radius {radius:.0f} mm)"
        legend.append(("ink", LINES[k], label))
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


def _stiffness(residuals: ResidualAnalysis | None) -> FloatArray | None:
    """A and B as estimated from the residuals, radians; None where they were not."""
    if residuals is None:
        return None
    term = residuals.by_joint("stiffness").get(None)
    return np.array(term.values) if term is not None and len(term.values) == 2 else None


def _bending_is_shown(
    moves: Sequence[JointMoves], residuals: ResidualAnalysis | None, geometry: StiffnessGeometry | None
) -> bool:
    """Whether joints 2 and 3 lift the arm, as far as is known, and moves of joint 2 or A and B show how it bends."""
    columns = [joint.series[0].columns for joint in moves if joint.joint == 2]
    if residuals is None:
        return tuple(JOINTS) in columns
    return geometry is not None and (bool(columns) or _stiffness(residuals) is not None)


def _equivalent(
    moves: Sequence[JointMoves], residuals: ResidualAnalysis | None, geometry: StiffnessGeometry | None
) -> Chart:
    """The equivalent error of joint 2: measured (Nubiola 2011, Figure 4.10) and modelled (Figures 5.5 and 5.6)."""
    series = [s for joint in moves if joint.joint == 2 for s in joint.series]
    estimated = _stiffness(residuals)
    model = None if estimated is None or geometry is None else (estimated, *geometry)
    label = "equivalent error of joint 2 (deg)"
    sheets: list[Drawing] = []
    legend: dict[str, LegendEntry] = {}
    panels: list[tuple[str, list[tuple[str, str, FloatArray, FloatArray, bool]]]] = []
    if series:
        rows = []
        for k, s in enumerate(series):
            elbow = f"joint 3 at {s.q[0, 2] / DEG:.0f} deg"
            rows.append((f"error{k % 5}", elbow, s.turn, s.angle, True))
            if residuals is not None and model:
                order = np.argsort(s.turn, kind="stable")
                curve = predicted_series(s, residuals.robot, model[0])
                rows.append((f"error{k % 5}", elbow, s.turn[order], curve[order], False))
        panels.append(("measured" + (", lines: model" if model else ""), rows))
    if model:
        values, phases, guess = model
        fitted = f"A = {values[0] / DEG:.4f}, B = {values[1] / DEG:.4f} deg"
        x = np.linspace(-90, 90, 181) * DEG
        for coefficients, curve_label in (
            (values, f"model, identified: {fitted}"),
            (guess.coefficients, "model, physical guess of eqs. 5.19 to 5.22"),
        ):
            rows = []
            for k, bent in enumerate(THESIS_ELBOW):
                curve = equivalent_error(x, bent * DEG, coefficients, phases, (guess.L_1, guess.L_2))
                rows.append((f"error{k}", f"joint 3 at {bent:.0f} deg", x, curve, False))
            panels.append((curve_label, rows))
    ends = span([0.0], *(y / DEG for _, rows in panels for *_, y, _ in rows))
    for title, rows in panels:
        drawing = Drawing(title, 260.0, SMALL + 40)
        panel = Panel(drawing, span(*(x / DEG for _, _, x, *_ in rows)), ends, "joint 2 (deg)", label, title=title)
        panel.level(0.0)
        for colour, curve_label, x, y, dots in rows:
            legend.setdefault(curve_label, (colour, "o" if dots else "-", curve_label))
            if dots:
                panel.dots(x / DEG, y / DEG, colour, 4.0)
            else:
                panel.line(x / DEG, y / DEG, colour, 1.2)
        sheets.append(drawing)
    return Chart("stiffness_joint_2", "Equivalent error of joint 2", sheets, tuple(legend.values()), 3)


def _shown_joints(analysis: ResidualAnalysis) -> list[int]:
    """Joints with a residual at a pose that they came to from a known side, counted from 0."""
    return [
        j
        for j in range(analysis.angle.shape[1])
        if (np.isfinite(analysis.angle[:, j]) & (np.abs(analysis.step[:, j]) > 0)).any()
    ]


def _residual_panel(
    analysis: ResidualAnalysis, j: int, x: FloatArray, means: Sequence[FloatArray], label: str, title: str
) -> Panel:
    """Residuals of joint j (from 0) over ``x``: single poses faint, means of bins with 95 % intervals strong."""
    unit, size = joint_unit(analysis.robot.arm.table.prismatic[j])
    x, angle, rows = x / size, analysis.angle[:, j] / size, [of_side / size for of_side in means]
    have = np.isfinite(angle)
    tall = [np.abs(level) + half for _, level, half in (of_side.T for of_side in rows)]
    top = 1.15 * max(np.concatenate([*tall, [np.quantile(np.abs(angle[have]), 0.8)]]).max(), 1e-9)
    panel = Panel(Drawing(title, 220.0, SMALL), span(x[have]), (-top, top), f"{label} ({unit})", f"residual ({unit})")
    panel.level(0.0)
    sparse = have.sum() < 100
    style = {"size": 4.0 if sparse else 1.8, "opacity": 0.7 if sparse else 0.35}
    for sign, colour, *_ in SIDES:
        of_side = have & (analysis.direction[:, j] == sign)
        panel.dots(x[of_side], np.clip(angle[of_side], -top, top), colour, **style)
    for (_, colour, mark, side), (at, level, half) in zip(SIDES, (of_side.T for of_side in rows), strict=True):
        panel.line(at, level, colour, 1.2)
        panel.bars(at, level, half, colour)
        texts = [
            f"{side}: {b:+.4f} ± {h:.4f} {unit} near {a:.1f} {unit}" for a, b, h in zip(at, level, half, strict=True)
        ]
        panel.dots(at, level, colour, 6.0, shape=mark, titles=texts)
    return panel


def residuals_by_joint(analysis: ResidualAnalysis) -> Chart:
    """Angular residual of each joint against its angle."""
    bare: list[int] = []
    sheets: list[Drawing] = []
    for j in _shown_joints(analysis):
        means = [analysis.by_angle(j, sign) for sign, *_ in SIDES]
        title = f"Residual of joint {j + 1} by angle and direction"
        sheets.append(_residual_panel(analysis, j, analysis.points.q[:, j], means, f"joint {j + 1}", title).drawing)
        bare += [] if all(map(len, means)) else [j]
    caption = (
        "Angular residual of each joint against its angle, by the direction it came from: "
        "faint dots are poses (those beyond the frame at its edge), marks the means of ranges of the angle "
        "with 95 % intervals; backlash keeps the two apart by the same distance everywhere"
    )
    caption += analysis.one_sided_in_words(bare)
    return Chart("residuals_by_joint", caption, sheets, _directions([1.0, -1.0]), 3)


def _by_move(analysis: ResidualAnalysis) -> Chart:
    """Angular residual against the last move: play makes a step at zero, a lag a slope."""
    tested = [joint for joint, term in analysis.by_joint("move").items() if term.tested]
    plays = analysis.by_joint("backlash")
    bare: list[int] = []
    sheets: list[Drawing] = []
    for j in (j for j in _shown_joints(analysis) if j + 1 in tested):
        have, move, size = np.isfinite(analysis.angle[:, j]), analysis.step[:, j], analysis.robot.arm.joint_units[j]
        means = []
        for sign, *_ in SIDES:
            of_side = move[have & (np.sign(move) == sign)]
            ends = np.quantile(of_side, np.linspace(0, 1, BINS // 2 + 1)) if len(of_side) else np.zeros(1)
            means.append(analysis.means(j, sign, move, ends))
        label = f"last move of joint {j + 1}"
        panel = _residual_panel(analysis, j, move, means, label, label)
        term = plays.get(j + 1)
        if term is not None and term.tested:
            for sign, end in ((-1.0, move[have].min()), (1.0, move[have].max())):
                panel.line([0, end / size], [-0.5 * sign * term.values[0] / size] * 2, "nominal", dash="5 3")
        sheets.append(panel.drawing)
        bare += [] if all(map(len, means)) else [j]
    legend: list[LegendEntry] = [*_directions([1.0, -1.0]), ("nominal", "--", "what backlash alone would give")]
    caption = "Angular residual of each joint by the size of its last move" + analysis.one_sided_in_words(bare)
    return Chart("residuals_by_move", caption, sheets, legend, 3)


def _backlash(analysis: ResidualAnalysis) -> Chart:
    """Backlash of each joint with its interval."""
    slides = analysis.robot.arm.table.prismatic
    terms = [term for term in analysis.by_joint("backlash").values() if term.tested]
    numbers = [term.joint or 0 for term in terms]
    sizes = analysis.robot.arm.joint_units[np.array(numbers, dtype=int) - 1]
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
