"""Large calibrations: tables beside the JSON file, read as if they stood in it, and guarded as it is."""

import json

import pytest

from irbcal.errors import CalibrationError
from irbcal.files import beside, calibration_folder


@pytest.fixture
def large(folder, tmp_path, monkeypatch):
    saved = calibration_folder.read(folder)
    monkeypatch.setattr(beside, "MANY", 50)
    calibration_folder.write(tmp_path / "large", saved.record, saved.urdf, "report")
    return saved, tmp_path / "large"


def test_what_is_read_is_what_was_written(large):
    saved, folder = large
    document = json.loads((folder / "calibration.json").read_text())
    assert document["schema_name"] == "irbcal-calibration-2"
    assert set(document["points"]) == {"file", "sha256"}
    again = calibration_folder.read(folder)
    assert again.record.model_copy(update={"seal": None}) == saved.record.model_copy(update={"seal": None})
    assert calibration_folder.checked(folder).differences == ()


def test_a_table_that_was_changed_or_lost_is_refused(large):
    _, folder = large
    table = folder / "calibration.points.parquet"
    content = table.read_bytes()
    table.write_bytes(content[:-1] + b"!")
    with pytest.raises(CalibrationError, match=r"calibration\.points\.parquet: this is not the table"):
        calibration_folder.read(folder)
    table.unlink()
    with pytest.raises(CalibrationError, match=r"calibration\.points\.parquet"):
        calibration_folder.read(folder)
    document = json.loads((folder / "calibration.json").read_text())
    table.write_bytes(content)
    document["points"]["sha256"] = "0" * 64
    (folder / "calibration.json").write_text(json.dumps(document))
    with pytest.raises(CalibrationError, match="this is not the table"):
        calibration_folder.read(folder)


def test_tables_of_a_calibration_that_was_here_before_go(large, monkeypatch):
    saved, folder = large
    monkeypatch.setattr(beside, "MANY", 10**6)
    calibration_folder.write(folder, saved.record, saved.urdf, "report")
    assert not list(folder.glob("*.parquet"))
    assert calibration_folder.read(folder).record.points == saved.record.points


def test_without_pyarrow_all_stands_in_the_json_file(large, tmp_path, monkeypatch):
    saved, _ = large
    monkeypatch.setattr(beside, "_pyarrow", lambda: False)
    calibration_folder.write(tmp_path / "plain", saved.record, saved.urdf, "report")
    assert json.loads((tmp_path / "plain" / "calibration.json").read_text())["schema_name"] == "irbcal-calibration-1"


@pytest.mark.parametrize("chunks", [[], [["a", None], ["b", "a"]], [["x"]], [[1.5, None]], [[True, False]]])
def test_values_of_a_column_are_those_of_pyarrow(chunks):
    import pyarrow as pa

    column = pa.chunked_array(chunks, type=None if chunks else pa.string())
    assert beside._values(column) == column.to_pylist()
