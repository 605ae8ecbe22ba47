"""Moves as INFORM: what is written, and that it is read again."""

import pytest
from moves_cases import check_comments, written

from irbcal.errors import ProgramError

LINE = "C00001=13414,-80484,-128104,20000,30125,-24880"


def test_joints_rests_and_speeds():
    files = written("inform", "gp8")
    text = files["PLAN.JBI"]
    assert LINE in text
    assert text.isascii()
    assert "MOVJ C00001 VJ=25.00 PL=0\r\nTIMER T=4.50\r\n" in text


def test_no_name_gets_out_of_its_comment():
    check_comments("inform", "gp8")


def test_pulses_are_needed():
    with pytest.raises(ProgramError, match="give the pulses per degree"):
        written("inform", "gp8", pulses=())
