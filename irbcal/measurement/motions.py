"""How the arm came to each measured pose: what terms of an error model are functions of."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from irbcal.arrays import FloatArray, NameArray
from irbcal.errors import MeasurementError
from irbcal.measurement import repeats
from irbcal.measurement.columns import PAYLOAD_CENTRE
from irbcal.measurement.points import PointSet
from irbcal.measurement.table import MeasurementSet, shared_table
from irbcal.modeling.terms.situation import Motion


def motion_of(measurements: MeasurementSet, points: PointSet) -> Motion:
    """Joints, last moves and order of points' poses, from the order of the file that they come from.

    Without programmed joints the file's readings stand for them, and may lag.

    Parameters
    ----------
    measurements : MeasurementSet
        All poses of the file, in the order in which the robot visited them.
    points : PointSet
        Some of its poses.

    Returns
    -------
    Motion
        Time is the number of the pose, the mean number of poses that share a name and joints. The last move is zero
        where the stop before is not known. Payload and torques are the points'.

    Raises
    ------
    MeasurementError
        If several loads were carried and it is not told where which.
    """
    first = shared_table(measurements).groupby("pose_index", sort=True)["pose"].first().astype(str)
    stop, number = repeats.numbered((first.to_numpy(), measurements.joints()), (points.pose_ids.astype(str), points.q))
    size = max(stop.max(initial=-1), number.max(initial=-1)) + 1
    count = np.bincount(stop, minlength=size)
    elapsed = (np.bincount(stop, np.arange(len(stop)), minlength=size) / np.maximum(count, 1))[number]
    load, centre = payload_of(points, measurements.source)
    return Motion(points.q, points.moves(), elapsed, load, not measurements.programmed, centre, points.torques)


def times_of(sets: Sequence[PointSet], timed: Sequence[tuple[PointSet, Motion]]) -> list[FloatArray | None]:
    """When poses were measured, from those of which it is known.

    Parameters
    ----------
    sets : sequence of PointSet
        In the order of measuring.
    timed : sequence of (PointSet, Motion)
        Poses with their times.

    Returns
    -------
    list of ndarray, shape (n,), or None
        One for each of ``sets``: poses that are not known lie between their neighbours; None where none is known.
    """
    told_of = [(points, motion.elapsed) for points, motion in timed if motion.elapsed is not None]
    number = repeats.numbered(*(_identities(points) for points in (*sets, *(points for points, _ in told_of))))
    times = np.full(1 + max((numbers_of_set.max(initial=-1) for numbers_of_set in number), default=-1), np.nan)
    for numbers, (_, elapsed) in zip(number[len(sets) :], told_of, strict=True):
        times[numbers] = elapsed
    out: list[FloatArray | None] = []
    for numbers in number[: len(sets)]:
        time = times[numbers]
        rows = np.flatnonzero(np.isfinite(time))
        out.append(np.interp(np.arange(len(time)), rows, time[rows]) if len(rows) else None)
    return out


def _identities(points: PointSet) -> tuple[NameArray, FloatArray]:
    """What tells poses from one another: session and name, and joints."""
    names = points.pose_ids.astype(str).astype(object)
    return names if points.session is None else points.session.astype(str).astype(object) + "\n" + names, points.q


def usual_load(loads: FloatArray | None) -> float | None:
    """The load that most poses carry, of equals the one of the last pose; None where no load is told.

    Parameters
    ----------
    loads : ndarray, shape (n,), or None
        Kg, NaN where not told.
    """
    if loads is None or not np.isfinite(loads).any():
        return None
    finite = loads[np.isfinite(loads)]
    values, count = np.unique(finite, return_counts=True)
    often = values[count == count.max()]
    return float(next(load for load in finite[::-1] if load in often))


def payload_of(points: PointSet, source: str) -> tuple[FloatArray | None, FloatArray | None]:
    """Mass and its place at each pose, without gaps; None where they are not told.

    Parameters
    ----------
    points : PointSet
    source : str
        File name for messages.

    Raises
    ------
    MeasurementError
        If several loads were carried and it is not told where which.
    """
    load, centre = points.payload_kg, points.payload_place
    if load is None:
        return None, None
    gaps = ~np.isfinite(load)
    if gaps.any():
        loads = np.unique(load[~gaps])
        if len(loads) > 1:
            raise MeasurementError(
                f"pose {points.pose_ids[gaps][0]} has no payload, others carry {loads[0]:g} to {loads[-1]:g} kg: write "
                "0 for a bare flange",
                file=source,
                column="payload_kg",
            )
        load = np.full(len(load), loads[0]) if len(loads) else None
    if load is None or centre is None:
        return load, None
    gaps = np.asarray(~np.isfinite(centre).all(axis=1))
    if (gaps & (load > 0.0)).any():
        raise MeasurementError(
            f"pose {points.pose_ids[gaps & (load > 0.0)][0]} has a payload without a place",
            file=source,
            column=tuple(PAYLOAD_CENTRE),
        )
    return load, np.where(gaps[:, None], 0.0, centre)


def usual_place(load: FloatArray, centre: FloatArray | None, usual_kg: float | None) -> tuple[float, float, float]:
    """Centre of the payload that counts where none is told: that of the usual load, else of the heaviest."""
    if centre is None:
        return 0.0, 0.0, 0.0
    usual = np.flatnonzero((load == usual_kg) & (load > 0.0))
    x, y, z = centre[usual[-1] if len(usual) else int(np.argmax(load))].tolist()
    return x, y, z
