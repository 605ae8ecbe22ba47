"""Direct geometric calibration from the six joint axes (Nubiola 2011, sections 3.1, 3.2 and 3.4).

The axes, brought to zero joints, give the DHM table of links 2 to 6 without iteration
(`irbcal.identification.link_geometry`); the base follows from axes 1 and 2, the tool from axes 5 and 6 or from its
known dimensions. No guess of base or tool is needed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray
from irbcal.errors import IdentificationError
from irbcal.identification.axes import MeasuredAxes, measure_axes
from irbcal.identification.choices import Parallel
from irbcal.identification.link_geometry import (
    COLUMNS,
    PARALLEL,
    AxisChain,
    nearest,
    standard_deviations,
    unknown,
    with_ends,
    wrapped,
)
from irbcal.measurement.points import PointSet
from irbcal.modeling import dhm, frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.extraction import NEARLY_PARALLEL, dhm_from_axes
from irbcal.modeling.robot import Robot
from irbcal.summary import Speaks, Table, Told
from irbcal.units import DEG, MM

if TYPE_CHECKING:
    import pandas as pd

LARGEST_ANGLE, LARGEST_LENGTH = 20.0 * DEG, 100.0 * MM
"""Corrections above these are not those of the robot in the file."""

LENGTHS = ("a", "d")


@dataclass(frozen=True, eq=False, repr=False)
class AxisCalibration(Speaks):
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

    def told(self) -> Sequence[Told]:
        """How well the axes explain the moves, and the correction of each link."""
        tool = "known" if self.tool_known else "unknown"
        headline = (
            f"{self.robot.arm.name} from its six axes: rms {self.rms / MM:.3f} mm over {self.axes.moves.poses} moves "
            f"of one joint, parallel axes {self.parallel}, tool of {tool} dimensions"
        )
        frame = self.to_frame()
        rows = tuple((r.name, r.value, None if np.isnan(r.std) else r.std, r.unit) for r in frame.itertuples())
        return headline, Table("Corrections of the nominal links", ("parameter", "value", "±", "unit"), rows, 4)

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

    Returns
    -------
    AxisCalibration

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
        raise IdentificationError(f"the method circles is for arms with six revolute joints, {arm.name} has others")
    axes = measure_axes(points)
    moves = axes.moves
    known = _known(known_targets, moves.target_names)
    chain = AxisChain(axes, parallel, tolerance)
    sine = np.linalg.norm(np.cross(*axes.directions[:2]))
    if sine < NEARLY_PARALLEL:
        raise IdentificationError(
            f"axes 1 and 2 are {np.arcsin(sine) / DEG:.2g} degrees from parallel: they do not give a base frame"
        )
    nominal = _nominal_form(arm)

    def values(p: FloatArray, z: FloatArray) -> dhm.DHMTable:
        robot = _robot(arm, nominal, chain, p, z)
        return _with_tool(robot, moves, known)[0].table if known else robot.table

    robot, scatter = _robot(arm, nominal, chain, *axes.as_measured()), (np.nan, np.nan)
    if known:
        robot, scatter = _with_tool(robot, moves, known)
    corrections = _difference(robot.table, nominal)
    _check_arm(arm, corrections)
    std = standard_deviations(axes, values)
    std = unknown(std, np.hypot(std.theta[5], scatter[0]), np.hypot(std.d[5], scatter[1]))
    robot = robot.replace(targets=_targets(robot, moves) | known)
    off = moves.xyz - moves.predicted(robot)
    rms = float(np.sqrt(np.mean(np.sum(off**2, axis=1))))
    return AxisCalibration(robot, axes, corrections, std, bool(known), parallel, rms)


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
    theta6 = arm.table.theta[5] + wrapped(np.arctan2(T_6_6[1, 0], T_6_6[0, 0]) - arm.table.theta[5])
    table = with_ends(table, arm.table, theta6, T_6_6[2, 3])
    same = {name: np.abs(getattr(table, name) - getattr(arm.table, name)) < 1e-12 for name in COLUMNS}
    return dhm.DHMTable(*(np.where(same[n], getattr(arm.table, n), getattr(table, n)) for n in COLUMNS))


def _difference(table: dhm.DHMTable, nominal: dhm.DHMTable) -> dhm.DHMTable:
    """One table minus another; angles in (-pi, pi]."""

    def difference(name: str) -> FloatArray:
        change: FloatArray = getattr(table, name) - getattr(nominal, name)
        return change if name in LENGTHS else wrapped(change)

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
    known = {name: np.asarray(place, dtype=float) for name, place in (known_targets or {}).items()}
    for name, place in known.items():
        if name not in names:
            raise IdentificationError(f"known target {name!r} was not measured: found {', '.join(names)}")
        if place.shape != (3,) or not np.isfinite(place).all():
            raise IdentificationError(f"known target {name!r} needs three coordinates, found {place.tolist()}")
    return known


def _with_tool(robot: Robot, moves: PointSet, known: Mapping[str, FloatArray]) -> tuple[Robot, tuple[float, float]]:
    """The robot with ``theta6`` and ``d6`` from targets known in the tip link, and their scatter (rad, m).

    What Nubiola 2011, section 3.4.3 (eqs. 3.25, 3.26, 3.27, 3.28, 3.29 and 3.30, Figure 3.8) does with one measurement,
    by least squares over all poses.

    In the frame that turns with joint 6 at zero ``theta6`` and ``d6``, a target at ``t`` in frame 6 lies at
    ``Rot(z, theta6) t + d6 z``; turn and shift in closed form.
    """
    moves = moves.take(np.isin(moves.names(), list(known)))
    places = np.array([known.get(name, np.zeros(3)) for name in moves.target_names])
    t = frames.apply(robot.arm.T_last_tip, places)[moves.target]
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
    theta = robot.table.theta[5] + wrapped(theta - robot.table.theta[5])
    table = with_ends(table, table, theta, shift.mean())
    return robot.replace(arm=robot.arm.with_table(table)), (float(np.sqrt(theta_variance)), float(np.sqrt(d_variance)))


def _targets(robot: Robot, moves: PointSet) -> dict[str, FloatArray]:
    """Mean place of each target in the tip link over the poses at hand (Nubiola 2011, eqs. 3.22, 3.23 and 3.24)."""
    T_tip_world = frames.inverse(robot.T_world_base @ robot.poses(moves.q))[moves.pose]
    places = np.einsum("nij,nj->ni", T_tip_world[:, :3, :3], moves.xyz) + T_tip_world[:, :3, 3]
    seen = np.unique(moves.target)
    return {moves.target_names[t]: places[moves.target == t].mean(axis=0) for t in seen}
