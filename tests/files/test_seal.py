"""A calibration that was changed after it was written is refused, by name of the part."""

import json

import pytest

import irbcal
from irbcal.errors import CalibrationError
from irbcal.files import calibration_folder, seal


@pytest.fixture
def copy(folder, tmp_path):
    for name in ("calibration.json", "calibrated.urdf"):
        (tmp_path / name).write_bytes((folder / name).read_bytes())

    def change(edit, reseal=False):
        content = json.loads((tmp_path / "calibration.json").read_text())
        edit(content)
        if reseal:
            content = seal.sealed(content)
        (tmp_path / "calibration.json").write_text(json.dumps(content))
        return tmp_path

    return change


def test_what_is_written_is_sealed_and_formatting_does_not_matter(copy):
    assert irbcal.load(copy(lambda d: None)).record.seal.changes == []


EDITS = [
    (lambda d: d["robot"]["dhm_calibrated"][2].update(a_mm=d["robot"]["dhm_calibrated"][2]["a_mm"] + 5), "robot was"),
    (lambda d: d["heldout"]["all"].update(mean_mm=0.01), "heldout was"),
    (lambda d: d["joint_map"]["gain"].pop(), "joint_map was"),
    (lambda d: (d["notes"].append("x"), d["placement"]["base"].update(x_mm=1.0)), "placement, notes were"),
    (lambda d: d.update(model="26"), "model was"),
    (lambda d: d["seal"]["parts"].pop("fit"), "fit was"),
    (lambda d: d["points"]["x_mm"].__setitem__(0, d["points"]["x_mm"][0] + 1e-6), "points was"),
]


@pytest.mark.parametrize(("edit", "words"), EDITS)
def test_edits_are_refused_by_name(copy, edit, words):
    folder = copy(edit)
    with pytest.raises(CalibrationError, match=rf"calibration\.json: {words} changed after irbcal wrote it"):
        irbcal.load(folder)
    found = irbcal.verify(folder)
    assert not found
    assert words.split()[0].rstrip(",") in found.explanation


def test_a_deliberate_change_is_accepted_with_a_line(copy, program):
    folder = copy(lambda d: d["notes"].append("measured by night"))
    said = program("verify", folder, "--reseal", "a note on the night shift")
    assert "notes: a note on the night shift" in " ".join(said.split())
    assert irbcal.load(folder).record.notes[-1] == "measured by night"
    assert len(irbcal.verify(folder).changes) == 1
    with pytest.raises(CalibrationError, match="nothing was changed since it was sealed"):
        irbcal.verify(folder, reseal="again")


def drop_gain(content):
    content["joint_map"]["gain"].pop()


def scale(content):
    content["robot"]["base_to_frame0"] = [[2.0 * x for x in row] for row in content["robot"]["base_to_frame0"]]


def lengthen(content):
    content["robot"]["dhm_calibrated"][2]["a_mm"] += 100.0


def stiffen(content):
    content["joint_map"]["stiffness_A_rad"] += 1e-4


def stretch(content):
    content["placement"]["base"]["qw"] *= 1.1


CONTRADICTIONS = [
    (drop_gain, "joint_map.gain has 5 entries for 6 joints"),
    (scale, "robot.base_to_frame0 is no rigid frame"),
    (lengthen, r"robot.dhm_calibrated is not the geometry of calibrated.urdf: tips differ by up to 100 mm"),
    (stiffen, "joint_map misses its own test vectors"),
    (stretch, "placement.base has no unit quaternion"),
]


@pytest.mark.parametrize(("edit", "words"), CONTRADICTIONS)
def test_contradictions_are_seen_without_a_seal_and_never_accepted(copy, edit, words):
    folder = copy(lambda d: (edit(d), d.pop("seal")))
    with pytest.raises(CalibrationError, match=words):
        irbcal.load(folder)
    with pytest.raises(CalibrationError, match="this cannot be accepted"):
        calibration_folder.reseal(folder, "on purpose")


def test_a_file_of_an_earlier_version_is_read(copy):
    assert irbcal.load(copy(lambda d: d.pop("seal"))).record.seal is None


def test_the_hash_is_that_of_canonical_json():
    assert seal.digest({"b": [1.5, None], "a": "ü"}) == (
        "cf20a961264914b72a6e5e1dec2c79c3341bd812f91adfd122b24cef9ff29d09"
    )
