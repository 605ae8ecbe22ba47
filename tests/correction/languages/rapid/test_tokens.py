"""Tokens and where they stand."""

import pytest

from irbcal.correction.languages.rapid.tokens import Scanner, decode
from irbcal.errors import ProgramError


def test_tokens_are_words_in_lower_case_without_space_and_comments():
    seen = Scanner('MoveL P10,\r\n  0x1F "a ""b"" !c" -1.5E3 ! MoveJ\n:= <>', "m.mod")
    kinds = ["name", "name", "symbol", "hex", "string", "symbol", "number", "symbol", "symbol", "end"]
    assert [token.kind for token in seen.tokens] == kinds
    assert [token.word for token in seen.tokens[:3]] == ["movel", "p10", ","]
    assert [token.word for token in seen.tokens[-4:]] == ["1.5E3", ":=", "<>", ""]
    assert seen.comments == ["! MoveJ"]


@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
def test_places_are_counted_from_one(newline):
    seen = Scanner(newline.join(["a", " b", "", "  c d"]), "m.mod")
    places = [(seen.line(token.start), seen.column(token.start)) for token in seen.tokens[:-1]]
    assert places == [(1, 1), (2, 2), (4, 3), (4, 5)]
    assert seen.quote_line(4) == "c d"


def test_refusals_carry_their_place():
    with pytest.raises(ProgramError) as caught:
        Scanner("a\nb $", "m.mod")
    assert str(caught.value) == "m.mod: line 2: unexpected character '$'"
    assert (caught.value.file, caught.value.row) == ("m.mod", 2)


def test_encodings_give_the_bytes_back():
    for data in ("é".encode(), "é".encode("latin-1"), "\ufeffa".encode()):
        text, encoding = decode(data, "m")
        assert text.encode(encoding) == data
    with pytest.raises(ProgramError, match="binary"):
        decode(b"MODULE\x00", "m")
