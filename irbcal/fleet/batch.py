"""Calibrating a fleet: every robot of a list into a folder of its own, and a page of all."""

from __future__ import annotations

import hashlib
import json
import re
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import date
from pathlib import Path
from typing import Any

from irbcal import parallel
from irbcal.calibration_options import CalibrationOptions
from irbcal.declared_options import fields_of
from irbcal.errors import CalibrationError, IrbcalError, MeasurementError
from irbcal.io.schema import Record
from irbcal.measurement.input_table import InputTable
from irbcal.names import check_names
from irbcal.option_values import Progress
from irbcal.safe_files import check_writable, read_bytes, write_together
from irbcal.summary import Paragraph, Result, Table, remarks
from irbcal.validation.verdict import verdict_of

NEEDED = ("id", "measurements", "robot")
KNOWN = (*NEEDED, "serial", "date", "options")
NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
"""What an id may be: it is a folder's name."""
RESERVED = {"fleet.html", "fleet.csv", "fleet.json"}


def _words(text: str) -> list[str]:
    return [word for word in text.split(",") if word]


def _yes(text: str) -> bool:
    if text not in ("yes", "no"):
        raise ValueError
    return text == "yes"


READERS: Mapping[str, Callable[[str], Any]] = {
    "str": str,
    "float": float,
    "int": int,
    "bool": _yes,
    "Sequence[str]": _words,
}
"""How an option is read from a list, by its type."""
OPTIONS = {
    option.name.rstrip("_"): (option, READERS["str" if option.choices or option.is_file else kind])
    for option in fields_of(CalibrationOptions)
    if (kind := option.annotation.removesuffix(" | None")) in READERS or option.choices or option.is_file
    if option.name not in (*NEEDED, "jobs")
}
"""Options of `irbcal.calibrate` that a row may have, and how they are read: all that can be written in a word."""


@dataclass(frozen=True)
class Entry:
    """A robot of the list."""

    id: str
    """Also the name of its folder."""
    serial: str
    """Of the robot; the id where the list has none."""
    measurements: str
    robot: str
    """Paths as a process finds them, or a robot's name."""
    date: str
    """When it was measured, ISO 8601; empty where the list does not say."""
    options: Mapping[str, Any]
    """Of `irbcal.calibrate`."""

    @property
    def name(self) -> str:
        """As messages call it."""
        return f"robot {self.id}"

    def sha256(self) -> str:
        """Fingerprint of the row and of the content of all files that it names, wherever they are.

        Raises
        ------
        MeasurementError
            If one cannot be read.
        """
        files = {name: str(value) for name, value in self.options.items() if OPTIONS[name.rstrip("_")][0].is_file}
        options = {name: value for name, value in self.options.items() if name not in files}
        row = [self.id, self.serial, self.date, Path(self.robot).name, options]
        digest = hashlib.sha256(json.dumps(row, sort_keys=True).encode())
        paths = [Path(path) for path in (self.robot, *files.values())]
        paths = [path / "calibration.json" if path.is_dir() else path for path in paths]
        for path in (Path(self.measurements), *(path for path in paths if path.is_file())):
            digest.update(hashlib.sha256(read_bytes(path, MeasurementError)).digest())
        return digest.hexdigest()


def read_manifest(manifest: str | Path) -> list[Entry]:
    """Read a list of robots.

    Parameters
    ----------
    manifest : str or Path
        CSV with the columns ``id``, ``measurements`` and ``robot``, and, where wanted, ``serial``, ``date``
        (2026-03-17) and ``options`` (``model=34 holdout=0.2``). Paths are counted from its folder.

    Raises
    ------
    MeasurementError
        If a row is no robot, or two have one id.
    """
    table = InputTable.read(manifest, NEEDED, KNOWN)
    folder = Path(table.source).parent.absolute()  # a cluster's workers have working folders of their own
    entries = [_entry(table, row, folder) for row in range(len(table))]
    # a folder's name: some systems take A for a
    table.refuse_repeats("id", [entry.id.casefold() for entry in entries])
    return entries


def _entry(table: InputTable, row: int, folder: Path) -> Entry:
    cells = {str(name): str(text).strip() for name, text in table.cells.iloc[row].items()}

    def wrong(column: str, sentence: str) -> MeasurementError:
        return table.fault(sentence, row, column)

    for column in NEEDED:
        if not cells[column]:
            raise wrong(column, "expected a text, found nothing")
    name = cells["id"]
    if not NAME.fullmatch(name) or name in RESERVED or len(name) > 100:
        raise wrong("id", f"expected letters, digits, '.', '_' and '-' (it names a folder), found {name!r}")
    check_names(cells.values(), MeasurementError, file=table.source)
    day = cells.get("date", "")
    if day:
        try:
            date.fromisoformat(day)
        except ValueError:
            raise wrong("date", f"expected a date such as 2026-03-17, found {day!r}") from None
    options = dict(_option(text, wrong) for text in cells.get("options", "").split())
    for option, _ in OPTIONS.values():
        if option.is_file and option.name in options:
            options[option.name] = str(folder / options[option.name])
    measurements, robot = str(folder / cells["measurements"]), cells["robot"]
    beside = folder / robot
    robot = str(beside) if beside.exists() else robot
    try:
        CalibrationOptions(measurements, robot, **options)
    except IrbcalError as error:
        raise wrong("options", str(error)) from None
    return Entry(name, cells.get("serial") or name, measurements, robot, day, options)


def _option(text: str, wrong: Callable[[str, str], MeasurementError]) -> tuple[str, Any]:
    key, equals, value = text.partition("=")
    key = key.replace("-", "_")
    if not equals or key not in OPTIONS:
        raise wrong("options", f"expected OPTION=VALUE with one of {', '.join(OPTIONS)}, found {text!r}")
    option, read = OPTIONS[key]
    try:
        return option.name, read(value)
    except ValueError:
        kind = {float: "a number", int: "a whole number"}.get(read, "yes or no")  # type: ignore[call-overload]
        raise wrong("options", f"{key}: expected {kind}, found {value!r}") from None


MARK = "fleet.json"
"""In each robot's folder, written last: whose calibration it is, from what, and what it is worth."""


@dataclass(frozen=True)
class RobotOutcome:
    """A robot of a list, calibrated or refused."""

    id: str
    serial: str
    date: str
    robot: str = ""
    model: str = ""
    """Name of the nominal robot, and the error model; empty where it failed."""
    simulated: bool = False
    poses: int = 0
    """Fitted and held out."""
    nominal_mm: float | None = None
    mean_mm: float | None = None
    max_mm: float | None = None
    """Held-out mean error of the nominal robot, mean and largest of the calibrated one."""
    verdict: str = ""
    """In a sentence; where it failed, why."""
    trusted: bool = False
    failed: bool = False
    sha256: str = ""
    """Of the row and its files."""

    @staticmethod
    def from_record(entry: Entry, record: Record, sha256: str) -> RobotOutcome:
        """Of a calibration just made."""
        proven = record.heldout is not None and record.heldout_nominal is not None
        judged = verdict_of(record)
        return RobotOutcome(
            entry.id,
            entry.serial,
            entry.date,
            record.robot.name,
            record.model,
            record.simulated,
            record.poses_fit + record.poses_heldout,
            record.heldout_nominal.all.mean_mm if proven and record.heldout_nominal else None,
            record.heldout.all.mean_mm if proven and record.heldout else None,
            record.heldout.all.max_mm if proven and record.heldout else None,
            judged.sentence(),
            judged.trusted,
            False,
            sha256,
        )

    @staticmethod
    def refused(entry: Entry, reason: str) -> RobotOutcome:
        """Of a robot that could not be calibrated."""
        return RobotOutcome(entry.id, entry.serial, entry.date, verdict=reason, failed=True)

    def mark(self) -> bytes:
        """What `MARK` says."""
        return (json.dumps({"irbcal": "robot of a fleet", **asdict(self)}, indent=1) + "\n").encode()


def read_mark(folder: Path) -> RobotOutcome | None:
    """What the mark of a folder says; None where there is none that can be read."""
    try:
        content = json.loads((folder / MARK).read_bytes())
        content.pop("irbcal")
        return RobotOutcome(**content)
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return None


def finished(entry: Entry, folder: Path) -> RobotOutcome | None:
    """The outcome of a robot that is calibrated already, from the same row and the same files; else None."""
    outcome = read_mark(folder)
    try:
        return outcome if outcome is not None and not outcome.failed and outcome.sha256 == entry.sha256() else None
    except IrbcalError:
        return None


PAGE, TABLE, SIGN = "fleet.html", "fleet.csv", "fleet.json"
CALIBRATION_S = 2.0
"""Seconds that a calibration takes, about."""


@dataclass(frozen=True, eq=False, repr=False)
class CalibratedFleet(Result):
    """What the folder of a fleet holds, and what the call has done.

    Attributes
    ----------
    out : Path
    robots : tuple of RobotOutcome
        In the order of the list.
    calibrated, reused : int
        Robots calibrated by this call, and found calibrated.
    seconds : float
    """

    out: Path
    robots: tuple[RobotOutcome, ...]
    calibrated: int
    reused: int
    seconds: float

    @property
    def failures(self) -> tuple[RobotOutcome, ...]:
        """Robots that could not be calibrated."""
        return tuple(robot for robot in self.robots if robot.failed)

    def report(self) -> Sequence[Paragraph]:
        """How many, a row a robot, and the sentences of those that failed."""
        kind = "SIMULATED: " if any(robot.simulated for robot in self.robots) else ""
        doubtful = sum(not (robot.trusted or robot.failed) for robot in self.robots)
        headline = (
            f"{kind}{len(self.robots)} robots: {len(self.robots) - len(self.failures)} calibrated ({doubtful} of them "
            f"not to be trusted), {len(self.failures)} failed"
        )
        rows = tuple(
            (r.id, r.serial, r.robot, r.nominal_mm, r.mean_mm, r.max_mm, "yes" if r.trusted else "NO")
            for r in self.robots
            if not r.failed
        )
        columns = ("id", "serial", "robot", "nominal mm", "calibrated mm", "largest mm", "trusted")
        return [
            headline,
            *([Table("Held-out errors", columns, rows)] if rows else []),
            *remarks("Doubt", (f"{r.id}: {r.verdict}" for r in self.robots if not (r.trusted or r.failed)), good=False),
            *(f"Failed: {r.id}: {r.verdict}" for r in self.failures),
            f"{self.calibrated} calibrated now, {self.reused} were calibrated already, {self.seconds:.1f} s",
        ]

    ROWS = "robots"
    COLUMNS = "id serial date robot model simulated poses nominal_mm mean_mm max_mm verdict trusted failed"
    CONTENT = "out calibrated reused failed=failures.__len__ seconds robots"


@parallel.on_workers
def fleet_calibrate(
    manifest: str | Path,
    out: str | Path,
    *,
    jobs: int | None = None,
    engine: str | None = None,
    progress: Progress | None = None,
) -> CalibratedFleet:
    """Calibrate every robot of a list, each into its own folder, whole or not at all.

    A second call does what is missing: robots whose row and files are as they were are kept. A robot that cannot be
    calibrated is listed with its sentence and stops none of the others.

    Parameters
    ----------
    manifest : str or Path
        CSV with id, measurements, robot and perhaps serial, date, options, see `irbcal.fleet.batch.read_manifest`.
    out : str or Path
        Folder: one folder a robot, ``fleet.csv`` and the page ``fleet.html``.
    jobs : int, optional
        See `irbcal.parallel.using`.
    engine : str, optional
        See `irbcal.parallel.using`.
    progress : callable, optional
        Called with a short text after each robot.

    Raises
    ------
    MeasurementError
        If the list is refused.
    CalibrationError
        If the folder holds something else, or cannot be written.
    Interrupted
        After the robots under way were finished.
    """
    started = time.perf_counter()
    entries, folder = read_manifest(manifest), Path(out)
    _open(folder)
    done: dict[str, RobotOutcome | None] = {entry.id: finished(entry, folder / entry.id) for entry in entries}
    pending = [entry for entry in entries if done[entry.id] is None]
    finished_before, say = len(entries) - len(pending), progress or (lambda text: None)
    shared = str(folder.absolute())
    try:
        files = [str(folder.absolute() / SIGN), *_some_files(pending)]
        tasks = parallel.each(_calibrate, shared, pending, seconds=CALIBRATION_S, lost=_lost, files=files)
        for count, (index, outcome) in enumerate(tasks, start=1):
            done[pending[index].id] = outcome
            say(f"{count} of {len(pending)} robots")
    except KeyboardInterrupt:
        raise parallel.Interrupted(sum(outcome is None for outcome in done.values()), "robots to calibrate") from None
    robots = tuple(robot for entry in entries if (robot := done[entry.id]) is not None)
    seconds = time.perf_counter() - started
    new = sum(not robot.failed for robot in robots) - finished_before
    result = CalibratedFleet(folder, robots, new, finished_before, seconds)
    _write(result)
    return result


def _some_files(entries: Sequence[Entry]) -> list[str]:
    """One file of each folder that robots are calibrated from."""
    paths = [Path(name).absolute() for entry in entries for name in (entry.measurements, entry.robot)]
    return [str(path) for path in {path.parent: path for path in paths if path.is_file()}.values()]


def _open(folder: Path) -> None:
    """Make the folder of a fleet, or see that it is one.

    Raises
    ------
    CalibrationError
        If it holds something else.
    """
    if folder.is_dir() and any(folder.iterdir()) and not (folder / SIGN).exists():
        raise CalibrationError("expected a new or empty folder, or that of a fleet", file=folder)
    check_writable(folder)
    if not (folder / SIGN).exists():
        write_together(folder, {SIGN: b'{"irbcal": "fleet"}\n'})


def _calibrate(shared: str, entry: Entry) -> RobotOutcome:
    """In a worker: one robot, from its files to its folder."""
    from irbcal.calibration import calibrate

    folder = Path(shared) / entry.id
    try:
        if (done := finished(entry, folder)) is not None:  # repeated, for its worker was lost
            return done
        sha256 = entry.sha256()
        calibration = calibrate(entry.measurements, entry.robot, **entry.options)
        outcome = RobotOutcome.from_record(entry, calibration.record, sha256)
        (folder / MARK).unlink(missing_ok=True)  # it speaks of what is replaced now
        calibration.save(folder, overwrite=True)
        write_together(folder, {MARK: outcome.mark()})
    except IrbcalError as error:
        return RobotOutcome.refused(entry, str(error))
    except Exception as error:  # a robot that irbcal stumbles over must not stop the others
        return RobotOutcome.refused(entry, f"irbcal failed, which is its own fault: {type(error).__name__}: {error}")
    return outcome


def _lost(entry: Entry) -> RobotOutcome:
    return RobotOutcome.refused(entry, "its processes ended by themselves, also alone (out of memory?)")


def _write(result: CalibratedFleet) -> None:
    from irbcal.names import csv_bytes

    write_together(result.out, {TABLE: csv_bytes(result.to_frame()), PAGE: page(result).encode()})


def page(fleet: CalibratedFleet) -> str:
    """The page of a list's calibrations."""
    from irbcal.templates import environment

    largest = max([r.nominal_mm or 0.0 for r in fleet.robots] + [r.mean_mm or 0.0 for r in fleet.robots] + [1e-9])
    return (
        environment("irbcal.fleet")
        .get_template("list.html.j2")
        .render(
            title="Fleet",
            simulated=any(r.simulated for r in fleet.robots),
            headline=fleet.headline(),
            robots=fleet.robots,
            share=lambda length: f"{100.0 * (length or 0.0) / largest:.1f}",
        )
    )
