"""What each pose says of all unknowns of a robot: normal equations, pose by pose, of a robot fitted to all of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from irbcal.arrays import FloatArray, IntArray
from irbcal.errors import IdentificationError
from irbcal.identification.fit import Fit, identify
from irbcal.measurement.points import PointSet
from irbcal.modeling.arm import Arm
from irbcal.modeling.parameters import default_level


class PoseSums(NamedTuple):
    """Normal equations of all unknowns, each scaled by its own size.

    Attributes
    ----------
    H : ndarray, shape (n, p, p)
    g : ndarray, shape (n, p)
    yy : ndarray, shape (n,)
        Squares, m^2.
    """

    H: FloatArray
    g: FloatArray
    yy: FloatArray

    @property
    def unknowns(self) -> int:
        """Their number."""
        return self.H.shape[1]


@dataclass(frozen=True, eq=False)
class PoseEquations:
    """Poses in the order of measuring, and what each says of the robot that was identified from all.

    Attributes
    ----------
    arm : Arm
        Nominal.
    points : PointSet
    """

    arm: Arm
    points: PointSet

    def of_most(self, count: int) -> PoseEquations:
        """The same of at most so many poses, evenly chosen."""
        n = self.points.poses
        if n <= count:
            return self
        return replace(self, points=self.points.select(np.isin(np.arange(n), evenly(n, count))))

    @cached_property
    def sums(self) -> PoseSums | None:
        """The equations; None where the robot cannot be identified."""
        try:
            fit = identify(self.arm, self.points.with_seen_targets(), default_level(self.arm))
        except IdentificationError:
            return None
        return sums(fit, self.points.poses)


def evenly(n: int, count: int) -> IntArray:
    """Numbers of so many of n poses, evenly chosen."""
    return np.linspace(0, n - 1, count).astype(int)


def sums(fit: Fit, n: int) -> PoseSums:
    """Normal equations of a fit for each of n poses."""
    problem, state = fit.problem, fit.solution.state
    m = len(problem.points)
    J = problem.jacobian(state).reshape(-1, 3, problem.unknowns)[:m]
    r = problem.residuals(state)[:m]
    J = J / np.maximum(np.sqrt((J**2).sum(axis=(0, 1))), 1e-300)
    H, g, yy = np.zeros((n, problem.unknowns, problem.unknowns)), np.zeros((n, problem.unknowns)), np.zeros(n)
    np.add.at(H, problem.points.pose, np.einsum("mca,mcb->mab", J, J))
    np.add.at(g, problem.points.pose, np.einsum("mca,mc->ma", J, r))
    np.add.at(yy, problem.points.pose, (r**2).sum(axis=1))
    return PoseSums(H, g, yy)
