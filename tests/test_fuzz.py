"""Damaged inputs for every command, and writers that are killed: some of what ``scripts/fuzz`` does, with a fixed seed."""

import faulthandler
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path
from random import Random

import pytest
import typer.main
from typer.testing import CliRunner

from irbcal import safe_files
from irbcal.cli.main import app

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "scripts"))

from fuzzing import commands, corpus, kill, run  # noqa: E402

pytestmark = pytest.mark.skipif(not hasattr(os, "pidfd_open"), reason="needs Linux")

CASES = 32
WITHOUT = {"calibrate", "plan", "joints", "report", "simulate"}
"""Commands that compute for long: the script has them."""


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fuzz") / "good"
    corpus.write(folder)
    run.warm(folder)
    return folder


def test_damaged_inputs_are_refused_or_used_and_harm_nothing(good, tmp_path, monkeypatch):
    quick = [(maker, weight) for maker, weight in commands.MAKERS if maker.__name__.strip("_") not in WITHOUT]
    monkeypatch.setattr(commands, "MAKERS", quick)
    counts, bad = run.cases(range(CASES), 14, good, tmp_path / "w" / "case")
    assert bad == [], "\n".join(map(str, bad))
    kinds = Counter(name.split(" ", 1)[1] for name in counts.elements())
    assert kinds["refused"] > CASES / 3
    assert kinds["done"] > CASES / 20


def test_a_program_without_targets_has_no_mean_error(good, tmp_path):
    """Found by it: a calibration that knows last moves, and nothing to correct."""
    (tmp_path / "job.script").write_text("def job():\n  # a comment\n  global W_0_p=p[.9,.05,.7,0,3.1,1_000]\n")
    words = ["filter", good / "cal-auto", tmp_path / "job.script", "--out", tmp_path / "out.script", "--json"]
    done = CliRunner().invoke(app, [*map(str, words)])
    assert done.exit_code == 1
    assert json.loads(done.stdout)["expected_with_last_moves_mm"] is None


def judged(tmp_path, monkeypatch, work):
    """The verdict on a command that does something of its own."""
    (tmp_path / "good").mkdir(exist_ok=True)
    monkeypatch.setattr(commands, "made", lambda random, good, folder: made(folder))
    monkeypatch.setattr(run, "_command", lambda words: work())

    def made(folder):
        (folder / "in.csv").write_text("a,b\n1,2\n")
        return ["fk", "in.csv"]

    return run.case(0, 0, tmp_path / "good", tmp_path / "w" / "case").kind


def test_the_judge_sees_what_must_not_be(tmp_path, monkeypatch):
    def refusal(code, text="irbcal: no"):
        print(text, file=sys.stderr)
        return code

    def eats():
        return len(bytearray(3 << 30))

    def crash():
        faulthandler.disable()  # its report would stand among pytest's lines
        os.kill(os.getpid(), signal.SIGSEGV)

    monkeypatch.setattr(run, "WALL_SECONDS", 3)
    for expected, work in (
        ("done", lambda: 0),
        ("refused", lambda: refusal(1)),
        ("usage", lambda: 2),
        ("traceback", lambda: 1 / 0),
        ("memory", eats),
        ("hang", lambda: time.sleep(60)),
        ("signal 11", crash),
        ("changed a file", lambda: Path("in.csv").write_text("") and 0),
        ("half a file", lambda: Path(".irbcal-0").write_text("") and 0),
        ("half a file (exit 1, wrote out.csv)", lambda: Path("out.csv").write_text("1") and refusal(1)),
        ("refusal that is not one sentence", lambda: refusal(1, "irbcal: a\nb")),
        ("non-finite number in out.csv, column x_mm", lambda: Path("out.csv").write_text("x_mm\nnan\n") and 0),
    ):
        assert judged(tmp_path, monkeypatch, work).split(":")[0].startswith(expected), expected


@pytest.fixture
def quick_disk():
    """A folder in memory, where there is one: what is synced there takes no time."""
    memory = "/dev/shm" if os.access("/dev/shm", os.W_OK) else None
    with tempfile.TemporaryDirectory(dir=memory) as folder:
        yield Path(folder)


@pytest.mark.parametrize(
    ("name", "calls"), [("import", range(1, 100, 6)), ("filter", range(1, 100, 16)), ("reseal", range(1, 100, 8))]
)
def test_a_command_that_is_cut_off_leaves_the_old_result_or_the_new_one(name, calls, good, quick_disk):
    """Killed, or failed by its disk, at calls that change files; the script does it for every writer and every call."""
    writer = next(writer for writer in kill.WRITERS if writer.name == name)
    damaged, events, (old, new) = kill.killed(writer, good, quick_disk / name, 3, Random(0), calls)
    assert damaged == []
    assert events > 8
    assert old > 0
    assert new > 0


def test_a_half_written_set_is_seen(good, quick_disk, monkeypatch):
    """The same with a writer that writes one file after the other."""

    def careless(targets, contents, folders):
        for path, name in targets.items():
            with atomic_open(path, "wb") as stream:
                stream.write(contents[name])
            os.chmod(path, 0o600)

    monkeypatch.setattr(safe_files, "_write", careless)
    writer = next(writer for writer in kill.WRITERS if writer.name == "filter")
    damaged, _, _ = kill.killed(writer, good, quick_disk / "filter", 0, Random(0), range(1, 9))
    assert any("mixed" in line or "said to be done" in line for line in damaged)


def atomic_open(path, mode):
    """The function by which irbcal opens what it writes, which fails when the disk does."""
    return vars(safe_files).get("open", open)(path, mode)


BEGIN = """
import signal
from irbcal import __main__
real = signal.signal
signal.signal = lambda *words: (real(*words), print("begun", flush=True))
__main__.start()
"""


def test_ctrl_c_ends_quietly_from_the_first_moment():
    """Interrupted at several moments while the program is loaded: exit code 130 or done, and no traceback."""
    seen = set()
    for wait in (0, 0.05, 0.15, 0.35):
        process = subprocess.Popen(
            [sys.executable, "-c", BEGIN, "robots"],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        process.stdout.readline()
        time.sleep(wait)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=60)
        seen.add(process.returncode)
        assert process.returncode in (130, 0, -signal.SIGINT), (wait, err)
        assert "Traceback" not in err
    assert seen & {130, -signal.SIGINT}


def test_the_fuzzer_knows_every_command():
    """Also those behind a group, such as ``fleet list``."""
    random, groups = Random(0), typer.main.get_command(app).commands
    words = [maker(random) for maker, _ in commands.MAKERS for _ in range(60)]
    for name, command in groups.items():
        for below in getattr(command, "commands", {None: None}):
            assert any(line[0] == name and below in (None, *line[1:2]) for line in words), (name, below)
