"""The models of a map: patterns of names, and what a map says without being asked for more."""

import re

import pytest
from import_support import ROW, make_map, refused, understood, write
from pydantic import ValidationError

from irbcal.errors import MeasurementError
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
    assert found.lost.texts == ["lost", "-9999"]
    with pytest.raises(ValidationError):
        found.trust_units = True


GOOD = "{columns: {joints: [a], position: [x, y, z]}, units: {joints: deg, lengths: mm}, fixed: {target: t}}"


@pytest.mark.parametrize("name", column_map.presets())
def test_presets_are_maps_that_explain_themselves(name):
    text = column_map.preset_text(name)
    assert column_map.read_map(name).about
    assert any(word in text for word in ("Confirmed", "Assumed", "not a maker's format"))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (GOOD.replace("joints: deg, ", ""), "expected the unit of the joints to be declared"),
        (GOOD.replace(", lengths: mm", ""), "expected the unit of the positions to be declared"),
        (GOOD.replace("fixed: {target: t}", "about: x"), "expected the target to be declared"),
        (GOOD.replace("[a]", "[a], time: b"), "expected the unit of the time to be declared"),
        (GOOD.replace("lengths: mm", "lengths: cm"), "units.lengths: expected 'mm', 'm' or 'inch', found 'cm'"),
        (GOOD.replace("lengths", "length"), "units.length: there is no such key; did you mean lengths?"),
        (GOOD.replace("units", "unit"), "unit: there is no such key; did you mean units?"),
        (GOOD.replace("[x, y, z]", "[x, y]"), "columns.position: expected at least 3 items, found ['x', 'y']"),
        (GOOD.replace("[a]", "[x]"), "columns: expected each column of joints and positions once, found 'x' again"),
        (
            GOOD.replace("[x, y, z]", "{s: [x, y, z]}, orientation: [a, a, a]"),
            "columns.orientation: expected one target in a row",
        ),
        (GOOD.replace("[a]", "[0]"), "columns are numbered from 1"),
        (GOOD.replace("[a]", "[no]"), "in quotes if it reads as yes, no"),
        (GOOD.replace("[a]", "[a], keep: {x_mm: b}"), "columns.keep: expected a new name"),
        ("{units: {lengths: mm}}", "columns: expected this key, found nothing"),
        (GOOD.replace("about", "x")[:-1] + ", names: ['{pose}']}", "belong together"),
        (GOOD[:-1] + ", file_name: '{pos}'}", "expected a pattern of {pose}, {target}"),
        (GOOD[:-1] + ", file_name: '{pose}{target}'}", "something between the fields"),
        (GOOD[:-1] + ", orientation: {axes: xxy}}", "two different axes"),
        (GOOD[:-1] + ", joints: {signs: [1, 1]}}", "joints.signs: expected 1 numbers"),
        (GOOD[:-1] + ", joints: {signs: [2]}}", "joints.signs"),
        (GOOD[:-1] + ", groups: [{group: a}]}", "expected either poses"),
        (GOOD.replace("joints: deg", "joints: [deg, deg]"), "units.joints: expected one unit or 1"),
        ("a: &x [1]\nb: *x", "row 1: not a map in YAML: anchors and aliases are not taken"),
        ("a: 1\nb: 2\na: 3", "row 3: not a map in YAML: 'a' stands there twice"),
        ("[" * 1_500, "not a map in YAML"),
        ("a: [1", "not a map in YAML"),
        ("!!python/object/apply:os.system ['true']", "not a map in YAML"),
        ("? {a: 1}\n: 2", "not a map in YAML"),
        ("just words", "expected keys and values"),
        ("# " + "x" * 70_000, "expected a file of at most 64 KiB"),
    ],
)
def test_bad_maps_are_named(tmp_path, text, expected):
    path = write(tmp_path / "f.csv", "a,x,y,z", "10,100,0,0")
    assert expected in refused(path, make_map(tmp_path, text))


def test_names_of_maps_and_changes(tmp_path):
    path = write(tmp_path / "r.csv", "h", ROW)
    assert "robodc: expected a preset (irbcal, leica-tmac, per-target, robodk" in refused(path, "robodc")
    assert "did you mean robodk?" in refused(path, "robodc")
    assert "there is no such file" in refused(path, str(tmp_path / "none.yaml"))
    assert "expected key=value" in refused(path, "robodk", "units.lengths")
    assert "units.lengths: expected 'mm', 'm' or 'inch'" in refused(path, "robodk", "units.lengths=feet")
    assert "pose_by is no group of keys" in refused(path, "robodk", "pose_by.x=1")
    copied = make_map(tmp_path, column_map.preset_text("robodk"))
    assert understood(path, copied).table.equals(understood(path, "robodk").table)


def test_changes_as_texts_and_as_values_are_the_same():
    texts = ["units.lengths=inch", "rename={'1': smr1}", "file.delimiter=;"]
    values = {"units.lengths": "inch", "rename": {"1": "smr1"}, "file.delimiter": ";"}
    assert column_map.read_map("robodk", texts) == column_map.read_map("robodk", values)
    with pytest.raises(MeasurementError, match="pose_by is no group of keys"):
        column_map.read_map("robodk", {"pose_by.x": 1})
    with pytest.raises(MeasurementError) as caught:
        column_map.read_map("robodk", ["units.lengths"])
    assert caught.value.parameter == "set"


def test_a_fault_in_a_map_carries_file_and_row(tmp_path):
    path = make_map(tmp_path, "a: 1\nb: 2\na: 3")
    with pytest.raises(MeasurementError) as caught:
        column_map.read_map(path)
    assert (caught.value.file, caught.value.row) == (str(path), 3)
