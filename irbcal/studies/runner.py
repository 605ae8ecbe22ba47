"""A study on all cores, in a folder that keeps every finished repetition.

``settings.json``, ``results.csv``, ``tables.md`` and ``page.html``; ``parts/`` holds the rows and the errors one by one
of each repetition. A second call with the same settings does only what is missing.
"""

import hashlib
import io
import json
import os
import signal
import threading
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import connection, get_context, parent_process
from pathlib import Path

import numpy as np
import pandas as pd

from irbcal.cell import simulation
from irbcal.errors import IrbcalError, MeasurementError
from irbcal.studies import repetition as study
from irbcal.studies import tables as study_tables

FORMAT = 1
"""Of the folder and of what the numbers mean: a change makes older folders strangers."""
SETTINGS, RESULTS, TABLES, PAGE, PARTS = "settings.json", "results.csv", "tables.md", "page.html", "parts"
NOTE = "SIMULATED: everything here was measured in the virtual cell, nothing on a real robot."
ONE_THREAD = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a call has done.

    Attributes
    ----------
    tables : list of Table
        All that the folder can fill.
    frame : DataFrame
        ``results.csv``.
    done, kept : int
        Repetitions computed by this call, and found finished.
    """

    tables: list
    frame: pd.DataFrame
    done: int
    kept: int


def run(settings, folder, jobs=None, only=None, report=lambda text: None):
    """Do what is missing of a study and write its files.

    Parameters
    ----------
    settings : Settings
    folder : str or Path
    jobs : int, optional
        Processes; as many as there are cores unless given. The results do not depend on it. Started from a script,
        that needs the usual ``if __name__ == "__main__"``.
    only : sequence of str, optional
        Tables (`irbcal.studies.tables.TABLES`) whose repetitions are computed; all unless given.
    report : callable
        Called with a text after each repetition.

    Returns
    -------
    Outcome

    Raises
    ------
    MeasurementError
        If a table is unknown or the folder holds another study or something damaged.
    CalibrationError
        If the folder cannot be written.
    KeyboardInterrupt
        After repetitions under way were finished and kept.
    """
    folder = Path(folder)
    wanted = selected(settings, only)
    open_folder(settings, folder)
    missing = [r for r in wanted if not (folder / PARTS / f"{r.name}.csv").exists()]
    if missing:
        stage = study.Stage.of(settings)
        report("poses measured")
        _compute(stage, missing, folder, jobs or cores(), report)
    found = write(settings, folder)
    return Outcome(*found, len(missing), len(wanted) - len(missing))


def selected(settings, only):
    """Repetitions of some tables (all for None), in the study's order."""
    every = study.repetitions(settings)
    if not only:
        return every
    unknown = [name for name in only if name not in study_tables.TABLES]
    if unknown:
        raise MeasurementError(f"unknown table {unknown[0]!r}: tables are {', '.join(study_tables.TABLES)}")
    table = study_tables.needed(settings)
    names = {r for name in only for r in table[name]}
    return [r for r in every if r in names]


def missing(settings, folder, only=None):
    """How many repetitions are still to be done."""
    return sum(not (Path(folder) / PARTS / f"{r.name}.csv").exists() for r in selected(settings, only))


def cores():
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def open_folder(settings, folder):
    """Make the folder, or see that it belongs to the same study.

    Raises
    ------
    MeasurementError
        If it belongs to another.
    """
    from irbcal.files.atomic import check_writable, write_together

    path = folder / SETTINGS
    check_writable(folder)
    document = {"simulated": True, "note": NOTE, "format": FORMAT, "settings": settings.document()}
    document["cell_sha256"] = _cell_digest(settings)
    document["sha256"] = hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()
    if not path.exists():
        strangers = [name for name in (RESULTS, TABLES, PAGE, PARTS) if (folder / name).exists()]
        if strangers:
            raise MeasurementError(f"{folder / strangers[0]}: results without {SETTINGS}: choose another folder")
        write_together(folder, {SETTINGS: (json.dumps(document, indent=1) + "\n").encode()})
        return
    try:
        found = json.loads(path.read_text())
        if found["sha256"] == document["sha256"]:
            return
        differences = [
            f"{name} {_text(found['settings'].get(name))}, not {_text(value)}"
            for name, value in document["settings"].items()
            if found["settings"].get(name) != value
        ]
    except (ValueError, KeyError, TypeError, AttributeError):
        raise MeasurementError(f"{path}: these are not the settings of a study: choose another folder") from None
    what = "; ".join(differences) or "another version of the virtual cell"
    raise MeasurementError(f"{path}: this folder holds a study with {what}: choose another folder")


def _text(value):
    return ",".join(map(str, value)) if isinstance(value, list) else str(value)


def _cell_digest(settings):
    """Fingerprint of all that the virtual cell hides."""
    truth = simulation.open_cell("irb1600", seed=settings.seed).truth()
    return hashlib.sha256(json.dumps(truth, sort_keys=True).encode()).hexdigest()


# --- computing --------------------------------------------------------------------------------------------


def _compute(stage, repetitions, folder, jobs, report):
    """Run repetitions in processes of one thread each, the longest first, and keep each as it ends."""
    (folder / PARTS).mkdir(exist_ok=True)
    order = sorted(repetitions, key=lambda r: -r.measures)
    workers = min(jobs, len(order))
    done, pool = 0, ProcessPoolExecutor(workers, get_context("spawn"), initializer=_start, initargs=(stage,))
    futures = {}
    try:
        with _quiet_start():
            futures = {pool.submit(_work, repetition): repetition for repetition in order}
        for future in as_completed(futures):
            _keep(folder, futures.pop(future), *future.result())
            done += 1
            report(f"{done} of {len(order)} calibrations")
    except BrokenProcessPool:
        raise IrbcalError(
            f"a process of the study ended by itself (out of memory?) after {done} of {len(order)} calibrations: the "
            "same call goes on from there"
        ) from None
    except BaseException:
        pool.shutdown(wait=True, cancel_futures=True)
        for future, repetition in futures.items():
            if future.done() and not future.cancelled() and future.exception() is None:
                _keep(folder, repetition, *future.result())
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _quiet_start():
    """Processes started here use one thread each for linear algebra and leave Ctrl-C to this one."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    main = threading.current_thread() is threading.main_thread()
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN) if main else None
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
        if main:
            signal.signal(signal.SIGINT, handler)


def _start(stage):
    global _stage
    _stage = stage
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent():
    """A killed study leaves no process behind."""
    connection.wait([parent_process().sentinel])
    os._exit(1)


def _work(repetition):
    return part(_stage, repetition)


def part(stage, repetition):
    """A repetition as the two files that keep it.

    Returns
    -------
    rows, series : bytes
        CSV of the rows; the errors one by one as a NumPy archive.
    """
    rows, series = study.run(stage, repetition)
    text = pd.DataFrame(rows, columns=list(study.COLUMNS)).to_csv(index=False, float_format="%.6f", lineterminator="\n")
    stream = io.BytesIO()
    np.savez_compressed(stream, **series)
    return text.encode(), stream.getvalue()


def _keep(folder, repetition, rows, series):
    from irbcal.files.atomic import write_together

    write_together(folder / PARTS, {f"{repetition.name}.npz": series, f"{repetition.name}.csv": rows})


# --- reading and writing ----------------------------------------------------------------------------------


def read_rows(path):
    """Rows of ``results.csv`` or of a part.

    Raises
    ------
    MeasurementError
        If they are not the rows of a study.
    """
    words = dict.fromkeys(("repetition", "model", "method", "kind", "area", "targets", "quantity", "unit"), str)
    try:
        frame = pd.read_csv(path, dtype=words, keep_default_na=False)
        good = list(frame.columns) == list(study.COLUMNS) and len(frame) > 0
        good = good and all(frame[name].dtype.kind in "if" for name in study.COLUMNS if name not in words)
    except (OSError, ValueError):
        good = False
    if not good:
        raise MeasurementError(f"{path}: these are not the rows of a study: delete it to compute them again")
    return frame


def read_series(folder, repetition):
    """Errors of a finished repetition one by one, mm and degrees, under ``kind/area/payload/quantity``."""
    path = Path(folder) / PARTS / f"{repetition.name}.npz"
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as archive:
            return dict(archive)
    except Exception:  # zip, zlib and numpy each have errors of their own for damage
        raise MeasurementError(f"{path}: damaged: delete it and {repetition.name}.csv to compute it again") from None


def write(settings, folder):
    """Write results, tables and page from the parts at hand.

    Returns
    -------
    tables : list of Table
    frame : DataFrame
    """
    from irbcal.files.atomic import write_together
    from irbcal.studies import page as study_page

    folder = Path(folder)
    done = [r for r in study.repetitions(settings) if (folder / PARTS / f"{r.name}.csv").exists()]
    frames = [read_rows(folder / PARTS / f"{r.name}.csv") for r in done]
    for r, frame in zip(done, frames, strict=True):
        if set(frame["repetition"]) != {r.name}:
            raise MeasurementError(f"{folder / PARTS / r.name}.csv: expected the rows of {r.name}, found others")
    frame = pd.concat(frames, ignore_index=True)
    results = study_tables.Results(frame, settings)
    tables = study_tables.tables(results)
    series = {r: read_series(folder, r) for r in study_page.drawn(results)}
    contents = {
        RESULTS: frame.to_csv(index=False, float_format="%.6f", lineterminator="\n").encode(),
        TABLES: study_tables.markdown(tables, settings).encode(),
        PAGE: study_page.render(results, tables, series).encode(),
    }
    write_together(folder, contents)
    return tables, frame
