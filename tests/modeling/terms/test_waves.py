"""Terms as waves: against sines by hand, the sums that they stand for, and central differences."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support import arm, assert_derivative

from irbcal.modeling.arm import Arm
from irbcal.modeling.dhm import DHMTable
from irbcal.modeling.terms.gravity import Gravity
from irbcal.modeling.terms.situation import Motion, Situation
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.waves import Waves, expanded_lever

DOWN = (0.0, 0.0, -1.0)


def values(waves, q, factor=None):
    out = np.zeros(q.shape)
    waves.add(q, out, factor)
    return out


def random_arm(rng, joints, square):
    """A chain with some prismatic joints, axes at right angles or anyhow."""
    alpha = rng.integers(-1, 3, joints) * np.pi / 2 if square else rng.uniform(-3, 3, joints)
    beta = np.zeros(joints) if square else rng.uniform(-0.5, 0.5, joints)
    a, theta, d, b = rng.uniform(-1, 1, (4, joints))
    table = DHMTable(alpha, a, theta, d, beta, b, rng.uniform(size=joints) < 0.2)
    names = tuple(f"j{k}" for k in range(joints))
    limits = np.full(joints, 3.0)
    return Arm("random", table, np.eye(4), np.eye(4), names, -limits, limits, "base", "tip")


def test_sines_by_hand():
    """``0.3 sin(q2 + q3 + 0.2)`` on joints 2 and 3, a series of joint 1, and 2.5 turns of joint 3 on joint 1."""
    turns = {"sum": (0.0, 1.0, 1.0), "half": (0.0, 0.0, 2.5), "none": (0.0, 0.0, 0.0)}
    series = {k: complex(*np.random.default_rng(k).normal(size=2)) for k in (1, 2, 3, 7, 12)}
    weight = 0.3 * np.exp(1j * (0.2 - np.pi / 2))
    weights = {(1, turns["sum"]): weight, (2, turns["sum"]): weight, (0, turns["half"]): 0.1j, (2, turns["none"]): 0.7}
    weights |= {(0, (float(k), 0.0, 0.0)): w for k, w in series.items()}
    q = np.random.default_rng(0).uniform(-3, 3, (5000, 3))
    expected = np.zeros(q.shape)
    expected[:, 1] = 0.3 * np.sin(q[:, 1] + q[:, 2] + 0.2)
    expected[:, 2] = expected[:, 1] + 0.7
    expected[:, 0] = -0.1 * np.sin(2.5 * q[:, 2])
    for k, w in series.items():
        expected[:, 0] += w.real * np.cos(k * q[:, 0]) - w.imag * np.sin(k * q[:, 0])
    waves = Waves(3, weights)
    assert np.abs(values(waves, q) - expected).max() < 1e-13
    factor = np.linspace(-1.0, 2.0, len(q))
    assert np.abs(values(waves, q, factor) - factor[:, None] * expected).max() < 1e-13
    for row in q[:5]:
        slopes = np.zeros((1, 3, 3))
        waves.add_slopes(row[None], slopes)
        assert_derivative(lambda x: values(waves, x[None])[0], row, slopes[0], 1e-7)
    assert (np.abs(expected[:, 1:]) <= waves.bound[1:] + 1e-12).all()


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10_000), st.integers(2, 6), st.booleans())
def test_levers_of_any_chain_are_what_the_basis_says(seed, joints, square):
    rng = np.random.default_rng(seed)
    chain = random_arm(rng, joints, square)
    joint = int(rng.choice(np.flatnonzero(~chain.table.prismatic))) if not chain.table.prismatic.all() else 0
    link, vector, down = int(rng.integers(joint, joints)), rng.normal(size=3), rng.normal(size=3)
    term = Term(joint, "rz", "gravity", 1.0, "", "", "rad", {"link": link + 1, "vector": tuple(vector.tolist())})
    q, dq = rng.uniform(-3, 3, (2, 20, joints))
    here = Situation(chain, Motion(q), tuple(down.tolist()))
    waves = Waves(joints, {(joint, turns): w for turns, w in expanded_lever(chain, joint, link, vector, down).items()})
    size = np.linalg.norm(vector) * np.linalg.norm(down)
    assert np.abs(values(waves, q)[:, joint] - Gravity().values([term], here)[0]).max() < 1e-13 * size
    slopes, rates = np.zeros((2, 20, joints, joints))
    waves.add_slopes(q, slopes)
    waves.add_slope_rates(q, dq, rates)
    assert np.abs(slopes[:, joint] - Gravity().slopes([term], here)[0]).max() < 1e-13 * size
    assert np.abs(rates[:, joint] - Gravity().slope_rates([term], here, dq)[0]).max() < 1e-12 * size


def test_a_wrist_has_tens_of_waves_and_a_long_chain_too_many():
    nominal = arm("irb120")
    assert 10 < len(expanded_lever(nominal, 1, 5, (0.1, 0.2, 0.3), DOWN)) < 30
    assert expanded_lever(nominal, 0, 5, (0.1, 0.2, 0.3), DOWN) == {}, "nothing turns about a vertical axis"
    anyhow = random_arm(np.random.default_rng(1), 9, False)
    anyhow = anyhow.with_table(DHMTable(*(getattr(anyhow.table, k) for k in ("alpha", "a", "theta", "d", "beta", "b"))))
    assert expanded_lever(anyhow, 0, 8, (0.1, 0.2, 0.3), DOWN) is None


@pytest.mark.parametrize("n", [0, 1, 33, 2000])
def test_blocks_of_poses_do_not_matter(n):
    rng = np.random.default_rng(3)
    keys = [(int(rng.integers(0, 6)), tuple(float(x) for x in rng.integers(-1, 2, 6))) for _ in range(150)]
    waves = Waves(6, {key: complex(*rng.normal(size=2)) for key in keys})
    q = rng.uniform(-3, 3, (n, 6))
    one_by_one = np.array([values(waves, row[None])[0] for row in q]).reshape(n, 6)
    assert np.abs(values(waves, q) - one_by_one).max(initial=0.0) < 1e-12
