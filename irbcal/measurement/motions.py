"""How the arm came to each measured pose: what terms of an error model are functions of."""

from __future__ import annotations

import numpy as np

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
        Time is the number of the pose, the mean number of poses that share a name and joints. The last move is zero
        where the stop before is not known.
    """
    first = measurements.table.groupby("pose_index", sort=True)["pose"].first().astype(str)
    stops: dict[tuple[str, bytes], list[int]] = {}
    for row, (name, q) in enumerate(zip(first, measurements.joints(), strict=True)):
        stops.setdefault((name, q.tobytes()), []).append(row)
    elapsed = np.array(
        [
            np.mean(stops.get((str(name), np.asarray(q).tobytes()), [0]))
            for name, q in zip(points.pose_ids, points.q, strict=True)
        ]
    )
    return Motion(points.q, points.moves(), elapsed, readings=not measurements.programmed)
