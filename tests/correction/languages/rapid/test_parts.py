"""Literals: what their numbers can be."""

import pytest

from irbcal.correction.languages.rapid.parts import Data, Literal, Node, may_be


def literal(kind, *numbers):
    leaves = [Node(None, number, 0, 1) for number in numbers]
    return Literal(kind, "p", 0, leaves, [], Node([], None, 0, 1))


@pytest.mark.parametrize(
    ("kind", "numbers", "problem"),
    [
        ("pose", (1, 2, 3, 1, 0, 0, 0), None),
        ("pose", (1, 2, 9e9, 1, 0, 0, 0), "found a number that is too large"),
        ("pose", (1, 2, 3, 1, 1, 0, 0), "expected a unit quaternion, found one of length 1.414"),
        ("joint", (1, 2, 3, 4, 5, 6), None),
        ("joint", (1, 2, float("inf"), 4, 5, 6), "found a number that is too large"),
    ],
)
def test_numbers_that_are_no_target(kind, numbers, problem):
    assert literal(kind, *numbers).problem == problem


def test_joints_that_are_not_there_are_a_reason_and_no_problem():
    found = literal("joint", 1, 2, 3, 9e9, 5, 6)
    assert found.problem is None
    assert found.reasons == ["joint 4 has no value (9E9)"]


def test_entries_are_looked_up_as_they_would_be_looked_through():
    """Plain, computed and missing indices, against every pair of indices compared."""
    data = Data("p", "robtarget", 0, sizes=(3, 2))
    indices = [(1, 1), (1, 2), (None, 2), (2, 1), (1, 2), (3, None)]
    for k, index in enumerate(indices):
        data.entries.append((index, k))
    for asked in [(1, 2), (2, 2), (3, 1), (None, 1), (1, None), (), (9, 9)]:
        assert data.literals(asked) == [k for k, index in enumerate(indices) if may_be(index, asked)]
    data.entries.append(((2, 2), 6))
    assert data.literals((2, 2)) == [2, 6], "what comes later is found, too"
