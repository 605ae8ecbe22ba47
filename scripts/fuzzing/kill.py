"""Commands that are killed while they write: afterwards the old result or the new one, loadable, nothing else.

A command runs once up to the moment where it begins to write; from there it is forked again and again, each fork is
killed somewhere else: at every call that changes the disk, and at random moments.
"""

from __future__ import annotations

import os
import shutil
import signal
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

CALLS = ("replace", "link", "unlink", "fsync", "open", "chmod")


@dataclass(frozen=True)
class Writer:
    """A command that writes: how the old result is made, how the new one, and what they consist of."""

    name: str
    old: list[str]
    new: list[str]
    loads: Callable[[Path], object]


def _calibration(folder: Path) -> object:
    import irbcal

    return irbcal.load(folder / "out")


def _files(folder: Path) -> object:
    from irbcal.measurement import columns

    for path in (folder / "out").rglob("*"):
        if path.suffix == ".csv" and path.is_file():
            columns.read(path, [])
    return None


def _study(folder: Path) -> object:
    import json

    return json.loads((folder / "out" / "study.json").read_text())


WRITERS = (
    Writer(
        "calibrate",
        ["calibrate", "m.csv", "--robot", "irb1600", "--model", "16", "--out", "out"],
        ["calibrate", "m.csv", "--robot", "irb1600", "--model", "26", "--out", "out", "--force"],
        _calibration,
    ),
    Writer(
        "filter",
        ["filter", "cal", "rapid.mod", "--allow-partial", "--out", "out/job.mod", "--changes", "out/changes.csv"],
        ["filter", "cal2", "rapid.mod", "--allow-partial", "--out", "out/job.mod", "--changes", "out/changes.csv"],
        _files,
    ),
    Writer(
        "plan",
        ["plan", "--robot", "irb1600", "--axis", "0", "--cube", "0", "--all-range", "4", "--out", "out"],
        ["plan", "--robot", "irb1600", "--axis", "0", "--cube", "0", "--all-range", "5", "--out", "out"],
        _files,
    ),
    Writer(
        "simulate",
        ["simulate", "j.csv", "--robot", "irb1600", "--out", "out/m.csv"],
        ["simulate", "j.csv", "--robot", "irb1600", "--robot-seed", "5", "--out", "out/m.csv"],
        _files,
    ),
    Writer(
        "import",
        ["import", "lab.csv", "--as", "map.yaml", "--out", "out/m.csv"],
        ["import", "lab.csv", "--as", "map.yaml", "--set", "fixed.target=other", "--out", "out/m.csv"],
        _files,
    ),
    Writer(
        "report",
        ["report", "cal", "--figures", "out/f", "--data", "out/t"],
        ["report", "cal2", "--figures", "out/f", "--data", "out/t"],
        _files,
    ),
    Writer(
        "tracker",
        ["tracker", "bar.csv", "--length", "1000", "--plot", "out/t.png"],
        ["tracker", "bar.csv", "--length", "1001", "--plot", "out/t.png"],
        _files,
    ),
)
"""The writing of ``study`` is that of ``import`` for each of its parts; tests/cli/test_study.py kills it as a whole."""


def all_writers(good: Path, folder: Path, moments: int, seed: int) -> int:
    """Kill every writer at every change of the disk and at its share of random moments; how many were damaged."""
    bad = 0
    for number, writer in enumerate(WRITERS):
        share = moments // len(WRITERS) + (number < moments % len(WRITERS))
        found, kills, seen = killed(writer, good, folder / writer.name, share, Random(f"{seed}:{writer.name}"))
        print(f"{writer.name}: {kills} kills, {seen[0]} old, {seen[1]} new, {len(found)} damaged", flush=True)
        for text in found:
            print(f"  {text}")
        bad += len(found)
    return bad


def killed(
    writer: Writer, good: Path, folder: Path, moments: int, random: Random, calls: range | None = None
) -> tuple[list[str], int, tuple[int, int]]:
    """Kill a writer; returns what was damaged, how many kills there were, and how often all was old or new.

    Parameters
    ----------
    writer : Writer
    good : Path
        The good inputs.
    folder : Path
        To work in.
    moments : int
        Random moments.
    random : Random
    calls : range, optional
        Which calls to kill at; by default every one.
    """
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(good, folder)
    (folder / "out").mkdir()
    log = folder.parent / f"{writer.name}.log"
    if _forked(lambda: _run(writer.old, folder, log)) != 0:
        return [f"the old result cannot be made: {log.read_text()[-300:]}"], 0, (0, 0)
    kept = folder.parent / f"{writer.name}-old"
    shutil.rmtree(kept, ignore_errors=True)
    shutil.copytree(folder / "out", kept)
    results = folder.parent / f"{writer.name}.results"
    results.write_text("")

    def run() -> int:
        _fork_where_it_writes(writer, folder, kept, results, moments, random, calls)
        return _run(writer.new, folder, log)

    _forked(run)
    lines = results.read_text().splitlines()
    damaged = [line for line in lines if line.partition(": ")[2] not in ("old", "new")]
    seen = tuple(sum(line.endswith(f": {kind}") for line in lines) for kind in ("old", "new"))
    if not lines:
        damaged.append(f"it was never killed: {log.read_text()[-300:]}")
    return damaged, len(lines), (seen[0], seen[1])


def _forked(work: Callable[[], int]) -> int:
    child = os.fork()
    if child == 0:
        code = 1
        try:
            code = work()
        finally:
            os._exit(code)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def _run(words: list[str], folder: Path, log: Path) -> int:
    import sys

    from irbcal.cli.main import main

    os.chdir(folder)
    handle = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(handle, 1)
    os.dup2(handle, 2)
    sys.stdout, sys.stderr = (os.fdopen(number, "w", closefd=False) for number in (1, 2))
    sys.argv = ["irbcal", *words]
    try:
        main()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 0
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
    return 0


def _fork_where_it_writes(
    writer: Writer, folder: Path, kept: Path, results: Path, moments: int, random: Random, calls: range | None
) -> None:
    """From now on, the first writing of a set in this process is tried many times, each in a fork that is killed."""
    from irbcal import atomic

    write = atomic._write
    begun = False

    def tried(*arguments: Any) -> None:
        nonlocal begun
        if begun:  # inside of a fork: a second set
            return write(*arguments)
        begun = True
        whole, complete = _uninterrupted(folder, kept)
        for number in calls or range(1, 10_000):
            _reset(folder, kept)
            if not _killed_at(number):
                break
            _note(results, f"call {number}", _state(writer, folder, kept, complete))
        for _ in range(moments):
            _reset(folder, kept)
            _killed_after(random.random() * whole)
            _note(results, "moment", _state(writer, folder, kept, complete))
        _reset(folder, kept)
        os._exit(0)

    def _killed_at(number: int) -> bool:
        """Whether a fork came as far as a call."""
        child = os.fork()
        if child:
            return os.waitpid(child, 0)[1] != 0
        _count(number)
        return _go_on()

    def _killed_after(seconds: float) -> None:
        child = os.fork()
        if child == 0:
            _go_on()
        killer = threading.Timer(seconds, os.kill, (child, signal.SIGKILL))
        killer.start()
        os.waitpid(child, 0)
        killer.cancel()
        killer.join()

    def _uninterrupted(folder: Path, kept: Path) -> tuple[float, dict[Path, bytes]]:
        """How long the writing takes, and what it leaves: to the byte what every fork would leave."""
        begin = time.monotonic()
        child = os.fork()
        if child == 0:
            _go_on()
        os.waitpid(child, 0)
        whole, complete = time.monotonic() - begin, _contents(folder / "out")
        _reset(folder, kept)
        return whole, complete

    def _go_on() -> bool:
        try:
            write(*current[0])
        finally:
            os._exit(0)

    current: list[tuple[Any, ...]] = []

    def entered(*arguments: Any) -> None:
        current[:] = [arguments]
        tried(*arguments)

    atomic._write = entered  # type: ignore[assignment]


def _count(number: int) -> None:
    """This process is killed at its n-th call that changes the disk."""
    count = 0

    def counted(function: Callable[..., Any]) -> Callable[..., Any]:
        def wrapped(*arguments: Any, **options: Any) -> Any:
            nonlocal count
            count += 1
            if count == number:
                os.kill(os.getpid(), signal.SIGKILL)
            return function(*arguments, **options)

        return wrapped

    for name in CALLS:
        setattr(os, name, counted(getattr(os, name)))


def _reset(folder: Path, kept: Path) -> None:
    shutil.rmtree(folder / "out")
    shutil.copytree(kept, folder / "out")


def _contents(folder: Path) -> dict[Path, bytes]:
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def _state(writer: Writer, folder: Path, kept: Path, complete: dict[Path, bytes]) -> str:
    """``old``, ``new``, or what is wrong; seen by a process that opens the folder as a command does."""
    from irbcal import atomic

    for path in [folder / "out", *(folder / "out").rglob("*/")]:
        if path.is_dir():
            atomic.recover(path)
    before, now = _contents(kept), _contents(folder / "out")
    if set(before) - set(now) or any(path.name.startswith(".irbcal-") for path in now):
        return f"files are {sorted(map(str, now))}"
    try:
        writer.loads(folder)
    except Exception as error:  # whatever it is, the result cannot be used
        return f"cannot be read: {error}"
    return "old" if now == before else "new" if now == complete else "mixed"


def _note(results: Path, where: str, what: str) -> None:
    with results.open("a") as stream:
        stream.write(f"{where}: {what}\n")
