"""Geometry: the constants are the errors of the DHM table."""

from dataclasses import replace

import numpy as np
from support import arm, central_differences
from term_cases import assert_derivatives, some_joints

from irbcal.modeling.parameters import parameter
from irbcal.modeling.terms import chain
from irbcal.modeling.terms.geometry import DHM_COLUMNS, FAMILY, SIZES


def test_all_six_numbers_of_all_joints_but_the_first():
    terms = FAMILY.terms(arm("irb120"))
    assert [(t.joint, t.axis) for t in terms] == [(j, a) for j in range(1, 6) for a in DHM_COLUMNS]
    assert {t.group for t in terms} == {"geometry"}
    assert {t.unit: t.size for t in terms} == {"rad": SIZES["r"], "m": SIZES["t"]}
    for t in terms:
        assert parameter(f"delta_{DHM_COLUMNS[t.axis]}{t.joint + 1}").unit == t.unit


def test_a_constant_is_one_everywhere():
    model = arm("irb120")
    assert not assert_derivatives(FAMILY.terms(model), model, some_joints(1)[0]).any()


def test_constant_columns_are_derivatives_by_the_table():
    model = arm("irb120")
    q, pose = some_joints(3), np.array([0, 1, 2, 2])
    local = np.random.default_rng(1).uniform(-0.2, 0.2, (4, 3))
    terms = FAMILY.terms(model)

    def points(c):
        columns = {name: getattr(model.table, name).copy() for name in DHM_COLUMNS.values()}
        for value, t in zip(c, terms, strict=True):
            columns[DHM_COLUMNS[t.axis]][t.joint] += value
        T = model.with_table(replace(model.table, **columns)).forward(q)[pose]
        return (np.einsum("mij,mj->mi", T[:, :3, :3], local) + T[:, :3, 3]).T

    numeric = central_differences(lambda c: points(c).ravel(), np.zeros(30), 1e-3)
    path, p = chain.walk(model, q).select(pose), points(np.zeros(30))
    columns = np.stack([chain.derivative(path, k, p, constant=True) for k in range(6)], axis=1)
    assert np.abs(columns[1:].reshape(30, -1).T - numeric).max() < 1e-10
