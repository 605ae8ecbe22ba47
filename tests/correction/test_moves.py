"""Moves to be written: joints as controllers count them, and speeds."""

import numpy as np
from moves_cases import Q, moves

from irbcal.correction.languages.fanuc import MAKER
from irbcal.correction.moves import Move, note
from irbcal.units import DEG


def test_joints_are_the_controllers():
    run = moves("m20ia")
    np.testing.assert_allclose(run.degrees(), np.round(Q / DEG, 4), rtol=0, atol=1e-9)
    against_ground = Q / DEG - np.outer(Q[:, 1], np.eye(6)[2]) / DEG
    np.testing.assert_allclose(run.degrees(MAKER), against_ground, rtol=0, atol=0.6e-4)
    assert run.texts()[0] == ["0.0000"] * 6


def test_speeds_are_whole_percents_above_zero():
    assert [Move("", 0, share, 1).percent for share in (0.0, 0.001, 0.254, 1.0, 3.0)] == [1, 1, 25, 100, 100]


def test_notes_are_short_and_without_signs_that_end_them():
    assert note("a;b]]>\ncé" * 30, 12, ";]>") == "a,b,,, c?a,b"
