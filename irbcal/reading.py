"""Reading files that were handed over: regular files only, whole, and what goes wrong said in one sentence.

A pipe would make a command wait for ever, a device would fill the memory: both are refused before a byte is read.
"""

from __future__ import annotations

import errno
import os
import stat
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from irbcal.errors import IrbcalError

STDIN = "-"
"""The file name that stands for standard input where a command takes it."""
LARGEST_FILE = 1_000_000_000
"""Bytes; what is larger was not written by a tracker, a robot or irbcal."""


def read_bytes(
    path: str | os.PathLike[str], error: type[IrbcalError], *, limit_bytes: int = LARGEST_FILE, prefix: str = ""
) -> bytes:
    """Content of a regular file.

    Parameters
    ----------
    path : str or Path
    error : type
        The kind of error to raise.
    limit_bytes : int
        Bytes that it may have.
    prefix : str
        Put before the reason, such as "not a calibration folder: ".

    Raises
    ------
    IrbcalError
        Of the kind ``error``, if there is no such file, it may not be read, is too large, or is no file but a folder,
        pipe, device or socket.
    """
    source = os.fspath(path)
    try:
        # without O_NONBLOCK, opening a pipe would wait for a writer
        handle = os.open(source, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except (OSError, ValueError) as fault:
        raise error(prefix + words_of(fault), file=source) from None
    try:
        with open(handle, "rb") as stream:
            status = os.fstat(handle)
            if not stat.S_ISREG(status.st_mode):
                raise error(f"{prefix}expected a file, found {kind_of(status.st_mode)}", file=source)
            # as many bytes as are asked for are reserved; some files (/proc) have more than they say
            data = stream.read(min(limit_bytes, status.st_size) + 1)
            data += stream.read(limit_bytes + 1) if len(data) == status.st_size + 1 <= limit_bytes else b""
    except OSError as fault:
        kind = "a folder" if isinstance(fault, IsADirectoryError) else None
        text = f"expected a file, found {kind}" if kind else words_of(fault)
        raise error(prefix + text, file=source) from None
    if len(data) > limit_bytes:
        limit = f"{limit_bytes // 10**6} MB" if limit_bytes >= 10**6 else f"{limit_bytes // 1024} KiB"
        raise error(f"expected a file of at most {limit}, found more", file=source)
    return data


def stdin_bytes(error: type[IrbcalError], largest: int = LARGEST_FILE) -> bytes:
    """What stands on standard input, to its end.

    Raises
    ------
    IrbcalError
        Of the kind ``error``, if there is no standard input or more than ``largest`` bytes.
    """
    stream = getattr(sys.stdin, "buffer", None)
    if stream is None:
        raise error("there is no standard input", file=STDIN)
    data: bytes = stream.read(largest + 1)
    if len(data) > largest:
        raise error(f"expected at most {largest // 10**6} MB, found more", file=STDIN)
    return data


def kind_of(mode: int) -> str:
    """What is no regular file, in words, from ``st_mode``."""
    kinds = (
        (stat.S_ISDIR, "a folder"),
        (stat.S_ISFIFO, "a pipe"),
        (stat.S_ISCHR, "a device"),
        (stat.S_ISBLK, "a device"),
        (stat.S_ISSOCK, "a socket"),
    )
    return next((description for test, description in kinds if test(mode)), "something else")


def words_of(fault: OSError | ValueError) -> str:
    """Why a file cannot be read, as the end of a sentence."""
    if isinstance(fault, FileNotFoundError):
        return "there is no such file"
    if isinstance(fault, PermissionError):
        return "no permission to read this file"
    if isinstance(fault, OSError) and fault.errno == errno.ENAMETOOLONG:
        return "the name is too long for a file"
    reason = fault.strerror if isinstance(fault, OSError) and fault.strerror else str(fault)
    return f"cannot read this file: {' '.join(reason.split())}"


@contextmanager
def libraries_silent() -> Iterator[None]:
    """Keep what C libraries print about a damaged file off stderr: the refusal says it in one sentence."""
    try:
        stderr = os.dup(2)
    except OSError:  # there is no stderr
        yield
        return
    sink = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(sink, 2)
        yield
    finally:
        os.dup2(stderr, 2)
        os.close(sink)
        os.close(stderr)
