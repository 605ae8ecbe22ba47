"""The models of a map: patterns of names, and what a map says without being asked for more."""

import re

import pytest
from pydantic import ValidationError

from irbcal.measurement.imports import column_map
from irbcal.measurement.imports.column_map import ImportMap, pattern_regex


@pytest.mark.parametrize(
    ("pattern", "name", "fields"),
    [
        ("{pose}_{target}", "P1_smr1", {"pose": "P1", "target": "smr1"}),
        ("{pose}_{target}", "a_b_c", {"pose": "a_b", "target": "c"}),
        ("{ignore}::{pose}::{target}", "A::P2::smr1", {"pose": "P2", "target": "smr1"}),
        ("log.{target}", "log.7", {"target": "7"}),
        ("log.{target}", "logx7", None),
        ("{pose}_{target}", "P1::x_smr1", None),
    ],
)
def test_patterns_take_names_apart(pattern, name, fields):
    found = re.fullmatch(pattern_regex(pattern), name)
    assert (found and found.groupdict()) == fields


@pytest.mark.parametrize("pattern", ["plain", "{pos}", "{pose}{target}", "{pose}_{pose}", "{}"])
def test_patterns_that_are_none(pattern):
    with pytest.raises(ValueError, match="expected"):
        pattern_regex(pattern)


def test_maps_say_whether_poses_have_names_and_cannot_be_changed():
    assert column_map.read_map("spatial-analyzer").names_poses
    assert not column_map.read_map("robodk").names_poses
    assert column_map.read_map("per-target", {"columns.pose": "n"}).names_poses
    found = ImportMap(columns={"position": [1, 2, 3]}, lost={"markers": ["LOST", -9999]})
    assert found.lost_texts == ["lost", "-9999"]
    with pytest.raises(ValidationError):
        found.trust_units = True
