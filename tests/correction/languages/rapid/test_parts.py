"""Literals: what their numbers can be."""

import pytest

from irbcal.correction.languages.rapid.parts import Literal, Node


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
