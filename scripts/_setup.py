"""Makes .venv ready and runs irbcal, its tests or its documentation in it: what app, demo, test and docs share.

Needs Python's own modules alone, on Linux, macOS and Windows. pip takes no file whose SHA-256 is not in scripts/locks/.

.venv/.irbcal-stamp holds a fingerprint of what was installed and is written last; .venv/.irbcal-unfinished is there
from before the first step until then. So an interrupted set-up is seen, and starts again from nothing.
"""

from __future__ import annotations  # older ones come as far as the sentence that refuses them

import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
from contextlib import contextmanager
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
VENV = ROOT / ".venv"
WINDOWS = os.name == "nt"
PYTHON = VENV / ("Scripts/python.exe" if WINDOWS else "bin/python")
STAMP, UNFINISHED, OF_ROOT = VENV / ".irbcal-stamp", VENV / ".irbcal-unfinished", VENV / ".irbcal-root"
KERNEL = ("hatch_build.py", "irbcal/kernel/kernel.hpp", "irbcal/kernel/binding.cpp")
LOCKS = ("demo", "app", "test")
"""Names of scripts/locks/; each has what those before it have."""
SUITABLE = "import sys, ensurepip, venv; print(sys.version if sys.version_info >= (3, 10) else '')"
VERSION, VERSION_WITH_PIP = "import sys; print(sys.version)", "import pip, sys; print(sys.version)"


def run(lock: str, *command: str) -> None:
    """Set up, then become a command of .venv: ``python`` with arguments.

    Parameters
    ----------
    lock : {"demo", "app", "test"}
        What is installed: scripts/locks/LOCK.txt.
    *command : str
        Arguments of Python.
    """
    with taking_turns():
        install(lock)
    sys.stdout.flush()
    if WINDOWS:  # there, a program that becomes another one ends for the shell
        sys.exit(subprocess.run([str(PYTHON), *command], check=False).returncode)
    os.execv(PYTHON, [str(PYTHON), *command])


@contextmanager
def taking_turns():
    """Two runs at a time take turns: the folder itself is the lock, on Windows a file beside others' temporary ones."""
    if WINDOWS:
        import msvcrt

        name = f"irbcal-{hashlib.sha256(str(ROOT).encode()).hexdigest()[:16]}.lock"
        handle = os.open(Path(tempfile.gettempdir()) / name, os.O_RDWR | os.O_CREAT)
        waiting = True
        while waiting:
            try:
                msvcrt.locking(handle, msvcrt.LK_LOCK, 1)
                waiting = False
            except OSError:  # it gives up after ten seconds
                continue
    else:
        import fcntl

        handle = os.open(ROOT, os.O_RDONLY)
        fcntl.flock(handle, fcntl.LOCK_EX)
    try:
        yield
    finally:
        os.close(handle)


def install(lock: str) -> None:
    """Make .venv ready, unless it is."""
    if up_to_date(lock):
        return
    python = chosen_python()
    print(
        f"Setting up irbcal in {VENV} with pip; this happens once and takes about a minute ...",
        file=sys.stderr,
        flush=True,
    )
    if not is_sound(said_by(python, VERSION)):
        make_room()
        if subprocess.run([python, "-I", "-m", "venv", str(VENV)], check=False).returncode:
            fail(f"{python} could not make the virtual environment {VENV}.")
        OF_ROOT.write_text(str(ROOT), encoding="utf-8")
    UNFINISHED.touch()
    STAMP.unlink(missing_ok=True)
    # The build backend is among them; pip would take the newest one otherwise. The lock is complete: what it leaves out
    # is not needed. Python compiles what is imported when it is.
    pip("--require-hashes", "--no-deps", "--no-compile", "-r", str(ROOT / "scripts" / "locks" / f"{lock}.txt"))
    pip("--no-deps", "--no-build-isolation", "-e", str(ROOT))
    STAMP.write_text(fingerprint(lock), encoding="utf-8")
    UNFINISHED.unlink()


def up_to_date(lock: str) -> bool:
    """Whether .venv has what is wanted, or more."""
    if not STAMP.is_file() or UNFINISHED.exists() or not PYTHON.exists():
        return False
    wanted = {fingerprint(name) for name in LOCKS[LOCKS.index(lock) :]}
    if STAMP.read_text(encoding="utf-8").strip() not in wanted:
        return False
    asked_for = os.environ.get("PYTHON")
    return not asked_for or said_by(asked_for, VERSION) == said_by(str(PYTHON), VERSION)


def fingerprint(lock: str) -> str:
    """Of the project's place, its requirements, its kernel and the interpreter of .venv."""
    version = said_by(str(PYTHON), VERSION)
    digest = hashlib.sha256(repr((str(ROOT), version, lock)).encode())
    for name in ("pyproject.toml", f"scripts/locks/{lock}.txt", *KERNEL):
        digest.update(hashlib.sha256((ROOT / name).read_bytes()).digest())
    return digest.hexdigest()


def is_sound(version: str) -> bool:
    """Whether .venv is whole, in its own place, and of the wanted interpreter."""
    if UNFINISHED.exists() or not OF_ROOT.is_file():
        return False
    return (
        OF_ROOT.read_text(encoding="utf-8").strip() == str(ROOT) and said_by(str(PYTHON), VERSION_WITH_PIP) == version
    )


def chosen_python() -> str:
    """The interpreter that makes .venv: ``PYTHON`` of the environment, else this one, or the one behind its .venv."""
    python = os.environ.get("PYTHON") or getattr(sys, "_base_executable", "") or sys.executable
    if not said_by(python, SUITABLE):
        fail(
            f"irbcal needs Python 3.10 or newer with the modules venv and ensurepip (Debian: python3-venv), found "
            f"{python}: set PYTHON to one."
        )
    return python


def said_by(python: str, code: str) -> str:
    """What code prints; nothing where it fails."""
    try:
        done = subprocess.run([python, "-I", "-c", code], capture_output=True, text=True, check=False)
    except OSError:
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def make_room() -> None:
    """Empty .venv, if it is ours, with the mark of the unfinished there from first to last."""
    if VENV.exists() and not UNFINISHED.exists() and not OF_ROOT.exists() and any(VENV.iterdir()):
        fail(f"{VENV} was not made by irbcal's scripts: move it away, or run irbcal and pytest in it yourself.")
    VENV.mkdir(exist_ok=True)
    UNFINISHED.touch()
    for path in VENV.iterdir():
        if path != UNFINISHED:
            shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()


def pip(*arguments: str) -> None:
    """Install with pip, or end."""
    quiet = ("-m", "pip", "install", "-qq", "--no-input", "--disable-pip-version-check")
    if subprocess.run([str(PYTHON), "-I", *quiet, *arguments], check=False).returncode:
        fail("The set-up of irbcal failed in pip (see above); the next run starts it again.")


def fail(sentence: str) -> None:
    """End with a sentence."""
    print(sentence, file=sys.stderr)
    sys.exit(1)
