"""ISO 9283:1998: sampled paths, static compliance, and the door to all its tests and to the plan of the test poses.

The formulas are those of public descriptions of the standard (such as Nubiola 2011, annex I and section 7.7.3.4); the
standard itself was not at hand.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, IntArray, Locked
from irbcal.errors import MeasurementError, OptionError
from irbcal.io.opening import CalibrationLike, open_calibration, open_robot
from irbcal.measurement import table
from irbcal.measurement.column_names import POSITION
from irbcal.measurement.input_table import InputTable, TableLike, distinct
from irbcal.measurement.table import MeasurementsLike
from irbcal.modeling import frames
from irbcal.modeling.arm import Arm
from irbcal.modeling.robot import Robot
from irbcal.option_values import length, number, point_in_metres
from irbcal.plotting.charts import (
    DASHED,
    DOT,
    TALL,
    WIDE,
    Chart,
    Drawing,
    LegendEntry,
    Panel,
    axis_top,
    check_name,
    span,
)
from irbcal.summary import Content, Paragraph, Result, Table, simulated_mark
from irbcal.units import DEG, MM
from irbcal.validation.pose_check import (
    FRACTION,
    NO_ORIENTATION,
    PLANES,
    SET_SIZE,
    CubePlane,
    FivePoses,
    PoseCheck,
    check_poses,
    five_poses,
)
from irbcal.validation.pose_criteria import ANGLES, AXES, small_angles
from irbcal.validation.settling import REST, PosingTimes, Settling, posing_times, settle

if TYPE_CHECKING:
    import pandas as pd


CENTRAL = (0.25, 0.75)
"""Part of the commanded path, as shares of its length, on which velocities are judged."""

BLOCK = 2_000_000
"""Numbers that are worked on at a time."""


@dataclass(frozen=True, eq=False)
class PathVelocity(Content):
    """Velocities of several cycles along one path."""

    CONTENT = "commanded_mm_s mean_mm_s=mean.mean AV_percent RV_percent FV_mm_s means_mm_s=mean"

    mean: FloatArray
    lowest: FloatArray
    highest: FloatArray
    """Shape (cycles,). Of each cycle's velocities, m/s."""
    commanded: float | None
    """Commanded velocity, m/s."""

    @property
    def AV(self) -> float | None:
        """Velocity accuracy: mean over the cycles against the commanded one, a share of it; None without a command."""
        return None if self.commanded is None else float(self.mean.mean() / self.commanded - 1.0)

    @property
    def RV(self) -> float | None:
        """Velocity repeatability: 3 S of the cycles' means (n - 1), a share of the commanded one; None without it."""
        return None if self.commanded is None else float(3 * self.mean.std(ddof=1) / self.commanded)

    @property
    def FV(self) -> float:
        """Velocity fluctuation: largest difference of highest and lowest velocity in a cycle, m/s."""
        return float((self.highest - self.lowest).max())


def path_velocity(
    times: Sequence[FloatArray],
    paths: Sequence[FloatArray],
    commanded: FloatArray,
    velocity: float | None = None,
    window: float = 0.0,
) -> PathVelocity:
    """Velocities on the middle half of a path.

    Parameters
    ----------
    times : sequence of ndarray, shape (k,)
        Of the samples, seconds, ascending.
    paths : sequence of ndarray, shape (k, 3)
        Samples of each cycle, in order, metres.
    commanded : ndarray, shape (m, 3)
        Points of the commanded path, metres.
    velocity : float, optional
        Commanded velocity, m/s.
    window : float
        Velocities are slopes of straight lines through the samples of so many seconds; 0: between neighbours. Noise of
        the samples counts in full in the fluctuation: 0.02 mm at 1 kHz are some 30 mm/s between neighbours.

    Raises
    ------
    MeasurementError
        If there are fewer than two cycles or a cycle has fewer than two velocities there.
    """
    if len(paths) < 2:
        raise MeasurementError("velocity accuracy and repeatability need two cycles or more")
    speeds = []
    for cycle_number, (time, path) in enumerate(zip(times, paths, strict=True), 1):
        share = way_along(path, commanded)
        if window > 0:
            speed = _slopes(time, path, window)
        else:
            speed = np.linalg.norm(np.diff(path, axis=0), axis=1) / np.diff(time)
            share = 0.5 * (share[1:] + share[:-1])
        speed = speed[(share >= CENTRAL[0]) & (share <= CENTRAL[1]) & np.isfinite(speed)]
        if len(speed) < 2:
            raise MeasurementError(f"cycle {cycle_number} has fewer than two velocities on the middle half of the path")
        speeds.append((speed.mean(), speed.min(), speed.max()))
    mean, lowest, highest = np.array(speeds).T
    return PathVelocity(mean, lowest, highest, velocity)


def way_along(path: FloatArray, commanded: FloatArray) -> FloatArray:
    """Where on a commanded path samples are nearest to it, shape (k,): share of its length."""
    start, step = commanded[:-1], np.diff(commanded, axis=0)
    size = np.sum(step**2, axis=1)
    length = np.sqrt(size)
    start_length = np.concatenate([[0.0], np.cumsum(length)])
    out = np.empty(len(path))
    rows = max(1, BLOCK // len(step))
    for first in range(0, len(path), rows):
        block = path[first : first + rows]
        t = np.clip(np.einsum("kmj,mj->km", block[:, None] - start, step) / np.maximum(size, 1e-300), 0.0, 1.0)
        off = np.linalg.norm(block[:, None] - start - t[..., None] * step, axis=2)
        best = np.argmin(off, axis=1)
        out[first : first + rows] = start_length[best] + t[np.arange(len(block)), best] * length[best]
    return out / start_length[-1]


def _slopes(time: FloatArray, path: FloatArray, window: float) -> FloatArray:
    """Velocity at each sample by the straight line through those around it, m/s; NaN where there is no other."""
    t, p = time - time.mean(), path - path.mean(axis=0)
    low = np.searchsorted(time, time - 0.5 * window)
    high = np.searchsorted(time, time + 0.5 * window, side="right")

    def total(values: FloatArray) -> FloatArray:
        sums = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
        return np.asarray(sums[high] - sums[low])

    n, st = (high - low).astype(float), total(t)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = (total(t[:, None] * p) - st[:, None] * total(p) / n[:, None]) / (total(t * t) - st**2 / n)[:, None]
    return np.where(n > 1, np.linalg.norm(slope, axis=1), np.nan)


@dataclass(frozen=True, eq=False)
class PathErrors(Locked):
    """Errors of a path on planes normal to the commanded one."""

    mean: FloatArray
    """Shape (m, 3). Barycentre of the cycles on each plane minus the commanded point, metres."""
    repeatability: FloatArray
    """Shape (m,). ``mean(l) + 3 S_l`` on each plane, metres."""
    mean_angles: FloatArray | None
    angle_repeatability: FloatArray | None
    """Shape (m, 3). Mean angles and 3 S of the angles, radians."""
    planes: IntArray
    """Shape (m,). Commanded points whose planes all cycles cross."""

    @property
    def AT(self) -> float:
        """Path accuracy: largest distance of the mean path from the commanded one, metres."""
        return float(np.linalg.norm(self.mean, axis=1).max())

    @property
    def RT(self) -> float:
        """Path repeatability: largest over the planes, metres."""
        return float(self.repeatability.max())


def path_errors(
    paths: Sequence[FloatArray],
    commanded: FloatArray,
    rotations: Sequence[FloatArray] | None = None,
    commanded_rotations: FloatArray | None = None,
) -> PathErrors:
    """Path accuracy AT and repeatability RT from sampled paths.

    Each cycle's path is taken as straight between its samples and cut by the planes normal to the commanded path; of
    several cuts the one nearest to the commanded point counts. Planes that not every cycle crosses (at the ends) are
    left out.

    Parameters
    ----------
    paths : sequence of ndarray, shape (k, 3)
        Samples of each cycle, in order, metres.
    commanded : ndarray, shape (m, 3)
        Points of the commanded path, in order, metres.
    rotations : sequence of ndarray, shape (k, 3, 3), optional
    commanded_rotations : ndarray, shape (m, 3, 3), optional

    Raises
    ------
    MeasurementError
        If there are fewer than two cycles, or no plane is crossed by all.
    """
    if len(paths) < 2:
        raise MeasurementError("path accuracy and repeatability need two cycles or more")
    along = _directions(commanded)
    segments, shares = zip(*(_cuts(path, commanded, along) for path in paths), strict=True)
    cuts = np.array([_between(*cut) for cut in zip(paths, segments, shares, strict=True)])
    planes = np.flatnonzero(np.isfinite(cuts).all(axis=(0, 2)))
    if not len(planes):
        raise MeasurementError("no plane normal to the commanded path is crossed by every cycle")
    cuts = cuts[:, planes]
    mean = cuts.mean(axis=0)
    distance = np.linalg.norm(cuts - mean, axis=2)
    angles = None
    if rotations is not None and commanded_rotations is not None:
        turned = zip(rotations, segments, shares, strict=True)
        angles = np.array([_angles_between(*cut, commanded_rotations)[planes] for cut in turned])
    return PathErrors(
        mean - commanded[planes],
        distance.mean(axis=0) + 3 * distance.std(axis=0, ddof=1),
        None if angles is None else angles.mean(axis=0),
        None if angles is None else 3 * angles.std(axis=0, ddof=1),
        planes,
    )


def _directions(commanded: FloatArray) -> FloatArray:
    """Unit vectors along a path, shape (m, 3)."""
    along = np.gradient(commanded, axis=0)
    length = np.linalg.norm(along, axis=1)
    if (length == 0).any():
        raise MeasurementError("the commanded path has points that do not move on")
    return along / length[:, None]


def _cuts(path: FloatArray, commanded: FloatArray, along: FloatArray) -> tuple[IntArray, FloatArray]:
    """Segment of a path that cuts each plane (-1 for none), and where on it."""
    at, share = np.full(len(commanded), -1), np.full(len(commanded), np.nan)
    step = max(1, BLOCK // len(path))
    for start in range(0, len(commanded), step):
        block = slice(start, start + step)
        # height (planes, samples) above each plane
        height = along[block] @ path.T - np.sum(along[block] * commanded[block], axis=1)[:, None]
        low, high = height[:, :-1], height[:, 1:]
        crossed = (low * high <= 0) & (low != high)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = np.where(crossed, low / (low - high), 0.0)
        cut = path[:-1] + t[..., None] * (path[1:] - path[:-1])
        far = np.where(crossed, np.linalg.norm(cut - commanded[block][:, None], axis=2), np.inf)
        best = np.argmin(far, axis=1)
        rows = np.arange(len(best))
        is_cut = np.isfinite(far[rows, best])
        at[block] = np.where(is_cut, best, -1)
        share[block] = np.where(is_cut, t[rows, best], np.nan)
    return at, share


def _between(path: FloatArray, at: IntArray, share: FloatArray) -> FloatArray:
    """Places of the cuts, shape (m, 3); NaN for none."""
    start = np.maximum(at, 0)
    cut = path[start] + share[:, None] * (path[start + 1] - path[start])
    return np.where(at[:, None] >= 0, cut, np.nan)


def _angles_between(rotations: FloatArray, at: IntArray, share: FloatArray, commanded: FloatArray) -> FloatArray:
    """Angles from the commanded orientation at the cuts, on the line between those of two samples, shape (m, 3)."""
    first, second = (small_angles(rotations[np.maximum(at, 0) + k], commanded) for k in (0, 1))
    return np.where(at[:, None] >= 0, first + share[:, None] * (second - first), np.nan)


SHARP = 40.0 * DEG
"""Turn of the commanded path at one of its points that makes it a corner; less belongs to a curve told by points."""

STRAIGHT = 1.0 * DEG
"""A leg after a corner goes on as long as the commanded path turns less than this from its first direction."""


@dataclass(frozen=True, eq=False)
class Corner(Content):
    """How the cycles go round one corner of the commanded path."""

    CONTENT = "distance_mm turn_deg CR_mm CO_mm round_off_mm overshoot_mm"

    position: FloatArray
    """Shape (3,). Commanded, metres."""
    distance: float
    """Of the corner on the commanded path, metres."""
    turn: float
    """Of the commanded path, radians."""
    round_off: FloatArray
    """Shape (cycles,). Smallest distance of each cycle's path from the corner, metres."""
    overshoot: FloatArray
    """Shape (cycles,). Largest distance from the second leg after the corner was passed, on the side to which the first
    leg points; 0 where the path does not go there; metres.
    """

    @property
    def CR(self) -> float:
        """Corner round-off: largest over the cycles, metres."""
        return float(self.round_off.max())

    @property
    def CO(self) -> float:
        """Cornering overshoot: largest over the cycles, metres."""
        return float(self.overshoot.max())


def cornering(paths: Sequence[FloatArray], commanded: FloatArray) -> tuple[Corner, ...]:
    """Round-off and overshoot at each corner of the commanded path.

    Paths are taken as straight between their samples. The overshoot is looked for from the sample nearest to the corner
    until the middle of the second leg is reached.

    Parameters
    ----------
    paths : sequence of ndarray, shape (k, 3)
        Samples of each cycle, in order, metres.
    commanded : ndarray, shape (m, 3)
        Points of the commanded path, in order, metres.

    Returns
    -------
    tuple of Corner
        In the order of the path; empty where it has no corner.
    """
    steps = np.diff(commanded, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    along = steps / lengths[:, None]
    turn = np.arccos(np.clip(np.sum(along[1:] * along[:-1], axis=1), -1.0, 1.0))
    length = np.cumsum(lengths)
    out = []
    for k in np.flatnonzero(turn > SHARP):
        first, second, corner = along[k], along[k + 1], commanded[k + 1]
        straight = np.sum(along[k + 1 :] * second, axis=1) > np.cos(STRAIGHT)
        leg = float(lengths[k + 1 :][np.cumprod(straight).astype(bool)].sum())
        errors = [(_nearest(path, corner), _overshoot(path, corner, first, second, leg)) for path in paths]
        round_off, overshoot = np.array(errors).T
        out.append(Corner(corner, float(length[k]), float(turn[k]), round_off, overshoot))
    return tuple(out)


def _nearest(path: FloatArray, corner: FloatArray) -> float:
    """Smallest distance of a polyline from a place."""
    start, step = path[:-1] - corner, np.diff(path, axis=0)
    size = np.maximum(np.sum(step**2, axis=1), 1e-300)
    t = np.clip(-np.sum(start * step, axis=1) / size, 0.0, 1.0)
    return float(np.linalg.norm(start + t[:, None] * step, axis=1).min())


def _overshoot(path: FloatArray, corner: FloatArray, first: FloatArray, second: FloatArray, leg: float) -> float:
    """Largest distance from the second leg beyond the corner."""
    arms = path - corner
    arms = arms[int(np.argmin(np.linalg.norm(arms, axis=1))) :]
    forward = arms @ second
    passed = np.flatnonzero(forward > 0.5 * leg)
    arms, forward = (array[: passed[0] if len(passed) else None] for array in (arms, forward))
    beside = arms - forward[:, None] * second
    beyond = beside @ (first - (first @ second) * second) > 0
    return float(np.linalg.norm(beside[beyond], axis=1).max(initial=0.0))


@dataclass(frozen=True, eq=False, repr=False)
class PathCheck(Result):
    """Accuracy, repeatability, velocity and corners of sampled paths."""

    errors: PathErrors
    """On the planes that all cycles cross."""
    along: FloatArray
    """Shape (m,). Way of these planes on the commanded path, metres."""
    cycles: int
    planes_of: int
    """Points of the commanded path."""
    velocity: PathVelocity | None = None
    """None where the samples have no times."""
    corners: tuple[Corner, ...] = ()
    """Of the commanded path."""
    simulated: bool = False

    COLUMNS = "along_mm mean_error_mm repeatability_mm=errors.repeatability"
    CONTENT = (
        "AT_mm=errors.AT RT_mm=errors.RT planes=errors.planes.__len__ planes_of cycles *of_angles velocity corners "
        f"{COLUMNS} simulated"
    )

    @property
    def of_angles(self) -> dict[str, float]:
        """``AT_a_deg`` to ``RT_c_deg``, the largest of the planes; empty without orientations."""
        e, out = self.errors, {}
        if e.mean_angles is not None and e.angle_repeatability is not None:
            for k, a in enumerate(ANGLES):
                out[f"AT_{a}_deg"] = float(np.abs(e.mean_angles[:, k]).max() / DEG)
                out[f"RT_{a}_deg"] = float(e.angle_repeatability[:, k].max() / DEG)
        return out

    @property
    def mean_error(self) -> FloatArray:
        """Distance of the mean path from the commanded one on each plane, shape (m,), metres."""
        return np.linalg.norm(self.errors.mean, axis=1)

    def report(self) -> Sequence[Paragraph]:
        """AT and RT, of orientations too where they were measured; velocities and corners."""
        values = self.to_dict()
        out: list[Paragraph] = [
            f"{simulated_mark(self.simulated)}Path: AT {values['AT_mm']:.3f} mm, RT {values['RT_mm']:.3f} mm "
            f"({values['cycles']} cycles, {values['planes']} of {values['planes_of']} planes)"
        ]
        if "AT_a_deg" in values:
            angles = [f"AT_{a} {values[f'AT_{a}_deg']:.4f}, RT_{a} {values[f'RT_{a}_deg']:.4f}" for a in ANGLES]
            out.append(f"Orientation, degrees: {'; '.join(angles)}")
        if self.velocity is not None:
            v = values["velocity"]
            accuracy = "" if v["AV_percent"] is None else f"AV {v['AV_percent']:+.2f} %, RV ±{v['RV_percent']:.2f} %, "
            out.append(
                f"Velocity on the middle half: {accuracy}FV {v['FV_mm_s']:.2f} mm/s, mean {v['mean_mm_s']:.2f} mm/s"
            )
        if self.corners:
            rows = tuple(
                (k, c.distance / MM, c.turn / DEG, c.CR / MM, c.CO / MM) for k, c in enumerate(self.corners, 1)
            )
            columns = ("corner", "way mm", "turn deg", "CR mm", "CO mm")
            out.append(Table("Corners: round-off CR and overshoot CO, largest of the cycles", columns, rows))
        return out

    def plot(self) -> Chart:
        """Path accuracy and repeatability on the planes along the path."""
        along, errors = self.along / MM, self.errors
        mean, spread = self.mean_error / MM, errors.repeatability / MM
        drawing = Drawing("Path accuracy and repeatability", TALL, WIDE)
        panel = Panel(
            drawing, span(along), (0.0, axis_top(mean, spread)), "way on the commanded path (mm)", "distance (mm)"
        )
        panel.line(along, mean, "measured")
        panel.line(along, spread, "accent", dash=DASHED)
        legend: list[LegendEntry] = [
            ("measured", "-", f"mean path, AT = {errors.AT / MM:.3f}"),
            ("accent", "--", f"mean(l) + 3 S, RT = {errors.RT / MM:.3f}"),
        ]
        for corner in self.corners:
            panel.upright(corner.distance / MM, dash="4 2")
        if self.corners:
            legend.append(("soft", "--", "corners"))
        caption = "Path accuracy and repeatability on the planes along the path"
        return Chart("path", caption, [drawing], legend).marked(self.simulated)


def path_accuracy(
    path: TableLike,
    commanded_path: TableLike,
    *,
    velocity: float | None = None,
    window: float = 0.0,
    robot: Robot | None = None,
    target: str | None = None,
) -> PathCheck:
    """Accuracy, repeatability, velocity and corners from a file of sampled paths.

    Parameters
    ----------
    path, commanded_path, velocity, window
        As `iso9283`; with a robot the commanded path is in its base link.
    robot : Robot, optional
        Knows where its base link stands in the measuring frame; everything is then told in the base link.
    target : str, optional
        Of the robot: the commanded path is that of the tip, with orientations, and this reflector was measured.
        Without, what was measured is what was commanded.

    Raises
    ------
    MeasurementError
        If a file does not keep the format or the paths do not fit.
    OptionError
        If a velocity is given without times, or there is no such target.
    """
    table, commanded = InputTable.read(path, ["cycle"]).measured(), InputTable.read(commanded_path).measured()
    if len(commanded) < 3:
        raise commanded.fault(f"a commanded path needs three points or more, found {len(commanded)}")
    position, turn, cycle = table.si(POSITION), table.rotations(), table.filled("cycle")
    rows = [np.flatnonzero(cycle == name) for name in distinct(cycle)]
    short = [k for k in rows if len(k) < 2]
    if short:
        raise table.fault("a path needs two samples in each cycle", int(short[0][0]))
    if robot is not None:
        T = frames.inverse(robot.T_world_base)
        position, turn = frames.apply(T, position), None if turn is None else T[:3, :3] @ turn
    meant, wanted_turn = _commanded_poses(commanded, robot, target)
    times = [table[k].ascending("time_s") for k in rows] if "time_s" in table else None
    if velocity is not None and times is None:
        raise OptionError(
            f"velocity: the velocity takes the column time_s, {table.source} has none", parameter="velocity"
        )
    paths = [position[k] for k in rows]
    try:
        errors = path_errors(paths, meant, None if turn is None else [turn[k] for k in rows], wanted_turn)
        speeds = None if times is None else path_velocity(times, paths, meant, velocity, window)
    except MeasurementError as error:
        raise table.fault(str(error)) from None
    length = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(meant, axis=0), axis=1))])
    return PathCheck(
        errors,
        length[errors.planes],
        len(rows),
        len(commanded),
        speeds,
        cornering(paths, meant),
        table.simulated or commanded.simulated,
    )


def _commanded_poses(
    commanded: InputTable, robot: Robot | None, target: str | None
) -> tuple[FloatArray, FloatArray | None]:
    """Commanded places and orientations of what was measured."""
    position, turn = commanded.si(POSITION), commanded.rotations()
    if target is None:
        return position, turn
    targets: Mapping[str, FloatArray] = {} if robot is None else robot.targets
    if robot is None or target not in targets:
        hint = f"the calibration knows {', '.join(targets)}" if targets else "give a calibration that knows it"
        raise OptionError(f"target: there is no target {target}: {hint}", parameter="target")
    if turn is None:
        raise commanded.header_fault(NO_ORIENTATION)
    on_tip = robot.target_rotations.get(target)
    return position + turn @ targets[target], None if on_tip is None else turn @ on_tip


DIRECTIONS = tuple(f"{sign}{axis}" for axis in AXES for sign in "+-")
"""Names of directions of force."""


@dataclass(frozen=True, eq=False)
class Compliance(Locked):
    """What forces in one direction do."""

    per_newton: FloatArray
    """Shape (cycles, 3). Slope of the displacement over the force, by least squares with the unloaded place free, m/N.
    """
    force: FloatArray
    """Shape (n,). Of all readings, newtons."""
    displacement: FloatArray
    """Shape (n, 3). From the unloaded place of its cycle, metres."""
    direction: FloatArray
    """Shape (3,). Of the force."""

    @property
    def along(self) -> float:
        """Compliance in the direction of the force, mean of the cycles, m/N."""
        return float(self.per_newton.mean(axis=0) @ self.direction)

    @property
    def across(self) -> float:
        """Compliance across the force, mean of the cycles, m/N."""
        mean = self.per_newton.mean(axis=0)
        return float(np.linalg.norm(mean - (mean @ self.direction) * self.direction))

    @property
    def spread(self) -> float:
        """Half the range of the cycles' compliances along the force, m/N."""
        return float(np.ptp(self.per_newton @ self.direction) / 2)

    @property
    def largest_force(self) -> float:
        """Newtons."""
        return float(self.force.max())

    @property
    def displacement_at_largest(self) -> float:
        """Along the largest force, mean of its readings, metres."""
        return float((self.displacement[self.force == self.largest_force] @ self.direction).mean())


@dataclass(frozen=True, eq=False, repr=False)
class StaticCompliance(Result):
    """Compliance along and against the axes of a frame."""

    frame: str
    """``base link``, or ``measuring frame`` without a calibration."""
    directions: dict[str, Compliance]
    """``+x``, ``-x``, ``+y``, …"""
    simulated: bool

    CONTENT = "frame directions=to_frame simulated"
    ROWS = "directions"
    COLUMNS = (
        "direction cycles=per_newton.__len__ along_mm_per_n half_range_mm_per_n=spread across_mm_per_n "
        "largest_n=largest_force displacement_mm=displacement_at_largest"
    )

    def report(self) -> Sequence[Paragraph]:
        """The softest direction, and the compliance direction by direction."""
        columns = ("force", "cycles", "along mm/N", "±", "across mm/N", "largest N", "moves mm")
        name, worst = max(self.directions.items(), key=lambda entry: entry[1].along)
        start = simulated_mark(self.simulated)
        title = f"{start}Static compliance, axes of the {self.frame}"
        headline = f"{start}static compliance up to {worst.along / MM:.5f} mm/N ({name})"
        return [headline, Table.from_frame(title, self.to_frame(), columns, 5)]

    def plot(self) -> Chart:
        """Displacement along the force over the force, with the fitted slopes."""
        along = {name: d.displacement @ d.direction / MM for name, d in self.directions.items()}
        slopes = {name: d.along / MM for name, d in self.directions.items()}
        ends = {name: np.array([0.0, d.force.max()]) for name, d in self.directions.items()}
        drawing = Drawing("Displacement over force", TALL, WIDE)
        x_label, y_label = f"force along the axes of the {self.frame} (N)", "displacement along the force (mm)"
        y = span(*along.values(), *(ends[name] * slope for name, slope in slopes.items()))
        panel = Panel(drawing, (0.0, axis_top(*ends.values())), y, x_label, y_label)
        legend: list[LegendEntry] = []
        for k, (name, direction) in enumerate(self.directions.items()):
            colour = f"series{k % 5}"
            panel.dots(direction.force, along[name], colour, DOT)
            panel.line(ends[name], ends[name] * slopes[name], colour)
            legend.append((colour, "-", f"{name}: {slopes[name]:.5f} mm/N"))
        return Chart("compliance", "Displacement along the force", [drawing], legend).marked(self.simulated)


def static_compliance(forces: TableLike, R_frame_world: FloatArray | None = None) -> StaticCompliance:
    """Static compliance from a file of loaded and unloaded places.

    Parameters
    ----------
    forces : str, Path or DataFrame
        Columns ``direction`` (``+x``, ``-x``, ``+y``, …), ``force_n`` (not negative; 0 is the unloaded place),
        ``x_mm``, ``y_mm``, ``z_mm``, optional ``cycle``.
    R_frame_world : ndarray, shape (3, 3), optional
        Takes directions of the measuring frame to the frame along whose axes the forces act, the base link.

    Raises
    ------
    MeasurementError
        If the file does not keep the format or a direction has fewer than two different forces in a cycle.
    """
    table = InputTable.read(forces, ["direction", "force_n"]).measured()
    xyz, force = table.si(POSITION), table.si("force_n")
    xyz = xyz if R_frame_world is None else xyz @ R_frame_world.T
    directions, cycle = table.choice("direction", DIRECTIONS), table.texts("cycle")
    table.refuse(force < 0, "force_n", "a force that is not negative: the direction has the sign")
    out = {}
    for name in distinct(directions):
        slopes, loads, moved = [], [], []
        for c in distinct(cycle[directions == name]):
            rows = (directions == name) & (cycle == c)
            f, p = force[rows], xyz[rows]
            if np.ptp(f) == 0:
                subject = f"direction {name}{f' of cycle {c}' if c else ''}"
                sentence = f"{subject} has one force only: compliance needs two, 0 for the unloaded place"
                raise table.fault(sentence, int(np.argmax(rows)), "force_n")
            off = f - f.mean()
            slope = off @ p / (off @ off)
            slopes.append(slope)
            loads.append(f)
            moved.append(p - (p.mean(axis=0) - f.mean() * slope))
        direction = np.eye(3)[AXES.index(name[1])] * (1.0 if name[0] == "+" else -1.0)
        out[name] = Compliance(np.array(slopes), np.concatenate(loads), np.concatenate(moved), direction)
    frame = "measuring frame" if R_frame_world is None else "base link"
    return StaticCompliance(frame, out, table.simulated)


@dataclass(frozen=True, eq=False, repr=False)
class Iso9283(Result):
    """What the tests of ISO 9283 came to; None for tests that were not made."""

    poses: PoseCheck | None
    stabilisation: Settling | None
    path: PathCheck | None
    posing: PosingTimes | None = None
    compliance: StaticCompliance | None = None

    def _present_checks(self) -> list[PoseCheck | Settling | PathCheck | PosingTimes | StaticCompliance]:
        checks = (self.poses, self.stabilisation, self.path, self.posing, self.compliance)
        return [check for check in checks if check is not None]

    def report(self) -> Sequence[Paragraph]:
        """What each of the tests has to say."""
        return [line for check in self._present_checks() for line in check.report()]

    CONTENT = "poses stabilisation=settled path posing compliance"

    def settled(self) -> dict[str, Any] | None:
        """`stabilisation` without what it is called."""
        content = None if self.stabilisation is None else self.stabilisation.to_dict()
        return content and {name: value for name, value in content.items() if name != "check"}

    def to_frame(self) -> pd.DataFrame:
        """The table of the first test that was made, in the order of the attributes."""
        return self._present_checks()[0].to_frame()

    def plots(self) -> dict[str, Chart]:
        """All figures, by ``drift`` and the names of the attributes; only what was measured.

        Raises
        ------
        MeasurementError
            If only directions of approach were measured.
        """
        charts = {}
        if self.poses is not None and self.poses.has_cycles:
            charts["poses"] = self.poses.plot()
        if self.poses is not None and self.poses.has_drift:
            charts["drift"] = self.poses.plot_drift()
        for name in ("stabilisation", "path", "posing", "compliance"):
            check: Settling | PathCheck | PosingTimes | StaticCompliance | None = getattr(self, name)
            if check is not None:
                charts[name] = check.plot()
        if not charts:
            raise MeasurementError("there is nothing to draw: only directions of approach were measured")
        return charts

    def plot(self) -> Chart:
        """The first of `plots`."""
        return next(iter(self.plots().values()))

    def save_plots(self, path: str | PathLike[str]) -> list[Path]:
        """Write all figures: the first as ``path`` says, the others with their names added to it.

        Raises
        ------
        IrbcalError
            If the ending is not that of a figure, or a file cannot be written.
        """
        path = check_name(path)
        return [
            chart.save(path if k == 0 else path.with_stem(f"{path.stem}-{name}"))
            for k, (name, chart) in enumerate(self.plots().items())
        ]


def iso9283(
    measurements: MeasurementsLike | None = None,
    *,
    calibration: CalibrationLike | None = None,
    commanded: TableLike | None = None,
    target: str | None = None,
    set_size: int = SET_SIZE,
    approaches: TableLike | None = None,
    band: float | None = None,
    rest: float = REST,
    path: TableLike | None = None,
    commanded_path: TableLike | None = None,
    velocity: float | None = None,
    window: float = 0.0,
    moves: TableLike | None = None,
    forces: TableLike | None = None,
) -> Iso9283:
    """Accuracy, repeatability, drift, settling, path velocity, corners, posing time, compliance, after ISO 9283:1998.

    The files are told in docs/files.md.

    Parameters
    ----------
    measurements : str, Path, DataFrame or MeasurementSet, optional
        With the columns ``pose`` (P1 to P5, or any names) and ``cycle``; rows with a ``direction`` are those of the
        multi-directional variation, rows of the group ``iso9283_drift`` those of the drift test.
    calibration : str, Path or loaded calibration, optional
        Gives the commanded poses at the measurements' joints, by the nominal and by the calibrated robot; and its base
        link, in which the commanded path then stands and along whose axes forces act.
    commanded : str, Path or DataFrame, optional
        Commanded poses: ``pose,x_mm,y_mm,z_mm`` and for orientations ``qw,qx,qy,qz``. With a calibration, poses of the
        tip in the base link; without, places of what was measured in the measuring frame.
    target : str, optional
        Regard the position of this reflector; by default the tip, where poses were measured as a whole. Of a path: the
        commanded one is that of the tip, with orientations, and this reflector was measured.
    set_size : int
        Cycles of a set of the drift test, two or more.
    approaches : str, Path or DataFrame, optional
        Time series of approaches to a pose: ``time_s,x_mm,y_mm,z_mm`` and, for several, ``run``.
    band : float, optional
        Limit band of stabilisation and posing time, metres; by default RP of P1, else of the first pose.
    rest : float
        Seconds after which the robot is at rest.
    path, commanded_path : str, Path or DataFrame, optional
        Sampled paths, ``cycle,x_mm,y_mm,z_mm``, for velocities ``time_s`` and for orientations ``qw,qx,qy,qz``, and the
        points of the commanded path: in the same frame, with a calibration in the base link; both or neither.
    velocity : float, optional
        Commanded velocity of the path, metres a second.
    window : float
        Velocities are slopes through the samples of so many seconds; 0: between neighbours.
    moves : str, Path or DataFrame, optional
        Moves from rest to rest: ``move,time_s,x_mm,y_mm,z_mm`` and, for several, ``cycle``.
    forces : str, Path or DataFrame, optional
        Places under load: ``direction`` (+x, -x, …), ``force_n``, ``x_mm,y_mm,z_mm`` and, for several, ``cycle``.

    Raises
    ------
    OptionError
        If there is nothing to judge, a path lacks its commanded points, or there is no limit band to take.
    MeasurementError
        If a file does not keep the format or holds too little.
    """
    if (path is None) != (commanded_path is None):
        raise OptionError("a path needs its commanded points, and they a path", parameter="path")
    if all(source is None for source in (measurements, approaches, path, moves, forces)):
        raise OptionError("give measurements, approaches, a path, moves or forces", parameter="measurements")
    if velocity is not None and not velocity > 0:
        raise OptionError(f"velocity: expected a number above zero, found {velocity:g}", parameter="velocity")
    if (velocity is not None or window) and path is None:
        raise OptionError("a velocity is that of a path: give one", parameter="path")
    if set_size < 2:
        raise OptionError(f"a set of the drift test has two cycles or more, found {set_size}", parameter="set_size")
    number("window", window, 0)
    poses = settled = None
    saved = None if calibration is None else open_calibration(calibration)
    if measurements is not None:
        measured = table.read(measurements)
        if saved is not None:
            measured = measured.of_arm(saved.arm())
        poses = check_poses(measured, saved, commanded, target, set_size)
    if band is None and (approaches is not None or moves is not None):
        band = None if poses is None else poses.default_band()
        if band is None:
            raise OptionError("there is no repeatability of P1 to take: give a limit band", parameter="band")
    if approaches is not None and band is not None:
        settled = settle(approaches, band, rest)
    robot = None if saved is None else saved.robot_calibrated()
    sampled = posing = compliance = None
    if path is not None and commanded_path is not None:
        on = target if measurements is None or robot is not None else None
        sampled = path_accuracy(path, commanded_path, velocity=velocity, window=window, robot=robot, target=on)
    if moves is not None and band is not None:
        posing = posing_times(moves, band)
    if forces is not None:
        compliance = static_compliance(forces, None if robot is None else robot.T_world_base[:3, :3].T)
    simulated = saved is not None and saved.simulated
    if sampled is not None and simulated:
        sampled = replace(sampled, simulated=True)
    if compliance is not None and simulated:
        compliance = replace(compliance, simulated=True)
    return Iso9283(poses, settled, sampled, posing, compliance)


def iso9283_plan(
    robot: str | Path | Arm,
    *,
    center: ArrayLike | None = None,
    edge: float | None = None,
    inset: float = FRACTION,
    plane: CubePlane = "x=z",
    near: ArrayLike | None = None,
) -> FivePoses:
    """The test poses P1 to P5 of a robot and the joints that reach them (Table A I-1).

    Parameters
    ----------
    robot : str, Path or Arm
        URDF, name of a shipped robot, or nominal arm.
    center : array_like, shape (3,), optional
        Of the cube, in the base link, metres; unless given, that of the IRB 1600 and IRB 120 is known, and other arms
        take the largest cube that they reach in front and above the base.
    edge : float, optional
        Of the cube, metres; likewise.
    inset : float
        Distance of P2 to P5 from the corners as a share of the cube's diagonal, below one half.
    plane : str
        Inclined plane of the cube: ``x=z``, ``x=-z``, ``y=z`` or ``y=-z``.
    near : array_like, shape (joints,), optional
        Joints that set the orientation of the tip, radians (metres for prismatic joints); zero unless given.

    Raises
    ------
    OptionError
        If the plane is none, or a place or length is no number or not in metres.
    RobotError
        If there is no such robot, or a pose is out of reach.
    """
    if plane not in PLANES:
        raise OptionError.unknown("plane", plane, tuple(PLANES))
    inset = number("inset", inset, 0)
    if center is not None:
        center = point_in_metres("center", center)
    if edge is not None:
        edge = length("edge", edge)
    arm = robot if isinstance(robot, Arm) else open_robot(robot, nominal=True).nominal
    return five_poses(arm, center, edge, near, plane, inset)
