"""What came of a robot of the list, and the mark in its folder that it is done."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from irbcal.errors import IrbcalError
from irbcal.files.schema import Record
from irbcal.fleet.manifest import Entry
from irbcal.validation.verdict import verdict_of

MARK = "fleet.json"
"""In each robot's folder, written last: whose calibration it is, from what, and what it is worth."""


@dataclass(frozen=True)
class Outcome:
    """A robot of a list, calibrated or refused.

    Attributes
    ----------
    id, serial, date : str
    robot, model : str
        Name of the nominal robot, and the error model; empty where it failed.
    simulated : bool
    poses : int
        Fitted and held out.
    nominal_mm, mean_mm, max_mm : float or None
        Held-out mean error of the nominal robot, mean and largest of the calibrated one.
    verdict : str
        In a sentence; where it failed, why.
    trusted : bool
    failed : bool
    sha256 : str
        Of the row and its files.
    """

    id: str
    serial: str
    date: str
    robot: str = ""
    model: str = ""
    simulated: bool = False
    poses: int = 0
    nominal_mm: float | None = None
    mean_mm: float | None = None
    max_mm: float | None = None
    verdict: str = ""
    trusted: bool = False
    failed: bool = False
    sha256: str = ""

    @staticmethod
    def of(entry: Entry, record: Record, sha256: str) -> Outcome:
        """Of a calibration just made."""
        proven = record.heldout is not None and record.heldout_nominal is not None
        found = verdict_of(record)
        return Outcome(
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
            found.sentence(),
            found.trusted,
            False,
            sha256,
        )

    @staticmethod
    def refused(entry: Entry, why: str) -> Outcome:
        """Of a robot that could not be calibrated."""
        return Outcome(entry.id, entry.serial, entry.date, verdict=why, failed=True)

    def mark(self) -> bytes:
        """What `MARK` says."""
        return (json.dumps({"irbcal": "robot of a fleet", **asdict(self)}, indent=1) + "\n").encode()


def read_mark(folder: Path) -> Outcome | None:
    """What the mark of a folder says; None where there is none that can be read."""
    try:
        content = json.loads((folder / MARK).read_bytes())
        content.pop("irbcal")
        return Outcome(**content)
    except (OSError, ValueError, TypeError, KeyError, AttributeError):
        return None


def done(entry: Entry, folder: Path) -> Outcome | None:
    """The outcome of a robot that is calibrated already, from the same row and the same files; else None."""
    found = read_mark(folder)
    try:
        return found if found is not None and not found.failed and found.sha256 == entry.sha256() else None
    except IrbcalError:
        return None
