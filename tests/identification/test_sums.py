"""Sums of a linear model: the part of some columns is the sum of those columns."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from irbcal.identification.evidence_maximisation import Sums


@given(st.lists(st.integers(0, 7), min_size=1, max_size=8, unique=True), st.integers(0, 1000))
def test_a_part_is_what_its_columns_give(columns, seed):
    rng = np.random.default_rng(seed)
    J, y = rng.standard_normal((8, 20)), rng.standard_normal(20)
    whole = Sums(J @ J.T, J @ y, float(y @ y), 20)
    part = whole.part(np.array(columns))
    np.testing.assert_allclose(part.H, J[columns] @ J[columns].T, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(part.g, J[columns] @ y, rtol=1e-12, atol=1e-12)
    assert (part.yy, part.equations) == (whole.yy, 20)
    # least squares from the sums is numpy's least squares of the rows
    c, left, *_ = np.linalg.lstsq(J[columns].T, y, rcond=None)
    np.testing.assert_allclose(np.linalg.solve(part.H, part.g), c, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(part.yy - c @ part.g, left[0], rtol=1e-6)
