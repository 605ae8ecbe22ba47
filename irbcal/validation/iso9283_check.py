"""The door to ISO 9283:1998: pose tests, settling, paths, posing time and compliance, and the plan of the test poses.

The formulas are those of public descriptions of the standard (such as Nubiola 2011, annex I and section 7.7.3.4); the
standard itself was not at hand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import FloatArray, Locked
from irbcal.errors import MeasurementError, OptionError
from irbcal.io.opening import CalibrationLike, open_calibration, open_nominal
from irbcal.measurement import table
from irbcal.measurement.columns import POSITION, InputTable, TableLike, distinct
from irbcal.measurement.table import MeasurementsLike
from irbcal.modeling.arm import Arm
from irbcal.options import length, number, place
from irbcal.plotting.charts import DOT, TALL, WIDE, Chart, Drawing, LegendEntry, Panel, axis_top, check_name, span
from irbcal.summary import Paragraph, Result, Table, simulated_mark
from irbcal.units import MM
from irbcal.validation.cube import FRACTION, PLANES, FivePoses, Plane, five_poses
from irbcal.validation.path_check import PathCheck, path_accuracy
from irbcal.validation.pose_check import SET_SIZE, PoseCheck, check_poses
from irbcal.validation.pose_criteria import AXES
from irbcal.validation.settling import REST, PosingTimes, Settling, posing_times, settle

if TYPE_CHECKING:
    import pandas as pd


DIRECTIONS = tuple(f"{sign}{axis}" for axis in AXES for sign in "+-")
"""Names of directions of force."""


@dataclass(frozen=True, eq=False)
class Compliance(Locked):
    """What forces in one direction do.

    Attributes
    ----------
    per_newton : ndarray, shape (cycles, 3)
        Slope of the displacement over the force, by least squares with the unloaded place free, m/N.
    force : ndarray, shape (n,)
        Of all readings, newtons.
    displacement : ndarray, shape (n, 3)
        From the unloaded place of its cycle, metres.
    direction : ndarray, shape (3,)
        Of the force.
    """

    per_newton: FloatArray
    force: FloatArray
    displacement: FloatArray
    direction: FloatArray

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
    """Compliance along and against the axes of a frame.

    Attributes
    ----------
    frame : str
        ``base link``, or ``measuring frame`` without a calibration.
    directions : dict of str to Compliance
        ``+x``, ``-x``, ``+y``, …
    simulated : bool
    """

    frame: str
    directions: dict[str, Compliance]
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
        return [headline, Table.of(title, self.to_frame(), columns, 5)]

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

    def _made(self) -> list[PoseCheck | Settling | PathCheck | PosingTimes | StaticCompliance]:
        checks = (self.poses, self.stabilisation, self.path, self.posing, self.compliance)
        return [check for check in checks if check is not None]

    def report(self) -> Sequence[Paragraph]:
        """What each of the tests has to say."""
        return [line for check in self._made() for line in check.report()]

    CONTENT = "poses stabilisation path posing compliance"

    def to_dict(self) -> dict[str, Any]:
        """``poses``, ``stabilisation``, ``path``, ``posing`` and ``compliance``; None for what was not made."""
        content = super().to_dict()
        if content["stabilisation"] is not None:
            del content["stabilisation"]["check"]
        return content

    def to_frame(self) -> pd.DataFrame:
        """The table of the first test that was made, in the order of the attributes."""
        return self._made()[0].to_frame()

    def plots(self) -> dict[str, Chart]:
        """All figures, by ``drift`` and the names of the attributes; only what was measured.

        Raises
        ------
        MeasurementError
            If only directions of approach were measured.
        """
        drawn = {}
        if self.poses is not None and self.poses.has_cycles:
            drawn["poses"] = self.poses.plot()
        if self.poses is not None and self.poses.has_drift:
            drawn["drift"] = self.poses.plot_drift()
        for name in ("stabilisation", "path", "posing", "compliance"):
            check: Settling | PathCheck | PosingTimes | StaticCompliance | None = getattr(self, name)
            if check is not None:
                drawn[name] = check.plot()
        if not drawn:
            raise MeasurementError("there is nothing to draw: only directions of approach were measured")
        return drawn

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
            drawn.save(path if k == 0 else path.with_stem(f"{path.stem}-{name}"))
            for k, (name, drawn) in enumerate(self.plots().items())
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
        Regard the position of this target; by default the tip, where poses were measured as a whole. Of a path: the
        commanded one is that of the tip, with orientations, and this target was measured.
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
        Commanded velocity of the path, m/s.
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
    plane: Plane = "x=z",
    near: ArrayLike | None = None,
) -> FivePoses:
    """The test poses P1 to P5 of a robot and the joints that reach them (Table A I-1).

    Parameters
    ----------
    robot : str, Path or Arm
        URDF, name of a shipped robot, or nominal arm.
    center : array_like, shape (3,), optional
        Of the cube, in the base link, metres; shipped robots have their own, others need it.
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
        If there is no such robot or cube, or a pose is out of reach.
    """
    if plane not in PLANES:
        raise OptionError.unknown("plane", plane, tuple(PLANES))
    inset = number("inset", inset, 0)
    if center is not None:
        center = place("center", center)
    if edge is not None:
        edge = length("edge", edge)
    arm = robot if isinstance(robot, Arm) else open_nominal(robot).arm
    return five_poses(arm, center, edge, near, plane, inset)
