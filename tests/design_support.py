"""What several tests of optimal plans need: poses, and random candidates and aims."""

import numpy as np
import pytest
from support import arm

from irbcal.planning.conditions import Targets
from irbcal.planning.optimal_design import Aim, Candidates, Criterion, LogDeterminant, MeanSquaredError

PLACES = np.array([[-0.087, 0.087, 0.11], [0.084, 0.084, 0.11], [0.086, -0.086, 0.11]])


TARGETS = Targets(("smr1", "smr2", "smr3"), PLACES)


def poses(n, seed, nominal=None):
    q = (nominal or arm()).random_joints(n, seed)
    seen = np.random.default_rng(seed).random((n, 3)) < 0.6
    seen[~seen.any(axis=1), 0] = True
    return q, seen


def random_candidates(n, r=2, p=9, h=4, seed=0):
    rng = np.random.default_rng(seed)
    return Candidates(5 * rng.standard_normal((n, r, p)), rng.standard_normal((n, r, h)))


class LargestVariance(Criterion):
    """A criterion as a user may add it: E-optimality, the largest eigenvalue of the covariance."""

    @classmethod
    def for_model(cls, model, q, target, unmodelled):
        return cls()

    def value(self, M, N):
        return 1.0 / np.linalg.eigvalsh(M)[0]


def random_aim(kind, p=9, h=4, nuisance=3, seed=1):
    rng = np.random.default_rng(seed)
    J, E = rng.standard_normal((40, p)), rng.standard_normal((40, h))
    criteria = {
        "D": LogDeterminant(nuisance),
        "position": MeanSquaredError(J.T @ J / 40, np.zeros((p, 0))),
        "unmodelled": MeanSquaredError(J.T @ J / 40, J.T @ E / 40, float(np.sum(E**2)) / 40),
        "new": LargestVariance(),
    }
    return Aim(criteria[kind])


def without_errors(candidates, kind):
    return candidates if kind == "unmodelled" else Candidates.without_errors(candidates.rows)


KINDS = pytest.mark.parametrize("kind", ["D", "position", "unmodelled", "new"])
