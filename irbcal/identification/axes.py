"""Direct geometric calibration from the six joint axes (Nubiola 2011, sections 3.1, 3.2 and 3.4).

Each joint is moved by itself; the circles that the reflectors draw give its axis (`irbcal.identification.circles`).
The axes, brought to zero joints, give the DHM table of links 2 to 6 without iteration; the base follows from axes 1
and 2, the tool from axes 5 and 6 or from its known dimensions. No guess of base or tool is needed.

Standard deviations come from the circles' residuals, which count as independent. What the poses of a group have in
common (a bent arm, a joint that is not where it says) is not in them.
"""

from dataclasses import dataclass

import numpy as np

from irbcal.errors import IdentificationError
from irbcal.identification import circles
from irbcal.measurement.last_moves import STILL
from irbcal.measurement.points import PointSet
from irbcal.modeling import dhm, frames
from irbcal.modeling.extraction import NEARLY_PARALLEL, dhm_from_axes
from irbcal.modeling.robot import Robot
from irbcal.units import DEG, MM

PARALLEL = 1.0 * DEG
"""Angle below which ``parallel="forced"`` gives consecutive axes one direction."""

LARGEST_ANGLE, LARGEST_LENGTH = 20.0 * DEG, 100.0 * MM
"""Corrections above these are not those of the robot in the file."""

GROUPS = tuple(f"axis{k}" for k in range(1, 7))
COLUMNS = ("alpha", "a", "theta", "d", "beta")
LENGTHS = ("a", "d")
STEP = 1e-6


@dataclass(frozen=True, eq=False)
class MeasuredAxes:
    """Six measured joint axes, in the measuring frame ("world").

    Attributes
    ----------
    fits : tuple of AxisFit
        As measured, each at its own home pose.
    homes : ndarray, shape (6, 6)
        Home pose of each group, a row each, radians; the moving joint's own entry does not matter.
    points, directions : ndarray, shape (6, 3)
        A point on each axis (m) and its unit direction with all joints at zero.
    moves : PointSet
        The poses of the six groups and their points.
    """

    fits: tuple
    homes: np.ndarray
    points: np.ndarray
    directions: np.ndarray
    moves: PointSet

    def as_measured(self):
        """Points and directions (6, 3), each axis at its own home pose."""
        return np.array([fit.point for fit in self.fits]), np.array([fit.direction for fit in self.fits])


@dataclass(frozen=True, eq=False)
class LinkGeometry:
    """Lengths and angles between consecutive axes, found without a nominal arm.

    Attributes
    ----------
    table : DHMTable
        ``a[i]`` and ``alpha[i]``: distance and angle from axis i to axis i+1 counted from 1 (``a[1]`` lies between axes
        1 and 2); ``d[i]`` and ``theta[i]``: shift along and turn about axis i+1 between the common normals on both of
        its sides. NaN where six axes do not say: row 0, ``theta[5]`` and ``d[5]``. ``a`` is not negative; nearly
        parallel axes are in Hayati's form, with the tilt in ``alpha`` and ``beta``.
    std : DHMTable
        Standard deviations, radians and metres.
    """

    table: dhm.DHMTable
    std: dhm.DHMTable


@dataclass(frozen=True, eq=False)
class AxisCalibration:
    """A robot calibrated from its axes.

    Attributes
    ----------
    robot : Robot
        The arm has the nominal arm's ``T_base_0``, first row and ``T_last_tip``; base and targets are measured.
    axes : MeasuredAxes
    corrections : DHMTable
        Calibrated minus nominal; angles in (-pi, pi]. Zero for link 1, which the base takes, and for ``theta[5]`` and
        ``d[5]`` of an unknown tool. The nominal values are those of the nominal axes taken to a table as the measured
        ones are: of the two d of parallel axes, of which only the sum matters, the first is zero.
    std : DHMTable
        Standard deviations of the corrections; NaN for link 1 and what was held. Those of ``theta[5]`` and ``d[5]``
        hold the scatter of the targets as well, as if it were independent of the axes.
    tool_known : bool
    parallel : str
        ``hayati`` or ``forced``.
    rms : float
        Root mean square distance of the measured from the modelled points of the six groups, metres.
    """

    robot: Robot
    axes: MeasuredAxes
    corrections: dhm.DHMTable
    std: dhm.DHMTable
    tool_known: bool
    parallel: str
    rms: float


def measure_axes(points):
    """Find the six axes from the groups ``axis1`` ... ``axis6``; other groups are not looked at.

    Axis k depends on joints 1 to k-1 only: it is brought to zero joints by turning it back about the axes before it
    by the group's home angles, joint 1 outermost. Home poses may differ from group to group.

    Parameters
    ----------
    points : PointSet

    Returns
    -------
    MeasuredAxes

    Raises
    ------
    IdentificationError
        If a group is missing, if other joints move within a group or if a group does not give an axis.
    """
    with_points = np.zeros(points.poses, dtype=bool)
    with_points[points.pose] = True
    groups = np.array([str(group) for group in points.groups])
    found = sorted({group for group in groups[with_points] if group})
    if not set(GROUPS) <= set(found):
        raise IdentificationError(
            "the method axes needs one-joint moves in the groups axis1 ... axis6; found "
            + (", ".join(found) or "no groups")
        )
    fits, homes = [], np.empty((6, 6))
    for k, name in enumerate(GROUPS):
        group = points.select(with_points & (groups == name))
        homes[k] = _home(group.q, k)
        fits.append(circles.fit_axis(group.xyz, group.target, group.joints()[:, k], name))
    p, z = np.array([fit.point for fit in fits]), np.array([fit.direction for fit in fits])
    moves = points.select(with_points & np.isin(groups, GROUPS))
    return MeasuredAxes(tuple(fits), homes, *at_zero_joints(p, z, homes), moves)


def _home(q, k):
    """The pose of the joints that stand still while joint ``k`` moves."""
    off = q - q[0]
    off -= 2 * np.pi * np.round(off / (2 * np.pi))
    off[:, k] = 0.0
    range_of = np.ptp(off, axis=0)
    worst = int(np.argmax(range_of))
    if range_of[worst] > STILL:
        raise IdentificationError(
            f"group {GROUPS[k]}: joint {worst + 1} moves by {range_of[worst] / DEG:.3g} degrees, "
            f"but only joint {k + 1} may move there"
        )
    return q[0] + off.mean(axis=0)


def at_zero_joints(points, directions, homes):
    """Axes with all joints at zero, from axes measured at their own home poses.

    Parameters
    ----------
    points, directions : ndarray, shape (6, 3)
        A point on each axis (m) and its unit direction, any frame.
    homes : ndarray, shape (6, 6)
        Joints at which each axis was measured, radians; of row k only joints before k matter.

    Returns
    -------
    points, directions : ndarray, shape (6, 3)
    """
    p, z = np.array(points, dtype=float), np.array(directions, dtype=float)
    for j in range(5):  # axis j is in place by now: all axes after it turn back about it
        R = np.array([frames.rotation_from_vector(-angle * z[j]) for angle in homes[j + 1 :, j]])
        p[j + 1 :] = p[j] + np.einsum("kab,kb->ka", R, p[j + 1 :] - p[j])
        z[j + 1 :] = np.einsum("kab,kb->ka", R, z[j + 1 :])
    return p, z


def link_geometry(axes, parallel="hayati", tolerance=PARALLEL):
    """Lengths and angles between consecutive axes, without a nominal arm (Nubiola 2011, section 3.1.2).

    Parameters
    ----------
    axes : MeasuredAxes
    parallel, tolerance
        As `calibrate_by_axes`.

    Returns
    -------
    LinkGeometry
    """
    chain = _Chain(axes, parallel, tolerance)
    table = chain.table(*axes.as_measured())[1]
    std = _standard_deviations(axes, lambda p, z: chain.table(p, z, table)[1])
    return LinkGeometry(_unknown(table), _unknown(std))


def calibrate_by_axes(arm, points, parallel="hayati", tolerance=PARALLEL, known_targets=None):
    """Base, links 2 to 6 and tool from one-joint moves, without iteration over a model.

    Frames are placed on the axes (Nubiola 2011, section 3.1.2), of the two senses of each common normal the one nearer
    to the nominal table. The base lies the nominal first row before frame 1 (eq. 3.10). With a tool of unknown
    dimensions frame 6 takes nominal ``theta6`` and ``d6``, and targets are the mean of ``T_world_tip^-1 y`` over the
    poses (eqs. 3.20 to 3.24); targets not seen in the six groups are left out. With known dimensions ``theta6`` and
    ``d6`` bring the targets nearest to their measured places (eqs. 3.25 to 3.30, least squares over all poses).

    Parameters
    ----------
    arm : Arm
        Nominal arm.
    points : PointSet
        With the groups ``axis1`` ... ``axis6``.
    parallel : str
        ``hayati``: the tilt between nearly parallel axes becomes ``beta``. ``forced``: consecutive axes closer than
        ``tolerance`` get one direction (section 3.1.3), the better known axis counting more.
    tolerance : float
        Radians; for ``forced``.
    known_targets : dict of str to array_like, shape (3,), optional
        Known places of some or all measured targets in the tip link, metres.

    Returns
    -------
    AxisCalibration

    Raises
    ------
    IdentificationError
        As `measure_axes`; also if the arm has not six revolute joints, if axes 1 and 2 are nearly parallel (they do not
        give a base), if the axes are not those of the nominal arm, if known targets are not among the measured ones or
        all on axis 6.
    """
    if not arm.six_revolute:
        raise IdentificationError(f"the method axes is for arms with six revolute joints, {arm.name} has others")
    axes = measure_axes(points)
    moves = axes.moves
    known = _known(known_targets, moves.target_names)
    chain = _Chain(axes, parallel, tolerance)
    sine = np.linalg.norm(np.cross(*axes.directions[:2]))
    if sine < NEARLY_PARALLEL:
        raise IdentificationError(
            f"axes 1 and 2 are {np.arcsin(sine) / DEG:.2g} degrees from parallel: they do not give a base frame"
        )
    nominal = _nominal_form(arm)

    def model(p, z):
        T_world_1, table = chain.table(p, z, nominal)
        table = _with(table, nominal)
        T_world_base = T_world_1 @ frames.inverse(arm.T_base_0 @ table.step(0))
        return Robot(arm.with_table(table), T_world_base=T_world_base)

    def values(p, z):
        robot = model(p, z)
        return _with_tool(robot, moves, known)[0].table if known else robot.table

    robot, scatter = model(*axes.as_measured()), (np.nan, np.nan)
    if known:
        robot, scatter = _with_tool(robot, moves, known)
    corrections = _difference(robot.table, nominal)
    _check_arm(arm, corrections)
    std = _standard_deviations(axes, values)
    std = _unknown(std, np.hypot(std.theta[5], scatter[0]), np.hypot(std.d[5], scatter[1]))
    robot = robot.replace(targets=_targets(robot, moves) | known)
    off = moves.xyz - moves.predicted(robot)
    rms = float(np.sqrt(np.mean(np.sum(off**2, axis=1))))
    return AxisCalibration(robot, axes, corrections, std, bool(known), parallel, rms)


class _Chain:
    """From axes as measured to frame 1 and a DHM table."""

    def __init__(self, axes, parallel, tolerance):
        if parallel not in ("hayati", "forced"):
            raise IdentificationError(f"unknown way {parallel!r} with parallel axes: choose hayati or forced")
        self.axes = axes
        self.tolerance = tolerance if parallel == "forced" else 0.0
        spread = np.array([fit.direction_std for fit in axes.fits])
        # without standard deviations, or with no noise at all, every axis counts the same
        self.weights = spread**-2.0 if np.all(spread > 1e-12) else np.ones(6)

    def table(self, p, z, reference=None):
        """``T_world_1`` and the table nearest to a reference, from points and directions as measured."""
        p, z = at_zero_joints(p, z, self.axes.homes)
        table, T_world_0, _ = dhm_from_axes(p, self._same_directions(z), np.eye(4))
        if reference is not None:
            table = _nearest(table, reference)
        return T_world_0 @ table.step(0), table

    def _same_directions(self, z):
        """Nearly parallel consecutive axes get their weighted mean direction."""
        z = z.copy()
        start = 0
        for k in range(1, 7):
            if k < 6 and np.linalg.norm(np.cross(z[k - 1], z[k])) < np.sin(self.tolerance):
                continue
            run = np.arange(start, k)
            signs = np.sign(z[run] @ z[start])
            mean = (signs * self.weights[run]) @ z[run]
            if len(run) > 1:
                z[run] = signs[:, None] * mean / np.linalg.norm(mean)
            start = k
        return z


def _nearest(table, reference):
    """The same geometry with the senses of the x axes that lie nearest to a reference table.

    Turning frame i by half a turn about its z axis changes ``theta_i`` and ``theta_{i+1}`` by pi and the signs of
    ``alpha_{i+1}``, ``a_{i+1}`` and ``beta_{i+1}``.
    """
    alpha, a, theta, d, beta = (getattr(table, name).copy() for name in ("alpha", "a", "theta", "d", "beta"))
    for i in range(5):
        if i == 0:  # theta_1 depends on where frame 0 lies: the next row tells
            far = np.cos(alpha[1] - reference.alpha[1]) - np.cos(alpha[1] + reference.alpha[1])
            turn = far < -1e-3 or (abs(far) <= 1e-3 and a[1] * reference.a[1] < 0)
        else:
            turn = np.cos(theta[i] - reference.theta[i]) < 0
        if turn:
            theta[i : i + 2] += np.pi
            alpha[i + 1], a[i + 1], beta[i + 1] = -alpha[i + 1], -a[i + 1], -beta[i + 1]
    # the same angles without leaps of a whole turn against the reference
    theta, alpha = (r + _wrapped(v - r) for v, r in ((theta, reference.theta), (alpha, reference.alpha)))
    return dhm.DHMTable(alpha, a, theta, d, beta)


def _nominal_form(arm):
    """The nominal arm's table in the form in which measured axes come.

    It is `Arm.table` itself for arms read from a URDF; where parallel axes leave a choice, another one may have been
    made elsewhere. Row 1 and frame 6 are those of the arm.
    """
    chain = dhm.chain_frames(arm.table, arm.table.offsets[:, None], arm.T_base_0)
    table, _, _ = dhm_from_axes(chain.o[:, :, 0], chain.z[:, :, 0], np.eye(4))
    table = _with(_nearest(table, arm.table), arm.table, 0.0, 0.0)
    joints = np.zeros((1, 6))
    T_6_6 = frames.inverse(dhm.forward(table, joints)[0]) @ dhm.forward(arm.table, joints)[0]
    theta6 = arm.table.theta[5] + _wrapped(np.arctan2(T_6_6[1, 0], T_6_6[0, 0]) - arm.table.theta[5])
    table = _with(table, arm.table, theta6, T_6_6[2, 3])
    same = {name: np.abs(getattr(table, name) - getattr(arm.table, name)) < 1e-12 for name in COLUMNS}
    return dhm.DHMTable(*(np.where(same[n], getattr(arm.table, n), getattr(table, n)) for n in COLUMNS))


def _with(table, first, theta6=None, d6=None):
    """The table with row 1 of another one and, unless given, also its ``theta6`` and ``d6``."""
    columns = {name: getattr(table, name).copy() for name in COLUMNS}
    for name, column in columns.items():
        column[0] = getattr(first, name)[0]
    columns["theta"][5] = first.theta[5] if theta6 is None else theta6
    columns["d"][5] = first.d[5] if d6 is None else d6
    return dhm.DHMTable(**columns)


def _unknown(table, theta6=np.nan, d6=np.nan):
    """The table without row 1, which axes alone do not tell, and with these entries in row 6."""
    return _with(table, dhm.DHMTable(*np.full((5, 6), np.nan)), theta6, d6)


def _wrapped(angle):
    """Angle in (-pi, pi]."""
    return np.pi - np.mod(np.pi - angle, 2 * np.pi)


def _difference(table, nominal):
    columns = {name: getattr(table, name) - getattr(nominal, name) for name in COLUMNS}
    return dhm.DHMTable(**{name: v if name in LENGTHS else _wrapped(v) for name, v in columns.items()})


def _check_arm(arm, corrections):
    """Refuse corrections that are those of another robot, or of a joint that turns the other way."""
    sizes = np.array(
        [np.abs(getattr(corrections, n)) / (LARGEST_LENGTH if n in LENGTHS else LARGEST_ANGLE) for n in COLUMNS]
    )
    column, row = np.unravel_index(np.argmax(sizes), sizes.shape)
    if sizes[column, row] > 1.0:
        name = COLUMNS[column]
        value = getattr(corrections, name)[row]
        value = f"{value / MM:.0f} mm" if name in LENGTHS else f"{value / DEG:.0f} degrees"
        raise IdentificationError(
            f"the measured axes are not those of {arm.name}: {name}{row + 1} differs by {value}; "
            "check the robot file, the order and the sense of the joints"
        )


def _known(known_targets, names):
    known = {name: np.asarray(place, dtype=float) for name, place in (known_targets or {}).items()}
    for name, place in known.items():
        if name not in names:
            raise IdentificationError(f"known target {name!r} was not measured: found {', '.join(names)}")
        if place.shape != (3,) or not np.isfinite(place).all():
            raise IdentificationError(f"known target {name!r} needs three coordinates, found {place.tolist()}")
    return known


def _with_tool(robot, moves, known):
    """The robot with ``theta6`` and ``d6`` from targets known in the tip link, and their scatter (rad, m).

    In the frame that turns with joint 6 at zero ``theta6`` and ``d6``, a target at ``t`` in frame 6 lies at
    ``Rot(z, theta6) t + d6 z``; turn and shift in closed form.
    """
    moves = moves.take(np.isin(moves.names(), list(known)))
    places = np.array([known.get(name, np.zeros(3)) for name in moves.target_names])
    t = frames.apply(robot.arm.T_last_tip, places)[moves.target]
    square = np.sum(t[:, :2] ** 2, axis=1)
    if len(t) < 2 or square.max() < (1.0 * MM) ** 2:
        raise IdentificationError("all known targets lie on axis 6: theta6 needs one beside it")
    table = _with(robot.table, robot.table, 0.0, 0.0)
    T_world_6 = robot.T_world_base @ dhm.forward(table, moves.joints(), robot.arm.T_base_0)
    y = np.einsum("nji,nj->ni", T_world_6[:, :3, :3], moves.xyz - T_world_6[:, :3, 3])
    cross, dot = t[:, 0] * y[:, 1] - t[:, 1] * y[:, 0], t[:, 0] * y[:, 0] + t[:, 1] * y[:, 1]
    theta = np.arctan2(cross.sum(), dot.sum())
    around = (np.cos(theta) * cross - np.sin(theta) * dot)[square > 0] ** 2 / square[square > 0]
    shift = y[:, 2] - t[:, 2]
    scatter = np.sqrt([around.sum() / square.sum() / (len(t) - 1), shift.var(ddof=1) / len(t)])
    theta = robot.table.theta[5] + _wrapped(theta - robot.table.theta[5])
    table = _with(table, table, theta, shift.mean())
    return robot.replace(arm=robot.arm.with_table(table)), scatter


def _targets(robot, moves):
    """Mean place of each target in the tip link over the poses at hand (Nubiola 2011, eqs. 3.22 to 3.24)."""
    T_tip_world = frames.inverse(robot.T_world_base @ robot.poses(moves.q))[moves.pose]
    places = np.einsum("nij,nj->ni", T_tip_world[:, :3, :3], moves.xyz) + T_tip_world[:, :3, 3]
    seen = np.unique(moves.target)
    return {moves.target_names[t]: places[moves.target == t].mean(axis=0) for t in seen}


def _standard_deviations(axes, values):
    """Standard deviations of a table's entries: covariances of the axes through central differences.

    Parameters
    ----------
    axes : MeasuredAxes
    values : callable
        Table of points and directions (6, 3) as measured.

    Returns
    -------
    DHMTable
    """
    p, z = axes.as_measured()
    variance = np.zeros((len(COLUMNS), 6))
    for k, fit in enumerate(axes.fits):
        J = np.empty((4, len(COLUMNS), 6))
        for m in range(4):
            ends = []
            for sign in (1.0, -1.0):
                array = (z if m < 2 else p).copy()
                array[k] += sign * STEP * fit.basis[m % 2]
                array[k] /= np.linalg.norm(array[k]) if m < 2 else 1.0
                table = values(p, array) if m < 2 else values(array, z)
                ends.append(np.array([getattr(table, name) for name in COLUMNS]))
            J[m] = (ends[0] - ends[1]) / (2 * STEP)
        variance += np.einsum("mij,mn,nij->ij", J, fit.covariance, J)
    return dhm.DHMTable(*np.sqrt(np.maximum(variance, 0.0)))
