"""Moves as KRL: what is written, and that it is read again."""

from moves_cases import check_comments, written

LINE = "PTP {A1 10.0000, A2 -60.0000, A3 95.5000, A4 20.0000, A5 30.1250, A6 -40.0000}"


def test_joints_rests_and_speeds():
    files = written("krl", "kr120r2500pro")
    text = files["plan.src"]
    assert LINE in text
    assert text.isascii()
    assert LINE + "\r\nWAIT SEC 4.5\r\n" in text
    assert text.count("BAS (#VEL_PTP,25)") == 1


def test_no_name_gets_out_of_its_comment():
    check_comments("krl", "kr120r2500pro")
