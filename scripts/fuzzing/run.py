"""One case: a call with damaged inputs in a fork of a process that has everything imported, and a verdict on it."""

from __future__ import annotations

import csv
import hashlib
import io
import json
import os
import re
import resource
import select
import shutil
import signal
import stat
import sys
import traceback
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from random import Random

from fuzzing import commands, corpus

CPU_SECONDS, WALL_SECONDS = 20, 120
"""A case that computes for longer, or waits for longer, hangs; the second is long because machines are shared."""
MEMORY = 2 << 30
"""Bytes beyond those that the process has at its start."""
GOOD = ("done", "refused", "usage")
TRACEBACK, UNREADABLE = 70, 71
NOT_A_PASS = 3
"""Exit code of a certificate that is written and says no."""


@dataclass(frozen=True)
class Verdict:
    """What became of a case."""

    case: str
    kind: str
    words: tuple[str, ...]
    said: str

    @property
    def good(self) -> bool:
        """Whether it may be so."""
        return self.kind in GOOD

    @property
    def signature(self) -> str:
        """What is alike in cases of one fault."""
        lines = [line.strip() for line in self.said.splitlines() if line.strip()]
        places = [
            line for line in lines if line.startswith("File ") and "/irbcal/" in line and "/cli/main.py" not in line
        ]
        if self.kind == "traceback" and places:
            file, line = re.findall(r'/irbcal/([^"]+)", line (\d+)', places[-1])[-1]
            return f"traceback {file}:{line} {lines[-1][:110]}"
        return f"{self.kind}: {self.words[0] if self.words else ''}"

    def __str__(self) -> str:
        line = " ".join(repr(word)[:80] if not word.isprintable() or len(word) > 80 else word for word in self.words)
        return f"{self.case}: {self.kind}: irbcal {line}\n{self.said}"


def warm(good: Path) -> None:
    """Import what commands import when they run, so that a fork costs milliseconds."""
    import importlib
    import pkgutil

    import coal
    import jinja2
    import lxml.etree
    import matplotlib.backends.backend_agg
    import matplotlib.backends.backend_svg
    import meshcat
    import pinocchio
    import rich.console
    import trimesh
    import yaml
    import yourdfpy

    import irbcal

    del coal, jinja2, lxml, matplotlib, meshcat, pinocchio, rich, trimesh, yaml, yourdfpy
    for module in pkgutil.walk_packages(irbcal.__path__, "irbcal."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    for name in corpus.endings():
        corpus.words(name)


def case(number: int, seed: int, good: Path, folder: Path, keep: bool = False) -> Verdict:
    """Run one case, which a seed and a number fix."""
    name = f"{seed}:{number}"
    random = Random(name)
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    words = commands.made(random, good, folder)
    before = _hashes(folder)
    code, out, err, spent = _forked(words, folder)
    verdict = _judged(words, code, out, err, before, folder)
    if spent and verdict in GOOD:
        verdict = "hang"
    if not keep:
        shutil.rmtree(folder, ignore_errors=True)
    return Verdict(name, verdict, tuple(words), (err[-3000:] or out[-800:]))


def cases(numbers: Iterable[int], seed: int, good: Path, folder: Path, say=None) -> tuple[Counter[str], list[Verdict]]:  # type: ignore[no-untyped-def]
    """Run cases; how many there are of each kind, by command, and those that must not be."""
    counts: Counter[str] = Counter()
    bad = []
    for number in numbers:
        verdict = case(number, seed, good, folder)
        counts[f"{verdict.words[0] if verdict.words else ''} {verdict.kind}"] += 1
        if not verdict.good:
            bad.append(verdict)
        if say is not None:
            say(verdict)
    return counts, bad


def _hashes(folder: Path) -> dict[str, str]:
    """Every file and what is in it; what is no file by its kind."""
    found = {}
    for path in sorted(folder.rglob("*")):
        mode = path.lstat().st_mode
        regular = stat.S_ISREG(mode)
        content = hashlib.sha256(path.read_bytes()).hexdigest() if regular else str(stat.S_IFMT(mode))
        found[str(path.relative_to(folder))] = content
    return found


def _forked(words: list[str], folder: Path) -> tuple[int, str, str, bool]:
    """Exit code (minus the signal), what was printed on both streams, and whether time was over."""
    logs = folder.parent / f"{folder.name}.out", folder.parent / f"{folder.name}.err"
    child = os.fork()
    if child == 0:
        _child(words, folder, logs)
    handle = os.pidfd_open(child)
    done, _, _ = select.select([handle], [], [], WALL_SECONDS)
    os.close(handle)
    if not done:
        os.kill(child, signal.SIGKILL)
    status = os.waitpid(child, 0)[1]
    code = os.waitstatus_to_exitcode(status)
    out, err = (path.read_bytes().decode("utf-8", "replace") for path in logs)
    return code, out, err, not done or code == -signal.SIGXCPU


def _child(words: list[str], folder: Path, logs: tuple[Path, Path]) -> None:
    """The command, in the fork; never returns."""
    code = TRACEBACK
    try:
        os.chdir(folder)
        os.setsid()
        for number, log in enumerate(logs, 1):
            os.dup2(os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
        given = next((word[1:] for word in words if word.startswith("<")), os.devnull)
        os.dup2(os.open(given if os.path.isfile(given) else os.devnull, os.O_RDONLY), 0)
        have = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (have + MEMORY, have + MEMORY))
        used = resource.getrusage(resource.RUSAGE_SELF)
        limit = int(used.ru_utime + used.ru_stime) + CPU_SECONDS
        resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 2))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        sys.stdout = io.TextIOWrapper(os.fdopen(1, "wb", closefd=False), encoding="utf-8", errors="surrogateescape")
        sys.stderr = io.TextIOWrapper(os.fdopen(2, "wb", closefd=False), encoding="utf-8", errors="backslashreplace")
        sys.stdin = io.TextIOWrapper(os.fdopen(0, "rb", closefd=False), encoding="utf-8", errors="surrogateescape")
        os.environ.update(COLUMNS="200", NO_COLOR="1")
        code = _command(words)
    except BaseException:
        traceback.print_exc()
    finally:
        for stream in (sys.stdout, sys.stderr):
            try:
                stream.flush()
            except (OSError, ValueError):
                code = TRACEBACK
        os._exit(code)


def _command(words: list[str]) -> int:
    from irbcal.cli.main import main

    sys.argv = ["irbcal", *(word for word in words if not word.startswith("<"))]
    try:
        main()
        code: object = 0
    except SystemExit as end:
        code = 0 if end.code is None else end.code
    if code == 0:
        fault = _unreadable(words)
        if fault:
            print(fault, file=sys.stderr)
            return UNREADABLE
    return code if isinstance(code, int) else TRACEBACK


def _unreadable(words: list[str]) -> str | None:
    """What is wrong with what a command has written, by the readers of the package."""
    import irbcal
    from irbcal.correction import languages
    from irbcal.measurement.input_table import InputTable

    outputs = [
        Path(words[k + 1]) for k, word in enumerate(words[:-1]) if word in ("--out", "--changes", "--html", "--data")
    ]
    for path in outputs:
        try:
            if path.is_dir() and (path / "calibration.json").exists():
                irbcal.load(path)
            elif path.suffix == ".csv" and path.is_file() and words[0] != "filter":
                InputTable.read(path)
            elif words[0] == "filter" and path.is_file() and path == outputs[0] and path.suffix not in ("", ".csv"):
                bears = languages.language_of(path).fingerprint(path.read_bytes(), str(path))
                if not bears:
                    return f"{path}: bears no fingerprint"
        except irbcal.errors.IrbcalError as error:
            return f"what was written cannot be read: {error}"
    return None


def _judged(words: list[str], code: int, out: str, err: str, before: dict[str, str], folder: Path) -> str:
    if code in (-signal.SIGXCPU, -signal.SIGKILL):
        return "hang"
    if "MemoryError" in err or "bad_alloc" in err:
        return "memory"
    if code < 0:
        return f"signal {-code}"
    if code == UNREADABLE:
        return "unreadable output"
    if (
        code == TRACEBACK
        or "Traceback (most recent call last)" in err
        or ("Warning:" in err and "site-packages" in err)
    ):
        return "traceback"
    after = _hashes(folder)
    resealed = words[:1] == ["verify"] and "--reseal" in words
    # written again into the folder it reads, the page's hash in the seal with it
    own = ("report.html", "calibration.json") if words[:1] == ["report"] else ()
    changed = [name for name, content in before.items() if after.get(name) != content and Path(name).name not in own]
    if changed and not resealed:
        return "changed a file"
    new = [name for name in after if name not in before]
    if any(Path(name).name.startswith(".irbcal-") for name in new):
        return "half a file"
    if code == 0 or (code == NOT_A_PASS and words[:1] in (["evaluate"], ["fleet"])):
        return _numbers_of(words, out, folder, new) or "done"
    if new:
        return f"half a file (exit {code}, wrote {new[0]})"
    if code == 1:
        listed = words[:1] in (["filter"], ["verify"])
        # what the library urdfdom says before goes to stderr past Python
        one = [
            line for line in err.splitlines() if line.strip() and not line.startswith(("Error:   ", "Warning: ", "   "))
        ]
        fine = (len(one) == 1 and one[0].startswith("irbcal: ") and one[0].isprintable()) or (listed and not err)
        return "refused" if fine else "refusal that is not one sentence"
    if code == 2:
        return "usage"
    return f"exit code {code}"


def _refuse(text: str) -> float:
    raise ValueError(text)


def _numbers_of(words: list[str], out: str, folder: Path, new: list[str]) -> str | None:
    """Non-finite numbers in what was written or printed as JSON."""
    texts = [out] if "--json" in words and out.strip() and not {"--plan", "--help", "-h"} & set(words) else []
    if texts and not out.lstrip().startswith(("{", "[")) and words[words.index("--json") - 1].startswith("--"):
        texts = []  # --json was taken for a file's name
    old = [path for path in folder.rglob("*") if path.is_file() and str(path.relative_to(folder)) not in new]
    given = b"".join(path.read_bytes() for path in old).lower()
    for name in new:
        path = folder / name
        if path.suffix == ".json" and path.is_file():
            texts.append(path.read_text())
        elif path.suffix == ".csv" and path.is_file():
            found = _in_table(path.read_text(encoding="utf-8-sig"))
            if found:
                return f"non-finite number in {name}, column {found}"
        elif path.is_file() and words[:1] == ["filter"] and path.suffix != ".csv":
            for word in (b"nan", b"inf"):
                if path.read_bytes().lower().count(word) > given.count(word):
                    return "non-finite number in a program"
    if words[:1] == ["fk"] or words[:1] == ["ik"]:
        if "--json" not in words or not out.startswith("{"):  # --json may have been taken for a file's name
            found = _in_table(out)
            return f"non-finite number in column {found}" if found else None
        texts = [line for text in texts for line in text.splitlines()]
    if words[:1] == ["stream"]:
        return _in_stream(out, 50.0)  # what the fastest joint does in the longest time that counts
    for text in texts:
        try:
            json.loads(text, parse_constant=_refuse)
        except ValueError as error:
            return f"non-finite number or no JSON: {error}"
    return None


def _in_stream(out: str, least: float) -> str | None:
    """A command that is not finite, or farther from the one before than any motor goes within a line."""
    last: list[float] | None = None
    for line in out.splitlines():
        try:
            joints = json.loads(line, parse_constant=_refuse)["joints"]
        except (ValueError, KeyError, TypeError) as error:
            return f"no command in a line: {error}"
        if (
            joints is not None
            and last is not None
            and max(abs(a - b) for a, b in zip(joints, last, strict=True)) > least
        ):
            return "a command jumps"
        last = joints or last
    return None


def _in_table(text: str) -> str | None:
    before = csv.field_size_limit(2**31 - 1)  # texts of any length come back in tables
    rows = list(csv.reader(io.StringIO(text)))
    csv.field_size_limit(before)
    for row in rows[1:]:
        for name, value in zip(rows[0], row, strict=False):
            if name.endswith(("_mm", "_deg", "_rad", "_s", "qw", "qx", "qy", "qz")) and value.lower().strip("-+") in (
                "nan",
                "inf",
            ):
                return name
    return None
