"""Writing files whole or not at all, and never over what was read."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from irbcal.errors import CalibrationError


def write_together(folder: str | Path, contents: Mapping[str, bytes]) -> None:
    """Write files into a folder so that either all are new or all are as before.

    Each file is written and flushed under a temporary name first; then all are renamed. If a rename
    fails, those done are taken back.

    Parameters
    ----------
    folder : str or Path
    contents : dict of str to bytes

    Raises
    ------
    CalibrationError
        If the folder cannot be written.
    """
    folder = Path(folder)
    done: list[str] = []
    taken = [name for name in contents if (folder / name).is_dir()]
    if taken:
        raise CalibrationError("expected a file to write, found a folder", file=folder / taken[0])
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".irbcal-", dir=folder) as temporary:
            new, old = Path(temporary, "new"), Path(temporary, "old")
            new.mkdir()
            old.mkdir()
            for name, content in contents.items():
                with open(new / name, "wb") as stream:
                    stream.write(content)
                    stream.flush()
                    os.fsync(stream.fileno())
            try:
                for name in contents:
                    if (folder / name).exists():
                        os.link(folder / name, old / name)
                    done.append(name)
                    os.replace(new / name, folder / name)
            except BaseException:
                for name in done:
                    if (old / name).exists():
                        os.replace(old / name, folder / name)
                    elif not (new / name).exists():
                        with suppress(FileNotFoundError):
                            os.unlink(folder / name)
                raise
    except OSError as error:
        raise CalibrationError(f"cannot write to this folder: {error.strerror}", file=folder) from None


def refuse_to_overwrite(out: str | Path, *inputs: str | Path | None) -> None:
    """Refuse a file to write that is one of those to read.

    Raises
    ------
    CalibrationError
        If it is.
    """
    for path in inputs:
        if path is not None and Path(out).exists() and Path(path).exists() and os.path.samefile(out, path):
            raise CalibrationError("this is the file to read from: name another one to write", file=out)


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
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=".irbcal-", dir=folder)
        os.close(handle)
        os.unlink(name)
    except FileExistsError:
        raise CalibrationError("expected a folder to write to, found a file", file=folder) from None
    except OSError as error:
        raise CalibrationError(f"cannot write to this folder: {error.strerror}", file=folder) from None
    taken = [name for name in names if (folder / name).is_dir()]
    if taken:
        raise CalibrationError("expected a file to replace, found a folder", file=folder / taken[0])
    return made


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
    made: list[Path] = []
    try:
        for folder in folders:
            made += check_writable(folder, names)
        yield
    except BaseException:
        for folder in made:  # an empty folder would look like a result
            with suppress(OSError):
                Path(folder).rmdir()
        raise
