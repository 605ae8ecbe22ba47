"""The README says what the program does: its measured tables, its options, its example."""

import re
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from support import assert_same_poses

import irbcal

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


def test_every_option_in_it_exists():
    named = set(re.findall(r"(?<![\w-])--[a-z][a-z-]+", README)) - {"--check"}
    known = ""
    for command in (
        "calibrate",
        "evaluate",
        "import",
        "report",
        "study",
        "plan",
        "simulate",
        "iso9283",
        "tracker",
        "ballbar",
        "joints",
        "verify",
        "view",
        "fk",
        "ik",
        "filter",
        "demo",
    ):
        done = subprocess.run(
            [sys.executable, "-m", "irbcal", command, "--help"], capture_output=True, text=True, check=True
        )
        known += done.stdout
    missing = {option for option in named if option not in known}
    assert missing == set()


def test_its_python_examples_run_one_after_the_other(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    outcome = irbcal.calibrate(ROOT / "irbcal" / "data" / "demo_identification.csv", "irb1600")
    irbcal.save(outcome, "my-robot")
    names = {}
    examples = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert len(examples) == 3
    exec(examples[0], names)
    assert np.abs(names["robot"].joint_map.commanded(names["theta"]) - names["q"]).max() < 1e-13
    exec(examples[1], names)
    assert_same_poses(names["planning"].placement(names["q"]), names["robot"].poses(names["q"]), 1e-12, 1e-12)
    exec(examples[2], names)
    assert names["visual"].ngeoms >= 7
    assert len(names["robot"].link_map) >= 8


def test_files_that_it_names_exist():
    for path in re.findall(r"`(scripts/[\w/.]+|irbcal/[\w/.]+|urdf/)`", README):
        assert (ROOT / path).exists(), path
    assert "SPEED_" + "TABLE" not in README
