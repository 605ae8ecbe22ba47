"""Measuring in a virtual cell: poses in, SIMULATED measurements and the truth out; what ``irbcal simulate`` does."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np
from numpy.typing import ArrayLike

from irbcal import safe_files
from irbcal.arrays import FloatArray
from irbcal.correction.program import ControllerSetup
from irbcal.errors import MeasurementError, OptionError
from irbcal.io.opening import CalibrationLike, open_calibration
from irbcal.io.schema import Record
from irbcal.measurement import table
from irbcal.measurement.columns import PAYLOAD_CENTRE, POSITION, TableLike, poses_to_frame
from irbcal.measurement.table import MeasurementSet
from irbcal.modeling.arm import Arm
from irbcal.modeling.joint_map import JointMap
from irbcal.names import csv_bytes
from irbcal.options import MOST_POSES, checked, names, number, place
from irbcal.options import seed as check_seed
from irbcal.simulation import pose_list, shipped_cells
from irbcal.simulation.pose_list import PoseList, PosesLike
from irbcal.simulation.shipped_cells import ROBOT_SEED, open_cell
from irbcal.simulation.virtual_cell import WAIT_S, Run, VirtualCell
from irbcal.statistics import statistics
from irbcal.summary import Paragraph, Result
from irbcal.units import MM
from irbcal.validation.evaluation import statistics_table

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

    row, point = np.nonzero(run.asked)
    units = arm.joint_units
    columns: dict[str, Any] = {"pose": poses.pose[row]}
    for name, values in poses.extra.items():
        columns[name] = values[row]
    commands = np.round(arm.to_controller(poses.q) / units, 6) + 0.0
    joints = commands if run.readings is None else np.round(arm.to_controller(run.readings) / units, 6) + 0.0
    columns |= {name: joints[row, j] for j, name in enumerate(arm.joint_columns)}
    if run.readings is not None:
        columns |= {f"c{name[1:]}": commands[row, j] for j, name in enumerate(arm.joint_columns)}
    columns["target"] = np.array(run.names, dtype=object)[point]
    xyz = np.round(run.xyz[row, point] / MM, 4) + 0.0
    columns |= {name: xyz[:, k] for k, name in enumerate(POSITION)}
    columns["payload_kg"] = np.full(len(row), run.payload_kg)
    if run.payload_place is not None:
        payload_at = np.round(run.payload_place / MM, 4)
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


__all__ = ["MOSTLY_HIDDEN", "Simulated", "misses", "open_cell", "simulate"]

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
    misses : ndarray, shape (m,), or None
        Distances of the targets seen from where a program wanted them, metres; None without such a program.
    """

    robot: str
    cell: VirtualCell
    poses: PoseList
    run: Run
    misses: FloatArray | None = None

    def report(self) -> list[Paragraph]:
        """See `Result.report`."""
        run, cell = self.run, self.cell
        minutes = self.duration_s / 60
        lines: list[Paragraph] = [
            f"SIMULATED: {len(run.q)} poses of {cell.arm.name} with {run.payload_kg:g} kg, {int(run.asked.sum())} "
            f"points in {minutes:.0f} minutes of the cell's time",
            f"Effects: {', '.join(cell.on) or 'none'}",
        ]
        lines += [f"  {count} points without a position: {name}" for name, count in run.unseen.items()]
        if self.wanted is not None:
            title = "Distances from where the program wanted the targets, mm"
            lines.append(statistics_table(title, [("all targets", "commanded", self.wanted)], {0}))
        return lines + [f"Note: {note}" for note in self._notes()]

    def _notes(self) -> list[str]:
        q, arm, notes = self.poses.q, self.cell.arm, []
        beyond = int(((q < arm.lower - 1e-9) | (q > arm.upper + 1e-9)).any(axis=1).sum())
        if beyond:
            notes.append(f"{beyond} of {len(q)} poses command joints beyond the limits of {arm.name}")
        hidden = self.run.unseen.get("visibility", 0)
        count = int(self.run.asked[:, : self.run.targets].sum())
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
        return None if self.misses is None else dict(statistics(self.misses) or {})

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
        "robot=cell.arm.name simulated poses=run.q.__len__ points=run.asked.sum targets=cell.tool.names "
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


def simulate(
    robot: str | Path,
    plan: PosesLike | None = None,
    *,
    random: int | None = None,
    seed: int = 0,
    robot_seed: int = ROBOT_SEED,
    payload: float | None = None,
    only: Sequence[str] | None = None,
    without: Sequence[str] = (),
    also: Sequence[str] = (),
    cell: Literal["thesis", "realistic"] = "thesis",
    targets: int | Sequence[str] = 3,
    tracker: ArrayLike | None = None,
    wait: float = WAIT_S,
    wanted: TableLike | None = None,
    calibration: CalibrationLike | None = None,
    tool: Mapping[str, ArrayLike] | None = None,
    wobj: Mapping[str, ArrayLike] | None = None,
    pulses: Sequence[float] | None = None,
    where: tuple[ArrayLike, ArrayLike] | None = None,
    base_link: str | None = None,
    tip_link: str | None = None,
    coupling: str | None = None,
) -> Simulated:
    """Measure with a virtual robot, tool and laser tracker: SIMULATED data for trying out plans and calibrations.

    Parameters
    ----------
    robot : str or Path
        URDF of the nominal robot, a name, such as irb1600 (tuned on the thesis) or irb120, or a calibration folder.
    plan : str, Path, DataFrame, Plan or array_like of shape (n, joints), optional
        Robot program (docs/programs.md) of which the stops are measured, or a table of joints (q1_deg …) or poses
        (x_mm … qz), such as a plan; optional columns pose, group, cycle, targets (names with spaces between them),
        wait_s; see `irbcal.simulation.pose_list.taken`.
    random : int, optional
        In place of a plan, that many random poses in the tracker's sight.
    seed : int
        Of the run: noise, repeatability, lost points, random poses.
    robot_seed : int
        Of the robot's own errors: another number is another robot.
    payload : float, optional
        Mass on the flange, kg; 3 unless given, less for smaller arms. Where it is given, its centre is told, too.
    only : sequence of str, optional
        Only these effects, none at all if empty; names as in `irbcal.simulation.effects.NAMES`.
    without : sequence of str, optional
        All effects but these.
    also : sequence of str, optional
        Effects to switch on that the cell of the thesis leaves off: reading_lag, bending, gear, wobble, direction,
        move, thaw.
    cell : {"thesis", "realistic"}
        A robot with the thesis's errors, or with those that measured robots show: weight at all joints, harmonic
        drives, wobbling bearings, warm-up, direction of approach, early readings.
    targets : int or sequence of str
        How many of the tool's nine reflectors, or their names.
    tracker : array_like, shape (3,), optional
        Place of the tracker in the base link, metres.
    wait : float
        Seconds between stop and measurement, where the plan does not say.
    wanted : str, Path or DataFrame, optional
        The program before it was filtered: tells how far the robot ends from it.
    calibration : str, Path or Calibration, optional
        With ``wanted``: the calibration it was filtered with.
    tool, wobj, pulses, where : optional
        See `irbcal.correct`.
    base_link, tip_link, coupling : str, optional
        See `irbcal.read_urdf`.

    Raises
    ------
    IrbcalError
        If options exclude or need one another, or an input is refused.

    Examples
    --------
    >>> irbcal.calibrate(simulate("irb1600", random=100), "irb1600")  # doctest: +SKIP
    """
    if (wanted is None) != (calibration is None):
        raise OptionError("wanted and calibration go together", parameter="wanted")
    seed, robot_seed, wait = check_seed(seed), check_seed(robot_seed, "robot_seed"), number("wait", wait, 0)
    kind = checked("cell", cell, shipped_cells.KINDS)
    opened = open_cell(robot, base_link, tip_link, coupling=coupling, seed=seed, robot_seed=robot_seed)
    opened = _changed(shipped_cells.of_kind(kind, opened, robot_seed), only, without, also)
    opened = _equipped(opened, targets, payload, tracker)
    setup = None
    if programs := [str(file) for file in (plan, wanted) if pose_list.is_program(file)]:
        setup = pose_list.given_for(robot, opened.arm, tool, wobj, pulses, where, programs[0])
    poses = _poses(opened, plan, random, seed, wait, setup)
    run = _run(opened, poses, payload is not None)
    errors = None
    if wanted is not None and calibration is not None:
        program = pose_list.taken(wanted, opened.arm, wait, setup)
        errors = misses(run, program.q, open_calibration(calibration))
    return Simulated(str(robot), opened, poses, run, errors)


def _equipped(
    cell: VirtualCell, targets: int | Sequence[str], payload: float | None, tracker: ArrayLike | None
) -> VirtualCell:
    """The cell with the tool's targets, the load and the tracker's place that are asked for."""
    cell = cell.with_targets(_targets(targets, cell.tool.names))
    cell = cell if payload is None else cell.with_payload(number("payload", payload, 0))
    if tracker is None:
        return cell
    return cell.replace(tracker=cell.tracker.moved(place("tracker", tracker, "x, y, z of the tracker in metres")))


def _run(cell: VirtualCell, poses: PoseList, place_told: bool) -> Run:
    """What the tracker sees; with the payload's place where it was asked for."""
    run = cell.measure(poses.q, poses.asked(cell), poses.wait_s)
    return replace(run, payload_place=cell.tool.payload_centre) if place_told else run


def _changed(cell: VirtualCell, only: Sequence[str] | None, without: Sequence[str], also: Sequence[str]) -> VirtualCell:
    """The cell with the effects that are asked for."""
    only, without, also = None if only is None else names("only", only), names("without", without), names("also", also)
    if only is not None and without:
        raise OptionError("only and without exclude each other", parameter="only")
    cell = cell.also(*also, *(only or ()))
    return (cell if only is None else cell.only(*only, *also)).without(*without)


def _poses(
    cell: VirtualCell, plan: PosesLike | None, random: int | None, seed: int, wait: float, setup: ControllerSetup | None
) -> PoseList:
    if (plan is None) == (random is None):
        raise OptionError("give either a plan or a number of random poses", parameter="plan")
    if random is None:
        return pose_list.taken(plan, cell.arm, wait, setup)
    return pose_list.random_list(cell, number("random", random, 1, MOST_POSES, whole=True), seed, wait)


def _targets(chosen: int | Sequence[str], all_names: Sequence[str]) -> tuple[str, ...]:
    """Names of the targets to measure: the first so many, or those named."""
    if isinstance(chosen, str):
        chosen = (chosen,)
    if not isinstance(chosen, int):
        return tuple(dict.fromkeys(names("targets", chosen)))
    if not 1 <= chosen <= len(all_names):
        raise OptionError(f"expected 1 to {len(all_names)} targets or names, found {chosen}", parameter="targets")
    return tuple(all_names[:chosen])


def misses(run: Run, commanded: FloatArray, calibration: Record) -> FloatArray:
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
