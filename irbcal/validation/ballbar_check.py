"""The door to the ballbar: radial errors of a circle, predicted and measured, and joints that turn back (annex VI)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import Locked
from irbcal.errors import OptionError
from irbcal.io.opening import CalibrationLike, open_calibration
from irbcal.measurement.columns import InputTable, TableLike
from irbcal.options import length, number, place
from irbcal.plotting.charts import Chart
from irbcal.summary import Cell, Paragraph, Result, Table
from irbcal.units import DEG, MM
from irbcal.validation import ballbar_trace
from irbcal.validation.ballbar_circle import circle
from irbcal.validation.ballbar_circle import tool as tool_frame
from irbcal.validation.ballbar_trace import MEASURED, Trace, explained

if TYPE_CHECKING:
    import pandas as pd
from irbcal.arrays import FloatArray
from irbcal.correction.fake_targets import correct_joints
from irbcal.correction.paths import Circle, Reversal, joint_history, reversals
from irbcal.errors import RobotError
from irbcal.modeling.arm import Arm
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms import chain
from irbcal.validation.ballbar_circle import TiltedCircle
from irbcal.validation.ballbar_trace import trace_of_points

SAMPLES = 720
"""Places on a circle at which errors are predicted."""


@dataclass(frozen=True, eq=False, repr=False)
class BallbarPrediction(Locked):
    """What a ballbar is expected to show.

    Attributes
    ----------
    uncorrected : Trace
        Path of the controller's nominal model, run by the calibrated robot.
    corrected : Trace or None
        Path through fake targets, run by the calibrated robot.
    arcs : int
        Circular moves of the corrected path.
    reversals : tuple of Reversal
        Joints that turn back (Tables A VI-1, A VI-2 and A VI-3); places are fractions of the path.
    q : ndarray, shape (n, 6)
        Joint history (Figures A VI-2, A VI-5 and A VI-8), radians.
    """

    uncorrected: Trace
    corrected: Trace | None
    arcs: int
    reversals: tuple[Reversal, ...]
    q: FloatArray

    def __repr__(self) -> str:
        fake = "no fake targets" if self.corrected is None else f"fake targets in {self.arcs} arcs"
        return f"<Prediction: {len(self.q)} places on the circle, {fake}, {len(self.reversals)} reversals>"


def predict(
    path: TiltedCircle,
    robot: Robot,
    nominal: Arm,
    q_center: FloatArray,
    arcs: int = 6,
    T_tip_tcp: FloatArray | None = None,
    samples: int = SAMPLES,
) -> BallbarPrediction:
    """Radial errors of a circular path that the nominal controller runs, without and with fake targets (annex VI).

    Parameters
    ----------
    path : TiltedCircle
        See `irbcal.validation.ballbar_circle.circle`.
    robot : Robot
        Calibrated.
    nominal : Arm
        What the controller computes with.
    q_center : ndarray, shape (6,)
        Joints that tell the configuration, radians.
    arcs : int
        Circular moves of the corrected path, two or more; 0: only the uncorrected one.
    T_tip_tcp : ndarray, shape (4, 4), optional
    samples : int

    Raises
    ------
    RobotError
        If the robot does not reach every place, or a target cannot be corrected.
    """
    s = np.arange(samples) / samples
    q = joint_history(path, nominal, q_center, s, T_tip_tcp)
    tcp = np.eye(4) if T_tip_tcp is None else T_tip_tcp
    uncorrected = trace_of_points(path, (robot.poses(q) @ tcp)[:, :3, 3])
    corrected = None
    if arcs:
        corrected = trace_of_points(path, _corrected_points(path, robot, nominal, q_center, arcs, tcp, samples))
    return BallbarPrediction(uncorrected, corrected, arcs, tuple(_reversals(q, s)), q)


def _reversals(q: FloatArray, s: FloatArray) -> Sequence[Reversal]:
    """Joint reversals of a closed path, its seam included."""
    step = s[1] - s[0]
    if np.abs(q[0] - q[-1]).max() > 10 * np.abs(np.diff(q, axis=0)).max():
        return reversals(q, s)  # a joint that turned as a whole does not come back
    return reversals(np.vstack([q, q[:2]]), np.append(s, s[-1] + step * np.array([1, 2])))


def _corrected_points(
    path: TiltedCircle,
    robot: Robot,
    nominal: Arm,
    q_center: FloatArray,
    arcs: int,
    T_tip_tcp: FloatArray,
    samples: int,
) -> FloatArray:
    """Where the tool truly goes between fake targets: the controller runs its own arcs between them."""
    if arcs < 2:
        raise RobotError("a whole circle takes two arcs or more: the ends of one would be the same point")
    s = np.linspace(0.0, 1.0, 2 * arcs + 1)
    corrected = correct_joints(robot, nominal, joint_history(path, nominal, q_center, s, T_tip_tcp))
    if not corrected.ok.all():
        k = int(np.flatnonzero(~corrected.ok)[0])
        raise RobotError(f"point {k + 1} of {len(s)} of the circle cannot be corrected: {corrected.reason[k]}")
    fake = corrected.T_fake @ T_tip_tcp
    inside = np.arange(max(2, -(-samples // arcs))) / max(2, -(-samples // arcs))
    points = []
    for k in range(arcs):
        move = Circle.through(fake[2 * k], fake[2 * k + 1, :3, 3], fake[2 * k + 2])
        q = joint_history(move, nominal, corrected.q[2 * k], inside, T_tip_tcp)
        points.append((robot.poses(q) @ T_tip_tcp)[:, :3, 3])
    return np.concatenate(points)


PRIOR = 1e-3
"""Standard deviation of a joint's offset before anything was measured, radians (1 mm/m)."""

NOISE = 0.002 * MM
"""Least standard deviation of a reading about what offsets explain, metres: a ballbar's own."""

SEEN = 0.5
"""Share of its prior deviation below which an offset counts as seen."""

CLEAR = 2.0
"""Standard deviations from zero beyond which an offset counts as there."""


@dataclass(frozen=True)
class JointOffset:
    """An offset of a joint.

    Attributes
    ----------
    joint : int
        From 1.
    value, std : float
        Radians.
    """

    joint: int
    value: float
    std: float

    @property
    def seen(self) -> bool:
        """Whether the circle tells it."""
        return self.std < SEEN * PRIOR

    @property
    def clear(self) -> bool:
        """Whether it is there, beyond chance."""
        return self.seen and abs(self.value) > CLEAR * self.std

    def in_words(self) -> str:
        """Joint, offset and deviation."""
        return f"joint {self.joint} by {self.value / DEG:+.4f} ± {self.std / DEG:.4f} deg"


@dataclass(frozen=True)
class JointZeroChange:
    """What joint offsets make of a difference of traces.

    Attributes
    ----------
    offsets : tuple of JointOffset
    before, after : float
        Root mean square of the difference about its mean, and of what the offsets leave of it, metres.
    """

    offsets: tuple[JointOffset, ...]
    before: float
    after: float

    def in_words(self) -> str:
        """Offsets that are there, or that none is."""
        clear = [offset.in_words() for offset in self.offsets if offset.clear]
        if clear:
            finding = f"offsets of joints explain it: {', '.join(clear)}"
        else:
            finding = "no offset of a single joint is beyond chance"
        unseen = [str(offset.joint) for offset in self.offsets if not offset.seen]
        tail = f" (this circle does not tell joints {', '.join(unseen)})" if unseen else ""
        return f"{self.before / MM:.4f} mm rms, of which {self.after / MM:.4f} mm remain; {finding}{tail}"


def by_joints(path: TiltedCircle, robot: Robot, q: FloatArray, T_tip_tcp: FloatArray, angle: FloatArray) -> FloatArray:
    """Derivative of centred radial errors by joint offsets, shape (n, joints), metres per radian.

    Parameters
    ----------
    path : TiltedCircle
    robot : Robot
        Calibrated.
    q : ndarray, shape (m, joints)
        Joints along the path, evenly, from its start.
    T_tip_tcp : ndarray, shape (4, 4)
    angle : ndarray, shape (n,)
        Angles of the readings along the path, radians.
    """
    theta = robot.joint_map.effective(q)
    walk = chain.walk(robot.arm, theta)
    p = walk.tip[3] + np.einsum("acm,a->cm", walk.tip[:3], T_tip_tcp[:3, 3])
    pose = np.arange(len(q))
    moves = chain.point_columns(walk, p, pose)[:, 2]
    to_ball = p.T - path.ball
    along = np.einsum("jcm,mc->mj", moves, to_ball / np.linalg.norm(to_ball, axis=1)[:, None])
    turn = 2 * np.pi * pose / len(q)
    columns = np.column_stack([np.interp(angle % (2 * np.pi), turn, column, period=2 * np.pi) for column in along.T])
    A = np.column_stack([np.ones_like(angle), np.cos(angle), np.sin(angle)])
    return np.asarray(columns - A @ np.linalg.lstsq(A, columns, rcond=None)[0])


def offsets(difference: Trace, columns: FloatArray) -> JointZeroChange:
    """Joint offsets that explain a difference of traces, with their prior.

    Parameters
    ----------
    difference : Trace
    columns : ndarray, shape (n, joints)
        Of `by_joints`, at its angles.
    """
    y = difference.error - difference.error.mean()
    A = np.column_stack([np.cos(difference.angle), np.sin(difference.angle)])
    y = y - A @ np.linalg.lstsq(A, y, rcond=None)[0]
    noise = max(float(np.sqrt(np.mean(y**2))), NOISE)
    for _ in range(20):
        C = np.linalg.inv(columns.T @ columns / noise**2 + np.eye(columns.shape[1]) / PRIOR**2)
        value = C @ (columns.T @ y) / noise**2
        residual = y - columns @ value
        dof = columns.shape[1] - float(np.trace(C)) / PRIOR**2
        noise = max(float(np.sqrt(residual @ residual / max(len(y) - 3 - dof, 1.0))), NOISE)
    std = np.sqrt(np.diagonal(C))
    joints = tuple(JointOffset(j + 1, float(v), float(s)) for j, (v, s) in enumerate(zip(value, std, strict=True)))
    return JointZeroChange(joints, float(np.sqrt(np.mean(y**2))), float(np.sqrt(np.mean(residual**2))))


def minus(first: Trace, second: Trace) -> Trace:
    """The difference of two traces at the first one's angles."""
    return Trace(first.angle, first.error - second.at(first.angle), first.shift - second.shift)


Run: TypeAlias = Literal["nominal", "fake"]

CENTER_JOINTS = (0.0, 0.0, 0.0, 0.0, 90 * DEG, 0.0)
"""Joints with the tool in the circle's centre unless others are given, radians."""

MOST_ARCS = 512


@dataclass(frozen=True, eq=False, repr=False)
class BallbarCheck(Result):
    """What a ballbar is expected to show, and what it showed.

    Attributes
    ----------
    bar : float
        Nominal length of the ballbar, metres.
    prediction : BallbarPrediction
    run : str
        What was run when it was measured: the ``nominal`` targets or the ``fake`` ones.
    measured : dict of str to Trace
        By the names of the runs; empty where nothing was measured.
    simulated : bool
        Whether the calibration is from simulated data.
    simulated_readings : bool
        Whether the measured file says that it is simulated.
    joints : dict of str to Change
        Of each run: joint offsets that explain what the prediction does not.
    since : dict of str to Change
        Of each run that was measured earlier, too: joint offsets that explain what changed.
    """

    bar: float
    prediction: BallbarPrediction
    run: Run
    measured: dict[str, Trace]
    simulated: bool
    simulated_readings: bool = False
    joints: Mapping[str, JointZeroChange] = field(default_factory=dict)
    since: Mapping[str, JointZeroChange] = field(default_factory=dict)

    @property
    def expected(self) -> Trace:
        """The prediction for what was run."""
        corrected = self.prediction.corrected
        return corrected if self.run == "fake" and corrected is not None else self.prediction.uncorrected

    def traces(self) -> dict[str, Trace]:
        """All traces by what they are called in tables and figures."""
        out = {"nominal targets, predicted": self.prediction.uncorrected}
        if self.prediction.corrected is not None:
            out[f"fake targets ({self.prediction.arcs} arcs), predicted"] = self.prediction.corrected
        return out | {
            name if name == MEASURED else f"measured, run {name}": trace for name, trace in self.measured.items()
        }

    def to_dict(self) -> dict[str, Any]:
        """What the command prints as JSON, mm and degrees.

        ``simulated``, ``simulated_readings``, ``nominal_targets``, ``fake_targets`` (None without), ``arcs``, ``run``,
        ``measured`` (of each run, with the rms that the prediction leaves unexplained) and ``reversals``.
        """
        p, runs = self.prediction, {}
        for name, trace in self.measured.items():
            variation, unexplained = explained(trace, self.expected)
            runs[name] = {
                **ballbar_trace.summary(trace),
                "variation_rms_mm": variation / MM,
                "unexplained_rms_mm": unexplained / MM,
                "joints": _change(self.joints.get(name)),
                "since_baseline": _change(self.since.get(name)),
            }
        return {
            "simulated": self.simulated,
            "simulated_readings": self.simulated_readings,
            "nominal_targets": ballbar_trace.summary(p.uncorrected),
            "fake_targets": None if p.corrected is None else ballbar_trace.summary(p.corrected),
            "arcs": p.arcs,
            "run": self.run,
            "measured": runs,
            "reversals": [
                {"path_angle_deg": 360 * r.s, "joint": r.joint, "joint_angle_deg": r.angle / DEG, "kind": r.kind}
                for r in p.reversals
            ],
        }

    def to_frame(self) -> pd.DataFrame:
        """A row for each angle of each trace: ``trace``, ``angle_deg``, ``error_mm``."""
        import pandas as pd

        tables = [
            pd.DataFrame({"trace": name, "angle_deg": trace.angle / DEG, "error_mm": trace.error / MM})
            for name, trace in self.traces().items()
        ]
        return pd.concat(tables, ignore_index=True)

    def report(self) -> Sequence[Paragraph]:
        """Circularity and radial errors of all traces, what the prediction explains, and the joints that turn back."""
        start = f"{self.mark}: " if self.mark else ""
        rows: list[tuple[Cell, ...]] = []
        for name, trace in self.traces().items():
            values = ballbar_trace.summary(trace)
            rows.append((name, *(values[key] for key in ("mean_mm", "rms_mm", "max_abs_mm", "circularity_mm"))))
        title = f"{start}radial errors of the circle, ballbar {self.bar / MM:g} mm, centre fitted, mm"
        targets = {"nominal": "nominal", "fake": "calibrated"}[self.run]
        circularity = "; ".join(f"{row[0]} {row[-1]:.3f} mm" for row in rows)
        headline = f"{start}circularity with a bar of {self.bar / MM:g} mm: {circularity}"
        out: list[Paragraph] = [headline, Table(title, ("", "mean", "rms", "largest", "circularity"), tuple(rows))]
        for name, trace in self.measured.items():
            variation, unexplained = (value / MM for value in explained(trace, self.expected))
            out.append(
                f"Run {name}: the readings vary by {variation:.4f} mm rms; the prediction for the path of {targets} "
                f"targets leaves {unexplained:.4f} mm unexplained."
            )
            if name in self.joints:
                out.append(f"  That is {self.joints[name].in_words()}.")
            if name in self.since:
                out.append(f"  Since the baseline it has changed by {self.since[name].in_words()}.")
        turns = tuple((360 * r.s, r.angle / DEG, str(r.joint), r.kind) for r in self.prediction.reversals)
        if turns:
            out.append(
                Table("Joints that turn back", ("path angle deg", "joint angle deg", "joint", "min/max"), turns, 1)
            )
        return out

    @property
    def mark(self) -> str:
        """What is simulated, in words; empty where nothing is."""
        of_calibration = ["Calibration from SIMULATED data"] if self.simulated else []
        return ", ".join([*of_calibration, *(["SIMULATED readings"] if self.simulated_readings else [])])

    def plot(self, magnify: float | None = None) -> Chart:
        """Polar plot of the radial errors (Figures A VI-1, A VI-4 and A VI-7), errors ``magnify`` times enlarged."""
        from irbcal.validation import plots

        return plots.ballbar(self, magnify)


def _change(change: JointZeroChange | None) -> dict[str, Any] | None:
    """What offsets of joints explain, ready for JSON; mm and degrees."""
    if change is None:
        return None
    rows = [
        {"joint": o.joint, "offset_deg": o.value / DEG, "std_deg": o.std / DEG, "seen": o.seen, "clear": o.clear}
        for o in change.offsets
    ]
    return {"rms_mm": change.before / MM, "left_mm": change.after / MM, "offsets": rows}


def ballbar(
    calibration: CalibrationLike,
    measured: TableLike | None = None,
    *,
    bar: float = 150 * MM,
    joints: ArrayLike | None = None,
    tool: ArrayLike = (0.0, 0.0, 0.0),
    normal: ArrayLike = (0.0, 0.0, 1.0),
    start: ArrayLike = (1.0, 0.0, 0.0),
    height: float = 0.0,
    tilt: float = 0.0,
    arcs: int = 6,
    run: Run = "nominal",
    baseline: TableLike | None = None,
) -> BallbarCheck:
    """Radial errors of a circle as a ballbar shows them: nominal targets, fake targets, measured; joint reversals.

    Parameters
    ----------
    calibration : str, Path or loaded calibration
    measured : str, Path or DataFrame, optional
        ``angle_deg,radius_mm`` (or ``error_mm``) and, for several, ``run``; angles count along the path.
    bar : float
        Length of the ballbar, metres: the radius, unless the ball stands out of the circle's plane.
    joints : array_like, shape (joints,), optional
        Joints with the tool in the circle's centre, radians; `CENTER_JOINTS` of arms with six unless given.
    tool : array_like, shape (3,) or (7,)
        The cup's centre on the tip link, metres, optionally with a unit quaternion, scalar first.
    normal, start : array_like, shape (3,)
        The path turns about the normal; direction from the centre to the start. In the base link.
    height : float
        Of the circle's plane above the ball, along the normal, metres.
    tilt : float
        Lean of the tool's z axis towards the centre, radians.
    arcs : int
        Arcs of the path of fake targets, two or more; 0: none.
    run : str
        What was run when it was measured: the ``nominal`` targets or the ``fake`` ones.
    baseline : str, Path or DataFrame, optional
        The same circle as it was measured earlier: what has changed since, and which joint's zero would explain it.

    Raises
    ------
    OptionError
        If an option has a value that it does not know, or fake targets were run without arcs.
    RobotError
        If the sizes make no circle, or the robot does not reach it.
    MeasurementError
        If the measured file does not keep the format or is of another circle.
    """
    if run not in get_args(Run):
        raise OptionError.unknown("run", run, get_args(Run))
    if run == "fake" and not arcs:
        raise OptionError("fake targets were run in at least one arc", parameter="arcs")
    if not 0 <= number("arcs", arcs, whole=True) <= MOST_ARCS:
        raise OptionError(f"a circle has up to {MOST_ARCS} arcs, found {arcs}", parameter="arcs")
    bar, height = length("bar", bar), length("height", height)
    tool = place("tool", tool, "x, y, z in metres and at will a unit quaternion", (3, 7))
    saved = open_calibration(calibration)
    robot, nominal = saved.robot_calibrated(), saved.arm(calibrated=False)
    if joints is None and len(nominal.joint_names) != len(CENTER_JOINTS):
        raise OptionError(f"{nominal.name} has not six joints: give those in the circle's centre", parameter="joints")
    q = nominal.check_joints(CENTER_JOINTS if joints is None else joints)[0]
    T_tip_tcp = tool_frame(tool)
    path = circle(nominal, q, bar, T_tip_tcp, normal, start, height, tilt)
    prediction = predict(path, robot, nominal, q, arcs, T_tip_tcp)
    traces = {} if measured is None else ballbar_trace.read(measured, bar)
    if baseline is not None and measured is None:
        raise OptionError("a baseline is compared with what is measured now: name its file, too", parameter="baseline")
    earlier = {} if baseline is None else ballbar_trace.read(baseline, bar)
    if earlier and not set(earlier) & set(traces):
        raise OptionError(
            f"the baseline has other runs ({', '.join(earlier)}) than the measured file ({', '.join(traces)})",
            parameter="baseline",
        )
    columns = {name: by_joints(path, robot, prediction.q, T_tip_tcp, trace.angle) for name, trace in traces.items()}
    expected = prediction.corrected if run == "fake" and prediction.corrected is not None else prediction.uncorrected
    joint_offsets = {name: offsets(minus(trace, expected), columns[name]) for name, trace in traces.items()}
    since = {n: offsets(minus(trace, earlier[n]), columns[n]) for n, trace in traces.items() if n in earlier}
    simulated = measured is not None and InputTable.read(measured).simulated
    return BallbarCheck(bar, prediction, run, traces, saved.simulated, simulated, joint_offsets, since)
