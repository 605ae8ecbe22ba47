"""The README says what the program does: its measured tables, its options, its example."""

import re
import runpy
import shutil
from pathlib import Path

import numpy as np
import pytest
from support import assert_same_poses
from typer.main import get_command

import irbcal
from irbcal.cli.main import app

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
NUMBER = re.compile(r"-?\d+\.\d+")


@pytest.mark.parametrize("name", ["levels", "pinocchio", "table_6_1"])
def test_tables_are_those_that_the_script_makes(name):
    """Words to the letter; numbers within 0.003 mm, because other processors round otherwise."""
    made = "\n".join(runpy.run_path(str(ROOT / "scripts" / "readme_tables"))[name]())
    title = name.replace("table_6_1", "table 6.1")
    written = re.search(rf"<!-- {title} -->(.*?)<!-- end -->", README, re.DOTALL)[1].strip()
    assert NUMBER.sub("#", made) == NUMBER.sub("#", written)
    numbers = [np.array(NUMBER.findall(text), dtype=float) for text in (made, written)]
    assert np.abs(numbers[0] - numbers[1]).max(initial=0.0) < 0.003


def test_every_option_and_command_in_it_exists():
    commands = get_command(app).commands
    known = {option for command in commands.values() for p in command.params for option in (*p.opts, *p.secondary_opts)}
    known |= {"--install-completion", "--check"}
    named = set(re.findall(r"(?<![\w-])--[a-z][a-z0-9-]+", README))
    assert named - known == set()
    blocks = re.findall(r"^```(\w*)\n(.*?)^```", README, re.DOTALL | re.MULTILINE)
    lines = "\n".join(text for kind, text in blocks if not kind)
    called = {*re.findall(r"^irbcal ([a-z0-9]+)", lines, re.MULTILINE), *re.findall(r"`irbcal ([a-z0-9]+)", README)}
    assert called - set(commands) == set()
    assert {name for name, command in commands.items() if not command.hidden} - called == set(), "told nowhere"


def test_its_python_examples_run_one_after_the_other(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    shutil.copy(ROOT / "irbcal" / "data" / "demo_identification.csv", "measured.csv")
    irbcal.save(irbcal.calibrate("measured.csv", "irb1600"), "my-robot")
    names = {}
    examples = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert len(examples) == 4
    exec(examples[0], names)
    assert np.abs(names["robot"].joint_map.commanded(names["theta"]) - names["q"]).max() < 1e-13
    exec(examples[1], names)
    assert Path("errors.png").read_bytes().startswith(b"\x89PNG")
    assert names["evaluation"].calibrated["n"] == len(names["evaluation"].to_frame())
    assert irbcal.load("my-robot-2").model == "auto"
    exec(examples[2], names)
    assert_same_poses(names["planning"].placement(names["q"]), names["robot"].poses(names["q"]), 1e-12, 1e-12)
    exec(examples[3], names)
    assert names["visual"].ngeoms >= 7
    assert len(names["robot"].link_map) >= 8


def test_files_that_it_names_exist():
    for path in re.findall(r"`(scripts/[\w/.]+|irbcal/[\w/.]+|urdf/)`", README):
        assert (ROOT / path).exists(), path
    assert "SPEED_" + "TABLE" not in README
