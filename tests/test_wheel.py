"""Wheels built from the checkout, with and without a compiler, work without it."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
NO_COMPILER = "/nonexistent/c++"


@pytest.fixture(scope="module", params=[None, NO_COMPILER])
def installed(request, tmp_path_factory):
    """The content of a wheel in a folder of its own, as pip would install it, and the wheel's name.

    With a compiler it is made from the source archive.
    """
    if request.param is None and shutil.which("c++") is None:
        pytest.skip("no compiler is installed")
    folder = tmp_path_factory.mktemp("wheel")
    source, leave = folder / "source", shutil.ignore_patterns("compiled.*", "__pycache__", "*.pyc")
    for name in ("irbcal", "urdf"):
        shutil.copytree(ROOT / name, source / name, ignore=leave)
    for name in ("pyproject.toml", "hatch_build.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source / name)
    if request.param is None:
        command = [sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", folder / "sdist"]
        subprocess.run(command, cwd=ROOT, capture_output=True, check=True)
        (source,) = (folder / "sdist").glob("*.tar.gz")
    command = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation", "-w", folder, source]
    environment = os.environ | ({"CXXFLAGS": "-O0"} if request.param is None else {"CXX": request.param})
    done = subprocess.run(command, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    (wheel,) = folder.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(folder / "site")
    return folder / "site", wheel.name, request.param is None


def test_it_holds_licence_types_and_metadata(installed):
    site, name, compiled = installed
    (info,) = site.glob("*.dist-info")
    metadata = (info / "METADATA").read_text()
    assert "License-Expression: BSD-2-Clause" in metadata
    assert "Requires-Dist: yourdfpy" in metadata
    assert (info / "licenses" / "LICENSE").is_file()
    assert (site / "irbcal" / "py.typed").is_file()
    assert (site / "irbcal" / "__init__.pyi").is_file()
    assert not (site / "tests").exists()
    assert ("any" in name) is not compiled
    assert ("abi3" in name) is (compiled and sys.version_info >= (3, 11))


def test_it_works_away_from_the_checkout(installed, tmp_path):
    """As in a container: no compiler or other program, no home, no settings, no locale, one folder to write to."""
    site, _, compiled = installed

    def run(*words):
        paths = os.pathsep.join([str(site), *(path for path in sys.path if path.endswith("site-packages"))])
        environment = {"PYTHONPATH": paths, "PATH": "/nowhere", "HOME": "/nowhere", "TMPDIR": str(tmp_path)}
        done = subprocess.run([sys.executable, *words], cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout

    assert run("-c", "import irbcal; print(irbcal.__file__)").startswith(str(site))
    state = run("-m", "irbcal", "--version", "--verbose").splitlines()[1]
    assert state.startswith("kernel: compiled" if compiled else "kernel: numpy: no C++17 compiler was found")
    if not compiled:
        (tmp_path / "q.csv").write_text("q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n10,20,-30,40,50,60\n")
        run("-m", "irbcal", "fk", "irb1600", "--joints", "q.csv")
    else:
        run("-m", "irbcal", "demo", "--model", "11", "--out", "demo")
        assert (tmp_path / "demo" / "report.html").stat().st_size > 100_000
        run("-m", "irbcal", "view", "demo", "--html", "v.html")
