"""Statistics of errors, as the tables of Nubiola 2011, section 7.7, have them."""

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from irbcal.arrays import FloatArray
from irbcal.units import DEG, MM

Statistics: TypeAlias = dict[str, float]
"""What `statistics` and `rotation_statistics` return; ``n`` is an int."""


def statistics(distance: ArrayLike) -> Statistics | None:
    """Mean, standard deviation and maximum of distances, as the tables of Nubiola 2011, section 7.7.

    Parameters
    ----------
    distance : array_like, shape (m,)
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
    sigma = _sigma(d)
    mean = float(d.mean())
    return {
        "n": len(d),
        "mean_mm": mean,
        "sigma_mm": sigma,
        "max_mm": float(d.max()),
        "mean_plus_3sigma_mm": mean + 3 * sigma,
        "rms_mm": float(np.sqrt(np.mean(d**2))),
    }


def statistics_by(distance: FloatArray, labels: Sequence[str] | NDArray[Any]) -> dict[str, Statistics | None]:
    """`statistics` of the distances of each label, as a dict in the order of the sorted labels."""
    labels = np.asarray(labels, dtype=object)
    return {str(label): statistics(distance[labels == label]) for label in sorted(set(labels))}


def rotation_statistics(angles: ArrayLike) -> Statistics | None:
    """Mean, standard deviation and maximum of angles, as Nubiola 2011, section 7.7.3.5.

    Parameters
    ----------
    angles : array_like, shape (m,)
        Radians.

    Returns
    -------
    dict or None
        ``n``, ``mean_deg``, ``sigma_deg`` (with n - 1), ``max_deg``; None for no angles.
    """
    a = np.asarray(angles, dtype=float) / DEG
    if not len(a):
        return None
    return {"n": len(a), "mean_deg": float(a.mean()), "sigma_deg": _sigma(a), "max_deg": float(a.max())}


def _sigma(values: FloatArray) -> float:
    """Standard deviation with n - 1, 0 of a single value."""
    return float(values.std(ddof=1)) if len(values) > 1 else 0.0
