"""Which poses are worst, and where: joints, target, error vector."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.plotting.pose_errors import PoseErrors
from irbcal.units import MM


@dataclass(frozen=True)
class WorstPose:
    """A pose with a large error, and its worst point.

    Attributes
    ----------
    pose, group, target : str
        Names; the target is that of the worst point.
    joints : tuple of float
        In degrees and mm; empty where they are not known.
    error_mm, nominal_mm : float
        Of the worst point, by the judged and by the nominal robot.
    vector_mm : tuple of three float, or None
        Measured minus predicted along the axes of the base link.
    """

    pose: str
    group: str
    target: str
    joints: tuple[float, ...]
    error_mm: float
    nominal_mm: float
    vector_mm: tuple[float, ...] | None


def worst_poses(poses: PoseErrors, joints: FloatArray | None = None, count: int = 10) -> list[WorstPose]:
    """The poses with the largest errors of single points, the worst first.

    Parameters
    ----------
    poses : PoseErrors
        Judged is the last of its models: the calibrated one where there is one.
    joints : ndarray, shape (n, joints), optional
        Of the poses, degrees and mm.
    count : int
    """
    judged, nominal = list(poses.models.values())[-1], poses.models["nominal"]
    order = np.argsort(-judged.distance, kind="stable")
    first = order[np.sort(np.unique(poses.pose[order], return_index=True)[1])][:count]
    return [
        WorstPose(
            poses.pose_names[pose],
            poses.groups[pose],
            poses.target[row],
            () if joints is None else tuple(joints[pose].tolist()),
            float(judged.distance[row] / MM),
            float(nominal.distance[row] / MM),
            None if judged.vector is None else tuple((judged.vector[row] / MM).tolist()),
        )
        for row, pose in ((int(row), int(poses.pose[row])) for row in first)
    ]
