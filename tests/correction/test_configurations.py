"""Configuration data: quadrants, and which solution a controller takes."""

import numpy as np
from support import arm

from irbcal.correction.configurations import ConfData, configuration_of, quadrants, seeds_of
from irbcal.modeling.inverse import closed_form


def test_quadrants_are_floors_of_ninety_degrees():
    q = np.radians([[10, 0, 0, 90, 0, 180], [-10, 0, 0, -90.5, 0, 359], [0, 0, 0, 190, 0, -181]])
    assert quadrants(q).tolist() == [[0, 1, 2], [-1, -2, 3], [0, 2, -3]]


def test_the_solution_with_the_configuration_data_is_taken():
    nominal = arm()
    q = np.radians([[100, 10, -20, 120, 40, -100], [100, 10, -20, 120, 40, 260]])
    branch = closed_form.configuration(nominal, q)
    confs = [configuration_of(row, int(cfx)) for row, cfx in zip(q, branch, strict=True)]
    assert [conf.cf6 for conf in confs] == [-2, 2], "the same pose a turn further"
    found, told = seeds_of(nominal, nominal.forward(q), confs)
    assert told.all()
    np.testing.assert_allclose(found, q, rtol=0, atol=1e-9)


def test_data_that_fit_nothing_are_told_from_poses_out_of_reach():
    nominal = arm()
    T = np.repeat(nominal.forward([[0.2, 0, 0, 0, 0.5, 0]]), 3, axis=0)
    T[2, 0, 3] = 9.0
    found, told = seeds_of(nominal, T, [ConfData(3, 3, 3, 0), None, ConfData(0, 0, 0, 0)])
    assert told.tolist() == [False, True, True]
    assert np.isfinite(found).all(axis=1).tolist() == [False, True, False]
    np.testing.assert_allclose(found[1], [0.2, 0, 0, 0, 0.5, 0], rtol=0, atol=1e-9)
