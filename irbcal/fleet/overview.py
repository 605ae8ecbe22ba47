"""What a store is for: adding calibration folders, listing and exporting them, and what changed over time."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import date, datetime, timezone
from itertools import chain, groupby, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from irbcal.errors import CalibrationError, IdentificationError, IrbcalError, OptionError
from irbcal.fleet import batch
from irbcal.fleet.batch import STORE
from irbcal.fleet.comparison import Change, StandsOut, agreeing, change, high_wave, perhaps_of, standing_out
from irbcal.fleet.store import Estimate, Store, Stored, opened
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
        row = {
            "part": "other",
            "position": len(out),
            "name": parameter.name,
            "value": parameter.value * size,
            "std": std,
        }
        out.append(row | {"prior": None, "natural": None, "unit": unit, "state": parameter.state})
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


def fleet_add(
    calibrations: Sequence[str | Path] | str | Path,
    store: str | Path = STORE,
    *,
    id: str | None = None,
    serial: str | None = None,
    date: str | None = None,
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
    progress : callable, optional
        Called with a short text after each.

    Raises
    ------
    CalibrationError
        If one is no calibration, contradicts the store, or the store fails: those before it stay added.
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
    added: list[str] = []
    known_before: list[str] = []
    first = [stored(folder, id, serial, date) for folder in folders[:1]]  # no store is made for what is none
    rest_stored = (stored(folder, id, serial, date) for folder in folders[1:])
    with opened(store, create=True) as database:
        for folder, calibration in zip(folders, chain(first, rest_stored), strict=True):
            (added if database.add(calibration) else known_before).append(str(folder))
            if progress is not None:
                progress(f"{len(added) + len(known_before)} of {len(folders)} calibrations")
        name = database.engine.url.render_as_string(hide_password=True) if "://" in str(store) else str(store)
    return Added(name, tuple(added), tuple(known_before))


def _folders(path: Path) -> list[Path]:
    """The calibration folders that a path stands for: itself, or those of a fleet."""
    from irbcal.fleet.batch import MARK, SIGN

    if (path / SIGN).is_file() and not (path / JSON_NAME).exists():
        folders = sorted(child for child in path.iterdir() if (child / MARK).is_file())
        if not folders:
            raise CalibrationError("a fleet without a calibrated robot", file=path)
        return folders
    return [path]


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
            for stored in self.latest
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
        return [headline, Table("Robots, by their last calibration", columns, rows), *changes, *outstanding]

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
        changes: dict[str, Change] = {}
        changed: list[Stored] = []
        fleet: list[Stored] = []
        for _, history in groupby(_levels(database, type=type), key=lambda stored: stored.robot["id"]):
            calibrations = list(history)
            if len(calibrations) > 1:
                step = changes[calibrations[-1].robot["id"]] = change(*calibrations)
                changed += calibrations[1:] if step.real else []
            fleet += map(_light, calibrations)
        for stored in changed:
            robot = stored.robot["id"]
            changes[robot] = _with_sisters(changes[robot], stored, fleet, database)
    latest = {stored.robot["id"]: stored for stored in fleet}
    by_type: dict[str, list[Stored]] = {}
    for stored in latest.values():
        by_type.setdefault(stored.robot["type"], []).append(stored)
    outstanding = {kind: tuple(robots) for kind, sisters in by_type.items() if (robots := standing_out(sisters))}
    times = {robot: count for robot, (count, _) in counts.items()}
    simulated = any(of_simulated for _, of_simulated in counts.values())
    overview = Overview(tuple(latest.values()), times, simulated, changes, outstanding)
    if report is not None:
        write_together(Path(report).parent, {Path(report).name: render_store(overview).encode()})
    return overview


def _levels(database: Store, robot: str | None = None, type: str | None = None) -> Iterator[Stored]:
    """The last two calibrations of robots, or all of one, with their levels."""
    return database.calibrations(robot, type, last=2 if robot is None else None, parts=("level",))


def _light(stored: Stored) -> Stored:
    return stored if stored.level is None else replace(stored, level=stored.level.without_covariance())


def _with_sisters(step: Change, second: Stored, fleet: Sequence[Stored], database: Store) -> Change:
    """A change, with the other robots whose last two calibrations agree with the later one."""
    numbers = {stored.calibration["number"] for stored in perhaps_of(second, fleet)}
    robots = {stored.robot["id"] for stored in fleet if stored.calibration["number"] in numbers}
    others = (stored for robot in sorted(robots) for stored in _levels(database, robot))
    return replace(step, sisters=agreeing(second, (one for one in others if one.calibration["number"] in numbers)))


@dataclass(frozen=True, eq=False, repr=False)
class Drift(Result):
    """What changed in a robot from calibration to calibration.

    Attributes
    ----------
    robot : str
    calibrations : tuple of Stored
        In the order of their dates.
    changes : tuple of Change
        From each to the next.
    """

    robot: str
    calibrations: tuple[Stored, ...]
    changes: tuple[Change, ...]

    def report(self) -> Sequence[Paragraph]:
        """A sentence or more for each step."""
        kind = "SIMULATED: " if any(stored.calibration["simulated"] for stored in self.calibrations) else ""
        head = self.calibrations[-1].robot
        count = sum(step.real for step in self.changes)
        steps = f"{len(self.changes)} step{'s' if len(self.changes) != 1 else ''}"
        return [
            f"{kind}{self.robot} (serial {head['serial']}, {head['type']}): {count} of {steps} a change",
            *(sentence for step in self.changes for sentence in step.in_words()),
        ]

    CONTENT = "robot changes=to_frame"
    ROWS, COLUMNS = "changes", "before after chi2 directions p changed=real sisters parameters words=in_words"


def fleet_drift(robot: str, store: str | Path = STORE) -> Drift:
    """What changed in a robot between its calibrations by more than their uncertainty.

    Parameters
    ----------
    robot : str
        Its id.
    store : str or Path
        See `fleet_add`.

    Raises
    ------
    CalibrationError
        If the store has fewer than two calibrations of it.
    """
    with opened(store) as database:
        calibrations = list(_levels(database, robot))
        if len(calibrations) < 2:
            ids = [row["id"] for row in database.robots()]
            count_text = "1 calibration" if calibrations else f"none of the {len(ids)} robots is it, and no calibration"
            raise CalibrationError(
                f"{robot}: two calibrations are needed to see a change, found {count_text}", file=str(store)
            )
        changes = [change(*pair) for pair in pairwise(calibrations)]
        if any(step.real for step in changes):
            fleet = [_light(stored) for stored in _levels(database, type=calibrations[-1].robot["type"])]
            changes = [
                _with_sisters(step, second, fleet, database) if step.real else step
                for step, second in zip(changes, calibrations[1:], strict=True)
            ]
    return Drift(robot, tuple(calibrations), tuple(changes))


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
    with opened(store) as database:
        frame = database.table(name)
        if "calibration" in frame:
            heads = database.table("calibrations").set_index("number")[["robot", "measured"]]
            absent = sorted(set(frame["calibration"]) - set(heads.index))
            if absent:
                raise CalibrationError(
                    f"this store is damaged: table {name} names calibration {absent[0]}, which is not there",
                    file=str(store),
                )
            frame = heads.loc[frame["calibration"]].reset_index(drop=True).join(frame)
    if path.suffix == ".csv":
        from irbcal.names import csv_bytes

        content = csv_bytes(frame)
    else:
        try:
            content = frame.to_parquet(index=False, engine="pyarrow")
        except ImportError:
            raise OptionError("out: Parquet needs pyarrow: pip install 'irbcal[parquet]'", parameter="out") from None
    write_together(path.parent, {path.name: content})
    return len(frame)


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
