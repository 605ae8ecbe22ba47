"""Figures of the behaviour of each joint.

Nubiola 2011, Figures 4.3, 4.5, 4.8, 4.9, 4.10, 5.2, 5.5 and 5.6. Nothing is computed here that is not in the result
beyond what a drawing needs (bins, smooth curves). One thing has one colour and marker everywhere: reached from below,
reached from above, with the term, without it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from irbcal.errors import OptionError
from irbcal.figures.colours import CALIBRATED, FROM_ABOVE, FROM_BELOW, NOMINAL, UNKNOWN
from irbcal.figures.style import as_bytes, house_style
from irbcal.joint_analysis.series import equivalent_error, predicted_series
from irbcal.joint_analysis.terms import JointTerm, fourier_columns, fourier_order
from irbcal.units import DEG, MM

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from irbcal.arrays import FloatArray
    from irbcal.joint_analysis.behaviour import JointBehaviour
    from irbcal.joint_analysis.moves import JointMoves
    from irbcal.joint_analysis.residuals import ResidualAnalysis
    from irbcal.joint_analysis.series import Series

LineStyle: TypeAlias = Literal["-", "--", ":", "-.", ""]

DIRECTIONS = (
    (1.0, FROM_BELOW, "^", "reached from below"),
    (-1.0, FROM_ABOVE, "v", "reached from above"),
    (0.0, UNKNOWN, "o", "direction not known"),
)
BINS = 10
MOST_TARGETS = 4
THESIS_ELBOW = (30.0, 0.0, -30.0, -60.0, -90.0)
"""Angles of joint 3 in Nubiola 2011, Table 4.4, degrees."""


def draw(found: JointBehaviour) -> dict[str, bytes]:
    """All figures that a result allows, as PNG files by name."""
    with house_style():
        return {f"{name}.png": as_bytes(drawing()) for name, drawing in drawings(found).items()}


def drawn(found: JointBehaviour, name: str) -> Figure:
    """One figure by its name.

    Raises
    ------
    OptionError
        If these measurements do not allow a figure of that name.
    """
    every = drawings(found)
    if name not in every:
        raise OptionError.unknown("figure", name, tuple(every))
    with house_style():
        return every[name]()


def drawings(found: JointBehaviour) -> dict[str, Callable[[], Figure]]:
    """What draws each figure that a result allows, by name."""
    out: dict[str, Callable[[], Figure]] = {}
    mark = "SIMULATED data: " if found.simulated else ""
    for joint in found.moves:
        for name, series in _named_series(joint):
            out[f"errors_{_file(name)}"] = partial(_errors, series, f"{mark}joint {joint.joint} moved alone ({name})")
        if joint.fourier.tested:
            out[f"fourier_joint_{joint.joint}"] = partial(
                _fourier, joint, f"{mark}angular error of joint {joint.joint}"
            )
    if found.moves:
        out["angular_errors"] = partial(_angular, found.moves, f"{mark}angular errors of joints moved alone")
    if any(joint.joint == 2 for joint in found.moves) or _stiffness(found) is not None:
        out["stiffness_joint_2"] = partial(_equivalent, found, f"{mark}equivalent error of joint 2")
    seen = found.residuals
    if seen is not None and _shown_joints(seen):
        title = f"{mark}angular residual of each joint by its direction of approach"
        out["residuals_by_direction"] = partial(_by_direction, seen, title)
        if any(term.tested for term in seen.of("move").values()):
            title = f"{mark}angular residual of each joint by the size of its last move"
            out["residuals_by_move"] = partial(_by_move, seen, title)
        out["backlash"] = partial(_backlash, seen, f"{mark}backlash, 95 % intervals")
    return out


def _named_series(joint: JointMoves) -> Iterator[tuple[str, Series]]:
    """Series with names of their own: the group, numbered where it has several home poses."""
    groups = [s.name for s in joint.series]
    count: dict[str, int] = {}
    for s in joint.series:
        count[s.name] = count.get(s.name, 0) + 1
        yield (f"{s.name} {count[s.name]}" if groups.count(s.name) > 1 else s.name), s


def _file(name: str) -> str:
    return re.sub(r"[^A-Za-z0-9.-]+", "_", name)[:60]


def _figure(width: float, height: float, title: str) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    engine: Any = figure.get_layout_engine()
    engine.set(w_pad=0.1, h_pad=0.1)
    return figure


def _legend(figure: Figure, handles: Sequence[Any], columns: int = 4) -> None:
    """A legend below everything else."""
    figure.legend(handles=handles, loc="outside lower left", ncols=columns, frameon=False, handlelength=1.6)


def _direction_handles(directions: FloatArray | Sequence[float], errorbars: bool = False) -> list[Any]:
    from matplotlib.lines import Line2D

    seen = [entry for entry in DIRECTIONS if (np.asarray(directions) == entry[0]).any()]
    line: LineStyle = "-" if errorbars else ""
    return [Line2D([], [], color=c, marker=m, linestyle=line, label=label) for _, c, m, label in seen]


def _curve_handle(colour: str, style: LineStyle, label: str) -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], color=colour, linestyle=style, label=label)


def _errors(series: Series, title: str) -> Figure:
    """Radial, tangential and axial errors against the joint's angle, a line for each target.

    Nubiola 2011, Figures 4.3, 4.8 and 4.9; the latter two, of section 4.3.1, are the stretched arm of Figure 4.6 with
    two payloads: one series for each.
    """
    figure = _figure(6.4, 6.6, title)
    panels = figure.subplots(3, 1, sharex=True)
    points = series.points
    lines: tuple[LineStyle, ...] = ("-", "--", ":", "-.")
    targets = np.unique(points.target)
    shown = targets[np.argsort([-series.radius[points.target == t][0] for t in targets])][:MOST_TARGETS]
    for axes, name in zip(panels, ("radial", "tangential", "axial"), strict=True):
        values = getattr(series, name) / MM
        for k, target in enumerate(shown):
            mine = points.target == target
            for sign, colour, marker, _ in DIRECTIONS:
                here = mine & (series.direction[points.pose] == sign)
                order = np.argsort(series.turn[points.pose[here]], kind="stable")
                x, y = series.turn[points.pose[here]][order] / DEG, values[here][order]
                axes.plot(x, y, lines[k], color=colour, marker=marker, markersize=4, linewidth=0.9)
        axes.axhline(0, color="black", linewidth=0.6)
        axes.set_ylabel(f"{name} error (mm)")
    panels[-1].set_xlabel(f"joint {series.joint} (deg)")
    handles = _direction_handles(series.direction)
    for k, t in enumerate(shown):
        radius = series.radius[points.target == t][0] / MM
        handles.append(_curve_handle("black", lines[k], f"{points.target_names[t]} (radius {radius:.0f} mm)"))
    _legend(figure, handles, 3)
    return figure


def _panels(figure: Figure, count: int, **options: Any) -> Any:
    columns = min(3, count)
    rows = -(-count // columns)
    grid = figure.subplots(rows, columns, squeeze=False, **options)
    for axes in grid.ravel()[count:]:
        axes.set_visible(False)
    return grid.ravel()[:count]


def _angular(moves: Sequence[JointMoves], title: str) -> Figure:
    """Angular errors of all joints, with both directions (Nubiola 2011, Figures 4.3 and 4.5)."""
    figure = _figure(9.6, 0.6 + 2.7 * -(-len(moves) // 3), title)
    directions = np.concatenate([s.direction for joint in moves for s in joint.series])
    for axes, joint in zip(_panels(figure, len(moves)), moves, strict=True):
        for s in joint.series:
            for sign, colour, marker, _ in DIRECTIONS:
                here = s.direction == sign
                axes.plot(s.turn[here] / DEG, s.angle[here] / DEG, marker, color=colour, markersize=3.5, alpha=0.8)
        axes.axhline(0, color="black", linewidth=0.6)
        axes.set_xlabel(f"joint {joint.joint} (deg)")
        axes.set_ylabel("angular error (deg)")
    _legend(figure, _direction_handles(directions))
    return figure


def _fourier(joint: JointMoves, title: str) -> Figure:
    """Angular error with its Fourier series, and what is left (Nubiola 2011, Figures 4.5 and 5.2)."""
    term = joint.fourier
    order, frequency = fourier_order(term), 1.0 if term.frequency is None else term.frequency[0]
    figure = _figure(6.4, 5.4, title)
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    play = joint.play
    for s in joint.series:
        curve = fourier_columns(s.turn, order, frequency) @ np.array(term.values)
        left = s.angle + 0.5 * play * s.direction - curve
        shift = left[(s.direction != 0) | (play == 0)].mean()
        left = left - shift
        for sign, colour, marker, _ in DIRECTIONS:
            here = s.direction == sign
            upper.plot(s.turn[here] / DEG, s.angle[here] / DEG, marker, color=colour, markersize=4)
            lower.plot(s.turn[here] / DEG, left[here] / DEG, marker, color=colour, markersize=4)
        x = np.linspace(s.turn.min(), s.turn.max(), 400)
        smooth = fourier_columns(x, order, frequency) @ np.array(term.values) + shift
        upper.plot(x / DEG, smooth / DEG, color=CALIBRATED, linewidth=1.4)
    for axes in (upper, lower):
        axes.axhline(0, color="black", linewidth=0.6)
    upper.set_ylabel("angular error (deg)")
    lower.set_ylabel("residual (deg)")
    lower.set_xlabel(f"joint {joint.joint} (deg)")
    directions = np.concatenate([s.direction for s in joint.series])
    label = f"Fourier series of order {order}, frequency {frequency:.4g} per turn"
    _legend(figure, [*_direction_handles(directions), _curve_handle(CALIBRATED, "-", label)], 2)
    return figure


def _stiffness(found: JointBehaviour) -> FloatArray | None:
    """A and B as estimated from the residuals, radians; None where they were not."""
    if found.residuals is None:
        return None
    term = found.residuals.of("stiffness").get(None)
    return np.array(term.shown.values) if term is not None and len(term.shown.values) == 2 else None


def _equivalent(report: JointBehaviour, title: str) -> Figure:
    """The equivalent error of joint 2: measured (Nubiola 2011, Figure 4.10) and modelled (Figures 5.5 and 5.6)."""
    import matplotlib

    series = [s for joint in report.moves if joint.joint == 2 for s in joint.series]
    found, geometry = _stiffness(report), report.stiffness_geometry
    model = None if found is None or geometry is None else (found, *geometry)
    count = (1 if series else 0) + (2 if model else 0)
    figure = _figure(max(6.4, 4.2 * count), 4.4, title)
    panels = list(_panels(figure, max(count, 1), sharey=True))
    shades = matplotlib.colormaps["viridis"](np.linspace(0.0, 0.85, max(len(series), len(THESIS_ELBOW))))
    for axes in panels:
        axes.axhline(0, color="black", linewidth=0.6)
        axes.set_xlabel("joint 2 (deg)")
        axes.tick_params(labelleft=True)
    panels[0].set_ylabel("equivalent error of joint 2 (deg)")
    if series:
        axes = panels.pop(0)
        axes.set_title("measured" + (", lines: model" if model else ""), fontsize=10, loc="left")
        for k, s in enumerate(series):
            elbow = f"joint 3 at {s.q[0, 2] / DEG:.0f} deg"
            axes.plot(s.turn / DEG, s.angle / DEG, ".", color=shades[k], markersize=5, label=elbow)
            if report.residuals is not None and found is not None and model:
                order = np.argsort(s.turn, kind="stable")
                curve = predicted_series(s, report.residuals.robot, found)
                axes.plot(s.turn[order] / DEG, curve[order] / DEG, color=shades[k], linewidth=1.2)
    if model:
        values, phases, guess = model
        fitted = f"A = {values[0] / DEG:.4f}, B = {values[1] / DEG:.4f} deg"
        for axes, coefficients, words in (
            (panels[0], values, f"model, identified: {fitted}"),
            (panels[1], guess.coefficients, "model, physical guess of eqs. 5.19 to 5.22"),
        ):
            axes.set_title(words, fontsize=10, loc="left")
            x = np.linspace(-90, 90, 181) * DEG
            for k, bent in enumerate(THESIS_ELBOW):
                curve = equivalent_error(x, bent * DEG, coefficients, phases, (guess.L_1, guess.L_2))
                axes.plot(x / DEG, curve / DEG, color=shades[k], label=f"joint 3 at {bent:.0f} deg")
    handles: dict[str, Any] = {}
    for axes in figure.axes:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    _legend(figure, list(handles.values()), 5 if count > 2 else 3)
    return figure


def _binned(x: FloatArray, y: FloatArray, edges: FloatArray) -> FloatArray:
    """Middle, mean and half-width of the 95 % interval of ``y`` in bins of ``x`` that hold five values or more."""
    which = np.digitize(x, edges[1:-1])
    out = []
    for k in range(len(edges) - 1):
        here = y[which == k]
        if len(here) >= 5:
            out.append((x[which == k].mean(), here.mean(), 1.96 * here.std(ddof=1) / np.sqrt(len(here))))
    return np.array(out).reshape(-1, 3).T


def _plays(found: ResidualAnalysis) -> dict[int | None, JointTerm]:
    return {joint: term.shown for joint, term in found.of("backlash").items()}


def _shown_joints(found: ResidualAnalysis) -> list[int]:
    """Joints with a residual at a pose that they came to from a known side, counted from 0."""
    return [
        j
        for j in range(found.angle.shape[1])
        if (np.isfinite(found.angle[:, j]) & (np.abs(found.step[:, j]) > 0)).any()
    ]


def _dot_look(have: Any) -> dict[str, float]:
    """Size and strength of dots: where there are many, they are a cloud."""
    return {"markersize": 2, "alpha": 0.35} if have.sum() > 200 else {"markersize": 4, "alpha": 0.6}


def _too_few(means: Sequence[FloatArray]) -> str:
    """Words for a panel that has no mean of one of the directions."""
    if all(len(values) for values in means):
        return ""
    return "; too few poses for means" + (" of both sides" if any(len(values) for values in means) else "")


def _limits(axes: Any, *values: FloatArray) -> None:
    """A vertical range that the means fill; single poses may lie outside."""
    size = 1.15 * max(np.abs(np.concatenate([v for v in values if len(v)])).max(initial=0.0), 1e-6)
    axes.set_ylim(-size, size)


def _by_direction(found: ResidualAnalysis, title: str) -> Figure:
    """Angular residual against joint angle: dots are poses, bars the means of bins with 95 % intervals."""
    joints = _shown_joints(found)
    figure = _figure(9.6, 0.8 + 2.9 * -(-len(joints) // 3), title)
    signs = np.sign(found.step)
    slides, plays = found.robot.arm.table.prismatic, _plays(found)
    for axes, j in zip(_panels(figure, len(joints)), joints, strict=True):
        size, unit = (MM, "mm") if slides[j] else (DEG, "deg")
        q, angle = found.points.q[:, j] / size, found.angle[:, j] / size
        have = np.isfinite(angle)
        edges = np.unique(np.quantile(q[have], np.linspace(0, 1, BINS + 1)))
        means: list[FloatArray] = []
        for sign, colour, marker, _ in DIRECTIONS[:2]:
            here = have & (signs[:, j] == sign)
            axes.plot(q[here], angle[here], ".", color=colour, **_dot_look(have))
            x, y, half = _binned(q[here], angle[here], edges)
            axes.errorbar(x, y, half, color=colour, marker=marker, markersize=5, linewidth=1.2, capsize=2)
            means += [np.abs(y) + half]
        _limits(axes, *means, np.quantile(np.abs(angle[have]), [0.8]))
        axes.axhline(0, color="black", linewidth=0.6)
        axes.set_xlabel(f"joint {j + 1} ({unit}){_too_few(means)}")
        axes.set_ylabel(f"residual ({unit})")
        term = plays.get(j + 1)
        if term is not None and term.tested:
            half = (term.high[0] - term.low[0]) / 2 / size
            axes.set_title(f"backlash {term.values[0] / size:.4f} ± {half:.4f} {unit}", fontsize=9.5, loc="left")
    handles = _direction_handles([1.0, -1.0], errorbars=True)
    _legend(figure, handles)
    return figure


def _by_move(found: ResidualAnalysis, title: str) -> Figure:
    """Angular residual against the last move: play makes a step at zero, a lag a slope."""
    tested = [joint for joint, term in found.of("move").items() if term.tested]
    joints = [j for j in _shown_joints(found) if j + 1 in tested]
    figure = _figure(9.6, 0.8 + 2.9 * -(-len(joints) // 3), title)
    slides, plays = found.robot.arm.table.prismatic, _plays(found)
    for axes, j in zip(_panels(figure, len(joints)), joints, strict=True):
        size, unit = (MM, "mm") if slides[j] else (DEG, "deg")
        move, angle = found.step[:, j] / size, found.angle[:, j] / size
        have = np.isfinite(angle) & np.isfinite(move)
        means: list[FloatArray] = []
        for sign, colour, marker, _ in DIRECTIONS[:2]:
            here = have & (np.sign(move) == sign)
            axes.plot(move[here], angle[here], ".", color=colour, **_dot_look(have))
            edges = np.unique(np.quantile(move[here], np.linspace(0, 1, BINS // 2 + 1)))
            x, y, half = _binned(move[here], angle[here], edges)
            axes.errorbar(x, y, half, color=colour, marker=marker, markersize=5, linewidth=1.2, capsize=2)
            means += [np.abs(y) + half]
        _limits(axes, *means, np.quantile(np.abs(angle[have]), [0.8]))
        term = plays.get(j + 1)
        if term is not None and term.tested:
            for sign in (-1.0, 1.0):
                end = move[have].max() if sign > 0 else move[have].min()
                axes.plot([0, end], [-0.5 * sign * term.values[0] / size] * 2, "--", color=NOMINAL, linewidth=1.4)
        axes.axhline(0, color="black", linewidth=0.6)
        axes.set_xlabel(f"last move of joint {j + 1} ({unit}){_too_few(means)}")
        axes.set_ylabel(f"residual ({unit})")
    handles = _direction_handles([1.0, -1.0], errorbars=True)
    _legend(figure, [*handles, _curve_handle(NOMINAL, "--", "what backlash alone would give")])
    return figure


def _backlash(found: ResidualAnalysis, title: str) -> Figure:
    """Backlash of each joint with its interval, and what the two halves of the poses give by themselves."""
    slides = found.robot.arm.table.prismatic
    terms = [term.shown for term in found.of("backlash").values() if term.tested]
    figure = _figure(6.4, 3.8, title)
    axes = figure.add_subplot()
    for term in terms:
        number = term.joint or 0
        size = MM if slides[number - 1] else DEG
        value, low, high = (v[0] / size for v in (term.values, term.low, term.high))
        bars = [[value - low], [high - value]]
        axes.errorbar([number], [value], bars, color=CALIBRATED, marker="o", capsize=4, linewidth=1.6)
        for k, marker in enumerate("<>"):
            x = number + (-0.2, 0.2)[k]
            axes.plot([x], [found.halves[number - 1, k] / size], marker, color=UNKNOWN, markersize=6)
    axes.axhline(0, color="black", linewidth=0.8)
    axes.set_xticks([term.joint or 0 for term in terms])
    axes.set_xlabel("joint")
    axes.set_ylabel("backlash (deg)" if not slides.any() else "backlash (deg; mm where it slides)")
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=CALIBRATED, marker="o", label="all poses, 95 % interval"),
        Line2D([], [], color=UNKNOWN, marker="<", linestyle="", label="first half"),
        Line2D([], [], color=UNKNOWN, marker=">", linestyle="", label="second half"),
    ]
    _legend(figure, handles, 3)
    return figure
