"""The folder of a study: it keeps every finished repetition and belongs to one study alone.

``settings.json``, ``results.csv``, ``tables.md`` and ``page.html``; ``parts/`` holds the rows and the errors one by one
of each repetition.
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from irbcal.atomic import check_writable, write_together
from irbcal.errors import MeasurementError
from irbcal.names import without_formulas
from irbcal.simulation import simulation
from irbcal.studies.figures import drawn
from irbcal.studies.page import render
from irbcal.studies.results import Results, Table
from irbcal.studies.settings import Repetition, Settings, repetitions
from irbcal.studies.tables import markdown, tables
from irbcal.studies.trial import COLUMNS

FORMAT = 1
"""Of the folder and of what the numbers mean: a change makes older folders strangers."""
SETTINGS, RESULTS, TABLES, PAGE, PARTS = "settings.json", "results.csv", "tables.md", "page.html", "parts"
NOTE = "SIMULATED: everything here was measured in the virtual cell, nothing on a real robot."


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
    """Keep a finished repetition, as `part` gives it."""
    write_together(folder / PARTS, {f"{repetition.name}.npz": series, f"{repetition.name}.csv": rows})


def part(rows: Sequence[Mapping[str, Any]], series: Mapping[str, NDArray[Any]]) -> tuple[bytes, bytes]:
    """What a trial gives as the two files that keep it.

    Returns
    -------
    rows, series : bytes
        CSV of the rows; the errors one by one as a NumPy archive.
    """
    text = without_formulas(pd.DataFrame(rows, columns=list(COLUMNS))).to_csv(
        index=False, float_format="%.6f", lineterminator="\n"
    )
    stream = io.BytesIO()
    arrays: dict[str, Any] = dict(series)
    np.savez_compressed(stream, **arrays)
    return text.encode(), stream.getvalue()


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


def write(settings: Settings, folder: Path) -> tuple[list[Table], pd.DataFrame]:
    """Write results, tables and page from the parts at hand.

    Returns
    -------
    tables : list of Table
    frame : DataFrame
    """
    done = [r for r in repetitions(settings) if is_kept(folder, r)]
    frames = [read_rows(folder / PARTS / f"{r.name}.csv") for r in done]
    for r, frame in zip(done, frames, strict=True):
        if set(frame["repetition"]) != {r.name}:
            raise MeasurementError(
                f"expected the rows of {r.name}, found others", file=folder / PARTS / f"{r.name}.csv"
            )
    whole = pd.concat(frames, ignore_index=True)
    results = Results(whole, settings)
    found = tables(results)
    contents = {
        RESULTS: without_formulas(whole).to_csv(index=False, float_format="%.6f", lineterminator="\n").encode(),
        TABLES: markdown(found, settings).encode(),
        PAGE: render(results, found, series_of(folder, results)).encode(),
    }
    write_together(folder, contents)
    return found, whole


def series_of(folder: Path, results: Results) -> dict[Repetition, dict[str, NDArray[Any]]]:
    """Errors one by one of all repetitions that are drawn."""
    return {r: read_series(folder, r) for r in drawn(results)}
