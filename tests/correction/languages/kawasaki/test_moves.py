"""Moves as Kawasaki AS: what is written, and that it is read again."""

from moves_cases import check_comments, written


def test_joints_rests_and_speeds():
    text = written("kawasaki", "rs007n")["plan.pg"]
    assert "  SPEED 25\r\n  JMOVE #plan2\r\n  BREAK\r\n  TWAIT 4.5\r\n" in text
    assert "\r\n#plan2 10.0000 -60.0000 95.5000 20.0000 30.1250 -40.0000\r\n" in text
    assert text.isascii()


def test_no_name_gets_out_of_its_comment():
    check_comments("kawasaki", "rs007n")
