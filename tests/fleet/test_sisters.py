"""A robot unlike its sisters is named."""

from dataclasses import replace

import numpy as np
import pytest

from irbcal.fleet import sisters
from irbcal.fleet.store import Estimate

K = 3


def estimate(values, C, prior):
    names = tuple(f"delta_theta{j}" for j in range(1, K + 1))
    return Estimate(names, ("rad",) * K, np.asarray(values), np.asarray(prior), np.full(K, 1e-3), np.asarray(C))


@pytest.fixture
def many(stored):
    """Forty robots drawn about a mean, each seen through noise with a prior of its own."""
    rng = np.random.default_rng(5)
    mean, scatter, noise, prior = np.array([1e-3, -5e-4, 0.0]), np.array([1e-4, 2e-4, 5e-5]), 5e-5, np.full(K, 1e-3)
    out = []
    for k in range(40):
        truth = mean + scatter * rng.standard_normal(K)
        A = rng.standard_normal((K, K)) + 2 * np.eye(K)  # what the data show, correlated
        precision = A.T @ A / noise**2
        seen = truth + np.linalg.solve(A, noise * rng.standard_normal(K))
        C = np.linalg.inv(precision + np.diag(1 / prior**2))
        out.append(
            replace(
                stored[0],
                robot={**stored[0].robot, "id": f"R{k:02d}"},
                fit=estimate(C @ precision @ seen, C, prior),
                level=estimate(seen, np.linalg.inv(precision), np.full(K, np.inf)),
            )
        )
    return out


def test_a_robot_unlike_its_sisters_is_named(many):
    robots = many
    assert sisters.standing_out(robots) == []
    values = np.array(robots[7].level.values)
    values[1] += 3e-3
    robots[7] = replace(robots[7], level=replace(robots[7].level, values=values))
    (found,) = sisters.standing_out(robots)
    assert found.robot == "R07"
    assert found.words.startswith("joint 2's zero is 0.17")
    assert sisters.standing_out(robots[5:9]) == []


def test_the_last_calibration_of_each_robot_counts(stored):
    again = replace(stored[0], calibration={**stored[0].calibration, "model": "later"})
    assert sisters.latest([stored[0], again, stored[1]]) == [again, stored[1]]
