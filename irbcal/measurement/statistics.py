"""Statistics of errors, as the tables of Nubiola 2011, chapter 7, have them."""

import numpy as np

from irbcal.units import DEG, MM


def rotation_statistics(angles):
    """Mean, standard deviation and maximum of angles in radians, in degrees; None for none."""
    a = np.asarray(angles, dtype=float) / DEG
    if not len(a):
        return None
    sigma = float(a.std(ddof=1)) if len(a) > 1 else 0.0
    return {"n": len(a), "mean_deg": float(a.mean()), "sigma_deg": sigma, "max_deg": float(a.max())}


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
