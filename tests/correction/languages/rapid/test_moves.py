"""Moves as RAPID: what is written, and that it is read again."""

from moves_cases import check_comments, written

LINE = (
    "MoveAbsJ [[10.0000,-60.0000,95.5000,20.0000,30.1250,-40.0000],[9E9,9E9,9E9,9E9,9E9,9E9]]\\NoEOffs,v100,fine,tool0;"
)


def test_joints_rests_and_speeds():
    files = written("rapid", "irb120")
    text = files["plan.mod"]
    assert LINE in text
    assert text.isascii()
    assert LINE + "\n    WaitTime 4.5;\n" in text


def test_no_name_gets_out_of_its_comment():
    check_comments("rapid", "irb120")
