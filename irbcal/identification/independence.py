"""Whether the points of a pose err by themselves, or together.

What a model does not describe of the robot moves all reflectors of a pose as one body; a tracker's noise does not. A
fit takes coordinates of a pose for dependent, as they are on measured robots
(`irbcal.identification.evidence_maximisation.fit_likelihood_power`). Where a pose's residuals are no larger in the six
directions of a rigid motion than across these, all that is left is noise, and each coordinate counts for itself.
"""

from __future__ import annotations

import numpy as np

from irbcal.arrays import FloatArray, IntArray
from irbcal.distributions import f_survival
from irbcal.identification.evidence_maximisation import Posterior
from irbcal.identification.linear_model import LinearModel

FEWEST_DEGREES_OF_FREEDOM = 30
"""Degrees of freedom of either part below which nothing is said."""
CERTAINTY = 0.95
"""Share of independent errors that pass."""
RIGID = 6
"""Columns of the base's motion, the first ones: what moves a pose as one body."""


def along_and_across(linear: LinearModel, columns: IntArray, fit: Posterior) -> tuple[FloatArray, FloatArray]:
    """Sums of squares of residuals along rigid motions of each pose and across them, and their numbers.

    Parameters
    ----------
    linear : LinearModel
    columns : ndarray of int
        Of the fit.
    fit : Posterior

    Returns
    -------
    squares, freedom : ndarray, shape (2,)
        Along and across, mm^2; degrees of freedom less those of the fit.
    """
    squares, freedom = np.zeros(2), np.zeros(2)
    for block in linear.blocks(columns):
        e = block.y - fit.c @ block.J
        first = np.flatnonzero(np.r_[True, block.pose[1:] != block.pose[:-1]])
        sizes = np.diff(np.r_[first, len(e)])
        for size in np.unique(sizes):
            rows = first[sizes == size][:, None] + np.arange(size)
            U, s, _ = np.linalg.svd(block.J[:RIGID][:, rows].transpose(1, 2, 0), full_matrices=False)
            along = s > 1e-6 * s[:, :1]
            share = np.einsum("prk,pr->pk", U, e[rows]) ** 2 * along
            squares += share.sum(), (e[rows] ** 2).sum() - share.sum()
            freedom += along.sum(), rows.size - along.sum()
    shape = max(linear.nuisance - 2 * RIGID, 0)  # of the reflectors to one another
    return squares, freedom - [linear.nuisance - shape + float(fit.gammas.sum()), shape]


def independent(linear: LinearModel, columns: IntArray, fit: Posterior) -> bool:
    """Whether what a fit leaves over is as small along rigid motions of a pose as across them."""
    squares, freedom = along_and_across(linear, columns, fit)
    if freedom.min() < FEWEST_DEGREES_OF_FREEDOM or not (squares > 0.0).all():
        return False
    along, across = squares / freedom
    return f_survival(along / across, *freedom) >= 1.0 - CERTAINTY
