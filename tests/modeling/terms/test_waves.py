"""Terms as waves: against the functions that they stand for."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from support import arm

from irbcal.modeling.arm import Arm
from irbcal.modeling.dhm import DHMTable
from irbcal.modeling.terms.gravity import Gravity
from irbcal.modeling.terms.situation import Motion, Situation
from irbcal.modeling.terms.term import Term
from irbcal.modeling.terms.waves import expanded_lever

DOWN = (0.0, 0.0, -1.0)


def random_arm(rng, joints, square):
    """A chain with some prismatic joints, axes at right angles or anyhow."""
    alpha = rng.integers(-1, 3, joints) * np.pi / 2 if square else rng.uniform(-3, 3, joints)
    beta = np.zeros(joints) if square else rng.uniform(-0.5, 0.5, joints)
    a, theta, d, b = rng.uniform(-1, 1, (4, joints))
    table = DHMTable(alpha, a, theta, d, beta, b, rng.uniform(size=joints) < 0.2)
    names = tuple(f"j{k}" for k in range(joints))
    limits = np.full(joints, 3.0)
    return Arm("random", table, np.eye(4), np.eye(4), names, -limits, limits, "base", "tip")


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10_000), st.integers(2, 6), st.booleans())
def test_levers_of_any_chain_are_what_the_basis_says(seed, joints, square):
    rng = np.random.default_rng(seed)
    chain = random_arm(rng, joints, square)
    joint = int(rng.choice(np.flatnonzero(~chain.table.prismatic))) if not chain.table.prismatic.all() else 0
    link, vector, down = int(rng.integers(joint, joints)), rng.normal(size=3), rng.normal(size=3)
    term = Term(joint, "rz", "gravity", 1.0, "", "", "rad", {"link": link + 1, "vector": tuple(vector.tolist())})
    q = rng.uniform(-3, 3, (20, joints))
    here = Situation(chain, Motion(q), tuple(down.tolist()))
    waves = expanded_lever(chain, joint, link, vector, down)
    turns = np.array([*waves], dtype=float).reshape(-1, joints)
    values = (np.array([*waves.values()]) * np.exp(1j * q @ turns.T)).real.sum(axis=1)
    size = np.linalg.norm(vector) * np.linalg.norm(down)
    assert np.abs(values - Gravity().values([term], here)[0]).max() < 1e-13 * size


def test_a_wrist_has_tens_of_waves_and_a_long_chain_too_many():
    nominal = arm("irb120")
    assert 10 < len(expanded_lever(nominal, 1, 5, (0.1, 0.2, 0.3), DOWN)) < 30
    assert expanded_lever(nominal, 0, 5, (0.1, 0.2, 0.3), DOWN) == {}, "nothing turns about a vertical axis"
    anyhow = random_arm(np.random.default_rng(1), 9, False)
    anyhow = anyhow.with_table(DHMTable(*(getattr(anyhow.table, k) for k in ("alpha", "a", "theta", "d", "beta", "b"))))
    assert expanded_lever(anyhow, 0, 8, (0.1, 0.2, 0.3), DOWN) is None
