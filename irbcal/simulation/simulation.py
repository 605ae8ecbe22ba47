"""Measuring in a virtual cell: poses in, SIMULATED measurements and the truth out; what ``irbcal simulate`` does."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from irbcal import safe_files
from irbcal.arrays import FloatArray
from irbcal.declared_options import takes_fields_of
from irbcal.error_statistics import statistics, statistics_table
from irbcal.errors import MeasurementError, OptionError
from irbcal.io.opening import open_calibration
from irbcal.io.schema import Record
from irbcal.measurement import table
from irbcal.measurement.column_names import PAYLOAD_CENTRE, POSITION
from irbcal.measurement.input_table import poses_to_frame
from irbcal.measurement.table import MeasurementSet
from irbcal.modeling.arm import Arm
from irbcal.modeling.joint_map import JointMap
from irbcal.names import csv_bytes
from irbcal.option_values import names, point_in_metres
from irbcal.simulation import pose_list
from irbcal.simulation.pose_list import PoseList
from irbcal.simulation.shipped_cells import asked_cell, open_cell
from irbcal.simulation.simulation_options import SimulationOptions
from irbcal.simulation.virtual_cell import Run, VirtualCell
from irbcal.summary import Paragraph, Result, remarks
from irbcal.units import MM

if TYPE_CHECKING:
    import pandas as pd


def measurement_table(run: Run, poses: PoseList, arm: Arm) -> pd.DataFrame:
    """A run as the rows of a measurement file.

    Returns
    -------
    DataFrame
        Text and numbers as they are written: joints with 6 decimals, positions with 4 (0.1 um). Where the robot's
        readings are not its commands, the commands stand beside them (``c1_deg`` …).
    """
    import pandas as pd

    row, point = np.nonzero(run.measured)
    columns: dict[str, Any] = {"pose": poses.pose[row]}
    for name, values in poses.extra.items():
        columns[name] = values[row]
    commands = arm.joint_table(poses.q[row], 6)
    columns |= commands if run.readings is None else arm.joint_table(run.readings[row], 6)
    if run.readings is not None:
        columns |= {f"c{name[1:]}": values for name, values in commands.items()}
    columns["target"] = np.array(run.names, dtype=object)[point]
    xyz = np.round(run.xyz[row, point] / MM, 4) + 0.0
    columns |= {name: xyz[:, k] for k, name in enumerate(POSITION)}
    columns["payload_kg"] = np.full(len(row), run.payload_kg)
    if run.payload_centre is not None:
        payload_at = np.round(run.payload_centre / MM, 4)
        columns |= {name: np.full(len(row), x) for name, x in zip(PAYLOAD_CENTRE, payload_at, strict=True)}
    columns["time_s"] = np.round(run.time_s[row, point], 2)
    columns["simulated"] = np.full(len(row), "yes", dtype=object)
    return pd.DataFrame(columns)


def files(run: Run, poses: PoseList, cell: VirtualCell, out: str | Path, robot: str) -> dict[str, bytes]:
    """Contents of the measurement file and of the truth beside it.

    Parameters
    ----------
    run : Run
    poses : PoseList
    cell : VirtualCell
    out : str or Path
        The measurement file.
    robot : str
        As the user named it.

    Returns
    -------
    dict of str to bytes
        File name -> content.
    """
    out = Path(out)
    data = csv_bytes(measurement_table(run, poses, cell.arm))
    document = {
        "simulated": True,
        "note": "What the virtual cell hides; the identification never reads this file.",
        "made_by": "irbcal simulate",
        "robot": robot,
        "data": out.name,
        "data_sha256": hashlib.sha256(data).hexdigest(),
        "plan": Path(poses.source).name,
        "plan_sha256": poses.sha256,
        "units": "mm and degrees; base_*: the base link in the tracker's frame (eq. 3.5); target_*: in the tip link",
        "terms_are": "what the robot does in the terms of the error model, by their names; rad, m and minutes",
        "stiffness_is": "the two numbers that describe joints 2 and 3 best; the effect compliance says what they do",
        **cell.truth(),
        "unseen": run.unseen,
        "poses_are": "true tip poses in the base link, in the order of the run: x_mm, y_mm, z_mm, qw, qx, qy, qz",
    }
    rows = poses_to_frame(run.T_base_tip).round(9).to_numpy().tolist()
    lines = ",\n".join(f"  {row}" for row in rows)
    truth = json.dumps(document, indent=1, ensure_ascii=False).removesuffix("\n}")
    return {out.name: data, truth_name(out): f'{truth},\n "poses": [\n{lines}\n ]\n}}\n'.encode()}


def truth_name(out: str | Path) -> str:
    """Name of the truth's file beside a measurement file."""
    return f"{Path(out).stem}.truth.json"


__all__ = ["MOSTLY_HIDDEN", "Simulated", "open_cell", "program_errors", "simulate"]

MOSTLY_HIDDEN = 0.2
"""Share of targets that the tracker may not see before the result says so."""


@dataclass(frozen=True, eq=False, repr=False)
class Simulated(Result):
    """Measurements from the virtual cell: SIMULATED.

    Attributes
    ----------
    robot : str
        As the user named it.
    cell : VirtualCell
    poses : PoseList
        What was commanded.
    run : Run
        What the tracker saw, and the truth.
    program_errors : ndarray, shape (m,), or None
        Distances of the targets seen from where a program wanted them, metres; None without such a program.
    """

    robot: str
    cell: VirtualCell
    poses: PoseList
    run: Run
    program_errors: FloatArray | None = None

    def report(self) -> list[Paragraph]:
        """See `Result.report`."""
        run, cell = self.run, self.cell
        minutes = self.duration_s / 60
        lines: list[Paragraph] = [
            f"SIMULATED: {len(run.q)} poses of {cell.arm.name} with {run.payload_kg:g} kg, {int(run.measured.sum())} "
            f"points in {minutes:.0f} minutes of the cell's time",
            f"Effects: {', '.join(cell.on) or 'none'}",
        ]
        lines += [f"  {count} points without a position: {name}" for name, count in run.unseen.items()]
        if self.wanted is not None:
            title = "Distances from where the program wanted the targets, mm"
            lines.append(statistics_table(title, [("all targets", "commanded", self.wanted)], {0}))
        return lines + remarks("Note", self._notes())

    def _notes(self) -> list[str]:
        q, arm, notes = self.poses.q, self.cell.arm, []
        beyond = int(((q < arm.lower - 1e-9) | (q > arm.upper + 1e-9)).any(axis=1).sum())
        if beyond:
            notes.append(f"{beyond} of {len(q)} poses command joints beyond the limits of {arm.name}")
        hidden = self.run.unseen.get("visibility", 0)
        count = int(self.run.measured[:, : self.run.targets].sum())
        if hidden > MOSTLY_HIDDEN * count:
            notes.append(
                f"the tracker did not see {hidden} of {count} targets: --random chooses poses that it sees, "
                "--without visibility lets it see through everything"
            )
        return notes

    @property
    def duration_s(self) -> float:
        """Of the measurement, by the cell's clock."""
        return float(self.run.time_s[-1].max())

    @property
    def wanted(self) -> dict[str, Any] | None:
        """Statistics of the distances from where a program wanted the targets, mm; None without such a program."""
        return None if self.program_errors is None else dict(statistics(self.program_errors) or {})

    def to_frame(self) -> pd.DataFrame:
        """The rows of the measurement file, as `irbcal.calibrate` takes them.

        Returns
        -------
        DataFrame
            A row for each point asked for; ``simulated`` is ``yes`` in all. Positions that were lost are NaN.
        """
        return measurement_table(self.run, self.poses, self.cell.arm)

    def measurements(self) -> MeasurementSet:
        """The measurements as irbcal reads them from the measurement file: what `irbcal.calibrate` takes."""
        data = csv_bytes(self.to_frame())
        return table.parse(data, f"SIMULATED measurements of {self.cell.arm.name}")

    simulated: ClassVar[bool] = True
    CONTENT = (
        "robot=cell.arm.name simulated poses=run.q.__len__ points=run.measured.sum targets=cell.tool.names "
        "references=cell.references.keys unseen=run.unseen payload_kg=run.payload_kg duration_s effects=cell.on "
        "seed=cell.seed wanted"
    )

    def save(self, out: str | Path) -> tuple[Path, Path]:
        """Write the measurement file, and the truth beside it as ``NAME.truth.json``.

        Parameters
        ----------
        out : str or Path
            The measurement file, CSV.

        Returns
        -------
        measurements, truth : Path

        Raises
        ------
        CalibrationError
            If they cannot be written.
        """
        out = Path(out)
        safe_files.write_together(out.parent, files(self.run, self.poses, self.cell, out, self.robot))
        return out, out.parent / truth_name(out)


@takes_fields_of(SimulationOptions)
def simulate(options: SimulationOptions) -> Simulated:
    """Measure with a virtual robot, tool and laser tracker: SIMULATED data for trying out plans and calibrations.

    Raises
    ------
    IrbcalError
        If options exclude or need one another, or an input is refused.

    Examples
    --------
    >>> irbcal.calibrate(simulate("irb1600", random=100), "irb1600")  # doctest: +SKIP
    """
    plan, wanted_program, wait = options.plan, options.wanted, options.wait
    cell = asked_cell(options)
    cell = cell.with_targets(_targets(options.targets, cell.tool.names))
    if options.tracker is not None:
        at = point_in_metres("tracker", options.tracker, "x, y, z of the tracker in metres")
        cell = cell.replace(tracker=cell.tracker.moved(at))
    setup = None
    if programs := [str(file) for file in (plan, wanted_program) if pose_list.is_program(file)]:
        setup = pose_list.given_for(options.robot, cell.arm, programs[0], options)
    if options.random is None:
        poses = pose_list.read_poses(plan, cell.arm, wait, setup)
    else:
        poses = pose_list.random_list(cell, options.random, options.seed, wait)
    run = cell.measure(poses.q, poses.measured_targets(cell), poses.wait_s)
    if options.payload is not None:
        run = replace(run, payload_centre=cell.tool.payload_centre)
    errors = None
    if wanted_program is not None and options.calibration is not None:
        program = pose_list.read_poses(wanted_program, cell.arm, wait, setup)
        errors = program_errors(run, program.q, open_calibration(options.calibration))
    return Simulated(str(options.robot), cell, poses, run, errors)


def _targets(chosen: int | Sequence[str], all_names: Sequence[str]) -> tuple[str, ...]:
    """Names of the targets to measure: the first so many, or those named."""
    if isinstance(chosen, str):
        chosen = (chosen,)
    if not isinstance(chosen, int):
        return tuple(dict.fromkeys(names("targets", chosen)))
    if not 1 <= chosen <= len(all_names):
        raise OptionError(f"expected 1 to {len(all_names)} targets or names, found {chosen}", parameter="targets")
    return tuple(all_names[:chosen])


def program_errors(run: Run, commanded: FloatArray, calibration: Record) -> FloatArray:
    """Distances of the measured targets from where a program wanted them.

    Wanted is what the controller's nominal arm means by its joints, in the base and with the tool of a calibration.

    Parameters
    ----------
    run : Run
    commanded : ndarray, shape (n, joints)
        Joints of the uncorrected program, radians (metres for prismatic joints).
    calibration : Record

    Returns
    -------
    ndarray, shape (m,)
        Metres, for the targets that were seen and that the calibration knows. Where the calibration has references,
        each pose is registered to them first.

    Raises
    ------
    MeasurementError
        If the programs differ in length or no target is known.
    """
    from irbcal.measurement.registration import register, without_noise

    if len(commanded) != len(run.q):
        raise MeasurementError(
            f"the wanted program has {len(commanded)} poses, the simulated one {len(run.q)}", parameter="wanted"
        )
    robot = calibration.robot_calibrated()
    nominal = calibration.arm(calibrated=False)
    robot = robot.replace(arm=nominal, joint_map=JointMap.identity(nominal))
    xyz, references = run.xyz[:, : run.targets], calibration.reference_places()
    fixed, names = run.xyz[:, run.targets :], run.names[run.targets :]
    registration = references and register(fixed, names, "simulated points", references)
    if registration:
        T = without_noise(registration, fixed, names).T_frame_pose
        xyz = np.einsum("nij,nkj->nki", T[:, :3, :3], xyz) + T[:, None, :3, 3]
    common = [k for k, name in enumerate(run.names[: run.targets]) if name in robot.targets]
    if not common:
        raise MeasurementError(f"the calibration knows none of the targets {', '.join(run.names[: run.targets])}")
    off = np.concatenate([np.linalg.norm(xyz[:, k] - robot.points(commanded, run.names[k]), axis=1) for k in common])
    return off[np.isfinite(off)]
