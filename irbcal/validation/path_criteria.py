"""Path accuracy AT and repeatability RT of ISO 9283:1998.

The formulas are those of public descriptions of the standard; the standard itself was not at hand. Lengths are in
metres, angles in radians.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from irbcal.arrays import FloatArray, IntArray, lock
from irbcal.errors import MeasurementError
from irbcal.validation.pose_criteria import small_angles

BLOCK = 2_000_000
"""Numbers that are worked on at a time."""


@dataclass(frozen=True, eq=False)
class PathErrors:
    """Errors of a path on planes normal to the commanded one.

    Attributes
    ----------
    mean : ndarray, shape (m, 3)
        Barycentre of the cycles on each plane minus the commanded point, metres.
    repeatability : ndarray, shape (m,)
        ``mean(l) + 3 S_l`` on each plane, metres.
    mean_angles, angle_repeatability : ndarray, shape (m, 3), or None
        Mean angles and 3 S of the angles, radians.
    planes : ndarray of int, shape (m,)
        Commanded points whose planes all cycles cross.
    """

    mean: FloatArray
    repeatability: FloatArray
    mean_angles: FloatArray | None
    angle_repeatability: FloatArray | None
    planes: IntArray

    def __post_init__(self) -> None:
        lock(self)

    @property
    def AT(self) -> float:
        """Path accuracy: largest distance of the mean path from the commanded one, metres."""
        return float(np.linalg.norm(self.mean, axis=1).max())

    @property
    def RT(self) -> float:
        """Path repeatability: largest over the planes, metres."""
        return float(self.repeatability.max())


def path_errors(
    paths: Sequence[FloatArray],
    commanded: FloatArray,
    rotations: Sequence[FloatArray] | None = None,
    commanded_rotations: FloatArray | None = None,
) -> PathErrors:
    """Path accuracy AT and repeatability RT from sampled paths.

    Each cycle's path is taken as straight between its samples and cut by the planes normal to the commanded path; of
    several cuts the one nearest to the commanded point counts. Planes that not every cycle crosses (at the ends) are
    left out.

    Parameters
    ----------
    paths : sequence of ndarray, shape (k, 3)
        Samples of each cycle, in order, metres.
    commanded : ndarray, shape (m, 3)
        Points of the commanded path, in order, metres.
    rotations : sequence of ndarray, shape (k, 3, 3), optional
    commanded_rotations : ndarray, shape (m, 3, 3), optional

    Returns
    -------
    PathErrors

    Raises
    ------
    MeasurementError
        If there are fewer than two cycles, or no plane is crossed by all.
    """
    if len(paths) < 2:
        raise MeasurementError("path accuracy and repeatability need two cycles or more")
    along = _directions(commanded)
    places, shares = zip(*(_cuts(path, commanded, along) for path in paths), strict=True)
    cuts = np.array([_between(*cut) for cut in zip(paths, places, shares, strict=True)])
    planes = np.flatnonzero(np.isfinite(cuts).all(axis=(0, 2)))
    if not len(planes):
        raise MeasurementError("no plane normal to the commanded path is crossed by every cycle")
    cuts = cuts[:, planes]
    mean = cuts.mean(axis=0)
    distance = np.linalg.norm(cuts - mean, axis=2)
    angles = None
    if rotations is not None and commanded_rotations is not None:
        turned = zip(rotations, places, shares, strict=True)
        angles = np.array([_angles_between(*cut, commanded_rotations)[planes] for cut in turned])
    return PathErrors(
        mean - commanded[planes],
        distance.mean(axis=0) + 3 * distance.std(axis=0, ddof=1),
        None if angles is None else angles.mean(axis=0),
        None if angles is None else 3 * angles.std(axis=0, ddof=1),
        planes,
    )


def _directions(commanded: FloatArray) -> FloatArray:
    """Unit vectors along a path, shape (m, 3)."""
    along = np.gradient(commanded, axis=0)
    length = np.linalg.norm(along, axis=1)
    if (length == 0).any():
        raise MeasurementError("the commanded path has points that do not move on")
    return along / length[:, None]


def _cuts(path: FloatArray, commanded: FloatArray, along: FloatArray) -> tuple[IntArray, FloatArray]:
    """Segment of a path that cuts each plane (-1 for none), and where on it."""
    at, share = np.full(len(commanded), -1), np.full(len(commanded), np.nan)
    step = max(1, BLOCK // len(path))
    for start in range(0, len(commanded), step):
        part = slice(start, start + step)
        # height (planes, samples) above each plane
        height = along[part] @ path.T - np.sum(along[part] * commanded[part], axis=1)[:, None]
        low, high = height[:, :-1], height[:, 1:]
        crossed = (low * high <= 0) & (low != high)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = np.where(crossed, low / (low - high), 0.0)
        place = path[:-1] + t[..., None] * (path[1:] - path[:-1])
        far = np.where(crossed, np.linalg.norm(place - commanded[part][:, None], axis=2), np.inf)
        best = np.argmin(far, axis=1)
        rows = np.arange(len(best))
        found = np.isfinite(far[rows, best])
        at[part] = np.where(found, best, -1)
        share[part] = np.where(found, t[rows, best], np.nan)
    return at, share


def _between(path: FloatArray, at: IntArray, share: FloatArray) -> FloatArray:
    """Places of the cuts, shape (m, 3); NaN for none."""
    start = np.maximum(at, 0)
    place = path[start] + share[:, None] * (path[start + 1] - path[start])
    return np.where(at[:, None] >= 0, place, np.nan)


def _angles_between(rotations: FloatArray, at: IntArray, share: FloatArray, commanded: FloatArray) -> FloatArray:
    """Angles from the commanded orientation at the cuts, on the line between those of two samples, shape (m, 3)."""
    first, second = (small_angles(rotations[np.maximum(at, 0) + k], commanded) for k in (0, 1))
    return np.where(at[:, None] >= 0, first + share[:, None] * (second - first), np.nan)
