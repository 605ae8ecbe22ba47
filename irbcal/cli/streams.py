"""Output whose reader may go: what is written after that is dropped, and the command ends as it would have ended."""

from __future__ import annotations

import io
import os
import sys


class Forgiving(io.FileIO):
    """A stream that goes on into nothing when its reader, such as ``head``, has seen enough.

    The command runs to its end, so that files are written whole and the exit code tells what it always tells.
    """

    def write(self, data: object) -> int:
        """Write, to the null device once the pipe is broken."""
        try:
            return super().write(data)  # type: ignore[arg-type]
        except BrokenPipeError:
            nothing = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nothing, self.fileno())
            os.close(nothing)
            return super().write(data)  # type: ignore[arg-type]


def forgive() -> None:
    """Make stdout and stderr of this process forgiving."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if not isinstance(stream, io.TextIOWrapper):  # none at all, or that of another program
            continue
        stream.flush()
        raw = Forgiving(stream.fileno(), "w", closefd=False)
        setattr(
            sys,
            name,
            io.TextIOWrapper(
                io.BufferedWriter(raw),
                encoding=stream.encoding,
                errors=stream.errors,
                line_buffering=stream.line_buffering or stream.write_through,
            ),
        )
