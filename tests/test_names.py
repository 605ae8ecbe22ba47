"""Names cannot act: not in comments of programs, not in terminals, not in spreadsheets. Names in the code say what things are."""

import ast
import re
import runpy
from pathlib import Path

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

import irbcal
from irbcal import names
from irbcal.errors import MeasurementError, RobotError
from irbcal.io import robots
from irbcal.measurement.input_table import read_targets

LINE_BREAKS = ["\n", "\r", "\x0b", "\x0c", "\x1c", "\x85", "\u2028", "\u2029", "\x9b", "\x1b", "\u202e", "\x00"]


@pytest.mark.parametrize("char", LINE_BREAKS)
def test_what_ends_a_line_or_steers_a_terminal_is_refused(char):
    with pytest.raises(RobotError, match=r"arm\.urdf: expected a name of printable characters on one line") as caught:
        names.check_names(["fine", f"a{char}MoveAbsJ"], RobotError, file="arm.urdf")
    assert char not in str(caught.value)


def test_common_names_pass():
    names.check_names(["smr1", "Prüfling 3", "目标", "a-b_c.d/e", None, "1", "-1", "x\u00a0y"], RobotError)


def test_names_without_end_are_refused():
    with pytest.raises(RobotError, match="robot: expected a name of at most 200 characters, found 300"):
        names.check_names(["n" * 300], RobotError, parameter="robot")


@given(st.text())
def test_a_comment_is_one_line_of_printable_ascii(text):
    line = names.comment(text)
    assert len(line.splitlines()) <= 1
    assert len(line) <= names.LONGEST_COMMENT
    assert all(" " <= char <= "~" for char in line)


def test_a_comment_keeps_what_it_can():
    assert names.comment("pose 1,\n  cube: smr1 é") == "pose 1, cube: smr1 ?"


@given(st.text(max_size=20))
def test_cells_are_no_formulas_and_read_back(text):
    assert names.from_cell(names.cell(text)) == text or text.startswith("'")
    if names.cell(text)[:1] in ("=", "+", "-", "@"):
        float(text)


def test_a_table_is_neutralised_where_it_must_be():
    table = pd.DataFrame({"target": ["=cmd|' /C calc'!A0", "smr1"], "x_mm": [-1.0, 2.0], "pose": ["-3", "4"]})
    safe = names.without_formulas(table)
    assert safe["target"].tolist() == ["'=cmd|' /C calc'!A0", "smr1"]
    assert safe["pose"].tolist() == ["-3", "4"]
    assert table["target"][0].startswith("=")
    same = table.drop(columns="target")
    assert names.without_formulas(same) is same


def test_a_list_of_targets_reads_back_what_was_neutralised(tmp_path):
    file = tmp_path / "targets.csv"
    file.write_text("target,x_mm,y_mm,z_mm\n'=a,1,2,3\n")
    assert list(read_targets(file)) == ["=a"]


@pytest.mark.parametrize("name", ["a\x85MoveJ", '"a\nMoveJ"'])
def test_a_list_of_targets_with_a_line_break_is_refused(tmp_path, name):
    file = tmp_path / "targets.csv"
    file.write_text(f"target,x_mm,y_mm,z_mm\n{name},1,2,3\n", encoding="utf-8", newline="")
    with pytest.raises(Exception, match="row 2, column target: expected a name of printable characters"):
        read_targets(file)


def test_a_file_name_with_a_line_break_is_refused_before_the_fit(tmp_path):
    data = robots.demo_file("demo_identification.csv").read_bytes()
    (tmp_path / "a\nb.csv").write_bytes(data)
    with pytest.raises(MeasurementError, match=r"printable characters on one line, found 'a\\nb\.csv'"):
        irbcal.calibrate(tmp_path / "a\nb.csv", "irb1600", model="34")


def test_names_in_the_code_say_what_things_are(monkeypatch, capsys):
    script = Path(__file__).parents[1] / "scripts" / "names"
    monkeypatch.setattr("sys.argv", [str(script), "--check"])
    names = runpy.run_path(str(script))
    assert names["main"]() == 0, capsys.readouterr().out
    text = "def _fit(points, own):\n    _found = own.found + points\n    return _found"
    assert sorted(names["names_in"](text)) == ["fit", "found", "found", "found", "own", "own", "points", "points"]
    assert {"found", "own"} <= names["VAGUE"]


def test_what_the_interpreter_shows_begins_with_the_name_of_the_class():
    """As far as a class writes it itself: ``<Word`` in a text of ``__repr__``."""
    for path in sorted(Path(irbcal.__file__).parent.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                shown = [part for part in node.body if isinstance(part, ast.FunctionDef) and part.name == "__repr__"]
                texts = [text.value for part in shown for text in ast.walk(part) if isinstance(text, ast.Constant)]
                words = [match[1] for text in texts if (match := re.match(r"<(\w+)", str(text)))]
                assert set(words) <= {node.name}, path
