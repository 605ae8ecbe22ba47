"""Style and types: what continuous integration and the hooks before a commit check."""

import subprocess
import sys
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]


def python_scripts():
    """Scripts without an ending, which ruff would not find by itself."""
    files = [path for path in sorted((ROOT / "scripts").rglob("*")) if path.is_file() and not path.suffix]
    return [path for path in files if "python" in path.read_text(encoding="utf-8").partition("\n")[0]]


UNCOLLECTED = "import gc, runpy; gc.disable(); gc.enable = gc.disable; runpy.run_module('mypy', run_name='__main__')"
"""mypy without the collector of garbage, which takes a tenth of its time, and would spare half of 1.7 GB."""


def run(*command):
    done = subprocess.run([sys.executable, *command], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, f"\n{done.stdout}{done.stderr}"


def test_ruff_finds_nothing():
    paths = [".", *(str(path.relative_to(ROOT)) for path in python_scripts())]
    run("-m", "ruff", "check", "--no-cache", "--output-format", "concise", *paths)


def test_everything_is_formatted():
    paths = ["irbcal", "tests", "scripts", *(str(path.relative_to(ROOT)) for path in python_scripts())]
    run("-m", "ruff", "format", "--no-cache", "--check", *paths)


@pytest.mark.skipif(sys.version_info < (3, 11), reason="numpy for Python 3.10 describes its own types less exactly")
def test_types_are_complete_and_right():
    run("-c", UNCOLLECTED)


def test_the_hooks_run_the_same_tools():
    hooks = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())["repos"][0]["hooks"]
    assert [hook["entry"] for hook in hooks] == [
        ".venv/bin/ruff check",
        ".venv/bin/ruff format --check",
        ".venv/bin/mypy",
    ]


def test_nothing_calls_negative_with_rows_of_its_own_to_write_to():
    """numpy 2.4 with AVX-512 writes wrong numbers where what is read lies 64 bytes apart: multiply by -1 in its place."""
    calls = [path for path in sorted((ROOT / "irbcal").rglob("*.py")) if "np.negative(" in path.read_text("utf-8")]
    assert calls == []
