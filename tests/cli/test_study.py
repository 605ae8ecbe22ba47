"""``irbcal study`` as a user meets it: a folder that is filled, goes on where it was stopped, and refuses strangers."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time

import pandas as pd
import pytest
from typer.testing import CliRunner

from irbcal.cli import main
from irbcal.errors import IrbcalError
from irbcal.studies import folder as study_folder
from irbcal.studies import runner
from irbcal.studies.settings import Settings
from irbcal.studies.stage import Stage

CALL = ("--procedures", "80,120", "--each", 1, "--points", 520, "--poses-curve", "none", "--method", "least-squares")
TABLES = ("--only", "7.1", "--only", "7.13")


def run(*arguments):
    """Run the command in this process; returns what it printed on stdout."""
    done = CliRunner(env={"COLUMNS": "160"}).invoke(main.app, ["study", *map(str, arguments)], catch_exceptions=False)
    assert done.exit_code == 0, done.output
    return done.stdout


def refused(*arguments):
    """The sentence of a refusal."""
    with pytest.raises(IrbcalError) as caught:
        CliRunner().invoke(main.app, ["study", *map(str, arguments)], catch_exceptions=False)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def contents(folder):
    """All files of a folder as bytes, but those under names with a dot in front."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A study of three calibrations, each run alone and without any process of its own."""
    folder = tmp_path_factory.mktemp("study") / "new" / "out"
    settings = Settings((80, 120), 1, (), "34", "least-squares", 520, 0)
    study_folder.open_folder(settings, folder)
    stage = Stage.of(settings)
    for repetition in runner.selected(settings, ["7.1", "7.13"]):
        rows, series = runner.finished(stage, repetition)
        (folder / "parts").mkdir(exist_ok=True)
        (folder / "parts" / f"{repetition.name}.csv").write_bytes(rows)
        (folder / "parts" / f"{repetition.name}.npz").write_bytes(series)
    study_folder.write(settings, folder)
    return folder


def test_a_study_fills_its_folder(finished):
    before = contents(finished)
    printed = json.loads(run("--out", finished, *CALL, *TABLES, "--json"))
    assert contents(finished) == before
    names = ["34-120-1", "34-80-1", "nominal"]
    files = [f"parts/{name}.{ending}" for name in names for ending in ("csv", "npz")]
    assert sorted(before) == sorted([*files, "page.html", "results.csv", "settings.json", "tables.md"])
    frame = pd.read_csv(finished / "results.csv", dtype={"model": str})
    assert list(frame["repetition"].unique()) == ["nominal", "34-80-1", "34-120-1"]
    assert (printed["done"], printed["kept"], printed["simulated"]) == (0, 3, True)
    assert list(printed["tables"]) == ["7.1", "7.13"]
    first = printed["tables"]["7.1"]["rows"][0]
    row = frame[(frame["kind"] == "expected") & (frame["targets"] == "1-8")].iloc[0]
    assert first[:3] == ["ISO cube", "3 kg", {"value": row["mean"], "thesis": 1.004}]
    assert printed["settings"]["procedures"] == [80, 120]
    assert json.loads(before["settings.json"])["simulated"] is True
    assert "SIMULATED" in before["tables.md"].decode().splitlines()[0]


def test_an_interrupted_study_goes_on_and_ends_in_the_same_bytes_with_any_number_of_processes(finished, tmp_path):
    """Ctrl-C at a program of its own with two processes, the rest with one, against each calibration run alone."""
    out = tmp_path / "out"
    call = ["study", "--out", out, *CALL, *TABLES]
    command = [sys.executable, "-m", "irbcal", *map(str, call), "--jobs", "2"]
    pipe = subprocess.PIPE
    process = subprocess.Popen(command, stderr=pipe, stdout=pipe, text=True, start_new_session=True)
    deadline = time.monotonic() + 60
    while not list((out / "parts").glob("*.csv")):
        assert time.monotonic() < deadline
        time.sleep(0.002)
    os.killpg(process.pid, signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    left = 3 - len(list((out / "parts").glob("*.csv")))
    assert "Traceback" not in errors
    if process.returncode != 0:  # else it was done before the signal came
        assert process.returncode == 130
        assert errors.strip() == f"irbcal: interrupted with {left} calibrations to do: the same call goes on from there"
        assert not (out / "page.html").exists()
    if not left:  # or too quick to leave anything
        (out / "parts" / "34-80-1.csv").unlink()
        left = 1
    text = run(*call[1:], "--jobs", 1)
    assert f"{left} calibrations done, {3 - left} found finished" in text
    assert "SIMULATED (in brackets: the thesis, a real robot). Table 7.1." in text
    assert "worst of the 80-measurement procedures" in text
    assert contents(out) == contents(finished)


def test_other_settings_and_strangers_in_the_folder_are_refused(finished, tmp_path, monkeypatch):
    before = contents(finished)
    sentence = refused("--out", finished, *CALL, "--seed", 7)
    assert sentence.endswith("settings.json: this folder holds a study with seed 0, not 7: choose another folder")
    assert "method least-squares, not max" in refused("--out", finished, *CALL[:-1], "max")
    assert "procedures 80,120, not 80" in refused("--out", finished, "--procedures", 80, *CALL[2:])
    monkeypatch.setattr(study_folder, "_cell_digest", lambda settings: "another")
    assert "a study with another version of the virtual cell" in refused("--out", finished, *CALL)
    monkeypatch.undo()
    assert contents(finished) == before
    (tmp_path / "results.csv").write_text("mine\n")
    assert "results without settings.json" in refused("--out", tmp_path, *CALL)
    (tmp_path / "settings.json").write_text('{"colour": "red"}')
    assert "not the settings of a study" in refused("--out", tmp_path, *CALL)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["results.csv", "settings.json"]
    assert (tmp_path / "results.csv").read_text() == "mine\n"


@pytest.mark.parametrize("damage", ["repetition,model\n", "", "other"])
def test_damaged_parts_are_refused_by_name(finished, tmp_path, damage):
    out = tmp_path / "copy"
    shutil.copytree(finished, out)
    path = out / "parts" / "nominal.csv"
    path.write_text((out / "parts" / "34-80-1.csv").read_text() if damage == "other" else damage)
    sentence = refused("--out", out, *CALL, *TABLES)
    assert sentence.startswith(str(path))
    assert ("expected the rows of nominal" if damage == "other" else "delete it") in sentence
    assert contents(out)["page.html"] == contents(finished)["page.html"]


def test_refusals_and_wrong_calls(tmp_path):
    out = ("--out", tmp_path / "out")
    assert "unknown table '7.17': tables are 7.1, 7.2" in refused(*out, *CALL, "--only", "7.17")
    assert "1000 identification measurements: expected 20 to 390" in refused(*out, "--points", 520)
    assert "expected 520 to 100000 verification points, found 8" in refused(*out, "--points", 8)
    assert not (tmp_path / "out").exists()
    for arguments, text in (
        ((), "--out"),
        ((*out, "--procedures", "80;90"), "--procedures"),
        ((*out, "--model", "12"), "12"),
    ):
        done = CliRunner(env={"COLUMNS": "200", "NO_COLOR": "1", "TERM": "dumb"}).invoke(
            main.app, ["study", *map(str, arguments)]
        )
        assert done.exit_code == 2
        assert text in done.output
