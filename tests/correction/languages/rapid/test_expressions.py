"""Values: lists of numbers, computed ones, and the names that are seen on the way."""

import pytest

from irbcal.correction.languages.rapid.expressions import Walker
from irbcal.errors import ProgramError


def value(text):
    seen = Walker(text, "m")
    node, _ = seen._list(0)
    return node, seen


def numbers(node):
    return [numbers(item) for item in node.items] if node.items is not None else node.number


def test_lists_of_numbers():
    node, seen = value("[1, -2.5, + 3, [.5, 1E2], []x]".replace(", []x", ""))
    assert numbers(node) == [1.0, -2.5, 3.0, [0.5, 100.0]]
    assert seen.mentions == []


@pytest.mark.parametrize("text", ["[1,2]", "[ -1.5 ,\n.5, +2E-3]", "[9E9]", "[ 0 ]"])
def test_a_list_of_plain_numbers_is_what_it_is_number_by_number(text):
    """Beside a comment it is no single token."""
    one, whole = value(text), value(text[:-1] + " ! c\n]")
    assert [token.kind for token in one[1].tokens] == ["list", "end"]
    assert len(whole[1].tokens) > 3
    assert one[0].items == whole[0].items
    assert [float(text[leaf.start : leaf.end]) for leaf in one[0].items] == numbers(one[0])


def test_computed_numbers_are_none_and_their_names_are_mentioned():
    node, seen = value("[a + 1, f(b{2,3}, \\opt:=4), c.trans.x, - 5 * 2, TRUE]")
    assert numbers(node) == [None] * 5
    assert [(mention.name, mention.indices) for mention in seen.mentions] == [
        ("a", ()),
        ("f", ()),
        ("b", (2, 3)),
        ("c", ()),
    ]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[1 2]", "expected an operator or ']', found '2'"),
        ("[1,]", "expected a value, found ']'"),
        ("[(1]", r"expected '\)', found '\]'"),
        ("[1)]", r"'\)' closes nothing"),
        ("[" * 20, "more than 12 lists within each other"),
        ("[1,2", "found the end of the file"),
    ],
)
def test_what_is_no_list(text, expected):
    with pytest.raises(ProgramError, match=expected):
        value(text)
