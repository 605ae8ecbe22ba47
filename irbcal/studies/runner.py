"""A study on all cores: chapter 7 of Nubiola 2011 over again in the virtual cell.

A second call with the same settings does only what is missing in its folder, see `irbcal.studies.folder`.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from irbcal import parallel
from irbcal.errors import OptionError
from irbcal.studies import trial
from irbcal.studies.figures import Figure, figures, plotted
from irbcal.studies.folder import PAGE, PARTS, RESULTS, TABLES, is_kept, keep, open_folder, part, series_of, write
from irbcal.studies.page import verdict
from irbcal.studies.results import Results, Table
from irbcal.studies.settings import Repetition, Settings, repetitions
from irbcal.studies.stage import Stage
from irbcal.studies.tables import TABLES as TABLE_NAMES
from irbcal.studies.tables import needed
from irbcal.summary import Speaks, Told

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure as Canvas

REPETITION_S = 1.0
"""Seconds that a repetition takes, about."""

HEADLINES = ("7.13", "curve")
"""Tables that are told of unless others are asked for."""


@dataclass(frozen=True, eq=False, repr=False)
class Study(Speaks):
    """What the folder of a study holds, and what the call has done.

    Attributes
    ----------
    out : str
        The folder.
    settings : Settings
    tables : tuple of Table
        All that the folder can fill.
    frame : DataFrame
        ``results.csv``.
    done, kept : int
        Repetitions computed by this call, and found finished.
    seconds : float
    only : tuple of str
        Tables that were asked for; empty for all.
    """

    out: str
    settings: Settings
    tables: tuple[Table, ...]
    frame: pd.DataFrame
    done: int
    kept: int
    seconds: float
    only: tuple[str, ...] = ()

    def table(self, key: str) -> Table:
        """A table by its number, such as ``7.13``, or word.

        Raises
        ------
        OptionError
            If the folder cannot fill such a table.
        """
        for table in self.tables:
            if table.key == key:
                return table
        raise OptionError.unknown("table", key, [table.key for table in self.tables] or ["none"])

    def told(self) -> Sequence[Told]:
        """The tables that were asked for, or the main ones, and what was done."""
        out = [item for table in self.tables if table.key in (self.only or HEADLINES) for item in table.told()]
        files = ", ".join(str(Path(self.out) / name) for name in (PAGE, TABLES, RESULTS))
        return [
            *out,
            f"{self.done} calibrations done, {self.kept} found finished, {self.seconds:.1f} s",
            f"Written to {files}",
        ]

    def headline(self) -> str:
        """What the procedures came to."""
        said = verdict(Results(self.frame, self.settings))
        return said or f"SIMULATED: {self.done + self.kept} of {len(repetitions(self.settings))} calibrations"

    def to_dict(self) -> dict[str, Any]:
        """As JSON has it: what was done, and the tables that were asked for."""
        return {
            "out": self.out,
            "simulated": True,
            "settings": self.settings.document(),
            "done": self.done,
            "kept": self.kept,
            "seconds": self.seconds,
            "tables": {table.key: table.to_dict() for table in self.tables if not self.only or table.key in self.only},
        }

    def to_frame(self) -> pd.DataFrame:
        """The rows of ``results.csv``; columns as `irbcal.studies.trial.COLUMNS`."""
        return self.frame.copy()

    @property
    def figures(self) -> tuple[str, ...]:
        """Names of the figures that `plot` can draw."""
        return tuple(self._figures())

    def _figures(self) -> dict[str, Figure]:
        results = Results(self.frame, self.settings)
        return {item.key: item for item in figures(results) if results.has(*item.needs)}

    def plot(self, figure: str) -> Canvas:
        """One of the `figures`, such as ``figure-7-4``; errors one by one are read from the folder.

        Raises
        ------
        OptionError
            If the folder cannot fill such a figure.
        """
        every = self._figures()
        if figure not in every:
            raise OptionError.unknown("figure", figure, tuple(every) or ("none",))
        results = Results(self.frame, self.settings)
        return plotted(every[figure], results, series_of(Path(self.out), results))


@parallel.on_workers
def study(
    *,
    out: str | Path,
    procedures: Sequence[int] = Settings.procedures,
    each: int = Settings.each,
    model: str = Settings.model,
    method: str = Settings.method,
    seed: int = Settings.seed,
    points: int = Settings.points,
    poses_curve: Sequence[int] = Settings.curve,
    jobs: int | None = None,
    engine: str | None = None,
    only: Sequence[str] | None = None,
    progress: Callable[[str], None] | None = None,
) -> Study:
    """Calibrate and verify a virtual robot again and again: Nubiola 2011, chapter 7, SIMULATED.

    Parameters
    ----------
    out : str or Path
        Folder of the study; where it holds one, what is missing of it is done.
    procedures : sequence of int
        Numbers of identification measurements of the procedures.
    each : int
        Random choices of each number of measurements.
    model : str
        Error model of the procedures and of the curve: ``11``, ``16``, ``26`` or ``34``.
    method : str
        ``nelder-mead`` (as the thesis searched), ``max`` (its objective with a certificate) or ``least-squares``.
    seed : int
        Of poses, noise and choices.
    points : int
        Verification points in each area with each payload; an eighth of them with fake targets; 520 or more.
    poses_curve : sequence of int
        Numbers of measurements for the curve of the error; empty: no curve.
    jobs : int, optional
        Processes; as many as there are cores unless given; 1: this one. The results do not depend on it. Started from a
        script, more than one need the usual ``if __name__ == "__main__"``.
    engine : str, optional
        ``dask://HOST:PORT``: the workers of a Dask cluster in place of processes, see `irbcal.parallel.using`.
    only : sequence of str, optional
        Tables (`irbcal.studies.tables.TABLES`) whose repetitions are computed; all unless given.
    progress : callable, optional
        Called with a short text when the poses are measured and after each calibration.

    Returns
    -------
    Study
        Lengths in mm, angles in degrees, as in the thesis's tables.

    Raises
    ------
    OptionError
        If the settings make no study, or a table is unknown.
    MeasurementError
        If the folder holds another study or something damaged.
    CalibrationError
        If the folder cannot be written.
    Interrupted
        After repetitions under way were finished and kept.
    """
    start = time.perf_counter()
    settings = Settings(tuple(procedures), each, tuple(poses_curve), model, method, points, seed)
    folder, wanted = Path(out), selected(settings, only)
    done = _do_missing(settings, folder, wanted, progress or (lambda text: None))
    tables, frame = write(settings, folder)
    seconds = time.perf_counter() - start
    return Study(str(out), settings, tuple(tables), frame, done, len(wanted) - done, seconds, tuple(only or ()))


def _do_missing(settings: Settings, folder: Path, wanted: Sequence[Repetition], say: Callable[[str], None]) -> int:
    """Compute what the folder does not hold; how many repetitions that was."""
    open_folder(settings, folder)
    left = [r for r in wanted if not is_kept(folder, r)]
    if not left:
        return 0
    try:
        stage = Stage.of(settings)
        say("poses measured")
        _compute(stage, left, folder, say)
    except KeyboardInterrupt:
        raise parallel.Interrupted(sum(not is_kept(folder, r) for r in wanted), "calibrations to do") from None
    return len(left)


def selected(settings: Settings, only: Sequence[str] | None) -> list[Repetition]:
    """Repetitions of some tables (all for None), in the study's order."""
    every = repetitions(settings)
    if not only:
        return every
    unknown = [name for name in only if name not in TABLE_NAMES]
    if unknown:
        raise OptionError(f"unknown table {unknown[0]!r}: tables are {', '.join(TABLE_NAMES)}", parameter="only")
    table = needed(settings)
    names = {r for name in only for r in table[name]}
    return [r for r in every if r in names]


def missing(settings: Settings, folder: str | Path, only: Sequence[str] | None = None) -> int:
    """How many repetitions are still to be done."""
    return sum(not is_kept(Path(folder), r) for r in selected(settings, only))


# --- computing --------------------------------------------------------------------------------------------


def _compute(stage: Stage, repetitions: Sequence[Repetition], folder: Path, report: Callable[[str], None]) -> None:
    """Run repetitions, the longest first, and keep each as it ends."""
    (folder / PARTS).mkdir(exist_ok=True)
    order = sorted(repetitions, key=lambda r: -r.measures)
    try:
        for done, (place, kept) in enumerate(parallel.each(finished, stage, order, seconds=REPETITION_S), start=1):
            keep(folder, order[place], *kept)
            report(f"{done} of {len(order)} calibrations")
    except parallel.WorkerLost as error:
        raise parallel.WorkerLost(f"{error}: the same call goes on from there") from None


def finished(stage: Stage, repetition: Repetition) -> tuple[bytes, bytes]:
    """A repetition, calibrated and tested, as the two files that keep it."""
    return part(*trial.run(stage, repetition))
