"""A program's text in one file or several."""

import pytest

from irbcal.correction.listing import Listing, mark_in, number_like, one_word, quoted
from irbcal.errors import ProgramError


def test_places_and_files():
    listing = Listing([("a", b"one\r\ntwo"), ("b", b"\xfcx\nthree")], "X")
    at = listing.text.index("three")
    assert (listing.line(at), listing.column(at), listing.parts[listing.part(at)].name) == (2, 1, "b")
    assert (listing.line(5), listing.column(6)) == (2, 2)
    assert listing.newline(0) == "\r\n"
    assert str(listing.error(at, "no")) == "b: line 2: no"
    assert listing.files_with([(0, 3, "1"), (at, at + 5, "3")]) == {"a": b"1\r\ntwo", "b": b"\xfcx\n3"}
    assert listing.files_with([(8, 8, "!")]) == {"a": b"one\r\ntwo!", "b": b"\xfcx\nthree"}
    assert listing.after_line(0) == 5
    with pytest.raises(ProgramError, match="found binary data"):
        Listing([("a", b"\x00")], "X")


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
