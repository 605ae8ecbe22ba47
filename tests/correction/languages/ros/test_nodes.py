"""Nodes of YAML stand where the text has them."""

import pytest

from irbcal.correction.languages.ros.nodes import Reader, document, line
from irbcal.errors import ProgramError


def test_numbers_are_found_where_they_stand_behind_letters_of_several_bytes():
    text = "# größe ü\na: [1.5, -2e3]\nb:\n  - 7\n"
    read = Reader("x.yaml")
    found = read.mapping(document(text, "x.yaml"), "something")
    numbers = [read.number(one, "n") for one in (*read.items(found["a"], "a"), *read.items(found["b"], "b"))]
    assert [n.value for n in numbers] == [1.5, -2000.0, 7.0]
    assert [text[n.start : n.end] for n in numbers] == ["1.5", "-2e3", "7"]
    assert line(found["b"]) == 4


@pytest.mark.parametrize("text", ["1_0", "\u0661", "", "one", "[1]"])
def test_what_is_no_number_is_refused(text):
    read = Reader("x.yaml")
    node = read.mapping(document(f"a: {text}", "x.yaml"), "something")["a"]
    with pytest.raises(ProgramError, match=r"x\.yaml: line 1: expected a speed"):
        read.number(node, "a speed")
