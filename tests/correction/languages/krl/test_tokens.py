"""Tokens of KRL and where they stand."""

import pytest

from irbcal.correction.languages.krl.tokens import END, lines_of
from irbcal.correction.listing import Listing
from irbcal.errors import ProgramError


def lines(text):
    return lines_of(Listing([("a.src", text.encode("latin-1"))], "KUKA KRL"))


def test_lines_words_and_comments():
    found, comments = lines('\xef\xbb\xbfDEF  Job()\r\n\t; fold\r\nLIN {X -1.5E-3} C_DIS ; "x\r\nMsg("a;b")\n')
    assert [[token.word for token in line.tokens] for line in found] == [
        ["def", "job", "(", ")"],
        ["lin", "{", "x", "-", "1.5e-3", "}", "c_dis"],
        ["msg", "(", '"a;b"', ")"],
    ]
    assert comments == ["; fold", '; "x']


@pytest.mark.parametrize(
    ("text", "value", "length"),
    [
        ("-1.5", -1.5, 4),
        ("+ .5", 0.5, 4),
        ("7", 7, 1),
        ("1.51745229E-12", 1.51745229e-12, 14),
        ("--1", None, 0),
        ("x", None, 0),
    ],
)
def test_numbers_with_their_signs(text, value, length):
    (line,), _ = lines(text)
    number = line.number()
    if value is None:
        assert number is None
        assert line.at == 0
    else:
        assert (number.value, number.start, number.end) == (value, 0, length)


def test_indices():
    (line,), _ = lines("[1,2] [n] x [3")
    assert line.index() == (1, 2)
    assert line.index() is None
    assert line.index() == ()
    line.at += 1
    assert line.index() == (3,)
    assert line.next is END


def test_open_strings_are_refused():
    with pytest.raises(ProgramError, match=r"a.src: line 2: the string is not closed"):
        lines('x\nmsg("abc\n')
