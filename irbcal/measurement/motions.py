"""How the arm came to each measured pose: what terms of an error model are functions of."""

from __future__ import annotations

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.measurement.points import PointSet
from irbcal.measurement.table import MeasurementSet
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
        Time is the number of the pose. The last move is zero where it is not known: for the first pose of the file and
        of each group, and for poses whose name and joints several stops of the file share.
    """
    first = measurements.table.groupby("pose_index", sort=True).first()
    groups = first["group"].fillna("").to_numpy(dtype=object) if "group" in first else None
    whole = Motion.in_order(measurements.joints(), groups=groups)
    stops: dict[tuple[str, bytes], list[int]] = {}
    for row, (name, q) in enumerate(zip(first["pose"].astype(str), whole.q, strict=True)):
        stops.setdefault((name, q.tobytes()), []).append(row)
    move, elapsed = np.zeros(points.q.shape), np.zeros(points.poses)
    for k, (name, q) in enumerate(zip(points.pose_ids, points.q, strict=True)):
        rows = stops.get((str(name), np.asarray(q).tobytes()), [])
        if rows:
            elapsed[k] = np.mean(rows)
            move[k] = _same(whole.moves[rows])
    return Motion(points.q, move, elapsed, readings=not measurements.programmed)


def _same(moves: FloatArray) -> FloatArray:
    """The move of several stops where it is the same, else zero."""
    return moves[0] if (moves == moves[0]).all() else np.zeros(moves.shape[1])
