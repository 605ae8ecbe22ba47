"""Ballbar: radial errors of circular paths, predicted and measured (Nubiola 2011, annex VI).

A telescopic ballbar measures the distance of the tool from a fixed ball while the robot runs a circle about it. The
controller runs the circle with its nominal model; the calibrated model tells where the tool truly goes. Errors are
taken about the centre that fits the circle best, as the ball is never exactly where the programme has the centre;
the deviation of the mean radius stays. The ball may stand below the plane of the circle: the bar is then inclined, and
the circle's radius is the shorter leg.

Angles count along the path from its start. Lengths are in metres, angles in radians.
"""

from dataclasses import dataclass

import numpy as np

from irbcal.correction.fake_targets import correct_joints
from irbcal.correction.joints_along import joint_history, reversals
from irbcal.correction.path import Circle
from irbcal.errors import MeasurementError, RobotError
from irbcal.measurement import readings
from irbcal.modeling import frames
from irbcal.units import DEG, MM

SAMPLES = 720
"""Places on a circle at which errors are predicted."""

FEWEST_READINGS = 8
SMALLEST_ARC = 180 * DEG
"""Part of the circle below which centre and radius cannot be told apart well enough."""


@dataclass(frozen=True, eq=False)
class Trace:
    """Radial errors over the path angle.

    Attributes
    ----------
    angle : ndarray, shape (n,)
        Radians from the start of the path, ascending.
    error : ndarray, shape (n,)
        Distance from the ball minus the nominal length of the bar, metres.
    shift : ndarray, shape (2,)
        Of the fitted centre towards the start and towards a quarter turn later, metres; zero where it was not fitted.
    """

    angle: np.ndarray
    error: np.ndarray
    shift: np.ndarray

    def at(self, angle):
        """Error at other angles, by linear interpolation around the circle."""
        return np.interp(angle % (2 * np.pi), self.angle % (2 * np.pi), self.error, period=2 * np.pi)


@dataclass(frozen=True)
class TiltedCircle(Circle):
    """A whole turn on which the tool leans towards the centre, as in the second and third test of annex VI.

    Parameters
    ----------
    tilt : float
        Turn of the tool about the path's tangent, radians; positive: the tip of its z axis leans inwards.
    height : float
        Of the circle's plane above the ball, along the normal, metres.
    """

    tilt: float = 0.0
    height: float = 0.0

    @property
    def ball(self):
        """Place of the ball, shape (3,), metres."""
        return self.center - self.height * self.normal

    @property
    def bar(self):
        """Length of the ballbar, metres."""
        return float(np.hypot(np.linalg.norm(self.T_start[:3, 3] - self.center), self.height))

    def poses(self, s):
        """Poses at fractions ``s`` (n,) of the way, shape (n, 4, 4)."""
        from scipy.spatial.transform import Rotation

        T = super().poses(s)
        out = T[:, :3, 3] - self.center
        tangent = np.cross(self.normal, out / np.linalg.norm(out, axis=1)[:, None])
        inwards = self.tilt if self.T_start[:3, 2] @ self.normal < 0 else -self.tilt
        T[:, :3, :3] = Rotation.from_rotvec(inwards * tangent).as_matrix() @ T[:, :3, :3]
        return T


def circle(arm, q_center, bar, T_tip_tcp=None, normal=(0.0, 0.0, 1.0), start=(1.0, 0.0, 0.0), height=0.0, tilt=0.0):
    """A circular path about the tool's place at given joints.

    Parameters
    ----------
    arm : Arm
        Nominal.
    q_center : array_like, shape (6,)
        Joints at which the tool centre point is in the circle's centre, radians; they set orientation and
        configuration, too.
    bar : float
        Nominal length of the ballbar, metres: the radius, unless the ball stands out of the circle's plane.
    T_tip_tcp : ndarray, shape (4, 4), optional
        The tool; identity unless given.
    normal : array_like, shape (3,)
        The path turns about it, in the base link.
    start : array_like, shape (3,)
        Direction from the centre to the start; made perpendicular to the normal.
    height, tilt : float
        See `TiltedCircle`.

    Returns
    -------
    TiltedCircle

    Raises
    ------
    RobotError
        If the sizes, normal or start make no circle.
    """
    T = arm.forward(arm.check_joints(q_center))[0] @ (np.eye(4) if T_tip_tcp is None else T_tip_tcp)
    normal, start = np.asarray(normal, dtype=float), np.asarray(start, dtype=float)
    if not (bar > abs(height) and np.linalg.norm(normal) > 0):
        raise RobotError("a circle needs a normal, and a ballbar longer than the ball is away from the circle's plane")
    normal = normal / np.linalg.norm(normal)
    start = start - normal * (normal @ start)
    if np.linalg.norm(start) < 1e-6:
        raise RobotError("the start of a circle cannot lie along its normal: give another direction")
    T_start = T.copy()
    T_start[:3, 3] += np.sqrt(bar**2 - height**2) * start / np.linalg.norm(start)
    return TiltedCircle(T_start, T_start, T[:3, 3], normal, 2 * np.pi, tilt, height)


@dataclass(frozen=True, eq=False)
class Prediction:
    """What a ballbar is expected to show.

    Attributes
    ----------
    uncorrected : Trace
        Path of the controller's nominal model, run by the calibrated robot.
    corrected : Trace or None
        Path through fake targets, run by the calibrated robot.
    arcs : int
        Circular moves of the corrected path.
    reversals : list of Reversal
        Places are fractions of the path.
    q : ndarray, shape (n, 6)
        Joint history, radians.
    """

    uncorrected: Trace
    corrected: Trace | None
    arcs: int
    reversals: list
    q: np.ndarray


def predict(path, robot, nominal, q_center, arcs=6, T_tip_tcp=None, samples=SAMPLES):
    """Radial errors of a circular path that the nominal controller runs, without and with fake targets.

    Parameters
    ----------
    path : TiltedCircle
        See `circle`.
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

    Returns
    -------
    Prediction

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
    return Prediction(uncorrected, corrected, arcs, _reversals(q, s), q)


def _reversals(q, s):
    """Joint reversals of a closed path, its seam included."""
    step = s[1] - s[0]
    if np.abs(q[0] - q[-1]).max() > 10 * np.abs(np.diff(q, axis=0)).max():
        return reversals(q, s)  # a joint that turned as a whole does not come back
    return reversals(np.vstack([q, q[:2]]), np.append(s, s[-1] + step * np.array([1, 2])))


def _corrected_points(path, robot, nominal, q_center, arcs, T_tip_tcp, samples):
    """Where the tool truly goes between fake targets: the controller runs its own arcs between them."""
    if arcs < 2:
        raise RobotError("a whole circle takes two arcs or more: the ends of one would be the same point")
    s = np.linspace(0.0, 1.0, 2 * arcs + 1)
    wanted = correct_joints(robot, nominal, joint_history(path, nominal, q_center, s, T_tip_tcp))
    if not wanted.ok.all():
        k = int(np.flatnonzero(~wanted.ok)[0])
        raise RobotError(f"point {k + 1} of {len(s)} of the circle cannot be corrected: {wanted.reason[k]}")
    fake = wanted.T_fake @ T_tip_tcp
    inside = np.arange(max(2, -(-samples // arcs))) / max(2, -(-samples // arcs))
    points = []
    for k in range(arcs):
        move = Circle.through(fake[2 * k], fake[2 * k + 1, :3, 3], fake[2 * k + 2])
        q = joint_history(move, nominal, wanted.q[2 * k], inside, T_tip_tcp)
        points.append((robot.poses(q) @ T_tip_tcp)[:, :3, 3])
    return np.concatenate(points)


def trace_of_points(path, points):
    """Radial errors of places of the tool near a circular path, about the best place of the ball.

    The ball is fixed: the shift of the true circle as a whole, also along the normal, is taken off. A tilt of the
    circle stays.

    Parameters
    ----------
    path : TiltedCircle
    points : ndarray, shape (n, 3)
        In the base link, metres.

    Returns
    -------
    Trace
    """
    offset = path.T_start[:3, 3] - path.center
    u = offset / np.linalg.norm(offset)
    v = np.cross(path.normal, u)
    relative = points - path.center
    angle = np.arctan2(relative @ v, relative @ u) % (2 * np.pi)
    relative = points - path.ball - path.normal * (relative @ path.normal).mean()
    ball = np.zeros(3)
    for _ in range(5):  # Gauss-Newton; the shift is a thousandth of the radius
        away = relative - ball
        distance = np.linalg.norm(away, axis=1)
        A = np.column_stack([np.ones(len(away)), away @ u / distance, away @ v / distance])
        step = np.linalg.lstsq(A, distance - path.bar, rcond=None)[0]
        ball = ball + step[1] * u + step[2] * v
    order = np.argsort(angle, kind="stable")
    error = np.linalg.norm(relative - ball, axis=1) - path.bar
    return Trace(angle[order], error[order], np.array([ball @ u, ball @ v]))


def centred(angle, error):
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
    angle, error = np.asarray(angle, dtype=float), np.asarray(error, dtype=float)
    turn = np.sort(angle % (2 * np.pi))
    gap = np.diff(np.append(turn, turn[0] + 2 * np.pi)).max()
    if len(angle) < FEWEST_READINGS or 2 * np.pi - gap < SMALLEST_ARC:
        raise MeasurementError(
            f"the centre needs {FEWEST_READINGS} readings or more over at least half a circle, found {len(angle)} over "
            f"{(2 * np.pi - gap) / DEG:.0f} degrees"
        )
    A = np.column_stack([np.ones_like(angle), np.cos(angle), np.sin(angle)])
    fit = np.linalg.lstsq(A, error, rcond=None)[0]
    order = np.argsort(angle, kind="stable")
    return Trace(angle[order], (error - A[:, 1:] @ fit[1:])[order], fit[1:])


def read(path, bar):
    """A measured ballbar file: columns ``angle_deg`` and ``radius_mm`` (or ``error_mm``), optional ``run``.

    Angles count along the path from its start, in the sense of the motion, for either direction of travel.

    Parameters
    ----------
    path : str or Path
    bar : float
        Nominal length of the ballbar, metres.

    Returns
    -------
    dict of str to Trace
        Of each run, centred.

    Raises
    ------
    MeasurementError
        If the file does not keep the format, the radius is another one or too little of the circle was measured.
    """
    table = readings.read(path, ("angle_deg",), (), ("radius_mm", "error_mm"))
    have = [name for name in ("radius_mm", "error_mm") if name in table.columns]
    if len(have) != 1:
        found = "both" if have else "neither"
        raise MeasurementError(f"{path}: row 1: expected a column radius_mm or error_mm, found {found}")
    table = table[table[have[0]].notna()]
    error = table[have[0]].to_numpy() * MM - (bar if have[0] == "radius_mm" else 0.0)
    if len(error) and np.median(np.abs(error)) > 0.05 * bar:
        raise MeasurementError(
            f"{path}: column {have[0]}: the readings lie {np.median(error) / MM:+.3f} mm from the bar's "
            f"{bar / MM:g} mm: another circle"
        )
    runs = table["run"].astype(str).str.strip() if "run" in table.columns else None
    out = {}
    for name in ["measured"] if runs is None else dict.fromkeys(runs):
        mine = np.ones(len(table), dtype=bool) if runs is None else (runs == name).to_numpy()
        try:
            out[str(name)] = centred(table["angle_deg"].to_numpy()[mine] * DEG, error[mine])
        except MeasurementError as refused:
            raise MeasurementError(f"{path}: run {name}: {refused}") from None
    return out


def summary(trace):
    """Figures of a trace, mm: ``mean``, ``rms``, ``max_abs`` and circularity (largest minus smallest error)."""
    e = trace.error / MM
    return {
        "n": len(e),
        "mean_mm": float(e.mean()),
        "rms_mm": float(np.sqrt(np.mean(e**2))),
        "max_abs_mm": float(np.abs(e).max()),
        "circularity_mm": float(np.ptp(e)),
        "shift_mm": (trace.shift / MM).tolist(),
    }


def explained(measured, predicted):
    """How much of a measured trace a prediction explains: rms before and after it is subtracted, metres.

    Both without their mean: the length of the ballbar is known less well than its changes.
    """
    error = measured.error - measured.error.mean()
    rest = measured.error - predicted.at(measured.angle)
    return float(np.sqrt(np.mean(error**2))), float(np.sqrt(np.mean((rest - rest.mean()) ** 2)))


def tool(values):
    """``T_tip_tcp`` from a position (3,) in metres and, optionally, a quaternion (scalar first)."""
    from scipy.spatial.transform import Rotation

    values = np.asarray(values, dtype=float)
    R = np.eye(3)
    if len(values) == 7:
        norm = np.linalg.norm(values[3:])
        if abs(norm - 1) > 1e-3:
            raise RobotError(f"the tool's orientation needs a unit quaternion, found one of length {norm:g}")
        R = Rotation.from_quat(values[[4, 5, 6, 3]] / norm).as_matrix()
    return frames.transform(R, values[:3])
