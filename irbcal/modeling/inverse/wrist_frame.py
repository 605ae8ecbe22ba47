"""Rotation of the hand and centre of the wrist from the pose of the tip (Nubiola 2011, eqs. 6.2 and 6.3).

Poses are here columns x, y, z and origin in arrays of shape (12, n): a row of numbers for each element.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from irbcal.arrays import FloatArray, lock
from irbcal.modeling import frames

ROUNDING = 1e-15
"""Elements up to this of the linear map are from the cosines of right angles."""


@dataclass(frozen=True, eq=False, repr=False)
class WristFrame:
    """The map from the tip to the wrist.

    Attributes
    ----------
    linear : ndarray, shape (12, 12)
    constant : ndarray, shape (3,)
        Metres, added to the wrist centre.
    """

    linear: FloatArray
    constant: FloatArray

    def __post_init__(self) -> None:
        lock(self)

    @staticmethod
    def of(left: FloatArray, right: FloatArray) -> WristFrame:
        """The map of poses T to ``left @ T @ right``, all (4, 4)."""
        linear = np.kron(right.T, left[:3, :3])
        linear[np.abs(linear) <= ROUNDING] = 0.0
        return WristFrame(np.asarray(linear, dtype=float), left[:3, 3])

    def place(self, columns: FloatArray, out: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Columns n, o, a of the hand (9, n) and wrist centre (3, n).

        Parameters
        ----------
        columns : ndarray, shape (12, n)
            Of the tip in the base.
        out : ndarray, shape (12, n)
            Room for them.

        Returns
        -------
        rotation : ndarray, shape (9, n)
            The columns themselves where the hand has the axes of the tip.
        centre : ndarray, shape (3, n)
            Metres.
        """
        if self._products is None:
            # in pieces too small for threads of the BLAS, which would wait where other work goes on
            for start in range(0, columns.shape[1], 1024):
                piece = slice(start, start + 1024)
                np.matmul(self.linear, columns[:, piece], out=out[:, piece])
            rotation = out[:9]
        else:
            first, rotation = (9, columns[:9]) if self._same_axes else (0, out[:9])
            spare = np.empty(columns.shape[1])
            for row, ((k, factor), *others) in zip(out[first:], self._products[first:], strict=True):
                np.multiply(columns[k], factor, out=row)
                for k, factor in others:
                    np.add(row, np.multiply(columns[k], factor, out=spare), out=row)
        centre = out[9:]
        return rotation, np.add(centre, self.constant[:, None], out=centre)

    @cached_property
    def _products(self) -> list[list[tuple[int, float]]] | None:
        """Places and factors of each element's sum; None where there are so many that a product of matrices is less.

        Few they are where the axes of tip, flange and base are parallel.
        """
        if np.count_nonzero(self.linear) > 2 * len(self.linear):
            return None
        return [[(int(k), float(row[k])) for k in np.flatnonzero(row)] for row in self.linear]

    @cached_property
    def _same_axes(self) -> bool:
        return bool(np.array_equal(self.linear[:9], np.eye(9, 12)))


def between(before: FloatArray, after: FloatArray, d1: float, d6: float) -> WristFrame:
    """The map for an arm: ``before`` joint 1 and ``after`` joint 6 (4, 4), and the distances along their axes (m)."""
    left = frames.transform(None, [0.0, 0.0, -d1]) @ frames.inverse(before)
    return WristFrame.of(left, frames.inverse(after) @ frames.transform(None, [0.0, 0.0, -d6]))
