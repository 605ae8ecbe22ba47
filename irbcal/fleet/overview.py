"""All robots of a store with their last calibrations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from irbcal.fleet.comparison import Change, StandsOut
from irbcal.fleet.store import Stored
from irbcal.summary import Paragraph, Result, Table
from irbcal.wording import counted

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
        counts = {"calibration": sum(self.times.values()), "robot": len(self.latest), "type": len(types)}
        text = " of ".join(counted(count, name) for name, count in counts.items())
        headline = f"{kind}{text}; {changed} changed since the calibration before, {out} stand out"
        changes = [f"{robot}: {sentence}" for robot, sentences in self.changed.items() for sentence in sentences]
        return [headline, self.table(), *changes, *self.outstanding_in_words()]

    def table(self) -> Table:
        """A row for each robot, of the first `LISTED`."""
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
        more = len(self.latest) - LISTED
        unlisted = f" ({more} more robots: --json, --type or irbcal fleet export name them)" if more > 0 else ""
        return Table(f"Robots, by their last calibration{unlisted}", columns, rows)

    def outstanding_in_words(self) -> list[str]:
        """A sentence for each robot that stands out of its type."""
        return [
            f"{entry.robot} stands out of type {type} ({entry.deviations:.0f} standard deviations): {entry.sentence}."
            for type, entries in self.outstanding.items()
            for entry in entries
        ]

    CONTENT = "simulated robots=_listed changed outstanding"

    def _listed(self) -> list[dict[str, Any]]:
        return [
            {**stored.robot, "times": self.times[stored.robot["id"]], **stored.calibration} for stored in self.latest
        ]

    @property
    def changed(self) -> dict[str, list[str]]:
        """What really changed of each robot, in sentences."""
        return {robot: step.in_words() for robot, step in self.changes.items() if step.real}
