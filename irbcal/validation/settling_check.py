"""Approaches to a pose, read and judged: stabilisation time and overshoot over several runs (Nubiola 2011, annex V)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from irbcal.arrays import FloatArray, plain
from irbcal.errors import MeasurementError, OptionError
from irbcal.measurement.columns import POSITION, InputTable, TableLike, distinct
from irbcal.plotting.charts import Chart
from irbcal.summary import Paragraph, Result, Table, simulated_mark
from irbcal.units import MM
from irbcal.validation import settling
from irbcal.validation.settling import READINGS, REST, Stabilisation

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False, repr=False)
class Settling(Result):
    """Position stabilisation time and overshoot of several approaches (ISO 9283 asks for three).

    Attributes
    ----------
    band : float
        Limit band, metres.
    rest : float
        Seconds after which the robot was taken to be at rest.
    runs : dict of str to Stabilisation
    simulated : bool
    """

    band: float
    rest: float
    runs: dict[str, Stabilisation]
    simulated: bool = False

    @property
    def time(self) -> float | None:
        """Mean stabilisation time PSt, seconds; None where a run never settled."""
        times = [run.time for run in self.runs.values()]
        return float(np.mean(times)) if np.isfinite(times).all() else None

    @property
    def overshoot(self) -> float | None:
        """Largest overshoot, metres; None where no run entered the band."""
        overshoots = [run.overshoot for run in self.runs.values() if np.isfinite(run.overshoot)]
        return max(overshoots) if overshoots else None

    def to_dict(self) -> dict[str, Any]:
        """What the command prints as JSON, mm and seconds.

        ``check``, ``band_mm``, ``after_s``, ``PSt_s`` (mean), ``overshoot_mm`` (largest), and of each of ``runs``
        these, the instants of entering the band, and the distances over time; None for what never was; ``simulated``.
        """
        return {
            "check": "settle",
            "band_mm": self.band / MM,
            "after_s": self.rest,
            "PSt_s": self.time,
            "overshoot_mm": None if self.overshoot is None else self.overshoot / MM,
            "runs": {
                name: {
                    "PSt_s": plain(run.time),
                    "first_entry_s": plain(run.first_entry),
                    "settled_s": plain(run.settled),
                    "overshoot_mm": plain(run.overshoot / MM),
                    "time_s": run.instant.tolist(),
                    "distance_mm": (run.distance / MM).tolist(),
                }
                for name, run in self.runs.items()
            },
            "simulated": self.simulated,
        }

    def to_frame(self) -> pd.DataFrame:
        """A row for each reading: ``run``, ``time_s``, ``distance_mm`` from the final position."""
        import pandas as pd

        tables = [
            pd.DataFrame({"run": name, "time_s": run.instant, "distance_mm": run.distance / MM})
            for name, run in self.runs.items()
        ]
        return pd.concat(tables, ignore_index=True)

    def report(self) -> Sequence[Paragraph]:
        """Mean time and largest overshoot, and both run by run."""
        rows = tuple(
            (name, *map(plain, (run.first_entry, run.settled, run.time)), plain(run.overshoot / MM))
            for name, run in self.runs.items()
        )
        columns = ("run", "first in band s", "settled s", "PSt s", "overshoot mm")
        mean = "a run never settled" if self.time is None else f"PSt {self.time:.2f} s (mean)"
        largest = "–" if self.overshoot is None else f"{self.overshoot / MM:.3f}"
        title = f"Position stabilisation, limit band {self.band / MM:.4g} mm"
        return [
            f"{simulated_mark(self.simulated)}{mean}, overshoot {largest} mm (largest)",
            Table(title, columns, rows),
        ]

    def plot(self) -> Chart:
        """Distance from the final position over time, with the limit band (Figure A V-1)."""
        from irbcal.validation import plots

        return plots.approaches(self)


def read_approaches(source: TableLike) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Approaches to a pose: columns ``time_s``, ``x_mm``, ``y_mm``, ``z_mm`` and, for several, ``run``.

    Parameters
    ----------
    source : str, Path or DataFrame

    Returns
    -------
    dict of str to (time, xyz)
        Seconds (n,) and metres (n, 3) of each run.

    Raises
    ------
    MeasurementError
        If the file does not keep the format or time does not go on.
    """
    return _approaches(InputTable.read(source, ["time_s"]).measured())


def _approaches(table: InputTable) -> dict[str, tuple[FloatArray, FloatArray]]:
    runs = table.texts("run", "1")
    by_name = {name: table[runs == name] for name in distinct(runs)}
    return {name: (rows.ascending("time_s"), rows.si(POSITION)) for name, rows in by_name.items()}


def settle(source: TableLike, band: float, rest: float = REST, count: int = READINGS) -> Settling:
    """Position stabilisation time and overshoot of the runs of a file (annex V).

    Parameters
    ----------
    source : str, Path or DataFrame
        See `read_approaches`.
    band : float
        Limit band, metres.
    rest : float
        Seconds after which the robot is at rest.
    count : int
        Readings after that whose mean is the final position.

    Raises
    ------
    MeasurementError
        As `read_approaches`, or if a run ends too early.
    OptionError
        If the band is not above zero.
    """
    if not band > 0:
        raise OptionError(f"a limit band is above zero, found {band / MM:g} mm", parameter="band")
    table, runs = InputTable.read(source, ["time_s"]).measured(), {}
    for name, (time, xyz) in _approaches(table).items():
        try:
            final = settling.final_position(time, xyz, rest, count)
        except MeasurementError as error:
            raise MeasurementError(f"run {name}: {error}", file=table.source) from None
        runs[name] = settling.stabilisation(time, xyz, final, band)
    return Settling(band, rest, runs, table.simulated)
