"""From the thesis to the code: the index is complete and up to date, and its reader reads what is written."""

import re
import runpy
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[1] / "scripts" / "thesis_index"


@pytest.fixture(scope="module")
def script():
    return runpy.run_path(str(SCRIPT))


@pytest.fixture(scope="module")
def index(script):
    return script["index"]()


def test_every_kept_item_is_cited_and_the_page_is_up_to_date(script, index):
    places, ranges = index
    assert [item for items in script["kept"]().values() for item in items if item not in places] == []
    assert ranges == []
    text = script["PAGE"].read_text(encoding="utf-8")
    assert text == script["page"](places), "python scripts/thesis_index writes it anew"


def test_citations_are_read(script):
    citations = script["citations"]
    text = "Nubiola 2011, eqs. 5.9, 5.10 and 5.11, section 7.5, Table A I-1, Figures 7.2 and 7.4, annex VI; eqs. 3.1 to 3.4"
    assert [item for item, _ in citations(text)] == [
        "eq. 5.9",
        "eq. 5.10",
        "eq. 5.11",
        "section 7.5",
        "Table A I-1",
        "Figure 7.2",
        "Figure 7.4",
        "annex VI",
        "eq. 3.1",
    ]
    assert [is_range for _, is_range in citations(text)][-1]


def test_the_code_that_computes_an_equation_comes_first(index):
    places, _ = index
    first = {item: f"{found[0].file.removeprefix('irbcal/')}: {found[0].name}" for item, found in places.items()}
    for item, place in {
        "eq. 3.31": "modeling/terms/gain.py: Gain",
        "eq. 5.1": "modeling/dhm.py: DHMTable.step",
        "eq. 5.8": "modeling/terms/thesis.py: fourier_of",
        "eq. 5.11": "modeling/terms/thesis.py: stiffness_of",
        "eq. 5.12": "modeling/stiffness.py: Stiffness.coefficients",
        "eq. 5.13": "modeling/stiffness.py: Stiffness.coefficients",
        "eq. 5.14": "modeling/stiffness.py: Stiffness.coefficients",
        "eq. 5.17": "modeling/stiffness.py: Stiffness._lever",
        "eq. 5.18": "modeling/stiffness.py: Stiffness.k_F1",
        "eq. 5.22": "modeling/stiffness.py: Stiffness.guess",
        "eq. 6.3": "modeling/inverse/orthoparallel.py: OrthoParallel.from_arm",
        "eq. 6.39": "modeling/dhm.py: forward",
        "eq. 6.40": "modeling/robot.py: Robot.forward",
        "eq. 6.41": "modeling/inverse/newton.py: errors",
        "eq. 7.1": "modeling/dhm.py: forward",
        "eq. 7.2": "modeling/robot.py: Robot.forward",
        "eq. 7.3": "correction/fake_targets.py: correct_joints",
        "Table 7.4": "scripts/thesis/chapter7/tables.py: table_7_4",
    }.items():
        assert first[item] == place, item


def test_each_room_and_file_with_a_command_is_there(script):
    root = SCRIPT.parents[1]
    files = [str(path.relative_to(root)) for top in ("irbcal", "scripts") for path in (root / top).rglob("*.py")]
    for start, _ in script["COMMANDS"]:
        assert any(file.startswith(start) for file in files), start
    for room in script["FLOORS"]:
        assert any(file.startswith((f"irbcal/{room}/", f"irbcal/{room}.py")) for file in files), room
    commands = script["commands"]
    for name, command in (
        ("pose_criteria", "iso9283"),
        ("pose_check", "iso9283"),
        ("iso9283_check", "iso9283"),
        ("settling", "tracker"),
        ("tracker_check", "tracker"),
        ("ballbar_check", "ballbar"),
        ("evaluation", "evaluate"),
    ):
        assert commands(f"irbcal/validation/{name}.py") == command


def test_the_page_leads_to_the_code_and_says_what_is_there():
    page = SCRIPT.parents[1] / "docs" / "thesis.md"
    rows = [line.split(" | ") for line in page.read_text(encoding="utf-8").splitlines() if re.match(r"\| eq\.", line)]
    assert len(rows) > 100
    for _, said, where, _ in rows:
        assert len(said) > 10
        for link in re.findall(r"\]\(([^)]+)\)", where):
            assert (page.parent / link).is_file()
