"""From axes to a DHM table: the same arm again, however its axes lie."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support import arm, assert_same_poses, random_rotation

from irbcal.modeling import dhm, frames
from irbcal.modeling.extraction import NEARLY_PARALLEL, dhm_from_axes

TABLE_5_1 = np.array(
    [[0, 0, 0, 486.5], [-90, 150, -90, 0], [0, 700, 0, 0], [-90, 0, 0, 600], [90, 0, 0, 0], [-90, 0, 180, 65]]
)
"""Nubiola 2011, Table 5.1: alpha (degrees), a (mm), theta (degrees), d (mm)."""


def axes_of(table, T_base_0, T_last_tip):
    """A point on each axis (any), its direction, and the tip at zero joints."""
    chain = dhm.chain_frames(table, table.offsets[:, None], T_base_0, T_last_tip)
    along = np.random.default_rng(0).uniform(-2, 2, (len(table), 1))
    T_base_tip = dhm.forward(table, np.zeros((1, len(table))), T_base_0, T_last_tip)[0]
    return chain.o[:, :, 0] + along * chain.z[:, :, 0], chain.z[:, :, 0], T_base_tip


def assert_same_arm(table, T_base_0, T_last_tip, prismatic=None, metres=1e-12):
    points, axes, T_base_tip = axes_of(table, T_base_0, T_last_tip)
    found, T_0, T_tip = dhm_from_axes(points, axes, T_base_tip, prismatic)
    q = np.random.default_rng(1).uniform(-2, 2, (50, len(table)))
    assert_same_poses(dhm.forward(found, q, T_0, T_tip), dhm.forward(table, q, T_base_0, T_last_tip), metres, 1e-12)
    return found


def test_table_5_1_is_what_the_axes_of_the_irb1600_give():
    nominal = arm()
    found = assert_same_arm(nominal.table, nominal.T_base_0, nominal.T_last_tip)
    wrapped = np.degrees([found.alpha, found.theta]) % 360
    np.testing.assert_allclose(wrapped[0], TABLE_5_1[:, 0] % 360, rtol=0, atol=1e-10)
    np.testing.assert_allclose(wrapped[1], TABLE_5_1[:, 2] % 360, rtol=0, atol=1e-10)
    np.testing.assert_allclose(found.a * 1e3, TABLE_5_1[:, 1], rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.d * 1e3, TABLE_5_1[:, 3], rtol=0, atol=1e-9)
    assert not found.beta.any()


@settings(max_examples=60)
@given(st.integers(0, 2**32 - 1), st.integers(1, 8))
def test_any_axes_give_the_same_arm(seed, joints):
    rng = np.random.default_rng(seed)
    alpha = rng.choice([-1, 1], joints) * rng.uniform(0.2, 2.9, joints)
    columns = np.array([alpha, *rng.uniform(-1, 1, (3, joints))])
    slides = rng.uniform(size=joints) < 0.3
    table = dhm.DHMTable(*columns, prismatic=slides)
    T_base_0, T_last_tip = (frames.transform(random_rotation(rng), rng.uniform(-1, 1, 3)) for _ in range(2))
    found = assert_same_arm(table, T_base_0, T_last_tip, slides, 1e-11)
    assert found.prismatic.tolist() == slides.tolist()


@pytest.mark.parametrize("tilt", [0.0, 1e-9, 1e-4, 0.02, 0.08])
def test_nearly_parallel_axes_throw_no_frame_far_away(tilt):
    """Below the tolerance Hayati's tilt takes up what a common normal kilometres away would have to."""
    assert np.sin(tilt) < NEARLY_PARALLEL
    direction = np.array([np.sin(tilt) * 0.6, np.sin(tilt) * 0.8, np.cos(tilt)])
    points = np.array([[0.0, 0, 0.3], [0.4, 0.1, 0.2], [0.7, 0, 0.1]])
    axes = np.array([[0.0, 0, 1], direction, [0.0, 1, 0]])
    T_base_tip = frames.transform(random_rotation(np.random.default_rng(2)), [0.8, 0.1, 0.5])
    table, T_base_0, T_last_tip = dhm_from_axes(points, axes, T_base_tip)
    assert np.abs([table.a, table.d]).max() < 2.0
    assert_same_poses(dhm.forward(table, np.zeros((1, 3)), T_base_0, T_last_tip)[0], T_base_tip, 1e-12, 1e-12)
    chain = dhm.chain_frames(table, table.offsets[:, None], T_base_0, T_last_tip)
    np.testing.assert_allclose(chain.z[:, :, 0], axes, rtol=0, atol=1e-12)
    off = np.cross(chain.o[:, :, 0] - points, axes)
    assert np.abs(off).max() < 1e-12, "each frame stands on its axis"
