"""A wheel built from the checkout works without it."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """The wheel's content in a folder of its own, as pip would install it."""
    folder = tmp_path_factory.mktemp("wheel")
    command = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation", "-w", folder, ROOT]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    return folder / "site"


def test_it_holds_licence_types_and_metadata(installed):
    (info,) = installed.glob("*.dist-info")
    metadata = (info / "METADATA").read_text()
    assert "License-Expression: BSD-2-Clause" in metadata
    assert "Requires-Dist: yourdfpy" in metadata
    assert (info / "licenses" / "LICENSE").is_file()
    assert (installed / "irbcal" / "py.typed").is_file()
    assert (installed / "irbcal" / "__init__.pyi").is_file()
    assert not (installed / "tests").exists()


def test_it_calibrates_away_from_the_checkout(installed, tmp_path):
    run = {"cwd": tmp_path, "env": os.environ | {"PYTHONPATH": str(installed)}, "capture_output": True, "text": True}
    where = subprocess.run([sys.executable, "-c", "import irbcal; print(irbcal.__file__)"], **run)
    assert where.stdout.startswith(str(installed))
    done = subprocess.run([sys.executable, "-m", "irbcal", "demo", "--model", "11", "--out", "demo"], **run)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "demo" / "report.html").stat().st_size > 100_000
    page = subprocess.run([sys.executable, "-m", "irbcal", "view", "demo", "--html", "v.html"], **run)
    assert page.returncode == 0, page.stderr
