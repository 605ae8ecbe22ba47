"""What was written is read again before it is handed out."""

from dataclasses import replace

import numpy as np
import pytest
from moves_cases import arm_of, moves

from irbcal.correction import languages, write_moves
from irbcal.correction.languages import fanuc, krl, table
from irbcal.errors import ProgramError


def test_a_language_without_moves_says_so():
    with pytest.raises(ProgramError, match="CSV has no moves to write"):
        write_moves.write(table, moves("m20ia"))


def test_arms_of_other_makers_are_refused():
    with pytest.raises(ProgramError, match="KRL programs are understood for arms whose axes point along"):
        write_moves.write(krl, moves("m20ia"))


def test_a_wrong_program_is_not_handed_out(monkeypatch):
    run = moves("m20ia")
    writer = fanuc.write_moves
    assert list(write_moves.write(fanuc, run)) == ["plan.ls"]
    off = lambda given: writer(replace(given, q=given.q + 1e-5))  # noqa: E731
    monkeypatch.setattr(fanuc, "write_moves", off)
    with pytest.raises(ProgramError, match="does not hold the joints"):
        write_moves.write(fanuc, run)


def test_a_declared_coupling_takes_the_place_of_the_assumed_one():
    run = moves("m20ia")
    coupled = replace(run, arm=replace(arm_of("m20ia"), coupling=np.eye(6)))
    text = write_moves.write(fanuc, coupled)["plan.ls"].decode()
    assert "J3=   95.5000 deg" in text


def test_every_language_that_has_robots_writes_moves():
    for language in languages.known():
        assert (language.write_moves is None) == (language.ROBOTS == "")
