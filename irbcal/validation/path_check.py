"""Sampled paths, read and judged: accuracy and repeatability, velocity and corners of ISO 9283:1998."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from irbcal.arrays import FloatArray, IntArray, lock
from irbcal.errors import MeasurementError, OptionError
from irbcal.measurement import readings
from irbcal.measurement.columns import TableLike
from irbcal.modeling import frames
from irbcal.modeling.robot import Robot
from irbcal.plotting.charts import Chart
from irbcal.summary import Speaks, Table, Told
from irbcal.units import DEG, MM
from irbcal.validation.corner_criteria import Corner, cornering
from irbcal.validation.path_criteria import PathErrors, path_errors
from irbcal.validation.tables import ANGLES, in_order, is_simulated, names, places, start_of
from irbcal.validation.velocity_criteria import PathVelocity, path_velocity

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False, repr=False)
class PathCheck(Speaks):
    """Accuracy, repeatability, velocity and corners of sampled paths.

    Attributes
    ----------
    errors : PathErrors
        On the planes that all cycles cross.
    along : ndarray, shape (m,)
        Way of these planes on the commanded path, metres.
    cycles : int
    planes_of : int
        Points of the commanded path.
    velocity : PathVelocity or None
        None where the samples have no times.
    corners : tuple of Corner
        Of the commanded path.
    simulated : bool
    """

    errors: PathErrors
    along: FloatArray
    cycles: int
    planes_of: int
    velocity: PathVelocity | None = None
    corners: tuple[Corner, ...] = ()
    simulated: bool = False

    def __post_init__(self) -> None:
        lock(self)

    def to_dict(self) -> dict[str, Any]:
        """What the command prints as JSON, mm, degrees and seconds.

        ``AT_mm``, ``RT_mm``, ``planes``, ``planes_of``, ``cycles``; with orientations ``AT_a_deg`` to ``RT_c_deg``;
        ``velocity`` (``AV_percent``, ``RV_percent``, ``FV_mm_s``, means of the cycles; None without times); ``corners``
        (``CR_mm``, ``CO_mm``, ``way_mm``, ``turn_deg`` each); ``along_mm``, ``mean_error_mm`` and ``repeatability_mm``
        plane by plane; ``simulated``.
        """
        e = self.errors
        out: dict[str, Any] = {
            "AT_mm": e.AT / MM,
            "RT_mm": e.RT / MM,
            "planes": len(e.planes),
            "planes_of": self.planes_of,
            "cycles": self.cycles,
        }
        if e.mean_angles is not None and e.angle_repeatability is not None:
            for k, a in enumerate(ANGLES):
                out[f"AT_{a}_deg"] = float(np.abs(e.mean_angles[:, k]).max() / DEG)
                out[f"RT_{a}_deg"] = float(e.angle_repeatability[:, k].max() / DEG)
        out["velocity"] = None if self.velocity is None else _velocity_dict(self.velocity)
        out["corners"] = [
            {
                "way_mm": c.way / MM,
                "turn_deg": c.turn / DEG,
                "CR_mm": c.CR / MM,
                "CO_mm": c.CO / MM,
                "round_off_mm": (c.round_off / MM).tolist(),
                "overshoot_mm": (c.overshoot / MM).tolist(),
            }
            for c in self.corners
        ]
        columns = {name: column.tolist() for name, column in self._columns().items()}
        return out | columns | {"simulated": self.simulated}

    def _columns(self) -> dict[str, FloatArray]:
        return {
            "along_mm": self.along / MM,
            "mean_error_mm": np.linalg.norm(self.errors.mean, axis=1) / MM,
            "repeatability_mm": self.errors.repeatability / MM,
        }

    def to_frame(self) -> pd.DataFrame:
        """A row for each plane: ``along_mm``, ``mean_error_mm``, ``repeatability_mm``."""
        import pandas as pd

        return pd.DataFrame(self._columns())

    def told(self) -> Sequence[Told]:
        """AT and RT, of orientations too where they were measured; velocities and corners."""
        found = self.to_dict()
        out: list[Told] = [
            f"{start_of(self.simulated)}Path: AT {found['AT_mm']:.3f} mm, RT {found['RT_mm']:.3f} mm "
            f"({found['cycles']} cycles, {found['planes']} of {found['planes_of']} planes)"
        ]
        if "AT_a_deg" in found:
            angles = [f"AT_{a} {found[f'AT_{a}_deg']:.4f}, RT_{a} {found[f'RT_{a}_deg']:.4f}" for a in ANGLES]
            out.append(f"Orientation, degrees: {'; '.join(angles)}")
        if self.velocity is not None:
            v = found["velocity"]
            of = "" if v["AV_percent"] is None else f"AV {v['AV_percent']:+.2f} %, RV ±{v['RV_percent']:.2f} %, "
            out.append(f"Velocity on the middle half: {of}FV {v['FV_mm_s']:.2f} mm/s, mean {v['mean_mm_s']:.2f} mm/s")
        if self.corners:
            rows = tuple((k, c.way / MM, c.turn / DEG, c.CR / MM, c.CO / MM) for k, c in enumerate(self.corners, 1))
            columns = ("corner", "way mm", "turn deg", "CR mm", "CO mm")
            out.append(Table("Corners: round-off CR and overshoot CO, largest of the cycles", columns, rows))
        return out

    def plot(self) -> Chart:
        """Path accuracy and repeatability on the planes along the path."""
        from irbcal.validation import plots

        return plots.along_path(self)


def _velocity_dict(v: PathVelocity) -> dict[str, Any]:
    return {
        "commanded_mm_s": None if v.commanded is None else v.commanded / MM,
        "mean_mm_s": float(v.mean.mean() / MM),
        "AV_percent": None if v.AV is None else 100 * v.AV,
        "RV_percent": None if v.RV is None else 100 * v.RV,
        "FV_mm_s": v.FV / MM,
        "means_mm_s": (v.mean / MM).tolist(),
    }


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
    path : str, Path or DataFrame
        Columns ``cycle``, ``x_mm``, ``y_mm``, ``z_mm`` in the order of the samples, optional ``time_s`` and
        ``qw,qx,qy,qz``.
    commanded_path : str, Path or DataFrame
        Points of the commanded path in order, likewise without ``cycle``: in the same frame; with a robot in its base
        link.
    velocity : float, optional
        Commanded velocity, m/s.
    window : float
        See `irbcal.validation.velocity_criteria.path_velocity`, seconds.
    robot : Robot, optional
        Knows where its base link stands in the measuring frame; everything is then told in the base link.
    target : str, optional
        Of the robot: the commanded path is that of the tip, with orientations, and this target was measured. Without,
        what was measured is what was commanded.

    Returns
    -------
    PathCheck

    Raises
    ------
    MeasurementError
        If a file does not keep the format or the paths do not fit.
    OptionError
        If a velocity is given without times, or there is no such target.
    """
    table, commanded = readings.read_points(path, labels=("cycle",)), readings.read_points(commanded_path)
    file = table.attrs["source"]
    if len(commanded) < 3:
        raise MeasurementError(
            f"a commanded path needs three points or more, found {len(commanded)}", file=commanded.attrs["source"]
        )
    place, turn, cycle = places(table), readings.rotations(table), names(table, "cycle")
    assert cycle is not None
    rows = [np.flatnonzero(cycle == name) for name in in_order(cycle)]
    short = [k for k in rows if len(k) < 2]
    if short:
        raise MeasurementError(
            "a path needs two samples in each cycle", file=file, row=int(table["row"].iloc[short[0][0]])
        )
    if robot is not None:
        T = frames.inverse(robot.T_world_base)
        place, turn = frames.apply(T, place), None if turn is None else T[:3, :3] @ turn
    wanted, wanted_turn = _wanted(commanded, robot, target)
    times = _times(path, rows) if "time_s" in table.columns else None
    if velocity is not None and times is None:
        raise OptionError(f"velocity: the velocity takes the column time_s, {file} has none", parameter="velocity")
    paths = [place[k] for k in rows]
    try:
        found = path_errors(paths, wanted, None if turn is None else [turn[k] for k in rows], wanted_turn)
        speeds = None if times is None else path_velocity(times, paths, wanted, velocity, window)
    except MeasurementError as error:
        raise MeasurementError(str(error), file=file) from None
    way = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(wanted, axis=0), axis=1))])
    return PathCheck(
        found,
        way[found.planes],
        len(rows),
        len(commanded),
        speeds,
        cornering(paths, wanted),
        is_simulated(table) or is_simulated(commanded),
    )


def _wanted(commanded: pd.DataFrame, robot: Robot | None, target: str | None) -> tuple[FloatArray, FloatArray | None]:
    """Commanded places and orientations of what was measured."""
    place, turn = places(commanded), readings.rotations(commanded)
    if target is None:
        return place, turn
    targets: Mapping[str, FloatArray] = {} if robot is None else robot.targets
    if robot is None or target not in targets:
        known = f"the calibration knows {', '.join(targets)}" if targets else "give a calibration that knows it"
        raise OptionError(f"target: there is no target {target}: {known}", parameter="target")
    if turn is None:
        raise MeasurementError(
            "missing columns qw, qx, qy, qz: where a target on the tool is commanded to be depends on the orientation",
            file=commanded.attrs["source"],
            row=1,
        )
    on_tip = robot.target_rotations.get(target)
    return place + turn @ targets[target], None if on_tip is None else turn @ on_tip


def _times(path: TableLike, rows: Sequence[IntArray]) -> list[FloatArray]:
    """Times of the samples of each cycle, seconds."""
    table = readings.read_points(path, numbers=("time_s",))
    time, out = table["time_s"].to_numpy(dtype=float), []
    for k in rows:
        back = np.flatnonzero(np.diff(time[k]) <= 0)
        if len(back):
            raise MeasurementError(
                f"expected a later time than in the row before, found {time[k[back[0] + 1]]:g}",
                file=table.attrs["source"],
                row=int(table["row"].iloc[k[back[0] + 1]]),
                column="time_s",
            )
        out.append(time[k])
    return out
