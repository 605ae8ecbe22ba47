"""Maps: presets that explain themselves, changes, and the refusals."""

import pytest
from import_support import ROW, make_map, refused, understood, write

from irbcal.errors import MeasurementError
from irbcal.measurement.imports import column_map

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
