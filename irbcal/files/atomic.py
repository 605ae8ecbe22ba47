"""Writing files whole or not at all, and never over what was read."""

import os
import tempfile
from contextlib import suppress
from pathlib import Path

from irbcal.errors import CalibrationError


def write_together(folder, contents):
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
    done = []
    taken = [name for name in contents if (folder / name).is_dir()]
    if taken:
        raise CalibrationError(f"{folder / taken[0]}: expected a file to write, found a folder")
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
        raise CalibrationError(f"{folder}: cannot write to this folder: {error.strerror}") from None


def refuse_to_overwrite(out, *inputs):
    """Refuse a file to write that is one of those to read.

    Raises
    ------
    CalibrationError
        If it is.
    """
    for path in inputs:
        if path is not None and Path(out).exists() and Path(path).exists() and os.path.samefile(out, path):
            raise CalibrationError(f"{out}: this is the file to read from: name another one to write")


def check_writable(folder, names=()):
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
    folder = Path(folder)
    made = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=".irbcal-", dir=folder)
        os.close(handle)
        os.unlink(name)
    except FileExistsError:
        raise CalibrationError(f"{folder}: expected a folder to write to, found a file") from None
    except OSError as error:
        raise CalibrationError(f"{folder}: cannot write to this folder: {error.strerror}") from None
    taken = [name for name in names if (folder / name).is_dir()]
    if taken:
        raise CalibrationError(f"{folder / taken[0]}: expected a file to replace, found a folder")
    return made
