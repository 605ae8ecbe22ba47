"""The ballbar: radial errors of a circle, predicted and measured, and joints that turn back (Nubiola 2011, annex VI).

The ball may stand below the plane of the circle: the bar is then inclined, and the circle's radius is the shorter leg.
Errors are taken about the centre that fits the circle best, as the ball is never exactly where the programme has the
centre; the deviation of the mean radius stays. Angles count along the path from its start. Lengths are in metres,
angles in radians.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, Locked, rms
from irbcal.correction.fake_targets import correct_joints
from irbcal.correction.paths import Circle, Reversal, joint_history, reversals
from irbcal.errors import MeasurementError, OptionError, RobotError
from irbcal.io.opening import CalibrationLike, open_calibration
from irbcal.measurement.input_table import InputTable, TableLike, distinct
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.robot import Robot
from irbcal.modeling.terms import chain
from irbcal.option_values import length, number, point_in_metres
from irbcal.plotting.charts import DASHED, DOTTED, Boxes, Chart, Drawing, LegendEntry, Lines, Text, round_number
from irbcal.summary import Content, Paragraph, Result, Table, TableValue, rows
from irbcal.units import DEG, MM
from irbcal.wording import inflected, joined


@dataclass(frozen=True, eq=False)
class TiltedCircle(Circle):
    """A whole turn on which the tool leans towards the centre.

    So it did in the second and third test of annex VI (Figures A VI-6 and A VI-9).
    """

    tilt: float = 0.0
    """Turn of the tool about the path's tangent, radians; positive: the tip of its z axis leans inwards."""
    height: float = 0.0
    """Of the circle's plane above the ball, along the normal, metres."""

    @property
    def ball(self) -> FloatArray:
        """Place of the ball, shape (3,), metres."""
        return self.center - self.height * self.normal

    @property
    def bar(self) -> float:
        """Length of the ballbar, metres."""
        return float(np.hypot(np.linalg.norm(self.T_start[:3, 3] - self.center), self.height))

    def poses(self, s: ArrayLike) -> FloatArray:
        """Poses at fractions ``s`` (n,) of the way, shape (n, 4, 4)."""
        from scipy.spatial.transform import Rotation

        T = super().poses(np.asarray(s, dtype=float))
        out = T[:, :3, 3] - self.center
        tangent = frames.cross(self.normal, out / np.linalg.norm(out, axis=1)[:, None])
        inwards = self.tilt if self.T_start[:3, 2] @ self.normal < 0 else -self.tilt
        T[:, :3, :3] = Rotation.from_rotvec(inwards * tangent).as_matrix() @ T[:, :3, :3]
        return T


def circle(
    arm: Arm,
    q_center: ArrayLike,
    bar: float,
    T_tip_tcp: FloatArray | None = None,
    normal: ArrayLike = (0.0, 0.0, 1.0),
    start: ArrayLike = (1.0, 0.0, 0.0),
    height: float = 0.0,
    tilt: float = 0.0,
) -> TiltedCircle:
    """A circular path about the tool's place at given joints (Figure A VI-3).

    Parameters
    ----------
    arm : Arm
        Nominal.
    q_center : array_like, shape (6,)
        Joints at which the tool centre point is in the circle's centre, radians; they set orientation and
        configuration, too.
    T_tip_tcp : ndarray, shape (4, 4), optional
        The tool; identity unless given.
    bar, normal, start, height, tilt
        As `ballbar`; the start is made perpendicular to the normal.

    Raises
    ------
    RobotError
        If the sizes, normal or start make no circle.
    """
    T = arm.forward(arm.check_joints(q_center))[0] @ (np.eye(4) if T_tip_tcp is None else T_tip_tcp)
    axis, out = np.asarray(normal, dtype=float), np.asarray(start, dtype=float)
    if not (bar > abs(height) and np.linalg.norm(axis) > 0):
        raise RobotError("a circle needs a normal, and a ballbar longer than the ball is away from the circle's plane")
    axis = axis / np.linalg.norm(axis)
    out = out - axis * (axis @ out)
    if np.linalg.norm(out) < 1e-6:
        raise RobotError("the start of a circle cannot lie along its normal: give another direction")
    T_start = T.copy()
    T_start[:3, 3] += np.sqrt(bar**2 - height**2) * out / np.linalg.norm(out)
    return TiltedCircle(T_start, T_start, T[:3, 3], axis, 2 * np.pi, tilt, height)


def tool_frame(values: ArrayLike) -> FloatArray:
    """``T_tip_tcp``, shape (4, 4), from a position (3,) in metres or that and a unit quaternion, scalar first, (7,).

    Raises
    ------
    RobotError
        If the quaternion is no unit one.
    """
    numbers = np.asarray(values, dtype=float)
    R = np.eye(3)
    if len(numbers) == 7:
        norm = np.linalg.norm(numbers[3:])
        if abs(norm - 1) > 1e-3:
            raise RobotError(f"the tool's orientation needs a unit quaternion, found one of length {norm:g}")
        R = frames.matrix_from_quaternion(numbers[3:])
    return frames.transform(R, numbers[:3])


FEWEST_READINGS = 8
SMALLEST_ARC = 180 * DEG
"""Part of the circle below which centre and radius cannot be told apart well enough."""

ANOTHER_CIRCLE = 0.05
"""Share of the bar by which readings may miss it before they are taken to be those of another circle."""

ROUNDS = 5
"""Gauss-Newton steps of the fit of the centre; the shift is a thousandth of the radius."""

MEASURED = "measured"
"""Name of the only run of a file without a column ``run``."""


@dataclass(frozen=True, eq=False)
class Trace(Locked):
    """Radial errors over the path angle."""

    angle: FloatArray
    """Shape (n,). Radians from the start of the path, ascending."""
    error: FloatArray
    """Shape (n,). Distance from the ball minus the nominal length of the bar, metres."""
    shift: FloatArray
    """Shape (2,). Of the fitted centre towards the start and towards a quarter turn later, metres; zero where it was
    not fitted.
    """

    def statistics(self) -> dict[str, Any]:
        """Figures, mm: ``mean``, ``rms``, ``max_abs`` and circularity (largest minus smallest error)."""
        e = self.error / MM
        return {
            "n": len(e),
            "mean_mm": float(e.mean()),
            "rms_mm": rms(e),
            "max_abs_mm": float(np.abs(e).max()),
            "circularity_mm": float(np.ptp(e)),
            "shift_mm": (self.shift / MM).tolist(),
        }

    def at(self, angle: ArrayLike) -> FloatArray:
        """Error at other angles, by linear interpolation around the circle, metres."""
        return np.interp(np.asarray(angle) % (2 * np.pi), self.angle % (2 * np.pi), self.error, period=2 * np.pi)


def trace_of_points(path: TiltedCircle, points: FloatArray) -> Trace:
    """Radial errors of places of the tool near a circular path, about the best place of the ball.

    The ball is fixed: the shift of the true circle as a whole, also along the normal, is taken off. A tilt of the
    circle stays.

    Parameters
    ----------
    path : TiltedCircle
    points : ndarray, shape (n, 3)
        In the base link, metres.
    """
    offset = path.T_start[:3, 3] - path.center
    u = offset / np.linalg.norm(offset)
    v = frames.cross(path.normal, u)
    relative = points - path.center
    angle = np.arctan2(relative @ v, relative @ u) % (2 * np.pi)
    relative = points - path.ball - path.normal * (relative @ path.normal).mean()
    ball = np.zeros(3)
    for _ in range(ROUNDS):
        to_ball = relative - ball
        distance = np.linalg.norm(to_ball, axis=1)
        A = np.column_stack([np.ones(len(to_ball)), to_ball @ u / distance, to_ball @ v / distance])
        step = np.linalg.lstsq(A, distance - path.bar, rcond=None)[0]
        ball = ball + step[1] * u + step[2] * v
    order = np.argsort(angle, kind="stable")
    error = np.linalg.norm(relative - ball, axis=1) - path.bar
    return Trace(angle[order], error[order], np.array([ball @ u, ball @ v]))


def centred(angle: ArrayLike, error: ArrayLike) -> Trace:
    """A trace with the best centre taken off: ``error = mean + a cos(angle) + b sin(angle) + rest``.

    Parameters
    ----------
    angle : ndarray, shape (n,)
        Radians.
    error : ndarray, shape (n,)
        Metres.

    Returns
    -------
    Trace
        Mean and rest; ``shift`` is (a, b).

    Raises
    ------
    MeasurementError
        If the readings cover too little of the circle.
    """
    at, error = np.asarray(angle, dtype=float), np.asarray(error, dtype=float)
    turn = np.sort(at % (2 * np.pi))
    gap = np.diff(np.append(turn, turn[0] + 2 * np.pi)).max() if len(turn) else 2 * np.pi
    if len(at) < FEWEST_READINGS or 2 * np.pi - gap < SMALLEST_ARC:
        raise MeasurementError(
            f"the centre needs {FEWEST_READINGS} readings or more over at least half a circle, found {len(at)} over "
            f"{(2 * np.pi - gap) / DEG:.0f} degrees"
        )
    A = np.column_stack([np.ones_like(at), np.cos(at), np.sin(at)])
    fit = np.linalg.lstsq(A, error, rcond=None)[0]
    order = np.argsort(at, kind="stable")
    return Trace(at[order], (error - A[:, 1:] @ fit[1:])[order], fit[1:])


def read_traces(source: TableLike, bar: float) -> tuple[dict[str, Trace], bool]:
    """A measured ballbar file: columns ``angle_deg`` and ``radius_mm`` (or ``error_mm``), optional ``run``.

    Angles count along the path from its start, in the sense of the motion, for either direction of travel.

    Parameters
    ----------
    source : str, Path or DataFrame
    bar : float
        Nominal length of the ballbar, metres.

    Returns
    -------
    traces : dict of str to Trace
        Of each run, centred.
    simulated : bool
        Whether the file says that it is simulated.

    Raises
    ------
    MeasurementError
        If the file does not keep the format, the radius is another one or too little of the circle was measured.
    """
    table = InputTable.read(source, ["angle_deg"])
    simulated = table.simulated
    column = table.either("radius_mm", "error_mm")
    table = table[np.isfinite(table.numbers(column, lost=True))]
    angle, error = table.si("angle_deg"), table.si(column) - (bar if column == "radius_mm" else 0.0)
    if len(error) and np.median(np.abs(error)) > ANOTHER_CIRCLE * bar:
        sentence = f"the readings lie {np.median(error) / MM:+.3f} mm from the bar's {bar / MM:g} mm: another circle"
        raise table.fault(sentence, column=column)
    runs = table.texts("run", MEASURED)
    out = {}
    for name in distinct(runs) or [MEASURED]:
        rows = runs == name
        try:
            out[name] = centred(angle[rows], error[rows])
        except MeasurementError as refused:
            raise table.fault(f"run {name}: {refused}") from None
    return out, simulated


def explained(measured: Trace, predicted: Trace) -> tuple[float, float]:
    """How much of a measured trace a prediction explains: rms before and after it is subtracted, metres.

    Both without their mean: the length of the ballbar is known less well than its changes.
    """
    error = measured.error - measured.error.mean()
    residual = measured.error - predicted.at(measured.angle)
    return rms(error), rms(residual - residual.mean())


SAMPLES = 720
"""Places on a circle at which errors are predicted."""


@dataclass(frozen=True, eq=False, repr=False)
class BallbarPrediction(Locked):
    """What a ballbar is expected to show."""

    uncorrected: Trace
    """Path of the controller's nominal model, run by the calibrated robot."""
    corrected: Trace | None
    """Path through fake targets, run by the calibrated robot."""
    arcs: int
    """Circular moves of the corrected path."""
    reversals: tuple[Reversal, ...]
    """Joints that turn back (Tables A VI-1, A VI-2 and A VI-3); places are fractions of the path."""
    q: FloatArray
    """Shape (n, 6). Joint history (Figures A VI-2, A VI-5 and A VI-8), radians."""

    def __repr__(self) -> str:
        fake = "no fake targets" if self.corrected is None else f"fake targets in {self.arcs} arcs"
        return f"<{type(self).__name__}: {len(self.q)} places on the circle, {fake}, {len(self.reversals)} reversals>"


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
        See `irbcal.validation.ballbar_check.circle`.
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

DETERMINED = 0.5
"""Share of its prior deviation below which an offset counts as seen."""

CLEAR = 2.0
"""Standard deviations from zero beyond which an offset counts as there."""


@dataclass(frozen=True)
class JointOffset(Content):
    """An offset of a joint."""

    CONTENT = "joint offset_deg=value std_deg=std determined clear"

    joint: int
    """From 1."""
    value: float
    std: float
    """Radians."""

    @property
    def determined(self) -> bool:
        """Whether the circle tells it."""
        return self.std < DETERMINED * PRIOR

    @property
    def clear(self) -> bool:
        """Whether it is there, beyond chance."""
        return self.determined and abs(self.value) > CLEAR * self.std

    def in_words(self) -> str:
        """Joint, offset and deviation."""
        return f"joint {self.joint} by {self.value / DEG:+.4f} ± {self.std / DEG:.4f} deg"


@dataclass(frozen=True)
class JointZeroChange(Content):
    """What joint offsets make of a difference of traces."""

    CONTENT = "rms_mm=rms_before left_mm=rms_after offsets"

    offsets: tuple[JointOffset, ...]
    rms_before: float
    rms_after: float
    """Root mean square of the difference about its mean, and of what the offsets leave of it, metres."""

    def in_words(self) -> str:
        """Its size without and with offsets of the joints, and which of these are there, or that none is."""
        clear = ", ".join(offset.in_words() for offset in self.offsets if offset.clear)
        undetermined = [str(offset.joint) for offset in self.offsets if not offset.determined]
        which = f"{inflected(len(undetermined), 'joint')} {joined(undetermined)}"
        tail = f" (this circle does not determine {which})" if undetermined else ""
        return (
            f"{self.rms_before / MM:.4f} mm rms without offsets of joints, {self.rms_after / MM:.4f} mm rms with those "
            f"that fit best; offsets beyond chance: {clear or 'none'}{tail}"
        )


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
    moves = chain.by_joints(walk, robot.arm, p)
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
    noise = max(rms(y), NOISE)
    for _ in range(20):
        C = np.linalg.inv(columns.T @ columns / noise**2 + np.eye(columns.shape[1]) / PRIOR**2)
        value = C @ (columns.T @ y) / noise**2
        residual = y - columns @ value
        dof = columns.shape[1] - float(np.trace(C)) / PRIOR**2
        noise = max(float(np.sqrt(residual @ residual / max(len(y) - 3 - dof, 1.0))), NOISE)
    std = np.sqrt(np.diagonal(C))
    joints = tuple(JointOffset(j + 1, float(v), float(s)) for j, (v, s) in enumerate(zip(value, std, strict=True)))
    return JointZeroChange(joints, rms(y), rms(residual))


def minus(first: Trace, second: Trace) -> Trace:
    """The difference of two traces at the first one's angles."""
    return Trace(first.angle, first.error - second.at(first.angle), first.shift - second.shift)


RunName: TypeAlias = Literal["nominal", "fake"]

SIDE, RIM = 520.0, 185.0
"""Side of the polar drawing and radius of its rim."""

CENTER_JOINTS = (0.0, 0.0, 0.0, 0.0, 90 * DEG, 0.0)
"""Joints with the tool in the circle's centre unless others are given, radians."""

MOST_ARCS = 512


@dataclass(frozen=True, eq=False)
class BallbarRun(Content):
    """A measured run."""

    CONTENT = "*trace.statistics variation_rms_mm=variation unexplained_rms_mm=unexplained joints since_baseline=since"

    trace: Trace
    variation: float
    unexplained: float
    """Root mean square of the readings about their mean, and of what the prediction leaves of them, metres."""
    joints: JointZeroChange
    """Joint offsets that explain what the prediction does not."""
    since: JointZeroChange | None
    """Joint offsets that explain what changed since the baseline; None without one."""


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
    runs : dict of str to BallbarRun
        By their names; empty where nothing was measured.
    simulated : bool
        Whether the calibration is from simulated data.
    simulated_readings : bool
        Whether the measured file or the baseline says that it is simulated.
    """

    bar: float
    prediction: BallbarPrediction
    run: RunName
    runs: Mapping[str, BallbarRun]
    simulated: bool
    simulated_readings: bool = False

    CONTENT = (
        "simulated simulated_readings nominal_targets=prediction.uncorrected.statistics "
        "fake_targets=prediction.corrected.statistics arcs=prediction.arcs run measured=runs reversals=turns"
    )
    ROWS, COLUMNS = "traces", "trace angle_deg error_mm"

    def turns(self) -> list[dict[str, Any]]:
        """Where joints turn back, degrees."""
        return rows(self.prediction.reversals, "path_angle_deg joint joint_angle_deg=angle kind")

    def traces(self) -> dict[str, Trace]:
        """All traces by what they are called in tables and figures."""
        out = {"nominal targets, predicted": self.prediction.uncorrected}
        if self.prediction.corrected is not None:
            out[f"fake targets ({self.prediction.arcs} arcs), predicted"] = self.prediction.corrected
        return out | {
            name if name == MEASURED else f"measured, run {name}": run.trace for name, run in self.runs.items()
        }

    def report(self) -> Sequence[Paragraph]:
        """Circularity and radial errors of all traces, what the prediction explains, and the joints that turn back."""
        start = f"{self.mark}: " if self.mark else ""
        rows: list[tuple[TableValue, ...]] = []
        for name, trace in self.traces().items():
            values = trace.statistics()
            rows.append((name, *(values[key] for key in ("mean_mm", "rms_mm", "max_abs_mm", "circularity_mm"))))
        title = f"{start}radial errors of the circle, ballbar {self.bar / MM:g} mm, centre fitted, mm"
        targets = {"nominal": "nominal", "fake": "calibrated"}[self.run]
        circularity = "; ".join(f"{row[0]} {row[-1]:.3f} mm" for row in rows)
        headline = f"{start}circularity with a bar of {self.bar / MM:g} mm: {circularity}"
        out: list[Paragraph] = [headline, Table(title, ("", "mean", "rms", "largest", "circularity"), tuple(rows))]
        for name, run in self.runs.items():
            out.append(
                f"Run {name}: the readings vary by {run.variation / MM:.4f} mm rms; the prediction for the path of "
                f"{targets} targets leaves {run.unexplained / MM:.4f} mm unexplained."
            )
            out.append(f"  Unexplained: {run.joints.in_words()}.")
            if run.since is not None:
                out.append(f"  Change since the baseline: {run.since.in_words()}.")
        turns = tuple((r.path_angle / DEG, r.angle / DEG, str(r.joint), r.kind) for r in self.prediction.reversals)
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
        """Polar plot of radial errors, with the joint reversals marked on the rim (Figures A VI-1, A VI-4 and A VI-7).

        Parameters
        ----------
        magnify : float, optional
            How many times errors are drawn larger than the radius; by default a round number.
        """
        radius, traces = self.bar / MM, self.traces()
        largest = max(np.abs(trace.error).max() for trace in traces.values()) / MM
        if magnify is None:
            magnify = round_number(0.3 * radius / max(largest, 1e-6))
        step = round_number(0.15 * radius / magnify)
        count = min(int(np.ceil(largest / step)) + 1, int(0.9 * radius / magnify / step))
        rings = step * np.arange(-count, count + 1, dtype=float)
        inside = radius + magnify * rings[0]
        rim = radius + magnify * max(rings.max() + 0.5 * step, largest + 0.3 * step)
        drawing = Drawing("Radial errors of the ballbar", SIDE, SIDE)

        def at(angle: ArrayLike, r: ArrayLike) -> FloatArray:
            a, s = np.asarray(angle, dtype=float), RIM / rim * np.asarray(r, dtype=float)
            return np.column_stack(np.broadcast_arrays(SIDE / 2 + s * np.cos(a), SIDE / 2 - s * np.sin(a)))

        turn = np.linspace(0, 2 * np.pi, 361)
        drawing.add(Lines([at(turn, radius + magnify * ring) for ring in rings], "line", 0.8))
        drawing.add(Lines([at(turn, radius)], "soft", 1.3))
        legend: list[LegendEntry] = []
        for (name, trace), (colour, dash) in zip(traces.items(), self._looks(), strict=True):
            drawing.add(Lines([at(*_closed(trace, radius, magnify))], colour, 1.4, dash))
            legend.append((colour, "--" if dash else "-", name))
        for ring in rings[[0, -1]]:
            position = at(np.radians(22.5), radius + magnify * ring)[0]
            drawing.add(Boxes(np.concatenate([position - [15, 7], position + np.array([15, 7])])[None], "page"))
            drawing.add(Text(position[0], position[1], f"{ring:+.3g}", "middle", "soft", 10.0))
        for angle, beside, text in _spread(_marks(self.prediction.reversals)):
            paths = [at([angle, angle], [inside, rim]), at([angle, beside], [rim, 1.05 * rim])]
            drawing.add(Lines(paths, "soft", 0.8))
            position = at(beside, 1.08 * rim)[0]
            across, up = np.cos(beside), np.sin(beside)
            lines = text.split("\n")
            first = position[1] - 12.0 * (len(lines) - 1) * (0.5 if abs(up) < 0.4 else 1.0 if up > 0 else 0.0)
            for k, text_line in enumerate(lines):
                side: Any = "middle" if abs(across) < 0.4 else "start" if across > 0 else "end"
                drawing.add(Text(position[0], first + 12.0 * k, text_line, side, size=10.0))
        for tick in np.arange(0, 360, 45):
            position = at(np.radians(tick), 0.82 * inside)[0]
            drawing.add(Text(position[0], position[1], f"{tick}°", "middle", "soft", 10.0))
        for k, text_line in enumerate((f"bar {radius:g} mm", f"errors × {magnify:g}", f"1 ring = {step:g} mm")):
            drawing.add(Text(SIDE / 2, SIDE / 2 + 13.0 * (k - 1), text_line, "middle", size=10.0))
        caption = (
            "Radial errors; on the rim: joints that turn back there, at their largest (max) or smallest (min) angle; "
            "rings: error in mm"
        )
        return Chart("ballbar", caption, [drawing], legend, mark=f"{self.mark}. " if self.mark else "")

    def _looks(self) -> list[tuple[str, str]]:
        """Colour and dashes of each trace."""
        looks = [("nominal", ""), *([("calibrated", "")] if self.prediction.corrected is not None else [])]
        lines = (DOTTED, DASHED, "6 3 1.5 3")
        return looks + [("measured", lines[k % len(lines)]) for k in range(len(self.runs))]


def _spread(
    marks: Sequence[tuple[float, str]], line_angle: float = 3.2, smallest: float = 10.0
) -> list[tuple[float, float, str]]:
    """Marks with places of their words beside them, moved so far apart that the words do not overlap.

    ``line_angle`` is the height of a line and ``smallest`` the width of a word on the rim, degrees.
    """
    beside = np.array([angle for angle, _ in marks])
    lines = np.array([text.count("\n") + 1 for _, text in marks])
    for _ in range(50):
        for k in range(len(marks)):
            following = (k + 1) % len(marks)
            need = np.radians(max(smallest, line_angle * (lines[k] + lines[following]) / 2 + 1.0))
            gap = (beside[following] - beside[k]) % (2 * np.pi)
            if len(marks) > 1 and gap < need:
                beside[k] -= 0.5 * (need - gap)
                beside[following] += 0.5 * (need - gap)
    return [(old, float(angle), text) for (old, text), angle in zip(marks, beside, strict=True)]


def _closed(trace: Trace, radius: float, magnification: float) -> tuple[FloatArray, FloatArray]:
    """A trace in polar coordinates, closed where its readings go all around."""
    angle, r = trace.angle, radius + magnification * trace.error / MM
    gaps = np.diff(np.append(angle, angle[0] + 2 * np.pi))
    if gaps[-1] < 3 * np.median(gaps):
        return np.append(angle, angle[0] + 2 * np.pi), np.append(r, r[0])
    return angle, r


def _marks(reversals: Sequence[Reversal], apart: float = 6.0) -> list[tuple[float, str]]:
    """Reversals within so many degrees of one another as one mark: (angle, text)."""
    groups: list[list[Reversal]] = []
    for reversal in sorted(reversals, key=lambda r: r.s):
        if groups and 360 * (reversal.s - groups[-1][-1].s) < apart:
            groups[-1].append(reversal)
        else:
            groups.append([reversal])
    return [
        (float(np.mean([r.path_angle for r in group])), "\n".join(f"J{r.joint} {r.kind}" for r in group))
        for group in groups
    ]


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
    run: RunName = "nominal",
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
        Joints with the tool in the circle's centre, radians (metres for prismatic joints); of arms with six all at
        zero but joint 5 at a right angle unless given.
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
    if run not in get_args(RunName):
        raise OptionError.unknown("run", run, get_args(RunName))
    if run == "fake" and not arcs:
        raise OptionError("fake targets were run in at least one arc", parameter="arcs")
    if not 0 <= number("arcs", arcs, whole=True) <= MOST_ARCS:
        raise OptionError(f"a circle has up to {MOST_ARCS} arcs, found {arcs}", parameter="arcs")
    bar, height = length("bar", bar), length("height", height)
    tool = point_in_metres("tool", tool, "x, y, z in metres, optionally a unit quaternion", (3, 7))
    saved = open_calibration(calibration)
    robot, nominal = saved.robot_calibrated(), saved.arm(calibrated=False)
    if joints is None and len(nominal.joint_names) != len(CENTER_JOINTS):
        message = f"give the joints in the circle's centre: {nominal.name} has {nominal.joints_listed}"
        raise OptionError(message, parameter="joints")
    q = nominal.check_joints(CENTER_JOINTS if joints is None else joints)[0]
    T_tip_tcp = tool_frame(tool)
    path = circle(nominal, q, bar, T_tip_tcp, normal, start, height, tilt)
    prediction = predict(path, robot, nominal, q, arcs, T_tip_tcp)
    traces, simulated = ({}, False) if measured is None else read_traces(measured, bar)
    if baseline is not None and measured is None:
        raise OptionError("a baseline is compared with what is measured now: name its file, too", parameter="baseline")
    earlier, simulated_before = ({}, False) if baseline is None else read_traces(baseline, bar)
    if earlier and not set(earlier) & set(traces):
        raise OptionError(
            f"the baseline has other runs ({', '.join(earlier)}) than the measured file ({', '.join(traces)})",
            parameter="baseline",
        )
    expected = prediction.corrected if run == "fake" and prediction.corrected is not None else prediction.uncorrected
    runs = {}
    for name, trace in traces.items():
        columns = by_joints(path, robot, prediction.q, T_tip_tcp, trace.angle)
        since = offsets(minus(trace, earlier[name]), columns) if name in earlier else None
        runs[name] = BallbarRun(trace, *explained(trace, expected), offsets(minus(trace, expected), columns), since)
    return BallbarCheck(bar, prediction, run, runs, saved.simulated, simulated or simulated_before)
