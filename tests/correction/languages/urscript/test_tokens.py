"""Statements, numbers and arguments of URScript."""

import pytest

from irbcal.correction.languages.urscript.tokens import arguments, statements
from irbcal.correction.listing import Listing
from irbcal.correction.tokens import numbers
from irbcal.errors import ProgramError


def read(text):
    return statements(Listing([("a.script", text.encode("latin-1"))], "URScript"))


def test_statements_end_with_lines_outside_brackets():
    found, comments = read('movej([1,\n 2])\n  $ 12 "a" # no\nx=1 # y\na();b()\n')
    assert ["".join(token.word for token in line) for line in found] == ["movej([1,2])", "x=1", "a()", "b()"]
    assert comments == ["# y"]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[-.5, +1, 2e-3]", [-0.5, 1, 0.002]),
        ("[1,]", None),
        ("[1 2]", None),
        ("[x]", None),
        ("[1-2]", None),
        ("[-]", None),
        ("[]", None),
        ("[1", None),
    ],
)
def test_numbers(text, expected):
    try:
        ((*tokens,),), _ = read(text)
    except ProgramError:
        assert expected is None
        return
    found = numbers(tokens)
    assert (None if found is None else [number.value for number in found]) == expected


def test_arguments():
    ((*tokens,),), _ = read("(p[1,2], a=1.2, f(x,y), t=[0,1]) + 3")
    assert [(name, "".join(t.word for t in part)) for name, part in arguments(tokens)] == [
        ("", "p[1,2]"),
        ("a", "1.2"),
        ("", "f(x,y)"),
        ("t", "[0,1]"),
    ]


def test_open_brackets_are_refused():
    with pytest.raises(ProgramError, match=r"a.script: line 2: the brackets of this statement"):
        read("x=1\nmovej([1,2\n")
