"""Moves as VAL3: what is written, and that it is read again."""

from moves_cases import check_comments, written

LINE = '<Value key="1" j1="10.0000" j2="-60.0000" j3="95.5000" j4="20.0000" j5="30.1250" j6="-40.0000" />'


def test_joints_rests_and_speeds():
    files = written("val3", "rx160")
    text = files["plan.dtx"]
    assert LINE in text
    assert text.isascii()
    assert "mPlan.vel=25\r\n  movej(jPlan[1],flange,mPlan)\r\n  waitEndMove()\r\n  delay(4.5)" in files["start.pgx"]


def test_no_name_gets_out_of_its_comment():
    check_comments("val3", "rx160")
