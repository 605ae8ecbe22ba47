"""A program's text in one file or several."""

import ast
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from irbcal.correction.listing import Listing, Token, mark_in, number_like, numbers, one_word, quoted
from irbcal.errors import ProgramError


def test_places_and_files():
    listing = Listing([("a", b"one\r\ntwo"), ("b", b"\xfcx\nthree")], "X")
    at = listing.text.index("three")
    assert (listing.line(at), listing.column(at), listing.files[listing.file_at(at)].name) == (2, 1, "b")
    assert (listing.line(5), listing.column(6)) == (2, 2)
    assert listing.newline(0) == "\r\n"
    assert str(listing.error(at, "no")) == "b: line 2: no"
    assert listing.files_with([(0, 3, "1"), (at, at + 5, "3")]) == {"a": b"1\r\ntwo", "b": b"\xfcx\n3"}
    assert listing.files_with([(8, 8, "!")]) == {"a": b"one\r\ntwo!", "b": b"\xfcx\nthree"}
    assert listing.after_line(0) == 5
    with pytest.raises(ProgramError, match="found binary data"):
        Listing([("a", b"\x00")], "X")


def test_carriage_returns_that_stand_alone_among_other_line_ends_are_no_line_ends():
    listing = Listing([("a", b"one\r\r\ntwo\rmore\r\nthree"), ("b", b"one\rtwo\r")], "X")
    assert [listing.line(listing.text.index(word)) for word in ("two", "more", "three")] == [2, 2, 3]
    assert listing.line(listing.text.rindex("two")) == 2
    assert [listing.newline(k) for k in (0, 1)] == ["\r\n", "\r"]


@pytest.mark.parametrize(
    ("old", "value", "least", "new"),
    [
        ("1.5", 2.25, 0, "2.2"),
        ("1", 2.25, 3, "2.250"),
        ("-.70000", 0.5, 3, "0.50000"),
        ("1e-12", 1e-13, 3, "0.000"),
        ("0.1", -0.0001, 3, "0.000"),
    ],
)
def test_numbers_keep_their_decimals(old, value, least, new):
    assert number_like(old, value, least) == new


def test_texts_for_people_are_one_printable_line():
    assert quoted("a\nb\x1b[31m  c") == "a b [31m c"
    assert quoted("Gr\xc3\xb6\xc3\x9fe") == "Größe"
    assert len(quoted("x" * 100)) == 50
    for bad in ("a b", "a\nb", "", "ä", "a\x00"):
        with pytest.raises(ValueError, match="one word"):
            one_word(bad)


def test_marks():
    assert mark_in(["; irbcal: fake targets, calibration ab12"]) == "ab12"
    assert mark_in(["x", "!irbcal fake targets ab12"]) == "ab12"
    assert mark_in(["; irbcal: fake targets"]) == ""
    assert mark_in(["; nothing"]) is None


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
