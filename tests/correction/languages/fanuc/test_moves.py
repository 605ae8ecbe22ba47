"""Moves as FANUC: what is written, and that it is read again."""

from moves_cases import check_comments, written

LINE = "J1=   10.0000 deg,\tJ2=  -60.0000 deg,\tJ3=  155.5000 deg,"


def test_joints_rests_and_speeds():
    files = written("fanuc", "m20ia")
    text = files["plan.ls"]
    assert LINE in text
    assert text.isascii()
    assert "J P[2] 25% FINE ;\r\n   7:  WAIT   4.50(sec) ;" in text


def test_no_name_gets_out_of_its_comment():
    check_comments("fanuc", "m20ia")
