"""``irbcal fleet add`` that is killed while it adds: each calibration is in the store whole or not at all, and once.

The command is forked with what it reads done before, and killed at every statement that it sends to the database, before
and after, and at random moments. Then the store must open, hold whole calibrations alone, and take what is missing by
the same call.
"""

from __future__ import annotations

import os
import shutil
import signal
import threading
import time
from collections.abc import Callable
from pathlib import Path
from random import Random

import sqlalchemy as sql

from fuzzing.kill import _forked, _run
from irbcal.errors import IrbcalError
from irbcal.fleet import adding
from irbcal.fleet.store import NOT_THERE, Stored, opened

ADDED = ("cal", "cal2", "cal-auto")
EVENTS = ("before_cursor_execute", "after_cursor_execute", "commit")
"""Moments at which a command is killed: before and after each statement, and before a transaction is committed."""


def all_stores(good: Path, folder: Path, moments: int, seed: int) -> int:
    """Both kinds of store; how many additions left something else."""
    import postgres_server

    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(good, folder)
    kept = {name: adding.stored(folder / name) for name in ADDED}
    bad = _reported("fleet add, SQLite", _Additions(folder, kept, str(folder / "new.db"), _unlinked), moments, seed)
    try:
        with postgres_server.server() as url:
            bad += _reported("fleet add, PostgreSQL", _Additions(folder, kept, url, _emptied), moments, seed)
    except postgres_server.Absent as reason:
        print(f"fleet add, PostgreSQL: left out, {reason}")
    return bad


def _reported(name: str, additions: _Additions, moments: int, seed: int) -> int:
    damaged, kills, counts = additions.attacked(moments, Random(f"{seed}:{name}"))
    print(f"{name}: {kills} kills, which left {dict(sorted(counts.items()))} calibrations, {len(damaged)} damaged")
    for text in damaged:
        print(f"  {text}")
    return len(damaged)


def _unlinked(place: str) -> None:
    for path in Path(place).parent.glob(f"{Path(place).name}*"):
        path.unlink()


def _emptied(place: str) -> None:
    import postgres_server

    postgres_server.emptied(place)


class _Additions:
    """An addition of some calibrations to an empty store, again and again."""

    def __init__(self, folder: Path, kept: dict[str, Stored], place: str, empty: Callable[[str], None]) -> None:
        self.folder, self.kept, self.place, self.empty = folder, kept, place, empty
        adding.stored = lambda path, *_: kept[Path(path).name]
        self.words = ["fleet", "add", *ADDED, "--store", place]

    def attacked(self, moments: int, random: Random) -> tuple[list[str], int, dict[int, int]]:
        """What was damaged, how many kills there were, and how often so many calibrations were left by them."""
        damaged: list[str] = []
        counts: dict[int, int] = {}
        begin = time.monotonic()
        if self._killed(lambda: None) != 0:
            return [f"nothing can be added: {self._log().read_text()[-300:]}"], 0, counts
        whole, number, kills = time.monotonic() - begin, 1, 0

        def judged(where: str) -> None:
            nonlocal kills
            kills += 1
            try:
                found = self._left()
            except (IrbcalError, ValueError) as error:
                damaged.append(f"{where}: {error}")
                return
            counts[found] = counts.get(found, 0) + 1

        while True:
            self.empty(self.place)
            if self._killed(lambda n=number: _count(n)) == 0:
                break
            judged(f"statement {number}")
            number += 1
        for _ in range(moments):
            self.empty(self.place)
            self._killed(lambda: None, random.random() * whole)
            judged("moment")
        self.empty(self.place)
        return damaged, kills, counts

    def _log(self) -> Path:
        return self.folder.parent / "store.log"

    def _killed(self, prepare: Callable[[], object], seconds: float | None = None) -> int:
        """Run the command in a fork, and kill it after a while; 0 if it came to its end."""

        def work() -> int:
            prepare()
            return _run(self.words, self.folder, self._log())

        if seconds is None:
            return _forked(work)
        child = os.fork()
        if child == 0:
            os._exit(work())
        killer = threading.Timer(seconds, os.kill, (child, signal.SIGKILL))
        killer.start()
        status = os.waitpid(child, 0)[1]
        killer.cancel()
        return status

    def _left(self) -> int:
        """How many calibrations are there, all whole; the same call brings the rest, and each is there once.

        Raises
        ------
        ValueError
            If it is not so.
        """
        before = 0
        try:
            with opened(self.place) as store:
                found = list(store.calibrations())
        except IrbcalError as error:
            if NOT_THERE not in str(error):
                raise
        else:
            parts = [one.robot["id"] for one in found if not self._whole(one)]
            if parts:
                raise ValueError(f"{parts[0]} is there in parts")
            before = len(found)
        again = adding.fleet_add([self.folder / name for name in ADDED], self.place)
        if (len(again.already_stored), len(again.added)) != (before, len(ADDED) - before):
            raise ValueError(
                f"{before} were there, then {len(again.already_stored)} were found and {len(again.added)} added"
            )
        with opened(self.place) as store:
            if len(list(store.calibrations())) != len(ADDED):
                raise ValueError(f"{len(list(store.calibrations()))} in place of {len(ADDED)} at the end")
        return before

    def _whole(self, one: Stored) -> bool:
        own = self.kept[one.robot["id"]]
        parts = [(getattr(one, part), getattr(own, part)) for part in ("fit", "level", "terms")]
        same = all(a is b or (a is not None and b is not None and a.names == b.names) for a, b in parts)
        return same and len(one.nuisance) == len(own.nuisance) and one.files == own.files


def _count(number: int) -> None:
    """This process is killed at its n-th event."""
    seen = 0

    def counted(*_: object) -> None:
        nonlocal seen
        seen += 1
        if seen == number:
            os.kill(os.getpid(), signal.SIGKILL)

    for event in EVENTS:
        sql.event.listen(sql.engine.Engine, event, counted)
