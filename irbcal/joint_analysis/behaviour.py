"""Behaviour of each joint: what it does beyond geometry (Nubiola 2011, chapter 4 and sections 5.2 and 5.3).

Two ways of looking at a joint:

- one-joint moves (`irbcal.joint_analysis.moves`): groups ``axis1``, ``axis2``, ...; several tests of one joint may
  be called ``axis6_b``, ``axis6_c``. Circles alone give the axis; radial, axial and tangential errors of every point
  and the angular error of every pose follow without a robot model;
- any poses (`irbcal.joint_analysis.residuals`): all terms of all joints fitted together with base, targets and link
  geometry, from the nominal robot.

Backlash is the joint's angle reached from above minus the angle reached from below, for one command: twice the
half-width, positive where the joint stops short of where it was sent. Intervals are 95 %: of one-joint moves from the
least-squares covariance (with that of the circles), of any poses from the posterior. Whether a joint needs a term is
answered by the log evidence with and without it (`irbcal.identification.evidence_maximisation`), less the logarithm of
the number of frequencies tried.

Nubiola 2011, Figures 4.3, 4.5, 4.8, 4.9, 4.10, 5.2, 5.5 and 5.6. Nothing is computed here that is not in the result
beyond what a drawing needs (bins, smooth curves). One thing has one colour and marker everywhere: reached from below,
reached from above, with the term, without it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeVar

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.errors import IdentificationError, MeasurementError, OptionError, RobotError
from irbcal.joint_analysis.moves import (
    JointMoves,
    analyse_moves,
    best_of,
    errors_table,
    has_moves,
    of_moves,
)
from irbcal.joint_analysis.residuals import (
    ResidualAnalysis,
    analyse_residuals,
    of_residuals,
    residual_terms_table,
)
from irbcal.joint_analysis.series import (
    PayloadEffect,
    equivalent_error,
    payload_effects,
    payload_table,
    predicted_series,
)
from irbcal.joint_analysis.terms import (
    MOVES_TITLE,
    fourier_columns,
    fourier_order,
    name_of,
    of_joints,
    term_rows,
    terms_table,
)
from irbcal.measurement import table
from irbcal.measurement.cleaning import Exclusion, left_out
from irbcal.measurement.column_names import JOINTS
from irbcal.measurement.motions import last_moves
from irbcal.measurement.points import PointSet
from irbcal.measurement.reading_lag import ReadingLag, mixed_use
from irbcal.measurement.table import MeasurementSet
from irbcal.modeling.arm import Arm
from irbcal.modeling.robot import Robot
from irbcal.modeling.stiffness import Stiffness
from irbcal.option_values import Progress
from irbcal.plotting.charts import DASHES, DIRECTIONS, Chart, Drawing, LegendEntry, Panel, span
from irbcal.summary import Paragraph, Result, Table, remarks, simulated_mark
from irbcal.units import DEG, MM, joint_unit

if TYPE_CHECKING:
    import pandas as pd

    from irbcal.io.opening import CalibrationLike
    from irbcal.joint_analysis.series import Series


def _disagreements(moves: Sequence[JointMoves], residuals: ResidualAnalysis) -> list[str]:
    """Terms that one of the two sources calls needed and the other does not."""
    tested = {(term.kind, term.joint): term.needed for term in residuals.terms if term.tested}
    best = [term for joint in moves for term in best_of(joint)]
    out = []
    for term in (term for joint in moves for term in joint.terms if term.tested):
        needed = tested.get((term.kind, term.joint))
        name = f"{name_of(term)}{of_joints([term.joint])}"
        if needed and not term.needed:
            out.append(
                f"{name}: needed by any poses, not needed by the one-joint moves: these are from one home pose, the "
                "others from all over the workspace"
            )
        elif needed is False and term in best:
            out.append(
                f"{name}: needed by the one-joint moves, not needed by any poses: it may be small beside their other "
                "errors, or hold at that home pose only"
            )
    return out


# --- tables ----------------------------------------------------------------------------------------------


def tables(result: JointBehaviour) -> list[Table]:
    """All tables of a result: errors and terms of one-joint moves, terms of residuals."""
    mark = simulated_mark(result.simulated)
    out = []
    if result.moves:
        out.append(errors_table(result.moves, f"{mark}errors of one-joint moves in {result.source}"))
        terms = [term for joint in result.moves for term in joint.terms]
        out.append(terms_table(terms, f"{mark}{MOVES_TITLE}"))
    if result.residuals is not None:
        out.append(residual_terms_table(result.residuals, mark))
    return out


HIGHEST_ORDER = 12
"""Of a Fourier series that is asked for."""

MOST_PERIODS = 1000.0
"""Frequency that nobody can ask for, periods per turn."""

T = TypeVar("T")


@dataclass(frozen=True, eq=False, repr=False)
class JointBehaviour(Result):
    """What each joint does beyond geometry, and which non-geometric terms the robot needs.

    Attributes
    ----------
    source : str
    simulated : bool
    moves : tuple of JointMoves
        Empty where there are no one-joint moves.
    residuals : ResidualAnalysis or None
        None without a robot.
    excluded : tuple of Exclusion
    notes : tuple of str
    stiffness_geometry : tuple or None
        Phases and physical guess of the nominal arm, see `irbcal.modeling.arm.Arm.stiffness_geometry`; None where the
        stiffness model is not for this arm.
    plots : tuple of str
        Files of the figures that were written.
    reading_lag : ReadingLag or None
        How joint readings differ from programmed joints; None without programmed joints.
    """

    source: str
    simulated: bool
    moves: tuple[JointMoves, ...]
    residuals: ResidualAnalysis | None
    excluded: tuple[Exclusion, ...] = ()
    notes: tuple[str, ...] = ()
    stiffness_geometry: tuple[Sequence[float] | FloatArray, Stiffness] | None = None
    plots: tuple[str, ...] = ()
    reading_lag: ReadingLag | None = None

    def verdict(self) -> list[str]:
        """Which non-geometric terms this robot needs, in sentences; the last one sums up.

        Nubiola 2011, section 7.2: an analysis of each axis tells whether a stiffness model and a model of joint 6 are
        necessary.
        """
        residuals = self.residuals
        out = of_moves(self.moves, only_moves=residuals is None)
        if residuals is None:
            return out
        sentences = of_residuals(residuals, self.stiffness_geometry)
        return [*out, *sentences[:-1], *_disagreements(self.moves, residuals), sentences[-1]]

    def payloads(self) -> tuple[PayloadEffect, ...]:
        """What payloads add, where the same joint was moved from the same pose with two (Nubiola 2011, Table 4.3)."""
        return payload_effects([series for joint in self.moves for series in joint.series])

    def report(self) -> Sequence[Paragraph]:
        """Errors and terms as tables, the verdict in sentences, what was left out, notes, files written."""
        effects = self.payloads()
        mark = simulated_mark(self.simulated)
        out: list[Paragraph] = [
            *tables(self),
            *([payload_table(effects, mark)] if effects else []),
            "± is the half-width of the 95 % interval; backlash is reached from above minus reached from below.",
            "Per move: for each 100 degrees (mm) of the last move. Gain: a ratio. Log evidence: with minus without it.",
            "Verdict",
            *(f"- {sentence}" for sentence in self.verdict()),
        ]
        out += left_out(self.excluded)
        out += [] if self.reading_lag is None else self.reading_lag.report()
        out += remarks("Note", self.notes)
        return [*out, *(f"Written to {name}" for name in self.plots)]

    def headline(self) -> str:
        """What the robot needs."""
        mark = "SIMULATED: " if self.simulated else ""
        return f"{mark}{self.verdict()[-1]}"

    CONTENT = "source simulated moves residuals payloads verdict excluded notes plots reading_lag?"

    def to_frame(self) -> pd.DataFrame:
        """A row for each coefficient of each term; of terms that were not tested a row without value.

        Returns
        -------
        DataFrame
            ``source`` (moves or residuals), ``kind``, ``joint``, ``name``, ``value``, ``low``, ``high``, ``unit`` (as
            in `to_dict`), ``log_evidence``, ``probability``, ``moves_mm``, ``verdict``, ``note``.
        """
        import pandas as pd

        sources = {"moves": term_rows([term for joint in self.moves for term in joint.terms])}
        if self.residuals is not None:
            sources["residuals"] = term_rows(self.residuals.terms)
        rows = [{"source": source, **row} for source, those in sources.items() for row in those]
        columns = ["source", "kind", "joint", "name", "value", "low", "high", "unit", "log_evidence", "probability"]
        columns += ["moves_mm", "verdict", "note"]
        return pd.DataFrame(rows, columns=columns).astype(
            {"joint": "Int64", "value": float, "low": float, "high": float}
        )

    @property
    def figures(self) -> tuple[str, ...]:
        """Names of the figures that `plot` can draw."""
        return tuple(drawings(self))

    def plot(self, figure: str) -> Chart:
        """One of the `figures`.

        Parameters
        ----------
        figure : str
            One of `figures`.

        Raises
        ------
        OptionError
            If there is no such figure of these measurements.
        """
        every = drawings(self)
        if figure not in every:
            raise OptionError.unknown("figure", figure, tuple(every))
        return every[figure]()


# --- the front door --------------------------------------------------------------------------------------


def joints(
    measurements: str | Path | pd.DataFrame | MeasurementSet,
    *,
    calibration: CalibrationLike | None = None,
    robot: str | Path | Arm | None = None,
    joint: int | None = None,
    order: int = 2,
    frequency: float | Literal["free"] = 1.0,
    plots: str | Path | None = None,
    progress: Progress | None = None,
) -> JointBehaviour:
    """Backlash, Fourier series, gains and stiffness joint by joint, and which of them this robot needs.

    One-joint moves (groups axis1, axis2, …) need no robot: their circles are enough (Nubiola 2011, chapter 4). Any
    other poses are analysed by the residuals of a calibration or of a robot that is identified from them first.

    Parameters
    ----------
    measurements : str, Path, DataFrame or MeasurementSet
        In the columns and units of a measurement file.
    calibration : str, Path or Record, optional
        A calibration (folder, or as loaded): its residuals are analysed, too.
    robot : str, Path or Arm, optional
        URDF, shipped robot's name or nominal arm, identified from these poses first. None: one-joint moves only.
    joint : int, optional
        Only this joint, counted from 1.
    order : int
        Of the Fourier series, 1 to 12.
    frequency : float or ``free``
        Of the Fourier series, periods per turn.
    plots : str or Path, optional
        Folder for figures (PNG).
    progress : callable, optional
        Called with a short text at each step.

    Returns
    -------
    JointBehaviour
        Lengths in metres, angles in radians (`JointBehaviour.to_dict` and ``to_frame``: mm and degrees).

    Raises
    ------
    OptionError
        If an option has no such value, or both a calibration and a robot are given.
    MeasurementError
        If the measurements cannot be read, or there are no one-joint moves and no robot either.
    IdentificationError
        If the measurements do not allow the analysis, or are not of this robot.
    RobotError, CalibrationError
        If robot or calibration cannot be used.
    """
    say = progress or (lambda text: None)
    periods = _checked(calibration, robot, joint, order, frequency)
    say("reading the measurements")
    measured = table.read(measurements)
    model = _model(calibration, robot)
    measured = measured if model.arm is None else measured.of_arm(model.arm)
    notes = () if model.programmed is None else mixed_use(model.programmed, measured.programmed, measured.source)
    say("analysing the joints")
    result = analyse(
        measured,
        model.robot,
        model.nominal,
        model.references,
        joint=joint,
        order=order,
        frequency=periods,
        simulated=model.simulated,
    )
    result = replace(result, notes=(*result.notes, *notes))
    if plots is None:
        return result
    from irbcal.safe_files import write_together

    say("drawing")
    files = draw(result)
    write_together(plots, files)
    return replace(result, plots=tuple(str(Path(plots) / name) for name in files))


def _checked(calibration: object, robot: object, joint: int | None, order: int, frequency: float | str) -> float | None:
    """The frequency as `analyse` takes it, if all options have values that there are."""
    if calibration is not None and robot is not None:
        raise OptionError("give a calibration or a robot, not both", parameter="robot")
    if joint is not None and joint < 1:
        raise OptionError(f"joint: expected a number from 1, found {joint}", parameter="joint")
    if not 1 <= order <= HIGHEST_ORDER:
        raise OptionError(f"order: expected 1 to {HIGHEST_ORDER}, found {order}", parameter="order")
    if frequency == "free":
        return None
    if isinstance(frequency, str) or not 0.0 < frequency < MOST_PERIODS:
        raise OptionError(
            f"frequency: expected free or a number of periods per turn above zero, found {frequency!r}",
            parameter="frequency",
        )
    return float(frequency)


class _ResidualModel(NamedTuple):
    """The robot of a calibration with what belongs to it, a nominal arm, or nothing."""

    robot: Robot | Arm | None = None
    nominal: Arm | None = None
    references: Mapping[str, FloatArray] | None = None
    simulated: bool = False
    programmed: bool | None = None

    @property
    def arm(self) -> Arm | None:
        """Whose joints were moved."""
        return self.robot if isinstance(self.robot, Arm) else self.nominal


def _model(calibration: CalibrationLike | None, robot: str | Path | Arm | None) -> _ResidualModel:
    if calibration is not None:
        from irbcal.io.opening import open_calibration

        saved = open_calibration(calibration)
        nominal, references = saved.arm(calibrated=False), saved.reference_places() or None
        return _ResidualModel(saved.robot_calibrated(), nominal, references, saved.simulated, saved.programmed)
    if robot is None:
        return _ResidualModel()
    if not isinstance(robot, Arm):
        from irbcal.io.opening import open_nominal

        robot = open_nominal(robot).arm
    return _ResidualModel(robot)


# --- from points to the whole answer ---------------------------------------------------------------------


def analyse(
    measurements: MeasurementSet,
    robot: Robot | Arm | None = None,
    nominal: Arm | None = None,
    references: Mapping[str, FloatArray] | None = None,
    *,
    joint: int | None = None,
    order: int = 2,
    frequency: float | None = 1.0,
    simulated: bool = False,
) -> JointBehaviour:
    """Both analyses of a measurement file, as far as it allows.

    Parameters
    ----------
    measurements : MeasurementSet
    robot : Robot or Arm, optional
        A robot (from a calibration) or a nominal arm. Without: circles alone.
    nominal : Arm, optional
        Nominal arm of a calibrated robot.
    references : dict of str to ndarray, optional
        Reference places of the calibration, metres.
    joint, order, frequency
        See `analyse_moves`.
    simulated : bool
        Whether the robot comes from simulated data.

    Raises
    ------
    IrbcalError
        If an input is refused.
    """
    source, options = measurements.source, (joint, order, frequency)
    points, step, excluded, notes = _cleaned(measurements, robot, references)
    moves: list[JointMoves] = []
    if has_moves(points):
        try:
            moves = _named(source, analyse_moves, points, step, *options, measurements.joint_columns)
        except IdentificationError as error:
            if robot is None:
                raise IdentificationError(
                    f"{error}; to analyse other poses than moves of one joint, give a robot or a calibration "
                    "(--robot or --calibration)"
                ) from None
            notes.append(f"The one-joint moves are not analysed by themselves: {error}")
        excluded += [_far(exclusion, "its circle") for moved in moves for s in moved.series for exclusion in s.excluded]
    elif robot is None:
        raise MeasurementError(
            "there are no one-joint moves (column group: axis1, axis2, …); for other poses a robot or a calibration is "
            "needed",
            file=source,
        )
    residuals = None
    nominal = robot.joint_map.terms.arm if nominal is None and isinstance(robot, Robot) else nominal
    nominal = robot if isinstance(robot, Arm) else nominal
    if nominal is not None:
        residuals = _named(source, analyse_residuals, nominal, points, step, *options)
        excluded += [_far(item, "the robot") for item in residuals.excluded]
    geometry = None
    if nominal is not None:
        with suppress(RobotError):
            geometry = nominal.stiffness_geometry()
    is_simulated = bool(measurements.simulated or simulated)
    lag = measurements.reading_lag()
    return JointBehaviour(
        source, is_simulated, tuple(moves), residuals, tuple(excluded), tuple(notes), geometry, reading_lag=lag
    )


def _cleaned(
    measurements: MeasurementSet, robot: Robot | Arm | None, references: Mapping[str, FloatArray] | None
) -> tuple[PointSet, FloatArray, list[Exclusion], list[str]]:
    """Points that can be trusted with the last moves before their poses, what was left out, and notes."""
    from irbcal.measurement import cleaning

    cleaned = cleaning.clean(measurements, references, tuple(robot.targets) if isinstance(robot, Robot) else None)
    groups = measurements.of_poses("group") if "group" in measurements.cells.columns else None
    # the moves are what is analysed: no model may take them off beforehand
    points = replace(cleaned.points, previous=None)
    return points, last_moves(measurements.joints(), groups)[cleaned.number], [*cleaned.excluded], [*cleaned.notes]


def _far(exclusion: tuple[str, str, float], where: str) -> Exclusion:
    pose, target, off = exclusion
    return Exclusion(pose=pose, target=target, reason=f"outlier: {off / MM:.3g} mm from {where}")


def _named(source: str, function: Callable[..., T], *arguments: Any) -> T:
    """Refusals with the file's name."""
    try:
        return function(*arguments)
    except IdentificationError as error:
        raise IdentificationError(str(error), file=source) from None


SIDES = DIRECTIONS[:2]
BINS = 10
LINES = tuple(DASHES)
"""Of the targets in one chart."""
THESIS_ELBOW = (30.0, 0.0, -30.0, -60.0, -90.0)
"""Angles of joint 3 in Nubiola 2011, Table 4.4, degrees."""
WIDE, SMALL = 480.0, 300.0
"""Widths of drawings one above the other and side by side."""


def draw(result: JointBehaviour) -> dict[str, bytes]:
    """All charts that a result allows, as PNG files by name."""
    return {f"{name}.png": drawing().content("png") for name, drawing in drawings(result).items()}


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
    if _bending_is_shown(result):
        out["stiffness_joint_2"] = partial(_equivalent, result)
    residuals = result.residuals
    if residuals is not None and _shown_joints(residuals):
        out["residuals_by_joint"] = partial(residuals_by_joint, residuals)
        if any(term.tested for term in residuals.by_joint("move").values()):
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


def _stiffness(result: JointBehaviour) -> FloatArray | None:
    """A and B as estimated from the residuals, radians; None where they were not."""
    if result.residuals is None:
        return None
    term = result.residuals.by_joint("stiffness").get(None)
    return np.array(term.values) if term is not None and len(term.values) == 2 else None


def _bending_is_shown(result: JointBehaviour) -> bool:
    """Whether joints 2 and 3 lift the arm, as far as is known, and moves of joint 2 or A and B show how it bends."""
    columns = [joint.series[0].columns for joint in result.moves if joint.joint == 2]
    if result.residuals is None:
        return tuple(JOINTS) in columns
    return result.stiffness_geometry is not None and (bool(columns) or _stiffness(result) is not None)


def _equivalent(report: JointBehaviour) -> Chart:
    """The equivalent error of joint 2: measured (Nubiola 2011, Figure 4.10) and modelled (Figures 5.5 and 5.6)."""
    series = [s for joint in report.moves if joint.joint == 2 for s in joint.series]
    coefficients_found, geometry = _stiffness(report), report.stiffness_geometry
    model = None if coefficients_found is None or geometry is None else (coefficients_found, *geometry)
    label = "equivalent error of joint 2 (deg)"
    sheets: list[Drawing] = []
    legend: dict[str, LegendEntry] = {}
    panels: list[tuple[str, list[tuple[str, str, FloatArray, FloatArray, bool]]]] = []
    if series:
        rows = []
        for k, s in enumerate(series):
            elbow = f"joint 3 at {s.q[0, 2] / DEG:.0f} deg"
            rows.append((f"error{k % 5}", elbow, s.turn, s.angle, True))
            if report.residuals is not None and coefficients_found is not None and model:
                order = np.argsort(s.turn, kind="stable")
                curve = predicted_series(s, report.residuals.robot, coefficients_found)
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
