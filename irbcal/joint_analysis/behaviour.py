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
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, TypeVar

from irbcal.arrays import FloatArray
from irbcal.errors import IdentificationError, MeasurementError, OptionError, RobotError
from irbcal.joint_analysis.joint_charts import StiffnessGeometry, drawings
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
    payload_effects,
    payload_table,
)
from irbcal.joint_analysis.terms import (
    MOVES_TITLE,
    name_of,
    of_joints,
    term_rows,
    terms_table,
)
from irbcal.measurement import table
from irbcal.measurement.cleaning import Exclusion, left_out
from irbcal.measurement.motions import last_moves
from irbcal.measurement.points import PointSet
from irbcal.measurement.reading_lag import ReadingLag, mixed_use
from irbcal.measurement.table import MeasurementSet
from irbcal.modeling.arm import Arm
from irbcal.modeling.robot import Robot
from irbcal.option_values import Progress
from irbcal.plotting.charts import Chart
from irbcal.summary import Paragraph, Result, Table, remarks, simulated_mark
from irbcal.units import MM

if TYPE_CHECKING:
    import pandas as pd

    from irbcal.io.opening import CalibrationLike


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
    stiffness_geometry: StiffnessGeometry | None = None
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
        return tuple(self._drawings())

    def _drawings(self) -> dict[str, Callable[[], Chart]]:
        return drawings(self.moves, self.residuals, self.stiffness_geometry, self.simulated)

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
        every = self._drawings()
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
        Calibration folder (in Python also a loaded calibration): its residuals are analysed, too.
    robot : str, Path or Arm, optional
        URDF, shipped robot's name or nominal arm, identified from these poses first; one-joint moves need
        none.
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
    files = {f"{name}.png": result.plot(name).content("png") for name in result.figures}
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
        from irbcal.io.opening import open_robot

        robot = open_robot(robot, nominal=True).nominal
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
    nominal = robot.joint_map.terms.arm if nominal is None and isinstance(robot, Robot) else nominal
    nominal = robot if isinstance(robot, Arm) else nominal
    moves: list[JointMoves] = []
    if has_moves(points):
        try:
            moves = _named(source, analyse_moves, points, step, *options, measurements.joint_columns, nominal)
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
    groups = measurements.per_pose("group") if "group" in measurements.cells.columns else None
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
