"""Moves to be written: joints as controllers count them, and speeds."""

from dataclasses import replace

import numpy as np
import pytest
from moves_cases import Q, arm_of, moves

from irbcal.correction import languages
from irbcal.correction.languages import fanuc, krl, table
from irbcal.correction.languages.fanuc import FANUC
from irbcal.correction.moves import JointMove, note
from irbcal.errors import ProgramError
from irbcal.units import DEG


def test_joints_are_the_controllers():
    run = moves("m20ia")
    np.testing.assert_allclose(run.degrees(), np.round(Q / DEG, 4), rtol=0, atol=1e-9)
    against_ground = Q / DEG - np.outer(Q[:, 1], np.eye(6)[2]) / DEG
    np.testing.assert_allclose(run.degrees(FANUC), against_ground, rtol=0, atol=0.6e-4)
    assert run.texts()[0] == ["0.0000"] * 6


def test_speeds_are_whole_percents_above_zero():
    assert [JointMove("", 0, share, 1).percent for share in (0.0, 0.001, 0.254, 1.0, 3.0)] == [1, 1, 25, 100, 100]


def test_notes_are_short_and_without_signs_that_end_them():
    assert note("a;b]]>\ncé" * 30, 12, ";]>") == "a,b,,, c?a,b"


def test_a_language_without_moves_says_so():
    with pytest.raises(ProgramError, match="CSV has no moves to write"):
        languages.write(table.LANGUAGE, moves("m20ia"))


def test_arms_of_other_makers_are_refused():
    with pytest.raises(ProgramError, match="KRL programs are understood for arms whose axes point along"):
        languages.write(krl.LANGUAGE, moves("m20ia"))


def test_a_wrong_program_is_not_handed_out():
    run, language = moves("m20ia"), fanuc.LANGUAGE
    assert list(languages.write(language, run)) == ["plan.ls"]
    off = replace(language, write_moves=lambda given: fanuc.write_moves(replace(given, q=given.q + 1e-5)))
    with pytest.raises(ProgramError, match="does not hold the joints"):
        languages.write(off, run)


def test_a_declared_coupling_takes_the_place_of_the_assumed_one():
    run = moves("m20ia")
    coupled = replace(run, arm=replace(arm_of("m20ia"), coupling=np.eye(6)))
    text = languages.write(fanuc.LANGUAGE, coupled)["plan.ls"].decode()
    assert "J3=   95.5000 deg" in text
