"""Every line of the README and of docs/ works as it is printed, in a folder that ``irbcal samples`` made.

So do the cells of the notebooks. Shell blocks stand without a language, ``python`` blocks are run in their order with
one namespace a page; anything else (``text``, ``yaml``, ``cpp``) is not run here.
"""

import functools
import glob
import os
import re
import shlex
import shutil
from pathlib import Path

import pytest
from typer.main import get_command
from typer.testing import CliRunner

import irbcal
from irbcal.cli.main import app
from irbcal.plotting import charts

ROOT = Path(__file__).parents[1]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("[!i]*.md"))
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCK = re.compile(r"^```([^\n]*)\n(.*?)^```[ \t]*$", re.DOTALL | re.MULTILINE)
CELL = re.compile(r"^```\{code-cell\}[^\n]*\n(.*?)^```", re.DOTALL | re.MULTILINE)

ELSEWHERE = {
    "irbcal fleet prior --type irb1600_6_145 --store fleet.db --out prior.json": "tests/fleet/test_prior.py",
    "irbcal calibrate new.csv --robot irb1600 --prior prior.json --out new": "tests/fleet/test_prior.py",
    "irbcal plan --robot my_robot.urdf --compare-devices --poses 30": "tests/planning/test_device_plan.py",
    "irbcal samples try-irbcal": "the folder that the lines are run in",
}
"""Lines that take long or are the beginning of all, and where they are run."""

EXAMPLES = {"calibration-auto": "tests/test_loads.py", "error-model": "tests/test_error_model.py"}
"""Pages whose ``python`` block is run together with what it is said to print, and where."""

LEVELS = {"programs": "placement", "robots": "placement", "tutorial": "34"}
"""Pages that are about something else than the model, and the one of their calibrations: the default, which takes longest,
is run for the front page and for those about models, loads, sessions and features."""

OTHERS = (
    "pip",
    "pipx",
    "source",
    "cd",
    "scripts/",
    "colcon",
    "ros2",
    "xacro",
    "gz",
    "check_urdf",
    "git",
    "sudo",
    "open",
    "export",
    "chromium",
)
"""What lines may begin with that are not of irbcal."""


def blocks(page, kind):
    return [text for found, text in BLOCK.findall(page.read_text(encoding="utf-8")) if found == kind]


def lines(page):
    """Commands of a page, without comments; a line that ends with a backslash goes on."""
    text = "\n".join(blocks(page, "")).replace("\\\n", " ")
    found = [re.sub(r"\s+#\s.*$", "", line).strip() for line in text.splitlines()]
    return [line for line in found if line and not line.startswith("#")]


@pytest.fixture(autouse=True)
def coarse_pictures(monkeypatch):
    """Nobody looks at them here."""
    monkeypatch.setattr(charts, "DPI", 20)


@pytest.fixture(scope="module")
def samples(fits_once, example_files, tmp_path_factory):
    """The samples, with my-robot calibrated as the front page says."""
    folder = shutil.copytree(example_files.folder, tmp_path_factory.mktemp("pages") / "samples")
    before = Path.cwd()
    os.chdir(folder)
    try:
        run("irbcal calibrate measured.csv --robot my_robot.urdf --out my-robot", Path())
    finally:
        os.chdir(before)
    return folder


def run(line, page):
    """Run a line; what a command before a ``|`` prints is what the next one reads."""
    printed = None
    for command in line.split(" | "):
        printed = run_one(command, page, printed)


def run_one(line, page, given):
    words = [word for part in shlex.split(line)[1:] for word in (sorted(glob.glob(part)) if "*" in part else [part])]
    if words[0] == "view" and "--html" not in words:
        words += ["--html", "served.html"]
    if words[0] == "calibrate" and page.stem in LEVELS:
        words += ["--model", LEVELS[page.stem]]
    done = CliRunner().invoke(app, words, input=given, prog_name="irbcal")
    if done.exception and not isinstance(done.exception, SystemExit):
        raise AssertionError(f"{page.name}: {line}: {done.exception}") from done.exception
    assert done.exit_code == 0, f"{page.name}: {line}\n{done.output}"
    return done.stdout


@pytest.mark.parametrize("page", [page for page in PAGES if lines(page)], ids=lambda page: page.stem)
def test_shell_lines(page, samples, tmp_path, monkeypatch):
    folder = tmp_path / "here"
    shutil.copytree(samples, folder)
    shutil.rmtree(
        folder / "my-robot" if page.name in ("README.md", "index.md") else folder / "nothing", ignore_errors=True
    )
    monkeypatch.chdir(folder)
    for line in lines(page):
        if line in ELSEWHERE:
            continue
        if line.startswith("irbcal "):
            run(line, page)
        else:
            assert line.startswith(OTHERS), f"{page.name}: nobody tries {line!r}"
            if line.startswith("scripts/"):
                assert (ROOT / shlex.split(line)[0]).exists(), line


@pytest.mark.parametrize("page", [page for page in PAGES if blocks(page, "python")], ids=lambda page: page.stem)
def test_python_blocks(page, samples, tmp_path, monkeypatch):
    if page.stem in EXAMPLES:
        assert len(blocks(page, "python")) == 1
        assert page.name in (ROOT / EXAMPLES[page.stem]).read_text(encoding="utf-8")
        return
    folder = tmp_path / "here"
    shutil.copytree(samples, folder)
    monkeypatch.chdir(folder)
    names = {}
    for text in blocks(page, "python"):
        exec(compile(text, str(page), "exec"), names)


@pytest.mark.parametrize("notebook", NOTEBOOKS, ids=lambda path: path.stem)
def test_notebook_cells_run(notebook, samples, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(irbcal, "samples", functools.partial(shutil.copytree, samples))
    cells = CELL.findall(notebook.read_text(encoding="utf-8"))
    assert len(cells) >= 3
    names = {}
    for cell in cells:
        exec(compile(cell, str(notebook), "exec"), names)


def test_every_command_is_told_and_every_option_exists():
    commands = get_command(app).commands
    within = [part for command in commands.values() for part in getattr(command, "commands", {}).values()]
    called_by = [p for command in (*commands.values(), *within) for p in command.params]
    known = {option for p in called_by for option in (*p.opts, *p.secondary_opts)}
    text = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    text = re.sub(r"`scripts/[^`]*`", "", text)  # these have options of their own
    text = re.sub(r"^.*(scripts/|chromium ).*$", "", text, flags=re.MULTILINE)
    named = set(re.findall(r"(?<![\w-])--[a-z][a-z0-9-]+", text))
    shell = "\n".join(line for page in PAGES for line in lines(page))
    word = "irbcal ([a-z][a-z0-9-]*)"
    called = {*re.findall(f"^{word}", shell, re.MULTILINE), *re.findall(f"`{word}", text)}
    assert named - known - OTHER_OPTIONS == set()
    assert called - set(commands) == set()
    assert {name for name, command in commands.items() if not command.hidden} - called == set(), "told nowhere"


OTHER_OPTIONS = {
    "--nthreads",
    "--install-completion",
    "--show-completion",
    "--version",
    "--help",
    "--check",
    "--ros-args",
    "--from",
    "--rm",
    "--no-deps",
    "--ntasks-per-node",
    "--hostfile",
    "--nanny",
    "--nworkers",
    "--wrap",
}
"""Of the program as a whole, of scripts, of ROS, of dask, SLURM, uv, Docker and pip."""


def test_the_readme_is_one_page():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").split()) <= 900


def test_links_lead_to_files():
    for page in PAGES:
        for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", page.read_text(encoding="utf-8")):
            if not re.match(r"[a-z]+:", target):
                assert (page.parent / target).exists(), f"{page.name}: {target}"


def test_files_that_they_name_exist():
    for page in PAGES:
        for path in re.findall(r"`((?:scripts|irbcal|tests)/[\w/.]+)`", page.read_text(encoding="utf-8")):
            assert (ROOT / path).exists(), f"{page.name}: {path}"
        for path in re.findall(r"`(\w+/[\w/]+\.py)`", page.read_text(encoding="utf-8")):
            assert (ROOT / path).exists() or (ROOT / "irbcal" / path).exists(), f"{page.name}: {path}"
