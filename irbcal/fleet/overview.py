"""What a store is for: adding calibration folders, listing and exporting them, and what changed over time."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date, datetime, timezone
from itertools import groupby, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np

from irbcal import parallel
from irbcal.errors import CalibrationError, IdentificationError, IrbcalError, OptionError
from irbcal.fleet import batch
from irbcal.fleet.batch import STORE
from irbcal.fleet.comparison import Change, Pair, Sisters, StandsOut, agreeing, changes, high_wave, standing_out
from irbcal.fleet.store import TOGETHER, Dated, Estimate, Store, Stored, opened
from irbcal.identification.evidence import check_averaging, type_terms
from irbcal.identification.fit import certainty_of, identify
from irbcal.identification.term_sets import WIDE, name_of
from irbcal.io import calibration_folder
from irbcal.io.calibration_folder import JSON_NAME
from irbcal.io.opening import open_calibration
from irbcal.io.schema import Record
from irbcal.modeling.certainty import Certainty
from irbcal.modeling.parameters import default_level
from irbcal.safe_files import read_bytes, write_together
from irbcal.sessions import earlier_of
from irbcal.summary import Paragraph, Result, Table
from irbcal.units import UNIT_OUTSIDE
from irbcal.validation.verdict import verdict_of

if TYPE_CHECKING:
    import pandas as pd


def stored(
    folder: str | Path, robot: str | None = None, serial: str | None = None, measured: str | None = None
) -> Stored:
    """A calibration folder as the store takes it.

    Parameters
    ----------
    folder : str or Path
    robot, serial : str, optional
        Id and serial number; those that `irbcal.fleet.batch.fleet_calibrate` wrote beside it, or the folder's
        name, unless given.
    measured : str, optional
        Date, ISO 8601; that of the calibration where none is known.

    Raises
    ------
    CalibrationError
        If the folder is no calibration, or the date is none.
    """
    path = calibration_folder.folder_of(folder)
    record = open_calibration(path)
    mark = batch.read_mark(path)
    name = robot or (mark.id if mark else path.resolve().name)
    number = serial or (mark.serial if mark else name)
    day = measured or (mark.date if mark and mark.date else record.created[:10])
    try:
        when = date.fromisoformat(day)
    except ValueError:
        raise CalibrationError(f"expected a date such as 2026-03-17, found {day!r}", parameter="date") from None
    sha256 = hashlib.sha256(read_bytes(path / JSON_NAME, CalibrationError)).hexdigest()
    certainty = record.robot_calibrated().certainty
    assert certainty is not None
    sizes = _expected(record, certainty)
    fit = _estimate(certainty, sizes)
    return Stored(
        {"id": name, "serial": number, "type": record.robot.name},
        _head(record, path, when, sha256) | {"robot": name},
        fit,
        _level(record),
        _terms(record),
        tuple(_other(record, set(fit.names))),
        tuple((file.file, file.sha256) for file in record.data),
    )


def _estimate(certainty: Certainty, sizes: Mapping[str, float] | None = None, count: float = 1.0) -> Estimate:
    """Parameters of a certainty; ``count`` times their variance."""
    terms, flat = certainty.terms, len(certainty.covariance) - len(certainty.terms)
    natural = np.array([term.size for term in terms])
    expected = [sizes.get(term.group, 1.0) for term in terms] if sizes else [np.inf] * len(terms)
    return Estimate(
        tuple(name_of(term) for term in terms),
        tuple(term.unit for term in terms),
        np.array(certainty.coefficients),
        natural * expected,
        natural,
        count * np.array(certainty.covariance)[flat:, flat:],
    )


def _level(record: Record) -> Estimate | None:
    """The arm's own level fitted to the points of a calibration, a pose counted once.

    A level takes the points of a pose for independent, but their errors are mostly the pose's: its variances are too
    small by the number of points.
    """
    used = record.used_points(False)
    if used is None:
        return None
    points, arm = used[0], record.arm(calibrated=False)
    try:
        fit = identify(arm, points, default_level(arm))
    except IdentificationError:
        return None
    return _estimate(certainty_of(fit), count=max(1.0, len(points) / points.poses))


def _terms(record: Record) -> Estimate | None:
    """What all points of a calibration's last session show of the terms that a type is compared by."""
    arm = record.arm(calibrated=False)
    try:
        _, points, motion = earlier_of(record).sessions[-1]
        check_averaging(arm, points.poses)
        estimate = type_terms(arm, points, motion)
    except IrbcalError:
        return None
    natural = np.array([term.size for term in estimate.terms])
    return Estimate(
        tuple(name_of(term) for term in estimate.terms),
        tuple(term.unit for term in estimate.terms),
        np.array(estimate.values),
        WIDE * natural,
        natural,
        np.array(estimate.covariance),
    )


def _head(record: Record, folder: Path, measured: date, sha256: str) -> dict[str, Any]:
    proven, nominal, judged = record.heldout, record.heldout_nominal, verdict_of(record)
    return {
        "fingerprint": record.fingerprint,
        "measured": measured,
        "created": record.created,
        "added": datetime.now(timezone.utc).isoformat(timespec="seconds"),
        "folder": str(folder.resolve()),
        "model": record.model,
        "method": record.method,
        "simulated": record.simulated,
        "poses_fit": record.poses_fit,
        "poses_heldout": record.poses_heldout,
        "nominal_mean_mm": nominal.all.mean_mm if nominal else None,
        "heldout_mean_mm": proven.all.mean_mm if proven else None,
        "heldout_sigma_mm": proven.all.sigma_mm if proven else None,
        "heldout_max_mm": proven.all.max_mm if proven else None,
        "trusted": judged.trusted,
        "verdict": judged.sentence(),
        "json_sha256": sha256,
        "urdf_sha256": record.calibrated_urdf_sha256,
        "nominal_urdf_sha256": record.robot.urdf_sha256,
    }


def _other(record: Record, names: set[str]) -> list[dict[str, Any]]:
    """Base, targets and what is held, as listed."""
    factor = {outside: (unit, size) for unit, (outside, size) in UNIT_OUTSIDE.items()}
    out: list[dict[str, Any]] = []
    for parameter in record.parameters:
        if parameter.name in names or not (parameter.name.startswith(("base", "target")) or parameter.state == "held"):
            continue
        unit, size = factor.get(parameter.unit, (parameter.unit, 1.0))
        std = None if parameter.std is None else parameter.std * size
        value = parameter.value * size
        out.append({"name": parameter.name, "value": value, "std": std, "unit": unit, "state": parameter.state})
    return out


def _expected(record: Record, certainty: Certainty) -> Mapping[str, float]:
    """Prior standard deviation of each group of an average of models, in natural sizes; empty for levels.

    A group that only some of the averaged models have is zero in the others, which its coefficients' second moments
    tell.
    """
    if record.evidence is None:
        return {}
    terms, flat = certainty.terms, len(certainty.covariance) - len(certainty.terms)
    natural = np.array([term.size for term in terms])
    moments = (np.diagonal(certainty.covariance)[flat:] + certainty.coefficients**2) / natural**2
    out = {}
    for group in record.evidence.groups:
        of_group = np.array([term.group == group.name and not high_wave(name_of(term)) for term in terms], dtype=bool)
        second_moment = group.estimate**2 + group.std**2
        share = float(moments[of_group].mean()) / second_moment if of_group.any() and second_moment > 0.0 else 1.0
        out[group.name] = group.size * min(1.0, share) ** 0.5
    return out


EXPORTED = ("robots", "calibrations", "parameters", "files")


@dataclass(frozen=True, eq=False, repr=False)
class Added(Result):
    """What was added to a store.

    Attributes
    ----------
    store : str
    added, there : tuple of str
        Folders that are new to it, and those that it had.
    """

    store: str
    added: tuple[str, ...]
    there: tuple[str, ...]

    def report(self) -> Sequence[Paragraph]:
        """How many."""
        return [f"{len(self.added)} calibrations added to {self.store}, {len(self.there)} were there"]

    CONTENT = "store added there"


@parallel.on_workers
def fleet_add(
    calibrations: Sequence[str | Path] | str | Path,
    store: str | Path = STORE,
    *,
    id: str | None = None,
    serial: str | None = None,
    date: str | None = None,
    jobs: int | None = None,
    progress: Callable[[str], Any] | None = None,
) -> Added:
    """Add calibrations to a store; what it has already is found, not added again.

    Parameters
    ----------
    calibrations : str, Path or sequence of them
        Calibration folders, or folders of `irbcal.fleet_calibrate`, of which all calibrated robots are taken.
    store : str or Path
        File (SQLite; made where there is none), or ``postgresql+psycopg://USER@HOST/NAME``.
    id, serial, date : str, optional
        Of a single calibration: which robot it is, its serial number, and when it was measured (2026-03-17). Folders of
        a fleet know that; else they are the folder's name, the same, and when it was calibrated.
    jobs : int, optional
        Processes that fit levels and terms to the calibrations' points; as many as there are cores unless given.
    progress : callable, optional
        Called with a short text as they are added.

    Raises
    ------
    CalibrationError
        If one is no calibration, contradicts the store, or the store fails: those before it stay added.
    Interrupted
        After those under way were added.
    OptionError
        If ``id``, ``serial`` or ``date`` are given for several.
    """
    paths = [calibrations] if isinstance(calibrations, (str, Path)) else list(calibrations)
    folders = [folder for path in paths for folder in _folders(Path(path))]
    for option, value in (("id", id), ("serial", serial), ("date", date)):
        if value is not None and len(folders) != 1:
            raise OptionError(f"{option}: it is of a single calibration, found {len(folders)}", parameter=option)
    for folder in folders:  # before anything is added
        if not (folder / JSON_NAME).is_file():
            raise CalibrationError("not a calibration folder", file=folder)
    new: dict[int, bool] = {}
    if not folders:
        raise OptionError("calibrations: expected one or more folders, found none", parameter="calibrations")
    first = stored(folders[0], id, serial, date)  # no store is made for what is none
    with opened(store, create=True) as database:
        waiting = {0: first}
        written = time.monotonic()

        def write() -> None:
            nonlocal written
            if not waiting:
                return
            new.update(zip(waiting, database.add_all(list(waiting.values())), strict=True))
            waiting.clear()
            written = time.monotonic()
            if progress is not None:
                progress(f"{len(new)} of {len(folders)} calibrations")

        try:
            for index, calibration in parallel.each(_stored, None, folders[1:], seconds=ADDITION_S):
                waiting[index + 1] = calibration
                if len(waiting) >= BATCH or time.monotonic() - written > BATCH_S:
                    write()
        except KeyboardInterrupt:
            write()
            raise parallel.Interrupted(len(folders) - len(new), "calibrations to add") from None
        except IrbcalError:
            write()  # those before it stay
            raise
        write()
    name = database.engine.url.render_as_string(hide_password=True) if "://" in str(store) else str(store)
    added, known_before = (tuple(str(folders[k]) for k in sorted(new) if new[k] is is_new) for is_new in (True, False))
    return Added(name, added, known_before)


ADDITION_S = 0.12
"""Seconds that refitting a calibration for the store takes, about."""
BATCH, BATCH_S = 200, 1.0
"""Calibrations that are added in one transaction at most, and seconds after which those that are ready are added."""


def _stored(_: None, folder: Path) -> Stored:
    """In a worker: a calibration folder as the store takes it."""
    return stored(folder)


def _folders(path: Path) -> list[Path]:
    """The calibration folders that a path stands for: itself, or those of a fleet."""
    from irbcal.fleet.batch import MARK, SIGN

    if (path / SIGN).is_file() and not (path / JSON_NAME).exists():
        folders = sorted(child for child in path.iterdir() if (child / MARK).is_file())
        if not folders:
            raise CalibrationError("a fleet without a calibrated robot", file=path)
        return folders
    return [path]


LISTED = 1_000
"""Robots that are listed for people."""


@dataclass(frozen=True, eq=False, repr=False)
class Overview(Result):
    """All robots of a store.

    Attributes
    ----------
    latest : tuple of Stored
        The last calibration of each robot, robots by their ids; covariances left out.
    times : dict of str to int
        How many calibrations each robot has.
    simulated : bool
        Whether any calibration is from simulated measurements.
    changes : dict of str to Change
        What changed between the last two calibrations of each robot that has two.
    outstanding : dict of str to tuple of StandsOut
        Robots that stand out of their type.
    """

    latest: tuple[Stored, ...]
    times: dict[str, int]
    simulated: bool
    changes: dict[str, Change]
    outstanding: dict[str, tuple[StandsOut, ...]]

    def report(self) -> Sequence[Paragraph]:
        """How many; a row a robot; what changed; which stand out."""
        kind = "SIMULATED: " if self.simulated else ""
        types = {stored.robot["type"] for stored in self.latest}
        changed = sum(step.real for step in self.changes.values())
        out = sum(map(len, self.outstanding.values()))
        headline = (
            f"{kind}{sum(self.times.values())} calibrations of {len(self.latest)} robots of {len(types)} "
            f"type{'s' if len(types) != 1 else ''}; {changed} changed since the calibration before, {out} stand out"
        )
        rows = tuple(
            (
                stored.robot["id"],
                stored.robot["serial"],
                stored.robot["type"],
                str(stored.measured),
                self.times[stored.robot["id"]],
                stored.calibration["model"],
                stored.calibration["nominal_mean_mm"],
                stored.calibration["heldout_mean_mm"],
                stored.calibration["heldout_max_mm"],
            )
            for stored in self.latest[:LISTED]
        )
        columns = ("id", "serial", "type", "last", "times", "model", "nominal mm", "calibrated mm", "largest mm")
        changes = [
            f"{robot}: {sentence}" for robot, step in self.changes.items() if step.real for sentence in step.in_words()
        ]
        outstanding = [
            f"{entry.robot} stands out of type {type} ({entry.deviations:.0f} standard deviations): {entry.words}."
            for type, entries in self.outstanding.items()
            for entry in entries
        ]
        more = len(self.latest) - LISTED
        others = [f"and {more} more robots: --json, --type or irbcal fleet export name them"] if more > 0 else []
        return [headline, Table("Robots, by their last calibration", columns, rows), *others, *changes, *outstanding]

    CONTENT = "simulated robots=_listed changed outstanding"

    def _listed(self) -> list[dict[str, Any]]:
        return [
            {**stored.robot, "times": self.times[stored.robot["id"]], **stored.calibration} for stored in self.latest
        ]

    @property
    def changed(self) -> dict[str, list[str]]:
        """What really changed of each robot, in sentences."""
        return {robot: step.in_words() for robot, step in self.changes.items() if step.real}


def fleet_list(store: str | Path = STORE, *, type: str | None = None, report: str | Path | None = None) -> Overview:
    """All robots of a store, what changed in their last calibration, and which stand out of their type.

    Parameters
    ----------
    store : str or Path
        See `fleet_add`.
    type : str, optional
        Only robots of this type (name of the nominal robot).
    report : str or Path, optional
        Page to write it to, HTML.

    Raises
    ------
    CalibrationError
        If the store cannot be read, or has no such robots.
    """
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
        write_together(Path(report).parent, {Path(report).name: render_store(overview).encode()})
    return overview


def _steps(
    database: Store, robot: str | None = None, type: str | None = None, last: int | None = None
) -> tuple[list[Change], list[Dated]]:
    """Changes of robots from calibration to calibration; the last two levels of each, without factors."""
    steps: list[Change] = []
    fleet: list[Dated] = []
    changed: list[tuple[int, Dated]] = []
    pairs: list[Pair] = []

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
        if len(pairs) >= TOGETHER:
            compare()
    compare()
    if not changed:
        return steps, fleet
    about = fleet
    if robot is not None:
        about = list(database.estimates("level", type=changed[0][1].type, last=2, factors=False))
    sisters = Sisters(about)
    for k, second in changed:
        others = database.with_factors("level", sisters.perhaps_of(second))
        steps[k] = replace(steps[k], sisters=agreeing(second, others))
    return steps, fleet


@dataclass(frozen=True, eq=False, repr=False)
class Drift(Result):
    """What changed in robots from calibration to calibration.

    Attributes
    ----------
    what : str
        The robot, with its serial number and type; or how many.
    simulated : bool
        Whether any calibration is from simulated measurements.
    changes : tuple of Change
        Robots by their ids, from each calibration to the next.
    """

    what: str
    simulated: bool
    changes: tuple[Change, ...]

    def report(self) -> Sequence[Paragraph]:
        """A sentence or more for each step; for those that are a change, where there are many robots."""
        kind = "SIMULATED: " if self.simulated else ""
        count = sum(step.real for step in self.changes)
        steps = f"{len(self.changes)} step{'s' if len(self.changes) != 1 else ''}"
        several = len({step.robot for step in self.changes}) > 1
        return [
            f"{kind}{self.what}: {count} of {steps} a change",
            *(
                f"{step.robot}: {sentence}" if several else sentence
                for step in self.changes
                if step.real or not several
                for sentence in step.in_words()
            ),
        ]

    CONTENT = "what changes=to_frame"
    ROWS = "changes"
    COLUMNS = "robot before after chi2 directions p changed=real sisters parameters words=in_words"


def fleet_drift(robot: str | None = None, store: str | Path = STORE) -> Drift:
    """What changed in robots between their calibrations by more than their uncertainty.

    Parameters
    ----------
    robot : str, optional
        Its id; all robots of the store unless given.
    store : str or Path
        See `fleet_add`.

    Raises
    ------
    CalibrationError
        If the store has fewer than two calibrations of it, or of any.
    """
    with opened(store) as database:
        counts = database.counts(robot=robot)
        if max((count for count, _ in counts.values()), default=0) < 2:
            count_text = "1 calibration" if counts else "no calibration"
            if robot is not None and not counts:
                count_text = f"none of the {len(database.robots())} robots is it, and no calibration"
            raise CalibrationError(
                f"{robot or 'robots'}: two calibrations are needed to see a change, found {count_text}", file=str(store)
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
        See `fleet_add`.
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
        If the store cannot be read or the file not be written.
    OptionError
        If there is no such table, or the ending is another.
    """
    from irbcal.options import checked

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
            rows = write_frames(database.frames(name), stream)

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
        [(name, known.get(str(name), types.get(column.dtype.kind, pa.string()))) for name, column in frame.items()]
    )


def render_store(overview: Overview) -> str:
    """The page of a store's robots."""
    from irbcal.plotting.charts import page_style
    from irbcal.templates import environment

    return (
        environment("irbcal.fleet")
        .get_template("store.html.j2")
        .render(
            title="Fleet",
            style=page_style(),
            simulated=overview.simulated,
            headline=overview.headline(),
            told=overview.report()[1:],
            is_table=lambda value: isinstance(value, Table),
        )
    )
