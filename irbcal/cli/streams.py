"""Output whose reader may go, that was closed from the start, or that cannot show every character.

What is written after a reader has gone is dropped, and the command ends as it would have ended. What is written to a
standard output that is closed is lost: the command says so. Characters that an encoding has not are written as escapes.
"""

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


class Closed(io.FileIO):
    """Stands for a stream that was closed when the program began."""

    lost = False
    """Whether something was written."""

    def write(self, data: object) -> int:
        """Write into nothing."""
        self.lost = True
        return super().write(data)  # type: ignore[arg-type]


def output_lost() -> bool:
    """Whether a standard output that is closed was written to; what could not be written otherwise is an error."""
    if not isinstance(sys.stdout, io.TextIOWrapper):
        return False
    sys.stdout.flush()
    raw = getattr(sys.stdout.buffer, "raw", None)
    return isinstance(raw, Closed) and raw.lost


def forgive() -> None:
    """Make stdout and stderr of this process forgiving."""
    for number, name in ((1, "stdout"), (2, "stderr")):
        stream = getattr(sys, name)
        if stream is None:
            nothing = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nothing, number)  # or the next file that is opened would be this stream
            if nothing not in (1, 2):
                os.close(nothing)
            setattr(sys, name, io.TextIOWrapper(io.BufferedWriter(Closed(number, "w", closefd=False)), "utf-8"))
            continue
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
                errors="backslashreplace",
                line_buffering=stream.line_buffering or stream.write_through,
            ),
        )
