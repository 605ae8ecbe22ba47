"""What a store is asked for: its robots, what stands out, what changed over time, and tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain, groupby, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from irbcal.errors import CalibrationError, OptionError
from irbcal.fleet import STORE
from irbcal.fleet.comparison import Change, DatedPair, OthersOfType, agreeing, changes, standing_out
from irbcal.fleet.overview import Overview
from irbcal.fleet.store import READ_AT_A_TIME, Dated, Store, opened
from irbcal.fleet.store_page import render_store
from irbcal.safe_files import write_together
from irbcal.summary import Paragraph, Result
from irbcal.wording import counted, first_of, inflected

if TYPE_CHECKING:
    import pandas as pd


EXPORTED = ("robots", "calibrations", "parameters", "files")


def fleet_list(
    store: str | Path = STORE,
    *,
    type: str | None = None,
    report: str | Path | None = None,
    tolerance: float | None = None,
) -> Overview:
    """All robots of a store, what changed in their last calibration, and which stand out of their type.

    Parameters
    ----------
    store : str or Path
        See `irbcal.fleet_add`.
    type : str, optional
        Only robots of this type (name of the nominal robot).
    report : str or Path, optional
        Page to write it to, HTML: drift curves, the worst robot first, what changed, all robots.
    tolerance : float, optional
        Largest mean error that is wanted, metres: a line of the page, on which robots beyond it come first.

    Raises
    ------
    CalibrationError
        If the store cannot be read, or has no such robots.
    OptionError
        If the tolerance is none, or there is no page to draw it on.
    """
    if tolerance is not None and (report is None or not 0.0 < tolerance < np.inf):
        wanted = "a page to draw it on (--report)" if report is None else f"a length above zero, found {tolerance:g}"
        raise OptionError(f"tolerance: expected {wanted}", parameter="tolerance")
    with opened(store) as database:
        counts = database.counts(type)
        if not counts:
            raise CalibrationError(f"the store has no calibrations{f' of type {type}' if type else ''}")
        steps, fleet = _steps(database, type=type, last=2)
        fleet = list({level.robot: level for level in fleet}.values())
        latest = tuple(database.of_numbers([level.number for level in fleet], ()))
        by_type: dict[str, list[Dated]] = {}
        for level in fleet:
            by_type.setdefault(level.type, []).append(level)
        errors = {stored.robot["id"]: stored.calibration["heldout_mean_mm"] for stored in latest}
        outstanding = {kind: tuple(robots) for kind, some in by_type.items() if (robots := standing_out(some, errors))}
        times = {robot: count for robot, (count, _) in counts.items()}
        simulated = any(of_simulated for _, of_simulated in counts.values())
        overview = Overview(latest, times, simulated, {step.robot: step for step in steps}, outstanding)
        if report is not None:
            page = render_store(overview, database, store, Path(report).parent, type, tolerance)
            write_together(Path(report).parent, {Path(report).name: page.encode()})
    return overview


def _steps(
    database: Store, robot: str | None = None, type: str | None = None, last: int | None = None
) -> tuple[list[Change], list[Dated]]:
    """Changes of robots from calibration to calibration; the last two levels of each, without factors."""
    steps: list[Change] = []
    fleet: list[Dated] = []
    changed: list[tuple[int, Dated]] = []
    pairs: list[DatedPair] = []

    def compare() -> None:
        for step, (_, second) in zip(changes(pairs), pairs, strict=True):
            if step.real:
                changed.append((len(steps), second))
            steps.append(step)
        pairs.clear()

    levels = database.estimates("level", robot, type, last=last)
    for _, history in groupby(levels, key=lambda level: level.robot):
        calibrations = list(history)
        fleet += [level.light() for level in calibrations[-2:]]
        pairs += pairwise(calibrations)
        if len(pairs) >= READ_AT_A_TIME:
            compare()
    compare()
    if not changed:
        return steps, fleet
    about = fleet
    if robot is not None:
        about = list(database.estimates("level", type=changed[0][1].type, last=2, factors=False))
    of_type = OthersOfType(about)
    for k, second in changed:
        others = database.with_factors("level", of_type.perhaps_of(second))
        steps[k] = replace(steps[k], agreeing=agreeing(second, others))
    return steps, fleet


@dataclass(frozen=True, eq=False, repr=False)
class Drift(Result):
    """What changed in robots from calibration to calibration.

    Attributes
    ----------
    subject : str
        The robot, with its serial number and type; or how many.
    simulated : bool
        Whether any calibration is from simulated measurements.
    changes : tuple of Change
        Robots by their ids, from each calibration to the next.
    """

    subject: str
    simulated: bool
    changes: tuple[Change, ...]

    def report(self) -> Sequence[Paragraph]:
        """A sentence or more for each step; for those that are a change, where there are many robots."""
        kind = "SIMULATED: " if self.simulated else ""
        count = sum(step.real for step in self.changes)
        several = len({step.robot for step in self.changes}) > 1
        return [
            f"{kind}{self.subject}: {count} of {counted(len(self.changes), 'pair')} of successive calibrations "
            f"{inflected(count, 'shows', 'show')} a change",
            *(
                f"{step.robot}: {sentence}" if several else sentence
                for step in self.changes
                if step.real or not several
                for sentence in step.in_words()
            ),
        ]

    CONTENT = "subject changes=to_frame"
    ROWS = "changes"
    COLUMNS = "robot before after chi2 directions p changed=real agreeing parameters sentence=in_words"


def fleet_drift(robot: str | None = None, store: str | Path = STORE) -> Drift:
    """What changed in robots between their calibrations by more than their uncertainty.

    Parameters
    ----------
    robot : str, optional
        Its id; all robots of the store unless given.
    store : str or Path
        See `irbcal.fleet_add`.

    Raises
    ------
    CalibrationError
        If the store has fewer than two calibrations of it, or of any.
    """
    with opened(store) as database:
        counts = database.counts(robot=robot)
        if max((count for count, _ in counts.values()), default=0) < 2:
            if robot is not None and not counts:
                known = first_of([row["id"] for row in database.robots()], 20)
                raise CalibrationError(f"there is no robot {robot}, expected one of {known}", file=str(store))
            whose = f"of robot {robot}" if robot is not None else "of any robot"
            raise CalibrationError(
                f"a change needs two calibrations {whose}, found {'one' if counts else 'none'}", file=str(store)
            )
        steps, _ = _steps(database, robot)
        what = f"{len(counts)} robots"
        if robot is not None:
            head = next(database.calibrations(robot, last=1, parts=())).robot
            what = f"{robot} (serial {head['serial']}, {head['type']})"
    return Drift(what, any(of_simulated for _, of_simulated in counts.values()), tuple(steps))


def fleet_export(out: str | Path, store: str | Path = STORE, *, what: str = "parameters") -> int:
    """Write a table of a store as CSV or Parquet, by the file's ending.

    Parameters
    ----------
    store : str or Path
        See `irbcal.fleet_add`.
    out : str or Path
        A name that ends in ``.csv`` or ``.parquet``.
    what : str
        ``robots``, ``calibrations``, ``parameters`` (with robot and date) or ``files``.

    Returns
    -------
    int
        Rows.

    Raises
    ------
    CalibrationError
        If the store cannot be read, has no such rows, or the file cannot be written.
    OptionError
        If there is no such table, or the ending is another.
    """
    from irbcal.option_values import checked

    path, name = Path(out), checked("what", what, EXPORTED)
    if path.suffix not in (".csv", ".parquet"):
        raise OptionError(f"out: expected a name that ends in .csv or .parquet, found {path.name!r}", parameter="out")
    if path.suffix == ".parquet":
        try:
            import pyarrow  # noqa: F401
        except ImportError:
            raise OptionError("out: Parquet needs pyarrow: pip install 'irbcal[parquet]'", parameter="out") from None
    rows = 0

    def write(stream: BinaryIO) -> None:
        nonlocal rows
        with opened(store) as database:
            write_frames = _csv if path.suffix == ".csv" else _parquet
            frames = iter(database.frames(name))
            first = next(frames, None)
            if first is None or first.empty:
                raise CalibrationError(f"the store has no {name}: there is nothing to write", file=str(store))
            rows = write_frames(chain([first], frames), stream)

    write_together(path.parent, {path.name: write})
    return rows


def _csv(frames: Iterable[pd.DataFrame], stream: BinaryIO) -> int:
    """Write frames one below the other; how many rows they have."""
    from irbcal.names import csv_bytes

    rows = 0
    for k, frame in enumerate(frames):
        content = csv_bytes(frame)
        stream.write(content if k == 0 else content.partition(b"\n")[2])
        rows += len(frame)
    return rows


def _parquet(frames: Iterable[pd.DataFrame], stream: BinaryIO) -> int:
    """Write frames as row groups; how many rows they have."""
    import pyarrow as pa
    from pyarrow import parquet

    rows, writer = 0, None
    for frame in frames:
        table = pa.Table.from_pandas(frame, schema=_schema(frame), preserve_index=False)
        writer = writer or parquet.ParquetWriter(stream, table.schema, compression="zstd")
        writer.write_table(table)
        rows += len(frame)
    if writer is not None:
        writer.close()
    return rows


def _schema(frame: pd.DataFrame) -> Any:
    """Types of a table's columns, which do not depend on its rows."""
    import pyarrow as pa

    types = {"i": pa.int64(), "f": pa.float64(), "b": pa.bool_()}
    dates = {"measured": pa.date32()}
    floats = dict.fromkeys([name for name in frame if str(name).endswith("_mm")], pa.float64())
    known = {**dates, **floats}
    return pa.schema(
        [(name, known.get(str(name), types.get(column.dtype.kind, pa.string()))) for name, column in frame.items()],
        metadata={"made_by": "irbcal"},
    )
