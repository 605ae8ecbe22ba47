"""Sessions: measurements of one robot between which the tracker, the robot's base or the tool's reflectors were moved.

Each session has its own base in its measuring frame and its own places of the targets; the robot is shared. While an
identification looks for them, points keep the frame in which they were measured, and `PointSet.session` says which; the
targets of all sessions but the last are named ``target@session`` (`own_targets`): an identification takes them for
other targets, so that each session has its own places of the tool. Afterwards `into_one_frame` moves all points into
the frame of the last session, so that a robot has one base.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd

from irbcal.arrays import FloatArray, NameArray
from irbcal.errors import MeasurementError, OptionError
from irbcal.measurement.column_names import listed
from irbcal.measurement.points import PointSet
from irbcal.measurement.table import MeasurementSet
from irbcal.modeling import frames

MARK = "@"
"""Between a target and the session in which it was mounted so."""
COLUMN = "session"
"""The column of a measurement file that tells sessions apart, unless another is named."""


def sessions_of(measurements: MeasurementSet, by: str | None = None) -> list[tuple[str, MeasurementSet]]:
    """Measurements by session, in the order in which sessions are first seen.

    Parameters
    ----------
    measurements : MeasurementSet
    by : str, optional
        Column that names the session of each row; by default ``session`` where there is one.

    Returns
    -------
    list of (name, MeasurementSet)
        One without a name where there is no such column or no name in it. Poses of each are numbered from 0.

    Raises
    ------
    OptionError
        If there is no such column.
    MeasurementError
        If a row has no session's name, or if a pose is in two sessions.
    """
    if by is not None and by not in measurements.cells.columns:
        raise OptionError(
            f"session_by: {measurements.source} has no column {by}; found {listed(list(measurements.cells.columns))}",
            parameter="session_by",
        )
    name = COLUMN if by is None else by
    if name not in measurements.cells.columns:
        return [("", measurements)]
    table = measurements.table
    label = table[name].fillna("").astype(str).str.strip()
    if (label == "").all():
        return [("", measurements)]
    for k in np.flatnonzero((label == "") | label.str.contains(MARK, regex=False)):
        label_found = repr(label.iloc[k]) if label.iloc[k] else "nothing"
        raise MeasurementError(
            f"expected the name of a session without {MARK}, found {label_found}",
            file=measurements.source,
            row=int(table["row"].iloc[k]),
            column=name,
        )
    first = label.groupby(table["pose_index"]).transform("first")
    for k in np.flatnonzero(label != first):
        raise MeasurementError(
            f"pose {table['pose'].iloc[k]} is in two sessions, {first.iloc[k]} and {label.iloc[k]}",
            file=measurements.source,
            row=int(table["row"].iloc[k]),
            column=name,
        )
    sets = []
    for session in dict.fromkeys(label):
        rows = table[label == session].reset_index(drop=True)
        rows["pose_index"] = pd.factorize(rows["pose_index"])[0]
        sets.append((str(session), measurements.with_table(rows)))
    return sets


def joined(sessions: Sequence[tuple[str, PointSet]]) -> PointSet:
    """Points of several sessions as one set: each in its own frame, targets by names of their own.

    Parameters
    ----------
    sessions : sequence of (name, PointSet)
        The last one's targets keep their names. A single one is returned as it is.
    """
    if len(sessions) == 1:
        return sessions[0][1]
    names = list(dict.fromkeys(name for _, points in sessions for name in points.target_names))
    sets = [points for _, points in sessions]
    first_pose = np.cumsum([0, *(points.poses for points in sets)])
    joined_set = PointSet(
        np.concatenate([points.q for points in sets]),
        np.concatenate([points.pose + start for points, start in zip(sets, first_pose, strict=False)]),
        np.concatenate([np.array([names.index(n) for n in p.target_names], dtype=int)[p.target] for p in sets]),
        np.concatenate([points.xyz for points in sets]),
        tuple(names),
        np.concatenate([np.asarray(points.pose_ids, dtype=object) for points in sets]),
        np.concatenate([points.groups for points in sets]),
        session=_labels([(name, points.poses) for name, points in sessions]),
        **{name: stacked([(getattr(p, name), len(p)) for p in sets]) for name in ("rotation", "u95")},
        previous=stacked([(points.previous, points.poses) for points in sets]),
        inputs={
            name: stacked([(points.inputs.get(name), points.poses) for points in sets])
            for name in dict.fromkeys(name for points in sets for name in points.inputs)
        },
    )
    assert joined_set.session is not None
    return own_targets(joined_set, joined_set.session, sessions[-1][0])


def _labels(counts: Sequence[tuple[str, int]]) -> NameArray:
    return np.repeat(np.array([name for name, _ in counts], dtype=object), [count for _, count in counts])


def stacked(values: Sequence[tuple[FloatArray | None, int]]) -> Any:
    """Arrays with their lengths one behind the other, NaN for those that are absent; None if all are."""
    present = [value for value, _ in values if value is not None]
    if not present:
        return None
    tail = present[0].shape[1:]
    return np.concatenate([np.full((n, *tail), np.nan) if value is None else value for value, n in values])


def into_one_frame(points: PointSet, T_world_base: FloatArray, bases: Mapping[str, FloatArray]) -> PointSet:
    """Points of all sessions in the measuring frame of the last one.

    Parameters
    ----------
    points : PointSet
        Each pose in its session's own measuring frame.
    T_world_base : ndarray, shape (4, 4)
        Base in the measuring frame of the last session.
    bases : dict of str to ndarray, shape (4, 4)
        Base in the measuring frame of each other session.

    Returns
    -------
    PointSet
        Without sessions: they are all on one base now.
    """
    if points.session is None:
        return points
    T = np.tile(np.eye(4), (points.poses, 1, 1))
    for name, base in bases.items():
        T[points.session == name] = T_world_base @ frames.inverse(base)
    T = T[points.pose]
    xyz = np.einsum("mij,mj->mi", T[:, :3, :3], points.xyz) + T[:, :3, 3]
    rotation = None if points.rotation is None else T[:, :3, :3] @ points.rotation
    return replace(points, xyz=xyz, rotation=rotation, session=None)


def own_targets(points: PointSet, blocks: NameArray, plain: str) -> PointSet:
    """The same points, the targets of each block by names of their own.

    Parameters
    ----------
    points : PointSet
        With the targets' plain names.
    blocks : ndarray of str, shape (n,)
        Block of each pose.
    plain : str
        The block whose targets keep their names.

    Returns
    -------
    PointSet
        Targets are sorted by name, those with plain names first.
    """
    of_point = np.asarray(blocks, dtype=object)[points.pose]
    name_and_block = zip(points.names(), of_point, strict=True)
    called = [name if block == plain else f"{name}{MARK}{block}" for name, block in name_and_block]
    names = sorted(set(called), key=lambda name: (MARK in name, name))
    number = {name: k for k, name in enumerate(names)}
    target = np.array([number[name] for name in called], dtype=int)
    return replace(points, target=target, target_names=tuple(names))


def block_of(target: str, blocks: tuple[str, ...], plain: str) -> tuple[str, str]:
    """The plain name of a target and its block.

    Parameters
    ----------
    target : str
        As `own_targets` calls it.
    blocks : tuple of str
        Their names.
    plain : str
        The block of targets with plain names.

    Returns
    -------
    name, block : str
    """
    for block in sorted(blocks, key=len, reverse=True):
        if target.endswith(f"{MARK}{block}"):
            return target.removesuffix(f"{MARK}{block}"), block
    return target, plain
