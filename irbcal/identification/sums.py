"""What a linear model needs to know of the data."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from irbcal.arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Sums:
    """Normal equations of all columns, flat ones first.

    Attributes
    ----------
    H : ndarray, shape (columns, columns)
        ``J^T J``, mm^2.
    g : ndarray, shape (columns,)
        ``J^T y``, mm^2.
    yy : float
        ``y^T y``, mm^2.
    equations : int
    """

    H: FloatArray
    g: FloatArray
    yy: float
    equations: int

    def part(self, columns: IntArray) -> Sums:
        """The sums of some columns."""
        return Sums(self.H[np.ix_(columns, columns)], self.g[columns], self.yy, self.equations)
