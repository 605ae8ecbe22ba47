"""The oldest versions that pyproject.toml allows, as scripts/lowest tries them: demonstration, import and fit.

In Python 3.10 where pyenv has one, else in that of the tests.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PATH = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])


@pytest.mark.skipif(shutil.which("uv", path=PATH) is None, reason="uv is not installed")
def test_the_oldest_neighbours_do():
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"} | {"PATH": PATH}
    oldest = sorted(Path.home().glob(".pyenv/versions/3.10.*/bin/python"))
    command = ["bash", ROOT / "scripts" / "lowest", *oldest[:1], *([] if oldest else [sys.executable])]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment, timeout=900)
    if done.returncode and "Failed to fetch" in done.stderr:
        pytest.skip("no packages can be fetched here")
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    assert "passed" in done.stdout
