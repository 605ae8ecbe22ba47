"""Poses of foreign files: which rows make one, its joints by the map's rules, its group."""

import fnmatch

import numpy as np
import pandas as pd

from irbcal.errors import MeasurementError
from irbcal.measurement.columns import joint_columns, programmed_columns
from irbcal.measurement.imports.column_map import ImportMap, JointRules
from irbcal.measurement.imports.dialect import short
from irbcal.measurement.imports.part import ROW, SOURCE

SAME_JOINTS = 1e-6
"""Joints that differ by no more are the same, degrees or mm."""


def pose_keys(frame: pd.DataFrame) -> pd.Series:
    """What tells the poses of all cycles apart, a text for each row."""
    return frame["pose"] + "\n" + frame["cycle"].astype(str) if "cycle" in frame.columns else frame["pose"]


def runs(frame: pd.DataFrame) -> pd.Series:
    """Number poses from 1: neighbouring rows with the same joints, until a target comes again."""
    columns = joint_columns(frame.columns)
    q = frame[columns].to_numpy()
    new = np.r_[True, np.abs(np.diff(q, axis=0)).max(axis=1) > SAME_JOINTS]
    new |= (frame[SOURCE] != frame[SOURCE].shift()).to_numpy()
    run = np.cumsum(new)
    again = frame.groupby([pd.Series(run), frame["target"]]).cumcount()
    return pd.Series(pd.factorize(pd.MultiIndex.from_arrays([run, again]))[0] + 1, index=frame.index)


def together(frame: pd.DataFrame) -> pd.DataFrame:
    """Rows of a pose (and cycle) beside one another, poses in the order in which they first appear."""
    order = np.argsort(pd.factorize(pose_keys(frame))[0], kind="stable")
    return frame.iloc[order].reset_index(drop=True)


def apply_joint_rules(frame: pd.DataFrame, import_map: ImportMap) -> None:
    """Readings to irbcal's joints, in place."""
    joint_rules_applied(frame, import_map.joints)


def joint_rules_applied(frame: pd.DataFrame, rules: JointRules) -> pd.DataFrame:
    """The same table, with readings as irbcal's joints."""
    columns = joint_columns(frame.columns)
    n = len(columns)
    for key, values in (("signs", rules.signs), ("offsets_deg", rules.offsets_deg)):
        if values is not None and len(values) != n:
            raise MeasurementError(
                f"the map: joints.{key}: expected {n} numbers, one for each joint, found {len(values)}"
            )
    if rules.signs is None and rules.offsets_deg is None and not rules.add:
        return frame
    matrix = np.eye(n)
    for to, source_joint in rules.add.items():
        if not (1 <= to <= n and 1 <= abs(source_joint) <= n and to != abs(source_joint)):
            raise MeasurementError(
                f"the map: joints.add: expected two different joints of 1 to {n}, found {to}: {source_joint}"
            )
        matrix[to - 1, abs(source_joint) - 1] = np.sign(source_joint)
    offsets = np.array(rules.offsets_deg if rules.offsets_deg is not None else np.zeros(n))
    sliding = [k for k, name in enumerate(columns) if name.endswith("_mm") and offsets[k]]
    if sliding:
        raise MeasurementError(f"the map: joints.offsets_deg: expected 0 for joint {sliding[0] + 1}, which slides")
    signs = np.array(rules.signs if rules.signs is not None else np.ones(n))
    for names in (columns, programmed_columns(frame.columns, frame[SOURCE].iloc[0])):
        if names:
            frame[names] = (frame[names].to_numpy() @ matrix.T) * signs + offsets
    return frame


def check_one_pose_one_joints(frame: pd.DataFrame) -> None:
    """Refuse a pose (of a cycle) whose rows have different joints."""
    index = pd.factorize(pose_keys(frame))[0]
    first = np.unique(index, return_index=True)[1][index]
    programmed = programmed_columns(frame.columns, frame[SOURCE].iloc[0])
    q = frame[joint_columns(frame.columns) + programmed].to_numpy()
    off = np.abs(q - q[first])
    if (off > SAME_JOINTS).any():
        k = int(np.flatnonzero((off > SAME_JOINTS).any(axis=1))[0])
        joint = int(off[k].argmax())
        row, first_row = frame.iloc[k], frame.iloc[first[k]]
        count = q.shape[1] - len(programmed)
        quantity, number = ("joints", joint + 1) if joint < count else ("programmed joints", joint + 1 - count)
        raise MeasurementError(
            f"expected the {quantity} of pose {short(row['pose'])} as in row {first_row[ROW]} of {first_row[SOURCE]} "
            f"(joint {number}: {q[first[k], joint]:.6g}), found {q[k, joint]:.6g}",
            file=row[SOURCE],
            row=int(row[ROW]),
        )


def name_groups(frame: pd.DataFrame, import_map: ImportMap) -> list[str]:
    """Name the groups of poses by the map's rules, in place; poses that no rule fits keep what they have.

    Returns
    -------
    list of str
        What the user should look at, in sentences.
    """
    warnings: list[str] = []
    if not import_map.groups:
        return warnings
    number, names = pd.factorize(frame["pose"])
    names = pd.Series(names, dtype=object)
    groups = np.full(len(names), "", dtype=object)
    open_ = np.ones(len(names), dtype=bool)
    for rule in import_map.groups:
        if rule.poses is not None:
            fits = names.str.fullmatch(fnmatch.translate(rule.poses)).to_numpy(dtype=bool)
        else:
            place = np.arange(1, len(names) + 1)
            fits = (place >= (rule.first or 1)) & (place <= (rule.last or len(names)))
        if not fits.any():
            warnings.append(f"The rule for group {rule.group} fits no pose")
        groups[fits & open_] = rule.group
        open_ &= ~fits
    previous = (
        frame["group"].to_numpy(dtype=object) if "group" in frame.columns else np.full(len(frame), "", dtype=object)
    )
    frame["group"] = np.where(open_[number], previous, groups[number])
    return warnings
