"""A calibration that was changed, contradicts itself or has absurd numbers is refused."""

import json
import shutil

import pytest

import irbcal
from irbcal.errors import CalibrationError
from irbcal.io import calibration_folder, integrity, robots
from irbcal.io.integrity import contradictions


@pytest.fixture
def copy(folder, tmp_path):
    shutil.copytree(folder, tmp_path, dirs_exist_ok=True)

    def change(edit, reseal=False):
        content = json.loads((tmp_path / "calibration.json").read_text())
        edit(content)
        if reseal:
            content = integrity.sealed(content)
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
    (lambda d: d["joint_map"]["terms"].pop(), "joint_map was"),
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


@pytest.mark.parametrize("name", ["calibrated.urdf", "joint_origins.yaml"])
def test_a_file_by_which_robots_move_that_is_not_listed_is_refused(copy, name):
    folder = copy(lambda d: d["seal"]["files"].pop(name))
    with pytest.raises(CalibrationError, match=f"{name} was changed after irbcal wrote it"):
        irbcal.load(folder)
    assert irbcal.verify(folder).differences == (f"{name} is not listed in the seal",)


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
    listed = integrity.hashes({"joint_origins.yaml": file.read_bytes()})
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


def scale(content):
    content["robot"]["base_to_frame0"] = [[2.0 * x for x in row] for row in content["robot"]["base_to_frame0"]]


def lengthen(content):
    content["robot"]["dhm_calibrated"][2]["a_mm"] += 100.0


def stiffen(content):
    content["joint_map"]["terms"][0]["coefficient_rad"] += 1e-4


def stretch(content):
    content["placement"]["base"]["qw"] *= 1.1


CONTRADICTIONS = [
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
    assert integrity.digest({"b": [1.5, None], "a": "ü"}) == (
        "cf20a961264914b72a6e5e1dec2c79c3341bd812f91adfd122b24cef9ff29d09"
    )


@pytest.mark.parametrize(
    ("place", "value"),
    [
        (("robot", "dhm_calibrated", 1, "a_mm"), 60_000.0),
        (("robot", "dhm_nominal", 1, "alpha_deg"), 1e308),
        (("robot", "dhm_nominal", 1, "theta_deg"), 2e4),
        (("robot", "base_to_frame0", 0, 3), 1e308),
        (("robot", "upper", 2), 1e308),
        (("joint_origins", 0, "calibrated", "xyz_m", 0), 51.0),
        (("joint_map", "terms", 0, "coefficient_rad"), 1e308),
        (("placement", "base", "x_mm"), 1e308),
        (("placement", "targets_mm", "smr1", 0), 1e308),
        (("certainty", "leave_one_out_mm", ""), 1e308),
        (("points", "x_mm", 0), 1e308),
        (("heldout", "all", "mean_mm"), 1e308),
    ],
)
def test_absurd_numbers_are_refused_with_their_place(folder, tmp_path, place, value):
    content = json.loads((folder / "calibration.json").read_text())
    inner = content
    for name in place[:-1]:
        inner = inner[name]
    inner[place[-1]] = value
    (tmp_path / "calibration.json").write_text(json.dumps(content))
    (tmp_path / "calibrated.urdf").write_bytes((folder / "calibrated.urdf").read_bytes())
    where = ".".join(map(str, place))
    with pytest.raises(CalibrationError, match=rf"calibration\.json: {where}: expected a number within") as refused:
        irbcal.load(tmp_path)
    assert refused.value.parameter == where
    assert len(str(refused.value).splitlines()) == 1


def test_what_the_program_writes_is_read(folder):
    assert irbcal.load(folder).record.model == "34"


@pytest.mark.parametrize("model", ["nominal", "34b", "placement", "auto"])
def test_a_fresh_calibration_agrees_with_itself(model, tmp_path):
    made = irbcal.calibrate(robots.demo_file("demo_identification.csv"), "irb1600", model)
    assert contradictions(made.record, made.urdf) == []


def test_another_calibrations_urdf_is_seen(tmp_path):
    file = robots.demo_file("demo_identification.csv")
    one, other = (irbcal.calibrate(file, "irb1600", model) for model in ("34", "26"))
    assert "not the geometry of calibrated.urdf" in "; ".join(contradictions(one.record, other.urdf))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: d["robot"]["lower"].pop(), "robot.lower has 5 entries for 6 joints"),
        (lambda d: d["robot"]["upper"].__setitem__(2, -300.0), "robot.lower of joint_3 is above robot.upper"),
        (lambda d: d["robot"]["base_to_frame0"].pop(), "base_to_frame0: List should have at least 4 items"),
        (lambda d: d["placement"]["base"].update(qw=0.0, qx=0.0, qy=0.0, qz=0.0), "no unit quaternion"),
        (lambda d: d["placement"]["targets_mm"]["smr1"].pop(), "smr1: List should have at least 3 items"),
        (lambda d: d["robot"]["dhm_calibrated"][1].update(a_mm=800.0), "not the geometry of calibrated.urdf"),
        (lambda d: d["robot"]["lower"].__setitem__(1, 1e3), "robot.lower of .* is above robot.upper"),
        (lambda d: d["covariance"].update(size=3), "covariance"),
    ],
)
def test_a_renewed_seal_helps_no_contradiction(folder, tmp_path, change, words):
    """Whoever edits the file can renew its seal, too."""
    document = json.loads((folder / "calibration.json").read_bytes())
    change(document)
    (tmp_path / "calibration.json").write_text(json.dumps(integrity.sealed(document)))
    (tmp_path / "calibrated.urdf").write_bytes((folder / "calibrated.urdf").read_bytes())
    with pytest.raises(CalibrationError, match=words):
        irbcal.load(tmp_path)


@pytest.fixture(scope="module")
def terms(tmp_path_factory):
    """A calibration of terms: frame terms, last moves, gravity."""
    folder = tmp_path_factory.mktemp("terms") / "cal"
    run = irbcal.simulate("irb120", random=30, seed=1, robot_seed=1, cell="realistic").measurements()
    irbcal.save(irbcal.calibrate(run, "irb120", "auto", terms="all"), folder)
    return folder


def _gravity(document):
    return next(term for term in document["joint_map"]["terms"] if term["basis"] == "gravity")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: None, None),
        (lambda d: _gravity(d).pop("link"), "joint_map"),
        (lambda d: _gravity(d).update(size={}), "calibration.json: joint_map"),
        (lambda d: d["joint_map"]["terms"][0].update(coefficient_rad=0.1), "joint_map misses its own test vectors"),
        (lambda d: d["frame_terms"]["terms"][0].update(coefficient_rad=0.1), "frame_terms miss their own test vectors"),
        (lambda d: d["frame_terms"]["test_vectors"][0]["T_base_tip"].pop(), "frame_terms"),
        (lambda d: d["frame_terms"]["test_vectors"][0]["T_base_tip"][1].pop(), "frame_terms cannot be used"),
    ],
)
def test_terms_are_held_against_their_test_vectors(terms, tmp_path, change, words):
    document = json.loads((terms / "calibration.json").read_bytes())
    change(document)
    (tmp_path / "calibration.json").write_text(json.dumps(integrity.sealed(document)))
    (tmp_path / "calibrated.urdf").write_bytes((terms / "calibrated.urdf").read_bytes())
    if words is None:
        irbcal.load(tmp_path)
        return
    with pytest.raises(CalibrationError, match=words):
        irbcal.load(tmp_path)
