"""A canary in every name and text that is anybody's, and every output: compiled, parsed or opened, it never acts."""

import csv
import json
import re
import shlex
import shutil
import sqlite3
import subprocess
import sys
from io import StringIO

import canary
import pytest
import yaml
from lxml import etree, html
from support import started

import irbcal
from irbcal.errors import CalibrationError, IrbcalError
from irbcal.exporting.export import TARGETS
from irbcal.io import integrity


@pytest.fixture(scope="module")
def room(tmp_path_factory):
    """The hostile robot, two sets of measurements and the calibration, in a folder with a hostile name."""
    folder = tmp_path_factory.mktemp("canary") / "a $(touch canary);'red room"
    folder.mkdir()
    robot = canary.urdf(folder / "robot.urdf")
    made = irbcal.calibrate(
        canary.measurements(folder / "m.csv"),
        robot,
        "34",
        base_link=canary.name("base_link"),
        tip_link=canary.name("tool0"),
    )
    made.save(folder / "calibration")
    canary.measurements(folder / "proof.csv", 30, seed=2)
    return folder


@pytest.fixture(autouse=True)
def silent(room, monkeypatch):
    """The canary was not there before, and is not there afterwards."""
    monkeypatch.chdir(room)
    yield
    assert not list(room.rglob("canary"))


def texts(part, place=()):
    """Places of texts in a document: of lists the first entry only; keys with None behind their place."""
    if isinstance(part, dict):
        for key, item in part.items():
            yield from texts(item, (*place, key))
        if part:
            yield (*place, next(iter(part)), None)
    elif isinstance(part, list):
        yield from texts(part[0], (*place, 0)) if part else ()
    elif isinstance(part, str):
        yield place


def put(document, place, text):
    """A copy of a document with another text or key."""
    made = json.loads(json.dumps(document))
    inner = made
    key = place[-2] if place[-1] is None else place[-1]
    for step in place[: -2 if place[-1] is None else -1]:
        inner = inner[step]
    if place[-1] is None:
        inner[text] = inner.pop(key)
    else:
        inner[key] = text
    return made


@pytest.mark.parametrize("seals", ["renewed", "gone"])
def test_every_text_of_a_calibration(room, tmp_path, seals):
    """What would act is refused on load, with one printable sentence, whatever the attacker does with the seal."""
    document = json.loads((room / "calibration" / "calibration.json").read_text())
    shutil.copytree(room / "calibration", tmp_path / "c")
    (tmp_path / "c" / "calibration.json").write_text(json.dumps(integrity.sealed(document)))
    irbcal.load(tmp_path / "c")
    places = [*enumerate(texts(document))]
    assert len(places) > 80
    for k, place in places if seals == "renewed" else places[::4]:
        foreign = put(document, place, canary.CONTROL[k % len(canary.CONTROL)])
        if seals == "renewed" and place[0] != "seal":
            foreign = integrity.sealed(foreign)
        elif seals == "gone":
            foreign.pop("seal", None)
        (tmp_path / "c" / "calibration.json").write_text(json.dumps(foreign))
        with pytest.raises(CalibrationError) as refused:
            irbcal.load(tmp_path / "c")
        assert str(refused.value).isprintable(), place
        assert seals == "gone" or "was changed" not in str(refused.value), place


@pytest.mark.parametrize("target", TARGETS)
def test_exports(room, target):
    if target == "casadi":
        pytest.importorskip("casadi", reason="CasADi needs Python 3.11")
    out = room / f"an $(touch canary) export as {target}"
    made = irbcal.export(room / "calibration", target, out)
    assert_silent(made.summary())
    command = made.next.partition("     #")[0]
    if target == "drake":
        assert eval(command.partition("AddPackageXml")[2]) == str(out / "package.xml")
    else:
        assert any(word.startswith(str(out)) for word in shlex.split(command))
    for file in sorted(path for path in out.rglob("*") if path.is_file()):
        opened(file)


def opened(file):
    """A file as its own reader takes it."""
    if file.suffix == ".py":
        done = subprocess.run([sys.executable, file], capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        assert_silent(done.stdout)
    elif file.name.endswith(("_check.cpp", "_stream.cpp", ".c")):
        if shutil.which("g++"):
            kind = ["-std=c++17"] if file.suffix == ".cpp" else ["-x", "c", "-std=c11"]
            call = ["g++", *kind, "-fsyntax-only", "-Wall", "-Werror=comment", file.name]
            done = subprocess.run(call, cwd=file.parent, capture_output=True, text=True)
            assert done.returncode == 0, done.stderr
    elif file.suffix in (".urdf", ".xacro", ".xml"):
        root = etree.parse(file).getroot()
        assert not [e for e in root.iter() if isinstance(e.tag, str) and e.tag in ("script", "img")]
        if file.name.endswith("_macro.xacro"):
            computed(file)
    elif file.suffix == ".yaml":
        content = yaml.safe_load(file.read_text())["kinematics"]
        assert canary.name("joint_1") in {entry["joint"] for key, entry in content.items() if key != "hash"}


def computed(macro):
    """xacro gives the names back, and computes nothing."""
    xacro = pytest.importorskip("xacro")
    text = xacro.process_file(str(macro.with_name(macro.name.replace("_macro.xacro", ".urdf.xacro")))).toxml()
    root = etree.fromstring(text.encode())
    assert canary.name("joint_1") in {joint.get("name") for joint in root.iter("joint")}
    assert root.findtext("gazebo") == '${open("canary","w")} $(eval 1/0)'


def assert_silent(text):
    assert not {char for char in text if not char.isprintable()} - {"\n", "\u00a0"}


def assert_page(file, scripts=0):
    """Markup in names is text: no element, no handler and no address of theirs."""
    root = html.document_fromstring(file.read_text("utf-8"))
    assert len(root.findall(".//script")) == scripts
    assert not root.xpath("//img[@onerror] | //*[@onload] | //script[starts-with(text(), 'x()')]")
    assert "canary" in root.text_content()


def assert_table(text):
    """No cell is a formula."""
    cells = [cell for row in csv.reader(StringIO(text)) for cell in row]
    assert any("canary" in cell for cell in cells)
    assert not [c for c in cells if c.startswith(("=", "+", "-", "@")) and not re.fullmatch(r"[+-]?[\d.e+-]+", c)]


def test_pages_tables_and_store(room, program):
    """Commands with hostile names of everything: pages, tables, SQL, and what the terminal is given."""
    for words in (
        ["verify", "calibration"],
        ["evaluate", "calibration", "proof.csv", "--tolerance", "1", "--report", "certificate.html", "--data", "data"],
        ["compare", "calibration", "calibration", "--measurements", "proof.csv", "--csv", "compared.csv"],
        ["report", "calibration", "--figures", "figures", "--format", "svg", "--data", "tables"],
        ["view", "calibration", "--html", "view.html"],
        ["fleet", "add", "calibration", "--store", "fleet.db"],
        ["fleet", "list", "--store", "fleet.db", "--report", "fleet.html"],
        ["fleet", "export", "--store", "fleet.db", "--out", "fleet.csv"],
    ):
        assert_silent(program(*words))
    for page in ("certificate.html", "calibration/report.html", "fleet.html"):
        assert_page(room / page)
    assert_page(room / "view.html", scripts=4)
    for table in ("fleet.csv", "data/points.csv", "compared.csv"):
        assert_table((room / table).read_text())
    for file in (room / "figures").glob("*.svg"):
        etree.parse(file)
    stored = sqlite3.connect(room / "fleet.db")
    assert canary.name("robot") in {value for row in stored.execute("select * from robots") for value in row}


MODULE = """MODULE m
  ! {text}
  CONST jointtarget jA:=[[10,-10,20,15,40,-30],[9E9,9E9,9E9,9E9,9E9,9E9]];
  PROC main()
    TPWrite "{quoted}";
    MoveAbsJ jA,v100,fine,tool0;
  ENDPROC
ENDMODULE
"""


@pytest.mark.parametrize("text", [canary.TEXT, "\x1b]0;x\x07\x9b31m"])
def test_programs(room, tmp_path, text):
    """What stands in a program stays what it was, and nothing of it reaches the terminal."""
    source = MODULE.format(text=text, quoted=text.replace('"', '""')).encode()
    (tmp_path / "job.mod").write_bytes(source)
    done = started("filter", room / "calibration", "job.mod", "--out", "true.mod", cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert_silent(done.stdout + done.stderr)
    before, after = source.splitlines(), (tmp_path / "true.mod").read_bytes().splitlines()
    assert [line for line in after if line not in before and b"jA:=" not in line and b"irbcal" not in line] == []
    assert [line for line in before if line not in after and b"jA:=" not in line] == []


@pytest.mark.parametrize("text", canary.CONTROL)
def test_files_from_elsewhere(room, tmp_path, text):
    """What is no name is refused in one printable sentence: in a URDF (where XML can hold it), a table, a list."""
    robot = (room / "robot.urdf").read_text()
    table = (room / "m.csv").read_text()
    cell = text.replace('"', '""')
    (tmp_path / "robot.urdf").write_text(robot.replace("link_3", text.replace('"', "&quot;").replace("\n", "&#10;")))
    (tmp_path / "m.csv").write_text(table.replace("smr1", cell))
    row = f'"{cell}",m.csv,irb1600' if "\n" not in text else f"a,{text},irb1600"
    (tmp_path / "list.csv").write_text(f"id,measurements,robot\n{row}\n")
    for call in (
        lambda: irbcal.read_urdf(tmp_path / "robot.urdf"),
        lambda: irbcal.calibrate(tmp_path / "m.csv", "irb1600", "34"),
        lambda: irbcal.fleet_calibrate(tmp_path / "list.csv", tmp_path / "out"),
    ):
        with pytest.raises(IrbcalError) as refused:
            call()
        assert str(refused.value).isprintable()


def test_plans(room, program):
    """A robot program holds names of the robot in comments only."""
    links = ["--base-link", canary.name("base_link"), "--tip-link", canary.name("tool0")]
    assert_silent(
        program("plan", "--robot", "robot.urdf", "--out", "plan", "--cube", "4", "--language", "rapid", *links)
    )
    assert_page(room / "plan" / "plan.html", scripts=4)
    lines = (room / "plan" / "plan.mod").read_text().splitlines()
    assert all(line.strip().startswith("!") for line in lines if "canary" in line)
