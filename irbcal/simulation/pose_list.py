"""Poses for the virtual cell: random ones in the tracker's sight, or those of a table, a plan or a robot program."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import ArrayLike

from irbcal.arrays import BoolArray, FloatArray, IntArray, Locked, NameArray
from irbcal.correction import languages
from irbcal.correction.corrected_targets import commanded
from irbcal.correction.fake_targets import correct_poses
from irbcal.correction.opened_programs import setup_of
from irbcal.correction.program import ControllerSetup, read_bytes
from irbcal.correction.program_options import ControllerOptions
from irbcal.errors import MeasurementError, ProgramError
from irbcal.io.controller_model import controller_frames, unknown_frames
from irbcal.io.opening import open_robot
from irbcal.measurement.column_names import POSE, check_header
from irbcal.measurement.input_table import InputTable, TableLike
from irbcal.modeling.arm import Arm
from irbcal.modeling.robot import Robot
from irbcal.simulation.instruments import FRONT, IRB1600_CUBE, IRB1600_HEIGHTS
from irbcal.simulation.virtual_cell import WAIT_S, VirtualCell
from irbcal.summary import Result

if TYPE_CHECKING:
    import pandas as pd

InRegion: TypeAlias = "Callable[[FloatArray], BoolArray]"
"""From tip positions (n, 3) in the base link, metres, to a mask (n,) of those inside."""

BLOCK = 20_000
"""Random poses that are looked at together."""
MOST_BLOCKS = 2000

CUBE_CENTRE, CUBE_EDGE = IRB1600_CUBE

AREAS = ("iso_cube", "all_range")
IDENTIFIED = ("smr1", "smr2", "smr3")
"""Targets that the identification uses (Nubiola 2011, section 7.3)."""
VERIFIED = tuple(f"smr{k}" for k in range(1, 9))
"""Targets that the verification uses."""


def in_cube(p: FloatArray) -> BoolArray:
    """Which positions (n, 3) in the base link lie in the ISO cube of the IRB 1600 (Nubiola 2011, section 7.2)."""
    return np.all(np.abs(p - CUBE_CENTRE) <= CUBE_EDGE / 2, axis=1)


def in_range(p: FloatArray) -> BoolArray:
    """Which positions (n, 3) lie above the obstacles around the thesis's robot (Nubiola 2011, section 7.2)."""
    return p[:, 2] > np.where(p[:, 0] >= FRONT, *IRB1600_HEIGHTS)


def above_floor(p: FloatArray) -> BoolArray:
    """Which positions (n, 3) lie above the robot's base plane."""
    return p[:, 2] > 0.0


def random_poses(
    cell: VirtualCell,
    count: int,
    seed: int | Sequence[int] = 0,
    region: InRegion = above_floor,
    targets: IntArray | None = None,
) -> FloatArray:
    """Random joints inside the limits with targets in sight, rounded to 1e-4 degrees (mm) as they are commanded.

    Parameters
    ----------
    cell : VirtualCell
        With the effect ``visibility`` off, every target is in sight.
    count : int
    seed : int or sequence of int
    region : callable
        From tip positions (n, 3) in the base link to a mask of the poses to keep.
    targets : ndarray of int, shape (count,), optional
        The target that must be in sight in each pose; by default all that look the same way as the first one.

    Returns
    -------
    ndarray, shape (count, joints)
        Radians (metres for prismatic joints).

    Raises
    ------
    MeasurementError
        If hardly any pose is as wanted.
    """
    arm, rng, units = cell.arm, np.random.default_rng(seed), cell.arm.joint_units
    lower, upper = arm.finite_limits
    alike = cell.tool.direction @ cell.tool.direction[0] > 1.0 - 1e-9
    wanted_target = np.zeros(count, dtype=int) if targets is None else np.asarray(targets)
    joints, missing = np.zeros((count, len(lower))), np.ones(count, dtype=bool)
    for _ in range(MOST_BLOCKS):
        q = np.round(rng.uniform(lower, upper, (BLOCK, len(lower))) / units, 4) * units
        q = q[np.all((q >= lower) & (q <= upper), axis=1)]
        q = q[region(arm.forward(q)[:, :3, 3])]
        visible = cell.visible(q)
        if targets is None:
            visible = np.all(visible[:, alike], axis=1)[:, None]
        for target in np.unique(wanted_target[missing]):
            good = q[visible[:, target]]
            rows = np.flatnonzero(missing & (wanted_target == target))[: len(good)]
            joints[rows], missing[rows] = good[: len(rows)], False
        if not missing.any():
            return joints
    raise MeasurementError(
        f"of {MOST_BLOCKS * BLOCK} random poses {int((~missing).sum())} were as wanted and in the tracker's sight, "
        f"{count} were asked for: move the tracker, or switch the effect visibility off"
    )


def is_program(poses: object) -> bool:
    """Whether poses are a file, or a folder, of a robot program in another language than CSV.

    Raises
    ------
    ProgramError
        If a file cannot be read_program.
    """
    if not isinstance(poses, (str, PathLike)):
        return False
    path = Path(poses)
    if path.is_dir():
        return True
    language_name = {
        ending: language.name for language in languages.all_languages() for ending in language.endings
    }.get(path.suffix.lower())
    if language_name is not None or path.suffix.lower() in (".txt", ".parquet") or not path.is_file():
        return language_name not in (None, "CSV")
    data = read_bytes(path)
    return any(language.looks_like(data) for language in languages.all_languages() if language.name != "CSV")


def given_for(robot: str | Path, arm: Arm, program: str | Path, options: ControllerOptions) -> ControllerSetup:
    """What the controller of a robot has for a program; errors as of `irbcal.correction.opened_programs.setup_of`."""
    opened = open_robot(robot, base_link=arm.base_link, tip_link=arm.tip_link)
    ends = unknown_frames()
    if opened.urdf_bytes is not None:
        ends = controller_frames(opened.urdf_bytes, str(robot), arm.base_link, arm.tip_link)
    return setup_of(options, languages.files_of([program]).language, arm, ends)


def read_program(program: str | Path, arm: Arm, setup: ControllerSetup) -> tuple[FloatArray, str | None]:
    """Joints at the stops of a program.

    Parameters
    ----------
    program : str or Path
        A file, or a folder with the files of one program.
    arm : Arm
        What the controller computes with.
    setup : ControllerSetup

    Returns
    -------
    q : ndarray, shape (n, joints)
        Radians (metres for prismatic joints).
    sha256 : str
        Of the contents of all files.

    Raises
    ------
    ProgramError
        If it cannot be read_program, moves nowhere, or the joints of a stop are not known.
    """
    found = languages.files_of([program])
    language, files = found.language, found.files
    read_joints = [(program.source, commanded(program, arm)) for program in language.read_for(arm, files, setup)]
    moving = [(source, q) for source, q in read_joints if len(q)]
    if not moving:
        raise ProgramError("expected a program that moves the robot, found no move", file=program)
    if len(moving) > 1:
        names = ", ".join(Path(source).name for source, _ in moving)
        raise ProgramError(f"expected one program, found several ({names}): name one of them", file=program)
    digest = hashlib.sha256(b"".join(read_bytes(file) for file in files)).hexdigest()
    return np.asarray(moving[0][1]), digest


PosesLike: TypeAlias = "str | Path | pd.DataFrame | Result | ArrayLike"
"""A robot program or a table of joints or poses, a result whose rows are poses such as a measuring plan, or joints (n,
joints) in radians and metres."""

COPIED_COLUMNS = ("group", "cycle")
"""Columns of a plan that go into the measurement file as they are."""
LONGEST_WAIT = 86_400.0


@dataclass(frozen=True, eq=False)
class PoseList(Locked):
    """Poses to measure, in their order."""

    q: FloatArray
    """Shape (n, joints). Radians (metres for prismatic joints)."""
    pose: NameArray
    """Shape (n,)."""
    targets: tuple[tuple[tuple[str, ...], int], ...] | None
    """For each pose the names of its targets (none for all) and its line in the file; None for all everywhere."""
    wait_s: FloatArray
    """Shape (n,)."""
    extra: dict[str, NameArray]
    """Values of shape (n,). Columns that are kept."""
    source: str
    sha256: str | None = None
    """Of the file's content."""

    def measured_targets(self, cell: VirtualCell) -> BoolArray | None:
        """Which targets each pose asks for, shape (n, targets); None for all.

        Raises
        ------
        MeasurementError
            If a pose asks for a target that the cell does not measure.
        """
        if self.targets is None:
            return None
        names = cell.tool.names
        out = np.zeros((len(self.q), len(names)), dtype=bool)
        for k, (names_asked, row) in enumerate(self.targets):
            unknown = [name for name in names_asked if name not in names]
            if unknown:
                raise MeasurementError(
                    f"expected targets of the tool ({', '.join(names)}), found {unknown[0]!r}",
                    file=self.source,
                    row=row,
                    column="targets",
                )
            out[k] = np.isin(names, names_asked) if names_asked else True
        return out


def numbered(n: int) -> NameArray:
    """Names of ``n`` poses: 1 to n."""
    return np.arange(1, n + 1).astype(str).astype(object)


def read_poses(poses: PosesLike, arm: Arm, wait_s: float = WAIT_S, setup: ControllerSetup | None = None) -> PoseList:
    """Poses by whatever holds them.

    Parameters
    ----------
    poses : str, Path, DataFrame, Plan, or array_like of shape (n, joints)
        A file (see `read`), a table with its columns, a measuring plan, or joints in radians (metres for prismatic
        joints).
    arm : Arm
    wait_s : float
        Seconds between stop and measurement where the poses do not say.
    setup : ControllerSetup, optional
        What comes with a robot program, see `irbcal.simulation.pose_list.given_for`.

    Raises
    ------
    IrbcalError
        If the poses do not fit the arm or the format.
    """
    import pandas as pd

    if isinstance(poses, Result):
        poses = poses.to_frame()
    if isinstance(poses, (str, Path)) and is_program(poses):
        q, digest = read_program(poses, arm, setup or ControllerSetup({}, {}, unknown_frames()))
        n = len(q)
        return PoseList(q, numbered(n), None, np.full(n, float(wait_s)), {}, str(poses), digest)
    if isinstance(poses, (str, Path, pd.DataFrame)):
        return read(poses, arm, wait_s)
    q = arm.check_joints(poses)
    return PoseList(q, numbered(len(q)), None, np.full(len(q), float(wait_s)), {}, f"{len(q)} poses")


def read(table: TableLike, arm: Arm, wait_s: float = WAIT_S) -> PoseList:
    """Read a plan, or a table of joints or of poses.

    Parameters
    ----------
    table : str, Path or DataFrame
        CSV with the arm's joint columns; optional columns ``pose``, ``group``, ``cycle``, ``targets`` (names with
        spaces or semicolons between them) and ``wait_s``. With a column ``target`` in place of ``targets``, the rows of
        a pose are one for each of its targets, as in the ``plan.csv`` of a measuring plan. Where there are programmed
        joints (``c1_deg`` …) beside the joint columns, they are what is commanded. In place of joints poses of the tip
        in the base link (``x_mm``, ``y_mm``, ``z_mm``, ``qw``, ``qx``, ``qy``, ``qz``): the arm takes the solution
        nearest to zero joints, as the filter does. Others are not looked at.
    arm : Arm
    wait_s : float
        Where the file does not say.

    Raises
    ------
    MeasurementError
        If the file does not keep the format.
    """
    rows = InputTable.read(table)
    digest, targets = rows.sha256, None
    if set(POSE) <= set(rows.names) and arm.joint_columns[0] not in rows:
        q = correct_poses(Robot(arm), arm, rows.poses()).q_nominal
        missing = np.flatnonzero(~np.isfinite(q).all(axis=1))
        if len(missing):
            raise rows.fault(f"expected a pose that {arm.name} reaches within its joint limits", int(missing[0]))
    else:
        check_header(rows.names, arm.joint_columns, rows.source)
        if "targets" not in rows:
            rows, targets = rows.one_row_a_pose(arm.joint_columns)
        q = arm.from_controller(rows.joints(arm.joint_columns))
    waits = rows.optional("wait_s")
    if "wait_s" in rows:
        rows.refuse((waits < 0) | (waits > LONGEST_WAIT), "wait_s", f"0 to {LONGEST_WAIT:g} seconds")
    if "targets" in rows:
        targets = rows.cells["targets"]
    return PoseList(
        q,
        _pose_names(rows) if "pose" in rows else numbered(len(rows)),
        None if targets is None else _targets(targets),
        np.where(np.isfinite(waits), waits, wait_s),
        {name: rows.cells[name].to_numpy(dtype=object) for name in COPIED_COLUMNS if name in rows},
        rows.source,
        digest,
    )


def random_list(cell: VirtualCell, count: int, seed: int = 0, wait_s: float = WAIT_S) -> PoseList:
    """Random joints inside the limits, above the floor and, where visibility is on, with a target in sight.

    Raises
    ------
    MeasurementError
        If the tracker sees too few poses.
    """
    q = random_poses(cell, count, seed)
    return PoseList(q, numbered(count), None, np.full(count, float(wait_s)), {}, f"{count} random poses")


def _pose_names(rows: InputTable) -> NameArray:
    names = rows.filled("pose")
    key = names + " / " + rows.texts("cycle")
    rows.refuse(rows.cells.assign(key=key)["key"].duplicated(), "pose", "each pose once (in each cycle)")
    return names


def _targets(texts: pd.Series) -> tuple[tuple[tuple[str, ...], int], ...]:
    """Names of the targets of each row and the line of the file; no names stand for all targets."""
    names = (tuple(name for name in re.split(r"[\s;|,]+", text) if name) for text in texts)
    return tuple(zip(names, (int(row) for row in texts.index), strict=True))
