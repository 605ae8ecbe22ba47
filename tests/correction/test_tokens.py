"""Lists of numbers among the words of a program, against Python's own reader of lists."""

import ast
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from irbcal.correction.tokens import Token, numbers


def tokens(text):
    kinds = (("number", r"\d+\.?\d*(?:[eE][-+]?\d+)?"), ("name", r"[a-z]\w*"), ("symbol", r"\S"))
    pattern = re.compile("|".join(f"(?P<{kind}>{found})" for kind, found in kinds))
    return [Token(str(found.lastgroup), found[0], found.start(), found.end()) for found in pattern.finditer(text)]


@given(st.lists(st.floats(-1e9, 1e9).map(repr), min_size=1, max_size=8))
def test_lists_of_numbers(values):
    text = "[" + ", ".join(values) + "]"
    found = numbers(tokens(text))
    assert [one.value for one in found] == ast.literal_eval(text)
    assert [text[one.start : one.end] for one in found] == values


@pytest.mark.parametrize(
    "text", ["", "[]", "1, 2", "[1, 2", "[1 2]", "[1,]", "[,1]", "[1, x]", "[1, 2+3]", "[--1]", "[-]", "(1, 2)"]
)
def test_what_is_no_list_of_plain_numbers(text):
    assert numbers(tokens(text)) is None


def test_brackets_are_those_of_the_language():
    assert [one.value for one in numbers(tokens("(1, -2)"), ("()", "[]"))] == [1.0, -2.0]
    assert numbers(tokens("(1, -2]"), ("()", "[]")) is None
