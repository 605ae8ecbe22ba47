"""Accuracy: statistics of the distances between measured and predicted points."""

import numpy as np

from irbcal.units import MM


def distances(robot, points):
    """Distance of each measured point from its prediction.

    Parameters
    ----------
    robot : Robot
    points : PointSet
        In the robot's measuring frame; every target must be one of the robot's.

    Returns
    -------
    ndarray, shape (m,)
        Metres.
    """
    local = np.array([robot.targets[name] for name in points.target_names])[points.target]
    T = robot.poses(points.q)
    R, p = T[points.pose, :3, :3], T[points.pose, :3, 3]
    base = np.einsum("mij,mj->mi", R, local) + p
    predicted = base @ robot.T_world_base[:3, :3].T + robot.T_world_base[:3, 3]
    return np.linalg.norm(points.xyz - predicted, axis=1)


def statistics(distance):
    """Mean, standard deviation and maximum of distances, as the tables of Nubiola 2011, chapter 7.

    Parameters
    ----------
    distance : ndarray, shape (m,)
        Metres.

    Returns
    -------
    dict or None
        ``n``, ``mean_mm``, ``sigma_mm`` (with n - 1), ``max_mm``, ``mean_plus_3sigma_mm``, ``rms_mm``;
        None for no distances.
    """
    d = np.asarray(distance, dtype=float) / MM
    if not len(d):
        return None
    sigma = float(d.std(ddof=1)) if len(d) > 1 else 0.0
    mean = float(d.mean())
    return {
        "n": len(d),
        "mean_mm": mean,
        "sigma_mm": sigma,
        "max_mm": float(d.max()),
        "mean_plus_3sigma_mm": mean + 3 * sigma,
        "rms_mm": float(np.sqrt(np.mean(d**2))),
    }


def statistics_by(distance, labels):
    """`statistics` of the distances of each label, as a dict in the order of the sorted labels."""
    labels = np.asarray(labels, dtype=object)
    return {str(label): statistics(distance[labels == label]) for label in sorted(set(labels))}
