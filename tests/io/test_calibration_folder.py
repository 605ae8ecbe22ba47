"""A calibration folder is written whole or not at all, and read as it was written."""

import hashlib
import io
import json

import numpy as np
import pytest

import irbcal
from irbcal.errors import CalibrationError
from irbcal.io import calibration_folder, integrity
from irbcal.io.opening import open_calibration


@pytest.fixture
def large(folder, tmp_path, monkeypatch):
    saved = calibration_folder.read(folder)
    monkeypatch.setattr(calibration_folder, "FEWEST_POSES_IN_TABLE_FILES", 10)
    calibration_folder.write(tmp_path / "large", saved.record, saved.urdf, "report")
    return saved, tmp_path / "large"


def test_what_is_read_is_what_was_written(large):
    saved, folder = large
    document = json.loads((folder / "calibration.json").read_text())
    assert document["schema_name"] == "irbcal-calibration-1"
    assert set(document["points"]) == {"file", "sha256"}
    again = calibration_folder.read(folder)
    assert again.record.model_copy(update={"seal": None}) == saved.record.model_copy(update={"seal": None})
    assert calibration_folder.checked(folder).differences == ()


def test_a_table_that_was_changed_or_lost_is_refused(large):
    _, folder = large
    table = folder / "calibration.points.npz"
    content = table.read_bytes()
    table.write_bytes(content[:-1] + b"!")
    with pytest.raises(CalibrationError, match=r"calibration\.points\.npz: this is not the table"):
        calibration_folder.read(folder)
    table.unlink()
    with pytest.raises(CalibrationError, match=r"calibration\.points\.npz"):
        calibration_folder.read(folder)
    document = json.loads((folder / "calibration.json").read_text())
    table.write_bytes(content)
    document["points"]["sha256"] = "0" * 64
    (folder / "calibration.json").write_text(json.dumps(document))
    with pytest.raises(CalibrationError, match="this is not the table"):
        calibration_folder.read(folder)


def test_tables_of_a_calibration_that_was_here_before_go(large, monkeypatch):
    saved, folder = large
    monkeypatch.setattr(calibration_folder, "FEWEST_POSES_IN_TABLE_FILES", 10**6)
    calibration_folder.write(folder, saved.record, saved.urdf, "report")
    assert not list(folder.glob("*.npz"))
    assert calibration_folder.read(folder).record.points == saved.record.points


def _exchanged(folder, content):
    """Put another table beside a calibration.json whose hashes fit it, as somebody who means harm would."""
    (folder / "calibration.points.npz").write_bytes(content)
    document = json.loads((folder / "calibration.json").read_text())
    document["points"]["sha256"] = hashlib.sha256(content).hexdigest()
    files = document["seal"]["files"] | {"calibration.points.npz": document["points"]["sha256"]}
    (folder / "calibration.json").write_text(json.dumps(integrity.sealed(document, files)))


class Harmful:
    def __reduce__(self):
        return (open, ("harm", "w"))


def test_a_table_that_holds_objects_or_unpacks_is_refused_and_runs_nothing(large, tmp_path, monkeypatch):
    _, folder = large
    monkeypatch.chdir(tmp_path)
    whole = (folder / "calibration.points.npz").read_bytes()
    with np.load(io.BytesIO(whole)) as arrays:
        columns = dict(arrays)
    changes = {
        "pickle": columns | {"x_mm": np.array([Harmful()] * len(columns["x_mm"]), dtype=object)},
        "names": columns | {"target": np.full_like(columns["target"], 10**6)},
        "not of numbers": columns | {"x_mm": columns["x_mm"].astype(str)},
        "values for": columns | {"x_mm": columns["x_mm"][1:]},
    }
    for changed in changes.values():
        buffer = io.BytesIO()
        np.savez(buffer, **changed)
        _exchanged(folder, buffer.getvalue())
        with pytest.raises(CalibrationError):
            calibration_folder.read(folder)
    packed = io.BytesIO()
    np.savez_compressed(packed, **columns)
    for content in (packed.getvalue(), whole[:-10], whole[: len(whole) // 2], b"", whole.replace(b"<f8", b"|O8", 1)):
        _exchanged(folder, content)
        with pytest.raises(CalibrationError, match=r"calibration\.points\.npz: this is no table of a calibration"):
            calibration_folder.read(folder)
    assert not (tmp_path / "harm").exists()
    _exchanged(folder, whole)
    calibration_folder.read(folder)


def test_urdf_with_world_and_target_links_needs_no_other_file_than_the_joint_map(validated, folder):
    import pinocchio as pin

    model = pin.buildModelFromXML((folder / "calibrated.urdf").read_text())
    data = model.createData()
    q = validated.urdf.arm.random_joints(20, 4)
    theta = validated.fit.robot.joint_map.effective(q)
    world, target = model.getFrameId("world"), model.getFrameId("target_smr2")
    for row, expected in zip(theta, validated.fit.robot.points(q, "smr2"), strict=True):
        pin.framesForwardKinematics(model, data, row)
        found = (data.oMf[world].inverse() * data.oMf[target]).translation
        assert np.abs(found - expected).max() < 1e-9


def test_a_changed_urdf_is_noticed(folder, tmp_path):
    for name in ("calibration.json", "calibrated.urdf"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())
    assert irbcal.load(tmp_path).record.model == "34"
    (tmp_path / "calibrated.urdf").write_text("<robot/>")
    with pytest.raises(CalibrationError, match=r"calibrated\.urdf"):
        irbcal.load(tmp_path)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda d: d.pop("model"), "calibration.json: model: Field required"),
        (lambda d: d.update(schema_name="irbcal-calibration-9"), "schema_name: Input should be 'irbcal-calibration-1'"),
        (lambda d: d["robot"]["dhm_calibrated"][2].update(a_mm="long"), "robot.dhm_calibrated.2.a_mm: Input should be"),
        (lambda d: d.update(surprise=1), "surprise: Extra inputs are not permitted"),
    ],
)
def test_damaged_calibrations_are_refused_with_the_place(folder, tmp_path, change, expected):
    content = json.loads((folder / "calibration.json").read_text())
    change(content)
    (tmp_path / "calibration.json").write_text(json.dumps(content))
    (tmp_path / "calibrated.urdf").write_bytes((folder / "calibrated.urdf").read_bytes())
    with pytest.raises(CalibrationError) as caught:
        irbcal.load(tmp_path)
    assert expected in str(caught.value)


def test_not_a_calibration_folder(tmp_path):
    with pytest.raises(CalibrationError, match="not a calibration folder: there is no such file"):
        irbcal.load(tmp_path)
    (tmp_path / "calibration.json").write_text("{")
    with pytest.raises(CalibrationError, match="Invalid JSON"):
        irbcal.load(tmp_path)


# --- writing: all or nothing ---------------------------------------------------------------------------


def content(folder):
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def test_the_file_in_the_folder_names_the_folder(folder):
    assert irbcal.load(folder / "calibration.json").folder == folder
    assert len(repr(calibration_folder.read(folder))) < 300


@pytest.mark.parametrize("calibration", [None, 5, ["my-robot"]])
def test_what_is_no_calibration_is_refused(calibration):
    with pytest.raises(
        CalibrationError, match="expected a calibration folder or a loaded calibration, found"
    ) as refused:
        open_calibration(calibration)
    assert refused.value.parameter == "calibration"
