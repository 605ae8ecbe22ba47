"""Joints files: the joints of poses whose sources hold points only."""

from collections.abc import Sequence
from os import PathLike

import numpy as np
import pandas as pd

from irbcal.arrays import IntArray
from irbcal.errors import MeasurementError
from irbcal.measurement.columns import joint_columns, programmed_columns
from irbcal.measurement.imports import dialect, literals
from irbcal.measurement.imports.column_map import Column, Dialect, ImportMap
from irbcal.measurement.imports.dialect import short
from irbcal.measurement.imports.part import ROW, SOURCE, joint_values
from irbcal.measurement.imports.plausible import check_joint_sizes


def join(
    frame: pd.DataFrame, joints: pd.DataFrame, path: str | PathLike[str], import_map: ImportMap
) -> tuple[pd.DataFrame, list[str]]:
    """Add the joints of a joints file, by the poses' names or by their order.

    Parameters
    ----------
    frame : DataFrame
        Points, as `Part.frame` returns them.
    joints : DataFrame
        As `read_joints` returns them.
    path : str or Path
        The joints file.
    import_map : ImportMap

    Returns
    -------
    frame : DataFrame
        With joint columns in degrees and mm.
    warnings : list of str
        What the user should look at, in sentences.

    Raises
    ------
    MeasurementError
        If the joints file cannot be read or does not fit the points.
    """
    warnings: list[str] = []
    if "target" in joints.columns:
        if "target" not in frame.columns:
            return _row_by_row(frame, joints, path), warnings
        joints = _one_row_for_each_pose(joints)
    how = import_map.join or ("name" if import_map.names_poses and "pose" in joints.columns else "order")
    columns = joint_columns(joints.columns) + programmed_columns(joints.columns, str(path))
    if how == "name":
        place = _places_by_name(frame, joints, path)
    else:
        place, named = pd.factorize(frame["pose"])
        _check_counts(frame, len(named), len(joints), path, import_map)
    frame = frame.copy()
    frame[columns] = joints[columns].to_numpy()[place]
    if "group" in joints.columns and "group" not in frame.columns:
        frame["group"] = joints["group"].to_numpy()[place]
    if how == "order" and "pose" in joints.columns and not import_map.names_poses and joints["pose"].is_unique:
        frame["pose"] = joints["pose"].to_numpy()[place]
    unused = np.setdiff1d(np.arange(len(joints)), place)
    if len(unused):
        warnings.append(
            f"{len(unused)} poses of {path} have no row in the measurements, the first in row {joints[ROW][unused[0]]}"
        )
    if how == "name":  # the joints file knows the order in which the robot visited them
        frame = frame.iloc[np.argsort(place, kind="stable")].reset_index(drop=True)
    return frame, warnings


def _row_by_row(frame: pd.DataFrame, joints: pd.DataFrame, path: str | PathLike[str]) -> pd.DataFrame:
    """Points whose targets, poses and joints stand in the same rows of the joints file."""
    if len(frame) != len(joints):
        raise MeasurementError(
            f"expected {len(joints)} rows, as many as {path} has, which names their targets, found {len(frame)}",
            file=frame[SOURCE].iloc[0],
        )
    frame = frame.copy()
    own = [name for name in joints.columns if name != ROW and (name != "group" or "group" not in frame.columns)]
    frame[own] = joints[own].to_numpy()
    frame = frame.astype({name: float for name in joints.columns if name.endswith(("_deg", "_mm"))})
    if "pose" not in joints.columns:
        frame["pose"] = _runs(joints).astype(str)
    return frame


def _one_row_for_each_pose(joints: pd.DataFrame) -> pd.DataFrame:
    """A joints file with a row for each point as one with a row for each pose."""
    key = joints["pose"] if "pose" in joints.columns else _runs(joints)
    return joints[~pd.Series(key).duplicated().to_numpy()].drop(columns="target").reset_index(drop=True)


def _runs(joints: pd.DataFrame) -> IntArray:
    """Number of the pose of each row, from 1: neighbouring rows with the same joints are one."""
    q = joints[joint_columns(joints.columns)].to_numpy()
    return np.cumsum(np.r_[True, np.abs(np.diff(q, axis=0)).max(axis=1) > 1e-6])


def _places_by_name(frame: pd.DataFrame, joints: pd.DataFrame, path: str | PathLike[str]) -> IntArray:
    """Row of the joints file for each point, by the poses' names."""
    if "pose" not in joints.columns:
        raise MeasurementError(
            "expected a column pose to join by name, found none; --set join=order joins by order", file=path, row=1
        )
    double = joints["pose"].duplicated()
    if double.any():
        k = int(np.flatnonzero(double)[0])
        raise MeasurementError(
            f"expected each pose once, found {joints['pose'][k]!r} again",
            file=path,
            row=int(joints[ROW][k]),
            column="pose",
        )
    place = np.asarray(pd.Index(joints["pose"]).get_indexer(frame["pose"]))
    if (place < 0).any():
        row = frame.iloc[int(np.flatnonzero(place < 0)[0])]
        raise MeasurementError(
            f"expected a pose of {path} ({short(str(joints['pose'][0]))} …), found {short(row['pose'])!r}; "
            "--set join=order joins by order",
            file=row[SOURCE],
            row=int(row[ROW]),
        )
    return place


def _check_counts(frame: pd.DataFrame, poses: int, rows: int, path: str | PathLike[str], import_map: ImportMap) -> None:
    """Joining by order needs as many poses as rows of joints, in every file that counts its own."""
    if not import_map.names_poses and "{target}" in (import_map.file_name or ""):
        counts = frame.groupby("target", sort=False)["pose"].nunique()
        wrong = counts[counts != rows]
        if len(wrong):
            source = frame[SOURCE][frame["target"] == wrong.index[0]].iloc[0]
            raise MeasurementError(
                f"expected {rows} rows, as many as {path} has, found {wrong.iloc[0]}: the order does not tell which is "
                "missing or too much; join by name",
                file=source,
            )
    if poses != rows:
        raise MeasurementError(
            f"expected {rows} poses, as many as {path} has rows, found {poses}; joining by order needs as many",
            file=frame[SOURCE].iloc[0],
        )


def read_joints(path: str | PathLike[str], import_map: ImportMap) -> pd.DataFrame:
    """A joints file, DataFrame of joints and, where it has them, pose, group and target.

    Parameters
    ----------
    path : str or Path
        A table, or a program in whose text the joints stand as literals, see `literals`.
    import_map : ImportMap

    Raises
    ------
    MeasurementError
        If it is neither.
    """
    given = import_map.joints_file
    if given is None:
        program = literals.read(path)
        if program is not None:
            check_joint_sizes(program, str(path), "deg", import_map)
            return program
    text = dialect.read(path, given.file if given else Dialect())
    names: Sequence[Column]
    programmed: Sequence[Column]
    units: str | Sequence[str]
    pose: Column | None
    group: Column | None
    target: Column | None
    if given:
        names, units, pose, group = given.columns.joints, given.units.joints, given.columns.pose, given.columns.group
        target = given.columns.target
        programmed = given.columns.programmed or ()
    else:
        header = text.names or ()
        names = columns = joint_columns(header)
        programmed = programmed_columns(header, str(path))
        units = [name.rpartition("_")[2] for name in columns]
        pose, group = ("pose" if "pose" in header else None), ("group" if "group" in header else None)
        target = "target" if "target" in header else None
        if not names:
            raise MeasurementError(
                "expected the columns q1_deg, q2_deg … (q1_mm of a rail; optional pose, group, target), or joints_file "
                f"in the map, found {', '.join(map(short, header[:40]))}",
                file=path,
                row=text.header_line,
            )
    places = [text.find(name, f"joint {k}") for k, name in enumerate(names, 1)]
    asked = [text.find(name, f"programmed joint {k}") for k, name in enumerate(programmed, 1)]
    text = text.with_decimal([*places, *asked])
    frame = pd.DataFrame(joint_values(text, places, units))
    if asked:
        frame = frame.assign(**joint_values(text, asked, units, "c"))
    frame[ROW] = text.lines
    for key, column in (("pose", pose), ("group", group), ("target", target)):
        if column is not None:
            frame[key] = text.text(text.find(column, f"the {key}")).to_numpy()
    check_joint_sizes(frame, str(path), units, import_map)
    return frame
