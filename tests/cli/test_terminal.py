"""Output as it is seen: in a terminal of 80 columns, by a pipe whose reader goes, by a shell that completes words."""

import os
import pty
import re
import select
import struct
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest
from rich.cells import cell_len
from support import started
from typer.main import get_command
from typer.testing import CliRunner

import irbcal
from irbcal.cli import calibrate
from irbcal.cli.main import app
from irbcal.io import robots

PROGRAM = [sys.executable, "-m", "irbcal"]
COLUMNS = 80
GREEN, RED = "\x1b[1;32m", "\x1b[1;31m"
CODES = re.compile(r"\x1b\[[0-9;?]*[a-zA-Z]")


def environment(**more):
    """That of a user at a terminal, whatever the tests run in."""
    kept = {name: value for name, value in os.environ.items() if name not in ("NO_COLOR", "FORCE_COLOR", "COLUMNS")}
    return kept | {"TERM": "xterm-256color", **more}


def seen(*arguments):
    """What a command shows in a terminal of 80 columns, with its codes of colours; progress is not shown."""
    import fcntl
    import termios

    ours, its = pty.openpty()
    fcntl.ioctl(its, termios.TIOCSWINSZ, struct.pack("HHHH", 40, COLUMNS, 0, 0))
    command = [*PROGRAM, *map(str, arguments)]
    done = subprocess.Popen(command, stdin=its, stdout=its, stderr=subprocess.DEVNULL, env=environment())
    os.close(its)
    parts = []
    while True:
        assert select.select([ours], [], [], 120)[0], "it shows nothing and does not end"
        try:
            parts.append(os.read(ours, 1 << 16))
        except OSError:  # how Linux tells the end
            break
        if not parts[-1]:
            break
    os.close(ours)
    assert done.wait(30) in (0, 3)
    return b"".join(parts).decode().replace("\r\n", "\n")


def lines(shown):
    """The lines of what was shown, without codes."""
    return CODES.sub("", shown).splitlines()


def sentences(text):
    """A text with single spaces."""
    return " ".join(text.split())


@pytest.fixture
def verification(tmp_path):
    """Some of the demonstration's other measurements, with a lost point."""
    table = robots.demo_file("demo_verification.csv").read_text().splitlines()
    (tmp_path / "verification.csv").write_text("\n".join(table[:80]) + "\n")
    return tmp_path / "verification.csv"


def test_a_terminal_of_80_columns_breaks_no_word(demo_calibration, verification, program):
    line = ["evaluate", demo_calibration, verification, "--tolerance", 5, "--region-only"]
    shown, piped = seen(*line), program(*line)
    assert max(map(cell_len, lines(shown))) <= COLUMNS
    assert max(map(len, piped.splitlines())) > COLUMNS, "elsewhere a sentence is one line"
    assert sentences("\n".join(lines(shown))) == sentences(piped)
    assert f"{GREEN}Tolerance: PASS" in shown
    assert f"{GREEN}Verdict: Better" in shown
    assert "\x1b" not in piped


def test_a_verdict_is_red_where_it_is_bad_and_has_no_colour_where_none_is_wanted(demo_calibration, verification):
    line = ["evaluate", str(demo_calibration), str(verification), "--tolerance", "0.001"]
    terminal = {"FORCE_COLOR": "1", "TERM": "xterm-256color", "COLUMNS": "80"}
    assert f"{RED}Tolerance: FAIL" in CliRunner(env={**terminal, "NO_COLOR": None}).invoke(app, line).output
    plain = CliRunner(env={**terminal, "NO_COLOR": "1"}).invoke(app, line).output
    assert "Tolerance: FAIL" in plain
    assert RED not in plain
    assert GREEN not in plain


@pytest.mark.parametrize("name", sorted(get_command(app).commands))
def test_help_fits_80_columns_and_breaks_no_word(name):
    command = get_command(app).commands[name]
    narrow = CliRunner(env={"COLUMNS": "80", "TERMINAL_WIDTH": "80", "NO_COLOR": "1"})
    shown = narrow.invoke(app, [name, "--help" if hasattr(command, "commands") else "--help-all"])
    assert shown.exit_code == 0
    text = shown.output
    assert max(map(cell_len, text.splitlines())) <= COLUMNS
    prose = [line.rstrip() for line in text.split("╭")[0].splitlines()]
    for line, following in pairwise(prose):  # a line ends where the next word would not fit
        ends = not line or not following or following.startswith(" irbcal")
        assert ends or len(line + following.split()[0]) >= COLUMNS - 2, line
    words = set(re.split(r"[\s│<>|,;:.()\[\]]+", text))
    for param in command.params:
        kind = getattr(param, "type_descriptor", None)
        if kind is not None and kind.is_choice:
            assert {str(getattr(choice, "value", choice)) for choice in kind.choices} <= words, param.name


def test_the_reader_of_a_pipe_may_go(demo_calibration, verification, tmp_path):
    rows = ",".join(f"q{k}_deg" for k in range(1, 7)) + "\n" + "10,-10,20,15,40,-30\n" * 4000
    (tmp_path / "q.csv").write_text(rows)
    for code, arguments in (
        (0, ("fk", "irb1600", "--joints", tmp_path / "q.csv")),
        (0, ("calibrate", "--help")),
        (3, ("evaluate", demo_calibration, verification, "--tolerance", "0.001")),
    ):
        out, into = os.pipe()
        done = subprocess.Popen(
            [*PROGRAM, *map(str, arguments)], stdout=into, stderr=subprocess.PIPE, env=environment()
        )
        os.close(into)
        os.close(out)  # nobody reads, from the first byte on
        errors = done.communicate(timeout=120)[1]
        assert (done.returncode, errors) == (code, b""), arguments


def test_standard_input(demo_calibration):
    q = "name,q1_deg,q2_deg,q3_deg,q4_deg,q5_deg,q6_deg\n001,10,-10,20,15,40,-30\n"
    found = CliRunner().invoke(app, ["fk", str(demo_calibration), "--joints", "-"], input=q).stdout
    assert found.splitlines()[0].startswith("name,q1_deg,")
    back = CliRunner().invoke(app, ["ik", str(demo_calibration), "--poses", "-"], input=found).stdout
    head, row = (line.split(",") for line in back.splitlines())
    cells = dict(zip(head, row, strict=True))
    assert cells["name"] == "001"
    assert cells["given_q4_deg"] == "15"
    assert float(cells["q4_deg"]) == pytest.approx(15, abs=1e-5)
    refused = CliRunner().invoke(app, ["fk", "irb1600", "--joints", "-"], input=q.replace("15", "x"))
    assert str(refused.exception) == "-: row 2, column q4_deg: expected a joint angle in degrees, found 'x'"


def complete(*words):
    """What bash is offered after these words."""
    line = " ".join(words)
    more = {"COMP_WORDS": line, "COMP_CWORD": str(len(words) - 1), "_IRBCAL_COMPLETE": "complete_bash"}
    return started(**more).stdout.split()


def test_completion():
    for shell, word in (
        ("bash", "complete -o default"),
        ("zsh", "#compdef irbcal"),
        ("fish", "complete --command irbcal"),
    ):
        done = CliRunner().invoke(app, ["--show-completion", shell], prog_name="irbcal")
        assert (done.exit_code, word in done.stdout) == (0, True), done.output
    assert CliRunner().invoke(app, ["--show-completion", "sh"]).exit_code == 2
    assert complete("irbcal", "eval") == ["evaluate"]
    assert "auto" in complete("irbcal", "calibrate", "--model", "")
    assert complete("irbcal", "evaluate", "--rule", "per") == ["percentile"]
    assert complete("irbcal", "calibrate", "--ver") == ["--verify", "--verbose"]
    assert complete("irbcal", "calibrate", "mea") == [], "bash completes files where nothing is offered"


def test_completion_is_installed(tmp_path):
    done = started("--install-completion", "bash", HOME=str(tmp_path))
    assert done.returncode == 0, done.stderr
    assert "_IRBCAL_COMPLETE=complete_bash" in (tmp_path / ".bash_completions" / "irbcal.sh").read_text()
    assert "irbcal.sh" in (tmp_path / ".bashrc").read_text()


def test_a_plain_calibration_prints_15_lines_and_all_on_request(demo_calibration, tmp_path, program):
    line = ["calibrate", robots.demo_file("demo_identification.csv"), "--robot", "irb1600", "--model", "34"]
    short = program(*line, "--out", tmp_path / "a")
    saved = irbcal.load(tmp_path / "a")
    assert len(saved.record.undetermined) == saved.record.parameter_count - saved.record.rank > 1
    assert len(short.splitlines()) <= 15
    assert "held: " not in short
    long = program(*line, "--out", tmp_path / "b", "--verbose")
    for sentence in saved.record.undetermined:
        assert f"  held: {sentence}\n" in long
    told = program(*line, "--out", tmp_path / "c", "--json")
    assert told["parameters"] - told["rank"] == len(told["undetermined"])
    assert f"{told['rank']} independent" in short
    page = sentences(re.sub(r"<[^>]+>", " ", (tmp_path / "a" / "report.html").read_text()))
    assert f"{told['rank']} independent" in page


def test_points_left_out_are_listed_on_request(demo_calibration, tmp_path, program):
    rows = robots.demo_file("demo_verification.csv").read_text().splitlines()[:80]
    place = rows[0].split(",").index("x_mm")
    for k in range(1, 40, 3):
        cells = rows[k].split(",")
        cells[place : place + 3] = ["", "", ""]
        rows[k] = ",".join(cells)
    (tmp_path / "lost.csv").write_text("\n".join(rows) + "\n")
    assert re.search(r" … and \d+ more\)", program("evaluate", demo_calibration, tmp_path / "lost.csv"))
    assert " more)" not in program("evaluate", demo_calibration, tmp_path / "lost.csv", "--verbose")


def test_a_demonstration_replaces_a_demonstration_only(monkeypatch, tmp_path, demo_calibration):
    monkeypatch.chdir(tmp_path)
    few = tmp_path / "demo_verification.csv"
    few.write_text("".join(robots.demo_file(few.name).read_text().splitlines(True)[:80]))
    shipped = robots.demo_file
    monkeypatch.setattr(robots, "demo_file", lambda name: few if name == few.name else shipped(name))
    line = ["demo", "--model", "11"]
    assert CliRunner().invoke(app, line).exit_code == 0
    assert CliRunner().invoke(app, line).exit_code == 0
    mine = irbcal.load(calibrate.OWN)
    table = robots.demo_file(calibrate.MEASURED).read_bytes()
    Path("mine.csv").write_bytes(table)
    irbcal.calibrate("mine.csv", "irb1600", "16").save(calibrate.OWN, overwrite=True)
    done = CliRunner().invoke(app, line)
    assert done.exit_code == 1
    assert "in this folder already" in str(done.exception)
    assert irbcal.load(calibrate.OWN).record.model == "16" != mine.record.model
    (calibrate.OWN / "calibration.json").write_text("{}")
    assert CliRunner().invoke(app, line).exit_code == 1, "what cannot be read may be anything"
