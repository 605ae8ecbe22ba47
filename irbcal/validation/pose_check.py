"""Pose tests, read and judged: accuracy, repeatability, variation, distance and drift of ISO 9283:1998.

The pose tests are measurements with the columns ``pose`` (P1 to P5, or any names) and ``cycle``. Where there is a
column ``group``, rows of ``iso9283`` are the cycles of pose accuracy and repeatability; rows with something in a column
``direction`` (three directions of approach) are those of the multi-directional variation, and rows of the group
``iso9283_drift`` the sets of the drift test, in the order of the file.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import TYPE_CHECKING, Any

import numpy as np

from irbcal.arrays import lock
from irbcal.errors import MeasurementError
from irbcal.io.schema import Record
from irbcal.measurement.cleaning import Exclusion, left_out
from irbcal.measurement.columns import TableLike
from irbcal.measurement.table import MeasurementSet
from irbcal.modeling.robot import Robot
from irbcal.plotting.charts import Chart
from irbcal.summary import Cell, Speaks, Table, Told
from irbcal.units import MM
from irbcal.validation.attained import attained, commanded_poses, measured_whole
from irbcal.validation.model_criteria import ModelCriteria, PoseValues, criteria
from irbcal.validation.prepared import CleanedPoints, prepare
from irbcal.validation.tables import ANGLES, AXES

if TYPE_CHECKING:
    import pandas as pd

SET_SIZE = 10
"""Cycles of a set of the drift test."""


@dataclass(frozen=True, eq=False, repr=False)
class PoseCheck(Speaks):
    """Pose accuracy and repeatability, variation, distance and drift.

    Attributes
    ----------
    subject : str
        What was regarded: ``flange``, ``measured frame``, ``all targets``, or a target.
    models : dict of str to ModelCriteria
        ``nominal`` and ``calibrated``; ``measured`` without a calibration.
    excluded : tuple of Exclusion
    notes : tuple of str
    simulated : bool
    """

    subject: str
    models: dict[str, ModelCriteria]
    excluded: tuple[Exclusion, ...]
    notes: tuple[str, ...]
    simulated: bool

    def __post_init__(self) -> None:
        lock(self)

    def default_band(self) -> float | None:
        """RP of P1, else of the first pose, metres: the limit band of stabilisation unless one is given."""
        poses = next(iter(self.models.values())).poses
        values = poses.get("P1") or next(iter(poses.values()), None)
        return None if values is None or values["RP_mm"] is None else values["RP_mm"] * MM

    def to_dict(self) -> dict[str, Any]:
        """The fields by their names, in mm and degrees."""
        models = {
            name: {field.name: _plain(getattr(model, field.name)) for field in fields(model)}
            for name, model in self.models.items()
        }
        return {
            "subject": self.subject,
            "models": models,
            "excluded": [asdict(item) for item in self.excluded],
            "notes": list(self.notes),
            "simulated": self.simulated,
        }

    def to_frame(self) -> pd.DataFrame:
        """A row for each model and pose: ``model``, ``pose`` and its criteria."""
        import pandas as pd

        rows = [
            {"model": name, "pose": pose, **values}
            for name, model in self.models.items()
            for pose, values in model.poses.items()
        ]
        return pd.DataFrame(rows)

    def cycles_to_frame(self) -> pd.DataFrame:
        """A row for each model and cycle: ``model``, ``pose``, ``cycle``, ``position_mm``, ``orientation_deg``."""
        import pandas as pd

        parts = [pd.DataFrame({"model": name, **m.history}) for name, m in self.models.items() if m.history]
        return pd.concat(parts, ignore_index=True) if parts else pd.DataFrame()

    def told(self) -> Sequence[Told]:
        """The criteria pose by pose, over all poses, and what was left out."""
        start = "SIMULATED data: " if self.simulated else ""
        out: list[Told] = [f"{start}ISO 9283, {self.subject}: {self._said_shortly()}."]
        for name, model in self.models.items():
            if model.poses:
                out += _tables_of_poses(f"{start}ISO 9283, {self.subject}, {name}", model.poses)
        out += _table_over_all(self.models)
        for name, model in self.models.items():
            if model.distance:
                out += _of_distance(name, model.distance)
        last = list(self.models.values())[-1]
        for pose, values in (last.directions or {}).items():
            angles = "".join(f", {x} {values[f'vAP_{x}_mm']:.3f}" for x in AXES)
            angles += "".join(f", {a} {values[f'vAP_{a}_deg']:.4f}°" for a in ANGLES if f"vAP_{a}_deg" in values)
            out.append(
                f"Variation over {values['directions']} directions, {pose}: vAP {values['vAP_mm']:.3f} mm{angles}"
            )
        for name, model in self.models.items():
            if model.drift:
                d = model.drift
                accuracy = f"dAP {d['dAP_mm']:+.3f} mm, " if "dAP_mm" in d else ""
                out.append(
                    f"Drift of {d['pose']} over {d['sets']} sets of {d['set_size']}, {name}: {accuracy}dRP "
                    f"{d['dRP_mm']:+.3f} mm, way of the mean {d['shift_mm'][-1]:.3f} mm"
                )
        return [
            *out,
            *([f"Left out: {len(self.excluded)} points"] if self.excluded else []),
            *left_out(self.excluded),
            *(f"Note: {note}" for note in self.notes),
        ]

    def _said_shortly(self) -> str:
        said = []
        for name, model in self.models.items():
            if model.overall:
                position = model.overall["position"]
                said.append(f"{name} {position['mean_mm']:.3f} mm (mean), {position['max_mm']:.3f} mm (largest)")
        return "position errors " + "; ".join(said) if said else "variation and drift"

    def plot(self) -> Chart:
        """Position and orientation errors by pose, in each pose by cycle (Figures 7.8 and 7.9).

        Raises
        ------
        MeasurementError
            If no cycles of pose accuracy were measured.
        """
        from irbcal.validation import plots

        if not self.has_cycles:
            raise MeasurementError("there is nothing to draw: no cycles of pose accuracy were measured")
        return plots.pose_cycles(self)

    def plot_drift(self) -> Chart:
        """Accuracy and repeatability of each set of cycles of the drift test.

        Raises
        ------
        MeasurementError
            If no drift was measured.
        """
        from irbcal.validation import plots

        if not self.has_drift:
            raise MeasurementError("there is nothing to draw: no drift was measured")
        return plots.drift_sets(self)

    @property
    def has_cycles(self) -> bool:
        """Whether cycles of pose accuracy were measured."""
        return any(model.history for model in self.models.values())

    @property
    def has_drift(self) -> bool:
        """Whether the drift test was measured."""
        return any(model.drift for model in self.models.values())


def _plain(value: Any) -> Any:
    """Locked dicts and tuples as dicts and lists."""
    if isinstance(value, Mapping):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, tuple) else value


def _tables_of_poses(title: str, poses: Mapping[str, PoseValues]) -> list[Told]:
    keys = ["AP_mm", "AP_x_mm", "AP_y_mm", "AP_z_mm", "RP_mm", "l_mean_mm", "l_max_mm"]
    columns = ["AP", "AP x", "AP y", "AP z", "RP", "mean l", "max l"]
    if next(iter(poses.values()))["AP_mm"] is None:
        keys, columns = keys[4:], columns[4:]
    rows = tuple((pose, values["n"], *(values.get(key) for key in keys)) for pose, values in poses.items())
    out: list[Told] = [Table(f"{title}, mm", ("pose", "n", *columns), rows)]
    if all("RP_a_deg" in values for values in poses.values()):
        keys = [f"{what}_{a}_deg" for what in ("AP", "RP") for a in ANGLES]
        turned = tuple((pose, *(values.get(key) for key in keys)) for pose, values in poses.items())
        columns = ["pose", "AP a", "AP b", "AP c", "RP a ±", "RP b ±", "RP c ±"]
        out.append(Table(f"{title}, orientation, degrees", tuple(columns), turned, digits=4))
    return out


def _of_distance(name: str, d: Mapping[str, Any]) -> list[Told]:
    """AD and RD in a sentence, and along and about the axes."""
    accuracy = "–" if d["AD_mm"] is None else f"{d['AD_mm']:.3f}"
    parts = []
    for axes, unit, digits in ((AXES, "mm", 3), (ANGLES, "deg", 4)):
        for axis in (axis for axis in axes if f"RD_{axis}_{unit}" in d):
            total = d[f"AD_{axis}_{unit}"]
            first = "" if total is None else f"{total:+.{digits}f} "
            parts.append(f"{axis} {first}±{d[f'RD_{axis}_{unit}']:.{digits}f}{'°' if unit == 'deg' else ''}")
    return [
        f"Distance P2 to P4, {name}: AD {accuracy} mm, RD ±{d['RD_mm']:.3f} mm",
        f"Distance P2 to P4, {name}, AD ± RD by axis, mm, and angle: {', '.join(parts)}",
    ]


def _table_over_all(models: Mapping[str, ModelCriteria]) -> list[Told]:
    """Errors of all poses and cycles by each model, as Table 7.8 has them."""
    rows: list[tuple[Cell, ...]] = []
    about = ""
    for name, model in models.items():
        if model.overall:
            position, turned = model.overall["position"], model.overall["orientation"] or {}
            rows.append((name, position["mean_mm"], position["max_mm"], turned.get("mean_deg"), turned.get("max_deg")))
            about = "command" if model.overall["from"] == "commanded" else "mean"
    columns = ("model", "position mean mm", "max mm", "orientation mean deg", "max deg")
    return [Table(f"Errors from the {about}, all poses and cycles", columns, tuple(rows), digits=4)] if rows else []


# --- from measurements to criteria ------------------------------------------------------------------------


def check_poses(
    measurements: MeasurementSet,
    calibration: Record | None = None,
    commanded: TableLike | None = None,
    target: str | None = None,
    set_size: int = SET_SIZE,
) -> PoseCheck:
    """Pose accuracy and repeatability, variation, distance and drift (section 7.7.3.4 and annex I).

    Parameters
    ----------
    measurements : MeasurementSet
    calibration : Record, optional
        Gives the commanded poses at the file's joints, by the nominal and by the calibrated robot.
    commanded : str, Path or DataFrame, optional
        Commanded poses: ``pose,x_mm,y_mm,z_mm`` and for orientations ``qw,qx,qy,qz``. With a calibration, poses of the
        tip in the base link; without, places of what was measured in the measuring frame.
    target : str, optional
        Regard the position of this target; by default the tip, where poses were measured as a whole.
    set_size : int
        Cycles of a set of the drift test.

    Returns
    -------
    PoseCheck

    Raises
    ------
    MeasurementError
        If the file has no cycles, a pose was measured once only, or a target or a commanded pose is missing.
    """
    _check_cycles(measurements)
    ready = prepare(measurements, calibration)
    if target is not None:
        ready = _only(ready, target)
    robots: dict[str, Robot | None] = {"measured": None}
    if calibration is not None:
        robots = {"nominal": calibration.robot_nominal(), "calibrated": calibration.robot_calibrated()}
    table = None if commanded is None else commanded_poses(commanded)
    whole = target is None and measured_whole(ready.points, robots, table)
    if not whole and target is None:
        ready = ready.keep(ready.points.target == int(np.argmax(np.bincount(ready.points.target))))
    models = {}
    for name, robot in robots.items():
        found = attained(ready, robot, whole).commanded_by(robot, table)
        models[name] = criteria(found if robot is None else found.seen_from(robot.T_world_base), set_size)
    subject = f"target {ready.points.names()[0]}"
    if whole:
        subject = "flange" if calibration else ("measured frame" if ready.points.oriented().any() else "all targets")
    simulated = measurements.simulated or (calibration is not None and calibration.simulated)
    return PoseCheck(subject, models, ready.excluded, ready.notes, simulated)


def _only(ready: CleanedPoints, target: str) -> CleanedPoints:
    if target not in ready.points.target_names:
        raise MeasurementError(
            f"no usable point of target {target}; targets are {', '.join(ready.points.target_names)}",
            file=ready.measurements.source,
            parameter="target",
        )
    return ready.keep(ready.points.names() == target)


def _check_cycles(measurements: MeasurementSet) -> None:
    table, source = measurements.table, measurements.source
    if "cycle" not in table.columns:
        raise MeasurementError(
            "missing column cycle: ISO 9283 repeats its poses in numbered cycles", file=source, row=1
        )
    used = ~measurements.is_reference()
    double = table[used].duplicated(["pose_index", "target"]).to_numpy()
    if double.any():
        row = table[used][double].iloc[0]
        raise MeasurementError(
            f"pose {row['pose']} with target {row['target']} stands there twice in cycle {row['cycle']}: number the "
            "cycles through, over directions and sets, too",
            file=source,
            row=int(row["row"]),
            column="cycle",
        )
