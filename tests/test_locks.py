"""The locked files are those of the pins: scripts/lock was run after every change of what irbcal needs."""

import json
import re
import runpy
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

tomllib = pytest.importorskip("tomllib")  # Python 3.11
ROOT = Path(__file__).parents[1]
HASH = re.compile(r"--hash=sha256:[0-9a-f]{64}")


def name_of(requirement):
    return re.match(r"[A-Za-z0-9._-]+", requirement)[0].lower().replace("_", "-").replace(".", "-")


def pins(lines):
    """Names and versions; entries without an exact version are left out."""
    exact = [line for line in lines if "==" in line.partition(";")[0]]
    return {(name_of(line), re.match(r"[^=]+==([^\s;]+)", line)[1]) for line in exact}


def locked(name):
    """Requirements of a lock, each with its lines of hashes."""
    text = (ROOT / "scripts" / "locks" / f"{name}.txt").read_text()
    return [part.replace("\\\n", " ") for part in re.split(r"\n(?=\S)", text.strip())]


@pytest.mark.parametrize("name", ["demo", "app", "test"])
def test_each_locked_file_has_its_hash_and_the_version_of_the_constraints(name):
    constraints = pins((ROOT / "scripts" / "constraints.txt").read_text().splitlines())
    entries = locked(name)
    assert [entry for entry in entries if not HASH.search(entry)] == []
    assert pins(entries) <= constraints
    assert "://" not in "".join(entries)


@pytest.mark.parametrize("name", ["demo", "app", "test"])
def test_all_that_the_project_names_is_locked(name):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    wanted = set(map(name_of, project["dependencies"])) | {"pip", "hatchling", "editables"}
    if name != "demo":
        of = [name]
        for extra in of:
            for line in extras[extra]:
                more = re.match(r"irbcal\[(.*)\]", line)
                of.extend(more[1].split(",") if more else [])
                wanted |= set() if more else {name_of(line)}
    assert wanted <= {name for name, _ in pins(locked(name))}


def test_each_lock_has_what_those_before_it_have():
    """So what was set up for the tests serves the app, and what was for the app the demo."""
    parts = [pins(locked(name)) for name in runpy.run_path(str(ROOT / "scripts" / "_setup.py"))["LOCKS"]]
    assert len(parts) == 3
    assert parts[0] < parts[1] < parts[2]


def test_the_bill_of_materials_has_what_is_installed():
    """Every part with its version, all that it needs among them, hashes of those that are locked."""
    done = subprocess.run([sys.executable, ROOT / "scripts" / "sbom"], capture_output=True, text=True, check=True)
    bill = json.loads(done.stdout)
    parts = {part["name"]: part for part in bill["components"]}
    assert all(part["version"] == version(name) for name, part in parts.items())
    assert {"numpy", "pandas", "pin", "scipy"} <= set(parts)
    assert not {"pytest", "mypy"} & set(parts)
    refs = {part["bom-ref"] for part in (*parts.values(), bill["metadata"]["component"])}
    assert {ref for row in bill["dependencies"] for ref in (row["ref"], *row["dependsOn"])} == refs
    for name, value in pins(locked("demo")):
        if name in parts and parts[name]["version"] == value:
            assert parts[name]["hashes"]
