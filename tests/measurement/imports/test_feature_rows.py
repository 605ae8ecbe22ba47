"""Tables of other programs as rows at features."""

import json

import feature_cases as cases
import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import irbcal
from irbcal.cli.main import app
from irbcal.errors import MeasurementError, OptionError
from irbcal.measurement import features

WIDE = "J1;J2;J3;J4;J5;J6;L1;L2\n10;-20;30;0;45,5;90;1200,25;800,5\n11;-20;30;0;45;90;;801\n"
STRINGS = {
    "columns.joints": ["J1", "J2", "J3", "J4", "J5", "J6"],
    "columns.values": {"string 1": "L1", "string 2": "L2"},
    "units.joints": "deg",
    "units.lengths": "mm",
}


@pytest.fixture
def wide(tmp_path):
    path = tmp_path / "strings.csv"
    path.write_text(WIDE)
    return path


def test_values_of_several_features_in_a_row_become_rows(wide, tmp_path):
    out = tmp_path / "rows.csv"
    found = irbcal.import_features(wide, set_=STRINGS, out=out)
    assert found.lost == 1
    known = pd.DataFrame([{"feature": f"string {k}", "kind": "radius"} for k in (1, 2)])
    seen = features.read(out, known, cases.arm())
    assert seen.pose.tolist() == ["1", "1", "2"]
    assert seen.feature.tolist() == ["string 1", "string 2", "string 2"]
    np.testing.assert_allclose(seen.value, [1.20025, 0.8005, 0.801], atol=1e-12)
    np.testing.assert_allclose(np.degrees(seen.q[0]), [10, -20, 30, 0, 45.5, 90], atol=1e-12)


def test_contacts_with_columns_that_name_a_place(tmp_path):
    """Radians, signs, masses and columns that are kept: names of features are made of them."""
    path = tmp_path / "contacts.txt"
    path.write_text("0.1 0.2 0.3 0 0.5 0.6 A 0 5\n0.1 0.2 0.3 0 0.5 0.7 A 1 5\n")
    changes = ["columns.joints=[1, 2, 3, 4, 5, 6]", "columns.keep={place: 7, socket: 8}", "columns.payload=9"]
    changes += ["units.joints=rad", "file.header=false", "joints.signs=[1, 1, -1, 1, 1, 1]", "fixed.kind=point"]
    found = irbcal.import_features(path, set_=changes)
    known = pd.DataFrame([{"feature": "{place}/{socket}", "kind": "point"}])
    seen = features.read(found.table, known, cases.arm())
    assert seen.feature.tolist() == ["A/0", "A/1"]
    assert seen.inputs["payload_kg"].tolist() == [5.0, 5.0]
    np.testing.assert_allclose(seen.q[0], [0.1, 0.2, -0.3, 0, 0.5, 0.6], atol=1e-9)


def test_an_inclinometer_shows_angles(wide):
    changes = STRINGS | {"columns.values": {"level": "L1"}, "values": "angle", "units.angles": "rad"}
    found = irbcal.import_features(wide, set_=changes)
    assert found.table["value_deg"].tolist() == pytest.approx([np.degrees(1200.25)])
    del changes["units.angles"]
    with pytest.raises(MeasurementError, match="unit of the angles"):
        irbcal.import_features(wide, set_=changes)


def test_an_uncertainty_has_the_unit_of_its_value(tmp_path):
    """By hand: 0.05 mm told in metres, and 0.01 degrees told in radians."""
    path = tmp_path / "readings.csv"
    path.write_text("a,b,c,d,e,f,value [m],u95 [m]\n1,2,3,4,5,6,1.20025,0.00005\n")
    changes = {"columns.joints": list("abcdef"), "columns.value": 7, "columns.u95": 8, "units.joints": "deg"}
    changes |= {"fixed.feature": "s", "fixed.kind": "radius", "units.lengths": "m"}
    table = irbcal.import_features(path, set_=changes).table
    assert table[["value_mm", "u95_mm"]].iloc[0].tolist() == pytest.approx([1200.25, 0.05])
    seen = features.read(table, None, cases.arm())
    assert [seen.value[0], seen.u95[0]] == pytest.approx([1.20025, 0.00005])
    path.write_text(f"a,b,c,d,e,f,value,u95\n1,2,3,4,5,6,0.3,{np.radians(0.01)}\n")
    changes |= {"fixed.kind": "angle", "values": "angle", "units.angles": "rad", "units.lengths": None}
    table = irbcal.import_features(path, set_=changes).table
    assert "u95_mm" not in table
    seen = features.read(table, None, cases.arm())
    assert [seen.value[0], seen.u95[0]] == pytest.approx([0.3, np.radians(0.01)])


@pytest.mark.parametrize("column", ["value", "u95", "position"])
def test_another_unit_in_the_header_is_refused(tmp_path, column):
    path = tmp_path / "readings.csv"
    path.write_text("a,b,c,d,e,f,x [inch]\n1,2,3,4,5,6,7\n")
    changes = {"columns.joints": list("abcdef"), "units.joints": "deg", "units.lengths": "mm", "fixed.feature": "s"}
    changes[f"columns.{column}"] = ["x", "x", "x"] if column == "position" else "x"
    with pytest.raises(MeasurementError, match=r"column x \[inch\]: expected lengths in mm .*, found inch"):
        irbcal.import_features(path, set_=changes)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"units.joints": None}, "the unit of the joints"),
        ({"columns.values": {"string 1": "L9"}}, "L9"),
        ({"columns.value": "L1"}, "expected no columns.feature and columns.value"),
        ({"columns.strings": "L1"}, "there is no such key"),
    ],
)
def test_what_is_not_declared_or_not_there_is_refused(wide, change, words):
    with pytest.raises(MeasurementError, match=words):
        irbcal.import_features(wide, set_=STRINGS | change)


def test_the_command_knows_it_by_its_name_and_by_a_map_file(wide, tmp_path):
    own = tmp_path / "strings.yaml"
    own.write_text(
        "rows: features\nfile: {delimiter: auto, decimal: auto}\nunits: {joints: deg, lengths: mm}\n"
        "columns: {joints: [1, 2, 3, 4, 5, 6], values: {a: L1, b: L2}}\n"
    )
    told = CliRunner().invoke(app, ["import", str(wide), "--as", str(own), "--out", str(tmp_path / "r.csv"), "--json"])
    assert told.exit_code == 0, told.output
    assert json.loads(told.stdout)["features"] == {"a": 1, "b": 2}
    line = ["import", str(wide), "--as", "features", "--set", "columns.joints=[1, 2, 3, 4, 5, 6]", "--dry-run"]
    told = CliRunner().invoke(app, [*line, "--set", "units.joints=deg", "--set", "columns.feature=7"])
    assert "Nothing was written" in told.output
    assert "rows: features" in CliRunner().invoke(app, ["import", "--show-preset", "features"]).output
    with pytest.raises(OptionError, match="sources"):
        irbcal.import_features()
