"""Reading and writing files safely: what was handed over is read whole, what is written is whole or not at all.

Only regular files are read: a pipe would make a command wait for ever, a device would fill the memory; both are refused
before a byte is read. What is not written over: `irbcal.overwriting`.

A set is written in four steps: every file under a temporary name beside the one it replaces; a *journal* that names
them (from then on the set is written, whatever happens); the renames; the journal away. Who is killed before the
journal stands has changed nothing; who is killed after it leaves a journal, which the next one to open or write the
folder carries out (`recover`). Writers of one folder wait for each other by a lock on the folder itself, which leaves
no file behind.
"""

from __future__ import annotations

import errno
import gzip
import hashlib
import json
import os
import re
import secrets
import stat
import sys
import tempfile
import time
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias

from irbcal.errors import CalibrationError, IrbcalError
from irbcal.overwriting import REPLACING, may_replace

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
        hint = "; only irbcal fk, ik, view and stream read standard input" if source == STDIN else ""
        raise error(prefix + words_of(fault) + hint, file=source) from None
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


MOST_MEMBERS = 50_000
"""Files of a zip archive."""
_DAMAGED = (zipfile.BadZipFile, zlib.error, RuntimeError, NotImplementedError, EOFError, ValueError, OSError)
"""What the module zipfile raises where an archive is damaged, encrypted, or of a method that it does not know."""


def zip_archive(
    data: bytes, source: str | os.PathLike[str], error: type[IrbcalError], limit_bytes: int = LARGEST_FILE
) -> zipfile.ZipFile:
    """A zip archive from its content, with files of bounded number and size.

    Raises
    ------
    IrbcalError
        Of the kind ``error``, if it is none, or has more than `MOST_MEMBERS` files or ``limit_bytes`` when unpacked.
    """
    try:
        archive = zipfile.ZipFile(BytesIO(data))
    except _DAMAGED as fault:
        raise error(f"not a zip archive that can be read: {fault}", file=os.fspath(source)) from None
    members = archive.infolist()
    size = sum(member.file_size for member in members)
    if size > limit_bytes or len(members) > MOST_MEMBERS:
        raise error(
            f"expected at most {MOST_MEMBERS} files of together {limit_bytes} bytes in the archive, "
            f"found {len(members)} of {size}",
            file=os.fspath(source),
        )
    return archive


def zip_member(
    archive: zipfile.ZipFile, name: str | zipfile.ZipInfo, source: str | os.PathLike[str], error: type[IrbcalError]
) -> bytes:
    """Content of a file of an archive.

    Raises
    ------
    IrbcalError
        Of the kind ``error``, if it is not there, damaged or encrypted.
    """
    try:
        return archive.read(name)
    except (KeyError, *_DAMAGED) as fault:
        raise error(f"not in the archive, or not to be read: {fault}", file=os.fspath(source)) from None


GZIP_MARK = b"\x1f\x8b"
"""With which the content of files begins that gzip compressed."""


def gzip_content(
    data: bytes, source: str | os.PathLike[str], error: type[IrbcalError], limit_bytes: int = LARGEST_FILE
) -> bytes:
    """What gzip compressed, of bounded size.

    Raises
    ------
    IrbcalError
        Of the kind ``error``, if it is damaged or of more bytes.
    """
    try:
        with gzip.GzipFile(fileobj=BytesIO(data)) as stream:
            content = stream.read(limit_bytes + 1)
    except (OSError, EOFError, zlib.error) as fault:
        raise error(f"not a gzip file that can be read: {fault}", file=os.fspath(source)) from None
    if len(content) > limit_bytes:
        raise error(f"expected at most {limit_bytes // 10**6} MB when unpacked, found more", file=os.fspath(source))
    return content


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


def path_of_uri(uri: str) -> str:
    """The path of a ``file://`` name; ``file:///C:/meshes`` is the folder ``C:/meshes``."""
    path = uri.removeprefix("file://")
    return path[1:] if re.match(r"/[A-Za-z]:[/\\]", path) else path


try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

PAUSES_S = (0.05, 0.1, 0.2, 0.4, 0.8)
"""Between tries to rename over a file that others read."""
PREFIX = ".irbcal-"
"""Names of temporary files and journals begin so."""
NEW, OLD, JOURNAL, ELSEWHERE = ".new", ".old", ".journal", ".elsewhere"
"""Endings: new and old content, what is to be done, and where that stands for files of a set in other folders."""

_OURS = re.compile(r"\.irbcal-[0-9a-f]{12}(-\d+)?\.(new|old|journal|elsewhere)")


FileContent: TypeAlias = "bytes | Callable[[BinaryIO], object]"
"""Of a file: itself, or what writes it, for one that is larger than memory."""


def write_together(folder: str | Path, contents: Mapping[str, FileContent]) -> None:
    """Write files into a folder so that either all are new or all are as before; as `write_set`."""
    write_set({Path(folder) / name: content for name, content in contents.items()})


def write_set(contents: Mapping[Path, FileContent]) -> None:
    """Write files, of several folders if need be, so that either all are new or all are as before.

    Symbolic links stay and their files are replaced; permissions of files that are replaced stay. What may be a
    measurement, a URDF or a program of others, which nothing brings back, is not replaced. Each file by itself is
    replaced if it is empty or has the same content; if the word irbcal stands in it and in the new one; if both are
    tables whose rows are all simulated; or if it is a CSV file with columns of the new one, which irbcal computes or in
    which no reading is filled in yet. Within `irbcal.overwriting.replacing` all is replaced.

    Parameters
    ----------
    contents : dict of Path to bytes or callable
        Folders are made if absent. What is to be called gets a file to write to.

    Raises
    ------
    CalibrationError
        If one cannot be written or must not be replaced: then none is.
    """
    taken = [path for path in contents if os.path.isdir(path)]
    if taken:
        raise CalibrationError("expected a file to write, found a folder", file=taken[0])
    if not contents:
        return
    shown = next(iter(contents)).parent
    try:
        targets = {Path(os.path.realpath(path)): path for path in contents}
        folders = sorted({path.parent for path in targets})
        for folder in folders:
            folder.mkdir(parents=True, exist_ok=True)
        with _tidy(folders):
            _write(targets, contents, folders)
    except OSError as error:
        raise CalibrationError(f"cannot write to this folder: {error.strerror}", file=shown) from None


def recover(folder: str | Path) -> None:
    """Finish what a writer that was killed has begun in a folder, and sweep what it left; nothing to do is fast.

    Raises
    ------
    CalibrationError
        If there is something to do and the folder cannot be written.
    """
    folder = Path(folder)
    try:
        if _leftovers(folder):
            with _tidy([folder]):
                pass
    except OSError as error:
        raise CalibrationError(
            f"an earlier writing was cut off, and cannot be finished: {error.strerror}", file=folder
        ) from None


@dataclass(frozen=True)
class _Replacement:
    """A file of a set: where it belongs, its new content, its old one, and whether there was one."""

    path: Path
    new: Path
    old: Path
    existed: bool

    def restore(self) -> None:
        """As it was before; may be done twice."""
        with suppress(OSError):
            if self.existed and self.old.exists():
                _rename(self.old, self.path)
            elif not self.existed and not self.new.exists():
                os.unlink(self.path)


@contextmanager
def _tidy(folders: Sequence[Path]) -> Iterator[None]:
    """Lock folders, with those of the journals that their leftovers belong to, and carry out what was left."""
    while True:
        locked = _with_journals(folders)
        with ExitStack() as locks:
            for folder in locked:
                locks.enter_context(_locked(folder))
            if not set(_with_journals(folders)) <= set(locked):
                continue  # another writer was killed meanwhile
            for folder in locked:
                _carry_out(folder)
            for leftover in (path for folder in locked for path in _leftovers(folder)):
                with suppress(OSError):
                    leftover.unlink()
            yield
            return


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """The lock of a folder, on Windows of a file made for it: writers wait for each other."""
    if fcntl is None:
        with _locked_file(folder):
            yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


@contextmanager
def _locked_file(folder: Path) -> Iterator[None]:
    import msvcrt

    name = hashlib.sha256(os.path.normcase(os.path.realpath(folder)).encode()).hexdigest()[:16]
    handle = os.open(Path(tempfile.gettempdir()) / f"irbcal-{name}.lock", os.O_RDWR | os.O_CREAT)
    lock: Any = msvcrt  # its names are there on Windows only
    try:
        while True:
            try:
                lock.locking(handle, lock.LK_LOCK, 1)
                break
            except OSError:  # after ten seconds of waiting
                continue
        yield
        lock.locking(handle, lock.LK_UNLCK, 1)
    finally:
        os.close(handle)


def _rename(source: Path, target: Path) -> None:
    """Rename over a file that is there; on Windows again, while a virus scanner or an index reads it."""
    for pause in (*PAUSES_S, None) if fcntl is None else (None,):
        try:
            return os.replace(source, target)
        except PermissionError:
            if pause is None:
                raise
            time.sleep(pause)
    return None


def _relative(path: Path, folder: Path) -> str:
    """A path from a folder, whole where they are on two drives."""
    try:
        return os.path.relpath(path, folder)
    except ValueError:
        return str(path)


def _leftovers(folder: Path) -> list[Path]:
    try:
        names = os.listdir(folder)
    except (FileNotFoundError, NotADirectoryError):
        return []
    return sorted(folder / name for name in names if _OURS.fullmatch(name))


def _with_journals(folders: Sequence[Path]) -> list[Path]:
    """Folders with those of the journals of sets that have files in them, in the order in which they are locked."""
    real = {Path(os.path.realpath(folder)) for folder in folders}
    for folder in tuple(real):
        for path in _leftovers(folder):
            if path.suffix == ELSEWHERE:
                journal = folder / path.read_text(encoding="utf-8")
                if journal.exists():
                    real.add(Path(os.path.realpath(journal.parent)))
    return sorted(real)


def _write(targets: Mapping[Path, Path], contents: Mapping[Path, FileContent], folders: Sequence[Path]) -> None:
    word = f"{PREFIX}{secrets.token_hex(6)}"
    rows = [
        _Replacement(path, path.parent / f"{word}-{number}{NEW}", path.parent / f"{word}-{number}{OLD}", path.exists())
        for number, path in enumerate(targets)
    ]
    journal = folders[0] / f"{word}{JOURNAL}"
    draft = journal.with_suffix(NEW)
    pointers = [folder / f"{word}{ELSEWHERE}" for folder in folders[1:]]
    try:
        for row in rows:
            _put(row.new, contents[targets[row.path]], _mode(row.path))
            if row.path.is_file() and not (REPLACING.get() or may_replace(row.path, row.new)):
                raise CalibrationError(
                    "there is a file already that does not say that irbcal wrote it: name another one, or replace it "
                    "with --force",
                    file=targets[row.path],
                    parameter="out",
                )
            if row.existed and len(rows) > 1:
                _keep(row)
        for pointer in pointers:
            _put(pointer, _relative(journal, pointer.parent).encode())
        if len(rows) > 1:
            _put(draft, _journal(rows, True, journal.parent))
            for folder in folders:
                _sync(folder)
            _rename(draft, journal)
            _sync(journal.parent)
        for row in rows:
            _rename(row.new, row.path)
        for folder in folders:
            _sync(folder)
    except BaseException:
        if journal.exists():
            _turn_back(rows, draft, journal)
        _clear(rows, [journal, draft, *pointers])
        raise
    _clear(rows, [journal, draft, *pointers])


def _keep(row: _Replacement) -> None:
    """The old file under a second name, or a copy where there are no links."""
    try:
        os.link(row.path, row.old)
    except OSError:
        _put(row.old, row.path.read_bytes(), _mode(row.path))


def _turn_back(rows: Sequence[_Replacement], draft: Path, journal: Path) -> None:
    """Undo renames: the journal is turned round first, so that a kill here does no harm."""
    with suppress(OSError):
        _put(draft, _journal(rows, False, journal.parent))
        _rename(draft, journal)
    for row in rows:
        row.restore()


def _clear(rows: Sequence[_Replacement], leftovers: Sequence[Path]) -> None:
    """The journal goes first: what is left then is rubbish that the next one sweeps."""
    for path in (*leftovers, *(path for row in rows for path in (row.new, row.old))):
        with suppress(OSError):
            os.unlink(path)


def _carry_out(folder: Path) -> None:
    """Carry out the journals that were left in a folder."""
    for journal in _leftovers(folder):
        if journal.suffix != JOURNAL:
            continue
        rows, forward = _read_journal(journal)
        for row in rows:
            if not forward:
                row.restore()
            elif row.new.exists():
                _rename(row.new, row.path)
        for folder_of_row in {row.path.parent for row in rows}:
            _sync(folder_of_row)
        _clear(rows, [journal])


def _journal(rows: Sequence[_Replacement], forward: bool, folder: Path) -> bytes:
    files = [[*(_relative(path, folder) for path in (r.path, r.new, r.old)), r.existed] for r in rows]
    return json.dumps({"irbcal": "journal", "forward": forward, "files": files}).encode()


def _read_journal(journal: Path) -> tuple[list[_Replacement], bool]:
    """Rows and direction. A journal is synced before it has its name: one that cannot be read is none of ours."""
    try:
        content = json.loads(journal.read_bytes())
        rows = []
        for path, new, old, existed in content["files"]:
            row = _Replacement(journal.parent / path, journal.parent / new, journal.parent / old, bool(existed))
            if _belongs(row, journal):
                rows.append(row)
        return rows, bool(content["forward"])
    except (ValueError, KeyError, TypeError, IndexError):
        return [], True


def _belongs(row: _Replacement, journal: Path) -> bool:
    """Whether a journal may move a file: a folder from elsewhere must not reach into other folders.

    Files of one row lie in one folder: the journal's own, or one that says by itself that it waits for this journal.
    """
    folder = row.new.parent
    if not (row.path.parent == row.old.parent == folder and _OURS.fullmatch(row.new.name) and row.path.name):
        return False
    if os.path.realpath(folder) == os.path.realpath(journal.parent):
        return True
    pointer = folder / journal.with_suffix(ELSEWHERE).name
    try:
        return os.path.realpath(folder / pointer.read_text(encoding="utf-8")) == os.path.realpath(journal)
    except (OSError, ValueError):
        return False


def _put(path: Path, content: FileContent, mode: int | None = None) -> None:
    with open(path, "xb") as stream:
        if isinstance(content, bytes):
            stream.write(content)
        else:
            content(stream)
        stream.flush()
        if mode is not None:
            os.chmod(path, mode)
        os.fsync(stream.fileno())


def _mode(path: Path) -> int | None:
    try:
        return stat.S_IMODE(path.stat().st_mode)
    except OSError:
        return None


def _sync(folder: Path) -> None:
    """Names of a folder's files onto the disk, where the system can do that."""
    if os.name != "posix":  # pragma: no cover
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def check_writable(folder: str | Path, names: Sequence[str] = ()) -> list[Path]:
    """Refuse a folder that cannot be written, before any work is done.

    Parameters
    ----------
    folder : str or Path
        Made if absent.
    names : sequence of str
        Of the files that will be written.

    Returns
    -------
    list of Path
        Folders that had to be made for it, innermost first.
    """
    if not os.fspath(folder):
        raise CalibrationError("expected the name of a folder to write to, found an empty text", parameter="out")
    folder = Path(folder)
    new = [path for path in (folder, *folder.parents) if not os.path.exists(path)]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f"{PREFIX}{secrets.token_hex(6)}{NEW}"
        probe.touch(exist_ok=False)
        probe.unlink(missing_ok=True)  # a writer may have swept it
    except FileExistsError:
        raise CalibrationError("expected a folder to write to, found a file", file=folder) from None
    except OSError as error:
        raise CalibrationError(f"cannot write to this folder: {error.strerror}", file=folder) from None
    folders_there = [name for name in names if os.path.isdir(folder / name)]
    if folders_there:
        raise CalibrationError("expected a file to replace, found a folder", file=folder / folders_there[0])
    return new


@contextmanager
def made_folders(*folders: str | Path, names: Sequence[str] = ()) -> Iterator[None]:
    """Folders to write to, checked before the work is done; those made for it go again where the work fails.

    Parameters
    ----------
    *folders : str or Path
        Made if absent.
    names : sequence of str
        See `check_writable`.

    Raises
    ------
    CalibrationError
        If one cannot be written.
    """
    new: list[Path] = []
    try:
        for folder in folders:
            new += check_writable(folder, names)
        yield
    except BaseException:
        for folder in new:  # an empty folder would look like a result
            with suppress(OSError):
                Path(folder).rmdir()
        raise
