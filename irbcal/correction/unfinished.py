"""What an interrupted correction of a long table has done, beside the file that it was to write.

``NAME.unfinished`` holds the rows that are corrected, a table of its own; ``NAME.unfinished.npz`` what is to be
reported of them, and for which call, so that the same call goes on. The second is written last and names the content
of the first: what was cut off, was changed or is of another call is not taken.
"""

from __future__ import annotations

import json
import shutil
import zipfile
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from irbcal.arrays import FloatArray
from irbcal.correction.program import Note, Unchanged
from irbcal.measurement.long_files import digest_of


@dataclass
class CorrectedPieces:
    """What was done of a long table."""

    pieces: int = 0
    """How many, from the first."""
    unchanged_targets: list[Unchanged] = field(default_factory=list)
    notes: list[Note] = field(default_factory=list)
    cautions: list[str] = field(default_factory=list)
    """Of all pieces."""
    unchanged: int = 0
    shifts: list[FloatArray] = field(default_factory=list)
    """From the wanted to the fake poses, metres."""


def _rows(out: Path) -> Path:
    return out.with_name(f"{out.name}.unfinished")


def _report(out: Path) -> Path:
    return out.with_name(f"{out.name}.unfinished.npz")


def keep(out: Path, written: Path, call: Sequence[object], corrected: CorrectedPieces) -> None:
    """Keep what was written so far.

    Parameters
    ----------
    out : Path
        The file that was to be written.
    written : Path
        What is there of it, a table of its own.
    call : sequence
        What the result depends on, as JSON can hold it.
    corrected : CorrectedPieces
    """
    forget(out)
    shutil.copyfile(written, _rows(out))
    counts = {
        "pieces": corrected.pieces,
        "left": corrected.unchanged_targets,
        "notes": corrected.notes,
        "cautions": corrected.cautions,
    }
    text = json.dumps({"call": call, "rows": digest_of(_rows(out)), "unchanged": corrected.unchanged, **counts})
    with open(_report(out), "wb") as stream:
        np.savez(stream, report=np.array(text), shifts=np.concatenate(corrected.shifts))


def resumed(out: Path, call: Sequence[object]) -> tuple[Path, CorrectedPieces] | None:
    """The rows that the same call has corrected, and what it did; None where it has not."""
    try:
        with np.load(_report(out), allow_pickle=False) as content:
            report, shifts = json.loads(str(content["report"])), np.asarray(content["shifts"], dtype=float)
        if report["call"] != json.loads(json.dumps(call)) or report["rows"] != digest_of(_rows(out)):
            return None
        return _rows(out), CorrectedPieces(
            int(report["pieces"]),
            [Unchanged(*left) for left in report["left"]],
            [Note(*note) for note in report["notes"]],
            [str(caution) for caution in report["cautions"]],
            int(report["unchanged"]),
            [shifts],
        )
    except (OSError, EOFError, ValueError, KeyError, TypeError, zipfile.BadZipFile):
        return None


def forget(out: Path) -> None:
    """Remove what was kept."""
    for path in (_report(out), _rows(out)):
        with suppress(OSError):
            path.unlink()
