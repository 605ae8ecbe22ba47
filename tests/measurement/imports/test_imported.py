"""What was understood: the measurement file, its words, and that nobody can change it."""

import pickle
from dataclasses import FrozenInstanceError

import numpy as np
import pytest
from import_support import FOUR_JOINTS, ROW, make_map, refused, write

from irbcal.errors import CalibrationError, OptionError
from irbcal.measurement import table
from irbcal.measurement.imports import column_map
from irbcal.measurement.imports.reader import import_measurements


def test_what_the_reader_would_refuse_is_said_in_rows_of_the_source(tmp_path):
    chosen = make_map(
        tmp_path,
        "{columns: {joints: [a], position: [x, y, z], u95: u}, units: {joints: deg, lengths: mm}, fixed: {target: t}}",
    )
    path = write(tmp_path / "r.csv", "a,x,y,z,u", "", "10,100,0,0,0.1", "11,100,0,0,-1")
    text = refused(path, chosen)
    assert text.startswith(f"{path}: row 4, column u95_mm: expected an uncertainty above zero")


@pytest.fixture
def robodk(tmp_path):
    """Two points of one pose and a lost one of another."""
    rows = [ROW + ",smr1", ROW.replace("1200.5", "1210.5") + ",ref1", ROW.replace("10,", "11,", 1) + ",smr1"]
    return write(tmp_path / "r.csv", "h", *rows[:2], rows[2].replace("1200.5,-35.25,640.75", "0,0,0"))


def test_import_measurements_writes_what_it_returns(robodk, tmp_path):
    out = tmp_path / "new" / "m.csv"
    found = import_measurements(robodk, as_="robodk", out=out)
    assert found.out == out
    assert [path.name for path in out.parent.iterdir()] == ["m.csv"]
    assert out.read_bytes() == found.csv()
    written, seen = table.read(out), found.measurements()
    assert seen.sha256 == written.sha256
    assert seen.source == str(robodk)
    assert np.array_equal(seen.positions(), written.positions(), equal_nan=True)
    assert np.array_equal(seen.joints(), written.joints())
    assert found.report()[-1] == f"Written to {out}"


def test_nothing_is_written_without_out_and_in_a_dry_run(robodk, tmp_path):
    before = sorted(path.name for path in tmp_path.iterdir())
    found = import_measurements(robodk, as_="robodk", out=tmp_path / "m.csv", dry_run=True)
    assert found.out is None
    import_measurements(str(robodk), as_="robodk")
    assert sorted(path.name for path in tmp_path.iterdir()) == before
    assert found.report()[0] == "3 rows, 2 poses, 1 lost points; points: ref1 1, smr1 1 (and 1 lost)"
    shown = found.report()[1]
    assert shown.columns == ("row of file", "2", "3", "4")
    assert ("x_mm", 1200.5, 1210.5, "") in shown.rows


def test_options_of_the_function(robodk, tmp_path):
    assert len(import_measurements(robodk, as_=column_map.read_map("robodk")).table) == 3
    with pytest.raises(CalibrationError, match="this is the file to read from") as caught:
        import_measurements(robodk, as_="robodk", out=tmp_path / "." / "r.csv")
    assert caught.value.parameter == "out"
    mine = make_map(tmp_path, column_map.preset_text("robodk"))
    with pytest.raises(CalibrationError, match="this is the file to read from"):
        import_measurements(robodk, as_=mine, out=mine)
    with pytest.raises(OptionError, match="no changes beside an ImportMap"):
        import_measurements(robodk, as_=column_map.read_map("robodk"), set_={"trust_units": True})
    with pytest.raises(OptionError, match="expected one file or more"):
        import_measurements(as_="robodk")
    with pytest.raises(CalibrationError, match="expected a file to write, found a folder"):
        import_measurements(robodk, as_="robodk", out=tmp_path)
    blocked = write(tmp_path / "file", "x")
    with pytest.raises(CalibrationError, match="cannot write to this folder"):
        import_measurements(robodk, as_="robodk", out=blocked / "m.csv")


def test_several_files_and_a_joints_file(tmp_path):
    joints = write(tmp_path / "joints.csv", FOUR_JOINTS.rstrip())
    files = [write(tmp_path / f"{name}.csv", "x,y,z", "1000,2,3", "1000,4,5") for name in ("smr1", "ref1")]
    found = import_measurements(*files, as_="per-target", joints=joints, set_={"units.lengths": "mm"})
    seen = found.measurements()
    assert (len(seen), seen.poses) == (4, 2)
    assert np.abs(np.degrees(seen.joints()[1]) - [11, 21, 31, 41, 51, 61]).max() < 1e-12


def test_nobody_can_change_what_was_understood(robodk):
    found = import_measurements(robodk, as_="robodk")
    before = found.csv()
    for frame, column, value in (
        (found.table, "x_mm", 1.0),
        (found.origin, "row", 0),
        (found.to_frame(), "target", "x"),
    ):
        frame[column] = value
    with pytest.raises(FrozenInstanceError):
        found.warnings = ()
    assert found.csv() == before
    assert found.origin["row"].tolist() == [2, 3, 4]
    again = pickle.loads(pickle.dumps(found))
    assert again.csv() == before
    assert again.map == found.map


def test_words(robodk, tmp_path):
    found = import_measurements(robodk, as_="robodk", set_={"rename": {"none": "x"}})
    assert len(repr(found)) < 2000
    assert "There is no target none to rename" in found.summary()
    assert "units: {joints: deg, lengths: mm}" in found.summary()
    assert "<table>" in found._repr_html_()


def test_an_import_is_measurements(robodk, tmp_path):
    found = import_measurements(robodk, as_="robodk")
    assert table.read(found).sha256 == found.measurements().sha256
