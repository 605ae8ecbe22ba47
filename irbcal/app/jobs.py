"""Command lines that run beside the server: their output as it comes, how they ended, and how to stop them.

A step of the app is the command line that its page shows, in a process of its own: what it computes is what the shell
would compute, and a step that is stopped leaves the files of before, as every command of irbcal does.
"""

from __future__ import annotations

import asyncio
import os
import signal
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from irbcal import literals

LONGEST_OUTPUT = 200_000
"""Characters of output that are kept for a page; the rest of them are dropped."""
LONGEST_LINE = 1 << 24
"""Bytes."""
PROGRESS = "\x1e"
"""First character of a line that names the step at work, see `irbcal.cli.show.progress`."""
PATIENCE_S = 5.0
"""Seconds between asking a process to stop and ending it."""


def as_typed(arguments: Sequence[str]) -> str:
    """The command line as a user types it."""
    return literals.shell("irbcal", *arguments)


@dataclass(eq=False)
class Job:
    """A command line that runs or ran."""

    step: str
    """The step of a page that it is."""
    arguments: list[str]
    """Behind ``irbcal``."""
    output: str = ""
    """What it printed."""
    at: str = ""
    """What it works on."""
    code: int | None = None
    """Its exit code; None while it runs."""
    stopped: bool = False
    """Whether a user stopped it."""
    began: float = field(default_factory=time.monotonic)
    ended: float = 0.0
    _process: asyncio.subprocess.Process | None = None

    @property
    def running(self) -> bool:
        """Whether it has not ended."""
        return self.code is None

    @property
    def seconds(self) -> float:
        """Since it began, as long as it runs; what it took, then."""
        return (time.monotonic() if self.running else self.ended) - self.began

    @property
    def good(self) -> bool:
        """Whether it did what it was asked for; exit code 3 is a verdict that is not good, of files that are."""
        return self.code in (0, 3)

    async def run(self, folder: Path) -> None:
        """Run it to its end in a folder."""
        environment = os.environ | {"IRBCAL_PROGRESS": "lines", "PYTHONUNBUFFERED": "1", "COLUMNS": "110"}
        environment["PYTHONIOENCODING"] = "utf-8"
        self._process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            "irbcal",
            *self.arguments,
            cwd=folder,
            env=environment,
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.STDOUT,
            limit=LONGEST_LINE,
        )
        stream = self._process.stdout
        try:
            while stream is not None and (chunk := await stream.readline()):
                text = chunk.decode("utf-8", "replace")
                if text.startswith(PROGRESS):
                    self.at = text.removeprefix(PROGRESS).strip()
                elif len(self.output) < LONGEST_OUTPUT:
                    self.output += text
            await self._process.wait()
        finally:
            await self.stop() if self._process.returncode is None else None
            self.ended = time.monotonic()
            self.code = self._process.returncode

    async def stop(self) -> None:
        """Ask it to stop as Ctrl-C does; end it where it does not hear."""
        process = self._process
        if process is None or process.returncode is not None:
            return
        self.stopped = True
        process.send_signal(signal.SIGTERM if sys.platform == "win32" else signal.SIGINT)
        try:
            await asyncio.wait_for(process.wait(), PATIENCE_S)
        except asyncio.TimeoutError:
            process.kill()
            await process.wait()


class Jobs:
    """The jobs of a project: the last of each step, one at a time."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.last: dict[str, Job] = {}

    @property
    def running(self) -> Job | None:
        """The job that runs, if one does."""
        return next((job for job in self.last.values() if job.running), None)

    async def run(self, step: str, commands: Sequence[Sequence[str]]) -> Job | None:
        """Run command lines one after the other, as long as each is good.

        Returns
        -------
        Job or None
            The last that ran; None where another one runs already: a project's files have one writer.
        """
        if self.running:
            return None
        output, began = "", time.monotonic()
        for arguments in commands:
            job = self.last[step] = Job(step, list(arguments), output + f"$ {as_typed(arguments)}\n", began=began)
            await job.run(self.folder)
            output = job.output + "\n"
            if not job.good or job.stopped:
                break
        return job
