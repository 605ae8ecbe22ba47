"""What a store is for: adding calibrations, listing and exporting them, and what changed over time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import chain, pairwise
from pathlib import Path
from typing import Any

from irbcal.arrays import lock
from irbcal.atomic import write_together
from irbcal.errors import CalibrationError, OptionError
from irbcal.fleet.change import Change, change
from irbcal.fleet.records import stored
from irbcal.fleet.sisters import StandsOut, latest, standing_out
from irbcal.fleet.store import Stored, opened
from irbcal.summary import Speaks, Table, Told

STORE = "fleet.db"
EXPORTED = ("robots", "calibrations", "parameters", "files")


@dataclass(frozen=True, eq=False, repr=False)
class Added(Speaks):
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

    def __post_init__(self) -> None:
        lock(self)

    def told(self) -> Sequence[Told]:
        """How many."""
        return [f"{len(self.added)} calibrations added to {self.store}, {len(self.there)} were there"]

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        return {"store": self.store, "added": list(self.added), "there": list(self.there)}


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

    Returns
    -------
    Added

    Raises
    ------
    CalibrationError
        If one is no calibration, contradicts the store, or the store fails: those before it stay added.
    OptionError
        If ``id``, ``serial`` or ``date`` are given for several.
    """
    given = [calibrations] if isinstance(calibrations, (str, Path)) else list(calibrations)
    folders = [folder for path in given for folder in _folders(Path(path))]
    for option, value in (("id", id), ("serial", serial), ("date", date)):
        if value is not None and len(folders) != 1:
            raise OptionError(f"{option}: it is of a single calibration, found {len(folders)}", parameter=option)
    added: list[str] = []
    there: list[str] = []
    first = [stored(folder, id, serial, date) for folder in folders[:1]]  # no store is made for what is none
    others = (stored(folder, id, serial, date) for folder in folders[1:])
    with opened(store, create=True) as held:
        for folder, calibration in zip(folders, chain(first, others), strict=True):
            (added if held.add(calibration) else there).append(str(folder))
            if progress is not None:
                progress(f"{len(added) + len(there)} of {len(folders)} calibrations")
        name = held.engine.url.render_as_string(hide_password=True) if "://" in str(store) else str(store)
    return Added(name, tuple(added), tuple(there))


def _folders(path: Path) -> list[Path]:
    """The calibration folders that a path stands for: itself, or those of a fleet."""
    from irbcal.files.calibration_folder import JSON_NAME
    from irbcal.fleet.calibrated import SIGN
    from irbcal.fleet.outcomes import MARK

    if (path / SIGN).is_file() and not (path / JSON_NAME).exists():
        found = sorted(child for child in path.iterdir() if (child / MARK).is_file())
        if not found:
            raise CalibrationError("a fleet without a calibrated robot", file=path)
        return found
    return [path]


@dataclass(frozen=True, eq=False, repr=False)
class Overview(Speaks):
    """All robots of a store.

    Attributes
    ----------
    calibrations : tuple of Stored
        Robots by their ids, each in the order of its dates.
    changes : dict of str to Change
        What changed between the last two calibrations of each robot that has two.
    outstanding : dict of str to tuple of StandsOut
        Robots that stand out of their type.
    """

    calibrations: tuple[Stored, ...]
    changes: dict[str, Change]
    outstanding: dict[str, tuple[StandsOut, ...]]

    @property
    def simulated(self) -> bool:
        """Whether any calibration is from simulated measurements."""
        return any(one.calibration["simulated"] for one in self.calibrations)

    def headline(self) -> str:
        """How many, in one line."""
        kind = "SIMULATED: " if self.simulated else ""
        robots = {one.robot["id"] for one in self.calibrations}
        types = {one.robot["type"] for one in self.calibrations}
        changed = sum(found.real for found in self.changes.values())
        out = sum(map(len, self.outstanding.values()))
        return (
            f"{kind}{len(self.calibrations)} calibrations of {len(robots)} robots of {len(types)} "
            f"type{'s' if len(types) != 1 else ''}; {changed} changed since the calibration before, {out} stand out"
        )

    def told(self) -> Sequence[Told]:
        """A row a robot; what changed; which stand out."""
        times: dict[str, int] = {}
        for one in self.calibrations:
            times[one.robot["id"]] = times.get(one.robot["id"], 0) + 1
        rows = tuple(
            (
                one.robot["id"],
                one.robot["serial"],
                one.robot["type"],
                str(one.measured),
                times[one.robot["id"]],
                one.calibration["model"],
                one.calibration["nominal_mean_mm"],
                one.calibration["heldout_mean_mm"],
                one.calibration["heldout_max_mm"],
            )
            for one in latest(self.calibrations)
        )
        columns = ("id", "serial", "type", "last", "times", "model", "nominal mm", "calibrated mm", "largest mm")
        changed = [
            f"{robot}: {sentence}"
            for robot, found in self.changes.items()
            if found.real
            for sentence in found.in_words()
        ]
        outstanding = [
            f"{item.robot} stands out of type {type} ({item.deviations:.0f} standard deviations): {item.words}."
            for type, items in self.outstanding.items()
            for item in items
        ]
        return [self.headline(), Table("Robots, by their last calibration", columns, rows), *changed, *outstanding]

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        return {
            "simulated": self.simulated,
            "calibrations": [
                {**one.robot} | {k: str(v) if k == "measured" else v for k, v in one.calibration.items()}
                for one in self.calibrations
            ],
            "changed": {robot: found.in_words() for robot, found in self.changes.items() if found.real},
            "outstanding": {type: [vars(item) for item in items] for type, items in self.outstanding.items()},
        }


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

    Returns
    -------
    Overview

    Raises
    ------
    CalibrationError
        If the store cannot be read, or has no such robots.
    """
    with opened(store) as held:
        found = held.calibrations(type=type)
    if not found:
        raise CalibrationError(f"the store has no calibrations{f' of type {type}' if type else ''}")
    by_robot: dict[str, list[Stored]] = {}
    by_type: dict[str, list[Stored]] = {}
    for one in found:
        by_robot.setdefault(one.robot["id"], []).append(one)
    for one in latest(found):
        by_type.setdefault(one.robot["type"], []).append(one)
    changes = {robot: change(items[-2], items[-1], found) for robot, items in by_robot.items() if len(items) > 1}
    outstanding = {kind: tuple(items) for kind, sisters in by_type.items() if (items := standing_out(sisters))}
    overview = Overview(tuple(found), changes, outstanding)
    if report is not None:
        from irbcal.fleet.page import render_store

        write_together(Path(report).parent, {Path(report).name: render_store(overview).encode()})
    return overview


@dataclass(frozen=True, eq=False, repr=False)
class Drift(Speaks):
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

    def told(self) -> Sequence[Told]:
        """A sentence or more for each step."""
        kind = "SIMULATED: " if any(one.calibration["simulated"] for one in self.calibrations) else ""
        head = self.calibrations[-1].robot
        count = sum(item.real for item in self.changes)
        steps = f"{len(self.changes)} step{'s' if len(self.changes) != 1 else ''}"
        return [
            f"{kind}{self.robot} (serial {head['serial']}, {head['type']}): {count} of {steps} a change",
            *(sentence for item in self.changes for sentence in item.in_words()),
        ]

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON; values in SI units."""
        return {
            "robot": self.robot,
            "changes": [
                {
                    "before": str(item.before),
                    "after": str(item.after),
                    "chi2": item.chi2,
                    "directions": item.directions,
                    "p": item.p,
                    "changed": item.real,
                    "sisters": list(item.sisters),
                    "parameters": [vars(one) for one in item.parameters],
                    "words": item.in_words(),
                }
                for item in self.changes
            ],
        }


def fleet_drift(robot: str, store: str | Path = STORE) -> Drift:
    """What changed in a robot between its calibrations by more than their uncertainty.

    Parameters
    ----------
    robot : str
        Its id.
    store : str or Path
        See `fleet_add`.

    Returns
    -------
    Drift

    Raises
    ------
    CalibrationError
        If the store has fewer than two calibrations of it.
    """
    with opened(store) as held:
        found = held.calibrations(robot=robot)
        every = held.calibrations(type=found[-1].robot["type"]) if found else []
        if len(found) < 2:
            known = [row["id"] for row in held.robots()]
            there = "1 calibration" if found else f"none of the {len(known)} robots is it, and no calibration"
            raise CalibrationError(
                f"{robot}: two calibrations are needed to see a change, found {there}", file=str(store)
            )
    return Drift(robot, tuple(found), tuple(change(*pair, every) for pair in pairwise(found)))


def fleet_export(store: str | Path, out: str | Path, *, what: str = "parameters") -> int:
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
    with opened(store) as held:
        frame = held.table(name)
        if "calibration" in frame:
            heads = held.table("calibrations").set_index("number")[["robot", "measured"]]
            absent = sorted(set(frame["calibration"]) - set(heads.index))
            if absent:
                raise CalibrationError(
                    f"this store is damaged: table {name} names calibration {absent[0]}, which is not there",
                    file=str(store),
                )
            frame = heads.loc[frame["calibration"]].reset_index(drop=True).join(frame)
    if path.suffix == ".csv":
        from irbcal.names import without_formulas

        content = without_formulas(frame).to_csv(index=False, lineterminator="\n").encode()
    else:
        try:
            content = frame.to_parquet(index=False, engine="pyarrow")
        except ImportError:
            raise OptionError("out: Parquet needs pyarrow: pip install 'irbcal[parquet]'", parameter="out") from None
    write_together(path.parent, {path.name: content})
    return len(frame)
