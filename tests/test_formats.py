"""docs/formats.md: its reference implementations meet the test vectors, its table and schema are those of the files."""

import json
import re
import shutil
import subprocess
from pathlib import Path

import jsonschema
import numpy as np
import pinocchio
import pytest
from support import arm, on_a_rail

from irbcal.io import urdf
from irbcal.io.robot_section import DhmRow
from irbcal.io.schema import Record
from irbcal.io.term_sections import JointMapSection
from irbcal.modeling.joint_map import JointMap
from irbcal.modeling.terms import families
from irbcal.modeling.terms.payload import Payload
from irbcal.modeling.terms.term_map import TermMap

PAGE = (Path(__file__).parents[1] / "docs" / "formats.md").read_text(encoding="utf-8")
COVERED = ("gravity", "gain", "thesis", "harmonics", "direction", "move")


def code(language, mark):
    (found,) = [text for text in re.findall(rf"^```{language}\n(.*?)^```$", PAGE, re.M | re.S) if mark in text]
    return found


def with_terms(model, terms):
    """What a joint map of terms needs of a ``calibration.json``."""
    values = np.array([t.size for t in terms]) * np.random.default_rng(3).standard_normal(len(terms))
    joint_map = JointMap(TermMap(model, tuple(terms), values, np.abs(values)), None, 2.0)
    kinds = ["prismatic" if slides else "revolute" for slides in model.table.prismatic]
    rows = [row.model_dump() for row in DhmRow.from_table(model.table)]
    robot = {"joint_types": kinds, "dhm_nominal": rows, "base_to_frame0": model.T_base_0.tolist()}
    return {"robot": robot, "joint_map": json.loads(JointMapSection.from_joint_map(joint_map, model).model_dump_json())}


@pytest.fixture(scope="module")
def calibrations(folder, tmp_path_factory):
    """``calibration.json`` with joint maps of both kinds, and one that neither implementation covers."""
    rail = urdf.read(on_a_rail(tmp_path_factory.mktemp("rail") / "rail.urdf"), "rail_base", "tool0").arm
    made = {"levels": json.loads((folder / "calibration.json").read_text())}
    for name, model, names in (
        ("terms", arm("irb1600"), COVERED),
        ("rail", rail, tuple(name for name in COVERED if name != "thesis")),
    ):
        made[name] = with_terms(model, [t for family in names for t in families()[family].terms(model)])
    made["payload"] = with_terms(arm("irb120"), Payload().terms(arm("irb120")))
    top = tmp_path_factory.mktemp("formats")
    for name, content in made.items():
        (top / name / "my-robot").mkdir(parents=True)
        (top / name / "my-robot" / "calibration.json").write_text(json.dumps(content), encoding="utf-8")
    return top


@pytest.fixture(scope="module")
def program(tmp_path_factory):
    """The C++ of the page, compiled; Boost.JSON comes with Pinocchio, or with the system."""
    if shutil.which("g++") is None:
        pytest.skip("no g++")
    folder, boost = tmp_path_factory.mktemp("cpp"), Path(pinocchio.__file__).parents[4]
    (folder / "joint_map.cpp").write_text(code("cpp", "int main"), encoding="utf-8")
    call = ["g++", "-std=c++17", "-Wall", "-Wextra", "-Werror", "joint_map.cpp", "-isystem", boost / "include"]
    call += ["-L", boost / "lib", "-lboost_json", f"-Wl,-rpath,{boost / 'lib'}", "-o", "joint_map"]
    done = subprocess.run(call, cwd=folder, capture_output=True, text=True)
    if "boost/json.hpp: No such file" in done.stderr:
        pytest.skip("no Boost.JSON")
    assert done.returncode == 0, done.stderr
    return folder / "joint_map"


KINDS = pytest.mark.parametrize("kind", ["levels", "terms", "rail"])


@KINDS
def test_python_meets_the_test_vectors(calibrations, kind, monkeypatch):
    monkeypatch.chdir(calibrations / kind)
    names = {}
    exec(code("python", "def effective"), names)  # ends with the test vectors
    content = names["calibration"]["joint_map"]
    assert len(content["test_vectors"]) == 5
    vector = content["test_vectors"][0]
    assert np.abs(names["found"] - names["test"]["q"]).max() > 1e-5
    names["calibration"]["joint_map"] = change(content)
    found = names["effective"](names["calibration"], vector["q"], vector["previous_q"])
    assert np.abs(found - vector["effective"]).max() > 1e-9  # a coefficient that is wrong is seen


@KINDS
def test_cpp_meets_the_test_vectors(calibrations, kind, program, tmp_path):
    file = calibrations / kind / "my-robot" / "calibration.json"
    done = subprocess.run([program, file], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert 0.0 <= float(done.stdout) < 1e-12
    content = json.loads(file.read_text())
    content["joint_map"] = change(content["joint_map"])
    (tmp_path / "wrong.json").write_text(json.dumps(content))
    assert subprocess.run([program, tmp_path / "wrong.json"], capture_output=True).returncode == 1


def change(joint_map):
    terms = [dict(term) for term in joint_map["terms"]]
    key = next(key for key in terms[0] if key.startswith("coefficient"))
    terms[0][key] += 1e-6
    return joint_map | {"terms": terms}


def test_what_they_do_not_cover_they_refuse(calibrations, program, monkeypatch):
    monkeypatch.chdir(calibrations / "payload")
    with pytest.raises(ValueError, match="terms of payload are not computed here"):
        exec(code("python", "def effective"), {})
    done = subprocess.run([program, "my-robot/calibration.json"], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (2, "terms of payload are not computed here\n")


def test_the_table_names_every_section():
    table = PAGE.partition("| section | content |")[2].partition("\n\n")[0]
    named = {name for row in table.splitlines()[2:] for name in re.findall(r"`(\w+)`", row.split("|")[1])}
    assert named == set(Record.model_fields)


def test_joint_map_tables_name_every_field(calibrations):
    section = PAGE.partition("## The joint map")[2].partition("### In Python")[0]
    for kind in ("levels", "terms"):
        content = json.loads((calibrations / kind / "my-robot" / "calibration.json").read_text())["joint_map"]
        assert {name for name in content if f"`{name}`" not in section} <= {"schema"}


def test_the_schema_is_that_of_the_files(folder, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    exec(code("python", "model_json_schema"), {})
    schema = json.loads((tmp_path / "calibration.schema.json").read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    content = json.loads((folder / "calibration.json").read_text())
    jsonschema.validate(content, schema)
    with pytest.raises(jsonschema.ValidationError):
        jsonschema.validate(content | {"robot": {}}, schema)
