"""Writing files whole or not at all, also a set of files, also when the power goes.

A set is written in four steps: every file under a temporary name beside the one it replaces; a *journal* that names
them (from then on the set is written, whatever happens); the renames; the journal away. Who is killed before the
journal stands has changed nothing; who is killed after it leaves a journal, which the next one to open or write the
folder carries out (`recover`). Writers of one folder wait for each other by a lock on the folder itself, which leaves
no file behind.
"""

from __future__ import annotations

import json
import os
import re
import secrets
import stat
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from irbcal.errors import CalibrationError

try:
    import fcntl
except ImportError:  # pragma: no cover - Windows has no locks on folders: one writer at a time there
    fcntl = None  # type: ignore[assignment]

PREFIX = ".irbcal-"
"""Names of temporary files and journals begin so."""
NEW, OLD, JOURNAL, ELSEWHERE = ".new", ".old", ".journal", ".elsewhere"
"""Endings: new and old content, what is to be done, and where that stands for files of a set in other folders."""

_OURS = re.compile(r"\.irbcal-[0-9a-f]{12}(-\d+)?\.(new|old|journal|elsewhere)")


def write_together(folder: str | Path, contents: Mapping[str, bytes]) -> None:
    """Write files into a folder so that either all are new or all are as before; as `write_set`."""
    write_set({Path(folder) / name: content for name, content in contents.items()})


def write_set(contents: Mapping[Path, bytes]) -> None:
    """Write files, of several folders if need be, so that either all are new or all are as before.

    Symbolic links stay and their files are replaced; permissions of files that are replaced stay.

    Parameters
    ----------
    contents : dict of Path to bytes
        Folders are made if absent.

    Raises
    ------
    CalibrationError
        If one cannot be written: then none is.
    """
    taken = [path for path in contents if os.path.isdir(path)]
    if taken:
        raise CalibrationError("expected a file to write, found a folder", file=taken[0])
    if not contents:
        return
    shown = next(iter(contents)).parent
    try:
        targets = {Path(os.path.realpath(path)): content for path, content in contents.items()}
        folders = sorted({path.parent for path in targets})
        for folder in folders:
            folder.mkdir(parents=True, exist_ok=True)
        with _tidy(folders):
            _write(targets, folders)
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
class _Row:
    """A file of a set: where it belongs, its new content, its old one, and whether there was one."""

    path: Path
    new: Path
    old: Path
    existed: bool

    def back(self) -> None:
        """As it was before; may be done twice."""
        with suppress(OSError):
            if self.existed and self.old.exists():
                os.replace(self.old, self.path)
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
            for folder in locked:
                _sweep(folder)
            yield
            return


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """The lock of a folder, where the system has one: writers wait for each other."""
    if fcntl is None:  # pragma: no cover
        yield
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):
            fcntl.flock(handle, fcntl.LOCK_EX)
        yield
    finally:
        os.close(handle)


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


def _write(targets: Mapping[Path, bytes], folders: Sequence[Path]) -> None:
    word = f"{PREFIX}{secrets.token_hex(6)}"
    rows = [
        _Row(path, path.parent / f"{word}-{number}{NEW}", path.parent / f"{word}-{number}{OLD}", path.exists())
        for number, path in enumerate(targets)
    ]
    journal = folders[0] / f"{word}{JOURNAL}"
    draft = journal.with_suffix(NEW)
    pointers = [folder / f"{word}{ELSEWHERE}" for folder in folders[1:]]
    try:
        for row in rows:
            _put(row.new, targets[row.path], _mode(row.path))
            if row.existed and len(rows) > 1:
                _keep(row)
        for pointer in pointers:
            _put(pointer, os.path.relpath(journal, pointer.parent).encode())
        if len(rows) > 1:
            _put(draft, _journal(rows, True, journal.parent))
            for folder in folders:
                _sync(folder)
            os.replace(draft, journal)
            _sync(journal.parent)
        for row in rows:
            os.replace(row.new, row.path)
        for folder in folders:
            _sync(folder)
    except BaseException:
        if journal.exists():
            _turn_back(rows, draft, journal)
        _clear(rows, [journal, draft, *pointers])
        raise
    _clear(rows, [journal, draft, *pointers])


def _keep(row: _Row) -> None:
    """The old file under a second name, or a copy where there are no links."""
    try:
        os.link(row.path, row.old)
    except OSError:
        _put(row.old, row.path.read_bytes(), _mode(row.path))


def _turn_back(rows: Sequence[_Row], draft: Path, journal: Path) -> None:
    """Undo renames: the journal is turned round first, so that a kill here does no harm."""
    with suppress(OSError):
        _put(draft, _journal(rows, False, journal.parent))
        os.replace(draft, journal)
    for row in rows:
        row.back()


def _clear(rows: Sequence[_Row], leftovers: Sequence[Path]) -> None:
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
                row.back()
            elif row.new.exists():
                os.replace(row.new, row.path)
        for folder_of_row in {row.path.parent for row in rows}:
            _sync(folder_of_row)
        _clear(rows, [journal])


def _sweep(folder: Path) -> None:
    for path in _leftovers(folder):
        with suppress(OSError):
            path.unlink()


def _journal(rows: Sequence[_Row], forward: bool, folder: Path) -> bytes:
    files = [[*(os.path.relpath(path, folder) for path in (r.path, r.new, r.old)), r.existed] for r in rows]
    return json.dumps({"irbcal": "journal", "forward": forward, "files": files}).encode()


def _read_journal(journal: Path) -> tuple[list[_Row], bool]:
    """Rows and direction. A journal is synced before it has its name: one that cannot be read is none of ours."""
    try:
        content = json.loads(journal.read_bytes())
        rows = []
        for path, new, old, existed in content["files"]:
            row = _Row(journal.parent / path, journal.parent / new, journal.parent / old, bool(existed))
            if _belongs(row, journal):
                rows.append(row)
        return rows, bool(content["forward"])
    except (ValueError, KeyError, TypeError, IndexError):
        return [], True


def _belongs(row: _Row, journal: Path) -> bool:
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


def _put(path: Path, content: bytes, mode: int | None = None) -> None:
    with open(path, "xb") as stream:
        stream.write(content)
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
