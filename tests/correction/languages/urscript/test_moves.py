"""Moves as URScript: what is written, and that it is read again."""

from moves_cases import check_comments, written

LINE = "movej([0.174532925, -1.047197551, 1.666789436, 0.349065850, 0.525780437, -0.698131701], a=1.0, v=0.500)"


def test_joints_rests_and_speeds():
    files = written("urscript", "ur10")
    text = files["plan.script"]
    assert LINE in text
    assert text.isascii()
    assert LINE + "\n  sleep(4.5)\n" in text


def test_no_name_gets_out_of_its_comment():
    check_comments("urscript", "ur10")
