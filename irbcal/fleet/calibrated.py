"""Calibrating a fleet: every robot of a list into a folder of its own."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from irbcal import parallel
from irbcal.arrays import lock
from irbcal.atomic import check_writable, write_together
from irbcal.errors import CalibrationError, IrbcalError
from irbcal.fleet import manifest as lists
from irbcal.fleet import outcomes
from irbcal.fleet.manifest import Entry
from irbcal.fleet.outcomes import Outcome
from irbcal.summary import Speaks, Table, Told

if TYPE_CHECKING:
    import pandas as pd

PAGE, TABLE, SIGN = "fleet.html", "fleet.csv", "fleet.json"
CALIBRATION_S = 2.0
"""Seconds that a calibration takes, about."""


@dataclass(frozen=True, eq=False, repr=False)
class CalibratedFleet(Speaks):
    """What the folder of a fleet holds, and what the call has done.

    Attributes
    ----------
    out : Path
    robots : tuple of Outcome
        In the order of the list.
    made, kept : int
        Robots calibrated by this call, and found calibrated.
    seconds : float
    """

    out: Path
    robots: tuple[Outcome, ...]
    made: int
    kept: int
    seconds: float

    def __post_init__(self) -> None:
        lock(self)

    @property
    def failures(self) -> tuple[Outcome, ...]:
        """Robots that could not be calibrated."""
        return tuple(robot for robot in self.robots if robot.failed)

    def headline(self) -> str:
        """How many, in one line."""
        kind = "SIMULATED: " if any(robot.simulated for robot in self.robots) else ""
        doubtful = sum(not (robot.trusted or robot.failed) for robot in self.robots)
        return (
            f"{kind}{len(self.robots)} robots: {len(self.robots) - len(self.failures)} calibrated ({doubtful} of them "
            f"not to be trusted), {len(self.failures)} failed"
        )

    def told(self) -> Sequence[Told]:
        """A row a robot, and the sentences of those that failed."""
        rows = tuple(
            (r.id, r.serial, r.robot, r.nominal_mm, r.mean_mm, r.max_mm, "yes" if r.trusted else "NO")
            for r in self.robots
            if not r.failed
        )
        columns = ("id", "serial", "robot", "nominal mm", "calibrated mm", "largest mm", "trusted")
        return [
            self.headline(),
            *([Table("Held-out errors", columns, rows)] if rows else []),
            *(f"Doubt: {r.id}: {r.verdict}" for r in self.robots if not (r.trusted or r.failed)),
            *(f"Failed: {r.id}: {r.verdict}" for r in self.failures),
            f"{self.made} calibrated now, {self.kept} found calibrated, {self.seconds:.1f} s",
        ]

    def to_frame(self) -> pd.DataFrame:
        """A row a robot, the attributes of `Outcome`."""
        import pandas as pd

        return pd.DataFrame([asdict(robot) for robot in self.robots]).drop(columns="sha256")

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        return {
            "out": str(self.out),
            "made": self.made,
            "kept": self.kept,
            "failed": len(self.failures),
            "seconds": self.seconds,
            "robots": [asdict(robot) for robot in self.robots],
        }


@parallel.on_workers
def fleet_calibrate(
    manifest: str | Path,
    out: str | Path,
    *,
    jobs: int | None = None,
    engine: str | None = None,
    progress: Callable[[str], Any] | None = None,
) -> CalibratedFleet:
    """Calibrate every robot of a list, each into its own folder, whole or not at all.

    A second call does what is missing: robots whose row and files are as they were are kept. A robot that cannot be
    calibrated is listed with its sentence and stops none of the others.

    Parameters
    ----------
    manifest : str or Path
        CSV, see `irbcal.fleet.manifest.read`.
    out : str or Path
        Folder: one folder a robot, ``fleet.csv`` and the page ``fleet.html``.
    jobs : int, optional
        Processes; as many as there are cores unless given. Calibrations do not depend on it.
    engine : str, optional
        ``dask://HOST:PORT``: the workers of a Dask cluster, see `irbcal.parallel.using`; they need the same paths.
    progress : callable, optional
        Called with a short text after each robot.

    Returns
    -------
    CalibratedFleet

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
    entries, folder = lists.read(manifest), Path(out)
    _open(folder)
    found: dict[str, Outcome | None] = {entry.id: outcomes.done(entry, folder / entry.id) for entry in entries}
    left = [entry for entry in entries if found[entry.id] is None]
    kept, say = len(entries) - len(left), progress or (lambda text: None)
    shared = str(folder.absolute())
    try:
        tasks = parallel.each(_calibrate, shared, left, seconds=CALIBRATION_S, lost=_lost)
        for count, (place, outcome) in enumerate(tasks, start=1):
            found[left[place].id] = outcome
            say(f"{count} of {len(left)} robots")
    except KeyboardInterrupt:
        raise parallel.Interrupted(sum(one is None for one in found.values()), "robots to calibrate") from None
    robots = tuple(one for entry in entries if (one := found[entry.id]) is not None)
    seconds = time.perf_counter() - started
    made = sum(not robot.failed for robot in robots) - kept
    result = CalibratedFleet(folder, robots, made, kept, seconds)
    _write(result)
    return result


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


def _calibrate(shared: str, entry: Entry) -> Outcome:
    """In a worker: one robot, from its files to its folder."""
    from irbcal.calibration import calibrate

    folder = Path(shared) / entry.id
    try:
        sha256 = entry.sha256()
        calibration = calibrate(entry.measurements, entry.robot, **entry.options)
        outcome = Outcome.of(entry, calibration.record, sha256)
        (folder / outcomes.MARK).unlink(missing_ok=True)  # it speaks of what is replaced now
        calibration.save(folder)
        write_together(folder, {outcomes.MARK: outcome.mark()})
    except IrbcalError as error:
        return Outcome.refused(entry, str(error))
    except Exception as error:  # a robot that irbcal stumbles over must not stop the others
        return Outcome.refused(entry, f"irbcal failed, which is its own fault: {type(error).__name__}: {error}")
    return outcome


def _lost(entry: Entry) -> Outcome:
    return Outcome.refused(entry, "its processes ended by themselves, also alone (out of memory?)")


def _write(result: CalibratedFleet) -> None:
    from irbcal.fleet.page import render
    from irbcal.names import without_formulas

    table = without_formulas(result.to_frame()).to_csv(index=False, lineterminator="\n")
    write_together(result.out, {TABLE: table.encode(), PAGE: render(result).encode()})
