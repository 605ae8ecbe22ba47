"""Numbers of corners on boards that look the same after half a turn: the finder counts them from either end."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.measurement.features import FeatureSet
from irbcal.measurement.pinhole import boards

REFERENCES = 40
"""Pictures that the others are compared with to number their corners alike."""


def numbered_alike(rows: FeatureSet, R: FloatArray) -> FeatureSet:
    """Rows whose corners are numbered alike in all pictures, on boards that look the same after half a turn.

    The finder then numbers corners from either end, as the picture shows them. The first picture's numbers stay; each
    other picture's are turned if the board then turns between pictures by the angles that the flange turns by.

    Parameters
    ----------
    rows : FeatureSet
    R : ndarray, shape (m, 3, 3)
        Orientation of the flange at each row, in the base link.
    """
    if rows.corners is None:
        return rows
    corners = rows.corners.copy()
    for name, feature in rows.features.items():
        view = feature.imaging
        if view is None or view.board is None or not view.board.turnable:
            continue
        rows_of_feature = np.flatnonzero(rows.feature == name)
        middle = view.corners.min(axis=0) + view.corners.max(axis=0)
        turned = corners[rows_of_feature]
        turned[:, :, :2] = middle - turned[:, :, :2]
        D = np.stack([boards(view.lens, each)[:, :3, :3] for each in (corners[rows_of_feature], turned)])
        chosen = np.zeros(len(rows_of_feature), dtype=int)
        n = 1
        while n < len(rows_of_feature):  # each picture by those before it, twice as many at a time
            new, references = np.arange(n, min(2 * n, len(rows_of_feature))), np.arange(n)[-REFERENCES:]
            by_flange = _angles(R[rows_of_feature[references]], R[rows_of_feature[new]])
            off = [
                np.abs(_angles(D[chosen[references], references], D[k, new]) - by_flange).sum(axis=0) for k in (0, 1)
            ]
            chosen[new] = off[1] < off[0]
            n += len(new)
        corners[rows_of_feature] = np.where(chosen[:, None, None] == 1, turned, corners[rows_of_feature])
    return replace(rows, corners=corners)


def _angles(A: FloatArray, B: FloatArray) -> FloatArray:
    """Angles between rotations, (len(A), len(B)), radians."""
    trace = np.einsum("aij,bij->ab", A, B)
    return np.asarray(np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0)))
