"""Commands that are killed while they write, or whose disk fails: the old result or the new one, loadable, nothing else.

A command runs once up to the moment where it begins to write; from there it is forked again and again. Each fork is
killed somewhere else, at every call that changes the disk and at random moments; or one such call fails in it (no space,
I/O error), once or from then on, and it must end with one sentence.
"""

from __future__ import annotations

import errno
import os
import shutil
import signal
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

CALLS = ("replace", "link", "unlink", "fsync", "open", "chmod")
FAULTS = (errno.ENOSPC, errno.EIO)
"""What fails."""


@dataclass(frozen=True)
class Writer:
    """A command that writes: how the old result is made, how the new one, and what they consist of.

    ``prepare`` is done in the folder before the old result is made, ``edit`` after it; of a command that writes several
    sets of files one after the other, ``number`` is the one that is cut off. Without ``faults`` it is killed only:
    a fleet takes a robot whose files cannot be written for one that failed, and goes on.
    """

    name: str
    old: Sequence[str]
    new: Sequence[str]
    loads: Callable[[Path], object]
    prepare: Callable[[Path], object] = lambda folder: None
    edit: Callable[[Path], object] = lambda folder: None
    number: int = 1
    faults: bool = True


def _calibration(folder: Path) -> object:
    import irbcal

    return irbcal.load(folder / "out")


def _files(folder: Path) -> object:
    from irbcal.measurement.input_table import InputTable

    for path in (folder / "out").rglob("*"):
        if path.suffix == ".csv" and path.is_file():
            InputTable.read(path)
    return None


def _urdf(folder: Path) -> object:
    import irbcal

    return irbcal.read_urdf(folder / "out" / "a.urdf")


def _document(folder: Path) -> object:
    import json

    return json.loads((folder / "out" / "calibration.json").read_text())


def _edited(path: Path) -> None:
    """A note added by hand."""
    import json

    document = json.loads(path.read_text())
    document["notes"].append("a note")
    path.write_text(json.dumps(document))


def _prior(folder: Path) -> object:
    from irbcal.io import prior_file

    return prior_file.read(folder / "out" / "prior.json")


def _fleet(folder: Path) -> object:
    """What is marked as done is a calibration, and the same call does what is missing."""
    import irbcal

    copy = folder.parent / f"{folder.name}-again"
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(folder / "out", copy)
    for mark in copy.glob("*/fleet.json"):
        irbcal.load(mark.parent)
    found = irbcal.fleet_calibrate(folder / "list2.csv", copy, jobs=1)
    if found.failures or found.calibrated + found.reused != 2:
        raise ValueError(f"the same call then gives: {found.headline()}")
    return irbcal.fleet_add(copy, copy / "fleet.db")


BALLBAR = ("--bar", "150", "--tool", "0,65,149", "--joints", "10,0,0,0,90,0")


TYPE = "irb1600_6_145"


def _listed(name: str) -> list[str]:
    return ["fleet", "calibrate", f"{name}.csv", "--out", "out", "--jobs", "1"]


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
        ["import", "lab.csv", "--as", "map.yaml", "--set", "fixed.target=other", "--out", "out/m.csv", "--force"],
        _files,
    ),
    Writer(
        "report",
        ["report", "out/cal", "--figures", "out/f", "--data", "out/t"],
        ["report", "out/cal", "--figures", "out/f", "--data", "out/t"],
        _files,
        prepare=lambda folder: shutil.copytree(folder / "cal2", folder / "out" / "cal"),
        edit=lambda folder: [
            shutil.copyfile(folder / "cal" / name, folder / "out" / "cal" / name)
            for name in ("calibration.json", "calibrated.urdf")
        ],
    ),
    Writer(
        "tracker",
        ["tracker", "bar.csv", "--length", "1000", "--plot", "out/t.png"],
        ["tracker", "bar.csv", "--length", "1001", "--plot", "out/t.png"],
        _files,
    ),
    Writer(
        "ballbar",
        ["ballbar", "cal", "ball.csv", *BALLBAR, "--plot", "out/b.svg"],
        ["ballbar", "cal2", "ball.csv", *BALLBAR, "--plot", "out/b.svg"],
        _files,
    ),
    Writer(
        "evaluate",
        ["evaluate", "cal2", "v.csv", "--report", "out/c.html", "--data", "out/t"],
        ["evaluate", "cal", "v.csv", "--report", "out/c.html", "--data", "out/t"],
        _files,
    ),
    Writer(
        "compare",
        ["compare", "cal", "cal2", "--measurements", "v.csv", "--csv", "out/c.csv", "--latex", "out/c.tex"],
        ["compare", "cal2", "cal", "--measurements", "v.csv", "--csv", "out/c.csv", "--latex", "out/c.tex"],
        _files,
    ),
    Writer(
        "joints",
        ["joints", "m.csv", "--joint", "1", "--plots", "out"],
        ["joints", "m.csv", "--joint", "1", "--order", "1", "--calibration", "cal", "--plots", "out"],
        _files,
    ),
    Writer(
        "view",
        ["view", "cal2", "v.csv", "--html", "out/v.html"],
        ["view", "cal", "v.csv", "--html", "out/v.html"],
        _files,
    ),
    Writer(
        "urdf",
        ["urdf", "--dh", "dh.csv", "--convention", "standard", "--out", "out/a.urdf"],
        ["urdf", "--dh", "dh.csv", "--convention", "modified", "--out", "out/a.urdf"],
        _urdf,
    ),
    Writer(
        "controller",
        ["urdf", "--dh", "dh.csv", "--convention", "standard", "--out", "out/a.urdf"],
        ["controller", "c.csv", "--robot", "irb120", "--out", "out/a.urdf"],
        _urdf,
    ),
    Writer(
        "reseal",
        ["report", "out"],
        ["verify", "out", "--reseal", "a note of mine"],
        _document,
        prepare=lambda folder: shutil.copytree(folder / "cal", folder / "out", dirs_exist_ok=True),
        edit=lambda folder: _edited(folder / "out" / "calibration.json"),
    ),
    Writer(
        "export",
        ["export", "cal", "--as", "cpp", "--out", "out/robot"],
        ["export", "cal2", "--as", "cpp", "--out", "out/robot"],
        _files,
    ),
    Writer(
        "fleet prior",
        ["fleet", "prior", "--type", TYPE, "--store", "type.db", "--out", "out/prior.json"],
        ["fleet", "prior", "--type", TYPE, "--store", "type.db", "--out", "out/prior.json", "--without", "a"],
        _prior,
    ),
    *(
        Writer(name, _listed("list"), _listed("list2"), _fleet, number=number, faults=number == 5)
        for number, name in ((1, "fleet, a robot"), (2, "fleet, its mark"), (5, "fleet, the page"))
    ),
)
"""Every command that writes files by itself; ``demo`` calls the others."""


def all_writers(good: Path, folder: Path, moments: int, seed: int) -> int:
    """Cut every writer off at every change of the disk and at its share of random moments; how many were damaged."""
    bad = 0
    for number, writer in enumerate(WRITERS):
        share = moments // len(WRITERS) + (number < moments % len(WRITERS))
        found, kills, seen = killed(writer, good, folder / writer.name, share, Random(f"{seed}:{writer.name}"))
        print(
            f"{writer.name}: {kills} kills and faults, {seen[0]} old, {seen[1]} new, {len(found)} damaged", flush=True
        )
        for text in found:
            print(f"  {text}")
        bad += len(found)
    return bad


def killed(
    writer: Writer,
    good: Path,
    folder: Path,
    moments: int,
    random: Random,
    calls: range | None = None,
    faults: bool = True,
) -> tuple[list[str], int, tuple[int, int]]:
    """Kill a writer; returns what was damaged, how many kills and faults there were, and how often all was old or new.

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
    faults : bool
        Whether these calls shall also fail, once and from then on.
    """
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(good, folder)
    (folder / "out").mkdir()
    log = folder.parent / f"{folder.name}.log"
    writer.prepare(folder)
    if _forked(lambda: _run(writer.old, folder, log)) != 0:
        return [f"the old result cannot be made: {log.read_text()[-300:]}"], 0, (0, 0)
    writer.edit(folder)
    attack = _Attack(writer, folder, moments, random, calls or range(1, 10_000), faults and writer.faults)
    _forked(attack.begin)
    lines = attack.results.read_text().splitlines()
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


def _run(words: Sequence[str], folder: Path, log: Path) -> int:
    import sys

    from irbcal.cli.main import main

    os.chdir(folder)
    _say_into(log)
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


def _say_into(log: Path, streams: Sequence[int] = (1, 2)) -> None:
    handle = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    for stream in streams:
        os.dup2(handle, stream)
    os.close(handle)


class _Attack:
    """A command that is forked again and again where it writes a set of files, and cut off in each fork."""

    def __init__(self, writer: Writer, folder: Path, moments: int, random: Random, calls: range, faults: bool) -> None:
        self.writer, self.folder, self.moments, self.random, self.calls = writer, folder, moments, random, calls
        self.faults, self.sets = faults, 0
        self.kept, self.results, self.log = (
            folder.parent / f"{folder.name}{ending}" for ending in ("-old", ".results", ".log")
        )
        self.results.write_text("")
        self.complete: dict[Path, bytes] = {}
        self.finished: dict[Path, bytes] = {}

    def begin(self) -> int:
        """Run the command; this process does not return from where it is attacked."""
        from irbcal import safe_files

        write = safe_files._write

        def written(*arguments: Any) -> None:
            self.sets += 1
            if self.sets == self.writer.number:
                self._try(write, *arguments)
            write(*arguments)

        safe_files._write = written  # type: ignore[assignment]
        return _run(self.writer.new, self.folder, self.log)

    def _try(self, write: Callable[..., None], *arguments: Any) -> None:
        """All that may happen to a writing; returns in forks whose disk fails, to see what the command makes of it."""

        def go_on() -> None:
            try:
                write(*arguments)
            finally:
                os._exit(0)

        shutil.rmtree(self.kept, ignore_errors=True)
        shutil.copytree(self.folder / "out", self.kept)
        begin = time.monotonic()
        self._in_a_fork(go_on)
        whole, self.complete = time.monotonic() - begin, _contents(self.folder / "out")
        self._reset()
        child = os.fork()
        if child == 0:
            return  # to the end of the command, with all other sets that it writes
        os.waitpid(child, 0)
        self.finished = _contents(self.folder / "out")
        for number in self.calls:
            self._reset()
            if self._in_a_fork(lambda n=number: (_count(n, _kill), go_on())) == 0:
                break
            self._note(f"call {number}")
        for _ in range(self.moments):
            self._reset()
            self._in_a_fork(go_on, self.random.random() * whole)
            self._note("moment")
        for error in FAULTS if self.faults else ():
            for for_good in (False, True):
                for number in self.calls:
                    self._reset()
                    happened = self.folder.parent / f"{self.folder.name}.happened"
                    happened.unlink(missing_ok=True)
                    child = os.fork()
                    if child == 0:
                        _say_into(self.log, (2,))
                        _count(number, partial(_fail, error, happened), for_good)
                        return
                    code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
                    if not happened.exists():
                        break
                    self._note(f"{errno.errorcode[error]} {'from' if for_good else 'at'} call {number}", code)
        self._reset()
        os._exit(0)

    def _in_a_fork(self, work: Callable[[], object], seconds: float | None = None) -> int:
        """Do something in a fork, and kill it after a while; 0 if it came to its end."""
        child = os.fork()
        if child == 0:
            work()
        killer = threading.Timer(seconds or 0.0, os.kill, (child, signal.SIGKILL))
        if seconds is not None:
            killer.start()
        status = os.waitpid(child, 0)[1]
        killer.cancel()
        return status

    def _reset(self) -> None:
        shutil.rmtree(self.folder / "out")
        shutil.copytree(self.kept, self.folder / "out")

    def _note(self, where: str, code: int | None = None) -> None:
        """Write down what is found; of a command that came to its end also whether it said the truth about it."""
        what = self._state()
        if code is not None and what in ("old", "new"):
            said = [line for line in self.log.read_text(errors="replace").splitlines() if line.strip()]
            if code == 0 and what != "new":
                what = "said to be done, and is not"
            elif code != 0 and not (code == 1 and len(said) == 1 and said[0].startswith("irbcal: ")):
                what = f"exit code {code}: {' / '.join(said)[-300:]}"
        with self.results.open("a") as stream:
            stream.write(f"{where}: {what}\n")

    def _state(self) -> str:
        """``old``, ``new``, or what is wrong; seen by a process that opens the folder as a command does."""
        from irbcal import safe_files

        out = self.folder / "out"
        for path in [out, *out.rglob("*/")]:
            if path.is_dir():
                safe_files.recover(path)
        before, now = _contents(self.kept), _contents(out)
        if set(before) - set(now) or any(path.name.startswith(".irbcal-") for path in now):
            return f"files are {sorted(map(str, now))}"
        try:
            self.writer.loads(self.folder)
        except Exception as error:  # whatever it is, the result cannot be used
            return f"cannot be read: {error}"
        return "old" if now == before else "new" if now in (self.complete, self.finished) else "mixed"


def _kill() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def _fail(error: int, happened: Path) -> None:
    os.close(_OPEN(happened, os.O_CREAT | os.O_WRONLY))
    raise OSError(error, os.strerror(error))


_OPEN = os.open


def _count(number: int, then: Callable[[], None], for_good: bool = False) -> None:
    """Something happens in this process at its n-th call that changes the disk, or from that on."""
    import builtins

    from irbcal import safe_files

    count = 0

    def counted(function: Callable[..., Any]) -> Callable[..., Any]:
        def wrapped(*arguments: Any, **options: Any) -> Any:
            nonlocal count
            count += 1
            if count == number or (for_good and count > number):
                then()
            return function(*arguments, **options)

        return wrapped

    class File:
        """A file whose every writing counts."""

        def __init__(self, *arguments: Any) -> None:
            self.stream = builtins.open(*arguments)  # noqa: SIM115
            self.write, self.flush = counted(self.stream.write), counted(self.stream.flush)

        def __enter__(self) -> File:
            return self

        def __exit__(self, *_: object) -> None:
            self.stream.close()

        def fileno(self) -> int:
            return self.stream.fileno()

    for name in CALLS:
        setattr(os, name, counted(getattr(os, name)))
    to_write = counted(File)
    safe_files.open = lambda path, mode: (builtins.open if mode == "rb" else to_write)(path, mode)  # type: ignore[attr-defined]


def _contents(folder: Path) -> dict[Path, bytes]:
    return {path.relative_to(folder): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
