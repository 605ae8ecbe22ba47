"""A calibration that was changed after it was written is refused, by name of the part or the file."""

import json
import shutil

import pytest

import irbcal
from irbcal.errors import CalibrationError
from irbcal.files import calibration_folder, seal


@pytest.fixture
def copy(folder, tmp_path):
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)

    def change(edit, reseal=False):
        content = json.loads((tmp_path / "calibration.json").read_text())
        edit(content)
        if reseal:
            content = seal.sealed(content)
        (tmp_path / "calibration.json").write_text(json.dumps(content))
        return tmp_path

    return change


def test_what_is_written_is_sealed_and_formatting_does_not_matter(copy):
    folder = copy(lambda d: None)
    assert irbcal.load(folder).record.seal.changes == []
    found = irbcal.verify(folder)
    assert found
    assert set(found.files) == {"calibration.json", "calibrated.urdf", "joint_origins.yaml", "report.html"}
    assert found.fingerprint in found.explanation


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


def widen(content):
    content["robot"]["upper"] = [9999.0] * 6
    content["robot"]["lower"] = [-9999.0] * 6


MOVING = [
    lambda d: d.update(simulated=not d["simulated"]),
    widen,
    lambda d: d["placement"]["base"].update(x_mm=d["placement"]["base"]["x_mm"] + 100.0),
    lambda d: d["robot"]["dhm_nominal"][2].update(a_mm=d["robot"]["dhm_nominal"][2]["a_mm"] + 50.0),
]


@pytest.mark.parametrize("edit", MOVING)
@pytest.mark.parametrize("without", ["no key", "null"])
def test_without_a_seal_nothing_is_opened(copy, edit, without):
    folder = copy(lambda d: (edit(d), d.pop("seal") if without == "no key" else d.update(seal=None)))
    with pytest.raises(CalibrationError, match=r"calibration\.json has no seal"):
        irbcal.load(folder)
    assert "calibration.json has no seal" in irbcal.verify(folder).differences


@pytest.mark.parametrize("edit", MOVING)
def test_what_a_robot_moves_by_is_in_the_fingerprint(copy, edit):
    """Whoever renews the seal must change the fingerprint, too, which stands in programs and in notes."""
    folder = copy(edit, reseal=True)
    with pytest.raises(CalibrationError, match="the fingerprint is not that of what it stands for"):
        irbcal.load(folder)


def test_every_file_is_listed(copy):
    folder = copy(lambda d: None)
    (folder / "report.html").write_text("another page")
    (folder / "notes.txt").write_text("a note")
    (folder / "joint_origins.yaml").unlink()
    found = irbcal.verify(folder)
    assert not found
    assert found.differences == ("joint_origins.yaml is missing", "report.html was changed after it was written")
    assert found.files == ("calibration.json", "calibrated.urdf")
    assert found.unlisted == ("notes.txt",)
    assert "notes.txt" in found.summary()
    irbcal.load(folder)  # no robot moves by what was changed here


@pytest.mark.parametrize(("old", "new"), [("x: ", "x: 1"), ("irbcal_", "irbcal_0")])
def test_joint_origins_of_another_robot_are_refused(copy, old, new):
    folder = copy(lambda d: None)
    file = folder / "joint_origins.yaml"
    file.write_text(file.read_text().replace(old, new, 1))
    with pytest.raises(CalibrationError, match=r"joint_origins\.yaml was changed after irbcal wrote it"):
        irbcal.load(folder)


def test_joint_origins_that_are_listed_anew_must_fit(copy):
    folder = copy(lambda d: None)
    file = folder / "joint_origins.yaml"
    file.write_text(file.read_text().replace("x: ", "x: 1", 1))
    listed = seal.hashes({"joint_origins.yaml": file.read_bytes()})
    copy(lambda d: d["seal"]["files"].update(listed))
    with pytest.raises(CalibrationError, match=r"joint_origins\.yaml has another origin of joint_1"):
        irbcal.load(folder)


def test_a_deliberate_change_is_accepted_with_a_line(copy, program):
    folder = copy(lambda d: d["notes"].append("measured by night"))
    (folder / "report.html").write_text("a page of mine")
    said = program("verify", folder, "--reseal", "a note on the night shift")
    assert "notes, report.html: a note on the night shift" in " ".join(said.split())
    assert irbcal.load(folder).record.notes[-1] == "measured by night"
    assert len(irbcal.verify(folder).changes) == 1
    with pytest.raises(CalibrationError, match="nothing was changed since it was sealed"):
        irbcal.verify(folder, reseal="again")


def test_a_report_written_again_is_listed_and_seals_nothing_else(copy):
    folder = copy(lambda d: None)
    (folder / "report.html").unlink()
    irbcal.report(folder)
    assert irbcal.verify(folder)
    copy(lambda d: d["notes"].append("x"))
    with pytest.raises(CalibrationError, match="notes was changed"):
        irbcal.report(folder)


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
def test_contradictions_are_seen_with_a_new_seal_and_never_accepted(copy, edit, words):
    folder = copy(edit, reseal=True)
    with pytest.raises(CalibrationError, match=words):
        irbcal.load(folder)
    with pytest.raises(CalibrationError, match="this cannot be accepted"):
        calibration_folder.reseal(folder, "on purpose")


def test_the_hash_is_that_of_canonical_json():
    assert seal.digest({"b": [1.5, None], "a": "ü"}) == (
        "cf20a961264914b72a6e5e1dec2c79c3341bd812f91adfd122b24cef9ff29d09"
    )
