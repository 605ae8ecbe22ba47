"""The filter: a program in, the same program with fake targets out (Nubiola 2011, chapter 6 and conclusion)."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd

from irbcal.correction import program as programs
from irbcal.correction.fake_targets import Corrected, correct_joints, correct_poses
from irbcal.correction.languages import table
from irbcal.correction.program import ConfData
from irbcal.errors import ProgramError
from irbcal.modeling.inverse import closed_form
from irbcal.units import DEG, MM

QUADRANT_TOLERANCE = 1e-6
"""Radians by which rounding may put an axis beyond the edge of its quadrant."""


@dataclass(frozen=True, eq=False)
class Filtered:
    """A corrected program.

    Attributes
    ----------
    data : bytes
        Content of the new file; what could not be corrected is as it was.
    names : list of tuple
        (name, line) of the targets that were looked at, in the order of ``parts``.
    parts : list of Corrected
        Their fake targets.
    left : list of tuple
        (name, line, reason) of targets and moves that were left as they were.
    notes : list of tuple
        (line, text) of what the corrections do not know about.
    joint_columns : list of str
        Columns of the arm's joints.
    """

    data: bytes
    names: list
    parts: list
    left: list
    notes: list
    joint_columns: list

    @property
    def shifts(self):
        """Distance from wanted to fake pose of each corrected target, metres."""
        return np.concatenate([found.shift[found.ok] for found in self.parts]) if self.parts else np.zeros(0)

    @cached_property
    def changes(self):
        """A row for each corrected target: a DataFrame.

        Name, line, joints before and after (degrees), ``shift_mm``, ``turn_deg`` (from the wanted to the fake pose) and
        ``residual_mm`` (what the calibrated model still misses by).
        """
        return _changes(self.names, self.parts, self.joint_columns)


def filter_module(robot, nominal, program, fingerprint, mark):
    """Correct the targets of a robot program.

    Parameters
    ----------
    robot : Robot
        Calibrated.
    nominal : Arm
        What the controller computes with.
    program : Program
        As read, see `irbcal.correction.languages.rapid.reader`.
    fingerprint : str
        Of the calibration; goes into the mark.
    mark : callable
        ``mark(data, fingerprint)`` puts the mark into the file.

    Returns
    -------
    Filtered

    Raises
    ------
    ProgramError
        If the program was filtered before, or the arm has not six revolute joints.
    """
    refuse_filtered(program)
    if not nominal.six_revolute:
        raise ProgramError(f"{program.source}: RAPID targets are of six revolute joints, {nominal.name} has others")
    targets = program.targets
    joints, poses = program.correctable("joint"), program.correctable("pose")
    values, configurations, parts = {}, {}, []
    left = [(t.name, t.line, reason) for t, reason in program.skipped() if t.uses or t.conflicts]
    left += [(f"{move.instruction} {move.target}", move.line, move.reason) for move in program.uncorrected]
    if joints:
        found = correct_joints(robot, nominal, np.array([targets[k].value for k in joints]))
        values |= {k: found.q[row] for row, k in enumerate(joints) if found.ok[row]}
        parts.append((joints, found))
    if poses:
        wanted = programs.tip_poses(program, poses)
        seed, told = seeds_of(nominal, wanted, [targets[k].configuration for k in poses])
        found = correct_poses(robot, nominal, wanted, seed, closed_form.configuration(nominal, np.nan_to_num(seed)))
        found = _without(found, ~told, "its configuration data fit no solution of the robot within the joint limits")
        rows = np.flatnonzero(found.ok)
        chosen = [poses[row] for row in rows]
        values |= programs.values_for_tip_poses(program, chosen, found.T_fake[rows])
        for row, k in zip(rows, chosen, strict=True):
            if targets[k].configuration is not None:
                configurations[k] = configuration_of(found.q[row], targets[k].configuration.cfx)
        parts.append((poses, found))
    for chosen, found in parts:
        left += [(targets[k].name, targets[k].line, found.reason[r]) for r, k in enumerate(chosen) if not found.ok[r]]
    data = mark(programs.with_targets(program, values, configurations), fingerprint) if values else program.data
    names = [(targets[k].name, targets[k].line) for chosen, _ in parts for k in chosen]
    notes = [(note.line, note.text) for note in program.notes]
    left = sorted(left, key=lambda item: item[1])
    return Filtered(data, names, [found for _, found in parts], left, notes, nominal.joint_columns)


def filter_table(robot, nominal, program, fingerprint):
    """Correct a CSV program of joints or of tip poses; arguments and result as `filter_module`."""
    refuse_filtered(program)
    if program.kind == "joint":
        found = correct_joints(robot, nominal, program.values)
        values = found.q
    else:
        found = correct_poses(robot, nominal, program.values)
        values = found.T_fake
    names = [(f"row {row}", int(row)) for row in program.rows]
    left = [(*names[k], found.reason[k]) for k in np.flatnonzero(~found.ok)]
    data = table.with_values(program, values, fingerprint, found.ok)
    return Filtered(data, names, [found], left, [], nominal.joint_columns)


def refuse_filtered(program):
    """Refuse a program that bears the mark of an earlier correction."""
    if programs.is_filtered(program):
        which = f" for calibration {program.fingerprint}" if program.fingerprint else ""
        raise ProgramError(f"{program.source}: these are fake targets already{which}: filter the original program")


def _without(found, mask, reason):
    ok = found.ok & ~mask
    reasons = found.reason.copy()
    reasons[mask] = reason
    q = np.where(ok[:, None], found.q, np.nan)
    return Corrected(found.T_wanted, found.q_nominal, q, found.T_fake, ok, reasons, found.residual)


def quadrants(q):
    """Quadrants of joints 1, 4 and 6: ``floor(angle / 90 degrees)``, shape (..., 3)."""
    return np.floor(np.asarray(q)[..., [0, 3, 5]] / (np.pi / 2) + 1e-12).astype(int)


def configuration_of(q, cfx):
    """Configuration data of joints (6,) in radians; ``cfx`` is kept."""
    cf1, cf4, cf6 = quadrants(q)
    return ConfData(int(cf1), int(cf4), int(cf6), cfx)


def seeds_of(nominal, T_base_tip, configurations):
    """Joints that the controller takes for poses with configuration data.

    Of the solutions within the joint limits, turned so that axes 1, 4 and 6 stand in their quadrants, the one with
    the branch number ``cfx``, else the one nearest to zero joints. Poses without configuration data take the solution
    nearest to zero joints.

    Parameters
    ----------
    nominal : Arm
    T_base_tip : ndarray, shape (n, 4, 4)
    configurations : sequence of ConfData or None, length n

    Returns
    -------
    q : ndarray, shape (n, 6)
        Radians; NaN where the pose is out of reach or nothing fits.
    told : ndarray of bool, shape (n,)
        False where the pose can be reached, but not with its configuration data.
    """
    branches = closed_form.branches(nominal, T_base_tip)
    nearest, _ = closed_form.nearest(nominal, branches, np.zeros(6))
    n = len(nearest)
    wanted = np.array([[c.cf1, c.cf4, c.cf6] if c else [0, 0, 0] for c in configurations]).reshape(n, 3)
    cfx = np.array([c.cfx if c else -1 for c in configurations])
    given = np.array([c is not None for c in configurations], dtype=bool)
    q = branches.joints.copy()
    axes = [0, 3, 5]
    middle = (wanted[:, None, :] + 0.5) * (np.pi / 2)
    q[..., axes] += 2 * np.pi * np.round((middle - q[..., axes]) / (2 * np.pi))
    fits = (np.abs(q[..., axes] - middle) <= np.pi / 4 + QUADRANT_TOLERANCE).all(axis=-1)
    inside = ((q >= nominal.lower - 1e-9) & (q <= nominal.upper + 1e-9)).all(axis=-1)
    usable = branches.valid & fits & inside
    cost = np.where(usable, np.sum(np.nan_to_num(q) ** 2, axis=-1), np.inf)
    cost[np.arange(n), np.clip(cfx, 0, 7)] -= np.where((cfx >= 0) & (cfx <= 7), 1e6, 0.0)
    cost[~usable] = np.inf
    best = np.argmin(cost, axis=1)
    found = usable.any(axis=1)
    chosen = np.where(found[:, None], q[np.arange(n), best], np.nan)
    reachable = np.isfinite(nearest).all(axis=1)
    return np.where(given[:, None], chosen, nearest), found | ~given | ~reachable


def _changes(names, parts, joints):
    columns = ["target", "line", *(f"{name}_before" for name in joints), *joints]
    columns += ["shift_mm", "turn_deg", "residual_mm"]
    if not parts:
        return pd.DataFrame(columns=columns)
    units = [MM if name.endswith("_mm") else DEG for name in joints]
    ok = np.concatenate([found.ok for found in parts])
    values = [
        np.column_stack(
            [found.q_nominal / units, found.q / units, found.shift / MM, found.turn / DEG, found.residual / MM]
        )
        for found in parts
    ]
    changes = pd.DataFrame(np.concatenate(values), columns=columns[2:])
    changes.insert(0, "line", [line for _, line in names])
    changes.insert(0, "target", [name for name, _ in names])
    return changes[ok].reset_index(drop=True)


def fingerprint_of(program):
    """Fingerprint of the calibration with which a program was corrected; None where it bears none."""
    raise NotImplementedError
