"""Direct geometric calibration from the six joint axes, without iteration (Nubiola 2011, sections 3.1, 3.2 and 3.4).

Frames are placed on the axes by their common normals, as `irbcal.modeling.extraction` places them; nearly parallel
axes, which have none worth the name, keep their tilt as Hayati's ``beta`` or are forced into one direction.

Standard deviations come from the circles' residuals, which count as independent. What the poses of a group have in
common (a bent arm, a joint that is not where it says) is not in them.

The axes, brought to zero joints, give the DHM table of links 2 to 6; the base follows from axes 1 and 2, the tool
from axes 5 and 6 or from its known dimensions. No guess of base or tool is needed.

The two ends of the arm need no moves of the joints between: axes 1 and 2 give the base, the last two the frame on which
the tool is mounted. Nothing is iterated; of the nominal arm only its first row, its last row and senses are taken.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray
from irbcal.errors import IdentificationError
from irbcal.identification.axes import AxisFit, MeasuredAxes, OneAxis, at_zero_joints, measure_axes, one_axis
from irbcal.identification.choices import Parallel
from irbcal.measurement.column_names import POSITION
from irbcal.measurement.input_table import poses_to_frame
from irbcal.measurement.motions import STILL
from irbcal.measurement.points import PointSet
from irbcal.modeling import dhm, frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.extraction import NEARLY_PARALLEL, dhm_from_axes
from irbcal.modeling.robot import Robot
from irbcal.option_values import checked
from irbcal.summary import Paragraph, Result, Table, TableValue
from irbcal.units import DEG, MM

if TYPE_CHECKING:
    import pandas as pd

PARALLEL = 1.0 * DEG
"""Angle below which ``parallel="forced"`` gives consecutive axes one direction."""

PARALLELS: tuple[Parallel, ...] = get_args(Parallel)

COLUMNS = ("alpha", "a", "theta", "d", "beta")
"""Columns of a table that axes tell about."""

STEP = 1e-6
"""Of the central differences behind standard deviations, radians and metres."""


class AxisChain:
    """From axes as measured to frame 1 and a DHM table.

    Parameters
    ----------
    axes : MeasuredAxes
    parallel : str
        ``hayati`` or ``forced`` (Nubiola 2011, section 3.1.3).
    tolerance : float
        Radians; for ``forced``.

    Raises
    ------
    OptionError
        If there is no such way with parallel axes.
    """

    def __init__(self, axes: MeasuredAxes, parallel: Parallel, tolerance: float) -> None:
        checked("parallel", parallel, PARALLELS)
        self.axes = axes
        self.tolerance = tolerance if parallel == "forced" else 0.0
        spread = np.array([fit.direction_std for fit in axes.fits])
        # without standard deviations, or with no noise at all, every axis counts the same
        self.weights = spread**-2.0 if np.all(spread > 1e-12) else np.ones(6)

    def table(
        self, p: FloatArray, z: FloatArray, reference: dhm.DHMTable | None = None
    ) -> tuple[FloatArray, dhm.DHMTable]:
        """``T_world_1`` and the table nearest to a reference, from points and directions as measured."""
        p, z = at_zero_joints(p, z, self.axes.homes)
        table, T_world_0, _ = dhm_from_axes(p, self._same_directions(z), np.eye(4))
        if reference is not None:
            table = nearest(table, reference)
        return T_world_0 @ table.step(0), table

    def _same_directions(self, z: FloatArray) -> FloatArray:
        """Nearly parallel consecutive axes get their weighted mean direction (section 3.1.3)."""
        z = z.copy()
        start = 0
        for k in range(1, 7):
            if k < 6 and np.linalg.norm(frames.cross(z[k - 1], z[k])) < np.sin(self.tolerance):
                continue
            run = np.arange(start, k)
            signs = np.sign(z[run] @ z[start])
            mean = (signs * self.weights[run]) @ z[run]
            if len(run) > 1:
                z[run] = signs[:, None] * mean / np.linalg.norm(mean)
            start = k
        return z


def nearest(table: dhm.DHMTable, reference: dhm.DHMTable) -> dhm.DHMTable:
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
    theta, alpha = (r + frames.wrapped(v - r) for v, r in ((theta, reference.theta), (alpha, reference.alpha)))
    return dhm.DHMTable(alpha, a, theta, d, beta)


def with_ends(
    table: dhm.DHMTable, first: dhm.DHMTable, theta6: float | None = None, d6: float | None = None
) -> dhm.DHMTable:
    """The table with row 1 of another one and, unless given, also its ``theta6`` and ``d6``."""
    columns = {name: getattr(table, name).copy() for name in COLUMNS}
    for name, column in columns.items():
        column[0] = getattr(first, name)[0]
    columns["theta"][5] = first.theta[5] if theta6 is None else theta6
    columns["d"][5] = first.d[5] if d6 is None else d6
    return dhm.DHMTable(**columns)


def unknown(table: dhm.DHMTable, theta6: float = np.nan, d6: float = np.nan) -> dhm.DHMTable:
    """The table without row 1, which axes alone do not tell, and with these entries in row 6."""
    return with_ends(table, dhm.DHMTable(*np.full((5, 6), np.nan)), theta6, d6)


def standard_deviations(axes: MeasuredAxes, values: Callable[[FloatArray, FloatArray], dhm.DHMTable]) -> dhm.DHMTable:
    """Standard deviations of a table's entries: covariances of the axes through central differences.

    Parameters
    ----------
    axes : MeasuredAxes
    values : callable
        Table of points and directions (6, 3) as measured.
    """

    def entries(p: FloatArray, z: FloatArray) -> FloatArray:
        table = values(p, z)
        return np.array([getattr(table, name) for name in COLUMNS])

    return dhm.DHMTable(*_std(axes.fits, entries))


LARGEST_ANGLE, LARGEST_LENGTH = 20.0 * DEG, 100.0 * MM
"""Corrections above these are not those of the robot in the file."""

LENGTHS = ("a", "d")


@dataclass(frozen=True, eq=False, repr=False)
class AxisCalibration(Result):
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
    parallel: Parallel
    rms: float

    CONTENT = "parallel rms_mm corrections=to_frame"

    def report(self) -> Sequence[Paragraph]:
        """How well the axes explain the moves, and the correction of each link."""
        tool = "known" if self.tool_known else "unknown"
        headline = (
            f"{self.robot.arm.name} from its six axes: rms {self.rms / MM:.3f} mm over {self.axes.moves.poses} moves "
            f"of one joint, parallel axes {self.parallel}, tool of {tool} dimensions"
        )
        columns = ("parameter", "value", "±", "unit")
        return headline, Table.from_frame("Corrections of the nominal links", self.to_frame(), columns, 4)

    def to_frame(self) -> pd.DataFrame:
        """The corrections of links 2 to 6, a row each: name, value, std (NaN where held) and unit (mm or deg)."""
        import pandas as pd

        rows = []
        for i in range(1, 6):
            for kind in COLUMNS:
                unit, factor = ("mm", MM) if kind in LENGTHS else ("deg", DEG)
                value, std = (float(getattr(table, kind)[i] / factor) for table in (self.corrections, self.std))
                rows.append((f"delta_{kind}{i + 1}", value, std, unit))
        return pd.DataFrame(rows, columns=["name", "value", "std", "unit"])


def calibrate_by_axes(
    arm: Arm,
    points: PointSet,
    parallel: Parallel = "hayati",
    tolerance: float = PARALLEL,
    known_targets: Mapping[str, ArrayLike] | None = None,
) -> AxisCalibration:
    """Base, links 2 to 6 and tool from one-joint moves, without iteration over a model.

    The entire kinematic calibration of Nubiola 2011 (sections 3.1.4 and 5.4.4, Table 5.6). Frames are placed on the
    axes (section 3.1.2), of the two senses of each common normal the one nearer to the nominal table. The base is the
    nominal one (section 3.2, eqs. 3.11 and 3.12 with H the identity): it lies the nominal first row before frame 1
    (eq. 3.10, Figure 3.3). With a tool of unknown dimensions (section 3.4.2, Figures 3.6 and 3.7) frame 6 takes nominal
    ``theta6`` from the common normal of axes 5 and 6 (eqs. 3.20 and 3.21) and nominal ``d6``, and targets are the mean
    of ``T_world_tip^-1 y`` over the poses (eqs. 3.22, 3.23 and 3.24); targets not seen in the six groups are left out.
    With known dimensions ``theta6`` and ``d6`` bring the targets nearest to their measured places (section 3.4.3).

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

    Raises
    ------
    IdentificationError
        As `irbcal.identification.axes.measure_axes`; also if the arm has not six revolute joints, if axes 1 and 2 are
        nearly parallel (they do not give a base), if the axes are not those of the nominal arm, if known targets are
        not among the measured ones or all on axis 6.
    OptionError
        If there is no such way with parallel axes.
    """
    if not arm.six_revolute:
        raise IdentificationError(
            f"the method circles is for arms with six revolute joints, {arm.name} has {arm.joints_listed}"
        )
    axes = measure_axes(points)
    moves = axes.moves
    places_in_tip = _known(known_targets, moves.target_names)
    chain = AxisChain(axes, parallel, tolerance)
    sine = np.linalg.norm(frames.cross(*axes.directions[:2]))
    if sine < NEARLY_PARALLEL:
        raise IdentificationError(
            f"axes 1 and 2 are {np.arcsin(sine) / DEG:.2g} degrees from parallel: they do not give a base frame"
        )
    nominal = _nominal_form(arm)

    def values(p: FloatArray, z: FloatArray) -> dhm.DHMTable:
        robot = _robot(arm, nominal, chain, p, z)
        return _with_tool(robot, moves, places_in_tip)[0].table if places_in_tip else robot.table

    robot, scatter = _robot(arm, nominal, chain, *axes.as_measured()), (np.nan, np.nan)
    if places_in_tip:
        robot, scatter = _with_tool(robot, moves, places_in_tip)
    corrections = _difference(robot.table, nominal)
    _check_arm(arm, corrections)
    std = standard_deviations(axes, values)
    std = unknown(std, np.hypot(std.theta[5], scatter[0]), np.hypot(std.d[5], scatter[1]))
    robot = robot.replace(targets=_targets(robot, moves) | places_in_tip)
    off = moves.xyz - moves.predicted(robot)
    rms = float(np.sqrt(np.mean(np.sum(off**2, axis=1))))
    return AxisCalibration(robot, axes, corrections, std, bool(places_in_tip), parallel, rms)


def _robot(arm: Arm, nominal: dhm.DHMTable, chain: AxisChain, p: FloatArray, z: FloatArray) -> Robot:
    """The robot of measured axes with the nominal first row, ``theta6`` and ``d6``."""
    T_world_1, table = chain.table(p, z, nominal)
    table = with_ends(table, nominal)
    T_world_base = T_world_1 @ frames.inverse(arm.T_base_0 @ table.step(0))
    return Robot(arm.with_table(table), T_world_base=T_world_base)


def _nominal_form(arm: Arm) -> dhm.DHMTable:
    """The nominal arm's table in the form in which measured axes come.

    It is `Arm.table` itself for arms read from a URDF; where parallel axes leave a choice, another one may have been
    made elsewhere. Row 1 and frame 6 are those of the arm.
    """
    chain = dhm.chain_frames(arm.table, arm.table.offsets[:, None], arm.T_base_0)
    table, _, _ = dhm_from_axes(chain.o[:, :, 0], chain.z[:, :, 0], np.eye(4))
    table = with_ends(nearest(table, arm.table), arm.table, 0.0, 0.0)
    joints = np.zeros((1, 6))
    T_6_6 = frames.inverse(dhm.forward(table, joints)[0]) @ dhm.forward(arm.table, joints)[0]
    theta6 = arm.table.theta[5] + frames.wrapped(np.arctan2(T_6_6[1, 0], T_6_6[0, 0]) - arm.table.theta[5])
    table = with_ends(table, arm.table, theta6, T_6_6[2, 3])
    equal = {name: np.abs(getattr(table, name) - getattr(arm.table, name)) < 1e-12 for name in COLUMNS}
    return dhm.DHMTable(*(np.where(equal[n], getattr(arm.table, n), getattr(table, n)) for n in COLUMNS))


def _difference(table: dhm.DHMTable, nominal: dhm.DHMTable) -> dhm.DHMTable:
    """One table minus another; angles in (-pi, pi]."""

    def difference(name: str) -> FloatArray:
        change: FloatArray = getattr(table, name) - getattr(nominal, name)
        return change if name in LENGTHS else frames.wrapped(change)

    alpha, a, theta, d, beta = (difference(name) for name in COLUMNS)
    return dhm.DHMTable(alpha, a, theta, d, beta)


def _check_arm(arm: Arm, corrections: dhm.DHMTable) -> None:
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


def _known(known_targets: Mapping[str, ArrayLike] | None, names: Sequence[str]) -> dict[str, FloatArray]:
    """Known places in the tip link, refused where they are no places or were not measured."""
    xyz_of_target = {name: np.asarray(xyz, dtype=float) for name, xyz in (known_targets or {}).items()}
    for name, position in xyz_of_target.items():
        if name not in names:
            raise IdentificationError(f"known target {name!r} was not measured: found {', '.join(names)}")
        if position.shape != (3,) or not np.isfinite(position).all():
            raise IdentificationError(f"known target {name!r} needs three coordinates, found {position.tolist()}")
    return xyz_of_target


def _with_tool(robot: Robot, moves: PointSet, targets: Mapping[str, FloatArray]) -> tuple[Robot, tuple[float, float]]:
    """The robot with ``theta6`` and ``d6`` from targets known in the tip link, and their scatter (rad, m).

    What Nubiola 2011, section 3.4.3 (eqs. 3.25, 3.26, 3.27, 3.28, 3.29 and 3.30, Figure 3.8) does with one measurement,
    by least squares over all poses.

    In the frame that turns with joint 6 at zero ``theta6`` and ``d6``, a target at ``t`` in frame 6 lies at
    ``Rot(z, theta6) t + d6 z``; turn and shift in closed form.
    """
    moves = moves.take(np.isin(moves.names(), list(targets)))
    xyz = np.array([targets.get(name, np.zeros(3)) for name in moves.target_names])
    t = frames.apply(robot.arm.T_last_tip, xyz)[moves.target]
    square = np.sum(t[:, :2] ** 2, axis=1)
    if len(t) < 2 or square.max() < (1.0 * MM) ** 2:
        raise IdentificationError("all known targets lie on axis 6: theta6 needs one beside it")
    table = with_ends(robot.table, robot.table, 0.0, 0.0)
    T_world_6 = robot.T_world_base @ dhm.forward(table, moves.joints(), robot.arm.T_base_0)
    y = np.einsum("nji,nj->ni", T_world_6[:, :3, :3], moves.xyz - T_world_6[:, :3, 3])
    cross, dot = t[:, 0] * y[:, 1] - t[:, 1] * y[:, 0], t[:, 0] * y[:, 0] + t[:, 1] * y[:, 1]
    theta = np.arctan2(cross.sum(), dot.sum())
    around = (np.cos(theta) * cross - np.sin(theta) * dot)[square > 0] ** 2 / square[square > 0]
    shift = y[:, 2] - t[:, 2]
    theta_variance, d_variance = around.sum() / square.sum() / (len(t) - 1), shift.var(ddof=1) / len(t)
    theta = robot.table.theta[5] + frames.wrapped(theta - robot.table.theta[5])
    table = with_ends(table, table, theta, shift.mean())
    return robot.replace(arm=robot.arm.with_table(table)), (float(np.sqrt(theta_variance)), float(np.sqrt(d_variance)))


def _targets(robot: Robot, moves: PointSet) -> dict[str, FloatArray]:
    """Mean place of each target in the tip link over the poses at hand (Nubiola 2011, eqs. 3.22, 3.23 and 3.24)."""
    T_tip_world = frames.inverse(robot.T_world_base @ robot.poses(moves.q))[moves.pose]
    xyz = np.einsum("nij,nj->ni", T_tip_world[:, :3, :3], moves.xyz) + T_tip_world[:, :3, 3]
    measured = np.unique(moves.target)
    return {moves.target_names[t]: xyz[moves.target == t].mean(axis=0) for t in measured}


@dataclass(frozen=True, eq=False, repr=False)
class BaseOfAxes(Result):
    """The base frame from axes 1 and 2."""

    T_world_base: FloatArray
    """Shape (4, 4). From the base link to the measuring frame, metres."""
    std: FloatArray
    """Shape (6,). Of the place (m) and of the turn about the axes of the measuring frame (rad); NaN where the circles
    leave none.
    """
    angle: float
    distance: float
    """Of axis 2 from axis 1, beyond the nominal one, radians and metres: what the base cannot take."""

    CONTENT = "*pose std_mm=std_of_place std_deg=std_of_turn axis_2_angle_deg=angle axis_2_distance_mm=distance"

    @property
    def pose(self) -> dict[str, float]:
        """Place in millimetres and unit quaternion, scalar first."""
        return dict(poses_to_frame(self.T_world_base[None]).iloc[0])

    @property
    def std_of_place(self) -> FloatArray:
        """Shape (3,), metres."""
        return self.std[:3]

    @property
    def std_of_turn(self) -> FloatArray:
        """Shape (3,), radians."""
        return self.std[3:]

    def report(self) -> Sequence[Paragraph]:
        """Place and turn of the base link in the measuring frame."""
        values = frames.to_xyz_angles(self.T_world_base) / ([MM] * 3 + [DEG] * 3)
        std = self.std / ([MM] * 3 + [DEG] * 3)
        names = ("x mm", "y mm", "z mm", "alpha deg", "beta deg", "gamma deg")
        rows = tuple((n, float(v), float(s)) for n, v, s in zip(names, values, std, strict=True))
        return [
            f"axis 2 from axis 1, beyond the nominal arm: angle {self.angle / DEG:+.4f} degrees, distance "
            f"{self.distance / MM:+.3f} mm",
            Table("Base link in the measuring frame, from axes 1 and 2", ("", "value", "±"), rows, 4),
        ]


@dataclass(frozen=True, eq=False, repr=False)
class ToolOfAxes(Result):
    """Places of the targets on the tool from the last two axes."""

    targets: Mapping[str, FloatArray]
    std: Mapping[str, FloatArray]
    """Values of shape (3,). In the tip link, metres; the standard deviations hold those of the axes and the scatter of
    the points.
    """
    angle: float
    distance: float
    """Of the last axis from the one before, beyond the nominal one, radians and metres."""

    CONTENT = "last_axis_angle_deg=angle last_axis_distance_mm=distance targets=by_target"

    def by_target(self) -> dict[str, dict[str, Any]]:
        """Place of each target, and standard deviations, mm."""
        return {
            name: dict(zip(POSITION, xyz / MM, strict=True)) | {"std_mm": self.std[name] / MM}
            for name, xyz in self.targets.items()
        }

    def report(self) -> Sequence[Paragraph]:
        """Places of the targets."""
        rows: tuple[tuple[TableValue, ...], ...] = tuple(
            (name, *(float(v / MM) for v in xyz), *(float(s / MM) for s in self.std[name]))
            for name, xyz in self.targets.items()
        )
        columns = ("target", "x mm", "y mm", "z mm", "± x", "± y", "± z")
        return [
            f"the last axis from the one before, beyond the nominal arm: angle {self.angle / DEG:+.4f} degrees, "
            f"distance {self.distance / MM:+.3f} mm; the nominal length and turn of the last row are taken",
            Table("Targets in the tip link, from the last two axes", columns, rows),
        ]


def base_of_axes(arm: Arm, points: PointSet) -> BaseOfAxes:
    """The base from axes 1 and 2 alone (Nubiola 2011, section 3.2, Figure 3.3).

    Frame 1 lies on axis 1 where the common normal to axis 2 meets it, its x axis along that normal; the base lies the
    nominal first row before it (eq. 3.10).

    Parameters
    ----------
    arm : Arm
        Nominal arm.
    points : PointSet
        With the groups ``axis1`` and ``axis2``.

    Raises
    ------
    IdentificationError
        If a group is missing or gives no axis, if the axes are nearly parallel or those of another arm.
    """
    _check_turning(arm, (0, 1))
    first, second = one_axis(points, 0), one_axis(points, 1)
    T_before = arm.T_base_0 @ arm.table.step(0)

    def base_from(p: FloatArray, z: FloatArray) -> FloatArray:
        R = frames.rotation_from_one(-second.home[0] * z[0])  # axis 2 back to joint 1 at zero
        p_2, z_2 = p[0] + R @ (p[1] - p[0]), R @ z[1]
        return _on_normal(p[0], z[0], p_2, z_2, arm.table.alpha[1], first=True) @ frames.inverse(T_before)

    def values(p: FloatArray, z: FloatArray) -> FloatArray:
        T = base_from(p, z)
        turn = T[:3, :3] @ T_base[:3, :3].T
        return np.concatenate([T[:3, 3], [turn[2, 1], turn[0, 2], turn[1, 0]]])  # tiny angles only

    p, z = _both(first, second)
    T_base = base_from(p, z)
    angle, distance = _beyond(arm, 1, p, z, frames.rotation_from_one(-second.home[0] * z[0]))
    return BaseOfAxes(T_base, _std((first.fit, second.fit), values), angle, distance)


def tool_of_axes(arm: Arm, points: PointSet) -> ToolOfAxes:
    """The targets in the tip link from the last two axes alone (Nubiola 2011, section 3.4.2, Figures 3.6 and 3.7).

    The x axis lies along the common normal (eqs. 3.20 and 3.21), turn and length of the last row are the nominal ones;
    targets are the mean of their places in that frame over all poses of both groups (eqs. 3.22, 3.23 and 3.24).

    Parameters
    ----------
    arm : Arm
        Nominal arm.
    points : PointSet
        With groups for the last two joints, ``axis5`` and ``axis6`` of six, moved with all joints before at one place.

    Raises
    ------
    IdentificationError
        As `base_of_axes`; also if other joints stand elsewhere in the two groups.
    """
    n = len(arm.joint_names)
    _check_turning(arm, (n - 2, n - 1))
    second_last, last = one_axis(points, n - 2), one_axis(points, n - 1)
    off = second_last.home[: n - 2] - last.home[: n - 2]
    off = np.abs(frames.wrapped(off))
    if off.max(initial=0.0) > STILL:
        k = int(np.argmax(off))
        raise IdentificationError(
            f"groups axis{n - 1} and axis{n}: joint {k + 1} stands {off[k] / DEG:.3g} degrees apart: for the tool both "
            "axes are moved from one pose"
        )
    names, axis_moves = points.target_names, (second_last.moves, last.moves)
    theta, d = arm.table.theta[n - 1], arm.table.d[n - 1]
    T_after = frames.transform(None, [0.0, 0.0, d]) @ arm.T_last_tip

    def targets_in_tip(p: FloatArray, z: FloatArray) -> list[FloatArray]:
        """In the tip link, all points of both groups."""
        N = _on_normal(p[0], z[0], p[1], z[1], arm.table.alpha[n - 1], first=False)
        out = []
        for moves in axis_moves:
            turn = moves.q[:, n - 2] - last.home[n - 2]
            back = frames.rotation_from_vector(-turn[:, None] * z[0])[moves.pose]
            tip_back = np.tile(np.eye(4), (moves.poses, 1, 1))
            tip_back[:, :3, :3] = frames.rotation_from_vector(-(theta + moves.q[:, n - 1])[:, None] * [0.0, 0.0, 1.0])
            tip_back = (frames.inverse(T_after) @ tip_back @ frames.inverse(N))[moves.pose]
            turned_back = p[0] + np.einsum("mij,mj->mi", back, moves.xyz - p[0])
            out.append(np.einsum("mij,mj->mi", tip_back[:, :3, :3], turned_back) + tip_back[:, :3, 3])
        return out

    target = np.concatenate([moves.target for moves in axis_moves])
    used = np.unique(target)

    def means(p: FloatArray, z: FloatArray) -> FloatArray:
        all_places = np.concatenate(targets_in_tip(p, z))
        return np.concatenate([all_places[target == t].mean(axis=0) for t in used])

    p, z = _both(second_last, last)
    all_in_tip = np.concatenate(targets_in_tip(p, z))
    of_axes = _std((second_last.fit, last.fit), means).reshape(-1, 3)
    targets, std = {}, {}
    for k, t in enumerate(used):
        of_target = all_in_tip[target == t]
        scatter = of_target.std(axis=0, ddof=1) / np.sqrt(len(of_target)) if len(of_target) > 1 else np.full(3, np.nan)
        targets[names[t]], std[names[t]] = of_target.mean(axis=0), np.hypot(of_axes[k], scatter)
    angle, distance = _beyond(arm, n - 1, p, z, np.eye(3))
    return ToolOfAxes(targets, std, angle, distance)


def _check_turning(arm: Arm, joints: Sequence[int]) -> None:
    for k in joints:
        if len(arm.joint_names) < 2 or arm.table.prismatic[k]:
            raise IdentificationError(f"joint {k + 1} of {arm.name} does not turn: it draws no circles")


def _both(first: OneAxis, second: OneAxis) -> tuple[FloatArray, FloatArray]:
    """Points (2, 3) on both axes and their directions (2, 3), as measured."""
    return np.array([first.fit.point, second.fit.point]), np.array([first.fit.direction, second.fit.direction])


def _on_normal(
    p_1: FloatArray, z_1: FloatArray, p_2: FloatArray, z_2: FloatArray, alpha: float, first: bool
) -> FloatArray:
    """Frame on the first axis or on the second, its x axis along their common normal, in the sense of a row's alpha."""
    cross = frames.cross(z_1, z_2)
    sine = float(np.linalg.norm(cross))
    if sine < NEARLY_PARALLEL:
        raise IdentificationError(
            f"the axes are {np.arcsin(sine) / DEG:.2g} degrees from parallel: they do not give a frame"
        )
    x = cross / sine * (1.0 if np.sin(alpha) > 0 else -1.0)
    w = p_2 - p_1
    # feet of the common normal: p_1 + s z_1 and p_2 + t z_2
    s, t = (np.dot(frames.cross(w, axis), cross) / sine**2 for axis in (z_2, z_1))
    z, origin = (z_1, p_1 + s * z_1) if first else (z_2, p_2 + t * z_2)
    return frames.transform(np.column_stack([x, frames.cross(z, x), z]), origin)


def _beyond(arm: Arm, row: int, p: FloatArray, z: FloatArray, R: FloatArray) -> tuple[float, float]:
    """Angle and distance of the second axis, turned back by R, from the first, minus the nominal ones; checked."""
    table = arm.table
    p_2, z_2 = p[0] + R @ (p[1] - p[0]), R @ z[1]
    x = _on_normal(p[0], z[0], p_2, z_2, table.alpha[row], first=True)[:3, 0]
    angle = np.arctan2(frames.cross(z[0], z_2) @ x, z[0] @ z_2) - table.alpha[row]
    angle = float(frames.wrapped(angle))
    distance = float((p_2 - p[0]) @ x - table.a[row])
    if abs(angle) > LARGEST_ANGLE or abs(distance) > LARGEST_LENGTH:
        raise IdentificationError(
            f"the measured axes {row} and {row + 1} are not those of {arm.name}: their angle differs by "
            f"{angle / DEG:.0f} degrees, their distance by {distance / MM:.0f} mm; check the robot file, the order and "
            "the sense of the joints"
        )
    return angle, distance


def _std(fits: Sequence[AxisFit], values: Callable[[FloatArray, FloatArray], FloatArray]) -> FloatArray:
    """Standard deviations of values of the axes' points and directions, through central differences."""
    p, z = np.array([fit.point for fit in fits]), np.array([fit.direction for fit in fits])
    variance = np.zeros(np.shape(values(p, z)))
    for k, fit in enumerate(fits):
        slopes = []
        for m in range(4):
            ends = []
            for sign in (1.0, -1.0):
                moved = [p.copy(), z.copy()]
                array = moved[1] if m < 2 else moved[0]
                array[k] += sign * STEP * fit.basis[m % 2]
                if m < 2:
                    array[k] /= np.linalg.norm(array[k])
                ends.append(values(*moved))
            slopes.append((ends[0] - ends[1]) / (2 * STEP))
        J = np.array(slopes)
        variance += np.einsum("m...,mn,n...->...", J, fit.covariance, J)
    return np.sqrt(np.where(np.isfinite(variance), np.maximum(variance, 0.0), np.nan))
