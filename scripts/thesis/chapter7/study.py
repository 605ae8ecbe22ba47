"""A study: chapter 7 of Nubiola 2011 repeated in the virtual cell on all cores, into a folder.

The folder belongs to one study. It holds ``settings.json``, ``results.csv``, ``tables.md`` and ``page.html``;
``parts/`` holds the rows and the single errors of each finished calibration: a second call computes what is missing.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from chapter7.page import render
from chapter7.settings import Repetition, Settings, repetitions
from chapter7.tables import TABLES as TABLE_NAMES
from chapter7.tables import Results, Table, markdown, needed, tables
from chapter7.trial import COLUMNS, Stage, run
from irbcal import parallel
from irbcal.errors import MeasurementError, OptionError
from irbcal.names import without_formulas
from irbcal.safe_files import check_writable, write_together
from irbcal.simulation import simulation

FORMAT = 1
"""Of the folder and of what the numbers mean: after a change, older folders are refused."""
SETTINGS, RESULTS, TABLES, PAGE, PARTS = "settings.json", "results.csv", "tables.md", "page.html", "parts"
NOTE = "SIMULATED: everything here was measured in the virtual cell, nothing on a real robot."

REPETITION_S = 1.0
"""Seconds that a repetition takes, about."""


@parallel.on_workers
def study(
    settings: Settings,
    out: str | Path,
    *,
    only: Sequence[str] = (),
    jobs: int | None = None,
    progress: Callable[[str], None] = lambda text: None,
) -> tuple[list[Table], int, int]:
    """Calibrate and verify a virtual robot again and again: Nubiola 2011, chapter 7, SIMULATED.

    Parameters
    ----------
    settings : Settings
    out : str or Path
        Folder of the study; where it holds one, what is missing of it is computed.
    only : sequence of str
        Tables (`TABLE_NAMES`) whose repetitions are computed; empty: all.
    jobs : int, optional
        Processes; as many as there are cores unless given. The results do not depend on it.
    progress : callable
        Called with a short text when the poses are measured and after each calibration.

    Returns
    -------
    tables : list of Table
        All that the folder can fill. Lengths in mm, angles in degrees.
    done, kept : int
        Repetitions computed by this call, and found finished.

    Raises
    ------
    OptionError
        If a table is unknown.
    MeasurementError
        If the folder holds another study or something damaged.
    CalibrationError
        If the folder cannot be written.
    Interrupted
        After repetitions under way were finished and kept.
    """
    folder, wanted = Path(out), selected(settings, only)
    open_folder(settings, folder)
    missing = [r for r in wanted if not is_kept(folder, r)]
    try:
        if missing:
            stage = Stage.of(settings)
            progress("poses measured")
            _compute(stage, missing, folder, progress)
    except KeyboardInterrupt:
        raise parallel.Interrupted(sum(not is_kept(folder, r) for r in wanted), "calibrations to do") from None
    return write(settings, folder), len(missing), len(wanted) - len(missing)


def selected(settings: Settings, only: Sequence[str]) -> list[Repetition]:
    """Repetitions of some tables (all for none), in the study's order."""
    every = repetitions(settings)
    if not only:
        return every
    unknown = [name for name in only if name not in TABLE_NAMES]
    if unknown:
        raise OptionError(f"unknown table {unknown[0]!r}: tables are {', '.join(TABLE_NAMES)}", parameter="only")
    table = needed(settings)
    names = {r for name in only for r in table[name]}
    return [r for r in every if r in names]


def _compute(stage: Stage, missing: Sequence[Repetition], folder: Path, progress: Callable[[str], None]) -> None:
    """Run repetitions, the longest first, and keep each as it ends."""
    (folder / PARTS).mkdir(exist_ok=True)
    order = sorted(missing, key=lambda r: -r.measures)
    try:
        for done, (k, files) in enumerate(parallel.each(finished, stage, order, seconds=REPETITION_S), start=1):
            keep(folder, order[k], *files)
            progress(f"{done} of {len(order)} calibrations")
    except parallel.WorkerLost as error:
        raise parallel.WorkerLost(f"{error}: the same call goes on from there") from None


def finished(stage: Stage, repetition: Repetition) -> tuple[bytes, bytes]:
    """A repetition, calibrated and tested: CSV of its rows, and the single errors as a NumPy archive."""
    rows, series = run(stage, repetition)
    text = without_formulas(pd.DataFrame(rows, columns=list(COLUMNS))).to_csv(
        index=False, float_format="%.6f", lineterminator="\n"
    )
    stream = io.BytesIO()
    arrays: dict[str, Any] = dict(series)
    np.savez_compressed(stream, **arrays)
    return text.encode(), stream.getvalue()


# --- the folder -------------------------------------------------------------------------------------------


def open_folder(settings: Settings, folder: Path) -> None:
    """Make the folder, or see that it belongs to the same study.

    Raises
    ------
    MeasurementError
        If it belongs to another.
    """
    path = folder / SETTINGS
    check_writable(folder)
    document: dict[str, Any] = {"simulated": True, "note": NOTE, "format": FORMAT, "settings": settings.document()}
    document["cell_sha256"] = _cell_digest(settings)
    document["sha256"] = hashlib.sha256(json.dumps(document, sort_keys=True).encode()).hexdigest()
    if not path.exists():
        strangers = [name for name in (RESULTS, TABLES, PAGE, PARTS) if (folder / name).exists()]
        if strangers:
            raise MeasurementError(f"results without {SETTINGS}: choose another folder", file=folder / strangers[0])
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
        raise MeasurementError("these are not the settings of a study: choose another folder", file=path) from None
    what = "; ".join(differences) or "another version of the virtual cell"
    raise MeasurementError(f"this folder holds a study with {what}: choose another folder", file=path)


def _text(value: Any) -> str:
    return ",".join(map(str, value)) if isinstance(value, list) else str(value)


def _cell_digest(settings: Settings) -> str:
    """Fingerprint of all that the virtual cell hides."""
    truth = simulation.open_cell("irb1600", seed=settings.seed).truth()
    return hashlib.sha256(json.dumps(truth, sort_keys=True).encode()).hexdigest()


def is_kept(folder: Path, repetition: Repetition) -> bool:
    """Whether a repetition is finished."""
    return (folder / PARTS / f"{repetition.name}.csv").exists()


def keep(folder: Path, repetition: Repetition, rows: bytes, series: bytes) -> None:
    """Keep a finished repetition, as `finished` gives it."""
    write_together(folder / PARTS, {f"{repetition.name}.npz": series, f"{repetition.name}.csv": rows})


def read_rows(path: str | Path) -> pd.DataFrame:
    """Rows of ``results.csv`` or of a part.

    Raises
    ------
    MeasurementError
        If they are not the rows of a study.
    """
    words = dict.fromkeys(("repetition", "model", "method", "kind", "area", "targets", "quantity", "unit"), str)
    try:
        frame = pd.read_csv(path, dtype=words, keep_default_na=False)
        good = list(frame.columns) == list(COLUMNS) and len(frame) > 0
        good = good and all(frame[name].dtype.kind in "if" for name in COLUMNS if name not in words)
    except (OSError, ValueError):
        good = False
    if not good:
        raise MeasurementError("these are not the rows of a study: delete it to compute them again", file=path)
    return frame


def read_series(folder: str | Path, repetition: Repetition) -> dict[str, NDArray[Any]]:
    """Errors of a finished repetition one by one, mm and degrees, under ``kind/area/payload/quantity``."""
    path = Path(folder) / PARTS / f"{repetition.name}.npz"
    try:
        with np.load(io.BytesIO(path.read_bytes()), allow_pickle=False) as archive:
            return dict(archive)
    except Exception:  # zip, zlib and numpy each have errors of their own for damage
        raise MeasurementError(f"damaged: delete it and {repetition.name}.csv to compute it again", file=path) from None


def write(settings: Settings, folder: Path) -> list[Table]:
    """Write results, tables and page from the finished repetitions."""
    done = [r for r in repetitions(settings) if is_kept(folder, r)]
    frames = [read_rows(folder / PARTS / f"{r.name}.csv") for r in done]
    for r, frame in zip(done, frames, strict=True):
        if set(frame["repetition"]) != {r.name}:
            raise MeasurementError(
                f"expected the rows of {r.name}, found others", file=folder / PARTS / f"{r.name}.csv"
            )
    frame = pd.concat(frames, ignore_index=True)
    results = Results(frame, settings)
    filled = tables(results)
    contents = {
        RESULTS: without_formulas(frame).to_csv(index=False, float_format="%.6f", lineterminator="\n").encode(),
        TABLES: markdown(filled, settings).encode(),
        PAGE: render(results, filled, cache(partial(read_series, folder))).encode(),
    }
    write_together(folder, contents)
    return filled
